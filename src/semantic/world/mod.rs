//! The plane and space: all that differs between them in this room.

use super::linear::Linear;
use crate::detections::Motion;
use crate::factor_graph::{Factor, Value, VariableId};
use nalgebra::{DMatrix, SMatrix};
use std::fmt::Debug;
use std::ops::Mul;

mod plane;
mod space;

pub use plane::Plane;
pub use space::Space;

/// An object is in view for certain this far from the edges of the view \[standard deviations\].
const INSIDE: f64 = 3.0;

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

/// The stamp of a frame \[s\], and the detections in view with their numbers in the frame.
pub type Seen<D> = (f64, Vec<(usize, D)>);

/// Where a robot moves and how it senses: [`Plane`] or [`Space`].
pub trait World: Copy + Debug + PartialEq + Send + Sync + 'static {
    /// What was recorded.
    type Recording: Sync + Debug;
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
    /// Numbers of the classes whose objects may move.
    fn movable(sensors: &Self::Sensors) -> &[usize];
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
