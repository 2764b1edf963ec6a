//! How good a trajectory is, against the ground truth that its log has.
//!
//! - [`relations`]: errors of the motion between pairs of stamps (Kuemmerle et al. 2009); needs no common frame.
//! - [`trajectory`]: errors against a trajectory of reference poses, after alignment (ATE) and between pairs (RPE).
//!
//! Both ask a trajectory for its pose at the stamps of the ground truth: [`PoseLookup`] says how. What other systems reach is in
//! [`published`].

use crate::geometry::{Pose, StampedPose};
use serde::Serialize;

pub mod published;
pub mod relations;
pub mod space;
pub mod trajectory;

/// Stamps this close, in seconds, name the same reading.
pub const SAME_STAMP: f64 = 2e-3;
/// The widest gap between two poses to interpolate over, in seconds.
pub const MAX_GAP: f64 = 2.0;
/// How far in time a pose may be taken from where there is nothing to interpolate between, in
/// seconds.
pub const MAX_DISTANCE: f64 = 0.1;

/// The poses of a trajectory by their stamps.
///
/// Stamps of real logs repeat and go backwards. Here a stamp is the name of a reading: poses are found in the order of
/// their stamps, and of several with one stamp the last in the trajectory counts.
#[derive(Clone, Debug)]
pub struct PoseLookup {
    /// Stamps rise strictly.
    poses: Vec<StampedPose>,
}

impl PoseLookup {
    /// Takes a trajectory in any order.
    pub fn new(trajectory: &[StampedPose]) -> Self {
        let mut poses = trajectory.to_vec();
        poses.sort_by(|a, b| a.stamp.total_cmp(&b.stamp));
        poses.dedup_by(|later, kept| {
            let repeats = later.stamp == kept.stamp;
            if repeats {
                kept.pose = later.pose;
            }
            repeats
        });
        Self { poses }
    }

    /// The pose at a stamp in seconds: that of the nearest stamp within [`SAME_STAMP`]; else, between two poses at most
    /// [`MAX_GAP`] apart, what lies between them (position linearly, heading on the short way); else that of the
    /// nearest stamp within [`MAX_DISTANCE`]; else none.
    pub fn at(&self, stamp: f64) -> Option<Pose> {
        let first_after = self.poses.partition_point(|pose| pose.stamp < stamp);
        let before = first_after.checked_sub(1).and_then(|last_before| self.poses.get(last_before));
        let after = self.poses.get(first_after);
        let nearest = match (before, after) {
            (Some(before), Some(after)) if stamp - before.stamp > after.stamp - stamp => after,
            _ => before.or(after)?,
        };
        let distance = (nearest.stamp - stamp).abs();
        match (before, after) {
            (Some(before), Some(after)) if distance > SAME_STAMP && after.stamp - before.stamp <= MAX_GAP => {
                Some(interpolate(before, after, stamp))
            }
            _ => (distance <= MAX_DISTANCE).then_some(nearest.pose),
        }
    }
}

fn interpolate(before: &StampedPose, after: &StampedPose, stamp: f64) -> Pose {
    let share = (stamp - before.stamp) / (after.stamp - before.stamp);
    before.pose.interpolated(after.pose, share)
}

/// Statistics of a list of errors, each at least 0; in the unit of the errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ErrorStats {
    /// How many errors there are.
    pub count: usize,
    /// Arithmetic mean.
    pub mean: f64,
    /// Standard deviation about the mean, of the population (divided by `count`).
    pub std: f64,
    /// Root of the mean square.
    pub rmse: f64,
    /// The middle one, or the mean of the two in the middle.
    pub median: f64,
    /// The largest.
    pub max: f64,
}

impl ErrorStats {
    /// `None` of no errors.
    pub fn of(errors: &[f64]) -> Option<Self> {
        let mut sorted = errors.to_vec();
        sorted.sort_by(f64::total_cmp);
        let max = *sorted.last()?;
        let count = sorted.len();
        let mean_of = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / count as f64;
        let mean = mean_of(&mut errors.iter().copied());
        Some(Self {
            count,
            mean,
            std: mean_of(&mut errors.iter().map(|error| (error - mean).powi(2))).sqrt(),
            rmse: mean_of(&mut errors.iter().map(|error| error.powi(2))).sqrt(),
            median: (sorted[(count - 1) / 2] + sorted[count / 2]) / 2.0,
            max,
        })
    }
}

/// Errors of poses, by their parts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PoseErrors {
    /// Distances of the positions, in metres.
    pub translation: ErrorStats,
    /// Absolute differences of the headings, in radians, at most π.
    pub rotation: ErrorStats,
}

impl PoseErrors {
    /// Each error is the pose that was found, seen from the true one. `None` of no errors.
    pub fn of(true_from_found: &[Pose]) -> Option<Self> {
        let translation: Vec<f64> = true_from_found.iter().map(|error| error.x.hypot(error.y)).collect();
        let rotation: Vec<f64> = true_from_found.iter().map(|error| error.heading.abs()).collect();
        Some(Self { translation: ErrorStats::of(&translation)?, rotation: ErrorStats::of(&rotation)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_of_a_list_worked_out_by_hand() {
        let stats = ErrorStats::of(&[3.0, 1.0, 8.0, 0.0]).unwrap();
        let expected =
            ErrorStats { count: 4, mean: 3.0, std: 9.5_f64.sqrt(), rmse: 18.5_f64.sqrt(), median: 2.0, max: 8.0 };
        assert_eq!(stats, expected);
        assert_eq!(ErrorStats::of(&[5.0, 1.0, 2.0]).unwrap().median, 2.0);
        assert_ne!(ErrorStats::of(&[3.0, 1.0, 8.0, 0.1]).unwrap(), expected);
        assert_eq!(ErrorStats::of(&[]), None);
    }

    /// Stamps out of order, one repeated, and a gap from 11 to 20.
    fn lookup() -> PoseLookup {
        let rows = [(11.0, 1.0, -3.0), (10.0, 9.0, 9.0), (10.0, 0.0, 3.0), (20.0, 5.0, 0.5)];
        PoseLookup::new(&rows.map(|(stamp, x, heading)| StampedPose { stamp, pose: Pose::new(x, 2.0 * x, heading) }))
    }

    #[test]
    fn poses_are_found_by_their_stamps() {
        let half_turn = 0.5 * (3.0 + (std::f64::consts::TAU - 3.0)); // from 3 to -3 on the short way
        let cases = [
            (10.0, Some((0.0, 3.0)), "exact, the last of two"),
            (10.001, Some((0.0, 3.0)), "the same stamp but for rounding"),
            (10.5, Some((0.5, half_turn)), "halfway"),
            (10.9, Some((0.9, 3.0 + 0.9 * (std::f64::consts::TAU - 6.0))), "near one, still between"),
            (9.95, Some((0.0, 3.0)), "just before the first"),
            (9.85, None, "long before the first"),
            (11.05, Some((1.0, -3.0)), "in the gap, near its start"),
            (15.0, None, "in the gap"),
            (19.95, Some((5.0, 0.5)), "in the gap, near its end"),
            (20.05, Some((5.0, 0.5)), "just after the last"),
            (20.15, None, "long after the last"),
            (f64::NAN, None, "no stamp"),
        ];
        for (stamp, expected, what) in cases {
            match (lookup().at(stamp), expected) {
                (None, None) => {}
                (Some(found), Some((x, heading))) => {
                    let error = found.seen_from(Pose::new(x, 2.0 * x, heading));
                    let size = error.x.hypot(error.y).max(error.heading.abs());
                    assert!(size < 1e-9, "{what}: {found:?} at {stamp}, not x {x}, heading {heading}");
                }
                (found, expected) => panic!("{what}: {found:?} at {stamp}, not {expected:?}"),
            }
        }
        assert_eq!(PoseLookup::new(&[]).at(1.0), None);
    }
}
