//! The office of TUM RGB-D, `freiburg3_long_office_household`: a camera is carried by hand round two desks (Sturm et al., "A
//! Benchmark for the Evaluation of RGB-D SLAM Systems", IROS 2012).
//!
//! `detections.csv` has the boxes that a detector drew in the pictures, `frames.csv` the stamps of all pictures, `groundtruth.txt`
//! the true poses of the camera. A set of boxes has no odometry: it is the true way with the drift that [`super::kitti_odometry`]
//! simulates, so this set is semi-synthetic, too. Only what stands upright has a height in the picture; keyboards, books and
//! what is only seen in part, such as chairs, are left out. Heights were measured in this drive: with them, places that boxes tell
//! from different sides agree best.

use super::kitti_odometry::odometry;
use super::kitti_tracking::odometry_noise;
use super::{Converted3, Options};
use crate::detections::{Detection3, Detector3, Frame, Odometry3, PixelNoise, Recording3, Sensors3};
use crate::geometry::{Pinhole, StampedPose3};
use crate::io::table::{Layout, read_table};
use crate::io::tum;
use crate::log::LogError;
use crate::parameters::ConfigError;
use std::path::Path;

const EXPECTED: &str = "a table of this set has other columns";
/// The camera after rectification, and the size of its pictures \[pixels\].
const CAMERA: Pinhole = Pinhole { focal: [535.4, 539.2], centre: [320.1, 247.6] };
const PICTURE: [f64; 2] = [640.0, 480.0];
/// A box this near to the edge of the picture shows a part of an object \[pixels\].
const EDGE: f64 = 3.0;
/// Boxes of a lower score are left out.
const LEAST_SCORE: f64 = 0.5;
/// Number of a class in COCO, its name, and how high such objects are \[m\].
const CLASSES: [(u32, &str, f64); 5] =
    [(39, "bottle", 0.30), (41, "cup", 0.135), (62, "screen", 0.48), (64, "mouse", 0.07), (77, "teddy bear", 0.55)];
/// The height that the `disparity` of every class is for \[m\].
const HEIGHT: f64 = 0.3;
/// Standard deviation of heights, as a share: that of the bear, of which there is one.
const HEIGHT_ERROR: f64 = 0.2;

pub(super) fn read(folder: &Path, options: &Options) -> Result<Converted3, super::ConvertError> {
    if let Some(wrong) = options.wrong_labels {
        return Err(ConfigError::value("--wrong-labels", wrong, "left out, as a detector made the labels").into());
    }
    let truth = Odometry3::Poses(tum::read3(&folder.join("groundtruth.txt"))?);
    let mut frames = read_stamps(&folder.join("frames.csv"))?;
    // In the frame of the first picture.
    let trajectory: Vec<StampedPose3> = truth.dead_reckoning(frames.iter().map(|frame| frame.stamp));
    let cut = read_boxes(&folder.join("detections.csv"), &mut frames)?;
    let classes = CLASSES.iter().map(|(_, name, _)| (*name).to_owned()).collect();
    let mut sensors = Sensors3::new(classes, 0.9, CAMERA, HEIGHT);
    sensors.noise = PixelNoise { u: 3.0, v: 3.0, disparity: 2.0, share: HEIGHT_ERROR };
    sensors.detector = Detector3 { detection_probability: 0.6, clutter: 0.1 };
    // As it was simulated.
    sensors.odometry = odometry_noise();
    Ok(Converted3 {
        ids: frames.iter().map(|frame| vec![None; frame.detections.len()]).collect(),
        recording: Recording3 { sensors, odometry: odometry(&trajectory, options.seed.unwrap_or(1)), frames },
        landmarks: Vec::new(),
        trajectory,
        notes: vec![
            "semi-synthetic: boxes are of a detector, and odometry is the true way with simulated drift".to_owned(),
            format!(
                "{cut} boxes are not in it: at the edge of the picture, of a low score, or of classes without a height"
            ),
        ],
    })
}

fn read_stamps(path: &Path) -> Result<Vec<Frame<Detection3>>, LogError> {
    const STAMPS: Layout = Layout { required: &["t_s"], optional: &[] };
    let mut frames: Vec<Frame<Detection3>> = Vec::new();
    read_table(path, &[STAMPS], EXPECTED, |_, row| {
        frames.push(Frame { stamp: row.number(0)?, detections: Vec::new() });
        Ok(())
    })?;
    Ok(frames)
}

/// Gives frames their boxes; returns how many are left out.
fn read_boxes(path: &Path, frames: &mut [Frame<Detection3>]) -> Result<usize, LogError> {
    const BOXES: Layout = Layout { required: &["t_s", "class_coco80", "x", "y", "w", "h", "score"], optional: &[] };
    let mut cut = 0;
    read_table(path, &[BOXES], EXPECTED, |_, row| {
        let (stamp, label): (f64, u32) = (row.number(0)?, row.count(1)?);
        let place = frames.partition_point(|frame| frame.stamp < stamp - 1e-3);
        let frame = frames.get_mut(place).filter(|frame| frame.stamp <= stamp + 1e-3);
        let frame = frame.ok_or_else(|| format!("there is no picture of {stamp} s in frames.csv"))?;
        let [x, y, width, height] = [row.number(2)?, row.number(3)?, row.number(4)?, row.number(5)?];
        let score = row.number(6)?;
        let is_whole = x > EDGE && y > EDGE && x + width < PICTURE[0] - EDGE && y + height < PICTURE[1] - EDGE;
        let class = CLASSES.iter().position(|(number, ..)| *number == label);
        match class.filter(|_| is_whole && height > 0.0 && score >= LEAST_SCORE) {
            Some(class) => frame.detections.push(Detection3 {
                class,
                score: score.min(1.0),
                pixel: [x + width / 2.0, y + height / 2.0],
                disparity: height * HEIGHT / CLASSES[class].2,
            }),
            None => cut += 1,
        }
        Ok(())
    })?;
    Ok(cut)
}
