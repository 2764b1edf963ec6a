//! "Lost in the Woods": a robot with a laser drives among seventeen tubes, ten readings a second.
//!
//! `odometry_truth.csv` has speeds and true poses, row k at k/10 s; `range_bearing.csv` the tubes that the laser saw
//! at row k; `parameters.txt` where the laser is mounted, and variances. A row without a tube is a frame that saw
//! nothing.

use super::{Converted, Labels, Sighting};
use crate::detections::{DetectionNoise, Detector, Odometry, OdometryNoise, Recording, Velocity, View};
use crate::geometry::{Pose, StampedPose};
use crate::io::lines::Lines;
use crate::io::semantic::truth::TrueLandmark;
use crate::io::table::{Layout, read_table};
use crate::log::LogError;
use nalgebra::Point2;
use std::path::Path;

const EXPECTED: &str = "a table of Lost in the Woods has other columns";
/// From one row to the next \[s\].
const INTERVAL: f64 = 0.1;

pub(super) fn read(folder: &Path, labels: &Labels) -> Result<Converted, LogError> {
    let parameters = Parameters::read(&folder.join("parameters.txt"))?;
    let Drive { speeds, trajectory, without_truth } = Drive::read(&folder.join("odometry_truth.csv"))?;
    let mut frames: Vec<(f64, Vec<Sighting>)> = speeds.iter().map(|row| (row.stamp, Vec::new())).collect();
    const SEEN: Layout = Layout { required: &["k", "landmark", "range_m", "bearing_rad"], optional: &[] };
    read_table(&folder.join("range_bearing.csv"), &[SEEN], EXPECTED, |_, row| {
        let (k, landmark): (usize, u32) = (row.count(0)?, row.count(1)?);
        let (_, frame) = frames.get_mut(k).ok_or_else(|| format!("there is no row {k} in odometry_truth.csv"))?;
        frame.push(Sighting {
            id: Some(landmark.into()),
            landmark: Some(landmark as usize),
            score: 1.0,
            range: row.number(2)?,
            bearing: row.number(3)?,
        });
        Ok(())
    })?;
    let (frames, ids) = labels.frames(frames);
    let mut landmarks = Vec::new();
    const LANDMARK: Layout = Layout { required: &["landmark", "x", "y"], optional: &[] };
    read_table(&folder.join("landmarks.csv"), &[LANDMARK], EXPECTED, |_, row| {
        let (id, position): (u32, _) = (row.count(0)?, Point2::new(row.number(1)?, row.number(2)?));
        landmarks.push(TrueLandmark { id: id.into(), class: labels.class_of(id as usize), position });
        Ok(())
    })?;
    let mut sensors = labels.sensors();
    sensors.robot_from_sensor = Pose::new(parameters.mounting, 0.0, 0.0);
    sensors.noise = parameters.detection_noise();
    sensors.view = View { min_range: 0.0, max_range: 6.0, min_bearing: -2.1, max_bearing: 2.1 };
    sensors.detector = Detector { detection_probability: 0.6, clutter_density: 1e-4 };
    sensors.odometry = parameters.odometry_noise();
    let note = format!("{without_truth} poses without a valid truth are not in it");
    Ok(Converted {
        recording: Recording { sensors, odometry: Odometry::Velocities(speeds), frames },
        ids,
        trajectory,
        landmarks,
        notes: if without_truth > 0 { vec![note] } else { Vec::new() },
    })
}

struct Drive {
    speeds: Vec<Velocity>,
    trajectory: Vec<StampedPose>,
    without_truth: usize,
}

impl Drive {
    fn read(path: &Path) -> Result<Self, LogError> {
        const LAYOUT: Layout =
            Layout { required: &["k", "t_s", "v", "w", "x_true", "y_true", "th_true", "truth_valid"], optional: &[] };
        let mut drive = Self { speeds: Vec::new(), trajectory: Vec::new(), without_truth: 0 };
        read_table(path, &[LAYOUT], EXPECTED, |_, row| {
            if row.count::<usize>(0)? != drive.speeds.len() {
                return Err(format!("k is `{}`; rows count from 0 and none is missing", row.text(0)));
            }
            let stamp = row.number(1)?;
            drive.speeds.push(Velocity { stamp, forward: row.number(2)?, turn: row.number(3)? });
            if row.number(7)? == 1.0 {
                let pose = Pose::new(row.number(4)?, row.number(5)?, row.number(6)?);
                drive.trajectory.push(StampedPose { stamp, pose });
            } else {
                drive.without_truth += 1;
            }
            Ok(())
        })?;
        Ok(drive)
    }
}

/// `parameters.txt`: a name and a number a line.
#[derive(Default)]
struct Parameters {
    /// The laser is so far ahead of the wheels \[m\].
    mounting: f64,
    range_variance: f64,
    bearing_variance: f64,
    speed_variance: f64,
    turn_rate_variance: f64,
}

impl Parameters {
    fn read(path: &Path) -> Result<Self, LogError> {
        let (mut found, mut lines, mut line) = (Self::default(), Lines::open(path)?, String::new());
        while lines.next_into(&mut line)? {
            let words: Vec<_> = line.split_whitespace().collect();
            let (name, number) = match words[..] {
                [name, number] => (name, number.parse::<f64>().ok().filter(|number| *number > 0.0)),
                _ => ("", None),
            };
            let number = number.ok_or_else(|| lines.error("a line is a name and a number above 0".to_owned()))?;
            match name {
                "d" => found.mounting = number,
                "r_var" => found.range_variance = number,
                "b_var" => found.bearing_variance = number,
                "v_var" => found.speed_variance = number,
                "om_var" => found.turn_rate_variance = number,
                _ => {}
            }
        }
        let all = [found.mounting, found.range_variance, found.bearing_variance, found.speed_variance];
        if all.into_iter().chain([found.turn_rate_variance]).any(|number| number == 0.0) {
            let reason = "one of d, r_var, b_var, v_var, om_var is missing".to_owned();
            return Err(LogError::NotThisFormat { path: path.to_owned(), reason, expected: EXPECTED });
        }
        Ok(found)
    }

    fn detection_noise(&self) -> DetectionNoise {
        DetectionNoise { range: self.range_variance.sqrt(), bearing: self.bearing_variance.sqrt(), position: 0.0 }
    }

    /// Speeds err from row to row, so that the variance of a motion grows with time.
    fn odometry_noise(&self) -> OdometryNoise {
        OdometryNoise {
            forward_per_metre: 0.0,
            sideways_per_metre: 0.0,
            heading_per_metre: 0.0,
            heading_per_radian: 0.0,
            position_per_second: (self.speed_variance * INTERVAL).sqrt(),
            heading_per_second: (self.turn_rate_variance * INTERVAL).sqrt(),
        }
    }
}
