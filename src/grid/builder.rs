//! Scans and poses to an occupancy grid, by counting.
//!
//! Of each cell two numbers are kept: how many beams ended in it (hits) and how many went through it (passes). By the
//! counting model (Hähnel, Triebel, Burgard, Thrun, ICRA 2003) hits / (hits + passes) is the most likely probability
//! that a beam which reaches the cell ends there. A beam without return is not used: a laser may not detect black surfaces.

use super::{Cell, GridError, MOST_CELLS, OccupancyGrid};
use crate::geometry::Pose;
use crate::scan::Scan;
use nalgebra::Point2;
use std::collections::HashMap;

/// A cell is occupied where at least this share of the beams that reach it end there. Beams that graze a wall, and
/// poses a few centimetres off, take many through cells that are wall, so it is less than half.
const OCCUPIED_SHARE: f64 = 0.25;
/// Cell indices stay below this, so that sums of them fit.
const FARTHEST_CELL: f64 = 1e9;

/// How many beams ended in a cell, and how many passed it.
#[derive(Clone, Copy, Default)]
struct Counts {
    hits: u16,
    passes: u16,
}

impl Counts {
    /// A full counter halves both, which keeps the share.
    fn halved_if_full(&mut self) {
        if self.hits == u16::MAX || self.passes == u16::MAX {
            (self.hits, self.passes) = (self.hits / 2, self.passes / 2);
        }
    }

    fn hit(&mut self) {
        self.hits += 1;
        self.halved_if_full();
    }

    fn pass(&mut self) {
        self.passes += 1;
        self.halved_if_full();
    }

    fn cell(self) -> Cell {
        let (hits, all) = (f64::from(self.hits), f64::from(self.hits) + f64::from(self.passes));
        match all {
            0.0 => Cell::Unknown,
            _ if hits >= OCCUPIED_SHARE * all => Cell::Occupied,
            _ => Cell::Free,
        }
    }
}

/// A rectangle of cells: from `min`, up to `max` but without it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Extent {
    min: [i64; 2],
    max: [i64; 2],
}

impl Extent {
    fn with(self, at: [i64; 2]) -> Self {
        if self == Self::default() {
            return Self { min: at, max: at.map(|i| i + 1) };
        }
        Self {
            min: [0, 1].map(|axis| self.min[axis].min(at[axis])),
            max: [0, 1].map(|axis| self.max[axis].max(at[axis] + 1)),
        }
    }

    fn size(self) -> [i64; 2] {
        [self.max[0] - self.min[0], self.max[1] - self.min[1]]
    }

    fn cells(self) -> u64 {
        let [width, height] = self.size().map(|side| side.max(0) as u64);
        width.saturating_mul(height)
    }
}

/// Side of a tile in cells. Only tiles that a beam passes take memory.
const TILE: i64 = 32;
/// One beam that comes from far away may be anything. A grid reaches to where the robot was, one tile further, and to
/// every tile in which this many beams ended.
const WELL_SEEN: u32 = 3;
/// A beam that passes more cells is longer than the largest square grid is wide, and counts as one without return.
const LONGEST_BEAM: f64 = 10_000.0;

/// A square of cells.
struct Tile {
    at: [i64; 2],
    counts: [Counts; (TILE * TILE) as usize],
    /// Beams that ended here.
    ends: u32,
    /// The robot was here or in a tile beside it.
    is_near: bool,
}

impl Tile {
    /// Cells in which a beam ended.
    fn ends(&self) -> impl Iterator<Item = [i64; 2]> {
        let [left, bottom] = self.at.map(|i| i * TILE);
        let hit = (0..).zip(&self.counts).filter(|(_, counts)| counts.hits > 0);
        hit.map(move |(index, _)| [left + index % TILE, bottom + index / TILE])
    }
}

/// The tile of a cell, and the cell's place in it.
fn place(at: [i64; 2]) -> ([i64; 2], usize) {
    let [column, row] = at.map(|i| i.rem_euclid(TILE));
    (at.map(|i| i.div_euclid(TILE)), (row * TILE + column) as usize)
}

/// Gathers scans and makes an [`OccupancyGrid`] of them, its axes those of the world.
pub struct GridBuilder {
    resolution: f64,
    tiles: Vec<Tile>,
    /// Where in `tiles` a tile is.
    index: HashMap<[i64; 2], usize>,
    /// Cells where the laser was.
    driven: Extent,
}

impl GridBuilder {
    /// A builder that has seen nothing; `resolution` is the side of a cell \[m\].
    pub fn new(resolution: f64) -> Self {
        Self { resolution, tiles: Vec::new(), index: HashMap::new(), driven: Extent::default() }
    }

    /// Adds the beams of a scan that had a return. What is not finite is left out, and once the grid became too large so
    /// is everything.
    pub fn add_scan(&mut self, scan: &Scan, robot_from_laser: Pose, world_from_robot: Pose) {
        let laser = (world_from_robot * robot_from_laser).position() / self.resolution;
        if !has_cell(laser) || self.is_full() {
            return;
        }
        let at = cell_of(laser);
        self.driven = self.driven.with(at);
        let ([column, row], _) = place(at);
        for (x, y) in (-1..=1).flat_map(|x| (-1..=1).map(move |y| (x, y))) {
            let tile = self.tile([column + x, row + y]);
            self.tiles[tile].is_near = true;
        }
        for &point in &scan.points {
            let end = world_from_robot * point / self.resolution;
            if has_cell(end) && nalgebra::distance(&laser, &end) <= LONGEST_BEAM {
                self.add_beam(laser, end);
            }
        }
    }

    fn add_beam(&mut self, laser: Point2<f64>, end: Point2<f64>) {
        // The next cell mostly lies in the same tile.
        let mut last = None;
        traverse(laser, end, |cell| {
            let (at, cell) = place(cell);
            let tile = match last {
                Some((last_at, tile)) if last_at == at => tile,
                _ => self.tile(at),
            };
            last = Some((at, tile));
            self.tiles[tile].counts[cell].pass();
        });
        let (at, cell) = place(cell_of(end));
        let tile = self.tile(at);
        let tile = &mut self.tiles[tile];
        tile.counts[cell].hit();
        tile.ends = tile.ends.saturating_add(1);
    }

    /// Where in `tiles` this tile is; it is made where it is missing.
    fn tile(&mut self, at: [i64; 2]) -> usize {
        *self.index.entry(at).or_insert_with(|| {
            let counts = [Counts::default(); (TILE * TILE) as usize];
            self.tiles.push(Tile { at, counts, ends: 0, is_near: false });
            self.tiles.len() - 1
        })
    }

    /// Whether beams passed more tiles than a grid can have.
    fn is_full(&self) -> bool {
        self.tiles.len() as u64 > MOST_CELLS / (TILE * TILE) as u64
    }

    /// The grid of all scans so far, as small as it can be: it reaches to where the robot was and what is near, and to what
    /// three beams saw.
    ///
    /// # Errors
    /// It would have too many cells, or there was no scan.
    pub fn finish(self) -> Result<OccupancyGrid, GridError> {
        let is_full = self.is_full();
        // Where it is full, the error names the whole extent.
        let well_seen = self.tiles.iter().filter(|tile| is_full || tile.is_near || tile.ends >= WELL_SEEN);
        let extent = well_seen.flat_map(Tile::ends).fold(self.driven, Extent::with);
        if is_full || extent.cells() > MOST_CELLS {
            let [width, height] = extent.size().map(|side| side as f64 * self.resolution);
            return Err(GridError::TooLarge { width, height, resolution: self.resolution });
        }
        if extent.cells() == 0 {
            return Err(GridError::Empty);
        }
        let [left, bottom] = extent.min;
        let ([right, top], [width, height]) = (extent.max, extent.size());
        let cell = |at: [i64; 2]| {
            let (tile, cell) = place(at);
            self.index.get(&tile).map_or(Cell::Unknown, |&tile| self.tiles[tile].counts[cell].cell())
        };
        let cells = (bottom..top).flat_map(|row| (left..right).map(move |column| [column, row])).map(cell).collect();
        let corner = Pose::new(left as f64 * self.resolution, bottom as f64 * self.resolution, 0.0);
        OccupancyGrid::new(self.resolution, corner, width as u32, height as u32, cells)
    }
}

fn has_cell(point: Point2<f64>) -> bool {
    point.iter().all(|coordinate| coordinate.abs() < FARTHEST_CELL)
}

pub(super) fn cell_of(point: Point2<f64>) -> [i64; 2] {
    [point.x.floor() as i64, point.y.floor() as i64]
}

/// Visits the cells that a beam passes, in order, but for the last, that it ends in (Amanatides & Woo, 1987).
///
/// Lengths are in cells. How many borders there are to cross is known in whole numbers at the start; only which comes
/// next is computed, so rounding can't lead past the end.
pub(super) fn traverse(from: Point2<f64>, to: Point2<f64>, mut visit: impl FnMut([i64; 2])) {
    let (mut at, end, ray) = (cell_of(from), cell_of(to), to - from);
    let step = [0, 1].map(|axis: usize| (end[axis] - at[axis]).signum());
    let mut borders = [0, 1].map(|axis: usize| (end[axis] - at[axis]).abs());
    // Shares of the beam: where it crosses the next border of each axis, and from one border to the next.
    let mut next = [0, 1].map(|axis: usize| match step[axis] {
        0 => f64::INFINITY,
        step => ((at[axis] + i64::from(step > 0)) as f64 - from[axis]) / ray[axis],
    });
    let stride = ray.map(|length| 1.0 / length.abs());
    while borders != [0, 0] {
        visit(at);
        let axis = usize::from(next[1] < next[0]);
        at[axis] += step[axis];
        borders[axis] -= 1;
        next[axis] = if borders[axis] == 0 { f64::INFINITY } else { next[axis] + stride[axis] };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    fn visited(from: Point2<f64>, to: Point2<f64>) -> Vec<[i64; 2]> {
        let mut cells = Vec::new();
        traverse(from, to, |at| cells.push(at));
        cells
    }

    /// The oracle: cells at ten thousand places along the beam, but for the last.
    fn sampled(from: Point2<f64>, to: Point2<f64>) -> BTreeSet<[i64; 2]> {
        let places = (0..10_000).map(|i| cell_of(from + (to - from) * (f64::from(i) / 1e4)));
        places.filter(|&at| at != cell_of(to)).collect()
    }

    proptest! {
        #[test]
        fn a_beam_visits_the_cells_it_passes(a in (-9.0..9.0, -9.0..9.0), b in (-9.0..9.0, -9.0..9.0)) {
            let (from, to) = (Point2::new(a.0, a.1), Point2::new(b.0, b.1));
            let cells = visited(from, to);
            let (set, expected): (BTreeSet<_>, _) = (cells.iter().copied().collect(), sampled(from, to));
            prop_assert_eq!(set.len(), cells.len(), "no cell twice");
            prop_assert!(expected.is_subset(&set), "{:?} lacks some of {:?}", set, expected);
            // Sampling can miss a corner that is cut, but nothing longer.
            for &[column, row] in set.difference(&expected) {
                prop_assert!(chord(from, to, [column, row]) < 1e-2, "{column} {row} is not on the way");
            }
            // Each is a neighbour of the one before.
            let ends = cells.iter().copied().chain([cell_of(to)]).collect::<Vec<_>>();
            for pair in ends.windows(2) {
                prop_assert_eq!((pair[0][0] - pair[1][0]).abs() + (pair[0][1] - pair[1][1]).abs(), 1);
            }
            // Another beam has another way.
            if cells.len() > 3 {
                prop_assert_ne!(set, sampled(Point2::new(from.x + 2.0, from.y - 1.0), to));
            }
        }
    }

    /// Length of a beam within a cell, by clipping; negative where it misses it.
    fn chord(from: Point2<f64>, to: Point2<f64>, at: [i64; 2]) -> f64 {
        let ray = to - from;
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for axis in 0..2 {
            let borders = [at[axis] as f64, at[axis] as f64 + 1.0].map(|border| (border - from[axis]) / ray[axis]);
            enter = enter.max(borders[0].min(borders[1]));
            leave = leave.min(borders[0].max(borders[1]));
        }
        if leave < enter - 1e-9 { f64::INFINITY } else { (leave - enter) * ray.norm() }
    }

    #[test]
    fn beams_along_and_through_borders_end() {
        assert_eq!(visited(Point2::new(0.0, 0.0), Point2::new(0.0, 0.0)), Vec::<[i64; 2]>::new());
        assert_eq!(visited(Point2::new(2.0, 0.5), Point2::new(-0.5, 0.5)), [[2, 0], [1, 0], [0, 0]]);
        assert_eq!(visited(Point2::new(0.0, 0.0), Point2::new(2.0, 2.0)).len(), 4);
        assert_eq!(visited(Point2::new(1.0, 3.0), Point2::new(1.0, 0.0)), [[1, 3], [1, 2], [1, 1]]);
    }

    #[test]
    fn full_counters_keep_their_share() {
        let mut counts = Counts::default();
        for beam in 0..300_000 {
            if beam % 3 == 0 { counts.hit() } else { counts.pass() }
        }
        let share = f64::from(counts.hits) / (f64::from(counts.hits) + f64::from(counts.passes));
        assert!((share - 1.0 / 3.0).abs() < 1e-3, "{share}");
        assert_eq!(counts.cell(), Cell::Occupied);
    }
}
