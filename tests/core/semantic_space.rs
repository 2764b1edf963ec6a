//! Semantic SLAM in space, in a world that is known: a camera that climbs and dips on its way round twelve objects.

use super::normals;
use ipslam::detections::{Detection3, Frame, Odometry3, Recording3, Sensors3, Velocity3};
use ipslam::geometry::{Pinhole, Pose3, StampedPose3};
use ipslam::metrics::space::space_errors;
use ipslam::semantic::{SemanticConfig, SemanticMap, Space, map, map_known};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

const STEP: f64 = 0.5;
const ROUND: f64 = 40.0;
const BASELINE: f64 = 0.3;
const CAMERA: Pinhole = Pinhole { focal: [400.0, 410.0], centre: [320.0, 240.0] };

/// Where the camera is: on a circle of 3 m, up and down by 0.5 m, and looking past the middle.
fn true_pose(stamp: f64) -> Pose3 {
    let angle = TAU * stamp / ROUND;
    let position = Vector3::new(3.0 * angle.cos(), 3.0 * angle.sin(), 0.5 * (3.0 * angle).sin());
    let ahead = (Vector3::new(0.5 * angle.sin(), -0.4, 0.1) - position).normalize();
    let rotation = UnitQuaternion::face_towards(&ahead, &-Vector3::z());
    Pose3::new(position.into(), rotation)
}

/// Two rounds; odometry tells 0.93 of the way and 0.95 of the turn, and every tenth label is wrong. And of each detection the
/// number of its object. The oracle is written out here: similar triangles.
fn recording() -> (Recording3, Vec<StampedPose3>, Vec<Vec<Option<u64>>>) {
    let names = ["cup", "lamp", "book"].map(str::to_owned).to_vec();
    let mut sensors = Sensors3::new(names, 0.9, CAMERA, BASELINE);
    sensors.robot_from_camera =
        Pose3::new(Point3::new(0.1, -0.05, 0.02), UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3));
    let objects: Vec<(Point3<f64>, usize)> = (0..12)
        .map(|object| {
            let (angle, number) = (TAU * f64::from(object) / 12.0, f64::from(object));
            let radius = if object % 2 == 0 { 1.5 } else { 0.6 };
            (Point3::new(radius * angle.cos(), radius * angle.sin(), 0.4 * (2.0 * number).sin()), object as usize % 3)
        })
        .collect();
    let robot = |stamp: f64| true_pose(stamp) * sensors.robot_from_camera.inverse();
    let count = (2.0 * ROUND / STEP) as usize;
    let mut noise = normals(5);
    let (mut frames, mut truth, mut ids, mut speeds) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut labels = 0;
    for step in 0..count {
        let stamp = step as f64 * STEP;
        let camera = true_pose(stamp);
        truth.push(StampedPose3 { stamp, pose: robot(stamp) });
        let (mut detections, mut shown) = (Vec::new(), Vec::new());
        for (object, &(position, class)) in (0..).zip(&objects) {
            let seen = camera.rotation.inverse() * (position - camera.position);
            let exact = [400.0 * seen.x / seen.z + 320.0, 410.0 * seen.y / seen.z + 240.0, 400.0 * BASELINE / seen.z];
            if seen.z > 0.3 && (0.0..640.0).contains(&exact[0]) && (0.0..480.0).contains(&exact[1]) {
                labels += 1;
                let class = if labels % 10 == 0 { (class + 1) % 3 } else { class };
                let [u, v, disparity] = exact.map(|exact| exact + 2.0 * noise.next().unwrap());
                detections.push(Detection3 { class, score: 1.0, pixel: [u, v], disparity });
                shown.push(Some(object));
            }
        }
        frames.push(Frame { stamp, detections });
        ids.push(shown);
        let twist = robot(stamp + STEP).seen_from(robot(stamp)).log() / STEP;
        let [linear, angular] = [0, 3].map(|first| twist.fixed_rows::<3>(first).into_owned());
        speeds.push(Velocity3 { stamp, linear: linear / 0.93, angular: angular / 0.95 });
    }
    (Recording3 { sensors, odometry: Odometry3::Velocities(speeds), frames }, truth, ids)
}

fn rms(truth: &[StampedPose3], trajectory: &[StampedPose3]) -> f64 {
    space_errors(truth, trajectory).unwrap().position.rmse
}

fn config() -> SemanticConfig {
    SemanticConfig { beam: 8, ..SemanticConfig::default() }
}

#[test]
fn objects_of_space_are_mapped() {
    let (recording, truth, ids) = recording();
    let reckoned = recording.odometry.dead_reckoning(truth.iter().map(|pose| pose.stamp));
    let found: SemanticMap<Space> = map(&recording, &config(), &|_| ()).unwrap();
    let (alone, mapped) = (rms(&truth, &reckoned), rms(&truth, &found.trajectory3()));
    assert!(alone > 0.3 && mapped < 0.03, "odometry alone {alone} m, mapped {mapped} m");
    assert_eq!(found.landmarks.len(), 12, "{:?}", found.runs);
    let [scale, turn_scale] = found.calibration;
    assert!((scale - 0.93).abs() < 0.01 && (turn_scale - 0.95).abs() < 0.01, "{:?}", found.calibration);
    assert!(found.verdict.is_consistent(), "{:?}", found.verdict.doubts());
    // All weight of an object is on one landmark.
    let mut landmark_of = BTreeMap::new();
    for weight in found.weights.iter().filter(|weight| weight.weight > 0.5) {
        let object = ids[weight.frame][weight.detection];
        assert_eq!(*landmark_of.entry(object).or_insert(weight.landmark), weight.landmark, "{weight:?}");
    }
    assert_eq!(landmark_of.len(), 12);
    assert!(found.keyframes.iter().all(|keyframe| keyframe.covariance.symmetric_eigenvalues().min() > 0.0));
}

/// The oracle of the errors: as many squared standard deviations as there are numbers.
#[test]
fn known_objects_of_space_are_mapped_as_well_as_is_said() {
    let (recording, truth, ids) = recording();
    let found: SemanticMap<Space> = map_known(&recording, &ids, &config(), &|_| ()).unwrap();
    assert!(rms(&truth, &found.trajectory3()) < 0.03);
    let start = truth[0].pose;
    let (mut squared, mut numbers) = (0.0, 0);
    for (mapped, truth) in found.keyframes.iter().zip(&truth).skip(20).step_by(20) {
        let error = truth.pose.seen_from(start).seen_from(mapped.pose).log();
        squared += (mapped.covariance.try_inverse().unwrap() * error).dot(&error);
        numbers += 6;
    }
    // Neighbours share their errors: so wide a range is left to chance.
    let ratio = squared / f64::from(numbers);
    assert!((0.3..3.0).contains(&ratio), "{ratio}");
}

#[test]
fn nothing_seen_is_told() {
    let (mut recording, ..) = recording();
    recording.frames.iter_mut().for_each(|frame| frame.detections.clear());
    assert!(map::<Space>(&recording, &config(), &|_| ()).is_err());
}
