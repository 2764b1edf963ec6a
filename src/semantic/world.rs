//! The plane and space: all that differs between them in this room.

use super::linear::Linear;
use crate::detections::{Detection, Detection3, Frame, Motion, Recording, Recording3, Sensors, Sensors3, View};
use crate::factor_graph::{
    Factor, Odometry, Odometry3, Prediction, RangeBearing, Stereo, StereoCamera, Value, VariableId,
};
use crate::geometry::{Pose, Pose3};
use nalgebra::{DMatrix, Matrix3, Point2, Point3, SMatrix, Vector3, Vector6};
use std::f64::consts::{PI, TAU};
use std::fmt::Debug;
use std::ops::Mul;

/// An object is in view for certain this far from the edges of the view \[standard deviations\].
const INSIDE: f64 = 3.0;
/// A sensor looks ahead, and not all round, if it saw nothing in so wide a sector to each side of straight behind \[rad\].
const OPEN: f64 = 0.5;
/// Standard deviations of forward scale, turn scale and curvature \[rad/m\]. Wheels and tracks that were never measured are off by
/// about a tenth, and pull to one side by a few degrees a metre.
const CALIBRATION_SIGMAS: [f64; 3] = [0.1, 0.1, 0.05];
/// The view that densities of new landmarks are meant for \[m rad\]: six metres far, and two radians wide.
const USUAL_VIEW: f64 = 12.0;

/// A covariance of a few numbers.
pub trait Square: Copy + Debug + PartialEq + Send + Sync {
    /// That of a matrix of this size.
    fn of(matrix: &DMatrix<f64>) -> Self;
    /// All entries, column by column.
    fn entries(&self) -> &[f64];
}

impl<const N: usize> Square for SMatrix<f64, N, N> {
    fn of(matrix: &DMatrix<f64>) -> Self {
        Self::from_column_slice(matrix.as_slice())
    }

    fn entries(&self) -> &[f64] {
        self.as_slice()
    }
}

/// Calibrated odometry: where it leads, and its derivatives.
pub struct Moved<P> {
    /// The end, seen from the start.
    pub pose: P,
    /// The end's step by that of the start.
    pub by_pose: DMatrix<f64>,
    /// The end's step by the calibration.
    pub by_calibration: DMatrix<f64>,
}

/// The stamp of a frame \[s\], and the detections in view with their numbers in the frame.
pub type Seen<D> = (f64, Vec<(usize, D)>);

impl<P> Moved<P> {
    fn new<const N: usize, const C: usize>(
        pose: P,
        by_pose: SMatrix<f64, N, N>,
        by_calibration: SMatrix<f64, N, C>,
    ) -> Self {
        let matrix = |columns, entries: &[f64]| DMatrix::from_column_slice(N, columns, entries);
        Self { pose, by_pose: matrix(N, by_pose.as_slice()), by_calibration: matrix(C, by_calibration.as_slice()) }
    }
}

/// Where a robot moves and how it senses: [`Plane`] or [`Space`].
pub trait World: Copy + Debug + PartialEq + Send + Sync + 'static {
    /// What was recorded.
    type Recording: Sync;
    /// What is known about the sensors.
    type Sensors: Sync + Debug;
    /// What a detector says.
    type Detection: Copy + Debug + Send + Sync;
    /// The numbers that a detection measures, and a landmark's coordinates: as many.
    type Numbers: Copy + Debug + AsRef<[f64]> + AsMut<[f64]> + Send + Sync;
    /// The numbers of the odometry's calibration.
    type Calibration: Copy + Debug + PartialEq + AsRef<[f64]> + AsMut<[f64]> + Send + Sync;
    /// `world_from_robot`.
    type Pose: Copy + Debug + PartialEq + Send + Sync + Mul<Output = Self::Pose> + Value;
    /// A landmark's position \[m\].
    type Point: Copy + Debug + PartialEq + Send + Sync + Value + Into<Self::Numbers> + From<Self::Numbers>;
    /// Covariance of a pose, by its step: translation \[m\], then rotation \[rad\].
    type PoseCovariance: Square;
    /// Covariance of a landmark's position \[m²\].
    type PointCovariance: Square;
    /// A landmark as it would be seen.
    type Prediction: Linear<Numbers = Self::Numbers>;

    /// Degrees of freedom of a pose.
    const POSE: usize;
    /// Coordinates of a landmark.
    const POINT: usize;
    /// The calibration of odometry that tells the truth.
    const CALIBRATED: Self::Calibration;
    /// ln of the largest value of the density whose negative logarithm is the loss, at unit variances.
    const LOG_PEAK: f64;

    /// Names of the classes, and p(label | class), a row for each class.
    fn labels(sensors: &Self::Sensors) -> (&[String], &[Vec<f64>]);
    /// The probability that an object in view is detected, by the description.
    fn detection_probability(sensors: &Self::Sensors) -> f64;
    /// The sensors of a recording.
    fn sensors(recording: &Self::Recording) -> &Self::Sensors;
    /// All frames.
    fn frames(recording: &Self::Recording) -> Vec<Seen<Self::Detection>>;
    /// The motion between two stamps, by odometry.
    fn motion(recording: &Self::Recording, from: f64, to: f64) -> Motion<Self::Pose>;
    /// The least and the largest of each number that a detection can have. Where the description leaves that open, nothing was
    /// seen beyond the outermost detections.
    fn view(recording: &Self::Recording) -> [Self::Numbers; 2];
    /// How far a detection typically errs \[m\].
    fn error(recording: &Self::Recording) -> f64;
    /// The density of false detections.
    fn clutter_density(recording: &Self::Recording) -> f64;
    /// The density of new landmarks is this many times that of the plane.
    fn new_density(recording: &Self::Recording) -> f64;
    /// Standard deviations of the odometry's calibration before anything was seen.
    fn calibration_sigmas(sensors: &Self::Sensors) -> Self::Calibration;

    /// The class that the detector names.
    fn label(seen: &Self::Detection) -> usize;
    /// Standard deviations of a detection's numbers, where it is about as near as this one.
    fn sigmas(sensors: &Self::Sensors, numbers: Self::Numbers) -> Self::Numbers;
    /// A detection's numbers.
    fn numbers(seen: &Self::Detection) -> Self::Numbers;
    /// A landmark as seen from a pose; none where it cannot be.
    fn predict(sensors: &Self::Sensors, pose: Self::Pose, point: Self::Point) -> Option<Self::Prediction>;
    /// Measured less predicted.
    fn innovation(prediction: &Self::Prediction, seen: &Self::Detection) -> Self::Numbers;
    /// Where the object of a detection is.
    fn position(sensors: &Self::Sensors, pose: Self::Pose, seen: &Self::Detection) -> Self::Point;
    /// Whether an object of which these numbers are predicted would be in view for certain.
    fn is_in_view(sensors: &Self::Sensors, view: [Self::Numbers; 2], numbers: Self::Numbers) -> bool;

    /// The pose of the first keyframe.
    fn origin() -> Self::Pose;
    /// pose · exp(step).
    fn step(pose: Self::Pose, step: &[f64]) -> Self::Pose;
    /// log(from⁻¹ · to).
    fn difference(from: Self::Pose, to: Self::Pose) -> Vec<f64>;
    /// How far two poses are apart \[m\], and how far turned \[rad\].
    fn apart(one: Self::Pose, other: Self::Pose) -> (f64, f64);
    /// All numbers of a pose.
    fn coordinates(pose: Self::Pose) -> Vec<f64>;
    /// Calibrated odometry.
    fn moved(motion: &Motion<Self::Pose>, calibration: Self::Calibration) -> Moved<Self::Pose>;
    /// Variances of a motion's end, in its own frame.
    fn motion_variances(sensors: &Self::Sensors, motion: &Motion<Self::Pose>) -> Vec<f64>;

    /// The factor of a motion between two poses.
    fn motion_factor(
        ends: [VariableId; 2],
        calibration: VariableId,
        motion: &Motion<Self::Pose>,
    ) -> impl Factor + 'static;
    /// The factor of a detection, of a landmark from a pose.
    fn detection_factor(
        sensors: &Self::Sensors,
        pose: VariableId,
        landmark: VariableId,
        seen: &Self::Detection,
    ) -> impl Factor + 'static;
}

/// A robot of the plane, whose detector tells range and bearing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane;

impl World for Plane {
    type Recording = Recording;
    type Sensors = Sensors;
    type Detection = Detection;
    type Numbers = [f64; 2];
    type Calibration = [f64; 3];
    type Pose = Pose;
    type Point = Point2<f64>;
    type PoseCovariance = SMatrix<f64, 3, 3>;
    type PointCovariance = SMatrix<f64, 2, 2>;
    type Prediction = Prediction<3, 2>;

    const POSE: usize = 3;
    const POINT: usize = 2;
    /// Forward scale, turn scale, curvature \[rad/m\].
    const CALIBRATED: [f64; 3] = Odometry::CALIBRATED;
    /// (1 - 2/c²) / (2π): Student's distribution of the plane.
    const LOG_PEAK: f64 = -2.089_191_494_690_252;

    fn labels(sensors: &Sensors) -> (&[String], &[Vec<f64>]) {
        (&sensors.classes, &sensors.confusion)
    }

    fn detection_probability(sensors: &Sensors) -> f64 {
        sensors.detector.detection_probability
    }

    fn sensors(recording: &Recording) -> &Sensors {
        &recording.sensors
    }

    fn frames(recording: &Recording) -> Vec<Seen<Detection>> {
        let in_view =
            |frame: &Frame| frame.in_view(recording.sensors.view).map(|(number, seen)| (number, *seen)).collect();
        recording.frames.iter().map(|frame| (frame.stamp, in_view(frame))).collect()
    }

    fn motion(recording: &Recording, from: f64, to: f64) -> Motion {
        recording.odometry.motion(from, to)
    }

    fn view(recording: &Recording) -> [[f64; 2]; 2] {
        let mut view = recording.sensors.view;
        let seen = || recording.frames.iter().flat_map(|frame| frame.in_view(recording.sensors.view));
        if view.max_range == f64::INFINITY {
            view.max_range = seen().map(|(_, seen)| seen.range).fold(0.0, f64::max);
        }
        if view.min_bearing <= -PI && view.max_bearing >= PI {
            let most = seen().map(|(_, seen)| seen.bearing.abs()).fold(0.0, f64::max);
            if most < PI - OPEN {
                (view.min_bearing, view.max_bearing) = (-most, most);
            }
        }
        let View { min_range, max_range, min_bearing, max_bearing } = view;
        [[min_range, min_bearing], [max_range, max_bearing]]
    }

    fn error(recording: &Recording) -> f64 {
        let noise = recording.sensors.noise;
        noise.range.hypot(noise.position)
    }

    fn clutter_density(recording: &Recording) -> f64 {
        recording.sensors.detector.clutter_density
    }

    fn new_density(_: &Recording) -> f64 {
        1.0
    }

    fn calibration_sigmas(_: &Sensors) -> [f64; 3] {
        CALIBRATION_SIGMAS
    }

    fn label(seen: &Detection) -> usize {
        seen.class
    }

    fn sigmas(sensors: &Sensors, [range, _]: [f64; 2]) -> [f64; 2] {
        sensors.noise.at(range)
    }

    fn numbers(seen: &Detection) -> [f64; 2] {
        [seen.range, seen.bearing]
    }

    fn predict(sensors: &Sensors, pose: Pose, point: Point2<f64>) -> Option<Prediction<3, 2>> {
        let prediction = RangeBearing::predict(pose, point, sensors.robot_from_sensor);
        (prediction.mean.x >= 1e-6).then_some(prediction)
    }

    fn innovation(prediction: &Prediction<3, 2>, seen: &Detection) -> [f64; 2] {
        prediction.innovation(seen.range, seen.bearing).into()
    }

    fn position(sensors: &Sensors, pose: Pose, seen: &Detection) -> Point2<f64> {
        pose * (sensors.robot_from_sensor * seen.position())
    }

    fn is_in_view(sensors: &Sensors, view: [[f64; 2]; 2], [range, bearing]: [f64; 2]) -> bool {
        let [[min_range, min_bearing], [max_range, max_bearing]] = view;
        let [range_sigma, bearing_sigma] = sensors.noise.at(range).map(|sigma| INSIDE * sigma);
        let sees_all_round = max_bearing - min_bearing >= TAU - 1e-9;
        let bearings = min_bearing + bearing_sigma..=max_bearing - bearing_sigma;
        (min_range..=max_range - range_sigma).contains(&range) && (sees_all_round || bearings.contains(&bearing))
    }

    fn origin() -> Pose {
        Pose::IDENTITY
    }

    fn step(pose: Pose, step: &[f64]) -> Pose {
        pose * Pose::exp(Vector3::from_column_slice(step))
    }

    fn difference(from: Pose, to: Pose) -> Vec<f64> {
        to.seen_from(from).log().as_slice().to_vec()
    }

    fn apart(one: Pose, other: Pose) -> (f64, f64) {
        let off = one.seen_from(other);
        (off.position().coords.norm(), off.heading.abs())
    }

    fn coordinates(Pose { x, y, heading }: Pose) -> Vec<f64> {
        vec![x, y, heading]
    }

    fn moved(motion: &Motion, calibration: [f64; 3]) -> Moved<Pose> {
        let (twist, by_calibration) = Odometry::calibrated(motion.start_from_end.log(), calibration.into());
        let pose = Pose::exp(twist);
        let by_calibration = Pose::exp_jacobian(twist) * by_calibration;
        Moved::new(pose, pose.inverse().adjoint(), by_calibration)
    }

    fn motion_variances(sensors: &Sensors, motion: &Motion) -> Vec<f64> {
        sensors.odometry.variances(motion).to_vec()
    }

    fn motion_factor(ends: [VariableId; 2], calibration: VariableId, motion: &Motion) -> impl Factor + 'static {
        Odometry::new(ends[0], ends[1], calibration, motion.start_from_end)
    }

    fn detection_factor(
        sensors: &Sensors,
        pose: VariableId,
        landmark: VariableId,
        seen: &Detection,
    ) -> impl Factor + 'static {
        RangeBearing::new(pose, landmark, seen.range, seen.bearing).from_sensor(sensors.robot_from_sensor)
    }
}

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
