//! Where the robot is: walls, and how far a beam flies before it meets one.
//!
//! In: straight walls and a ray in the world's frame \[m\]. Out: the distance to the nearest wall, exact against every
//! wall. A uniform grid over the walls lets a beam test only those that it passes near (Amanatides and Woo, A fast
//! voxel traversal algorithm for ray tracing, Eurographics 1987).

use nalgebra::{Point2, Vector2};

/// Side of a grid cell \[m\], unless the world is so wide that this would take too many cells.
const CELL: f64 = 1.0;
/// Most cells along one side of the grid; bounds it to about a million cells, some megabytes.
const MOST_CELLS: f64 = 1000.0;
/// Slack for a wall that touches a cell's border \[m\], so that rounding leaves no gap between cells.
const SLACK: f64 = 1e-6;

/// One straight surface that a laser sees, from `a` to `b`, in the world's frame \[m\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// One end.
    pub a: Point2<f64>,
    /// The other end.
    pub b: Point2<f64>,
}

impl Wall {
    /// Distance along a ray to this wall, or `None` where the ray misses it or runs along it.
    ///
    /// Solves `from + t direction = a + u (b - a)` for t ≥ 0 and 0 ≤ u ≤ 1. `direction` has length one.
    pub fn hit(&self, from: Point2<f64>, direction: Vector2<f64>) -> Option<f64> {
        let along = self.b - self.a;
        let to_a = self.a - from;
        let parallel = direction.perp(&along);
        let t = to_a.perp(&along) / parallel;
        let u = to_a.perp(&direction) / parallel;
        (parallel != 0.0 && t >= 0.0 && (0.0..=1.0).contains(&u)).then_some(t)
    }
}

/// Walls, sorted into a grid for fast ray casting.
#[derive(Clone, Debug)]
pub struct World {
    walls: Vec<Wall>,
    lower: Point2<f64>,
    cell: f64,
    columns: usize,
    rows: usize,
    /// The walls of cell i are `members[starts[i]..starts[i + 1]]`.
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl World {
    /// A world of these walls. A wall with a coordinate that is not finite is left out: no ray could hit it.
    pub fn new(mut walls: Vec<Wall>) -> Self {
        walls.retain(|wall| [wall.a, wall.b].iter().all(|end| end.x.is_finite() && end.y.is_finite()));
        let mut ends = walls.iter().flat_map(|wall| [wall.a, wall.b]);
        let first = ends.next().unwrap_or_default();
        let (lower, upper) = ends.fold((first, first), |(lower, upper), end| (lower.inf(&end), upper.sup(&end)));
        let extent = upper - lower;
        let cell = CELL.max(extent.x / MOST_CELLS).max(extent.y / MOST_CELLS);
        let (columns, rows) = ((extent.x / cell) as usize + 1, (extent.y / cell) as usize + 1);
        let mut world =
            Self { walls, lower, cell, columns, rows, starts: vec![0; columns * rows + 1], members: vec![] };
        world.sort_into_cells();
        world
    }

    /// All walls.
    pub fn walls(&self) -> &[Wall] {
        &self.walls
    }

    /// Distance \[m\] from a point along a direction (of length one) to the nearest wall, or `None` where there is none
    /// below `max_range` \[m\].
    pub fn cast(&self, from: Point2<f64>, direction: Vector2<f64>, max_range: f64) -> Option<f64> {
        let (enter, leave) = self.clip(from, direction)?;
        let leave = leave.min(max_range);
        let start = (from + direction * enter - self.lower) / self.cell;
        let (mut column, mut row) = (index_below(start.x, self.columns), index_below(start.y, self.rows));
        let mut nearest = f64::INFINITY;
        loop {
            for &member in self.members_of(row * self.columns + column) {
                if let Some(distance) = self.walls[member as usize].hit(from, direction) {
                    nearest = nearest.min(distance);
                }
            }
            let next_column = self.border(column, direction.x, from.x - self.lower.x);
            let next_row = self.border(row, direction.y, from.y - self.lower.y);
            let border = next_column.min(next_row);
            if nearest <= border || border > leave {
                break;
            }
            let moved = if next_column < next_row {
                neighbour(column, direction.x, self.columns).map(|next| column = next)
            } else {
                neighbour(row, direction.y, self.rows).map(|next| row = next)
            };
            if moved.is_none() {
                break;
            }
        }
        (nearest < max_range).then_some(nearest)
    }

    /// Where along the ray the cell's column (or row) ends.
    fn border(&self, index: usize, direction: f64, from: f64) -> f64 {
        let end = if direction > 0.0 { index + 1 } else { index };
        if direction == 0.0 { f64::INFINITY } else { (end as f64 * self.cell - from) / direction }
    }

    /// The stretch of a ray that lies above the grid.
    fn clip(&self, from: Point2<f64>, direction: Vector2<f64>) -> Option<(f64, f64)> {
        let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
        for (axis, count) in [self.columns, self.rows].into_iter().enumerate() {
            let lower = self.lower[axis] - SLACK - from[axis];
            let upper = self.lower[axis] + count as f64 * self.cell + SLACK - from[axis];
            if direction[axis] == 0.0 {
                if lower > 0.0 || upper < 0.0 {
                    return None;
                }
            } else {
                let (a, b) = (lower / direction[axis], upper / direction[axis]);
                enter = enter.max(a.min(b));
                leave = leave.min(a.max(b));
            }
        }
        (enter <= leave).then_some((enter, leave))
    }

    fn members_of(&self, cell: usize) -> &[u32] {
        &self.members[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }

    /// Counting sort: how many walls a cell has, where its list begins, then the lists.
    fn sort_into_cells(&mut self) {
        for index in 0..self.walls.len() {
            self.cells_of(index).for_each(|cell| self.starts[cell + 1] += 1);
        }
        for cell in 1..self.starts.len() {
            self.starts[cell] += self.starts[cell - 1];
        }
        let mut next = self.starts.clone();
        self.members = vec![0; self.starts.last().map_or(0, |&count| count as usize)];
        for index in 0..self.walls.len() {
            for cell in self.cells_of(index) {
                self.members[next[cell] as usize] = index as u32;
                next[cell] += 1;
            }
        }
    }

    /// The cells that a wall touches: those of its bounding box that its line does not leave on one side.
    fn cells_of(&self, index: usize) -> impl Iterator<Item = usize> + use<> {
        let (lower, cell, columns) = (self.lower, self.cell, self.columns);
        let Wall { a, b } = self.walls[index];
        let slack = Vector2::repeat(SLACK);
        let first = (a.inf(&b) - slack - lower) / cell;
        let last = (a.sup(&b) + slack - lower) / cell;
        let across = Vector2::new(a.y - b.y, b.x - a.x);
        let reach = 0.5 * cell * (across.x.abs() + across.y.abs()) + SLACK * across.norm();
        let in_columns = index_below(first.x, columns)..=index_below(last.x, columns);
        let in_rows = index_below(first.y, self.rows)..=index_below(last.y, self.rows);
        in_rows.flat_map(move |row| in_columns.clone().map(move |column| (row, column))).filter_map(
            move |(row, column)| {
                let centre = lower + Vector2::new(column as f64 + 0.5, row as f64 + 0.5) * cell;
                (across.dot(&(centre - a)).abs() <= reach).then_some(row * columns + column)
            },
        )
    }
}

/// The cell index that a coordinate falls in, kept inside the grid.
fn index_below(coordinate: f64, count: usize) -> usize {
    (coordinate.max(0.0) as usize).min(count - 1)
}

fn neighbour(index: usize, direction: f64, count: usize) -> Option<usize> {
    if direction > 0.0 { Some(index + 1).filter(|&next| next < count) } else { index.checked_sub(1) }
}
