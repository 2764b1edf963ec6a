//! Between the steps of a filter: when the next step is due, and how the robot is followed till then.

use crate::geometry::Pose;
use crate::parameters::parameters;

parameters! {
    /// How the robot is followed between steps, and when a step is taken.
    pub struct TrackingConfig {
        /// A step is taken once the robot has moved this far \[m\] or turned by `step_turn`. Both zero: a step every scan, as
        /// in the paper.
        step_distance: f64 = 0.3, in 0.0..=f64::INFINITY;
        /// A step is taken once the robot has turned this far \[rad\] or moved by `step_distance`.
        step_turn: f64 = 0.2, in 0.0..=f64::INFINITY;
        /// Starts of scan matching at each scan, drawn from the motion model; 0 follows odometry alone, as in the paper.
        starts: u32 = 24, in 0.0..=1e6;
    }
}

impl TrackingConfig {
    /// Whether a robot that has moved so since the last step is still too near for another one.
    pub fn is_too_near(&self, moved: Pose) -> bool {
        moved.x.hypot(moved.y) < self.step_distance && moved.heading.abs() < self.step_turn
    }
}
