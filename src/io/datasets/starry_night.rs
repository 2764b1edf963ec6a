//! "Starry Night": a rig of two cameras and an inertial sensor, moved by hand over twenty points of light.
//!
//! `odometry.csv` has speeds in the frame of the rig, `truth.csv` its true poses, and `stereo.csv` the pixels of the points in
//! both pictures of row k; `landmarks.csv` where the points are; `calibration.txt` the cameras, and variances.

use super::{Converted3, Labels};
use crate::detections::{
    Detection3, Detector3, Frame, Odometry3, OdometryNoise3, PixelNoise, Recording3, Sensors3, Velocity3,
};
use crate::geometry::{Pinhole, Pose3, StampedPose3};
use crate::io::lines::Lines;
use crate::io::semantic::truth::TrueLandmark;
use crate::io::table::{Layout, Row, read_table};
use crate::log::LogError;
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use std::collections::HashMap;
use std::path::Path;

const EXPECTED: &str = "a table of Starry Night has other columns";
/// From one row to the next, in the mean \[s\].
const INTERVAL: f64 = 0.089;
/// Of a disparity \[pixels\]. Both pictures of a point err alike, so that it is less than `calibration.txt` would let one think;
/// it was measured in all pictures, with the true poses.
const DISPARITY_NOISE: f64 = 3.4;

/// Of an angular speed \[rad/s\], measured in the same way: `w_var` is that of speeds of the other sign.
const TURN_NOISE: f64 = 0.12;

/// Reads the set, or some of its rows.
pub(super) fn read(folder: &Path, labels: &Labels, rows: Option<(usize, usize)>) -> Result<Converted3, LogError> {
    let (first, last) = rows.unwrap_or((0, usize::MAX));
    let sensors = Calibration::read(&folder.join("calibration.txt"))?.sensors(labels);
    let mut speeds = Vec::new();
    const SPEEDS: Layout = Layout { required: &["k", "t_s", "vx", "vy", "vz", "wx", "wy", "wz"], optional: &[] };
    read_table(&folder.join("odometry.csv"), &[SPEEDS], EXPECTED, |_, row| {
        // By the true poses, the set tells how the world turns around the rig.
        speeds.push(Velocity3 { stamp: row.number(1)?, linear: vector(row, 2)?, angular: -vector(row, 5)? });
        Ok(())
    })?;
    let mut trajectory = Vec::new();
    const TRUTH: Layout = Layout { required: &["k", "t_s", "ax", "ay", "az", "x", "y", "z"], optional: &[] };
    read_table(&folder.join("truth.csv"), &[TRUTH], EXPECTED, |_, row| {
        let pose = Pose3::new(vector(row, 5)?.into(), UnitQuaternion::from_scaled_axis(vector(row, 2)?));
        trajectory.push(StampedPose3 { stamp: row.number(1)?, pose });
        Ok(())
    })?;
    let mut seen: Vec<Vec<(u32, [f64; 2], f64)>> = vec![Vec::new(); speeds.len()];
    let mut behind = 0;
    const SEEN: Layout = Layout { required: &["k", "feature", "ul", "vl", "ur", "vr"], optional: &[] };
    read_table(&folder.join("stereo.csv"), &[SEEN], EXPECTED, |_, row| {
        let (k, feature): (usize, u32) = (row.count(0)?, row.count(1)?);
        let frame = seen.get_mut(k).ok_or_else(|| format!("there is no row {k} in odometry.csv"))?;
        let (pixel, disparity) = ([row.number(2)?, row.number(3)?], row.number(2)? - row.number(4)?);
        if disparity > 0.0 {
            frame.push((feature, pixel, disparity))
        } else {
            behind += 1
        }
        Ok(())
    })?;
    let mut landmarks = Vec::new();
    const LANDMARK: Layout = Layout { required: &["feature", "x", "y", "z"], optional: &[] };
    read_table(&folder.join("landmarks.csv"), &[LANDMARK], EXPECTED, |_, row| {
        let (id, position): (u32, Point3<f64>) = (row.count(0)?, vector(row, 1)?.into());
        landmarks.push(TrueLandmark { id: id.into(), class: labels.class_of(id as usize), position });
        Ok(())
    })?;
    let is_wanted = |k: usize| (first..=last).contains(&k);
    let (mut frames, mut ids) = (Vec::new(), Vec::new());
    for (k, (mut seen, speed)) in seen.into_iter().zip(&speeds).enumerate().filter(|(k, _)| is_wanted(*k)) {
        // Their order tells nothing about the points.
        seen.sort_by(|(_, a, _), (_, b, _)| a[0].total_cmp(&b[0]));
        let detect = |(number, &(feature, pixel, disparity)): (usize, &(u32, [f64; 2], f64))| Detection3 {
            class: labels.label(labels.class_of(feature as usize), k, number),
            score: 1.0,
            pixel,
            disparity,
        };
        frames.push(Frame { stamp: speed.stamp, detections: seen.iter().enumerate().map(detect).collect() });
        ids.push(seen.iter().map(|(feature, ..)| Some((*feature).into())).collect());
    }
    let note = format!("{behind} points behind the cameras are not in it");
    trajectory = trajectory.into_iter().skip(first).take(frames.len()).collect();
    Ok(Converted3 {
        recording: Recording3 { sensors, odometry: Odometry3::Velocities(speeds), frames },
        ids,
        trajectory,
        landmarks,
        notes: if behind > 0 { vec![note] } else { Vec::new() },
    })
}

fn vector(row: &Row, first: usize) -> Result<Vector3<f64>, String> {
    Ok(Vector3::new(row.number(first)?, row.number(first + 1)?, row.number(first + 2)?))
}

/// `calibration.txt`: a name and its numbers a line.
struct Calibration(HashMap<String, Vec<f64>>);

impl Calibration {
    fn read(path: &Path) -> Result<Self, LogError> {
        let (mut found, mut lines, mut line) = (HashMap::new(), Lines::open(path)?, String::new());
        while lines.next_into(&mut line)? {
            let mut words = line.split_whitespace();
            let name = words.next().unwrap_or_default().to_owned();
            let numbers = super::numbers(words).map_err(|reason| lines.error(reason))?;
            found.insert(name, numbers);
        }
        let lengths = [
            ("fu", 1),
            ("fv", 1),
            ("cu", 1),
            ("cv", 1),
            ("b", 1),
            ("rho_v_c_v", 3),
            ("C_c_v", 9),
            ("y_var", 4),
            ("v_var", 3),
        ];
        for (name, length) in lengths {
            if found.get(name).is_none_or(|numbers| numbers.len() != length) {
                let reason = format!("it has no line {name} of {length} numbers");
                return Err(LogError::NotThisFormat { path: path.to_owned(), reason, expected: EXPECTED });
            }
        }
        Ok(Self(found))
    }

    fn numbers<const N: usize>(&self, name: &str) -> [f64; N] {
        self.0.get(name).and_then(|numbers| numbers.as_slice().try_into().ok()).unwrap_or([0.0; N])
    }

    fn sensors(&self, labels: &Labels) -> Sensors3 {
        let number = |name| self.numbers::<1>(name)[0];
        let camera_from_rig = Matrix3::from_row_slice(&self.numbers::<9>("C_c_v"));
        let rotation = Rotation3::from_matrix_unchecked(camera_from_rig.transpose());
        let speed_variance = self.numbers::<3>("v_var").iter().sum::<f64>() / 3.0;
        let [u, v, ..] = self.numbers::<4>("y_var").map(f64::sqrt);
        let camera = Pinhole { focal: [number("fu"), number("fv")], centre: [number("cu"), number("cv")] };
        let (names, accuracy) = labels.named();
        let mut sensors = Sensors3::new(names, accuracy, camera, number("b"));
        let position = self.numbers::<3>("rho_v_c_v").into();
        sensors.robot_from_camera = Pose3::new(position, UnitQuaternion::from_rotation_matrix(&rotation));
        sensors.noise = PixelNoise { u, v, disparity: DISPARITY_NOISE, share: 0.0 };
        sensors.detector = Detector3 { detection_probability: 0.8, ..Detector3::default() };
        // Speeds err from row to row, so that the variance of a motion grows with time.
        sensors.odometry = OdometryNoise3 {
            position_per_metre: 0.0,
            rotation_per_metre: 0.0,
            rotation_per_radian: 0.0,
            position_per_second: (speed_variance * INTERVAL).sqrt(),
            rotation_per_second: TURN_NOISE * INTERVAL.sqrt(),
            ..OdometryNoise3::default()
        };
        sensors
    }
}
