//! Walls that a scan looks through speak against the pose that it is said to be taken from.

use crate::ppca::Cluster;
use nalgebra::Point2;

/// A wall hides what lies behind it only where it is thicker than this \[m\]: scans are matched to no better.
const HIDING_SIGMA: f64 = 0.1;

/// Share of rays, each from where the robot was to a point that it saw, that go through one of these walls.
pub(crate) fn share_behind<'a>(rays: &[[Point2<f64>; 2]], walls: impl Iterator<Item = &'a Cluster> + Clone) -> f64 {
    let is_behind =
        |&&[robot, point]: &&[Point2<f64>; 2]| walls.clone().any(|wall| wall.separates(robot, point, HIDING_SIGMA));
    rays.iter().filter(is_behind).count() as f64 / rays.len().max(1) as f64
}
