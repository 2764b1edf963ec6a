//! What the odometry of this drive was worth: its errors, as far as scans have shown them, in units of those that are configured.
//! They decide between the modes of a scan match. Particles are drawn as configured: drawn more narrowly, as these errors would have
//! it, they closed fewer loops.

use crate::motion::MotionConfig;
use serde::Serialize;

/// By what the standard deviations of `[motion]` would have to be multiplied; 1 where the scans have shown no error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OdometryErrors {
    /// Those of positions.
    pub position: f64,
    /// Those of headings.
    pub heading: f64,
}

impl Default for OdometryErrors {
    fn default() -> Self {
        Self { position: 1.0, heading: 1.0 }
    }
}

/// Errors of motions in standard deviations, in the order of their absolute values.
#[derive(Clone, Debug)]
pub(super) struct Errors(Vec<f64>);

/// A normal distribution has half of its errors within so many standard deviations.
const MEDIAN: f64 = 0.674_489_750_196_082;
/// Nine errors as they are configured, with which a drive begins: the quantiles from 10 % to 90 %.
const CONFIGURED: [f64; 9] = [0.126, 0.253, 0.385, 0.524, MEDIAN, 0.842, 1.036, 1.282, 1.645];

impl OdometryErrors {
    /// The noise of motions with these errors. A stamp that is off shows in both of them. The floors stay: however good odometry is, a
    /// scan is matched no better.
    pub(super) fn scaled(&self, configured: &MotionConfig) -> MotionConfig {
        let &Self { position, heading } = self;
        MotionConfig {
            position_per_distance: position * configured.position_per_distance,
            position_per_turn: position * configured.position_per_turn,
            heading_per_distance: heading * configured.heading_per_distance,
            heading_per_turn: heading * configured.heading_per_turn,
            stamp_error: position.max(heading) * configured.stamp_error,
            ..*configured
        }
    }
}

impl Default for Errors {
    fn default() -> Self {
        Self(CONFIGURED.to_vec())
    }
}

impl Errors {
    pub(super) fn add(&mut self, error: f64) {
        let error = error.abs();
        let place = self.0.partition_point(|&other| other < error);
        self.0.insert(place, error);
    }

    /// By what to multiply standard deviations so that half of the errors are as they should be: the median does not mind
    /// a wheel that spins now and then.
    pub(super) fn factor(&self) -> f64 {
        self.0.get(self.0.len() / 2).map_or(1.0, |median| median / MEDIAN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use crate::motion::{Motion, MotionConfig};
    use crate::random::{Draw, normals};
    use crate::tracking::{Tracker, TrackingConfig};
    use nalgebra::{Matrix3, Vector3};

    /// A motion of half a metre is expected to err by `EXPECTED`.
    const MOTION: MotionConfig = MotionConfig {
        position_per_distance: 0.1,
        position_per_turn: 0.0,
        heading_per_distance: 0.2,
        heading_per_turn: 0.0,
        position_floor: 1e-6,
        heading_floor: 1e-6,
        stamp_error: 0.0,
    };
    /// Forward, sideways, heading \[m, m, rad\].
    const EXPECTED: [f64; 3] = [0.05, 0.05, 0.1];
    const FORWARD: Pose = Pose { x: 0.5, y: 0.0, heading: 0.0 };
    const SEED: u64 = 7;

    /// Drives half a metre a second. The true motions are off odometry by `errors`, and the scans know them to `known`, both in units
    /// of `EXPECTED`.
    fn drive(tracker: &mut Tracker, seconds: std::ops::Range<u32>, errors: [f64; 3], known: [f64; 3]) {
        for second in seconds {
            tracker.add(f64::from(second), Pose::new(0.5 * f64::from(second), 0.0, 0.0));
            let normals = normals(SEED, 0, second, Draw::Motion).map(f64::from);
            let [x, y, heading] = [0, 1, 2].map(|axis| errors[axis] * EXPECTED[axis] * normals[axis]);
            let sigmas = Vector3::from_fn(|axis, _| known[axis] * EXPECTED[axis]);
            let covariance = Matrix3::from_diagonal(&sigmas.component_mul(&sigmas));
            tracker.correct(Motion { mean: FORWARD * Pose::new(x, y, heading), covariance });
            tracker.begin_step();
        }
    }

    fn started() -> Tracker {
        let mut tracker = Tracker::new(MOTION, TrackingConfig::default());
        tracker.add(0.0, Pose::IDENTITY);
        tracker
    }

    fn shown(errors: [f64; 3], known: [f64; 3]) -> OdometryErrors {
        let mut tracker = started();
        drive(&mut tracker, 1..401, errors, known);
        tracker.odometry_errors()
    }

    /// By 400 headings and 800 positions, forward and sideways.
    #[test]
    fn the_errors_of_this_drive_are_measured() {
        for [position, heading] in [[0.3, 0.2], [3.0, 2.0], [1.0, 1.0]] {
            let errors = shown([position, position, heading], [0.01; 3]);
            let off = [errors.position / position - 1.0, errors.heading / heading - 1.0];
            assert!(off[0].abs() < 0.1 && off[1].abs() < 0.15, "seed {SEED}, {position}, {heading}: {errors:?}");
        }
    }

    #[test]
    fn a_scan_that_knows_no_better_than_odometry_shows_nothing() {
        assert_eq!(shown([0.1; 3], [0.6; 3]), OdometryErrors::default());
        // Along a corridor: the motions sideways count alone, and are as configured. The median of 400 is known to 6 %.
        let corridor = shown([0.0, 1.0, 0.1], [0.6, 0.01, 0.6]);
        assert!((corridor.position - 1.0).abs() < 0.15, "seed {SEED}: {corridor:?}");
        assert_eq!(corridor.heading, 1.0);
    }

    /// Odometry that never changes, or that jumps, has not measured the motion; a step that no scan corrected shows no error.
    #[test]
    fn nothing_is_shown_where_nothing_was_measured() {
        let exact = Motion { mean: FORWARD, covariance: Matrix3::identity() * 1e-8 };
        let (mut blind, mut jumping, mut unseen) = (started(), started(), started());
        for second in 1..200 {
            let ahead = Pose::new(0.5 * f64::from(second), 0.0, 0.0);
            blind.add(f64::from(second), Pose::IDENTITY);
            jumping.add(f64::from(second), Pose { y: 1e3 * f64::from(second), ..ahead });
            unseen.add(f64::from(second), ahead);
            for tracker in [&mut blind, &mut jumping] {
                tracker.correct(exact);
            }
            for tracker in [&mut blind, &mut jumping, &mut unseen] {
                tracker.begin_step();
            }
        }
        assert_eq!(jumping.refused().len(), 199);
        for tracker in [blind, jumping, unseen] {
            assert_eq!(tracker.odometry_errors(), OdometryErrors::default());
        }
    }

    #[test]
    fn the_factor_is_that_of_the_errors_with_outliers_or_without() {
        for (outliers, tolerance) in [(0, 0.05), (100, 0.15)] {
            let mut errors = Errors::default();
            for number in 0..2000 {
                let [normal, ..] = normals(7, 0, number, Draw::Motion);
                errors.add(if number < outliers { 1e3 } else { 0.3 * f64::from(normal) });
            }
            let factor = errors.factor();
            assert!((factor / 0.3 - 1.0).abs() < tolerance, "seed 7, {outliers} outliers: {factor}");
        }
    }
}
