//! Odometry -> motion distribution (eq. 17 of the paper).
//!
//! A motion is the pose of the robot at the later time seen from the earlier one, `earlier_from_later`, with a
//! Gaussian error in the later robot's own frame: forward, sideways, heading.

use crate::geometry::Pose;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// How far odometry is trusted: standard deviations in proportion to the motion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MotionConfig {
    /// Forward and sideways error of a travelled distance \[m/m\].
    pub position_per_distance: f64,
    /// Forward and sideways error of a turn \[m/rad\].
    pub position_per_turn: f64,
    /// Heading error of a travelled distance \[rad/m\].
    pub heading_per_distance: f64,
    /// Heading error of a turn \[rad/rad\].
    pub heading_per_turn: f64,
    /// Error of a motion of nothing, forward and sideways \[m\].
    pub position_floor: f64,
    /// Error of a motion of nothing, heading \[rad\].
    pub heading_floor: f64,
}

impl Default for MotionConfig {
    /// Wide enough for a robot whose heading is off by half a radian in a bad moment, such as that of the CSAIL log.
    fn default() -> Self {
        Self {
            position_per_distance: 0.05,
            position_per_turn: 0.02,
            heading_per_distance: 0.2,
            heading_per_turn: 0.3,
            position_floor: 0.005,
            heading_floor: 0.01,
        }
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
        let carry = carried(next.mean.inverse());
        Self { mean: self.mean * next.mean, covariance: carry * self.covariance * carry.transpose() + next.covariance }
    }
}

/// The matrix that carries a small motion of one frame into another frame: the adjoint of SE(2) for
/// (forward, sideways, heading) and `to_from`.
pub fn carried(to_from: Pose) -> Matrix3<f64> {
    let (sin, cos) = to_from.heading.sin_cos();
    Matrix3::new(cos, -sin, to_from.y, sin, cos, -to_from.x, 0.0, 0.0, 1.0)
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

    /// The oracle: a small motion before `next` moves its end by the finite difference of the composed poses.
    #[test]
    fn carrying_is_the_derivative_of_composition() {
        let next = Pose::new(1.5, -0.7, 2.0);
        let carry = carried(next.inverse());
        let step = 1e-6;
        for axis in 0..3 {
            let mut small = [0.0; 3];
            small[axis] = step;
            let moved = (Pose::new(small[0], small[1], small[2]) * next).seen_from(next);
            for (row, value) in [moved.x, moved.y, moved.heading].into_iter().enumerate() {
                assert!((carry[(row, axis)] - value / step).abs() < 1e-5, "row {row} axis {axis}");
            }
        }
    }
}
