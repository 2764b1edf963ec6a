//! A floor whose wings are alike, as in hospitals and hotels: a corridor, and side corridors off it that a laser cannot tell
//! apart. What differs are the objects along them: doors, chairs and plants.

use super::objects::Object;
use super::plan::Plan;
use super::{Stream, generator};
use nalgebra::Point2;
use rand::RngExt;

/// Middles of the wings \[m\].
const WINGS: [f64; 3] = [8.0, 20.0, 32.0];
/// Half the width of the corridors \[m\].
const HALF: f64 = 1.1;
/// Length of the main corridor, and how far the wings reach from its middle \[m\].
const LENGTH: [f64; 2] = [40.0, 15.0];
/// From one object to the next along a wall, at least and at most \[m\].
const SPACING: std::ops::Range<f64> = 1.5..4.5;

/// Draws the floor. Its walls are always the same; the objects depend on the seed.
pub fn look_alike_wings(seed: u64) -> Plan {
    let [length, depth] = LENGTH;
    let mut plan = Plan { classes: ["door", "chair", "plant"].map(str::to_owned).to_vec(), ..Plan::default() };
    plan.partition([0.0, -HALF], [length, -HALF], &[]);
    plan.partition([0.0, -HALF], [0.0, HALF], &[]);
    plan.partition([length, -HALF], [length, HALF], &[]);
    let mut from = 0.0;
    for middle in WINGS {
        let (left, right) = (middle - HALF, middle + HALF);
        plan.partition([from, HALF], [left, HALF], &[]);
        plan.partition([left, HALF], [left, depth], &[]);
        plan.partition([left, depth], [right, depth], &[]);
        plan.partition([right, HALF], [right, depth], &[]);
        // A cupboard on either side.
        plan.shaft([left + 0.1, 5.0], [left + 0.4, 6.0]);
        plan.shaft([right - 0.5, 10.0], [right - 0.1, 10.8]);
        from = right;
    }
    plan.partition([from, HALF], [length, HALF], &[]);

    let mut rng = generator(seed, Stream::World);
    let mut along = |from: Point2<f64>, to: Point2<f64>| {
        let (way, mut at) = ((to - from).norm(), rng.random_range(SPACING));
        while at < way {
            let class = rng.random_range(0..plan.classes.len());
            plan.objects.push(Object { class, position: from + (to - from) * (at / way) });
            at += rng.random_range(SPACING);
        }
    };
    along(Point2::new(0.0, -HALF), Point2::new(length, -HALF));
    for middle in WINGS {
        for side in [middle - HALF, middle + HALF] {
            along(Point2::new(side, HALF), Point2::new(side, depth));
        }
    }
    // Into every wing and back, and home.
    plan.go(&[[2.0, 0.0]]);
    for middle in WINGS {
        plan.go(&[[middle, 0.0], [middle, depth - 1.5], [middle, 0.0]]);
    }
    plan.go(&[[2.0, 0.0]]);
    plan
}
