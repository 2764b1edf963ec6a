//! A camera with an inertial sensor, on a way that is known.

use crate::normals;
use ipslam::geometry::{Pinhole, Pose3, StampedPose3};
use ipslam::inertial::{GRAVITY, ImuBias, ImuNoise, ImuReading};
use ipslam::metrics::space::space_errors;
use ipslam::visual_inertial::{Camera, Feature, FeatureFrame, Recording, Rest, VisualInertialError, estimate};
use nalgebra::{Matrix3, Point2, Point3, Rotation3, UnitQuaternion, Vector3};

/// The body rests so long [s].
const REST: f64 = 2.0;
const END: f64 = 12.0;
const READING: f64 = 0.005;

/// Where the body is: still at first, then in loops among the points.
fn pose(stamp: f64) -> Pose3 {
    let t = (stamp - REST).max(0.0);
    let position = Point3::new(
        0.5 * (1.1 * t).sin() - 0.55 * t * (-t).exp(),
        0.4 - 0.4 * (0.8 * t).cos(),
        0.1 * t * (1.0 - (-t).exp()),
    );
    let turn = Vector3::new(0.2 * (0.9 * t).sin(), 0.1 - 0.1 * (1.3 * t).cos(), 0.4 - 0.4 * (0.7 * t).cos());
    let tilt = UnitQuaternion::from_scaled_axis(Vector3::new(0.1, -0.2, 0.0));
    Pose3::new(position, UnitQuaternion::from_scaled_axis(turn) * tilt)
}

fn velocity(stamp: f64) -> Vector3<f64> {
    const STEP: f64 = 1e-5;
    if stamp < REST { Vector3::zeros() } else { (pose(stamp + STEP).position - pose(stamp).position) / STEP }
}

fn bias() -> ImuBias {
    ImuBias { rate: Vector3::new(0.02, -0.03, 0.05), force: Vector3::new(0.1, -0.05, 0.08) }
}

fn readings(noise: &ImuNoise) -> Vec<ImuReading> {
    let mut normal = normals(1);
    let mut noisy = |density: f64| Vector3::from_fn(|_, _| density / READING.sqrt() * normal.next().unwrap());
    let reading = |step: u32| {
        let (stamp, next) = (READING * f64::from(step), READING * f64::from(step + 1));
        let (now, bias) = (pose(stamp), bias());
        let rate = (now.rotation.inverse() * pose(next).rotation).scaled_axis() / READING;
        let force = now.rotation.inverse() * ((velocity(next) - velocity(stamp)) / READING - GRAVITY);
        ImuReading { stamp, rate: rate + bias.rate + noisy(noise.rate), force: force + bias.force + noisy(noise.force) }
    };
    (0..(END / READING) as u32 + 1).map(reading).collect()
}

/// What the camera sees, with an error of one pixel; one feature in thirty is somewhere else.
fn frames(camera: &Camera) -> Vec<FeatureFrame> {
    let mut normal = normals(2);
    let mut draw = || normal.next().unwrap();
    let points: Vec<Point3<f64>> = (0..120).map(|_| Point3::new(5.0 + draw(), 3.0 * draw(), 2.0 * draw())).collect();
    let mut frame = |step: u32| {
        let stamp = 0.1 * f64::from(step);
        let camera_from_world = (pose(stamp) * camera.body_from_camera).inverse();
        let mut features = Vec::new();
        for (number, point) in points.iter().enumerate() {
            let Some((pixel, _)) = camera.pinhole.project((camera_from_world * *point).coords) else { continue };
            let gross = if (number + 7 * step as usize).is_multiple_of(30) { 80.0 } else { 1.0 };
            let pixel = Point2::new(pixel.x + gross * draw(), pixel.y + gross * draw());
            // A track is lost every two or three seconds.
            let track = 1000 * (u64::from(step) / (20 + number as u64 % 10)) + number as u64;
            if (0.0..640.0).contains(&pixel.x) && (0.0..480.0).contains(&pixel.y) {
                features.push(Feature { track, pixel });
            }
        }
        FeatureFrame { stamp, features }
    };
    (0..(END / 0.1) as u32).map(&mut frame).collect()
}

fn recording() -> Recording {
    let axes = Rotation3::from_matrix_unchecked(Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0));
    let body_from_camera = Pose3::new(Point3::new(0.05, -0.02, 0.1), UnitQuaternion::from_rotation_matrix(&axes));
    let pinhole = Pinhole { focal: [450.0, 450.0], centre: [320.0, 240.0] };
    let camera = Camera { pinhole, body_from_camera, noise: 1.0 };
    let imu_noise = ImuNoise::default();
    Recording { camera, imu_noise, imu: readings(&imu_noise), frames: frames(&camera) }
}

/// The greatest errors: of positions after alignment [m], of orientations as seen from the first one [rad], and of what is
/// up [rad].
fn errors(recording: &Recording) -> [f64; 3] {
    let estimate = estimate(recording).unwrap();
    let stamps = || recording.frames.iter().map(|frame| frame.stamp);
    let truth: Vec<_> = stamps().map(|stamp| StampedPose3 { stamp, pose: pose(stamp) }).collect();
    let found = estimate.trajectory(recording, stamps());
    assert_eq!(found.len(), truth.len());
    let first = found[0].pose.rotation * truth[0].pose.rotation.inverse();
    let (mut turned, mut tilted) = (0.0_f64, 0.0_f64);
    for (found, truth) in found.iter().zip(&truth) {
        let (found, truth) = (found.pose.rotation, truth.pose.rotation);
        turned = turned.max(found.angle_to(&(first * truth)));
        tilted = tilted.max((found.inverse() * Vector3::z()).angle(&(truth.inverse() * Vector3::z())));
    }
    [space_errors(&truth, &found).unwrap().position.max, turned, tilted]
}

#[test]
fn a_known_way_is_found() {
    let mut recording = recording();
    let [position, turned, tilted] = errors(&recording);
    assert!(position < 0.03 && turned < 0.005 && tilted < 0.005, "{position} m, {turned} rad, {tilted} rad");
    let last = *estimate(&recording).unwrap().states.last().unwrap();
    let wrong = last.bias.to_vector() - bias().to_vector();
    assert!(wrong.fixed_rows::<3>(0).norm() < 1e-3 && wrong.fixed_rows::<3>(3).norm() < 0.03, "{wrong}");
    // Without the camera the way is lost, so that it is the camera that finds it.
    recording.frames.iter_mut().for_each(|frame| frame.features.clear());
    let [position, ..] = errors(&recording);
    assert!(position > 0.3, "{position} m without a camera");
}

#[test]
fn rest_tells_the_bias_and_what_is_up() {
    let mut recording = recording();
    let rest = Rest::at_start(&recording.imu).unwrap();
    assert!((rest.end - REST).abs() < 1e-9, "{rest:?}");
    assert!((rest.bias.rate - bias().rate).norm() < 1e-3, "{rest:?}");
    let (found, expected) =
        (rest.world_from_body.inverse() * Vector3::z(), pose(0.0).rotation.inverse() * Vector3::z());
    // The accelerometer's bias makes it wrong by a hundredth.
    assert!((found - expected).norm() < 0.02, "{found} {expected}");
    recording.imu.retain(|reading| reading.stamp > REST - 0.4);
    assert_eq!(Rest::at_start(&recording.imu), None);
    assert_eq!(estimate(&recording).unwrap_err(), VisualInertialError::NoRest);
}

#[test]
fn what_cannot_be_is_an_error() {
    let whole = recording();
    let mut nothing = whole.clone();
    nothing.frames.truncate(1);
    assert_eq!(estimate(&nothing).unwrap_err(), VisualInertialError::Empty);
    nothing.imu.clear();
    assert_eq!(estimate(&nothing).unwrap_err(), VisualInertialError::NoRest);
    let mut gap = whole.clone();
    gap.imu.retain(|reading| !(5.001..5.299).contains(&reading.stamp));
    let error = estimate(&gap).unwrap_err();
    assert!(matches!(error, VisualInertialError::Gap { from, to } if from >= 5.0 && to <= 5.3), "{error}");
    let mut nan = whole;
    nan.frames[30].features[0].pixel.x = f64::NAN;
    assert!(matches!(estimate(&nan), Err(VisualInertialError::Graph(_))));
}
