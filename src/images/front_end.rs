//! Pictures in; odometry, detections and tracks out.

use super::{Detector, DetectorError, Keyframe, ObjectBox, Tracker, VisualOdometry};
use crate::detections::{Detection3, Frame, Odometry3, Recording3, Sensors3};
use crate::factor_graph::GraphError;
use crate::geometry::{Pose3, StampedPose3};
use crate::visual_inertial::{Feature, FeatureFrame};
use image::{DynamicImage, RgbImage};
use nalgebra::Point2;
use std::collections::BTreeMap;

/// Why pictures make no recording.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The detector fails.
    #[error(transparent)]
    Detector(#[from] DetectorError),
    /// The detector has no such class.
    #[error("the detector has no class `{class}`; its classes are {known}")]
    Class {
        /// What `sensors.toml` names.
        class: String,
        /// What there is.
        known: String,
    },
    /// The way of the camera has no solution.
    #[error("the way of the camera cannot be told from its pictures: {0}")]
    Way(#[from] GraphError),
    /// There is no way.
    #[error("the camera does not move: there are less than two keyframes")]
    Still,
}

/// What was found in a keyframe, for drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    /// All features; of those that were in the last keyframe, where they were there.
    pub features: Vec<(Point2<f64>, Option<Point2<f64>>)>,
    /// Objects of the classes of the sensors.
    pub boxes: Vec<ObjectBox>,
}

/// Takes the pictures of a drive one by one.
pub struct FrontEnd<'a> {
    sensors: Sensors3,
    detector: &'a Detector,
    /// The detector's numbers of the sensors' classes.
    classes: Vec<usize>,
    least_score: f64,
    tracker: Tracker,
    odometry: VisualOdometry,
    last: BTreeMap<u64, Point2<f64>>,
    tracks: Vec<FeatureFrame>,
    frames: Vec<Frame<Detection3>>,
}

impl<'a> FrontEnd<'a> {
    /// Objects of a lower score are left out.
    ///
    /// # Errors
    /// The detector lacks a class of the sensors.
    pub fn new(sensors: Sensors3, detector: &'a Detector, least_score: f64) -> Result<Self, ImageError> {
        let number = |class: &String| {
            let place = detector.labels().iter().skip(1).position(|label| label == class).map(|place| place + 1);
            let unknown = || ImageError::Class { class: class.clone(), known: detector.labels()[1..].join(", ") };
            place.ok_or_else(unknown)
        };
        let classes = sensors.classes.iter().map(number).collect::<Result<_, _>>()?;
        let camera = sensors.camera;
        Ok(Self {
            sensors,
            detector,
            classes,
            least_score,
            tracker: Tracker::new(camera),
            odometry: VisualOdometry::new(camera),
            last: BTreeMap::new(),
            tracks: Vec::new(),
            frames: Vec::new(),
        })
    }

    /// Takes the next picture, of this time \[s\]; none where it is no keyframe.
    ///
    /// # Errors
    /// The detector fails, or the way has no solution.
    pub fn add(&mut self, stamp: f64, picture: &RgbImage) -> Result<Option<Shown>, ImageError> {
        let grey = DynamicImage::ImageRgb8(picture.clone()).into_luma8();
        let Some(keyframe) = self.tracker.add(&grey) else { return Ok(None) };
        self.odometry.add(stamp, &keyframe)?;
        let boxes = self.detector.detect(picture, &self.classes, self.least_score)?;
        let (width, height) = picture.dimensions();
        let whole = boxes.iter().filter(|seen| !seen.is_cut(width, height));
        let detections = whole.filter_map(|seen| self.detection(seen)).collect();
        self.frames.push(Frame { stamp, detections });
        Ok(Some(self.show(stamp, keyframe, boxes)))
    }

    /// A box says how far an object is by its height.
    fn detection(&self, seen: &ObjectBox) -> Option<Detection3> {
        let class = self.classes.iter().position(|class| *class == seen.class)?;
        Some(Detection3 { class, score: seen.score, pixel: seen.centre(), disparity: seen.height() })
    }

    fn show(&mut self, stamp: f64, keyframe: Keyframe, boxes: Vec<ObjectBox>) -> Shown {
        let features = keyframe.features;
        let before = |&Feature { track, pixel }: &Feature| (pixel, self.last.get(&track).copied());
        let shown = Shown { features: features.iter().map(before).collect(), boxes };
        self.last = features.iter().map(|&Feature { track, pixel }| (track, pixel)).collect();
        self.tracks.push(FeatureFrame { stamp, features });
        shown
    }

    /// The recording, whose way is `length` metres long; and the tracks.
    ///
    /// # Errors
    /// The camera does not move, or its way has no solution.
    pub fn finish(mut self, length: f64) -> Result<(Recording3, Vec<FeatureFrame>), ImageError> {
        if self.odometry.path().len() < 2 {
            return Err(ImageError::Still);
        }
        self.odometry.finish()?;
        let path = self.odometry.path();
        let steps = path.windows(2).map(|ends| (ends[1].pose.position - ends[0].pose.position).norm());
        let scale = length / steps.sum::<f64>();
        let camera_from_robot = self.sensors.robot_from_camera.inverse();
        let scaled = |&StampedPose3 { stamp, pose }: &StampedPose3| {
            let camera = Pose3::new((pose.position.coords * scale).into(), pose.rotation);
            StampedPose3 { stamp, pose: self.sensors.robot_from_camera * camera * camera_from_robot }
        };
        let odometry = Odometry3::Poses(path.iter().map(scaled).collect());
        Ok((Recording3 { sensors: self.sensors, odometry, frames: self.frames }, self.tracks))
    }
}
