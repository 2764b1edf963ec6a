//! A robot of space.

use super::{INSIDE, Moved, Seen, World};
use crate::detections::{Detection3, Frame, Motion, Recording3, Sensors3};
use crate::factor_graph::{Factor, Odometry3, Prediction, Stereo, StereoCamera, VariableId};
use crate::geometry::Pose3;
use nalgebra::{Matrix3, Point3, SMatrix, Vector3, Vector6};

/// The view that densities of new landmarks are meant for \[m rad\]: six metres far, and two radians wide.
const USUAL_VIEW: f64 = 12.0;

/// A robot of space, whose camera also tells how far an object is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Space;

impl World for Space {
    type Recording = Recording3;
    type Sensors = Sensors3;
    type Detection = Detection3;
    type Numbers = [f64; 3];
    type Calibration = [f64; 2];
    type Pose = Pose3;
    type Point = Point3<f64>;
    type PoseCovariance = SMatrix<f64, 6, 6>;
    type PointCovariance = SMatrix<f64, 3, 3>;
    type Prediction = Prediction<6, 3>;

    const POSE: usize = 6;
    const POINT: usize = 3;
    /// Scale and turn scale.
    const CALIBRATED: [f64; 2] = Odometry3::CALIBRATED;
    /// Γ(c²/2) / Γ(c²/2 - 3/2) / (π c²)^(3/2): Student's distribution of space.
    const LOG_PEAK: f64 = -3.252_342_304_495_932_5;

    fn labels(sensors: &Sensors3) -> (&[String], &[Vec<f64>]) {
        (&sensors.classes, &sensors.confusion)
    }

    fn movable(sensors: &Sensors3) -> &[usize] {
        &sensors.movable
    }

    fn detection_probability(sensors: &Sensors3) -> f64 {
        sensors.detector.detection_probability
    }

    fn sensors(recording: &Recording3) -> &Sensors3 {
        &recording.sensors
    }

    fn frames(recording: &Recording3) -> Vec<Seen<Detection3>> {
        let all = |frame: &Frame<Detection3>| frame.detections.iter().copied().enumerate().collect();
        recording.frames.iter().map(|frame| (frame.stamp, all(frame))).collect()
    }

    fn motion(recording: &Recording3, from: f64, to: f64) -> Motion<Pose3> {
        recording.odometry.motion(from, to)
    }

    fn view(recording: &Recording3) -> [[f64; 3]; 2] {
        let mut view = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for seen in recording.frames.iter().flat_map(|frame| &frame.detections) {
            for (axis, number) in Self::numbers(seen).into_iter().enumerate() {
                view[0][axis] = view[0][axis].min(number);
                view[1][axis] = view[1][axis].max(number);
            }
        }
        view
    }

    fn error(recording: &Recording3) -> f64 {
        let sensors = &recording.sensors;
        let error = |seen: &Detection3| {
            let depth = sensors.depth(seen);
            let [u, v, disparity] = sensors.noise.at(seen.disparity);
            let across = u.max(v) / sensors.camera.focal[0];
            depth * across.max(disparity / seen.disparity)
        };
        let mut errors: Vec<f64> = recording.frames.iter().flat_map(|frame| &frame.detections).map(error).collect();
        errors.sort_by(f64::total_cmp);
        errors.get(errors.len() / 2).copied().unwrap_or(0.0)
    }

    fn clutter_density(recording: &Recording3) -> f64 {
        recording.sensors.detector.clutter / volume(recording)
    }

    fn new_density(recording: &Recording3) -> f64 {
        USUAL_VIEW / volume(recording)
    }

    fn calibration_sigmas(sensors: &Sensors3) -> [f64; 2] {
        [sensors.odometry.scale, sensors.odometry.turn_scale]
    }

    fn label(seen: &Detection3) -> usize {
        seen.class
    }

    fn sigmas(sensors: &Sensors3, numbers: [f64; 3]) -> [f64; 3] {
        sensors.noise.at(numbers[2])
    }

    fn numbers(seen: &Detection3) -> [f64; 3] {
        [seen.pixel[0], seen.pixel[1], seen.disparity]
    }

    fn predict(sensors: &Sensors3, pose: Pose3, point: Point3<f64>) -> Option<Prediction<6, 3>> {
        stereo_camera(sensors).predict(pose, point)
    }

    fn innovation(prediction: &Prediction<6, 3>, seen: &Detection3) -> [f64; 3] {
        (Vector3::from(Self::numbers(seen)) - prediction.mean).into()
    }

    fn position(sensors: &Sensors3, pose: Pose3, seen: &Detection3) -> Point3<f64> {
        pose * sensors.position(seen)
    }

    fn is_in_view(sensors: &Sensors3, [least, most]: [[f64; 3]; 2], numbers: [f64; 3]) -> bool {
        let margins = sensors.noise.at(numbers[2]).map(|sigma| INSIDE * sigma);
        (0..3).all(|axis| (least[axis] + margins[axis]..=most[axis] - margins[axis]).contains(&numbers[axis]))
    }

    fn origin() -> Pose3 {
        Pose3::identity()
    }

    fn step(pose: Pose3, step: &[f64]) -> Pose3 {
        pose * Pose3::exp(Vector6::from_column_slice(step))
    }

    fn difference(from: Pose3, to: Pose3) -> Vec<f64> {
        to.seen_from(from).log().as_slice().to_vec()
    }

    fn apart(one: Pose3, other: Pose3) -> (f64, f64) {
        let off = one.seen_from(other);
        (off.position.coords.norm(), off.rotation.angle())
    }

    fn coordinates(Pose3 { position, rotation }: Pose3) -> Vec<f64> {
        position.iter().chain(rotation.coords.iter()).copied().collect()
    }

    fn moved(motion: &Motion<Pose3>, calibration: [f64; 2]) -> Moved<Pose3> {
        let (twist, by_calibration) = Odometry3::calibrated(motion.start_from_end.log(), calibration);
        let pose = Pose3::exp(twist);
        let by_calibration = Pose3::exp_jacobian(twist) * by_calibration;
        Moved::new(pose, pose.inverse().adjoint(), by_calibration)
    }

    fn motion_variances(sensors: &Sensors3, motion: &Motion<Pose3>) -> Vec<f64> {
        sensors.odometry.variances(motion).to_vec()
    }

    fn motion_factor(ends: [VariableId; 2], calibration: VariableId, motion: &Motion<Pose3>) -> impl Factor + 'static {
        Odometry3::new(ends[0], ends[1], calibration, motion.start_from_end)
    }

    fn detection_factor(
        sensors: &Sensors3,
        pose: VariableId,
        landmark: VariableId,
        seen: &Detection3,
    ) -> impl Factor + 'static {
        Stereo::new(pose, landmark, Self::numbers(seen).into(), stereo_camera(sensors))
    }
}

fn stereo_camera(sensors: &Sensors3) -> StereoCamera {
    let Sensors3 { camera, baseline, reach, robot_from_camera, .. } = *sensors;
    StereoCamera { pinhole: camera, baseline, reach, robot_from_camera }
}

/// How much room detections take in the picture \[pixels³\]: that of the box in which they would be spread evenly, with the same
/// covariance. False detections and new objects are where detections are, and not in the sky.
fn volume(recording: &Recording3) -> f64 {
    let seen =
        || recording.frames.iter().flat_map(|frame| &frame.detections).map(|seen| Vector3::from(Space::numbers(seen)));
    let count = seen().count().max(1) as f64;
    let mean = seen().sum::<Vector3<f64>>() / count;
    let covariance: Matrix3<f64> =
        seen().map(|seen| (seen - mean) * (seen - mean).transpose()).sum::<Matrix3<f64>>() / count;
    // Of a flat one, as if it were a pixel thick.
    let variances = covariance.symmetric_eigenvalues();
    variances.iter().map(|variance| (12.0 * variance).max(1.0).sqrt()).product()
}
