//! What is estimated from: features of pictures, and inertial readings beside them.

use crate::geometry::{Pinhole, Pose3};
use crate::inertial::{ImuNoise, ImuReading};
use nalgebra::Point2;

/// A feature in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feature {
    /// Names the track: features of one number, in different pictures, show the same point.
    pub track: u64,
    /// Where it is, without the lens's distortion \[pixels of the camera\].
    pub pixel: Point2<f64>,
}

/// All features of one picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FeatureFrame {
    /// Seconds; the clock is that of the inertial sensor.
    pub stamp: f64,
    /// Each track once.
    pub features: Vec<Feature>,
}

/// A camera on a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// How it sees points.
    pub pinhole: Pinhole,
    /// Where it is mounted, as seen from the inertial sensor.
    pub body_from_camera: Pose3,
    /// Standard deviation of a feature's place, in each direction \[pixels of the camera\].
    pub noise: f64,
}

/// Everything that was recorded on one way.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The camera that saw the features.
    pub camera: Camera,
    /// Noise of the inertial sensor.
    pub imu_noise: ImuNoise,
    /// Readings of the inertial sensor; stamps rise strictly.
    pub imu: Vec<ImuReading>,
    /// Features; stamps rise strictly.
    pub frames: Vec<FeatureFrame>,
}
