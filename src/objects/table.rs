//! A frame against the landmarks of one map.

use super::landmark::LEAST_CERTAIN;
use super::observation::{Detected, Observation};
use super::{Landmark, Objects};
use crate::association::{Policy, Table, Weights, associate, class_log_likelihood};
use crate::evaluator::sighting::{LandmarkRow, MOST_SEEN};
use crate::geometry::Pose;
use nalgebra::Point2;
use std::f64::consts::TAU;

/// Of what shows nothing of the map, the share that is new: see `objects`.
const NEW: f64 = 0.5;
/// A landmark may be seen this many standard deviations off.
const GATE: f64 = 6.0;

/// What a frame shows of a map.
pub(super) struct Associated {
    /// Numbers of the landmarks that it may show, or should.
    pub near: Vec<usize>,
    /// Which of them are surely in view.
    pub in_view: Vec<bool>,
    /// Weights of the pairs, a column for each of them.
    pub weights: Weights,
}

impl Objects {
    /// The landmarks that a frame may show, or should, from any pose within `distance` \[m\] of this one, as the evaluator takes
    /// them.
    pub fn rows(
        &self,
        landmarks: &[Landmark],
        observation: &Observation,
        robot: Point2<f64>,
        distance: f64,
        anchor: Point2<f64>,
    ) -> Vec<LandmarkRow> {
        let reach = observation.reach() + distance;
        let near = landmarks.iter().filter(|landmark| is_near(landmark, robot, reach));
        let row = |landmark: &Landmark| {
            let (position, covariance) = (landmark.position - anchor, landmark.covariance);
            let detected = self.detected(landmark);
            let mut log_label = [0.0; MOST_SEEN];
            for (log, Detected { label, .. }) in log_label.iter_mut().zip(&observation.detected) {
                *log = class_log_likelihood(&self.confusion, &landmark.classes, *label) as f32;
            }
            LandmarkRow {
                x: position.x as f32,
                y: position.y as f32,
                xx: covariance.m11 as f32,
                xy: covariance.m12 as f32,
                yy: covariance.m22 as f32,
                log_detected: detected.ln() as f32,
                log_missed: (-detected).ln_1p() as f32,
                padding: 0.0,
                log_label,
            }
        };
        near.map(row).collect()
    }

    /// Takes a frame into a map, seen from a pose. Returns ln p(S), as it was before.
    pub fn update(&self, landmarks: &mut Vec<Landmark>, observation: &Observation, world_from_robot: Pose) -> f64 {
        let detected: Vec<Detected> = observation.detected.iter().map(|seen| seen.moved(world_from_robot)).collect();
        let Associated { near, in_view, weights } =
            self.associated(landmarks, observation, world_from_robot, &detected);
        for (j, &number) in near.iter().enumerate() {
            let landmark = &mut landmarks[number];
            let of_landmark = weights.pairs.column(j);
            let (there, detectable) = (landmark.existence, self.detected(landmark));
            let missed = if in_view[j] { (there - detectable) / (1.0 - detectable) } else { there };
            landmark.confirm(of_landmark.sum(), missed);
            landmark.update(of_landmark.iter().copied().zip(&detected), &self.confusion);
        }
        landmarks.retain(|landmark| landmark.existence >= LEAST_CERTAIN);
        for (seen, &null) in detected.iter().zip(&weights.nulls).filter(|(_, null)| **null >= 0.5) {
            landmarks.push(Landmark::new(seen, null, NEW * null, &self.confusion));
        }
        weights.log_likelihood
    }

    /// The weights of a frame, whose detections are given as the world has them, over the landmarks of a map.
    pub(super) fn associated(
        &self,
        landmarks: &[Landmark],
        observation: &Observation,
        world_from_robot: Pose,
        detected: &[Detected],
    ) -> Associated {
        let reach = observation.reach();
        let is_near = |&j: &usize| is_near(&landmarks[j], world_from_robot.position(), reach);
        let near: Vec<usize> = (0..landmarks.len()).filter(is_near).collect();
        let is_in_view = |landmark: &Landmark| {
            let place = world_from_robot.inverse() * landmark.position;
            observation.horizon.holds(place.x as f32, place.y as f32)
        };
        let in_view: Vec<bool> = near.iter().map(|&j| is_in_view(&landmarks[j])).collect();
        let log_pair = |k: usize, j: usize| {
            let (seen, landmark) = (&detected[k], &landmarks[near[j]]);
            // Of one in view, the table itself counts that it was detected.
            let log_detected = if in_view[j] { 0.0 } else { self.detected(landmark).ln() };
            log_density(seen, landmark)
                + class_log_likelihood(&self.confusion, &landmark.classes, seen.label)
                + log_detected
        };
        let nulls = detected.iter().map(|seen| seen.log_null).collect();
        let table = Table::new(nulls, near.len(), log_pair)
            .with_missed(|j| in_view[j].then(|| self.detected(&landmarks[near[j]])));
        let weights = associate(&table, Policy::Soft);
        Associated { near, in_view, weights }
    }

    /// The probability that a landmark is there and is detected, where it is in view.
    fn detected(&self, landmark: &Landmark) -> f64 {
        self.sensors().detector.detection_probability * landmark.existence
    }
}

fn is_near(landmark: &Landmark, robot: Point2<f64>, reach: f64) -> bool {
    let spread = GATE * landmark.covariance.trace().sqrt() + 1.0;
    (landmark.position - robot).norm() <= reach + spread
}

/// ln N(z_k; l_j, R_k + Σ_j), per square metre.
fn log_density(seen: &Detected, landmark: &Landmark) -> f64 {
    let covariance = seen.covariance + landmark.covariance;
    let offset = seen.position - landmark.position.coords;
    let square = covariance.try_inverse().map_or(f64::INFINITY, |inverse| offset.dot(&(inverse * offset)));
    -0.5 * (square + covariance.determinant().ln()) - TAU.ln()
}
