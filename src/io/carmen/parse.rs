//! One line of a CARMEN log as a message, by itself: what came before it is the reader's business.
//!
//! A line must have exactly the fields of its message, so that a line that was cut or run together with another never
//! passes for a whole one. An `Err` is the reason why a line is malformed, for a person to read.

use crate::geometry::{Pose, wrap_angle};

/// Lasers that a log distinguishes: the front one, the rear one, and two more.
pub(super) const LASERS: usize = 4;
const FRONT: usize = 0;
const REAR: usize = 1;

/// Fields after the last value of every message: `ipc_timestamp ipc_hostname logger_timestamp`.
const TAIL: usize = 3;
const POSE: usize = 3;

/// No robot turned further \[rad\]; larger numbers are damage, and lose digits when they are wrapped.
const LARGEST_ANGLE: f64 = 1e6;

/// Longest part of a word that an error message shows \[bytes\].
const SHOWN: usize = 32;
/// Longest name of a message \[bytes\].
const LONGEST_NAME: usize = 32;

/// What a line says.
#[derive(Debug)]
pub(super) enum Message<'a> {
    Odometry {
        stamp: f64,
        odom_from_robot: Pose,
    },
    Truth {
        stamp: f64,
        world_from_robot: Pose,
    },
    Sweep(Sweep),
    Param(Param),
    /// A parameter that nothing here depends on.
    OtherParam,
    /// A message that is not read, by name.
    Other(&'a [u8]),
}

/// A laser message.
#[derive(Debug)]
pub(super) struct Sweep {
    pub(super) laser: usize,
    pub(super) stamp: f64,
    /// `None` in raw messages.
    pub(super) poses: Option<SweepPoses>,
    /// Angle of the first beam and from one to the next; `None` in messages that have only ranges.
    pub(super) angles: Option<(f64, f64)>,
    /// `None` in messages that have no such field.
    pub(super) max_range: Option<f64>,
    pub(super) ranges: Vec<f64>,
}

/// The poses in a laser message, in the order of its fields.
#[derive(Clone, Copy, Debug)]
pub(super) struct SweepPoses {
    pub(super) odom_from_laser: Pose,
    pub(super) odom_from_robot: Pose,
}

/// A parameter of a laser.
#[derive(Clone, Copy, Debug)]
pub(super) struct Param {
    pub(super) laser: usize,
    pub(super) setting: Setting,
    pub(super) value: f64,
}

/// What a parameter sets: mounting in the robot's frame \[m\], \[rad\], maximum range \[m\], field of view \[rad\].
#[derive(Clone, Copy, Debug)]
pub(super) enum Setting {
    Forward,
    Left,
    Heading,
    MaxRange,
    FieldOfView,
    /// In degrees, alone of all.
    AngleStep,
}

const PARAMS: [(&[u8], usize, Setting); 12] = [
    (b"laser_front_laser_fov", FRONT, Setting::FieldOfView),
    (b"laser_front_laser_resolution", FRONT, Setting::AngleStep),
    (b"laser_rear_laser_fov", REAR, Setting::FieldOfView),
    (b"laser_rear_laser_resolution", REAR, Setting::AngleStep),
    (b"robot_frontlaser_offset", FRONT, Setting::Forward),
    (b"robot_frontlaser_side_offset", FRONT, Setting::Left),
    (b"robot_frontlaser_angular_offset", FRONT, Setting::Heading),
    (b"robot_front_laser_max", FRONT, Setting::MaxRange),
    (b"robot_rearlaser_offset", REAR, Setting::Forward),
    (b"robot_rearlaser_side_offset", REAR, Setting::Left),
    (b"robot_rearlaser_angular_offset", REAR, Setting::Heading),
    (b"robot_rear_laser_max", REAR, Setting::MaxRange),
];

/// Angle of the first beam and from one beam to the next \[rad\] of a sweep whose message holds only ranges.
///
/// These are the modes of the lasers that recorded such logs, as CARMEN and GMapping take them:
///
/// | Beams | Step | First beam |
/// |---|---|---|
/// | 180, 181 | 1° | -90° |
/// | 360, 361 | 0.5° | -90° |
/// | 400, 401 | 0.25° | -50° |
/// | 540, 541 | 0.5° | -135° |
/// | 682, 683, 769 | 360°/1024 | half the field to the right |
/// | others | 180°/(beams - 1) | -90° |
pub fn implied_angles(beams: usize) -> (f64, f64) {
    let (first, step) = match beams {
        180 | 181 => (-90.0, 1.0),
        360 | 361 => (-90.0, 0.5),
        400 | 401 => (-50.0, 0.25),
        540 | 541 => (-135.0, 0.5),
        682 | 683 | 769 => (-0.5 * (beams - 1) as f64 * 360.0 / 1024.0, 360.0 / 1024.0),
        _ => (-90.0, 180.0 / beams.saturating_sub(1).max(1) as f64),
    };
    (f64::to_radians(first), f64::to_radians(step))
}

/// Whether [`implied_angles`] knows a laser of this number of beams, or guesses.
pub(super) fn is_known_laser(beams: usize) -> bool {
    matches!(beams, 180 | 181 | 360 | 361 | 400 | 401 | 540 | 541 | 682 | 683 | 769)
}

/// Angle of the first beam and from one beam to the next \[rad\], of a laser whose field of view \[rad\] is known. A step
/// that is known as well decides whether the last beam of a full circle is at its end or a step before it.
pub(super) fn angles_of(beams: usize, field_of_view: f64, step: Option<f64>) -> (f64, f64) {
    let between = beams.saturating_sub(1).max(1) as f64;
    let spread = field_of_view / between;
    let closed = field_of_view / beams as f64;
    let goes_round = field_of_view > std::f64::consts::TAU - 1e-3;
    let step = match step {
        Some(step) if (step - closed).abs() < (step - spread).abs() => closed,
        None if goes_round => closed,
        _ => spread,
    };
    (-0.5 * field_of_view, step)
}

/// A maximum range as [`crate::log::LaserReading`] has it: infinite if the log's number is no limit.
pub(super) fn known_range(range: f64) -> f64 {
    if range > 0.0 { range } else { f64::INFINITY }
}

/// Whether a line begins with the name of a message that CARMEN logs are made of.
pub(super) fn is_carmen(line: &[u8]) -> bool {
    match Fields(line).next() {
        Some(b"SYNC") => true,
        Some(name) => Kind::of(name).is_some(),
        None => false,
    }
}

/// Reads one line, which is neither blank nor a comment.
pub(super) fn parse(line: &[u8]) -> Result<Message<'_>, String> {
    let mut fields = Fields(line);
    let name = fields.word("the name of the message")?;
    match Kind::of(name) {
        Some(Kind::Odometry) => odometry(fields),
        Some(Kind::Truth) => truth(fields),
        Some(Kind::Param) => param(fields),
        Some(Kind::OldLaser(laser)) => old_laser(laser, fields),
        Some(Kind::RobotLaser(laser)) => laser_with_angles(laser, true, fields),
        Some(Kind::RawLaser(laser)) => laser_with_angles(laser, false, fields),
        None if is_name(name) => Ok(Message::Other(name)),
        None => Err(format!("no CARMEN message begins with `{}`", shown(name))),
    }
}

/// The messages that are read.
enum Kind {
    Odometry,
    Truth,
    Param,
    /// Ranges and poses, without angles.
    OldLaser(usize),
    RobotLaser(usize),
    RawLaser(usize),
}

impl Kind {
    fn of(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"ODOM" => Self::Odometry,
            b"TRUEPOS" => Self::Truth,
            b"PARAM" => Self::Param,
            b"FLASER" => Self::OldLaser(FRONT),
            b"RLASER" => Self::OldLaser(REAR),
            b"ROBOTLASER1" => Self::RobotLaser(FRONT),
            b"ROBOTLASER2" => Self::RobotLaser(REAR),
            b"RAWLASER1" => Self::RawLaser(FRONT),
            b"RAWLASER2" => Self::RawLaser(REAR),
            b"RAWLASER3" => Self::RawLaser(2),
            b"RAWLASER4" => Self::RawLaser(3),
            _ => return None,
        })
    }
}

/// Names of messages are in capitals; anything else is damage.
fn is_name(word: &[u8]) -> bool {
    let in_name = |byte: &u8| byte.is_ascii_uppercase() || byte.is_ascii_digit() || *byte == b'_';
    word.len() <= LONGEST_NAME && word[0].is_ascii_uppercase() && word.iter().all(in_name)
}

/// `ODOM x y theta tv rv accel` and the tail.
fn odometry(mut fields: Fields<'_>) -> Result<Message<'_>, String> {
    fields.must_be(POSE + 3 + TAIL)?;
    let odom_from_robot = fields.pose("the pose")?;
    for what in ["tv", "rv", "accel"] {
        fields.number(what)?;
    }
    Ok(Message::Odometry { stamp: fields.tail()?, odom_from_robot })
}

/// `TRUEPOS true_x true_y true_theta odom_x odom_y odom_theta` and the tail.
fn truth(mut fields: Fields<'_>) -> Result<Message<'_>, String> {
    fields.must_be(2 * POSE + TAIL)?;
    let world_from_robot = fields.pose("the true pose")?;
    fields.pose("the odometry pose")?;
    Ok(Message::Truth { stamp: fields.tail()?, world_from_robot })
}

/// `PARAM name value` and whatever follows.
fn param(mut fields: Fields<'_>) -> Result<Message<'_>, String> {
    let name = fields.word("the name of the parameter")?;
    match PARAMS.iter().find(|(known, ..)| *known == name) {
        Some(&(_, laser, setting)) => {
            let what = shown(name);
            let value =
                if matches!(setting, Setting::Heading) { fields.angle(&what)? } else { fields.finite(&what)? };
            Ok(Message::Param(Param { laser, setting, value }))
        }
        None => Ok(Message::OtherParam),
    }
}

/// `FLASER num_readings [ranges] x y theta odom_x odom_y odom_theta` and the tail.
fn old_laser(laser: usize, mut fields: Fields<'_>) -> Result<Message<'_>, String> {
    let beams = fields.beams()?;
    fields.must_be(beams.saturating_add(2 * POSE + TAIL))?;
    let ranges = fields.numbers(beams, "a range")?;
    let poses = Some(fields.poses()?);
    let stamp = fields.tail()?;
    Ok(Message::Sweep(Sweep { laser, stamp, poses, angles: None, max_range: None, ranges }))
}

/// `RAWLASER1 laser_type start_angle field_of_view angular_resolution maximum_range accuracy remission_mode
/// num_readings [ranges] num_remissions [remissions]` and the tail; `ROBOTLASER1` has before the tail
/// `laser_pose_x y theta robot_pose_x y theta laser_tv laser_rv forward_safety_dist side_safety_dist turn_axis`.
fn laser_with_angles(laser: usize, with_poses: bool, mut fields: Fields<'_>) -> Result<Message<'_>, String> {
    fields.number("laser_type")?;
    let first_angle = fields.finite("start_angle")?;
    fields.number("field_of_view")?;
    let angle_step = fields.finite("angular_resolution")?;
    let max_range = Some(known_range(fields.number("maximum_range")?));
    fields.number("accuracy")?;
    fields.number("remission_mode")?;
    let beams = fields.beams()?;
    if angle_step == 0.0 && beams > 1 {
        return Err("angular_resolution is zero".to_owned());
    }
    let left = fields.left();
    if left <= beams {
        return Err(format!("{beams} ranges and more should follow, {left} fields do"));
    }
    let ranges = fields.numbers(beams, "a range")?;
    let remissions = fields.whole_number("num_remissions")?;
    let others = if with_poses { 2 * POSE + 5 } else { 0 };
    fields.must_be(remissions.saturating_add(others + TAIL))?;
    for _ in 0..remissions {
        fields.number("a remission")?;
    }
    let mut poses = None;
    if with_poses {
        poses = Some(fields.poses()?);
        for what in ["laser_tv", "laser_rv", "forward_safety_dist", "side_safety_dist", "turn_axis"] {
            fields.number(what)?;
        }
    }
    let stamp = fields.tail()?;
    let angles = Some((first_angle, angle_step));
    Ok(Message::Sweep(Sweep { laser, stamp, poses, angles, max_range, ranges }))
}

/// The words of a line that were not read yet.
struct Fields<'a>(&'a [u8]);

impl<'a> Iterator for Fields<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let text = self.0.trim_ascii_start();
        let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        let (word, rest) = text.split_at(end);
        self.0 = rest;
        (!word.is_empty()).then_some(word)
    }
}

impl<'a> Fields<'a> {
    fn left(&self) -> usize {
        Fields(self.0).count()
    }

    fn must_be(&self, expected: usize) -> Result<(), String> {
        match self.left() {
            left if left == expected => Ok(()),
            left if left + TAIL == expected => Err(format!(
                "{expected} fields should follow, {left} do: ipc_timestamp, ipc_hostname and logger_timestamp may be missing"
            )),
            left if left + 1 == expected => {
                Err(format!("{expected} fields should follow, {left} do: the ipc_hostname may be empty"))
            }
            left => Err(format!("{expected} fields should follow, {left} do")),
        }
    }

    fn word(&mut self, what: &str) -> Result<&'a [u8], String> {
        self.next().ok_or_else(|| format!("the line ends before {what}"))
    }

    fn number(&mut self, what: &str) -> Result<f64, String> {
        let word = self.word(what)?;
        let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        number.ok_or_else(|| format!("{what} is no number: `{}`", shown(word)))
    }

    fn finite(&mut self, what: &str) -> Result<f64, String> {
        let number = self.number(what)?;
        if number.is_finite() { Ok(number) } else { Err(format!("{what} is not finite: {number}")) }
    }

    /// An angle, wrapped to (-π, π].
    fn angle(&mut self, what: &str) -> Result<f64, String> {
        let angle = self.finite(what)?;
        if angle.abs() <= LARGEST_ANGLE {
            Ok(wrap_angle(angle))
        } else {
            Err(format!("{what} has no angle: {angle:?}"))
        }
    }

    fn whole_number(&mut self, what: &str) -> Result<usize, String> {
        let word = self.word(what)?;
        let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        number.ok_or_else(|| format!("{what} is no whole number: `{}`", shown(word)))
    }

    fn beams(&mut self) -> Result<usize, String> {
        match self.whole_number("num_readings")? {
            0 => Err("the sweep has no beams".to_owned()),
            beams => Ok(beams),
        }
    }

    fn numbers(&mut self, count: usize, what: &str) -> Result<Vec<f64>, String> {
        let mut numbers = Vec::with_capacity(count);
        for _ in 0..count {
            numbers.push(self.number(what)?);
        }
        Ok(numbers)
    }

    fn pose(&mut self, what: &str) -> Result<Pose, String> {
        Ok(Pose { x: self.finite(what)?, y: self.finite(what)?, heading: self.angle(what)? })
    }

    fn poses(&mut self) -> Result<SweepPoses, String> {
        let odom_from_laser = self.pose("the laser's pose")?;
        let odom_from_robot = self.pose("the robot's pose")?;
        Ok(SweepPoses { odom_from_laser, odom_from_robot })
    }

    /// `ipc_timestamp ipc_hostname logger_timestamp`; returns the first.
    fn tail(&mut self) -> Result<f64, String> {
        let stamp = self.finite("ipc_timestamp")?;
        self.word("ipc_hostname")?;
        self.number("logger_timestamp")?;
        Ok(stamp)
    }
}

/// A word as an error message shows it.
fn shown(word: &[u8]) -> String {
    let shown = String::from_utf8_lossy(&word[..word.len().min(SHOWN)]);
    if word.len() > SHOWN { format!("{shown}...") } else { shown.into_owned() }
}
