//! Where a robot can be.

use super::{Cell, OccupancyGrid};
use crate::geometry::Pose;
use nalgebra::Point2;

/// Side of a cell \[m\], about: a whole number of the grid's cells.
const CELL: f64 = 0.25;
/// A cell is free where more than this share of it is known to be free ...
const FREE_SHARE: f64 = 0.5;
/// ... and at most this share occupied: a speck, but no wall.
const OCCUPIED_SHARE: f64 = 0.1;
/// A file may describe an area of any size.
const MOST_POINTS: usize = 1_000_000;
/// Farthest column or row that a file may name.
const FARTHEST_CELL: u32 = 1 << 24;

/// The area where the centre of a robot can be: free cells of a raster, row by row as runs.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeArea {
    cell: f64,
    world_from_grid: Pose,
    /// By row, then by column; never empty.
    runs: Vec<Run>,
}

/// Cells `start` up to `end`, without it, of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Run {
    row: u32,
    start: u32,
    end: u32,
    /// Cells of all runs before this one.
    before: u64,
}

impl FreeArea {
    /// The free area of a grid: cells of about 0.25 m, most of them known to be free and with no wall in them, and
    /// connected with a place where the robot drove. A cell that it drove through is free whatever was seen in it.
    ///
    /// `driven` are positions of the robot, in the world's frame \[m\]. Where none of them is in the grid, the largest
    /// connected area counts: rays through windows make others that no robot comes to. `None` where nothing is free.
    pub fn from_grid(grid: &OccupancyGrid, driven: impl IntoIterator<Item = Point2<f64>>) -> Option<Self> {
        let factor = (CELL / grid.resolution()).round().max(1.0) as u32;
        let cell = f64::from(factor) * grid.resolution();
        let mut raster = Raster::coarsened(grid, factor);
        let grid_from_world = grid.world_from_grid().inverse();
        let driven = driven.into_iter().filter_map(|point| raster.index(grid_from_world * point / cell));
        let driven: Vec<usize> = driven.collect();
        driven.iter().for_each(|&index| raster.free[index] = true);
        raster.keep_connected(&driven);
        let rows = raster.free.chunks(raster.width).map(|row| {
            let columns: Vec<u32> = (0..).zip(row).filter_map(|(column, &free)| free.then_some(column)).collect();
            let runs = columns.chunk_by(|a, b| a + 1 == *b);
            runs.filter_map(|run| Some([*run.first()?, run.last()? + 1])).collect()
        });
        let rows: Vec<Vec<[u32; 2]>> = rows.collect();
        Self::from_rows(cell, grid.world_from_grid(), &rows).ok()
    }

    /// The area of these runs, `[start, end)` in cells of side `cell` \[m\], row by row from the pose
    /// `world_from_grid`; or what is wrong with them.
    pub(crate) fn from_rows(cell: f64, world_from_grid: Pose, rows: &[Vec<[u32; 2]>]) -> Result<Self, String> {
        if !(1e-3..=1e3).contains(&cell) {
            return Err(format!("its cell_size is {cell}, but has to be 0.001 to 1000 m"));
        }
        if !world_from_grid.is_finite() {
            return Err("its origin is not finite".to_owned());
        }
        let (mut runs, mut before) = (Vec::new(), 0);
        for (row, ends) in (0..).zip(rows) {
            let mut free_until = 0;
            for &[start, end] in ends {
                if start < free_until || end <= start || end > FARTHEST_CELL || row > FARTHEST_CELL {
                    return Err(format!("row {row} (from 0) has a run [{start}, {end}] out of order or range"));
                }
                runs.push(Run { row, start, end, before });
                before += u64::from(end - start);
                free_until = end;
            }
        }
        if runs.is_empty() {
            return Err("it has no free cell".to_owned());
        }
        Ok(Self { cell, world_from_grid, runs })
    }

    /// The runs `[start, end)` of each row, from the lowest to the last that has any.
    pub fn rows(&self) -> Vec<Vec<[u32; 2]>> {
        let mut rows = vec![Vec::new(); self.runs.last().map_or(0, |run| run.row as usize + 1)];
        self.runs.iter().for_each(|run| rows[run.row as usize].push([run.start, run.end]));
        rows
    }

    /// Side of a cell \[m\].
    pub fn cell_size(&self) -> f64 {
        self.cell
    }

    /// Where column 0 of row 0 begins; rows run along its heading.
    pub fn world_from_grid(&self) -> Pose {
        self.world_from_grid
    }

    /// The ends of its runs, in the world's frame: all of it lies between them.
    pub(super) fn corners(&self) -> impl Iterator<Item = Point2<f64>> + '_ {
        self.runs.iter().flat_map(|run| {
            let corners = [(run.start, run.row), (run.end, run.row), (run.start, run.row + 1), (run.end, run.row + 1)];
            corners.map(|(x, y)| self.world_from_grid * (Point2::new(f64::from(x), f64::from(y)) * self.cell))
        })
    }

    /// Whether a point of the world \[m\] is in it.
    pub fn contains(&self, point: Point2<f64>) -> bool {
        let at = self.world_from_grid.inverse() * point / self.cell;
        let (column, row) = (at.x.floor(), at.y.floor());
        let after = self.runs.partition_point(|run| (f64::from(run.row), f64::from(run.start)) <= (row, column));
        let run = after.checked_sub(1).map(|index| self.runs[index]);
        run.is_some_and(|run| f64::from(run.row) == row && column < f64::from(run.end))
    }

    /// Points of the area \[m\], of its rows and columns one every `spacing` \[m\]; at most a million.
    pub fn points(&self, spacing: f64) -> Vec<Point2<f64>> {
        let every = (spacing / self.cell).round().max(1.0) as u32;
        let middle = |cell: u32| (f64::from(cell) + 0.5) * self.cell;
        let rows = self.runs.iter().filter(|run| run.row.is_multiple_of(every));
        let points = rows.flat_map(|run| {
            let columns = (run.start.next_multiple_of(every)..run.end).step_by(every as usize);
            columns.map(|column| self.world_from_grid * Point2::new(middle(column), middle(run.row)))
        });
        points.take(MOST_POINTS).collect()
    }

    /// Its size \[m²\].
    pub fn area(&self) -> f64 {
        self.cells() as f64 * self.cell * self.cell
    }

    /// A point of the world \[m\], uniform over the area where `uniform` are two numbers uniform in [0, 1).
    pub fn sample(&self, uniform: [f64; 2]) -> Point2<f64> {
        // As if all runs lay behind one another, a cell high.
        let [along, up] = uniform.map(|u| u.clamp(0.0, 1.0 - f64::EPSILON));
        let along = along * self.cells() as f64;
        let after = self.runs.partition_point(|run| run.before as f64 <= along);
        let Some(run) = self.runs.get(after.saturating_sub(1)) else { return self.world_from_grid.position() };
        let (x, y) = (f64::from(run.start) + along - run.before as f64, f64::from(run.row) + up);
        self.world_from_grid * (Point2::new(x, y) * self.cell)
    }

    fn cells(&self) -> u64 {
        self.runs.last().map_or(0, |run| run.before + u64::from(run.end - run.start))
    }
}

/// Free cells, row by row.
struct Raster {
    width: usize,
    free: Vec<bool>,
}

impl Raster {
    fn coarsened(grid: &OccupancyGrid, factor: u32) -> Self {
        let [width, height] = [grid.width(), grid.height()].map(|side| side.div_ceil(factor) as usize);
        let mut counts = vec![[0_u32; 2]; width * height];
        for (kind, cell) in [Cell::Free, Cell::Occupied].into_iter().enumerate() {
            for [column, row] in grid.places(cell) {
                let [column, row] = [column, row].map(|i| i as usize / factor as usize);
                counts[row * width + column][kind] += 1;
            }
        }
        let whole = f64::from(factor).powi(2);
        let is_free = |[free, occupied]: [u32; 2]| {
            f64::from(free) > FREE_SHARE * whole && f64::from(occupied) <= OCCUPIED_SHARE * whole
        };
        Self { width, free: counts.into_iter().map(is_free).collect() }
    }

    /// Where a point is whose unit is the cell.
    fn index(&self, point: Point2<f64>) -> Option<usize> {
        let (width, height) = (self.width as f64, (self.free.len() / self.width) as f64);
        let inside = (0.0..width).contains(&point.x) && (0.0..height).contains(&point.y);
        inside.then_some(point.y as usize * self.width + point.x as usize)
    }

    /// Leaves only what is connected with one of these cells, or, of none, the largest connected area.
    fn keep_connected(&mut self, driven: &[usize]) {
        let mut area_of = vec![None; self.free.len()];
        let mut sizes: Vec<usize> = Vec::new();
        for start in 0..self.free.len() {
            if !self.free[start] || area_of[start].is_some() {
                continue;
            }
            let area = sizes.len();
            sizes.push(0);
            area_of[start] = Some(area);
            let mut open = vec![start];
            while let Some(index) = open.pop() {
                sizes[area] += 1;
                for neighbour in self.neighbours(index) {
                    if self.free[neighbour] && area_of[neighbour].is_none() {
                        area_of[neighbour] = Some(area);
                        open.push(neighbour);
                    }
                }
            }
        }
        let mut kept = vec![false; sizes.len()];
        let reached = driven.iter().filter_map(|&index| area_of[index]);
        let largest = || (0..sizes.len()).max_by_key(|&area| sizes[area]);
        for area in reached.chain(if driven.is_empty() { largest() } else { None }) {
            kept[area] = true;
        }
        self.free = area_of.into_iter().map(|area| area.is_some_and(|area| kept[area])).collect();
    }

    /// The cells left, right, below and above.
    fn neighbours(&self, index: usize) -> impl Iterator<Item = usize> + use<> {
        let (width, cells, column) = (self.width, self.free.len(), index % self.width);
        let left = (column > 0).then(|| index - 1);
        let right = (column + 1 < width).then_some(index + 1);
        let below = index.checked_sub(width);
        let above = Some(index + width).filter(|&above| above < cells);
        [left, right, below, above].into_iter().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A room of 4 m by 3 m with a cell of 0.25 m beside it, turned.
    #[test]
    fn points_are_spread_over_the_area() {
        let mut rows = vec![vec![[0, 16]]; 12];
        rows[8].push([20, 21]);
        let area = FreeArea::from_rows(0.25, Pose::new(5.0, -2.0, 0.3), &rows).unwrap();
        let points = area.points(1.0);
        assert_eq!(points.len(), 4 * 3 + 1, "{points:?}");
        assert!(points.iter().all(|&point| area.contains(point)));
        let apart = |i: usize, j: usize| (points[i] - points[j]).norm();
        let least = (0..points.len()).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| apart(i, j));
        assert!((least.fold(f64::MAX, f64::min) - 1.0).abs() < 1e-9);
        assert_eq!(area.points(0.25).len(), 16 * 12 + 1);
    }
}
