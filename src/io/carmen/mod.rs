//! CARMEN logs (`.clf`, `.log`): text with one message a line, plain or gzip.
//!
//! In: a file. Out: its odometry, laser sweeps and true poses as [`LogEntry`]s, in the order of the lines, metres,
//! radians and seconds, stamped with the message's `ipc_timestamp`. The log is streamed, so memory does not grow with
//! it. Lines that cannot be read are left out and counted in [`LogStats`].
//!
//! | Message | Becomes |
//! |---|---|
//! | `ODOM` | odometry |
//! | `FLASER`, `RLASER` | laser, angles implied by the number of beams ([`implied_angles`]), no maximum range |
//! | `ROBOTLASER1`, `ROBOTLASER2` | laser, with angles, maximum range and poses of its own |
//! | `RAWLASER1` .. `RAWLASER4` | laser, with angles and maximum range of its own, at the last odometry before it |
//! | `TRUEPOS` | truth |
//! | `PARAM` | mounting and maximum range of the lasers; other parameters do nothing |
//! | others | nothing, counted by name |
//!
//! # Where a laser is mounted
//! A message with two poses has the laser's first and the robot's second: `robot_from_laser` is the first seen from the
//! second. Where the two are equal, and in `RAWLASER` messages, it is the mounting in the log's parameters
//! (`robot_frontlaser_offset`, metres forward, `robot_frontlaser_side_offset`, metres to the left,
//! `robot_frontlaser_angular_offset`, radians, the same for `rearlaser`): programs that rewrite logs put the robot's
//! pose in both places. Without parameters a laser is at the robot's origin, facing forward; the second one
//! (`RLASER`, `ROBOTLASER2`, `RAWLASER2`) faces backward.
//!
//! # Maximum range
//! `robot_front_laser_max` and `robot_rear_laser_max` \[m\] where a log has them, for `FLASER` and `RLASER`; otherwise
//! infinite. The other messages carry their own; one that is not above zero means unknown, which is infinite.
//!
//! # One sweep, two messages
//! CARMEN's logger can write a sweep twice, as `RAWLASER1` and as `FLASER` or `ROBOTLASER1` (`RAWLASER2`: `RLASER` or
//! `ROBOTLASER2`). Once the message with poses was seen, the raw one is skipped and counted.

use crate::geometry::Pose;
use crate::log::{LaserReading, LogEntry, LogError, LogReader, LogSource, LogStats};
use input::{Input, Line};
use parse::{LASERS, Message, Param, Setting, Sweep};
use std::f64::consts::PI;
use std::fs::File;
use std::io::{Cursor, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

mod input;
mod parse;
mod write;

pub use parse::implied_angles;
pub use write::CarmenWriter;

/// A file whose first 1000 lines, blank ones and comments aside, hold no CARMEN message is no CARMEN log.
const LINES_TO_RECOGNISE: u64 = 1000;

/// Editors on Windows put it before a text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

const EXPECTED: &str = "a CARMEN log is needed: text, plain or gzip, one message a line (FLASER, RLASER, ROBOTLASER1, \
                        RAWLASER1, ODOM, ...), or a bag of ROS; give such a file or convert this one";

/// A CARMEN log in a file.
#[derive(Clone, Debug)]
pub struct CarmenLog {
    path: PathBuf,
    /// What the file holds, where it is in memory.
    bytes: Option<Arc<[u8]>>,
    field_of_view: Option<f64>,
}

impl CarmenLog {
    /// The log in this file; nothing is opened yet.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), bytes: None, field_of_view: None }
    }

    /// The log in the bytes of a file; `path` names it.
    pub(super) fn of_bytes(path: PathBuf, bytes: Arc<[u8]>) -> Self {
        Self { path, bytes: Some(bytes), field_of_view: None }
    }

    /// The same log, in which sweeps that hold only ranges are spread over this angle \[rad\], the middle one ahead.
    pub fn with_field_of_view(self, field_of_view: f64) -> Self {
        Self { field_of_view: Some(field_of_view), ..self }
    }
}

impl LogSource for CarmenLog {
    fn name(&self) -> String {
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let name = name.strip_suffix(".gz").unwrap_or(&name);
        Path::new(name).file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }

    fn open(&self) -> Result<Box<dyn LogReader>, LogError> {
        if let Some(bytes) = &self.bytes {
            let reader = CarmenReader::from_reader(&self.path, Cursor::new(Arc::clone(bytes)))?;
            let reader = reader.with_field_of_view(self.field_of_view);
            return Ok(Box::new(CarmenReader { length: Some(bytes.len() as u64), ..reader }));
        }
        let failed = |source| LogError::Open { path: self.path.clone(), source };
        let file = File::open(&self.path).map_err(failed)?;
        let metadata = file.metadata().map_err(failed)?;
        if metadata.is_dir() {
            return Err(failed(std::io::Error::new(ErrorKind::IsADirectory, "a folder; name a log file inside it")));
        }
        let mut reader = CarmenReader::from_reader(&self.path, file)?.with_field_of_view(self.field_of_view);
        reader.length = metadata.is_file().then_some(metadata.len());
        Ok(Box::new(reader))
    }
}

/// The mounting and range of a laser, by the log's parameters.
#[derive(Clone, Copy, Debug)]
struct Mounting {
    robot_from_laser: Pose,
    max_range: f64,
    /// \[rad\].
    field_of_view: Option<f64>,
    /// \[rad\].
    angle_step: Option<f64>,
}

/// The entries of a CARMEN log.
///
/// [`LogError::NotThisFormat`] comes out when 1000 lines, or all of a shorter file, hold no CARMEN message.
#[derive(Debug)]
pub struct CarmenReader {
    path: PathBuf,
    input: Input,
    length: Option<u64>,
    ended: bool,
    recognised: bool,
    unrecognised_lines: u64,
    mountings: [Mounting; LASERS],
    /// As set by the user \[rad\].
    field_of_view: Option<f64>,
    /// Lasers whose sweeps came with poses.
    posed: [bool; LASERS],
    odom_from_robot: Option<Pose>,
    last_stamp: f64,
    stats: LogStats,
}

impl CarmenReader {
    /// Reads a log from anything that holds its bytes, plain or gzip; `path` names it in errors.
    ///
    /// # Errors
    /// The first bytes cannot be read, or are those of another format.
    pub fn from_reader(path: impl Into<PathBuf>, bytes: impl Read + Send + 'static) -> Result<Self, LogError> {
        let path = path.into();
        let input = match Input::new(bytes) {
            Ok(input) => input,
            Err(source) => return Err(LogError::Read { path, line: 0, source }),
        };
        let forward = Mounting {
            robot_from_laser: Pose::IDENTITY,
            max_range: f64::INFINITY,
            field_of_view: None,
            angle_step: None,
        };
        let backward = Mounting { robot_from_laser: Pose::new(0.0, 0.0, PI), ..forward };
        Ok(Self {
            path,
            input,
            length: None,
            ended: false,
            recognised: false,
            unrecognised_lines: 0,
            mountings: [forward, backward, forward, forward],
            field_of_view: None,
            posed: [false; LASERS],
            odom_from_robot: None,
            last_stamp: f64::NEG_INFINITY,
            stats: LogStats::default(),
        })
    }

    /// As for [`CarmenLog::with_field_of_view`], where there is one.
    pub(super) fn with_field_of_view(self, field_of_view: Option<f64>) -> Self {
        Self { field_of_view, ..self }
    }

    /// The next entry; `None` at the end of the log.
    fn next_entry(&mut self) -> Result<Option<LogEntry>, LogError> {
        let mut line = Vec::new();
        loop {
            let read = self.input.read_line(&mut line);
            let read =
                read.map_err(|source| LogError::Read { path: self.path.clone(), line: self.stats.lines, source })?;
            let understood = match read {
                Line::End if self.recognised => return Ok(None),
                Line::End => return Err(self.not_carmen()),
                Line::TooLong => {
                    self.stats.lines += 1;
                    if !self.recognised {
                        return Err(self.not_carmen());
                    }
                    Err(format!("the line is longer than {} bytes", input::MAX_LINE))
                }
                Line::Whole => {
                    self.stats.lines += 1;
                    let text = line.strip_prefix(BYTE_ORDER_MARK).filter(|_| self.stats.lines == 1).unwrap_or(&line);
                    let text = text.trim_ascii();
                    if text.is_empty() || text.starts_with(b"#") {
                        continue;
                    }
                    self.recognise(text)?;
                    parse::parse(text).and_then(|message| self.understand(message))
                }
            };
            match understood {
                Ok(Some(entry)) => {
                    self.stats.add(&entry, &mut self.last_stamp);
                    return Ok(Some(entry));
                }
                Ok(None) => {}
                Err(reason) => self.stats.add_malformed(&self.path, reason),
            }
        }
    }

    fn recognise(&mut self, text: &[u8]) -> Result<(), LogError> {
        if !self.recognised {
            self.recognised = parse::is_carmen(text);
            self.unrecognised_lines += 1;
            if !self.recognised && self.unrecognised_lines == LINES_TO_RECOGNISE {
                return Err(self.not_carmen());
            }
        }
        Ok(())
    }

    fn not_carmen(&self) -> LogError {
        let reason = match self.stats.lines {
            0 => "the file is empty".to_owned(),
            lines => format!("no CARMEN message in the first {lines} lines"),
        };
        LogError::NotThisFormat { path: self.path.clone(), reason, expected: EXPECTED }
    }

    /// The entry of a message, given those before it; `Err` holds why its line is malformed.
    fn understand(&mut self, message: Message<'_>) -> Result<Option<LogEntry>, String> {
        match message {
            Message::Odometry { stamp, odom_from_robot } => {
                self.odom_from_robot = Some(odom_from_robot);
                Ok(Some(LogEntry::Odometry { stamp, odom_from_robot }))
            }
            Message::Truth { stamp, world_from_robot } => Ok(Some(LogEntry::Truth { stamp, world_from_robot })),
            Message::Sweep(sweep) => Ok(self.reading(sweep)?.map(LogEntry::Laser)),
            Message::Param(param) => {
                self.set(param);
                Ok(None)
            }
            Message::Other(name) => {
                self.stats.add_skipped(&String::from_utf8_lossy(name));
                Ok(None)
            }
            Message::OtherParam => Ok(None),
        }
    }

    fn reading(&mut self, sweep: Sweep) -> Result<Option<LaserReading>, String> {
        let mounting = self.mountings[sweep.laser];
        let (odom_from_robot, robot_from_laser) = match sweep.poses {
            Some(poses) if poses.odom_from_laser == poses.odom_from_robot => {
                (poses.odom_from_robot, mounting.robot_from_laser)
            }
            Some(poses) => (poses.odom_from_robot, poses.odom_from_laser.seen_from(poses.odom_from_robot)),
            None if self.posed[sweep.laser] => {
                self.stats.add_skipped(&format!("RAWLASER{}", sweep.laser + 1));
                return Ok(None);
            }
            None => (self.odom_from_robot.unwrap_or(Pose::IDENTITY), mounting.robot_from_laser),
        };
        if !robot_from_laser.is_finite() {
            return Err("laser and robot are too far apart".to_owned());
        }
        if sweep.poses.is_some() {
            self.posed[sweep.laser] = true;
            self.odom_from_robot = Some(odom_from_robot);
        } else if self.odom_from_robot.is_none() {
            self.stats.laser_without_odometry += 1;
        }
        let (first_angle, angle_step) = sweep.angles.unwrap_or_else(|| self.angles(mounting, sweep.ranges.len()));
        Ok(Some(LaserReading {
            stamp: sweep.stamp,
            odom_from_robot,
            robot_from_laser,
            start_from_end: Pose::IDENTITY,
            first_angle,
            angle_step,
            max_range: sweep.max_range.unwrap_or(mounting.max_range),
            ranges: sweep.ranges,
        }))
    }

    /// The angles of a sweep whose message holds only ranges: as set by the user or the log, or as lasers of this number of beams
    /// have them.
    fn angles(&mut self, mounting: Mounting, beams: usize) -> (f64, f64) {
        let implied = implied_angles(beams);
        match self.field_of_view.or(mounting.field_of_view) {
            Some(field_of_view) => {
                let angles = parse::angles_of(beams, field_of_view, mounting.angle_step);
                // The log's own digits of π are no reason to turn the beams.
                let is_implied = (angles.0 - implied.0).abs() < 1e-4 && (angles.1 - implied.1).abs() < 1e-6;
                if is_implied { implied } else { angles }
            }
            None => {
                self.stats.guessed_angles += u64::from(!parse::is_known_laser(beams));
                implied
            }
        }
    }

    fn set(&mut self, param: Param) {
        let mounting = &mut self.mountings[param.laser];
        match param.setting {
            Setting::Forward => mounting.robot_from_laser.x = param.value,
            Setting::Left => mounting.robot_from_laser.y = param.value,
            Setting::Heading => mounting.robot_from_laser.heading = param.value,
            Setting::MaxRange => mounting.max_range = parse::known_range(param.value),
            Setting::FieldOfView => mounting.field_of_view = Some(param.value).filter(|&field| field > 0.0),
            Setting::AngleStep => mounting.angle_step = Some(param.value.to_radians()).filter(|&step| step > 0.0),
        }
    }
}

impl Iterator for CarmenReader {
    type Item = Result<LogEntry, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let entry = self.next_entry().transpose();
        self.ended = !matches!(entry, Some(Ok(_)));
        entry
    }
}

impl LogReader for CarmenReader {
    fn stats(&self) -> &LogStats {
        &self.stats
    }

    fn progress(&self) -> Option<(u64, u64)> {
        self.length.map(|length| (self.input.consumed(), length))
    }
}
