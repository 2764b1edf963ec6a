//! Poses in f32, in a frame near the robot.

use crate::geometry::{Pose, wrap_angle};
use crate::math::sin_cos;
use bytemuck::{Pod, Zeroable};
use nalgebra::Point2;

/// A pose in the evaluator's frame: that of the world, moved to an origin near the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LocalPose {
    /// Metres.
    pub x: f32,
    /// Metres.
    pub y: f32,
    /// Radians.
    pub heading: f32,
}

impl LocalPose {
    /// Into the evaluator's frame.
    pub fn new(world_from_robot: Pose, origin: Point2<f64>) -> Self {
        Self {
            x: (world_from_robot.x - origin.x) as f32,
            y: (world_from_robot.y - origin.y) as f32,
            heading: world_from_robot.heading as f32,
        }
    }

    /// Back into the world.
    pub fn in_world(self, origin: Point2<f64>) -> Pose {
        Pose::new(f64::from(self.x) + origin.x, f64::from(self.y) + origin.y, f64::from(self.heading))
    }

    /// Whether two poses are this close together \[m, rad\].
    pub fn is_near(self, other: Self, [distance, turn]: [f64; 2]) -> bool {
        f64::from((self.x - other.x).hypot(self.y - other.y)) < distance
            && wrap_angle(f64::from(self.heading - other.heading)).abs() < turn
    }

    /// The pose after a motion (forward, sideways, turn) of the robot. The heading is not wrapped.
    pub fn moved(self, motion: [f32; 3]) -> Self {
        let (sin, cos) = sin_cos(self.heading);
        let [forward, sideways, turn] = motion;
        Self {
            x: self.x + cos * forward - sin * sideways,
            y: self.y + sin * forward + cos * sideways,
            heading: self.heading + turn,
        }
    }
}
