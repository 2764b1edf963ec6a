//! A recording of detections: a folder with `sensors.toml`, `odometry.csv` and `detections.csv`, as `docs/formats.md`
//! says.
//!
//! Ground truth lies beside them ([`truth`]) and is never opened here.

use super::{WriteError, write_whole};
use crate::detections::{DetectionKind, Frame, Recording, Recording3};
use crate::log::LogError;
use crate::objects::Detections;
use std::path::Path;

mod detections;
mod odometry;
pub mod results;
pub mod sensors;
pub mod truth;

/// What is known about the sensors.
pub const SENSORS: &str = "sensors.toml";
const ODOMETRY: &str = "odometry.csv";
/// The detections; folders of this kind are recognised by this file.
pub const DETECTIONS: &str = "detections.csv";

const EXPECTED: &str = "a recording of detections is a folder with sensors.toml, odometry.csv and detections.csv \
                        (docs/formats.md); `ipslam convert FOLDER RECORDING` makes one of a published data set";

/// Odometry and detections further apart are not of one drive, or one of them broke off \[s\].
const MAX_GAP: f64 = 1.0;

/// A recording and what is odd about it.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadRecording<R = Recording> {
    /// What was recorded.
    pub recording: R,
    /// One sentence each.
    pub warnings: Vec<String>,
}

/// What the detections in the folder of a recording are: of a robot of the plane, which [`read`] reads, or of space,
/// which [`read3`] reads.
///
/// # Errors
/// As for [`read`].
pub fn read_kind(folder: &Path) -> Result<DetectionKind, LogError> {
    check_files(folder)?;
    sensors::read_kind(&folder.join(SENSORS))
}

fn check_files(folder: &Path) -> Result<(), LogError> {
    for name in [SENSORS, ODOMETRY, DETECTIONS] {
        if !folder.join(name).is_file() {
            let reason = if folder.is_dir() { format!("it has no {name}") } else { "this is no folder".to_owned() };
            return Err(LogError::NotThisFormat { path: folder.to_owned(), reason, expected: EXPECTED });
        }
    }
    Ok(())
}

/// Reads the folder of a recording.
///
/// # Errors
/// A file is missing or cannot be read, or a line of it is wrong; the message names file, line and remedy.
pub fn read(folder: &Path) -> Result<ReadRecording, LogError> {
    check_files(folder)?;
    let sensors = sensors::read(&folder.join(SENSORS))?;
    let (odometry, of_odometry) = odometry::read(&folder.join(ODOMETRY))?;
    let (frames, of_detections) = detections::read(&folder.join(DETECTIONS), &sensors.classes)?;
    let mut warnings = unknown_columns([(ODOMETRY, of_odometry), (DETECTIONS, of_detections)]);
    warnings.extend(frames_without_odometry(odometry.span(), &frames));
    let recording = Recording { sensors, odometry, frames };
    let in_view: usize = recording.frames.iter().map(|frame| frame.in_view(recording.sensors.view).count()).sum();
    warnings.extend(outside_view(recording.detections() - in_view));
    Ok(ReadRecording { recording, warnings })
}

/// Reads the folder of a recording of space.
///
/// # Errors
/// As for [`read`].
pub fn read3(folder: &Path) -> Result<ReadRecording<Recording3>, LogError> {
    check_files(folder)?;
    let sensors = sensors::read3(&folder.join(SENSORS))?;
    let (odometry, of_odometry) = odometry::read3(&folder.join(ODOMETRY))?;
    let (frames, of_detections) = detections::read3(&folder.join(DETECTIONS), &sensors.classes)?;
    let mut warnings = unknown_columns([(ODOMETRY, of_odometry), (DETECTIONS, of_detections)]);
    warnings.extend(frames_without_odometry(odometry.span(), &frames));
    Ok(ReadRecording { recording: Recording3 { sensors, odometry, frames }, warnings })
}

/// Reads detections that belong to a log, with the `sensors.toml` beside them, whose odometry is not used; and what is odd about
/// them, one sentence each.
///
/// # Errors
/// As for [`read`].
pub fn read_detections(path: &Path) -> Result<(Detections, Vec<String>), LogError> {
    let sensors = sensors::read(&path.with_file_name(SENSORS))?;
    let (frames, unknown) = detections::read(path, &sensors.classes)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let mut warnings = unknown_columns([(&name, unknown)]);
    let count = |in_view: bool| -> usize {
        frames.iter().map(|f| if in_view { f.in_view(sensors.view).count() } else { f.detections.len() }).sum()
    };
    warnings.extend(outside_view(count(false) - count(true)));
    Ok((Detections { sensors, frames }, warnings))
}

/// Writes `detections.csv` and `sensors.toml` into a folder.
///
/// # Errors
/// A file cannot be written, or the detections are none that could be read.
pub fn write_detections(folder: &Path, Detections { sensors, frames }: &Detections) -> Result<(), WriteError> {
    write_whole(&folder.join(DETECTIONS), |file| detections::write(frames, &sensors.classes, file))?;
    write_whole(&folder.join(SENSORS), |file| sensors::write(sensors, file))
}

fn outside_view(count: usize) -> Option<String> {
    let told = || format!("{count} detections are left out: they lie outside what [view] of {SENSORS} says");
    (count > 0).then(told)
}

fn unknown_columns<const N: usize>(files: [(&str, Vec<String>); N]) -> Vec<String> {
    let is_odd = |(_, unknown): &(&str, Vec<String>)| !unknown.is_empty();
    let tell = |(name, unknown): (&str, Vec<String>)| {
        format!("{name}: columns left out, of which nothing is known: {}", unknown.join(", "))
    };
    files.into_iter().filter(is_odd).map(tell).collect()
}

fn frames_without_odometry<D>(span: Option<(f64, f64)>, frames: &[Frame<D>]) -> Vec<String> {
    let mut found = Vec::new();
    if let Some((first, last)) = span {
        let count_of = |is_odd: &dyn Fn(f64) -> bool| frames.iter().filter(|frame| is_odd(frame.stamp)).count();
        match count_of(&|stamp| stamp < first - MAX_GAP) {
            0 => {}
            count => {
                found.push(format!("{count} frames come before all odometry: the robot is taken to stand still there"))
            }
        }
        match count_of(&|stamp| stamp > last + MAX_GAP) {
            0 => {}
            count => found.push(format!(
                "{count} frames come after the end of the odometry, which is taken to go on as it ended"
            )),
        }
    }
    found
}

/// Writes the folder of a recording; it is made where there is none, and files of these names in it are replaced.
///
/// # Errors
/// A file cannot be written, or the recording is none that could be read.
pub fn write(folder: &Path, recording: &Recording) -> Result<(), WriteError> {
    let Recording { sensors, odometry, frames } = recording;
    std::fs::create_dir_all(folder).map_err(|source| WriteError { path: folder.to_owned(), source })?;
    write_whole(&folder.join(ODOMETRY), |file| odometry::write(odometry, file))?;
    write_whole(&folder.join(DETECTIONS), |file| detections::write(frames, &sensors.classes, file))?;
    // Last, so that what was cut short is no recording.
    write_whole(&folder.join(SENSORS), |file| sensors::write(sensors, file))
}

/// Writes the folder of a recording of space.
///
/// # Errors
/// As for [`write()`].
pub fn write3(folder: &Path, recording: &Recording3) -> Result<(), WriteError> {
    let Recording3 { sensors, odometry, frames } = recording;
    std::fs::create_dir_all(folder).map_err(|source| WriteError { path: folder.to_owned(), source })?;
    write_whole(&folder.join(ODOMETRY), |file| odometry::write3(odometry, file))?;
    write_whole(&folder.join(DETECTIONS), |file| detections::write3(frames, &sensors.classes, file))?;
    write_whole(&folder.join(SENSORS), |file| sensors::write3(sensors, file))
}

fn invalid(reason: String) -> std::io::Error {
    std::io::Error::new(std::io::ErrorKind::InvalidInput, reason)
}
