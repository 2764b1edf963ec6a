//! Semantic SLAM in a world that is known: twelve objects of three classes round a loop.

use super::normals;
use ipslam::detections::{Detection, Frame, Odometry, Recording, Sensors, Velocity, View};
use ipslam::geometry::{Pose, StampedPose};
use ipslam::metrics::trajectory::reference_errors;
use ipslam::semantic::{Plane, SemanticConfig, SemanticError, SemanticMap, Weight, map, map_known};
use nalgebra::Point2;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::sync::Mutex;

const RADIUS: f64 = 4.0;
const STEP: f64 = 0.5;
const SPEED: f64 = 0.4;

/// Three rounds of a circle; odometry tells 0.9 of the way and 0.9 of the turn, and every tenth label is wrong. And of each
/// detection the number of its object.
fn recording() -> (Recording, Vec<StampedPose>, Vec<Vec<Option<u64>>>) {
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
    let (mut frames, mut truth, mut ids) = (Vec::new(), Vec::new(), Vec::new());
    let mut labels = 0;
    for step in 0..count {
        let stamp = step as f64 * STEP;
        let angle = turn * stamp;
        let pose = Pose::new(RADIUS * angle.cos(), RADIUS * angle.sin(), angle + TAU / 4.0);
        truth.push(StampedPose { stamp, pose });
        let (mut detections, mut shown) = (Vec::new(), Vec::new());
        for (object, &(position, class)) in (0..).zip(&objects) {
            let seen = pose.inverse() * position;
            let (range, bearing) = (seen.coords.norm(), seen.y.atan2(seen.x));
            if sensors.view.holds(range, bearing) {
                labels += 1;
                let class = if labels % 10 == 0 { (class + 1) % 3 } else { class };
                let mut off = |sigma: f64| sigma * noise.next().unwrap_or(0.0);
                let (range, bearing) = (range + off(sensors.noise.range), bearing + off(sensors.noise.bearing));
                detections.push(Detection { class, score: 1.0, range, bearing });
                shown.push(Some(object));
            }
        }
        frames.push(Frame { stamp, detections });
        ids.push(shown);
    }
    let speed = Velocity { stamp: 0.0, forward: SPEED / 0.9, turn: turn / 0.9 };
    (Recording { sensors, odometry: Odometry::Velocities(vec![speed]), frames }, truth, ids)
}

fn rms(truth: &[StampedPose], trajectory: &[StampedPose]) -> f64 {
    reference_errors(truth, trajectory).absolute.unwrap().rmse
}

fn mapped() -> (Recording, Vec<StampedPose>, SemanticMap) {
    let (recording, truth, _) = recording();
    let config = SemanticConfig { beam: 8, ..SemanticConfig::default() };
    let found = map::<Plane>(&recording, &config, &|_| ()).unwrap();
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
    assert!(found.verdict.is_consistent(), "{:?}", found.verdict);
    // All that is in view is seen.
    assert!(found.detection_probability > 0.95, "{}", found.detection_probability);
    // The weights of a detection are probabilities.
    let mut sums = BTreeMap::new();
    for weight in &found.weights {
        *sums.entry((weight.frame, weight.detection)).or_insert(0.0) += weight.weight;
    }
    assert!(!sums.is_empty() && sums.values().all(|sum| *sum <= 1.0 + 1e-9));
    for landmark in &found.landmarks {
        assert!((landmark.classes.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        assert!(landmark.covariance.symmetric_eigenvalues().min() > 0.0);
    }
    assert!(found.keyframes.iter().all(|keyframe| keyframe.covariance.symmetric_eigenvalues().min() > 0.0));
    let again = mapped().2;
    assert_eq!((again.objective, again.keyframes), (found.objective, found.keyframes));
}

/// A window of half a round: the loop closes long after its start has left the window.
#[test]
fn a_loop_is_mapped_online() {
    let (recording, truth, _) = recording();
    let config = SemanticConfig { beam: 8, window: 60, ..SemanticConfig::default() };
    let found = map::<Plane>(&recording, &config, &|_| ()).unwrap();
    let rms = rms(&truth, &found.trajectory());
    assert_eq!((found.keyframes.len(), found.landmarks.len()), (truth.len(), 12), "{:?}", found.runs);
    assert!(rms < 0.15, "{rms} m");
    assert!(found.keyframes.iter().all(|keyframe| keyframe.covariance.symmetric_eigenvalues().min() > 0.0));
    // A pose depends on nothing that comes more than a window later.
    let mut half = recording.clone();
    half.frames.truncate(150);
    let half = map::<Plane>(&half, &config, &|_| ()).unwrap();
    let same = |count: usize| (0..count).all(|place| half.keyframes[place].pose == found.keyframes[place].pose);
    assert!(same(90) && !same(150));
}

#[test]
fn known_objects_are_mapped_as_they_are_known() {
    let (recording, truth, ids) = recording();
    let most = Mutex::new(0.0_f64);
    let told = |share: f64| {
        let mut most = most.lock().unwrap();
        *most = most.max(share);
    };
    let found = map_known::<Plane>(&recording, &ids, &SemanticConfig::default(), &told).unwrap();
    let rms = rms(&truth, &found.trajectory());
    assert!(rms < 0.1, "{rms} m");
    assert_eq!(found.landmarks.len(), 12);
    assert!(found.verdict.is_consistent(), "{:?}", found.verdict.doubts());
    // Landmark numbers follow the objects.
    let object = |weight: &Weight| ids[weight.frame][weight.detection].unwrap();
    let landmark_of: BTreeMap<u64, usize> =
        found.weights.iter().map(|weight| (object(weight), weight.landmark)).collect();
    assert_eq!(landmark_of.len(), 12);
    assert!(found.weights.iter().all(|weight| landmark_of[&object(weight)] == weight.landmark && weight.weight == 1.0));
    assert!((*most.lock().unwrap() - 1.0).abs() < 1e-12);

    // Detections of objects that nobody knows are left out.
    let unknown: Vec<_> = ids.iter().map(|frame| frame.iter().map(|id| id.filter(|id| *id != 3)).collect()).collect();
    let fewer = map_known::<Plane>(&recording, &unknown, &SemanticConfig::default(), &|_| ()).unwrap();
    assert_eq!(fewer.landmarks.len(), 11);
    assert!(fewer.detections < found.detections);
}

/// Where nobody says what the sensor sees, objects behind the robot are not taken for missed.
#[test]
fn a_view_that_is_not_described_is_learnt() {
    let (mut recording, _, ids) = recording();
    recording.sensors.view = View::default();
    let found = map_known::<Plane>(&recording, &ids, &SemanticConfig::default(), &|_| ()).unwrap();
    assert!(found.verdict.is_consistent() && found.detection_probability > 0.9, "{found:?}");
}

/// Whoever takes the objects of each round for new ones maps each three times, and sees only one of the three.
#[test]
fn a_place_that_is_mapped_twice_is_doubted() {
    let (recording, _, ids) = recording();
    let frames = ids.len();
    let by_round = |(frame, ids): (usize, Vec<Option<u64>>)| {
        ids.into_iter().map(|id| id.map(|id| id + 100 * (3 * frame / frames) as u64)).collect()
    };
    let ids: Vec<Vec<_>> = ids.into_iter().enumerate().map(by_round).collect();
    let found = map_known::<Plane>(&recording, &ids, &SemanticConfig::default(), &|_| ()).unwrap();
    assert_eq!(found.landmarks.len(), 36);
    let doubts = found.verdict.doubts();
    assert!(doubts.iter().any(|doubt| doubt.contains("a place may be mapped twice")), "{:?}", found.verdict);
}

#[test]
fn nothing_seen_is_told() {
    let (mut recording, ..) = recording();
    recording.frames.iter_mut().for_each(|frame| frame.detections.clear());
    assert!(matches!(map::<Plane>(&recording, &SemanticConfig::default(), &|_| ()), Err(SemanticError::NothingSeen)));
}
