//! UTIAS MR.CLAM: five robots drive among fifteen tubes with barcodes; each sees tubes and other robots by a camera.
//!
//! Read are the files as they were published (`Robot1_Odometry.dat` and so on, with barcodes and the time of day),
//! and tables of one robot each (`robot1_odometry.csv` and so on, with subjects, and times from the robot's first
//! odometry). Subjects 1 to 5 are the robots, 6 to 20 the tubes.

use super::{ConvertError, Converted, Labels, Sighting};
use crate::detections::{DetectionNoise, Detector, Odometry, OdometryNoise, Recording, Velocity, View};
use crate::geometry::{Pose, StampedPose};
use crate::io::columns::read_rows;
use crate::io::semantic::truth::TrueLandmark;
use crate::io::table::{Layout, read_table};
use crate::log::LogError;
use crate::parameters::ConfigError;
use nalgebra::Point2;
use std::collections::HashMap;
use std::path::Path;

/// The first subject that is a tube.
const FIRST_TUBE: i64 = 6;
const LAST_TUBE: i64 = 20;
const EXPECTED: &str = "a file of MR.CLAM has rows of numbers, as its own description says";

/// Numbers of the robots that a folder has files of.
pub(super) fn robots(folder: &Path) -> Vec<u32> {
    let has_files = |robot: &u32| {
        let tables = ["odometry", "measurement"].map(|what| format!("robot{robot}_{what}.csv"));
        let published = ["Odometry", "Measurement"].map(|what| format!("Robot{robot}_{what}.dat"));
        [tables, published].iter().any(|names| names.iter().all(|name| folder.join(name).is_file()))
    };
    (1..FIRST_TUBE as u32).filter(has_files).collect()
}

pub(super) fn read(folder: &Path, robot: Option<u32>, labels: &Labels) -> Result<Converted, ConvertError> {
    let robots = robots(folder);
    let robot = robot.filter(|robot| robots.contains(robot)).ok_or_else(|| {
        let known: Vec<_> = robots.iter().map(ToString::to_string).collect();
        let told = robot.map_or_else(|| "not given".to_owned(), |robot| robot.to_string());
        ConfigError::value("--robot", told, format!("one of {}", known.join(", ")))
    })?;
    let files = if folder.join(format!("robot{robot}_odometry.csv")).is_file() {
        Files::of_tables(folder, robot)?
    } else {
        Files::as_published(folder, robot)?
    };
    Ok(files.convert(labels))
}

/// The rows of all files of a robot.
struct Files {
    /// Time, speed, turn rate.
    odometry: Vec<[f64; 3]>,
    /// Time, subject, range, bearing.
    sightings: Vec<[f64; 4]>,
    /// Time, x, y, heading.
    truth: Vec<[f64; 4]>,
    /// Subject, x, y.
    landmarks: Vec<[f64; 3]>,
}

impl Files {
    fn of_tables(folder: &Path, robot: u32) -> Result<Self, LogError> {
        let of_robot = |what: &str| folder.join(format!("robot{robot}_{what}.csv"));
        Ok(Self {
            odometry: table(&of_robot("odometry"), &["t_s", "v_mps", "w_radps"])?,
            sightings: table(&of_robot("measurement"), &["t_s", "subject", "range_m", "bearing_rad"])?,
            truth: table(&of_robot("truth"), &["t_s", "x_m", "y_m", "theta_rad"])?,
            landmarks: table(&folder.join("landmarks.csv"), &["subject", "x_m", "y_m"])?,
        })
    }

    fn as_published(folder: &Path, robot: u32) -> Result<Self, LogError> {
        let of_robot = |what: &str| folder.join(format!("Robot{robot}_{what}.dat"));
        let mut odometry: Vec<[f64; 3]> = rows(&of_robot("Odometry"))?;
        let mut sightings: Vec<[f64; 4]> = rows(&of_robot("Measurement"))?;
        let mut truth: Vec<[f64; 4]> = rows(&of_robot("Groundtruth"))?;
        let start = odometry.first().map_or(0.0, |row| row[0]);
        let barcodes: HashMap<i64, f64> = rows::<2>(&folder.join("Barcodes.dat"))?
            .into_iter()
            .map(|[subject, code]| (code as i64, subject))
            .collect();
        odometry.iter_mut().for_each(|row| row[0] = since(row[0], start));
        truth.iter_mut().for_each(|row| row[0] = since(row[0], start));
        for row in &mut sightings {
            row[0] = since(row[0], start);
            row[1] = barcodes.get(&(row[1] as i64)).copied().unwrap_or(-1.0);
        }
        Ok(Self { odometry, sightings, truth, landmarks: rows(&folder.join("Landmark_Groundtruth.dat"))? })
    }

    fn convert(mut self, labels: &Labels) -> Converted {
        // What was recorded together has one stamp.
        self.sightings.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut frames: Vec<(f64, Vec<Sighting>)> = Vec::new();
        let (mut of_robots, mut unknown) = (0, 0);
        for [stamp, subject, range, bearing] in self.sightings {
            // A camera that saw only other robots saw no tube.
            if frames.last().is_none_or(|(last, _)| *last != stamp) {
                frames.push((stamp, Vec::new()));
            }
            match subject as i64 {
                subject @ FIRST_TUBE..=LAST_TUBE if range > 0.0 => {
                    let landmark = Some((subject - FIRST_TUBE) as usize);
                    let seen = Sighting { id: Some(subject as u64), landmark, score: 1.0, range, bearing };
                    frames.last_mut().into_iter().for_each(|(_, frame)| frame.push(seen.clone()));
                }
                1..FIRST_TUBE => of_robots += 1,
                _ => unknown += 1,
            }
        }
        let (frames, ids) = labels.frames(frames);
        self.odometry.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let velocity = |&[stamp, forward, turn]: &[f64; 3]| Velocity { stamp, forward, turn };
        let mut sensors = labels.sensors();
        // Of robots 1 and 4 of data set 7; the odometry is also wrong by a factor of about 0.9, which is not noise.
        sensors.noise = DetectionNoise { range: 0.17, bearing: 0.015, position: 0.0 };
        sensors.view = View { min_range: 0.0, max_range: 9.0, min_bearing: -0.65, max_bearing: 0.65 };
        sensors.detector = Detector { detection_probability: 0.3, clutter_density: 0.003 };
        sensors.odometry = OdometryNoise { heading_per_radian: 0.1, ..OdometryNoise::default() };
        let landmark = |&[subject, x, y]: &[f64; 3]| TrueLandmark {
            id: subject as u64,
            class: labels.class_of((subject as i64 - FIRST_TUBE).max(0) as usize),
            position: Point2::new(x, y),
        };
        let odometry = Odometry::Velocities(self.odometry.iter().map(velocity).collect());
        let pose = |&[stamp, x, y, heading]: &[f64; 4]| StampedPose { stamp, pose: Pose::new(x, y, heading) };
        let note = |count: usize, what: &str| (count > 0).then(|| format!("{count} detections left out: {what}"));
        Converted {
            recording: Recording { sensors, odometry, frames },
            ids,
            trajectory: self.truth.iter().map(pose).collect(),
            landmarks: self.landmarks.iter().map(landmark).collect(),
            notes: [note(of_robots, "other robots"), note(unknown, "barcodes that were misread")]
                .into_iter()
                .flatten()
                .collect(),
        }
    }
}

/// Seconds since a start; both have milliseconds.
fn since(time: f64, start: f64) -> f64 {
    ((time - start) * 1e3).round() / 1e3
}

/// The columns of a table, by their names.
fn table<const N: usize>(path: &Path, names: &'static [&'static str; N]) -> Result<Vec<[f64; N]>, LogError> {
    let mut rows = Vec::new();
    read_table(path, &[Layout { required: names, optional: &[] }], EXPECTED, |_, row| {
        let mut numbers = [0.0; N];
        for (column, number) in numbers.iter_mut().enumerate() {
            *number = row.number(column)?;
        }
        rows.push(numbers);
        Ok(())
    })?;
    Ok(rows)
}

/// The first columns of a file as it was published.
fn rows<const N: usize>(path: &Path) -> Result<Vec<[f64; N]>, LogError> {
    let mut rows = Vec::new();
    read_rows(path, EXPECTED, |row| {
        rows.push(*row.first_chunk().ok_or_else(|| format!("{} columns in place of {N}", row.len()))?);
        Ok(())
    })?;
    Ok(rows)
}
