//! Odometry -> motion distribution (eq. 17 of the paper).
//!
//! A motion is the pose of the robot at the later time seen from the earlier one, `earlier_from_later`, with a
//! Gaussian error in the later robot's own frame: forward, sideways, heading.

use crate::geometry::{Pose, wrap_angle};
use crate::parameters::parameters;
use nalgebra::{Matrix3, Vector3};

parameters! {
    /// Noise of odometry: standard deviations in proportion to the motion. The defaults allow for a heading that is suddenly
    /// off by half a radian, as in the CSAIL log.
    pub struct MotionConfig {
        /// Forward and sideways error of a travelled distance \[m/m\].
        position_per_distance: f64 = 0.05, in 0.0..=1e3;
        /// Forward and sideways error of a turn \[m/rad\].
        position_per_turn: f64 = 0.02, in 0.0..=1e3;
        /// Heading error of a travelled distance \[rad/m\].
        heading_per_distance: f64 = 0.2, in 0.0..=1e3;
        /// Heading error of a turn \[rad/rad\].
        heading_per_turn: f64 = 0.3, in 0.0..=1e3;
        /// Error of any motion, even of none, forward and sideways \[m\].
        position_floor: f64 = 0.005, in 1e-6..=1e3;
        /// Error of the heading of any motion, even of none \[rad\].
        heading_floor: f64 = 0.01, in 1e-6..=1e3;
        /// Error of the stamps of odometry and scans \[s\]: times the speed it is an error of the position, times the turn rate
        /// one of the heading. Stamps are often those of receipt, and messages wait for each other.
        stamp_error: f64 = 0.05, in 0.0..=1e3;
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
    /// The identity, known exactly.
    pub fn none() -> Self {
        Self { mean: Pose::IDENTITY, covariance: Matrix3::zeros() }
    }

    /// Its covariance by the axes of the earlier frame: of (x \[m\], y \[m\], heading \[rad\]).
    pub fn covariance_in_earlier_frame(&self) -> Matrix3<f64> {
        let turn = Pose::new(0.0, 0.0, self.mean.heading).adjoint();
        turn * self.covariance * turn.transpose()
    }

    /// This motion and then another one: means compose, covariances are carried to the last frame and added.
    pub fn then(&self, next: &Motion) -> Self {
        let carry = next.mean.inverse().adjoint();
        Self { mean: self.mean * next.mean, covariance: carry * self.covariance * carry.transpose() + next.covariance }
    }
}

/// A motion of any number of readings, and the sums that its error grows with, so that the noise does not depend on the rate of
/// the readings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Travel {
    /// The mean, `earlier_from_later`.
    mean: Pose,
    /// Distance travelled \[m\].
    distance: f64,
    /// Sum of the absolute turns \[rad\].
    turn: f64,
    /// Standard deviation of the unmeasured part of the position, forward and sideways \[m\].
    unmeasured_position: f64,
    /// Standard deviation of the unmeasured part of the heading \[rad\].
    unmeasured_heading: f64,
}

impl Travel {
    /// A motion measured by odometry.
    pub fn measured(mean: Pose) -> Self {
        Self { mean, distance: mean.x.hypot(mean.y), turn: mean.heading.abs(), ..Self::default() }
    }

    /// A guessed motion of `seconds` \[s\] that nothing measured.
    pub fn unmeasured(mean: Pose, seconds: f64) -> Self {
        let (unmeasured_position, unmeasured_heading) = (UNMEASURED_SPEED * seconds, UNMEASURED_TURN_RATE * seconds);
        Self { mean, unmeasured_position, unmeasured_heading, ..Self::default() }
    }

    /// The same, where odometry measured another turn than this motion has \[rad\]: its turn is as doubtful as the two differ.
    pub fn doubting(self, turn: f64) -> Self {
        Self { turn: self.turn + wrap_angle(turn - self.mean.heading).abs(), ..self }
    }

    /// The same, where its turn, and no more, was measured.
    pub fn with_measured_turn(self) -> Self {
        Self { turn: self.mean.heading.abs(), unmeasured_heading: 0.0, ..self }
    }

    /// No motion, with the noise of one that odometry may have missed: at `velocity` \[m/s, m/s, rad/s\] for `seconds` \[s\].
    pub fn missed(velocity: Pose, seconds: f64) -> Self {
        Self {
            unmeasured_position: velocity.x.hypot(velocity.y) * seconds,
            unmeasured_heading: velocity.heading.abs() * seconds,
            ..Self::default()
        }
    }

    /// This motion and then another one.
    pub fn then(&self, next: &Self) -> Self {
        Self {
            mean: self.mean * next.mean,
            distance: self.distance + next.distance,
            turn: self.turn + next.turn,
            unmeasured_position: self.unmeasured_position + next.unmeasured_position,
            unmeasured_heading: self.unmeasured_heading + next.unmeasured_heading,
        }
    }

    /// The mean, `earlier_from_later`.
    pub fn mean(&self) -> Pose {
        self.mean
    }

    /// Whether odometry measured all of it.
    pub fn is_measured(&self) -> bool {
        self.unmeasured_position == 0.0 && self.unmeasured_heading == 0.0
    }

    /// The same noise with another mean.
    pub fn moved_to(self, mean: Pose) -> Self {
        Self { mean, ..self }
    }

    /// The distribution of the motion (eq. 17). Standard deviations grow in proportion to distance, turn and unmeasured time, as
    /// those of a scale error do; added to them are the floors, and the motion at this `velocity` \[m/s, m/s, rad/s\] within the
    /// error of a stamp.
    pub fn motion(&self, config: &MotionConfig, velocity: Pose) -> Motion {
        let position = config.position_floor
            + config.stamp_error * velocity.x.hypot(velocity.y)
            + config.position_per_distance * self.distance
            + config.position_per_turn * self.turn
            + self.unmeasured_position;
        let heading = config.heading_floor
            + config.stamp_error * velocity.heading.abs()
            + config.heading_per_distance * self.distance
            + config.heading_per_turn * self.turn
            + self.unmeasured_heading;
        let diagonal = Vector3::new(position * position, position * position, heading * heading);
        Motion { mean: self.mean, covariance: Matrix3::from_diagonal(&diagonal) }
    }
}

/// Standard deviation of the speed of an unmeasured motion \[m/s\]: a walking pace is two of them.
const UNMEASURED_SPEED: f64 = 0.5;
/// Standard deviation of the turn rate of an unmeasured motion \[rad/s\]: a quarter turn a second is three of them.
const UNMEASURED_TURN_RATE: f64 = 0.5;

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: MotionConfig = MotionConfig {
        position_per_distance: 0.1,
        position_per_turn: 0.3,
        heading_per_distance: 0.02,
        heading_per_turn: 0.5,
        position_floor: 0.001,
        heading_floor: 0.002,
        stamp_error: 0.0,
    };

    #[test]
    fn noise_grows_with_the_motion_as_configured() {
        let moved = Pose::new(5.0, 7.0, 1.4).seen_from(Pose::new(5.0, 5.0, 1.0));
        let motion = Travel::measured(moved).motion(&CONFIG, Pose::IDENTITY);
        let position = 0.001 + 0.1 * 2.0 + 0.3 * 0.4;
        let expected = [position, position, 0.002 + 0.02 * 2.0 + 0.5 * 0.4];
        for (axis, sigma) in expected.into_iter().enumerate() {
            assert!((motion.covariance[(axis, axis)].sqrt() - sigma).abs() < 1e-12);
        }
    }

    /// Two metres a second and half a radian a second, stamps that are off by a tenth of a second.
    #[test]
    fn a_fast_robot_is_where_its_stamps_put_it() {
        let config = MotionConfig { stamp_error: 0.1, ..CONFIG };
        let Motion { covariance, .. } = Travel::default().motion(&config, Pose::new(1.2, -1.6, -0.5));
        let expected = [0.001 + 0.2, 0.001 + 0.2, 0.002 + 0.05];
        for (axis, sigma) in expected.into_iter().enumerate() {
            assert!((covariance[(axis, axis)].sqrt() - sigma).abs() < 1e-12, "{covariance}");
        }
    }

    /// An arc in one piece and in ten: the chord of a tenth is shorter by its curvature alone.
    #[test]
    fn noise_does_not_depend_on_into_how_many_readings_a_motion_is_cut() {
        let arc = |turn: f64| Pose::new((turn.sin()) / 0.2, (1.0 - turn.cos()) / 0.2, turn);
        let whole = Travel::measured(arc(0.1)).motion(&CONFIG, Pose::IDENTITY);
        let piece = Travel::measured(arc(0.01));
        let cut = (0..10).fold(Travel::default(), |travel, _| travel.then(&piece)).motion(&CONFIG, Pose::IDENTITY);
        assert!((cut.mean.x - whole.mean.x).abs() < 1e-9 && (cut.mean.heading - 0.1).abs() < 1e-12);
        let apart = (cut.covariance - whole.covariance).abs().max() / whole.covariance.max();
        assert!(apart < 1e-3, "{apart}");
        let guess = Travel::unmeasured(Pose::IDENTITY, 0.2).motion(&CONFIG, Pose::IDENTITY).covariance;
        assert!((guess[(0, 0)].sqrt() - 0.101).abs() < 1e-12, "{guess}");
    }
}
