//! Laser points as counts on a grid: hundreds of thousands come in one at a time, memory stays bounded.
//!
//! The grid is sparse, in tiles. It starts with cells of 2 cm; whenever it would hold more than 65,536 tiles the cells
//! double, so that a campus is kept more coarsely than an office and a few far points cost a few tiles.

use super::{View, is_drawable};
use nalgebra::Point2;
use resvg::tiny_skia::{ColorU8, Pixmap};
use std::collections::BTreeMap;

/// Cells along a side of a tile.
const TILE: i64 = 16;
/// Most tiles; 512 bytes each.
const MOST_TILES: usize = 1 << 16;
/// Side of the finest cells, in metres.
const FINEST_CELL: f64 = 0.02;
/// Most image pixels along the longer side of a view.
const IMAGE_SIDE: f64 = 1600.0;
/// Share of the points outside the extent, at each of the four sides.
const OUTSIDE: f64 = 0.005;

/// How many points of the world's frame fell into each cell of a grid.
#[derive(Clone, Debug)]
pub struct PointRaster {
    /// Side of a cell, in metres.
    cell: f64,
    /// Counts by tile column and row; cells row by row from the lower left.
    tiles: BTreeMap<(i64, i64), Box<[u16; (TILE * TILE) as usize]>>,
    count: u64,
}

impl Default for PointRaster {
    fn default() -> Self {
        Self { cell: FINEST_CELL, tiles: BTreeMap::new(), count: 0 }
    }
}

/// Part of a raster as an embedded picture.
pub(super) struct RasterImage {
    /// PNG file, transparent where there are no points, the top row first.
    pub png: Vec<u8>,
    /// What the outer edges of the image are in the world.
    pub view: View,
}

impl PointRaster {
    /// A raster without points.
    pub fn new() -> Self {
        Self::default()
    }

    /// Counts one point of the world's frame, in metres; points that are not finite are left out.
    pub fn add(&mut self, point: Point2<f64>) {
        if !is_drawable(point) {
            return;
        }
        self.count += 1;
        let (column, row) = ((point.x / self.cell).floor() as i64, (point.y / self.cell).floor() as i64);
        self.add_cell(column, row, 1);
        while self.tiles.len() > MOST_TILES {
            self.coarsen();
        }
    }

    /// Points counted.
    pub fn count(&self) -> u64 {
        self.count
    }

    fn add_cell(&mut self, column: i64, row: i64, hits: u16) {
        let tile = self
            .tiles
            .entry((column.div_euclid(TILE), row.div_euclid(TILE)))
            .or_insert_with(|| Box::new([0; (TILE * TILE) as usize]));
        let cell = &mut tile[(row.rem_euclid(TILE) * TILE + column.rem_euclid(TILE)) as usize];
        *cell = cell.saturating_add(hits);
    }

    /// Doubles the side of the cells.
    fn coarsen(&mut self) {
        let fine = std::mem::take(&mut self.tiles);
        self.cell *= 2.0;
        for (column, row, hits) in cells(&fine) {
            self.add_cell(column.div_euclid(2), row.div_euclid(2), hits);
        }
    }

    /// What holds the points but for half a percent at each side, to whole tiles; `None` without points.
    pub(super) fn extent(&self) -> Option<View> {
        let (mut by_column, mut by_row) = (BTreeMap::<i64, u64>::new(), BTreeMap::<i64, u64>::new());
        for (&(column, row), tile) in &self.tiles {
            let hits = tile.iter().copied().map(u64::from).sum::<u64>();
            *by_column.entry(column).or_default() += hits;
            *by_row.entry(row).or_default() += hits;
        }
        let side = self.cell * TILE as f64;
        let (x, y) = (middle(&by_column)?, middle(&by_row)?);
        Some(View {
            min: Point2::new(x.0 as f64, y.0 as f64) * side,
            max: Point2::new((x.1 + 1) as f64, (y.1 + 1) as f64) * side,
        })
    }

    /// The cells within a view as an image, several cells to a pixel where the view is wide; more points, more opaque.
    pub(super) fn image(&self, view: &View, colour: [u8; 3]) -> Option<RasterImage> {
        let per_pixel = (view.size().amax() / self.cell / IMAGE_SIDE).ceil().max(1.0) as i64;
        let pixel = self.cell * per_pixel as f64;
        let first = (view.min / pixel).map(|v| v.floor() as i64);
        let last = (view.max / pixel).map(|v| v.floor() as i64);
        let (width, height) = ((last.x - first.x + 1) as usize, (last.y - first.y + 1) as usize);
        let mut hits = vec![0u32; width * height];
        for (column, row, count) in cells(&self.tiles) {
            let (x, y) = (column.div_euclid(per_pixel) - first.x, last.y - row.div_euclid(per_pixel));
            if (0..width as i64).contains(&x) && (0..height as i64).contains(&y) {
                hits[y as usize * width + x as usize] += u32::from(count);
            }
        }
        let full = f64::from(high_count(&hits)?);
        let mut image = Pixmap::new(width as u32, height as u32)?;
        for (pixel, &hits) in image.pixels_mut().iter_mut().zip(&hits).filter(|(_, hits)| **hits > 0) {
            let share = (f64::from(hits).ln_1p() / full.ln_1p()).min(1.0);
            // Sixteen levels: no eye distinguishes more, and the file shrinks.
            let level = (share * 15.0).round() / 15.0;
            let alpha = (255.0 * (0.2 + 0.8 * level)).round() as u8;
            *pixel = ColorU8::from_rgba(colour[0], colour[1], colour[2], alpha).premultiply();
        }
        let view = View {
            min: Point2::new(first.x as f64, first.y as f64) * pixel,
            max: Point2::new((last.x + 1) as f64, (last.y + 1) as f64) * pixel,
        };
        Some(RasterImage { png: image.encode_png().ok()?, view })
    }
}

/// Column, row and count of every cell that holds points.
fn cells(
    tiles: &BTreeMap<(i64, i64), Box<[u16; (TILE * TILE) as usize]>>,
) -> impl Iterator<Item = (i64, i64, u16)> + '_ {
    tiles.iter().flat_map(|(&(column, row), tile)| {
        let occupied = tile.iter().enumerate().filter(|(_, hits)| **hits > 0);
        occupied.map(move |(i, &hits)| (column * TILE + i as i64 % TILE, row * TILE + i as i64 / TILE, hits))
    })
}

/// Lowest and highest key once the outermost share of the hits is left out at both ends.
fn middle(hits: &BTreeMap<i64, u64>) -> Option<(i64, i64)> {
    let spare = (OUTSIDE * hits.values().sum::<u64>() as f64) as u64;
    let beyond = |sum: &mut u64, (&key, &hits): (&i64, &u64)| {
        *sum += hits;
        Some((key, *sum))
    };
    let low = hits.iter().scan(0, beyond).find(|(_, sum)| *sum > spare)?.0;
    let high = hits.iter().rev().scan(0, beyond).find(|(_, sum)| *sum > spare)?.0;
    Some((low, high))
}

/// The count that 95 % of the pixels with points do not exceed; it is drawn fully opaque.
fn high_count(hits: &[u32]) -> Option<u32> {
    let mut occupied: Vec<u32> = hits.iter().copied().filter(|&hits| hits > 0).collect();
    let rank = occupied.len() * 95 / 100;
    (rank < occupied.len()).then(|| *occupied.select_nth_unstable(rank).1)
}
