//! "SLAM with objects": a camera with depth is carried past the furniture of the MIT Stata Center and back (Mu, Liu, Paull,
//! Leonard, How, IROS 2016).
//!
//! `frames.csv` has the way of the camera by visual odometry, a pose of the first camera's frame each row; `detections_3d.csv`
//! the objects that a detector named in the pictures, with the middle of what the depth camera measured of them. There are no
//! stamps: pictures count as a tenth of a second apart. Nobody knows which object a detection shows, nor the true way.

use super::kitti_tracking::pose_of;
use super::{Converted3, Options};
use crate::detections::{Detection3, Detector3, Frame, Odometry3, OdometryNoise3, PixelNoise, Recording3, Sensors3};
use crate::geometry::{Pinhole, StampedPose3};
use crate::io::table::{Layout, read_table};
use crate::log::LogError;
use crate::parameters::ConfigError;
use std::path::Path;

const EXPECTED: &str = "a table of this set has other columns";
const INTERVAL: f64 = 0.1;
const CAMERA: Pinhole = Pinhole { focal: [670.92, 671.49], centre: [324.45, 192.84] };
/// Numbers of the detector's labels, and their names.
const LABELS: [(u32, &str); 8] = [
    (6, "keyboard"),
    (9, "screen"),
    (11, "flower pot"),
    (12, "traffic light"),
    (14, "cup"),
    (16, "car"),
    (17, "chair"),
    (19, "person"),
];

pub(super) fn read(folder: &Path, options: &Options) -> Result<Converted3, super::ConvertError> {
    if let Some(wrong) = options.wrong_labels {
        return Err(ConfigError::value("--wrong-labels", wrong, "left out, as a detector made the labels").into());
    }
    let poses = read_poses(&folder.join("frames.csv"))?;
    let frames = read_frames(&folder.join("detections_3d.csv"), &poses)?;
    let classes = LABELS.iter().map(|(_, name)| (*name).to_owned()).collect();
    // Where an object is was measured in metres: a baseline of one metre makes the disparity f / z.
    let mut sensors = Sensors3::new(classes, 0.9, CAMERA, 1.0);
    // The middle of what is seen of an object errs by about a decimetre in each direction.
    sensors.noise = PixelNoise { u: 2.0, v: 2.0, disparity: 2.0, share: 0.1 };
    sensors.detector = Detector3 { detection_probability: 0.6, clutter: 0.1 };
    sensors.odometry = OdometryNoise3 { scale: 0.03, turn_scale: 0.03, ..OdometryNoise3::default() };
    sensors.movable = vec![LABELS.len() - 1];
    let ids = frames.iter().map(|frame: &Frame<Detection3>| vec![None; frame.detections.len()]).collect();
    let recording = Recording3 { sensors, odometry: Odometry3::Poses(poses), frames };
    Ok(Converted3 { recording, ids, trajectory: Vec::new(), landmarks: Vec::new(), notes: Vec::new() })
}

fn read_poses(path: &Path) -> Result<Vec<StampedPose3>, LogError> {
    const POSES: Layout = Layout {
        required: &["t00", "t01", "t02", "t03", "t10", "t11", "t12", "t13", "t20", "t21", "t22", "t23"],
        optional: &[],
    };
    let mut poses = Vec::new();
    read_table(path, &[POSES], EXPECTED, |_, row| {
        let numbers = (0..12).map(|column| row.number(column)).collect::<Result<Vec<f64>, _>>()?;
        let pose = pose_of(&numbers).ok_or("a pose has 12 numbers")?;
        poses.push(StampedPose3 { stamp: INTERVAL * poses.len() as f64, pose });
        Ok(())
    })?;
    Ok(poses)
}

fn read_frames(path: &Path, poses: &[StampedPose3]) -> Result<Vec<Frame<Detection3>>, LogError> {
    const OBJECTS: Layout = Layout { required: &["frame", "label", "score", "px_m", "py_m", "pz_m"], optional: &[] };
    let mut frames: Vec<Frame<Detection3>> =
        poses.iter().map(|pose| Frame { stamp: pose.stamp, detections: Vec::new() }).collect();
    read_table(path, &[OBJECTS], EXPECTED, |_, row| {
        let (frame, label): (usize, u32) = (row.count(0)?, row.count(1)?);
        let frame = frames.get_mut(frame).ok_or_else(|| format!("there is no frame {frame} in frames.csv"))?;
        let class = LABELS.iter().position(|(number, _)| *number == label);
        let class = class.ok_or_else(|| format!("label is {label}, of which no name is known"))?;
        let [x, y, z] = [row.number(3)?, row.number(4)?, row.number(5)?];
        if z <= 0.0 {
            return Err(format!("pz_m is {z}; what a camera sees is ahead of it"));
        }
        let [fu, fv] = CAMERA.focal;
        let pixel = [fu * x / z + CAMERA.centre[0], fv * y / z + CAMERA.centre[1]];
        frame.detections.push(Detection3 { class, score: row.number(2)?.clamp(0.0, 1.0), pixel, disparity: fu / z });
        Ok(())
    })?;
    Ok(frames)
}
