//! Scans and poses to an occupancy grid, by counting.
//!
//! Of each cell two numbers are kept: how many beams ended in it (hits) and how many went through it (passes). By the
//! counting model (Hähnel, Triebel, Burgard, Thrun, ICRA 2003) hits / (hits + passes) is the most likely probability
//! that a beam which reaches the cell ends there. A beam without return tells nothing: the laser may not see black.

use super::{Cell, GridError, MOST_CELLS, OccupancyGrid};
use crate::geometry::Pose;
use crate::scan::Scan;
use nalgebra::Point2;

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
    fn of_cell(at: [i64; 2]) -> Self {
        Self { min: at, max: at.map(|i| i + 1) }
    }

    fn union(self, other: Self) -> Self {
        if self == Self::default() {
            return other;
        }
        let pairs = |a: [i64; 2], b: [i64; 2], f: fn(i64, i64) -> i64| [f(a[0], b[0]), f(a[1], b[1])];
        Self { min: pairs(self.min, other.min, i64::min), max: pairs(self.max, other.max, i64::max) }
    }

    /// Half as much again in each direction, so that a growing grid is seldom copied.
    fn padded(self) -> Self {
        let [width, height] = self.size().map(|side| side / 4);
        let [left, bottom] = self.min;
        let [right, top] = self.max;
        Self { min: [left - width, bottom - height], max: [right + width, top + height] }
    }

    fn size(self) -> [i64; 2] {
        [self.max[0] - self.min[0], self.max[1] - self.min[1]]
    }

    fn cells(self) -> u64 {
        let [width, height] = self.size().map(|side| side.max(0) as u64);
        width.saturating_mul(height)
    }

    fn index(self, at: [i64; 2]) -> usize {
        ((at[1] - self.min[1]) * self.size()[0] + at[0] - self.min[0]) as usize
    }
}

/// Gathers scans and makes an [`OccupancyGrid`] of them, its axes those of the world.
pub struct GridBuilder {
    resolution: f64,
    counts: Vec<Counts>,
    /// What `counts` holds, row by row.
    allotted: Extent,
    /// What the scans reached.
    seen: Extent,
}

impl GridBuilder {
    /// A builder that has seen nothing; `resolution` is the side of a cell \[m\].
    pub fn new(resolution: f64) -> Self {
        Self { resolution, counts: Vec::new(), allotted: Extent::default(), seen: Extent::default() }
    }

    /// Adds the beams of a scan that had a return. What is not finite is left out, and once the grid became too large so is everything.
    pub fn add_scan(&mut self, scan: &Scan, robot_from_laser: Pose, world_from_robot: Pose) {
        let laser = (world_from_robot * robot_from_laser).position() / self.resolution;
        if !has_cell(laser) {
            return;
        }
        let ends = scan.points.iter().map(|&point| world_from_robot * point / self.resolution);
        let ends: Vec<Point2<f64>> = ends.filter(|&end| has_cell(end)).collect();
        let reached = ends.iter().map(|&end| Extent::of_cell(cell_of(end)));
        self.seen = reached.fold(self.seen.union(Extent::of_cell(cell_of(laser))), Extent::union);
        if self.seen.cells() > MOST_CELLS {
            self.counts = Vec::new();
            return;
        }
        self.allot();
        for end in ends {
            traverse(laser, end, |at| self.counts[self.allotted.index(at)].pass());
            self.counts[self.allotted.index(cell_of(end))].hit();
        }
    }

    /// The grid of all scans so far, as small as it can be.
    ///
    /// # Errors
    /// It would have too many cells, or there was no scan.
    pub fn finish(self) -> Result<OccupancyGrid, GridError> {
        let [width, height] = self.seen.size();
        if self.seen.cells() > MOST_CELLS {
            let [width, height] = [width, height].map(|side| side as f64 * self.resolution);
            return Err(GridError::TooLarge { width, height, resolution: self.resolution });
        }
        if self.seen.cells() == 0 {
            return Err(GridError::Empty);
        }
        let [left, bottom] = self.seen.min;
        let row = |j| {
            let start = self.allotted.index([left, bottom + j]);
            self.counts[start..start + width as usize].iter().map(|counts| counts.cell())
        };
        let cells = (0..height).flat_map(row).collect();
        let corner = Pose::new(left as f64 * self.resolution, bottom as f64 * self.resolution, 0.0);
        OccupancyGrid::new(self.resolution, corner, width as u32, height as u32, cells)
    }

    /// Makes room for all that was seen.
    fn allot(&mut self) {
        if self.allotted.union(self.seen) == self.allotted {
            return;
        }
        let old = self.allotted;
        let roomy = self.seen.padded().union(old);
        self.allotted = if roomy.cells() <= MOST_CELLS { roomy } else { self.seen.union(old) };
        let mut counts = vec![Counts::default(); self.allotted.cells() as usize];
        let width = old.size()[0] as usize;
        if width > 0 {
            for (row, from) in self.counts.chunks_exact(width).enumerate() {
                let start = self.allotted.index([old.min[0], old.min[1] + row as i64]);
                counts[start..start + width].copy_from_slice(from);
            }
        }
        self.counts = counts;
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
