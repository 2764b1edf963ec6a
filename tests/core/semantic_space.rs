//! Semantic SLAM in space, in a world that is known: a camera that climbs and dips on its way round twelve objects.

use super::normals;
use ipslam::detections::{Detection3, Frame, Odometry3, PixelNoise, Recording3, Sensors3, Velocity3};
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

/// A street: every 15 m a car is parked on either side of it, and one car drives ahead, a little faster.
/// The oracle is written out here: boxes of cars 1.5 m high. And of each detection whether its car moves.
fn street() -> (Recording3, Vec<Vec<bool>>) {
    const HEIGHT: f64 = 1.5;
    let mut sensors = Sensors3::new(vec!["car".to_owned()], 1.0, CAMERA, HEIGHT);
    sensors.noise = PixelNoise { u: 2.0, v: 2.0, disparity: 1.0, share: 0.05 };
    let parked: Vec<[f64; 2]> =
        (0..24).map(|car| [if car % 2 == 0 { -4.0 } else { 4.0 }, 15.0 * f64::from(car / 2)]).collect();
    let mut noise = normals(9);
    let (mut frames, mut moves, mut speeds) = (Vec::new(), Vec::new(), Vec::new());
    for step in 0..120 {
        let stamp = 0.1 * f64::from(step);
        let way = 10.0 * stamp;
        let ahead = [[0.5, 15.0 + 10.5 * stamp]];
        let cars = parked.iter().map(|car| (*car, false)).chain(ahead.map(|car| (car, true)));
        let (mut detections, mut of_frame) = (Vec::new(), Vec::new());
        for ([x, z], is_moving) in cars {
            let ahead = z - way;
            let [u, v] = [400.0 * x / ahead + 320.0, 410.0 / ahead + 240.0];
            if (5.0..40.0).contains(&ahead) && (0.0..640.0).contains(&u) {
                let height = 400.0 * HEIGHT / ahead;
                let mut errs = |sigma: f64| sigma.hypot(0.05 * height) * noise.next().unwrap();
                let (pixel, disparity) = ([u + errs(2.0), v + errs(2.0)], height + errs(1.0));
                detections.push(Detection3 { class: 0, score: 1.0, pixel, disparity });
                of_frame.push(is_moving);
            }
        }
        frames.push(Frame { stamp, detections });
        moves.push(of_frame);
        speeds.push(Velocity3 { stamp, linear: Vector3::new(0.0, 0.0, 10.0), angular: Vector3::zeros() });
    }
    (Recording3 { sensors, odometry: Odometry3::Velocities(speeds), frames }, moves)
}

/// Where cars may move, those that do are left out, and those that stand are mapped; where not, rows of cars are mapped.
#[test]
fn cars_that_move_are_no_landmarks() {
    let (mut recording, moves) = street();
    let all: SemanticMap<Space> = map(&recording, &config(), &|_| ()).unwrap();
    recording.sensors.movable = vec![0];
    let found: SemanticMap<Space> = map(&recording, &config(), &|_| ()).unwrap();
    let moving = moves.iter().flatten().filter(|moves| **moves).count();
    let right = found.moving.iter().filter(|(frame, detection)| moves[*frame][*detection]).count();
    let wrong = found.moving.len() - right;
    assert!(moving == 120 && right * 100 > moving * 95, "{right} of {moving} detections of moving cars are left out");
    assert!(wrong <= 5, "{wrong} detections of parked cars are left out");
    assert!(all.moving.is_empty() && all.landmarks.len() > found.landmarks.len() + 5);
    assert!((18..=24).contains(&found.landmarks.len()), "{} landmarks", found.landmarks.len());
}

/// The first pose is turned anyhow; upright, heights are those of the world.
#[test]
fn an_upright_map_has_the_heights_of_the_world() {
    let (recording, truth, _) = recording();
    let found: SemanticMap<Space> = map(&recording, &config(), &|_| ()).unwrap();
    let start = truth[0].pose.position.z;
    let upright = found.upright(&recording.sensors);
    let off = |map: &SemanticMap<Space>| {
        let heights = map.keyframes.iter().zip(&truth);
        heights
            .map(|(mapped, truth)| (mapped.pose.position.z + start - truth.pose.position.z).abs())
            .fold(0.0, f64::max)
    };
    // Up is found by where path and objects extend least, which is not quite the vertical.
    assert!(off(&upright) < 0.3 && off(&found) > 1.0, "{} m, before {} m", off(&upright), off(&found));
    assert!((rms(&truth, &upright.trajectory3()) - rms(&truth, &found.trajectory3())).abs() < 1e-9);
}
