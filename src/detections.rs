//! Detections of objects, with the robot's odometry: the input of semantic SLAM.
//!
//! A detection is an object of some class at a range and a bearing; its identity is not known. The detections
//! of one moment are a [`Frame`]. A [`Recording`] holds all frames, the odometry, and what is known about both
//! sensors.

pub use odometry::{Motion, Odometry, Velocity};
pub use sensors::{DetectionKind, DetectionNoise, Detector, OdometryNoise, Sensors, View};
pub use space::{Detection3, Detector3, Odometry3, OdometryNoise3, PixelNoise, Recording3, Sensors3, Velocity3};

use nalgebra::Point2;
use sensors::{even_confusion, validate_labels};

mod odometry;
mod sensors;
mod space;

/// An object, as a detector saw it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Number of the class that the detector names, in the list of [`Sensors::classes`].
    pub class: usize,
    /// How sure the detector is, 0 to 1.
    pub score: f64,
    /// Distance from the sensor \[m\], above 0.
    pub range: f64,
    /// Direction in the sensor's frame \[rad\], counter-clockwise from straight ahead, in (-π, π].
    pub bearing: f64,
}

impl Detection {
    /// Where the object is, in the sensor's frame \[m\].
    pub fn position(&self) -> Point2<f64> {
        let (sin, cos) = self.bearing.sin_cos();
        Point2::new(self.range * cos, self.range * sin)
    }
}

/// All detections of one moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame<D = Detection> {
    /// Seconds; the clock is that of the odometry.
    pub stamp: f64,
    /// Empty where the sensor worked and detected nothing.
    pub detections: Vec<D>,
}

impl Frame {
    /// The detections at places that the sensor can see by its own description, each with its number in the frame.
    pub fn in_view(&self, view: View) -> impl Iterator<Item = (usize, &Detection)> {
        self.detections.iter().enumerate().filter(move |(_, seen)| view.holds(seen.range, seen.bearing))
    }
}

/// Everything that was recorded in one drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The sensors and their noise.
    pub sensors: Sensors,
    /// What the wheels say, in the order of time.
    pub odometry: Odometry,
    /// What the detector saw; stamps rise strictly.
    pub frames: Vec<Frame>,
}

impl Recording {
    /// How many detections there are.
    pub fn detections(&self) -> usize {
        self.frames.iter().map(|frame| frame.detections.len()).sum()
    }
}
