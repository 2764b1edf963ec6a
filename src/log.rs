//! Readings of the robot's sensors in the order in which they were recorded, and where they come from.
//!
//! A log is a sequence of [`LogEntry`]s. Stamps may go backwards in it (the recorders of public logs stamped some messages
//! late), so the order of the entries is the true order, and stamps identify readings. A log is streamed, never
//! read whole, and can be opened again for a second pass.

use crate::geometry::Pose;
use std::path::{Path, PathBuf};

/// One entry of a log.
#[derive(Clone, Debug, PartialEq)]
pub enum LogEntry {
    /// Pose by odometry.
    Odometry {
        /// Seconds.
        stamp: f64,
        /// Pose in the drifting frame of the odometry.
        odom_from_robot: Pose,
    },
    /// One sweep of the laser.
    Laser(LaserReading),
    /// How far the robot has turned since the reading before, by a gyroscope. It stands before the reading of the same stamp; where
    /// there is none, nothing measured that turn.
    Turn {
        /// Seconds.
        stamp: f64,
        /// Counter-clockwise, with the bias of the gyroscope \[rad\].
        by_gyro: f64,
    },
    /// True pose, where a log has it; never used for mapping.
    Truth {
        /// Seconds.
        stamp: f64,
        /// True pose of the robot.
        world_from_robot: Pose,
    },
}

impl LogEntry {
    /// Seconds.
    pub fn stamp(&self) -> f64 {
        match self {
            Self::Odometry { stamp, .. } | Self::Turn { stamp, .. } | Self::Truth { stamp, .. } => *stamp,
            Self::Laser(reading) => reading.stamp,
        }
    }

    /// Whether it is odometry or a sweep: the k-th reading of a log has the k-th pose of a result.
    pub fn is_reading(&self) -> bool {
        matches!(self, Self::Odometry { .. } | Self::Laser(_))
    }
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
    /// The motion of the robot during the sweep: its pose at the last beam, seen from that at the first, which is the reading's.
    /// The identity if the sweep took no time or its duration is unknown.
    pub start_from_end: Pose,
    /// Angle of the first beam in the laser's frame \[rad\].
    pub first_angle: f64,
    /// Angle from one beam to the next \[rad\], positive counter-clockwise.
    pub angle_step: f64,
    /// Ranges at or above this are no return \[m\]; infinite if unknown.
    pub max_range: f64,
    /// One range a beam \[m\], as recorded: may hold NaN, infinite, negative and no-return values.
    pub ranges: Vec<f64>,
}

/// Statistics of a reader: what it read and what it left out.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct LogStats {
    /// Lines read, comments included; messages, where the log is a bag.
    pub lines: u64,
    /// Laser readings handed out.
    pub laser: u64,
    /// Odometry entries handed out.
    pub odometry: u64,
    /// Turns by a gyroscope handed out.
    pub turns: u64,
    /// The inertial sensor of a bag that is read.
    pub imu: Option<ImuStats>,
    /// Messages of other kinds, by name; by topic, where the log is a bag.
    pub skipped: std::collections::BTreeMap<String, u64>,
    /// Lines, or messages and chunks of a bag, that could not be read and were left out.
    pub malformed: u64,
    /// The reason of the first of these, with file and line.
    pub first_malformed: Option<String>,
    /// Laser readings that came before any odometry; they carry the identity pose. In a bag, also those more than a
    /// second from the nearest odometry; where there is any, they carry the nearest.
    pub laser_without_odometry: u64,
    /// Laser readings of a bag without the pose of the laser; it is taken to be at the robot's origin, facing forward.
    pub laser_without_mounting: u64,
    /// Scans and odometry of a bag are stamped by clocks that differ by so much \[s\]; the times at which the bag's writer
    /// received them counted in place of the stamps.
    pub clocks_differ: Option<f64>,
    /// Laser readings without the angles of their beams, whose number is that of no known laser: 180° were assumed.
    pub guessed_angles: u64,
    /// Stamps lower than the one before.
    pub backward_stamps: u64,
}

/// The inertial sensor of a bag.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct ImuStats {
    /// Its topic.
    pub topic: String,
    /// Messages with a rate of rotation.
    pub messages: u64,
    /// Whether the bag has its mounting; else its z axis was assumed to point up.
    pub is_mounted: bool,
}

/// Names of skipped messages that are counted apart; a damaged file could hold any number.
const MAX_SKIPPED_NAMES: usize = 64;
/// Under this name the others are counted.
const OTHER_NAMES: &str = "(others)";

impl LogStats {
    /// Counts an entry that is handed out; `last_stamp` is that of the entry before.
    pub(crate) fn add(&mut self, entry: &LogEntry, last_stamp: &mut f64) {
        match entry {
            LogEntry::Odometry { .. } => self.odometry += 1,
            LogEntry::Laser(_) => self.laser += 1,
            LogEntry::Turn { .. } => self.turns += 1,
            LogEntry::Truth { .. } => {}
        }
        self.backward_stamps += u64::from(entry.stamp() < *last_stamp);
        *last_stamp = entry.stamp();
    }

    /// Counts what was left out at the last line read.
    pub(crate) fn add_malformed(&mut self, path: &Path, reason: String) {
        self.malformed += 1;
        if self.first_malformed.is_none() {
            let error = LogError::Line { path: path.to_owned(), line: self.lines, reason };
            self.first_malformed = Some(error.to_string());
        }
    }

    pub(crate) fn add_skipped(&mut self, name: &str) {
        let skipped = &mut self.skipped;
        let name = if skipped.len() < MAX_SKIPPED_NAMES || skipped.contains_key(name) { name } else { OTHER_NAMES };
        *skipped.entry(name.to_owned()).or_default() += 1;
    }
}

/// A log that can be read from its start any number of times.
pub trait LogSource: Send + Sync {
    /// What to call the log: the file's name without folder and ending, or the name of a built-in world.
    fn name(&self) -> String;

    /// Starts reading at the first entry.
    ///
    /// # Errors
    /// The file cannot be opened, or is none of this format. An empty log is no error.
    fn open(&self) -> Result<Box<dyn LogReader>, LogError>;

    /// Whether the log may still be coming. Who wants no more of such a log ends it, and has all of it then.
    fn is_live(&self) -> bool {
        false
    }
}

/// The entries of an opened log, in the order of the log.
///
/// After an `Err` the iterator ends: errors here are those that reading cannot go on from.
pub trait LogReader: Iterator<Item = Result<LogEntry, LogError>> + Send {
    /// Counts so far.
    fn stats(&self) -> &LogStats;

    /// Bytes of the file consumed so far and in all, for a progress bar; `None` if the source is no file.
    fn progress(&self) -> Option<(u64, u64)>;
}

/// The odometry and laser readings of a log, each with its number from 0: true poses are no readings.
///
/// # Errors
/// The log cannot be opened; each item, as [`LogReader`].
pub fn readings(source: &dyn LogSource) -> Result<impl Iterator<Item = Result<(usize, LogEntry), LogError>>, LogError> {
    let entries = source.open()?.filter(|entry| entry.as_ref().map_or(true, LogEntry::is_reading));
    Ok(entries.enumerate().map(|(number, entry)| Ok((number, entry?))))
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
