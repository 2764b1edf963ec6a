//! E step (eq. 5): how likely each pair of a detection and a landmark is, given the estimate.

use super::estimate::{Estimate, Landmark, Pair};
use super::keyframes::Keyframe;
use super::sensor_model::SensorModel;
use crate::association::{Policy, Table, associate};
use crate::detections::Detection;
use crate::geometry::Pose;

/// A pair that is less likely than this is left out: it hardly moves anything, and takes as long as the others.
const MIN_WEIGHT: f64 = 0.02;
/// A pair this unlikely beside clutter \[nats\] is not weighed.
const MIN_ADVANTAGE: f64 = -12.0;

/// The terms of a keyframe: density and class of each pair, and clutter. Noise is `tempering` times as wide.
pub fn table(
    model: &SensorModel<'_>,
    pose: Pose,
    landmarks: &[Landmark],
    seen: &[(usize, Detection)],
    tempering: f64,
) -> Table {
    let clutter = model.log_density_of_any_label(model.sensors.detector.clutter_density);
    let predictions: Vec<_> = landmarks.iter().map(|landmark| model.predict(pose, landmark.position)).collect();
    Table::new(vec![clutter; seen.len()], landmarks.len(), |detection, landmark| {
        let seen = &seen[detection].1;
        let Some(prediction) = &predictions[landmark] else { return f64::NEG_INFINITY };
        let log = model.log_density(prediction.innovation(seen.range, seen.bearing), model.variances(seen), tempering)
            + model.class_log_likelihood(&landmarks[landmark].classes, seen.class);
        // What is far off splits the frame from the rest: so blocks stay small.
        if log < clutter + MIN_ADVANTAGE { f64::NEG_INFINITY } else { log }
    })
}

/// Weights of all pairs of all keyframes, and the classes that follow from them.
pub fn e_step(
    model: &SensorModel<'_>,
    keyframes: &[Keyframe],
    estimate: &mut Estimate,
    policy: Policy,
    tempering: f64,
) {
    let landmarks = &estimate.landmarks;
    estimate.weights = keyframes
        .iter()
        .zip(&estimate.poses)
        .map(|(keyframe, pose)| {
            if keyframe.seen.is_empty() || landmarks.is_empty() {
                return Vec::new();
            }
            let table = table(model, *pose, landmarks, &keyframe.seen, tempering);
            let weights = associate(&table, policy);
            let mut pairs = Vec::new();
            for detection in 0..keyframe.seen.len() {
                for landmark in 0..landmarks.len() {
                    let weight = weights.pairs[(detection, landmark)];
                    if weight >= MIN_WEIGHT {
                        pairs.push(Pair { detection, landmark, weight });
                    }
                }
            }
            if policy == Policy::MaxMixture {
                keep_likeliest(&mut pairs, &table);
            }
            pairs
        })
        .collect();
    class_posteriors(model, keyframes, estimate);
}

/// Of each detection, keeps the component of largest weight times density.
fn keep_likeliest(pairs: &mut Vec<Pair>, table: &Table) {
    let size = |pair: &Pair| pair.weight.ln() + table.pairs()[(pair.detection, pair.landmark)];
    let all = pairs.clone();
    pairs.retain(|pair| {
        all.iter().all(|other| {
            other.detection != pair.detection || other.landmark == pair.landmark || size(other) < size(pair)
        })
    });
    pairs.iter_mut().for_each(|pair| pair.weight = 1.0);
}

/// π_j(c) ∝ Π p(label | c)^w over the pairs of landmark j; and the sum of its weights.
pub fn class_posteriors(model: &SensorModel<'_>, keyframes: &[Keyframe], estimate: &mut Estimate) {
    let classes = model.classes();
    let mut logs = vec![vec![0.0; classes]; estimate.landmarks.len()];
    estimate.landmarks.iter_mut().for_each(|landmark| landmark.weight = 0.0);
    for (keyframe, pairs) in keyframes.iter().zip(&estimate.weights) {
        for pair in pairs {
            estimate.landmarks[pair.landmark].weight += pair.weight;
            let label = keyframe.seen[pair.detection].1.class;
            for (class, log) in logs[pair.landmark].iter_mut().enumerate() {
                *log += pair.weight * model.confusion(class, label).ln();
            }
        }
    }
    for (landmark, logs) in estimate.landmarks.iter_mut().zip(logs) {
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let shares: Vec<f64> = logs.iter().map(|log| (log - most).exp()).collect();
        let sum: f64 = shares.iter().sum();
        landmark.classes = shares.iter().map(|share| share / sum).collect();
    }
}
