//! A map of clusters as a grid.

use super::builder::{cell_of, traverse};
use super::{Cell, FreeArea, GridError, MOST_CELLS, OccupancyGrid};
use crate::geometry::Pose;
use crate::ppca::Cluster;
use nalgebra::Point2;

/// Unknown cells around what is drawn.
const MARGIN: f64 = 2.0;

/// A grid of walls, as thin as a cell, and of the free area between them, in cells of side `resolution` \[m\].
///
/// # Errors
/// It would have too many cells, or there is nothing to draw.
pub fn drawn(clusters: &[Cluster], free: Option<&FreeArea>, resolution: f64) -> Result<OccupancyGrid, GridError> {
    let segments = clusters.iter().map(|cluster| cluster.endpoints().map(|end| end / resolution));
    let is_finite = |ends: &[Point2<f64>; 2]| ends.iter().flat_map(|end| end.iter()).all(|v| v.is_finite());
    let segments: Vec<[Point2<f64>; 2]> = segments.filter(is_finite).collect();
    let area = free.into_iter().flat_map(FreeArea::corners).map(|corner| corner / resolution);
    let mut corners = segments.iter().flatten().copied().chain(area);
    let first = corners.next().ok_or(GridError::Empty)?;
    let (low, high) = corners.fold((first, first), |(low, high), corner| (low.inf(&corner), high.sup(&corner)));
    let (low, high) = (low.map(|v| (v - MARGIN).floor()), high.map(|v| (v + MARGIN).ceil()));
    let size = high - low;
    if size.x * size.y > MOST_CELLS as f64 {
        return Err(GridError::TooLarge { width: size.x * resolution, height: size.y * resolution, resolution });
    }
    let [width, height] = [size.x as u32, size.y as u32];
    let corner = Pose::new(low.x * resolution, low.y * resolution, 0.0);
    let mut grid =
        OccupancyGrid::new(resolution, corner, width, height, vec![Cell::Unknown; (width * height) as usize])?;
    if let Some(free) = free {
        for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
            if free.contains(grid.centre(column.into(), row.into())) {
                grid.cells[(row * width + column) as usize] = Cell::Free;
            }
        }
    }
    let mut occupy =
        |[column, row]: [i64; 2]| grid.cells[row as usize * width as usize + column as usize] = Cell::Occupied;
    for [from, to] in segments {
        let (from, to) = (from - low.coords, to - low.coords);
        traverse(from, to, &mut occupy);
        occupy(cell_of(to));
    }
    Ok(grid)
}
