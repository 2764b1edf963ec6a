//! Poses of the plane, SE(2), and of space, SE(3), and the cameras that see it.
//!
//! A pose is named for the two frames that it joins: `world_from_robot` takes points of the robot's frame to the
//! world, and products chain by their neighbours, `world_from_robot * robot_from_laser`. Metres and radians.

mod camera;
mod se2;
mod se3;

pub use camera::Pinhole;
pub use se2::{Pose, StampedPose, wrap_angle};
pub use se3::{Pose3, StampedPose3, rotation_jacobian, rotation_log_jacobian};
