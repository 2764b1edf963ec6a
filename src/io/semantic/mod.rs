//! A recording of detections: a folder with `sensors.toml`, `odometry.csv` and `detections.csv`, as `docs/formats.md`
//! says.
//!
//! Ground truth lies beside them ([`truth`]) and is never opened here.

use super::{WriteError, write_whole};
use crate::detections::Recording;
use crate::log::LogError;
use std::path::Path;

mod detections;
mod odometry;
pub mod results;
pub mod sensors;
pub mod truth;

const SENSORS: &str = "sensors.toml";
const ODOMETRY: &str = "odometry.csv";
/// The detections; folders of this kind are recognised by this file.
pub const DETECTIONS: &str = "detections.csv";

const EXPECTED: &str = "a recording of detections is a folder with sensors.toml, odometry.csv and detections.csv \
                        (docs/formats.md); `ipslam convert FOLDER RECORDING` makes one of a published data set";

/// Odometry and detections further apart are not of one drive, or one of them broke off \[s\].
const MAX_GAP: f64 = 1.0;

/// A recording and what is odd about it.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadRecording {
    /// What was recorded.
    pub recording: Recording,
    /// One sentence each.
    pub warnings: Vec<String>,
}

/// Reads the folder of a recording.
///
/// # Errors
/// A file is missing or cannot be read, or a line of it is wrong; the message names file, line and remedy.
pub fn read(folder: &Path) -> Result<ReadRecording, LogError> {
    for name in [SENSORS, ODOMETRY, DETECTIONS] {
        if !folder.join(name).is_file() {
            let reason = if folder.is_dir() { format!("it has no {name}") } else { "this is no folder".to_owned() };
            return Err(LogError::NotThisFormat { path: folder.to_owned(), reason, expected: EXPECTED });
        }
    }
    let mut warnings = Vec::new();
    let mut take = |name: &str, unknown: Vec<String>| {
        if !unknown.is_empty() {
            warnings.push(format!("{name}: columns left out, of which nothing is known: {}", unknown.join(", ")));
        }
    };
    let sensors = sensors::read(&folder.join(SENSORS))?;
    let (odometry, unknown) = odometry::read(&folder.join(ODOMETRY))?;
    take(ODOMETRY, unknown);
    let (frames, unknown) = detections::read(&folder.join(DETECTIONS), &sensors.classes)?;
    take(DETECTIONS, unknown);
    let recording = Recording { sensors, odometry, frames };
    warnings.extend(oddities(&recording));
    Ok(ReadRecording { recording, warnings })
}

fn oddities(recording: &Recording) -> Vec<String> {
    let Recording { sensors, odometry, frames } = recording;
    let mut found = Vec::new();
    if let Some((first, last)) = odometry.span() {
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
    let in_view: usize = frames.iter().map(|frame| frame.in_view(sensors.view).count()).sum();
    match recording.detections() - in_view {
        0 => {}
        count => found.push(format!("{count} detections are left out: they lie outside what [view] of {SENSORS} says")),
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

fn invalid(reason: String) -> std::io::Error {
    std::io::Error::new(std::io::ErrorKind::InvalidInput, reason)
}
