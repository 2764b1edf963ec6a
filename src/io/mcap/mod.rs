//! Bags of ROS: of ROS 2 in MCAP files (`.mcap`), with chunks packed by zstd, lz4 or not at all, or in SQLite files (`.db3`);
//! and of ROS 1 (`.bag`), also where they were converted to MCAP.
//!
//! In: a file, or the files of a bag one after the other. Out: its odometry and laser sweeps as [`LogEntry`]s in the order
//! of their stamps, metres, radians and seconds, stamped with the messages' `header.stamp`. Messages and chunks that cannot
//! be read are left out and counted in [`LogStats`]. A bag that was cut off is read as far as it goes, and then ends with
//! [`LogError::Read`].
//!
//! | Message | Becomes |
//! |---|---|
//! | `sensor_msgs/msg/LaserScan` | laser |
//! | `nav_msgs/msg/Odometry` | odometry: the pose, seen from above |
//! | `sensor_msgs/msg/Imu` | turns: the rate of rotation about the robot's z axis, summed up from reading to reading |
//! | `tf2_msgs/msg/TFMessage` on `tf_static` | mounting of the laser and of the inertial sensor |
//! | `tf2_msgs/msg/TFMessage` on other topics | odometry, where there are no odometry messages |
//! | others | nothing, counted by topic |
//!
//! # Which topics
//! Topics are found by type; where a bag has several of a type, [`Topics`] says which. Of transforms, odometry is the one
//! from a frame whose name contains `odom` to the robot that carries the laser.
//!
//! # Where a laser is mounted
//! The static transforms between the robot's frame (`child_frame_id` of the odometry) and the laser's (`frame_id` of
//! the scan), any number of them, seen from above. A laser upside down has its angles mirrored; one tilted by more than
//! 20° is refused. Transforms on `/tf` that never change count as static ones do. Where the transforms do not join the two,
//! the laser is taken to be at the robot's origin, facing forward, and is counted in [`LogStats::laser_without_mounting`]. Lasers that
//! take turns on one topic have each the mounting of its `frame_id`. Odometry that does not name its robot is of the frame
//! from which the laser hangs.
//!
//! # Clocks
//! Stamps of scans and odometry are compared with the times at which the bag's writer received the messages. Where the two
//! clocks differ by more than 2 s, or the stamps of one never change, the times of receipt count in place of the stamps
//! ([`LogStats::clocks_differ`]).
//!
//! # Turns by a gyroscope
//! Of inertial sensors the first one counts whose mounting is in the transforms, or the one that [`Topics`] names. Its rates are turned
//! into the robot's frame; where no transforms join the two, its z axis is taken to point up ([`ImuStats::is_mounted`]). A turn stands
//! before the reading that it ends at. It is missing where rates are more than 0.2 s apart or no numbers. A sensor whose clock is not
//! that of the scans is taken to be received as late as they are.
//!
//! # Odometry at a scan
//! Between the messages before and after the stamp of the scan, position and heading change evenly; before the first
//! message and after the last they stand still. A bag without odometry has the robot at the identity. See
//! [`LogStats::laser_without_odometry`].
//!
//! # Sweeps
//! Where `time_increment` shows that a sweep took time, the robot moves during it at the speed of the odometry around it, and
//! [`LaserReading::start_from_end`] says how far.
//!
//! # Ranges
//! Ranges below `range_min` become NaN; `range_max` is the maximum range.

use super::stream::Stream;
use crate::geometry::Pose;
use crate::log::{ImuStats, LaserReading, LogEntry, LogError, LogReader, LogSource, LogStats};
use decode::decode;
use frames::Mounting;
use gyro::Gyro;
use messages::{Header, IMU, Imu, LASER_SCAN, LaserScan, ODOMETRY, Odometry, TRANSFORMS, Transforms, seconds};
use plan::{ImuSource, OdometrySource, Plan, plan};
use records::{Channel, Next};
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;
use storage::{Origin, Storage};
use survey::survey;
use transforms::is_static;

mod clock;
mod decode;
mod frames;
mod gyro;
mod messages;
mod plan;
mod records;
mod ros1;
mod rosbag;
#[cfg(not(target_family = "wasm"))]
mod sqlite;
mod storage;
mod survey;
mod topics;
mod transforms;
mod write;

pub(super) use records::MAGIC;
pub(super) use storage::is_bag;
pub use write::McapWriter;

/// Scans that wait for odometry, and odometry that waits for scans, at most: the one comes without the other.
const MAX_WAITING_SCANS: usize = 256;
const MAX_WAITING_ODOMETRY: usize = 1 << 14;
/// No laser has more; bounds the memory of the scans that wait.
const MAX_BEAMS: usize = 1 << 16;
/// No laser takes longer for a sweep \[s\].
const MAX_SWEEP: f64 = 1.0;
/// Odometry further from a scan than this is not used for it \[ns\].
const ODOMETRY_REACH: i64 = 1_000_000_000;

/// Which topics of a bag to read; without a name the only one of its type.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Topics {
    /// Topics of the laser scans: of several lasers of one robot, which take turns.
    pub scan: Vec<String>,
    /// Topic of the odometry: of odometry messages or of transforms.
    pub odometry: Option<String>,
    /// Topic of the inertial sensor.
    pub imu: ImuTopic,
}

/// Which inertial sensor to read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ImuTopic {
    /// The one that is there; of several the first whose mounting is known.
    #[default]
    Any,
    /// None of them.
    None,
    /// That on this topic.
    Named(String),
}

impl ImuTopic {
    /// A topic, or `none`.
    pub fn named(text: &str) -> Self {
        if text == "none" { Self::None } else { Self::Named(text.to_owned()) }
    }
}

/// Frames of ROS, without a leading slash.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FrameNames {
    /// That of the odometry; `None` where there is none.
    pub odom: Option<String>,
    /// That of the robot: of which the odometry is, or from which the laser hangs.
    pub robot: String,
}

/// The log in an MCAP file, or in several.
#[derive(Clone, Debug)]
pub struct McapLog {
    path: PathBuf,
    origin: Origin,
    plan: Arc<Plan>,
}

impl McapLog {
    /// The log in this file, which is read once to find its topics and where its laser is mounted.
    ///
    /// # Errors
    /// The file cannot be opened or is no MCAP file ([`LogError::Open`]), breaks off before its first message
    /// ([`LogError::Read`]), or has no scans, several choices of topics, or a tilted laser ([`LogError::Bag`]).
    pub fn new(path: impl Into<PathBuf>, topics: &Topics) -> Result<Self, LogError> {
        let path = path.into();
        Self::of_files(path.clone(), vec![path], topics)
    }

    /// The log in several files of one bag, in the order of their time; `path` stands for all of them.
    ///
    /// # Errors
    /// As for [`Self::new`].
    pub fn of_files(path: PathBuf, files: Vec<PathBuf>, topics: &Topics) -> Result<Self, LogError> {
        Self::of(path, Origin::Files(files), topics)
    }

    /// The log in the bytes of a file; `path` names it.
    pub(super) fn of_bytes(path: PathBuf, bytes: Arc<[u8]>, topics: &Topics) -> Result<Self, LogError> {
        Self::of(path, Origin::Memory(bytes), topics)
    }

    /// The log in MCAP that comes through a stream: its topics and transforms are those of the first five seconds of scans, which
    /// are waited for. `path` stands for it in errors.
    ///
    /// # Errors
    /// As for [`Self::new`].
    pub fn of_stream(path: PathBuf, stream: Stream, topics: &Topics) -> Result<Self, LogError> {
        Self::of(path, Origin::Stream(stream), topics)
    }

    /// The frames that the robot's own topics name.
    pub fn frames(&self) -> &FrameNames {
        &self.plan.frames
    }

    fn of(path: PathBuf, origin: Origin, topics: &Topics) -> Result<Self, LogError> {
        let found = survey(&path, &origin)?;
        let plan = plan(&found, topics).map_err(|reason| LogError::Bag { path: path.clone(), reason })?;
        let plan = Arc::new(plan);
        Ok(Self { path, origin, plan })
    }
}

impl LogSource for McapLog {
    fn name(&self) -> String {
        match &self.origin {
            Origin::Files(_) | Origin::Memory(_) => {
                self.path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
            }
            Origin::Stream(stream) => stream.name(),
        }
    }

    fn open(&self) -> Result<Box<dyn LogReader>, LogError> {
        let open_error = |source| LogError::Open { path: self.path.clone(), source };
        Ok(Box::new(McapReader {
            path: self.path.clone(),
            plan: Arc::clone(&self.plan),
            records: Storage::open(&self.origin).map_err(open_error)?,
            odometry: VecDeque::new(),
            scans: VecDeque::new(),
            gyro: Gyro::default(),
            behind_turn: None,
            last_odometry: None,
            broke_off: None,
            drained: false,
            ended: false,
            last_stamp: f64::NEG_INFINITY,
            stats: LogStats {
                clocks_differ: self.plan.clocks_differ.map(|nanoseconds| nanoseconds as f64 / 1e9),
                imu: self.plan.imu.as_ref().map(|ImuSource { topic, is_mounted, .. }| ImuStats {
                    topic: topic.clone(),
                    messages: 0,
                    is_mounted: *is_mounted,
                }),
                ..LogStats::default()
            },
        }))
    }

    fn is_live(&self) -> bool {
        matches!(self.origin, Origin::Stream(_))
    }
}

/// Where odometry believes the robot to be, at a stamp \[ns\].
#[derive(Clone, Copy, Debug)]
struct StampedOdometry {
    stamp: i64,
    odom_from_robot: Pose,
}

/// The entries of a bag.
///
/// Scans arrive later than odometry of the same stamp, and odometry after a scan is needed for it. So each waits until
/// the other has come as far.
#[derive(Debug)]
struct McapReader {
    path: PathBuf,
    plan: Arc<Plan>,
    records: Storage,
    /// Odometry that was read and not handed out, in the order of the file.
    odometry: VecDeque<StampedOdometry>,
    /// Scans that were read and not handed out, with their stamps and how long they took \[ns\], without odometry.
    scans: VecDeque<(i64, i64, LaserReading)>,
    gyro: Gyro,
    /// The reading whose turn was handed out.
    behind_turn: Option<LogEntry>,
    /// The last odometry that was handed out.
    last_odometry: Option<StampedOdometry>,
    /// Why nothing more can be read.
    broke_off: Option<std::io::Error>,
    /// Nothing more is to be read.
    drained: bool,
    ended: bool,
    last_stamp: f64,
    stats: LogStats,
}

impl McapReader {
    /// The next entry; `None` at the end of the log.
    fn next_entry(&mut self) -> Result<Option<LogEntry>, LogError> {
        loop {
            if let Some(entry) = self.behind_turn.take().or_else(|| self.ready()) {
                self.stats.add(&entry, &mut self.last_stamp);
                return Ok(Some(entry));
            }
            if self.drained {
                let (path, line) = (self.path.clone(), self.stats.lines);
                return self.broke_off.take().map_or(Ok(None), |source| Err(LogError::Read { path, line, source }));
            }
            match self.records.next() {
                Ok(Next::Message { channel, received, data }) => {
                    self.stats.lines += 1;
                    if let Err(reason) = self.take(&channel, received, &data) {
                        self.stats.add_malformed(&self.path, format!("{:.100}: {reason}", channel.topic));
                    }
                }
                Ok(Next::Damage(reason)) => self.stats.add_malformed(&self.path, reason),
                Ok(Next::End) => self.drained = true,
                Err(source) => {
                    self.drained = true;
                    self.broke_off = (!self.records.was_stopped()).then_some(source);
                }
            }
        }
    }

    /// Queues a message; `Err` holds why it is malformed.
    fn take(&mut self, channel: &Channel, received: i64, data: &[u8]) -> Result<(), String> {
        let plan = Arc::clone(&self.plan);
        let stamp_of = |header: &Header| if plan.clocks_differ.is_some() { Ok(received) } else { header.stamp() };
        match &plan.odometry {
            OdometrySource::Messages { topic } if *topic == channel.topic && channel.schema == ODOMETRY => {
                let message: Odometry = decode(channel, data)?;
                let (stamp, odom_from_robot) = (stamp_of(&message.header)?, message.pose.pose()?);
                self.odometry.push_back(StampedOdometry { stamp, odom_from_robot });
            }
            OdometrySource::Transforms { odom, robot, .. }
                if channel.schema == TRANSFORMS && !is_static(&channel.topic) =>
            {
                let message: Transforms = decode(channel, data)?;
                for stamped in &message.transforms {
                    if stamped.header.frame() == odom && stamped.child_frame() == robot {
                        let (stamp, odom_from_robot) = (stamp_of(&stamped.header)?, stamped.transform.pose()?);
                        self.odometry.push_back(StampedOdometry { stamp, odom_from_robot });
                    }
                }
            }
            _ if plan.scan_topics.contains(&channel.topic) && channel.schema == LASER_SCAN => {
                let message: LaserScan = decode(channel, data)?;
                let stamp = stamp_of(&message.header)?;
                let mounting = plan.mountings.get(message.header.frame()).copied().flatten();
                let reading = reading(stamp, &message, mounting)?;
                self.stats.laser_without_mounting += u64::from(mounting.is_none());
                // Several lasers are received in any order; what one tells stays in its own.
                let is_before = |waiting: &(i64, i64, LaserReading)| plan.scan_topics.len() == 1 || waiting.0 <= stamp;
                let place = self.scans.iter().rposition(is_before).map_or(0, |before| before + 1);
                self.scans.insert(place, (stamp, duration(&message), reading));
            }
            _ if channel.schema == IMU => match &plan.imu {
                Some(imu) if imu.topic == channel.topic => {
                    let message: Imu = decode(channel, data)?;
                    let stamp = match imu.late {
                        Some(late) if plan.clocks_differ.is_none() => received.saturating_sub(late),
                        _ => stamp_of(&message.header)?,
                    };
                    self.gyro.add(stamp, message.rate_about(&imu.up)?);
                    self.stats.imu.iter_mut().for_each(|imu| imu.messages += 1);
                }
                _ => self.stats.add_skipped(&channel.topic),
            },
            _ if channel.schema == TRANSFORMS && is_static(&channel.topic) => {}
            _ => self.stats.add_skipped(&channel.topic),
        }
        Ok(())
    }

    /// The earliest entry that waits, if nothing can come before it and all that it needs is there.
    fn ready(&mut self) -> Option<LogEntry> {
        let no_scan_comes = self.drained || self.odometry.len() > MAX_WAITING_ODOMETRY;
        let no_odometry_comes = self.drained
            || self.scans.len() > MAX_WAITING_SCANS
            || matches!(self.plan.odometry, OdometrySource::Nowhere);
        let scan_is_next = match (self.odometry.front(), self.scans.front()) {
            (Some(odometry), Some((stamp, ..))) => *stamp < odometry.stamp,
            (Some(_), None) if no_scan_comes => false,
            (None, Some(_)) if no_odometry_comes => true,
            _ => return None,
        };
        let stamp = if scan_is_next { self.scans.front()?.0 } else { self.odometry.front()?.stamp };
        let newest =
            self.scans.back().map(|(newest, ..)| *newest).max(self.odometry.back().map(|newest| newest.stamp))?;
        let is_full = self.scans.len() > MAX_WAITING_SCANS || self.odometry.len() > MAX_WAITING_ODOMETRY;
        if !self.drained && !is_full && self.gyro.is_awaited(stamp, newest) {
            return None;
        }
        let entry = if scan_is_next {
            let (_, duration, mut reading) = self.scans.pop_front()?;
            reading.odom_from_robot = self.odometry_at(stamp);
            reading.start_from_end = self.motion_in(duration);
            LogEntry::Laser(reading)
        } else {
            let odometry = self.odometry.pop_front()?;
            self.last_odometry = Some(odometry);
            LogEntry::Odometry { stamp: seconds(odometry.stamp), odom_from_robot: odometry.odom_from_robot }
        };
        let Some(by_gyro) = self.gyro.turn(stamp) else { return Some(entry) };
        self.behind_turn = Some(entry);
        Some(LogEntry::Turn { stamp: seconds(stamp), by_gyro })
    }

    /// Where the robot was at the stamp of a scan that comes after all odometry handed out and before all that waits.
    fn odometry_at(&mut self, stamp: i64) -> Pose {
        let (before, after) = (self.last_odometry, self.odometry.front().copied());
        let is_near = |odometry: &StampedOdometry| odometry.stamp.abs_diff(stamp) <= ODOMETRY_REACH.unsigned_abs();
        let some_is_near = before.is_some() && before.iter().chain(&after).any(is_near);
        self.stats.laser_without_odometry += u64::from(!some_is_near);
        match (before, after) {
            (None, None) => Pose::IDENTITY,
            (Some(only), None) | (None, Some(only)) => only.odom_from_robot,
            (Some(before), Some(after)) => between(before, after, stamp),
        }
    }
}

impl McapReader {
    /// The motion in so long a time \[ns\] after a scan, at the speed of the odometry around it.
    fn motion_in(&self, duration: i64) -> Pose {
        let (Some(before), Some(after)) = (self.last_odometry, self.odometry.front()) else { return Pose::IDENTITY };
        let between = after.stamp.saturating_sub(before.stamp);
        if duration == 0 || between <= 0 || between > ODOMETRY_REACH {
            return Pose::IDENTITY;
        }
        let Pose { x, y, heading } = after.odom_from_robot.seen_from(before.odom_from_robot);
        let share = duration as f64 / between as f64;
        let motion = Pose { x: share * x, y: share * y, heading: share * heading };
        if motion.is_finite() { motion } else { Pose::IDENTITY }
    }
}

impl Iterator for McapReader {
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

impl LogReader for McapReader {
    fn stats(&self) -> &LogStats {
        &self.stats
    }

    fn progress(&self) -> Option<(u64, u64)> {
        self.records.progress()
    }
}

/// How long a sweep takes from its first beam to its last \[ns\]; 0 where that cannot be.
fn duration(message: &LaserScan) -> i64 {
    let seconds = f64::from(message.time_increment) * message.ranges.len().saturating_sub(1) as f64;
    if (0.0..=MAX_SWEEP).contains(&seconds) { (seconds * 1e9) as i64 } else { 0 }
}

/// The sweep of a message, seen by the robot that carries the laser; its odometry comes later.
fn reading(stamp: i64, message: &LaserScan, mounting: Option<Mounting>) -> Result<LaserReading, String> {
    let beams = message.ranges.len();
    if beams == 0 || beams > MAX_BEAMS {
        return Err(format!("it has {beams} ranges, not 1 to {MAX_BEAMS}"));
    }
    let (first_angle, angle_step) = (f64::from(message.angle_min), f64::from(message.angle_increment));
    if !first_angle.is_finite() || !angle_step.is_finite() || (angle_step == 0.0 && beams > 1) {
        return Err(format!("its angles cannot be: angle_min {first_angle}, angle_increment {angle_step}"));
    }
    let Mounting { robot_from_laser, upside_down } =
        mounting.unwrap_or(Mounting { robot_from_laser: Pose::IDENTITY, upside_down: false });
    let side = if upside_down { -1.0 } else { 1.0 };
    let valid = |&range: &f32| if range < message.range_min { f64::NAN } else { f64::from(range) };
    Ok(LaserReading {
        stamp: seconds(stamp),
        odom_from_robot: Pose::IDENTITY,
        robot_from_laser,
        start_from_end: Pose::IDENTITY,
        first_angle: side * first_angle,
        angle_step: side * angle_step,
        max_range: if message.range_max > 0.0 { f64::from(message.range_max) } else { f64::INFINITY },
        ranges: message.ranges.iter().map(valid).collect(),
    })
}

/// The pose on an even way from one to the other.
fn between(before: StampedOdometry, after: StampedOdometry, stamp: i64) -> Pose {
    if stamp <= before.stamp {
        return before.odom_from_robot;
    }
    let share = (stamp - before.stamp) as f64 / (after.stamp - before.stamp) as f64;
    before.odom_from_robot.interpolated(after.odom_from_robot, share)
}
