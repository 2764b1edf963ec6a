//! Buildings of any size from a seed: a grid of corridors around blocks of rooms, and a tour through the corridors.
//!
//! The outer corridors run along the building's outside, so every block can be driven around. Most blocks hold two
//! rows of rooms, a few are open halls with pillars.

use super::plan::{Door, Plan};
use super::{SimulationError, generator};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;

/// Width of the corridors \[m\].
const CORRIDOR: f64 = 2.3;
/// Least mean width and height of the blocks \[m\]; single blocks may be a quarter smaller.
const BLOCK: [f64; 2] = [10.5, 9.5];
/// How far into a room the tour leads \[m\].
const VISIT: f64 = 1.5;
/// Shortest and longest side of a building \[m\]: one block, and what fits into some hundred megabytes.
const SIDES: std::ops::RangeInclusive<f64> = 16.0..=1000.0;

/// A room that the robot may look into: where the door is and how far in to go.
struct Visit {
    door_x: f64,
    inside_y: f64,
}

/// Corridors between the blocks, seen as a graph; crossing (i, j) lies at (`xs[i]`, `ys[j]`).
struct Corridors {
    xs: Vec<f64>,
    ys: Vec<f64>,
    /// Rooms along the corridor from crossing (i, j) to (i + 1, j), at `j * (xs.len() - 1) + i`.
    visits: Vec<Vec<Visit>>,
}

/// Draws a building of `width` by `height` metres, both from 16 to 1000.
///
/// # Errors
/// A side is outside of that.
pub fn random_offices(seed: u64, width: f64, height: f64) -> Result<Plan, SimulationError> {
    for (what, side) in [("width of the building", width), ("height of the building", height)] {
        if !SIDES.contains(&side) {
            return Err(SimulationError::new(what, side, "16 to 1000 m"));
        }
    }
    let mut rng = generator(seed, super::Stream::World);
    let mut plan = Plan::default();
    plan.partition([0.0, 0.0], [width, 0.0], &[]);
    plan.partition([width, 0.0], [width, height], &[]);
    plan.partition([width, height], [0.0, height], &[]);
    plan.partition([0.0, height], [0.0, 0.0], &[]);

    let columns = blocks(&mut rng, width, BLOCK[0]);
    let rows = blocks(&mut rng, height, BLOCK[1]);
    let crossings = |spans: &[(f64, f64)]| {
        let after = spans.iter().map(|span| span.1 + CORRIDOR / 2.0);
        std::iter::once(CORRIDOR / 2.0).chain(after).collect::<Vec<_>>()
    };
    let (xs, ys) = (crossings(&columns), crossings(&rows));
    let mut corridors = Corridors { visits: Vec::new(), xs, ys };
    corridors.visits.resize_with(columns.len() * corridors.ys.len(), Vec::new);
    for (j, &(bottom, top)) in rows.iter().enumerate() {
        for (i, &(left, right)) in columns.iter().enumerate() {
            if rng.random_bool(0.12) {
                hall(&mut plan, [left, bottom], [right, top]);
            } else {
                let middle = 0.5 * (bottom + top) + rng.random_range(-0.5..0.5);
                plan.partition([left, bottom], [left, top], &[]);
                plan.partition([right, bottom], [right, top], &[]);
                plan.partition([left, middle], [right, middle], &[]);
                let south = rooms(&mut plan, &mut rng, [left, right], bottom, middle);
                let north = rooms(&mut plan, &mut rng, [left, right], top, middle);
                corridors.visits[j * columns.len() + i].extend(south);
                corridors.visits[(j + 1) * columns.len() + i].extend(north);
            }
        }
    }
    corridors.tour(&mut plan, &mut rng);
    Ok(plan)
}

/// Cuts a length into corridors and blocks: where each block begins and ends.
fn blocks(rng: &mut ChaCha8Rng, length: f64, block: f64) -> Vec<(f64, f64)> {
    let count = ((length - CORRIDOR) / (block + CORRIDOR)).floor().max(1.0);
    let shares: Vec<f64> = (0..count as usize).map(|_| rng.random_range(0.8..1.2)).collect();
    let scale = (length - (count + 1.0) * CORRIDOR) / shares.iter().sum::<f64>();
    let mut start = CORRIDOR;
    let block = |share| {
        let span = (start, start + share * scale);
        start = span.1 + CORRIDOR;
        span
    };
    shares.into_iter().map(block).collect()
}

/// A hall without partitions: pillars about 4 m apart, none near the corridors' middle.
fn hall(plan: &mut Plan, lower: [f64; 2], upper: [f64; 2]) {
    let places = |from: f64, to: f64| {
        let count = ((to - from) / 4.0).round().max(1.0);
        (0..count as usize).map(move |k| from + (to - from) * (k as f64 + 0.5) / count)
    };
    for x in places(lower[0], upper[0]) {
        places(lower[1], upper[1]).for_each(|y| plan.round([x, y], 0.25));
    }
}

/// One row of rooms between the corridor's partition at `front` and the partition at `back`; returns those whose door
/// stands wide open.
fn rooms(plan: &mut Plan, rng: &mut ChaCha8Rng, [left, right]: [f64; 2], front: f64, back: f64) -> Vec<Visit> {
    let inwards = (back - front).signum();
    let count = ((right - left) / rng.random_range(3.8..5.5)).floor().max(1.0);
    let width = (right - left) / count;
    let (mut doors, mut visits) = (Vec::new(), Vec::new());
    for room in 0..count as usize {
        let start = left + room as f64 * width;
        if room > 0 {
            plan.partition([start, front], [start, back], &[]);
        }
        let at = width * (room as f64 + rng.random_range(0.3..0.7));
        let leaf = match rng.random_range(0..10) {
            0..3 => 0.0,
            3..6 => rng.random_range(25.0..80.0),
            _ => rng.random_range(92.0..105.0),
        };
        doors.push(Door::leaf(at, inwards * leaf));
        if leaf > 90.0 {
            visits.push(Visit { door_x: left + at, inside_y: front + inwards * VISIT });
        }
        // A desk at the back, in one corner or the other.
        let desk = start + if rng.random_bool(0.5) { 0.15 } else { width - 1.75 };
        let (near, far) = (back - inwards * 0.95, back - inwards * 0.15);
        plan.furniture([desk, near.min(far)], [desk + 1.6, near.max(far)]);
    }
    plan.partition([left, front], [right, front], &doors);
    visits
}

impl Corridors {
    /// Drives the corridor least driven so far, again and again, until none is left or the walk gets long, looks into
    /// a room now and then, and goes home.
    fn tour(&mut self, plan: &mut Plan, rng: &mut ChaCha8Rng) {
        let (columns, rows) = (self.xs.len(), self.ys.len());
        let corridors = (columns - 1) * rows + (rows - 1) * columns;
        // How often the corridor east and the one north of a crossing were driven.
        let mut driven = vec![[0u32; 2]; columns * rows];
        let (mut i, mut j, mut fresh) = (0, 0, corridors);
        plan.go(&[[self.xs[0], self.ys[0]]]);
        for _ in 0..2 * corridors {
            let mut choices = Vec::with_capacity(4);
            // (next crossing, the crossing that the corridor belongs to, 0 east or 1 north)
            if i + 1 < columns {
                choices.push(((i + 1, j), j * columns + i, 0));
            }
            if j + 1 < rows {
                choices.push(((i, j + 1), j * columns + i, 1));
            }
            if i > 0 {
                choices.push(((i - 1, j), j * columns + i - 1, 0));
            }
            if j > 0 {
                choices.push(((i, j - 1), (j - 1) * columns + i, 1));
            }
            let first = rng.random_range(0..choices.len());
            choices.rotate_left(first);
            let Some(&(next, owner, side)) = choices.iter().min_by_key(|choice| driven[choice.1][choice.2]) else {
                break;
            };
            fresh -= usize::from(driven[owner][side] == 0);
            driven[owner][side] += 1;
            if side == 0 {
                self.visit(plan, rng, i.min(next.0), j);
            }
            (i, j) = next;
            plan.go(&[[self.xs[i], self.ys[j]]]);
            if fresh == 0 {
                break;
            }
        }
        plan.go(&[[self.xs[0], self.ys[j]], [self.xs[0], self.ys[0]]]);
    }

    /// Looks into one room of a corridor, or goes past; no room twice.
    fn visit(&mut self, plan: &mut Plan, rng: &mut ChaCha8Rng, i: usize, j: usize) {
        let visits = &mut self.visits[j * (self.xs.len() - 1) + i];
        if visits.is_empty() || !rng.random_bool(0.3) {
            return;
        }
        let visit = visits.swap_remove(rng.random_range(0..visits.len()));
        let at_door = [visit.door_x, self.ys[j]];
        plan.go(&[at_door, [visit.door_x, visit.inside_y], at_door]);
    }
}
