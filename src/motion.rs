//! Odometry -> motion distribution (eq. 17 of the paper).
//!
//! A motion is the pose of the robot at the later time seen from the earlier one, `earlier_from_later`, with a
//! Gaussian error in the later robot's own frame: forward, sideways, heading.

use crate::geometry::Pose;
use crate::parameters::parameters;
use nalgebra::{Matrix3, Vector3};

parameters! {
    /// How far odometry is trusted: standard deviations in proportion to the motion. The defaults are wide enough for a robot
    /// whose heading is off by half a radian in a bad moment, such as that of the CSAIL log.
    pub struct MotionConfig {
        /// Forward and sideways error of a travelled distance \[m/m\].
        position_per_distance: f64 = 0.05, in 0.0..=1e3;
        /// Forward and sideways error of a turn \[m/rad\].
        position_per_turn: f64 = 0.02, in 0.0..=1e3;
        /// Heading error of a travelled distance \[rad/m\].
        heading_per_distance: f64 = 0.2, in 0.0..=1e3;
        /// Heading error of a turn \[rad/rad\].
        heading_per_turn: f64 = 0.3, in 0.0..=1e3;
        /// Error of a motion of nothing, forward and sideways \[m\].
        position_floor: f64 = 0.005, in 1e-6..=1e3;
        /// Error of a motion of nothing, heading \[rad\].
        heading_floor: f64 = 0.01, in 1e-6..=1e3;
    }
}

/// A Gaussian over motions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// The mean, `earlier_from_later`.
    pub mean: Pose,
    /// Covariance of (forward \[m\], sideways \[m\], heading \[rad\]) in the later robot's frame; positive definite.
    pub covariance: Matrix3<f64>,
}

impl Motion {
    /// No motion, no doubt.
    pub fn none() -> Self {
        Self { mean: Pose::IDENTITY, covariance: Matrix3::zeros() }
    }

    /// The motion between two odometry poses (eq. 17).
    pub fn from_odometry(odom_from_earlier: Pose, odom_from_later: Pose, config: &MotionConfig) -> Self {
        let mean = odom_from_later.seen_from(odom_from_earlier);
        let (distance, turn) = (mean.x.hypot(mean.y), mean.heading.abs());
        let position =
            config.position_floor + config.position_per_distance * distance + config.position_per_turn * turn;
        let heading = config.heading_floor + config.heading_per_distance * distance + config.heading_per_turn * turn;
        let diagonal = Vector3::new(position * position, position * position, heading * heading);
        Self { mean, covariance: Matrix3::from_diagonal(&diagonal) }
    }

    /// This motion and then another one: means compose, covariances are carried to the last frame and added.
    pub fn then(&self, next: &Motion) -> Self {
        let carry = next.mean.inverse().adjoint();
        Self { mean: self.mean * next.mean, covariance: carry * self.covariance * carry.transpose() + next.covariance }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_grows_with_the_motion_as_configured() {
        let config = MotionConfig {
            position_per_distance: 0.1,
            position_per_turn: 0.0,
            heading_per_distance: 0.02,
            heading_per_turn: 0.5,
            position_floor: 0.001,
            heading_floor: 0.002,
        };
        let motion = Motion::from_odometry(Pose::new(5.0, 5.0, 1.0), Pose::new(5.0, 7.0, 1.4), &config);
        let expected = [0.001 + 0.1 * 2.0, 0.001 + 0.1 * 2.0, 0.002 + 0.02 * 2.0 + 0.5 * 0.4];
        for (axis, sigma) in expected.into_iter().enumerate() {
            assert!((motion.covariance[(axis, axis)].sqrt() - sigma).abs() < 1e-12);
        }
    }
}
