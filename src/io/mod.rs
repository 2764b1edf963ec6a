//! Files in and out: one file a format behind one small reader. [`open_log`] finds the reader for a log by its content.
//!
//! A log is a sequence of [`LogEntry`]s in the order in which they were recorded. Stamps may go backwards in it (the
//! recorders of public logs stamped some messages late), so the order of the lines is the true order and a stamp is
//! the name of a reading. A log is streamed, never read whole, and can be opened again for a second pass.

use crate::geometry::Pose;
use std::io::Write;
use std::path::{Path, PathBuf};

pub mod carmen;
mod columns;
pub mod geojson;
pub mod map_json;
pub mod map_server;
pub mod mcap;
mod open;
pub mod relations;
pub mod tum;

pub use open::open_log;

/// One entry of a log.
#[derive(Clone, Debug, PartialEq)]
pub enum LogEntry {
    /// Where odometry believes the robot to be.
    Odometry {
        /// Seconds.
        stamp: f64,
        /// Pose in the drifting frame of the odometry.
        odom_from_robot: Pose,
    },
    /// One sweep of the laser.
    Laser(LaserReading),
    /// True pose, where a log has it; never used for mapping.
    Truth {
        /// Seconds.
        stamp: f64,
        /// True pose of the robot.
        world_from_robot: Pose,
    },
}

/// One sweep of a laser as it was recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct LaserReading {
    /// Seconds.
    pub stamp: f64,
    /// Odometry at the sweep.
    pub odom_from_robot: Pose,
    /// Where the laser is mounted.
    pub robot_from_laser: Pose,
    /// Angle of the first beam in the laser's frame \[rad\].
    pub first_angle: f64,
    /// Angle from one beam to the next \[rad\], positive counter-clockwise.
    pub angle_step: f64,
    /// Ranges at or above this are no return \[m\]; infinite where the log does not tell.
    pub max_range: f64,
    /// One range a beam \[m\], as recorded: may hold NaN, infinite, negative and no-return values.
    pub ranges: Vec<f64>,
}

/// What a reader met besides the entries that it handed out.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct LogStats {
    /// Lines read, comments included; messages, where the log is a bag.
    pub lines: u64,
    /// Laser readings handed out.
    pub laser: u64,
    /// Odometry entries handed out.
    pub odometry: u64,
    /// Messages of other kinds, by name; by topic, where the log is a bag.
    pub skipped: std::collections::BTreeMap<String, u64>,
    /// Lines, or messages and chunks of a bag, that could not be read and were left out.
    pub malformed: u64,
    /// The first of these: what was wrong with it, with file and line.
    pub first_malformed: Option<String>,
    /// Laser readings that came before any odometry; they carry the identity pose. In a bag, also those more than a
    /// second from the nearest odometry; where there is any, they carry the nearest.
    pub laser_without_odometry: u64,
    /// Laser readings of a bag that does not tell where the laser is mounted; it is taken to be at the robot's origin
    /// and to look forward.
    pub laser_without_mounting: u64,
    /// Stamps lower than the one before.
    pub backward_stamps: u64,
}

/// Names of skipped messages that are counted apart; a damaged file could hold any number.
const MAX_SKIPPED_NAMES: usize = 64;
/// Under this name the others are counted.
const OTHER_NAMES: &str = "(others)";

impl LogStats {
    /// Counts an entry that is handed out; `last_stamp` is that of the entry before.
    fn add(&mut self, entry: &LogEntry, last_stamp: &mut f64) {
        let stamp = match entry {
            LogEntry::Odometry { stamp, .. } => {
                self.odometry += 1;
                *stamp
            }
            LogEntry::Laser(reading) => {
                self.laser += 1;
                reading.stamp
            }
            LogEntry::Truth { stamp, .. } => *stamp,
        };
        self.backward_stamps += u64::from(stamp < *last_stamp);
        *last_stamp = stamp;
    }

    /// Counts what was left out at the last line read.
    fn add_malformed(&mut self, path: &Path, reason: String) {
        self.malformed += 1;
        if self.first_malformed.is_none() {
            let error = LogError::Line { path: path.to_owned(), line: self.lines, reason };
            self.first_malformed = Some(error.to_string());
        }
    }

    fn add_skipped(&mut self, name: &str) {
        let skipped = &mut self.skipped;
        let name = if skipped.len() < MAX_SKIPPED_NAMES || skipped.contains_key(name) { name } else { OTHER_NAMES };
        *skipped.entry(name.to_owned()).or_default() += 1;
    }
}

/// A log that can be read from its start any number of times.
pub trait LogSource: Sync {
    /// What to call the log: the file's name without folder and ending, or the name of a built-in world.
    fn name(&self) -> String;

    /// Starts reading at the first entry.
    fn open(&self) -> Result<Box<dyn LogReader>, LogError>;
}

/// The entries of an opened log, in the order of the log.
///
/// After an `Err` the iterator ends: errors here are those that reading cannot go on from.
pub trait LogReader: Iterator<Item = Result<LogEntry, LogError>> + Send {
    /// Counts so far.
    fn stats(&self) -> &LogStats;

    /// Bytes of the file consumed so far and in all, for a progress bar; `None` where there is no file.
    fn progress(&self) -> Option<(u64, u64)>;
}

/// Why a log, trajectory or relations file could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The file cannot be opened.
    #[error("{path}: cannot be opened: {source}")]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Reading broke off.
    #[error("{path}:{line}: reading broke off after this line: {source} (is the file complete?)")]
    Read {
        /// The file.
        path: PathBuf,
        /// Lines, or messages of a bag, read before.
        line: u64,
        /// What the system or the decompressor said.
        source: std::io::Error,
    },
    /// The file is of another kind.
    #[error("{path}: {reason}; {expected}")]
    NotThisFormat {
        /// The file.
        path: PathBuf,
        /// What was found.
        reason: String,
        /// What is understood.
        expected: &'static str,
    },
    /// A line that has to be right is not.
    #[error("{path}:{line}: {reason}")]
    Line {
        /// The file.
        path: PathBuf,
        /// Line number, from 1; in a bag, number of the message.
        line: u64,
        /// What is wrong with it, with the field's name.
        reason: String,
    },
    /// A bag holds no log, or it is not clear which of its topics make one.
    #[error("{path}: {reason}")]
    Bag {
        /// The file or folder.
        path: PathBuf,
        /// What is not clear, with what the bag holds and the option that chooses.
        reason: String,
    },
}

/// Why a file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: cannot be written: {source}{}", remedy(source))]
pub struct WriteError {
    /// The file.
    pub path: PathBuf,
    /// What the system said.
    pub source: std::io::Error,
}

fn remedy(error: &std::io::Error) -> &'static str {
    use std::io::ErrorKind;
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => "; free some space there or write to another disk",
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => "; choose a folder that you may write to",
        ErrorKind::NotFound | ErrorKind::NotADirectory => "; its folder does not exist: create it first",
        ErrorKind::IsADirectory => "; this is a folder: name a file in it",
        _ => "",
    }
}

/// Writes a file so that it is there whole or not at all.
///
/// `write` fills a temporary file beside `path`, which takes the name `path` once everything is on the disk. What is
/// no regular file (a pipe, `/dev/stdout`) is written to directly.
///
/// # Errors
/// `write` fails, or the file cannot be made, filled or renamed. What stood at `path` before is then untouched.
pub fn write_whole(path: &Path, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<(), WriteError> {
    replace_file(path, write).map_err(|source| WriteError { path: path.to_owned(), source })
}

fn replace_file(path: &Path, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> std::io::Result<()> {
    if std::fs::metadata(path).is_ok_and(|metadata| !metadata.is_file()) {
        let mut file = std::io::BufWriter::new(std::fs::OpenOptions::new().write(true).open(path)?);
        write(&mut file)?;
        return file.flush();
    }
    // A link stays a link: the file that it leads to is replaced.
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let Some(name) = path.file_name() else { return Err(std::io::ErrorKind::IsADirectory.into()) };
    let partial = path.with_file_name(format!(".{}.{}.partial", name.to_string_lossy(), std::process::id()));
    let written = std::fs::File::create(&partial).and_then(|file| {
        let mut file = std::io::BufWriter::new(file);
        write(&mut file)?;
        file.flush()?;
        file.get_ref().sync_all()?;
        std::fs::rename(&partial, &path)
    });
    if written.is_err() {
        // The first error is the one to tell; there may be nothing to remove.
        let _ = std::fs::remove_file(&partial);
    }
    written
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_file_is_replaced_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.txt");
        write_whole(&path, |file| file.write_all(b"first")).unwrap();
        let error = write_whole(&path, |file| {
            file.write_all(b"half of the sec")?;
            Err(std::io::ErrorKind::StorageFull.into())
        })
        .unwrap_err();
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        assert_eq!(names(folder.path()), ["out.txt"]);
        let message = error.to_string();
        assert!(message.contains("out.txt: cannot be written") && message.contains("free some space"), "{message}");
        write_whole(&path, |file| file.write_all(b"second")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"second");
        assert_eq!(names(folder.path()), ["out.txt"]);
    }

    #[test]
    fn says_where_and_why_a_file_cannot_be_written() {
        let folder = tempfile::tempdir().unwrap();
        for (path, expected) in [
            (folder.path().join("missing/out.txt"), "its folder does not exist"),
            (folder.path().to_owned(), "this is a folder"),
        ] {
            let message = write_whole(&path, |file| file.write_all(b"text")).unwrap_err().to_string();
            assert!(message.contains(expected), "{message:?} does not say {expected:?}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_stay_and_devices_stay() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        std::fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_whole(&link, |out| out.write_all(b"new")).unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), b"new");
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        write_whole(Path::new("/dev/null"), |out| out.write_all(b"nothing")).unwrap();
        assert!(!std::fs::metadata("/dev/null").unwrap().is_file());
    }
}
