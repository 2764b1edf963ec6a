//! The places where the robot may be, and whether an estimate can be relied on.

use super::bins::{BIN, bin};
use super::clouds::{Clouds, LIGHTEST_CLOUD};
use super::{Localization, Located};
use crate::evaluator::Weighed;
use crate::evaluator::cholesky::unpacked;
use crate::evaluator::tiles::Tile;
use crate::geometry::Pose;
use crate::motion::Motion;
use crate::report::Confidence;
use nalgebra::{Matrix3, Point2, Vector3};
use std::collections::HashMap;

/// No pose is taken to be known better than this in (forward, sideways, heading): standard deviations \[m, m, rad\].
const BEST_KNOWN: Vector3<f64> = Vector3::new(0.05, 0.05, 0.02);
/// The 99 % quantile of the χ² distribution of three degrees of freedom.
const CHI2_99_3DOF: f64 = 11.345;
/// Particles this close to its mean belong to a cloud \[m, rad\].
const CLOUD: [f64; 2] = [1.0, 0.5];

/// Particles around a place with much of the weight, in the evaluator's frame.
pub(super) struct Cloud {
    pub mean: Pose,
    /// Of (forward, sideways, heading) in the frame of the mean, or of a pose close to it.
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
        // The border of the bin may cut the cloud in two: mean shift centres it.
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

/// Whether a motion lies within the 99 % region of the predicted one, whose covariance is increased by `more`.
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
/// The robot is located once the evidence for its place has reached this: a quarter of the scan more than required, in six
/// steps, which are two metres. One room resembles another, but the way from one to the next differs.
const LOCATED_EVIDENCE: f64 = 6.0 * 0.25;
/// Bound of the evidence for or against a place: a few bad scans do not undo it, and a wrong start can be made up for.
const MAX_EVIDENCE: f64 = 2.0 * LOCATED_EVIDENCE;

/// A place where the robot may be.
pub(super) struct Place {
    /// The mode of the posterior there.
    pub world_from_robot: Pose,
    /// Of (forward, sideways, heading) in its own frame.
    pub covariance: Matrix3<f64>,
    /// Share of the weight before and after the scan.
    pub share: f64,
    pub weight: f64,
    /// Share of the weight after the scan that lies in the heaviest cloud around the mode.
    pub concentrated: f64,
    /// Share of the scan that the map explains from there, 0 to 1.
    pub explained: f64,
    /// Evidence for it, accumulated over the steps.
    pub evidence: f64,
}

impl Place {
    /// Multiplies the weights of the place by a factor.
    pub fn scale(&mut self, factor: f64) {
        self.weight *= factor;
        self.concentrated *= factor;
    }

    /// Whether the robot is there, judged by this place alone: `enough` is the share of a scan that has to be explained.
    pub fn is_sure(&self, enough: f64) -> bool {
        self.concentrated >= LOCATED_WEIGHT && self.explained >= enough && self.evidence >= LOCATED_EVIDENCE
    }
}

/// The evidence for a place after one more step: the bounded sum over the steps of the share of the scan that the map explains,
/// less the share that is `enough`. This is a sequential test of the place against one that explains just enough.
fn evidence(before: f64, explained: f64, enough: f64) -> f64 {
    (before + explained - enough).clamp(-MAX_EVIDENCE, MAX_EVIDENCE)
}

/// Factors that limit how far eq. 18 lowers the weight of one place against another.
///
/// Eq. 18 takes the map for exact. But maps lack walls, and what is missing or wrong at a place counts against it in every
/// step: of two places that look the same to the robot, the one that is mapped slightly better would win. So a place where the
/// map explains `enough` of the scan loses no weight against the best one, and others lose only by what is missing to that.
/// `most` is the largest log-likelihood ratio that the map can give a scan.
fn held_back(places: &[Place], most: f64, enough: f64) -> Vec<f64> {
    let gain = |place: &Place| (place.weight / place.share).ln();
    let best = places.iter().map(gain).fold(f64::NEG_INFINITY, f64::max);
    let factor = |place: &Place| {
        // A place without weight stays without.
        if place.weight < f64::MIN_POSITIVE {
            return 1.0;
        }
        let behind = best - gain(place);
        let counts = behind.min(most * (enough - place.explained).max(0.0));
        (behind - counts).exp()
    };
    places.iter().map(factor).collect()
}

impl Localization {
    /// Evaluates every place where the robot may be, corrects the weights, and judges the heaviest.
    pub(super) fn estimate(
        &mut self,
        weighed: &[Weighed],
        weights: &mut [f64],
        clouds: &Clouds,
        tiles: &[Tile],
    ) -> Located {
        let mut places: Vec<Place> =
            clouds.clouds.iter().map(|members| self.place(members, weighed, weights, tiles)).collect();
        let most = self.config.temper * self.walls.most(tiles);
        let held = held_back(&places, most, self.config.located_explained);
        for ((place, members), factor) in places.iter_mut().zip(&clouds.clouds).zip(held) {
            place.scale(factor);
            members.iter().for_each(|&number| weights[number as usize] *= factor);
        }
        let total: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|weight| *weight /= total);
        places.iter_mut().for_each(|place| place.scale(1.0 / total));

        let fit = places.iter().map(|place| place.explained).fold(0.0, f64::max);
        let is_alone = places.iter().filter(|place| place.weight >= LIGHTEST_CLOUD).count() <= 1;
        let heaviest = places.into_iter().reduce(|a, b| if b.weight > a.weight { b } else { a });
        let heaviest = heaviest.unwrap_or_else(|| self.evaluate(&Cloud::heaviest(weighed, weights), 0.0, tiles));
        self.from_anywhere = self.recovery.update(fit.max(heaviest.explained));
        self.judge(&heaviest, is_alone)
    }

    /// The place of a cloud. All particles of the cloud take over its evidence.
    fn place(&mut self, members: &[u32], weighed: &[Weighed], weights: &[f64], tiles: &[Tile]) -> Place {
        let of = |numbers: &[f64]| members.iter().map(|&number| numbers[number as usize]).collect::<Vec<f64>>();
        let particles: Vec<Weighed> = members.iter().map(|&number| weighed[number as usize]).collect();
        let (weights, shares, evidence) = (of(weights), of(&self.shares), of(&self.evidence));
        let share: f64 = shares.iter().sum();
        let before = shares.iter().zip(evidence).map(|(share, evidence)| share * evidence).sum::<f64>() / share;
        let cloud = Cloud::heaviest(&particles, &weights);
        let place = Place { share, weight: weights.iter().sum(), ..self.evaluate(&cloud, before, tiles) };
        members.iter().for_each(|&number| self.evidence[number as usize] = place.evidence);
        place
    }

    /// The MAP estimate of the pose near a cloud, by Gauss-Newton steps from its mean, with the evidence for it; `before` is the
    /// evidence up to the last step.
    pub(super) fn evaluate(&mut self, cloud: &Cloud, before: f64, tiles: &[Tile]) -> Place {
        // The few particles of a cloud may coincide.
        let mode = self.climb(cloud.mean, &(cloud.covariance + best_known(1.0)), tiles, false);
        let world_from_robot = mode.pose.in_world(self.walls.table.anchor());
        let explained = self.walls.explained(world_from_robot, f64::from(mode.log_likelihood), tiles);
        let evidence = evidence(before, explained, self.config.located_explained);
        let covariance = unpacked(mode.information).try_inverse().unwrap_or(cloud.covariance) + best_known(1.0);
        Place {
            world_from_robot,
            covariance,
            share: 1.0,
            weight: cloud.weight,
            concentrated: cloud.weight,
            explained,
            evidence,
        }
    }

    /// Takes a place for the estimate, and decides whether it can be relied on.
    pub(super) fn judge(&mut self, place: &Place, is_alone: bool) -> Located {
        self.best_evidence = place.evidence;
        let is_located =
            is_alone && self.is_expected(place.world_from_robot) && place.is_sure(self.config.located_explained);
        let confidence = Confidence { weight: place.concentrated, explained: place.explained, is_located };
        Located { world_from_robot: place.world_from_robot, covariance: place.covariance, confidence }
    }

    /// Whether the robot can have moved here since the last step. An estimate that jumps shows a wrong place that resembles the
    /// right one. In a map of inexact walls estimates jump everywhere, so the test is wider there.
    pub(super) fn is_expected(&self, world_from_robot: Pose) -> bool {
        let Some(last) = self.last else { return true };
        let times = (self.walls.sigma() / BEST_KNOWN.x).max(1.0);
        is_plausible(world_from_robot.seen_from(last.world_from_robot), &self.tracker.by_odometry(), best_known(times))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(share: f64, weight: f64, explained: f64) -> Place {
        let world_from_robot = Pose::IDENTITY;
        let covariance = Matrix3::zeros();
        Place { world_from_robot, covariance, share, weight, concentrated: weight, explained, evidence: 0.0 }
    }

    /// By hand: of equal shares the weights are as e⁰, e⁻², e⁻⁴ and e⁻⁴; the first two explain enough, the third lacks 0.1 of
    /// the scan, which can count for e⁻¹, the fourth all of what its weight says.
    #[test]
    fn a_place_that_is_explained_loses_no_weight() {
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
    fn evidence_accumulates_over_the_steps() {
        let enough = 0.6;
        let after = |steps: &[(u32, f64)]| {
            let all = steps.iter().flat_map(|&(times, explained)| std::iter::repeat_n(explained, times as usize));
            all.fold(0.0, |before, explained| evidence(before, explained, enough))
        };
        let is_sure = |steps| Place { evidence: after(steps), ..place(1.0, 1.0, 0.9) }.is_sure(enough);
        // A surplus of 0.3 a step: 1.5 after five of them.
        assert!(!is_sure(&[(4, 0.9)]) && is_sure(&[(6, 0.9)]));
        // Ten steps that lack 0.3 cost ten that have as much more.
        assert!(!is_sure(&[(10, 0.3), (14, 0.9)]) && is_sure(&[(10, 0.3), (16, 0.9)]));
        // A few bad scans do not undo it, and the evidence is bounded.
        assert!(
            is_sure(&[(100, 0.9), (4, 0.3)]) && !is_sure(&[(100, 0.9), (6, 0.3)]) && is_sure(&[(100, 0.0), (16, 0.9)])
        );
    }
}
