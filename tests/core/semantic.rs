//! Semantic SLAM in a world that is known: twelve objects of three classes round a loop.

use super::normals;
use ipslam::detections::{Detection, Frame, Odometry, Recording, Sensors, Velocity, View};
use ipslam::geometry::{Pose, StampedPose};
use ipslam::metrics::trajectory::reference_errors;
use ipslam::semantic::{SemanticConfig, SemanticError, SemanticMap, map};
use nalgebra::Point2;
use std::f64::consts::TAU;

const RADIUS: f64 = 4.0;
const STEP: f64 = 0.5;
const SPEED: f64 = 0.4;

/// Three rounds of a circle; odometry tells 0.9 of the way and 0.9 of the turn, and every tenth label is wrong.
fn recording() -> (Recording, Vec<StampedPose>) {
    let names = ["tree", "car", "door"].map(str::to_owned).to_vec();
    let mut sensors = Sensors::new(names, 0.9);
    sensors.view = View { max_range: 6.0, min_bearing: -1.2, max_bearing: 1.2, ..View::default() };
    let objects: Vec<(Point2<f64>, usize)> = (0..12)
        .map(|object| {
            let (sin, cos) = (TAU * f64::from(object) / 12.0).sin_cos();
            let radius = if object % 2 == 0 { 5.5 } else { 2.5 };
            (Point2::new(radius * cos, radius * sin), object as usize % 3)
        })
        .collect();
    let turn = SPEED / RADIUS;
    let count = (3.0 * TAU / (turn * STEP)) as usize;
    let mut noise = normals(7);
    let (mut frames, mut truth) = (Vec::new(), Vec::new());
    let mut labels = 0;
    for step in 0..count {
        let stamp = step as f64 * STEP;
        let angle = turn * stamp;
        let pose = Pose::new(RADIUS * angle.cos(), RADIUS * angle.sin(), angle + TAU / 4.0);
        truth.push(StampedPose { stamp, pose });
        let mut detections = Vec::new();
        for &(position, class) in &objects {
            let seen = pose.inverse() * position;
            let (range, bearing) = (seen.coords.norm(), seen.y.atan2(seen.x));
            if sensors.view.holds(range, bearing) {
                labels += 1;
                let class = if labels % 10 == 0 { (class + 1) % 3 } else { class };
                let mut off = |sigma: f64| sigma * noise.next().unwrap_or(0.0);
                let (range, bearing) = (range + off(sensors.noise.range), bearing + off(sensors.noise.bearing));
                detections.push(Detection { class, score: 1.0, range, bearing });
            }
        }
        frames.push(Frame { stamp, detections });
    }
    let speed = Velocity { stamp: 0.0, forward: SPEED / 0.9, turn: turn / 0.9 };
    (Recording { sensors, odometry: Odometry::Velocities(vec![speed]), frames }, truth)
}

fn rms(truth: &[StampedPose], trajectory: &[StampedPose]) -> f64 {
    reference_errors(truth, trajectory).absolute.unwrap().rmse
}

fn mapped() -> (Recording, Vec<StampedPose>, SemanticMap) {
    let (recording, truth) = recording();
    let config = SemanticConfig { beam: 8, ..SemanticConfig::default() };
    let found = map(&recording, &config, &|_| ()).unwrap();
    (recording, truth, found)
}

#[test]
fn a_loop_is_mapped_that_odometry_alone_misses() {
    let (recording, truth, found) = mapped();
    let reckoned = recording.odometry.dead_reckoning(truth.iter().map(|pose| pose.stamp));
    let (alone, rms) = (rms(&truth, &reckoned), rms(&truth, &found.trajectory()));
    assert!(alone > 0.5 && rms < 0.1, "odometry alone {alone} m, mapped {rms} m");
    assert_eq!(found.landmarks.len(), 12, "{:?}", found.runs);
    let [forward, turn, curvature] = found.calibration;
    // On a circle only the sum of both turns is known.
    let turned = turn + curvature * RADIUS;
    assert!((forward - 0.9).abs() < 0.05 && (turned - 0.9).abs() < 0.05, "{:?}", found.calibration);
    // The weights of a detection are probabilities.
    let mut sums = std::collections::BTreeMap::new();
    for weight in &found.weights {
        *sums.entry((weight.frame, weight.detection)).or_insert(0.0) += weight.weight;
    }
    assert!(!sums.is_empty() && sums.values().all(|sum| *sum <= 1.0 + 1e-9));
    for landmark in &found.landmarks {
        assert!((landmark.classes.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        assert!(landmark.covariance.symmetric_eigenvalues().min() > 0.0);
    }
    let again = mapped().2;
    assert_eq!((again.objective, again.keyframes), (found.objective, found.keyframes));
}

#[test]
fn nothing_seen_is_told() {
    let (mut recording, _) = recording();
    recording.frames.iter_mut().for_each(|frame| frame.detections.clear());
    assert!(matches!(map(&recording, &SemanticConfig::default(), &|_| ()), Err(SemanticError::NothingSeen)));
}
