//! Whether a map is consistent with the data, judged without ground truth.
//!
//! A map with a wrong association fits its detections nearly as well as the right one. It is recognised by missed detections:
//! where a robot returns to a place and maps it a second time, the objects of the first map are in view and are not detected.

use super::estimate::Estimate;
use super::keyframes::Keyframe;
use super::sensor_model::{SensorModel, squared_errors};
use super::world::World;
use serde::Serialize;

/// A visit is long if this number of detections of the object is expected in it: the probability of none is e⁻⁵, less than a
/// hundredth.
const LONG_VISIT: f64 = 5.0;

/// A map is doubted if a smaller share of the detections shows its objects.
const LEAST_EXPLAINED: f64 = 0.8;
/// A map is doubted if its objects are not detected in a larger share of the time of long visits. Chance accounts for a
/// hundredth, occlusion for some more.
const MOST_UNSEEN: f64 = 0.1;
/// A map is doubted if its mean squared errors are larger than this many times the variances of the sensors.
const MOST_ERROR: f64 = 2.0;
/// A calibration is doubted beyond this many standard deviations, which 0.3 % exceed.
const MOST_CALIBRATION: f64 = 3.0;

/// Evidence for and against a map.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// Share of the detections that show an object of the map rather than clutter.
    pub explained: f64,
    /// Of the time that objects were in view for long, the share in which they were not seen at all; `None` if no object
    /// was in view for long.
    pub unseen: Option<f64>,
    /// Mean squared error of the detections per number, in their variances; errors of more than three standard deviations
    /// count as three. 0.9 would be expected where they are normal.
    pub detection_error: f64,
    /// Mean squared error of the odometry per number, in its variances, after calibration. At most one is expected: the path
    /// fits it.
    pub odometry_error: f64,
    /// The largest change that calibration makes \[standard deviations of its prior\].
    pub calibration: f64,
    /// The number of other runs that found the same path, within three standard deviations of each position; `None` if there
    /// was no other run.
    pub agreeing_runs: Option<usize>,
}

impl Verdict {
    /// Looks at an estimate.
    pub(super) fn new<W: World>(
        model: &SensorModel<'_, W>,
        keyframes: &[Keyframe<W>],
        estimate: &Estimate<W>,
        agreeing_runs: Option<usize>,
    ) -> Self {
        let (explained, detection_error) = detections(model, keyframes, estimate);
        let steps = keyframes.len().saturating_sub(1).max(1);
        Self {
            explained,
            unseen: unseen(model, keyframes, estimate),
            detection_error,
            odometry_error: 2.0 * estimate.odometry_cost(model, keyframes) / (W::POSE * steps) as f64,
            calibration: estimate.calibrated_by(model).map(f64::abs).fold(0.0, f64::max),
            agreeing_runs,
        }
    }

    /// Reasons to doubt the map, one sentence each; empty if it is consistent.
    pub fn doubts(&self) -> Vec<String> {
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        let mut doubts = Vec::new();
        if self.explained < LEAST_EXPLAINED {
            let explained = percent(self.explained);
            doubts.push(format!("only {explained} of the detections show an object of the map"));
        }
        if let Some(unseen) = self.unseen.filter(|unseen| *unseen > MOST_UNSEEN) {
            let unseen = percent(unseen);
            doubts.push(format!("objects were not seen in {unseen} of the time that they were in view for long: a place may be mapped twice, if nothing stood in front of them"));
        }
        if self.detection_error > MOST_ERROR {
            let times = self.detection_error.sqrt();
            doubts.push(format!("detections err {times:.1} times as much as [noise] of sensors.toml says"));
        }
        if self.odometry_error > MOST_ERROR {
            let times = self.odometry_error.sqrt();
            doubts.push(format!("odometry errs {times:.1} times as much as [odometry] of sensors.toml says"));
        }
        if self.calibration > MOST_CALIBRATION {
            let sigmas = self.calibration;
            doubts.push(format!("odometry would have to be calibrated by {sigmas:.1} standard deviations"));
        }
        if self.agreeing_runs == Some(0) {
            doubts.push("no run with another density of new landmarks came to the same path".to_owned());
        }
        doubts
    }

    /// Whether there is no reason to doubt the map.
    pub fn is_consistent(&self) -> bool {
        self.doubts().is_empty()
    }
}

/// The share of detections that are explained, and the mean squared error of a number.
fn detections<W: World>(model: &SensorModel<'_, W>, keyframes: &[Keyframe<W>], estimate: &Estimate<W>) -> (f64, f64) {
    let (mut explained, mut squared, mut sum) = (0.0, 0.0, 0.0);
    for ((keyframe, pose), pairs) in keyframes.iter().zip(&estimate.poses).zip(&estimate.weights) {
        for pair in pairs {
            explained += pair.weight;
            let seen = &keyframe.seen[pair.detection].1;
            if let Some(prediction) = model.predict(*pose, estimate.landmarks[pair.landmark].position) {
                let (errors, variances) = (squared_errors::<W>(&prediction, seen), model.variances(seen));
                let errors = errors.as_ref().iter().zip(variances.as_ref());
                squared += pair.weight * errors.map(|(error, variance)| (error / variance).min(9.0)).sum::<f64>();
                sum += W::POINT as f64 * pair.weight;
            }
        }
    }
    let all: usize = keyframes.iter().map(|keyframe| keyframe.seen.len()).sum();
    (explained / all.max(1) as f64, if sum > 0.0 { squared / sum } else { 0.0 })
}

/// Successive frames in which an object is in view.
#[derive(Clone, Copy, Default)]
struct Visit {
    frames: f64,
    /// Sum of the weights of its detections.
    seen: f64,
}

/// The share of the long visits' frames that are of visits without a detection.
fn unseen<W: World>(model: &SensorModel<'_, W>, keyframes: &[Keyframe<W>], estimate: &Estimate<W>) -> Option<f64> {
    let mut visits = Vec::new();
    let mut open = vec![Visit::default(); estimate.landmarks.len()];
    for ((keyframe, pose), pairs) in keyframes.iter().zip(&estimate.poses).zip(&estimate.weights) {
        if keyframe.frame.is_none() {
            continue;
        }
        for (place, (landmark, visit)) in estimate.landmarks.iter().zip(&mut open).enumerate() {
            let prediction = model.predict(*pose, landmark.position);
            if prediction.is_some_and(|prediction| model.is_in_view(&prediction)) {
                visit.frames += 1.0;
                let of_landmark = pairs.iter().filter(|pair| pair.landmark == place);
                visit.seen += of_landmark.map(|pair| pair.weight).sum::<f64>();
            } else {
                visits.push(std::mem::take(visit));
            }
        }
    }
    visits.extend(open);
    // Detection rate of an object in the visits that detect it.
    let is_seen = |visit: &&Visit| visit.seen >= 0.5;
    let sum = |value: fn(&Visit) -> f64| visits.iter().filter(is_seen).map(value).sum::<f64>();
    let rate = sum(|visit| visit.seen) / sum(|visit| visit.frames);
    let long = || visits.iter().filter(|visit| visit.frames * rate >= LONG_VISIT);
    let all: f64 = long().map(|visit| visit.frames).sum();
    let unseen: f64 = long().filter(|visit| !is_seen(visit)).map(|visit| visit.frames).sum();
    (all > 0.0).then(|| unseen / all)
}
