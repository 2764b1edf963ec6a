//! Where most of the weight is, and whether a pose can be relied on.

use super::{BIN, LocalizationConfig, bin};
use crate::evaluator::Weighed;
use crate::geometry::Pose;
use crate::motion::Motion;
use crate::report::Confidence;
use nalgebra::{Matrix3, Point2, Vector3};
use std::collections::HashMap;

/// No pose is known better than this in (forward, sideways, heading), whatever particles or a map say: standard
/// deviations \[m, m, rad\].
pub(super) const BEST_KNOWN: Vector3<f64> = Vector3::new(0.05, 0.05, 0.02);
/// The 99 % quantile of the χ² distribution of three degrees of freedom.
const CHI2_99_3DOF: f64 = 11.345;
/// A cloud is what lies this close around its mean \[m, rad\].
const CLOUD: [f64; 2] = [1.0, 0.5];

/// Particles around a place with much of the weight, in the evaluator's frame.
pub(super) struct Cloud {
    pub mean: Pose,
    /// Of (forward, sideways, heading) in the frame of the mean, or of one close by.
    pub covariance: Matrix3<f64>,
    /// Share of all weight.
    pub weight: f64,
}

impl Cloud {
    /// The cloud around the bin with the largest weight.
    pub fn heaviest(weighed: &[Weighed], weights: &[f64]) -> Self {
        let least = 1e-6 / weights.len() as f64;
        let heavy = || weighed.iter().zip(weights).filter(|(_, weight)| **weight > least);
        let mut bins: HashMap<[i32; 3], f64> = HashMap::new();
        for (Weighed { pose, .. }, weight) in heavy() {
            *bins.entry(bin(*pose)).or_default() += weight;
        }
        // Of equal bins always the same: the order of a hash map is not.
        let heaviest = bins.into_iter().max_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        let middle = heaviest.map_or([0.0; 3], |(bin, _)| std::array::from_fn(|i| (f64::from(bin[i]) + 0.5) * BIN[i]));
        let mut mean = Pose::new(middle[0], middle[1], middle[2]);
        let mut cloud = Cloud { mean, covariance: Matrix3::zeros(), weight: 0.0 };
        // The bin may have cut the cloud in two: its mean moves to where it is.
        for _ in 0..3 {
            let (mut weight, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
            for (Weighed { pose, .. }, w) in heavy() {
                let off = pose.in_world(Point2::origin()).seen_from(mean);
                if off.x.hypot(off.y) < CLOUD[0] && off.heading.abs() < CLOUD[1] {
                    let off = Vector3::new(off.x, off.y, off.heading);
                    weight += w;
                    first += off * *w;
                    second += off * off.transpose() * *w;
                }
            }
            if weight <= 0.0 {
                break;
            }
            let off = first / weight;
            let covariance = second / weight - off * off.transpose();
            mean = mean * Pose::new(off.x, off.y, off.z);
            cloud = Cloud { mean, covariance, weight };
        }
        cloud
    }
}

/// Whether this can have been the motion: 99 % are as close to the mean, with this much more of doubt.
pub(super) fn is_plausible(mean: Pose, motion: &Motion, more: Matrix3<f64>) -> bool {
    let off = mean.seen_from(motion.mean);
    let off = Vector3::new(off.x, off.y, off.heading);
    let information = (motion.covariance + more).try_inverse();
    information.is_none_or(|information| off.dot(&(information * off)) <= CHI2_99_3DOF)
}

/// The covariance of a pose that is known `times` times worse than [`BEST_KNOWN`].
pub(super) fn best_known(times: f64) -> Matrix3<f64> {
    Matrix3::from_diagonal(&BEST_KNOWN.map(|sigma| (times * sigma).powi(2)))
}

/// The robot is located where one cloud has this share of the weight: 95 % confidence.
const LOCATED_WEIGHT: f64 = 0.95;
/// The robot is located once all has been well for about this many steps, two metres of way: rooms look alike, but not the
/// way from one to the next.
const LOCATED_STEPS: u32 = 6;

/// Steps at which the pose could be relied on, less those at which it could not; up to twice as many as are wanted.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Trust {
    pub good_steps: u32,
}

impl Trust {
    /// Judges the estimate of a step: the share of the weight that its cloud has, the share of the scan that the map explains
    /// from there, and whether the robot can have come there.
    pub fn judge(&mut self, weight: f64, explained: f64, is_expected: bool, config: &LocalizationConfig) -> Confidence {
        let is_good = weight >= LOCATED_WEIGHT && explained >= config.located_explained && is_expected;
        // A bad step costs a good one, so that a moment of doubt is no new start.
        let good = if is_good { self.good_steps + 1 } else { self.good_steps.saturating_sub(1) };
        self.good_steps = good.min(2 * LOCATED_STEPS);
        Confidence { weight, explained, is_located: is_good && self.good_steps >= LOCATED_STEPS }
    }
}
