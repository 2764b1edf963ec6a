//! E step (eq. 5): how likely each pair of a detection and a landmark is, given the estimate.

use super::estimate::{Estimate, Landmark, Pair};
use super::hypothesis::Hypothesis;
use super::keyframes::Keyframe;
use super::sensor_model::SensorModel;
use super::world::World;
use crate::association::{Policy, Table, associate};

/// Pairs of smaller weight are left out: they have hardly any effect and cost as much as the others.
const MIN_WEIGHT: f64 = 0.02;
/// Pairs whose log-density is this far below that of clutter \[nats\] get no weight.
const MIN_ADVANTAGE: f64 = -12.0;
/// Prior weight of the described detection probability \[times in view\].
const DESCRIBED: f64 = 10.0;

/// The terms of a keyframe: density and class of each pair, clutter, and the landmarks in view that were missed. Noise is
/// `tempering` times as wide.
pub fn table<W: World>(
    model: &SensorModel<'_, W>,
    pose: W::Pose,
    landmarks: &[Landmark<W>],
    seen: &[(usize, W::Detection)],
    detection_probability: f64,
    tempering: f64,
) -> Table {
    let clutter = model.log_clutter();
    let predictions: Vec<_> = landmarks.iter().map(|landmark| model.predict(pose, landmark.position)).collect();
    Table::new(vec![clutter; seen.len()], landmarks.len(), |detection, landmark| {
        let seen = &seen[detection].1;
        let Some(prediction) = &predictions[landmark] else { return f64::NEG_INFINITY };
        let density = model.log_density(prediction, seen, tempering);
        // What is far off splits the frame from the rest: so blocks stay small.
        let is_far = |log: f64| log < clutter + MIN_ADVANTAGE;
        if is_far(density) {
            return f64::NEG_INFINITY;
        }
        let log = density + model.class_log_likelihood(&landmarks[landmark].classes, W::label(seen));
        if is_far(log) { f64::NEG_INFINITY } else { log }
    })
    .with_missed(|place| {
        let prediction = predictions[place].as_ref()?;
        model.is_in_view(prediction).then_some(detection_probability)
    })
}

/// Weights of all pairs of all keyframes, and the classes that follow from them.
pub fn e_step<W: World>(
    model: &SensorModel<'_, W>,
    keyframes: &[Keyframe<W>],
    estimate: &mut Estimate<W>,
    policy: Policy,
    tempering: f64,
    before: Option<&Hypothesis<W>>,
) {
    let landmarks = &estimate.landmarks;
    estimate.weights = keyframes
        .iter()
        .zip(&estimate.poses)
        .map(|(keyframe, pose)| {
            if keyframe.seen.is_empty() || landmarks.is_empty() {
                return Vec::new();
            }
            let table = table(model, *pose, landmarks, &keyframe.seen, estimate.detection_probability, tempering);
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
    class_posteriors(model, keyframes, estimate, before);
    estimate.detection_probability = detection_probability(model, keyframes, estimate);
}

/// How often a landmark in view is detected. What the sensors' description says counts as much as [`DESCRIBED`] times in view:
/// it is a guess, and what hides an object is not of the detector.
pub fn detection_probability<W: World>(
    model: &SensorModel<'_, W>,
    keyframes: &[Keyframe<W>],
    estimate: &Estimate<W>,
) -> f64 {
    let described = model.detection_probability();
    let (mut detected, mut in_view) = (DESCRIBED * described, DESCRIBED);
    for ((keyframe, pose), pairs) in keyframes.iter().zip(&estimate.poses).zip(&estimate.weights) {
        if keyframe.seen.is_empty() {
            continue;
        }
        let is_in_view = |landmark: &Landmark<W>| {
            model.predict(*pose, landmark.position).is_some_and(|prediction| model.is_in_view(&prediction))
        };
        let visible: Vec<bool> = estimate.landmarks.iter().map(is_in_view).collect();
        in_view += visible.iter().filter(|visible| **visible).count() as f64;
        detected += pairs.iter().filter(|pair| visible[pair.landmark]).map(|pair| pair.weight).sum::<f64>();
    }
    detected / in_view
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

/// π_j(c) ∝ Π p(label | c)^w over the pairs of landmark j; and the sum of its weights. Both start from the state
/// `before` the keyframes.
pub fn class_posteriors<W: World>(
    model: &SensorModel<'_, W>,
    keyframes: &[Keyframe<W>],
    estimate: &mut Estimate<W>,
    before: Option<&Hypothesis<W>>,
) {
    let classes = model.classes();
    let mut logs = vec![vec![0.0; classes]; estimate.landmarks.len()];
    for ((landmark, logs), number) in estimate.landmarks.iter_mut().zip(&mut logs).zip(&estimate.numbers) {
        landmark.weight = 0.0;
        if let Some(place) = before.and_then(|before| before.place(*number))
            && let Some(known) = before.and_then(|before| before.landmarks.get(place))
        {
            landmark.weight = known.sightings as f64;
            logs.iter_mut().zip(&known.classes).for_each(|(log, share)| *log = share.ln());
        }
    }
    for (keyframe, pairs) in keyframes.iter().zip(&estimate.weights) {
        for pair in pairs {
            estimate.landmarks[pair.landmark].weight += pair.weight;
            let label = W::label(&keyframe.seen[pair.detection].1);
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
