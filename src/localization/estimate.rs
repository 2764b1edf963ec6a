//! Where most of the weight is, and whether a pose can be relied on.

use super::LocalizationConfig;
use super::drawing::{BIN, bin};
use crate::evaluator::Weighed;
use crate::geometry::Pose;
use crate::motion::Motion;
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
/// The robot is located once this much speaks for its place: a quarter of the scan more than has to be explained, for six
/// steps, two metres of way. Rooms look alike, but not the way from one to the next.
const LOCATED_CREDIT: f64 = 6.0 * 0.25;
/// What speaks for a place, or against it, counts up to this: a moment of doubt is no new start, and what went wrong can be
/// made good.
const MOST_CREDIT: f64 = 2.0 * LOCATED_CREDIT;

/// A place where the robot may be.
pub(super) struct Place {
    /// The top of the posterior there.
    pub world_from_robot: Pose,
    /// Of (forward, sideways, heading) in its own frame.
    pub covariance: Matrix3<f64>,
    /// Share of the weight before and after the scan.
    pub share: f64,
    pub weight: f64,
    /// Share of the weight after the scan that lies close together.
    pub concentrated: f64,
    /// Share of the scan that the map explains from there.
    pub explained: f64,
    /// What speaks for it, of all the way.
    pub credit: f64,
}

impl Place {
    /// The weight of the place times a factor.
    pub fn scale(&mut self, factor: f64) {
        self.weight *= factor;
        self.concentrated *= factor;
    }

    /// Whether the robot is there, as far as this place alone can tell.
    pub fn is_sure(&self, config: &LocalizationConfig) -> bool {
        self.concentrated >= LOCATED_WEIGHT
            && self.explained >= config.located_explained
            && self.credit >= LOCATED_CREDIT
    }
}

/// What speaks for a place after one more step: of all the way there, the sum of what the map explains of the scans less what
/// it has to. It is a sequential test of this place against any that explains just as much as it has to.
pub(super) fn credit(before: f64, explained: f64, config: &LocalizationConfig) -> f64 {
    (before + explained - config.located_explained).clamp(-MOST_CREDIT, MOST_CREDIT)
}

/// Factors for the weights of places, by which eq. 18 decides no more than it can between them.
///
/// It takes the map for true. But maps lack walls, and what they lack or have wrong at a place speaks against that place
/// step after step: of two places that look alike to the robot, the one that is drawn a little better would win.
/// So nothing speaks against a place of which the map explains `enough` to rely on, and against others only what is missing.
/// `most` is the log of how much likelier the map can make a scan at best.
pub(super) fn held_back(places: &[Place], most: f64, enough: f64) -> Vec<f64> {
    let gain = |place: &Place| (place.weight / place.share).ln();
    let best = places.iter().map(gain).fold(f64::NEG_INFINITY, f64::max);
    let factor = |place: &Place| {
        // Of a place that is out of the question nothing is left to hold.
        if place.weight < f64::MIN_POSITIVE {
            return 1.0;
        }
        let behind = best - gain(place);
        let counts = behind.min(most * (enough - place.explained).max(0.0));
        (behind - counts).exp()
    };
    places.iter().map(factor).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(share: f64, weight: f64, explained: f64) -> Place {
        let world_from_robot = Pose::IDENTITY;
        let covariance = Matrix3::zeros();
        Place { world_from_robot, covariance, share, weight, concentrated: weight, explained, credit: 0.0 }
    }

    /// By hand: of equal shares the weights are as e⁰, e⁻², e⁻⁴ and e⁻⁴; the first two explain enough, the third lacks 0.1 of
    /// the scan, which can count for e⁻¹, the fourth all of what its weight says.
    #[test]
    fn nothing_speaks_against_a_place_that_is_explained() {
        let weight = |log: f64| 0.25 * log.exp();
        let places = [(0.0, 0.9), (-2.0, 0.61), (-4.0, 0.5), (-4.0, 0.1)]
            .map(|(log, explained)| place(0.25, weight(log), explained));
        let found: Vec<f64> = held_back(&places, 10.0, 0.6).iter().map(|factor| factor.ln()).collect();
        for (found, expected) in found.into_iter().zip([0.0, 2.0, 3.0, 0.0]) {
            assert!((found - expected).abs() < 1e-9, "{found}, not {expected}");
        }
        assert!(held_back(&[], 10.0, 0.6).is_empty());
        assert_eq!(held_back(&[place(0.5, 1.0, 0.9), place(0.5, 0.0, 0.9)], 10.0, 0.6), [1.0, 1.0], "impossible");
    }

    #[test]
    fn what_speaks_for_and_against_a_place_counts_over_the_way() {
        let config = LocalizationConfig::default();
        let after = |steps: &[(u32, f64)]| {
            let all = steps.iter().flat_map(|&(times, explained)| std::iter::repeat_n(explained, times as usize));
            all.fold(0.0, |before, explained| credit(before, explained, &config))
        };
        let is_sure = |steps| Place { credit: after(steps), ..place(1.0, 1.0, 0.9) }.is_sure(&config);
        // A surplus of 0.3 a step: 1.5 after five of them.
        assert!(!is_sure(&[(4, 0.9)]) && is_sure(&[(6, 0.9)]));
        // Ten steps that lack 0.3 cost ten that have as much more.
        assert!(!is_sure(&[(10, 0.3), (14, 0.9)]) && is_sure(&[(10, 0.3), (16, 0.9)]));
        // A moment of doubt is none too much, and nothing counts for ever.
        assert!(
            is_sure(&[(100, 0.9), (4, 0.3)]) && !is_sure(&[(100, 0.9), (6, 0.3)]) && is_sure(&[(100, 0.0), (16, 0.9)])
        );
    }
}
