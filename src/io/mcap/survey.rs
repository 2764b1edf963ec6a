//! The first pass over a bag: which topics make the log, and how its laser is mounted.

use super::Topics;
use super::frames::{Frames, Mounting};
use super::messages::{self, LASER_SCAN, LaserScan, ODOMETRY, Odometry, TRANSFORMS, Transforms};
use super::records::{Channel, Next};
use super::storage::Storage;
use crate::log::LogError;
use nalgebra::Isometry3;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Topics that are kept apart, and pairs of moving frames; a damaged file could hold any number.
const MAX_NAMES: usize = 10_000;
/// Lasers that take turns on one topic, at most.
const MAX_FRAMES: usize = 16;
/// Topics that an error lists.
const SHOWN: usize = 20;

/// Where the entries of a log are to be found in a bag.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) scan_topic: String,
    pub(super) odometry: OdometrySource,
    /// Of each frame that scans come from; `None` where the bag does not tell.
    pub(super) mountings: BTreeMap<String, Option<Mounting>>,
    /// Stamps of scans and odometry are those of clocks that differ by so much \[ns\], or of none: the times at which messages
    /// were received count in their place.
    pub(super) clocks_differ: Option<i64>,
}

#[derive(Debug)]
pub(super) enum OdometrySource {
    /// Messages of type [`ODOMETRY`].
    Messages { topic: String },
    /// Transforms between two frames, on any topic that is not static; this is one of them.
    Transforms { topic: String, odom: String, robot: String },
    /// The bag has none.
    Nowhere,
}

/// Reads a bag to its end, or as far as it goes.
///
/// # Errors
/// The bag cannot be opened, or it is not clear which of its topics make the log.
pub(super) fn survey(path: &Path, files: Vec<PathBuf>, topics: &Topics) -> Result<Plan, LogError> {
    let open_error = |source| LogError::Open { path: path.to_owned(), source };
    let mut records = Storage::open(files).map_err(open_error)?;
    let mut found = Survey::default();
    let (mut messages, mut first_damage) = (0, None);
    let broke_off = loop {
        match records.next() {
            Ok(Next::Message { channel, received, data }) => {
                messages += 1;
                found.add(&channel, received, &data);
            }
            // Where there is more, the second pass counts and tells it.
            Ok(Next::Damage(reason)) => _ = first_damage.get_or_insert(reason),
            Ok(Next::End) => break None,
            Err(source) => break Some(source),
        }
    };
    let bag_error = |reason| LogError::Bag { path: path.to_owned(), reason };
    match (first_damage, broke_off) {
        (Some(reason), _) if messages == 0 => Err(bag_error(format!("no message can be read; {reason}"))),
        (None, Some(source)) if messages == 0 => Err(LogError::Read { path: path.to_owned(), line: 0, source }),
        _ => found.plan(topics).map_err(bag_error),
    }
}

/// Whether a topic tells transforms that never change.
pub(super) fn is_static(topic: &str) -> bool {
    last_name(topic) == "tf_static"
}

fn last_name(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or(name)
}

/// What a bag holds.
#[derive(Default)]
struct Survey {
    topics: BTreeMap<String, Topic>,
    fixed: Frames,
    /// Topic, parent and child of the transforms that are sent again and again.
    moving: BTreeMap<(String, String, String), Repeated>,
}

/// A transform that is sent again and again.
#[derive(Clone, Copy)]
struct Repeated {
    first: Isometry3<f64>,
    is_constant: bool,
    times: u64,
}

/// A topic that has messages.
struct Topic {
    schema: String,
    encoding: String,
    messages: u64,
    /// The frames whose readings these are: of lasers, or of the robot.
    frames: BTreeSet<String>,
    clock: Clock,
}

/// The stamps of a topic beside the times at which its messages were received \[ns\].
#[derive(Clone, Copy, Default)]
struct Clock {
    stamps: Option<Span>,
    received: Option<Span>,
    /// Least of the times from a stamp to the receipt.
    delay: Option<i64>,
}

/// The least and the greatest of some times \[ns\].
#[derive(Clone, Copy)]
struct Span(i64, i64);

impl Span {
    fn with(span: Option<Self>, time: i64) -> Option<Self> {
        Some(span.map_or(Self(time, time), |Self(least, greatest)| Self(least.min(time), greatest.max(time))))
    }

    const fn length(self) -> i64 {
        self.1.saturating_sub(self.0)
    }
}

impl Clock {
    fn add(&mut self, stamp: i64, received: i64) {
        self.stamps = Span::with(self.stamps, stamp);
        self.received = Span::with(self.received, received);
        let delay = received.saturating_sub(stamp);
        self.delay = Some(self.delay.map_or(delay, |least| least.min(delay)));
    }

    /// Whether the stamps ever change.
    fn runs(&self) -> bool {
        self.stamps.is_some_and(|stamps| stamps.length() > 0)
    }

    /// Whether the times of receipt are those of a drive: a program that writes a bag may number its messages instead.
    fn receipt_runs(&self) -> bool {
        let stamped = self.stamps.map_or(0, Span::length);
        self.received.is_some_and(|received| received.length() > 0 && received.length() >= stamped / 2)
    }

    /// How far two clocks are apart, where stamps by them cannot be compared but times of receipt can.
    fn differs_from(&self, other: &Self) -> Option<i64> {
        let apart = self.delay?.saturating_sub(other.delay?);
        let comparable = self.runs() && other.runs() && apart.unsigned_abs() <= CLOCKS_AGREE.unsigned_abs();
        (!comparable && self.receipt_runs() && other.receipt_runs()).then_some(apart)
    }
}

/// Stamps of one clock are received sooner than this, or as late as one another \[ns\].
const CLOCKS_AGREE: i64 = 2_000_000_000;
/// A transform that is sent as often and never changes is no odometry: the robot would have stood all the time.
const ALWAYS_THE_SAME: u64 = 20;

impl Survey {
    fn add(&mut self, channel: &Channel, received: i64, data: &[u8]) {
        if !self.topics.contains_key(&channel.topic) {
            if self.topics.len() == MAX_NAMES {
                return;
            }
            let (schema, encoding) = (channel.schema.clone(), channel.encoding.clone());
            self.topics.insert(
                channel.topic.clone(),
                Topic { schema, encoding, messages: 0, frames: BTreeSet::new(), clock: Clock::default() },
            );
        }
        let Some(topic) = self.topics.get_mut(&channel.topic) else { return };
        topic.messages += 1;
        let mut add = |stamp: Result<i64, String>, frame: &str| {
            if let Ok(stamp) = stamp {
                topic.clock.add(stamp, received);
            }
            if topic.frames.len() < MAX_FRAMES && !topic.frames.contains(frame) {
                topic.frames.insert(frame.to_owned());
            }
        };
        match &*channel.schema {
            LASER_SCAN => {
                if let Ok(scan) = messages::decode::<LaserScan>(data) {
                    add(scan.header.stamp(), scan.header.frame());
                }
            }
            ODOMETRY => {
                if let Ok(odometry) = messages::decode::<Odometry>(data) {
                    add(odometry.header.stamp(), odometry.child_frame());
                }
            }
            TRANSFORMS => {
                if let Ok(message) = messages::decode::<Transforms>(data) {
                    // Of many frames one tells the clock of the topic.
                    if let Some(stamped) = message.transforms.first() {
                        add(stamped.header.stamp(), "");
                    }
                    self.add_transforms(&channel.topic, &message);
                }
            }
            _ => {}
        }
    }

    fn add_transforms(&mut self, topic: &str, message: &Transforms) {
        for stamped in &message.transforms {
            let (parent, child) = (stamped.header.frame(), stamped.child_frame());
            let Ok(parent_from_child) = stamped.transform.isometry() else { continue };
            if is_static(topic) {
                self.fixed.insert(parent, child, parent_from_child);
                continue;
            }
            let key = (topic.to_owned(), parent.to_owned(), child.to_owned());
            if self.moving.len() < MAX_NAMES || self.moving.contains_key(&key) {
                let new = Repeated { first: parent_from_child, is_constant: true, times: 0 };
                let repeated = self.moving.entry(key).or_insert(new);
                repeated.is_constant &= repeated.first == parent_from_child;
                repeated.times += 1;
            }
        }
    }

    /// What never moves: static transforms, and those between frames of the robot that are sent again and again and never
    /// change.
    fn fixed(&self) -> Frames {
        let mut fixed = Frames::default();
        for ((_, parent, child), repeated) in &self.moving {
            let is_of_world = ["odom", "map", "world"].iter().any(|name| last_name(parent).contains(name));
            if repeated.is_constant && !is_of_world {
                fixed.insert(parent, child, repeated.first);
            }
        }
        fixed.extend(&self.fixed);
        fixed
    }

    /// Chooses the topics; `Err` tells why they cannot be chosen.
    fn plan(&self, topics: &Topics) -> Result<Plan, String> {
        let scan_topic = self.scan_topic(topics.scan.as_deref())?;
        let fixed = self.fixed();
        let frames_of = |topic: &str| self.topics.get(topic).map(|topic| &topic.frames).into_iter().flatten();
        let frame_of = |topic: &str| frames_of(topic).find(|frame| !frame.is_empty()).map_or("", String::as_str);
        let laser = frame_of(scan_topic);
        let odometry = self.odometry(topics.odometry.as_deref(), laser, &fixed)?;
        if let OdometrySource::Messages { topic } = &odometry
            && (topics.scan.is_none() || topics.odometry.is_none())
        {
            self.of_one_robot(scan_topic, topic)?;
        }
        // Odometry that does not name its robot is of the one that carries the laser.
        let root = || fixed.root(laser).map_or(laser, |(root, _)| root).to_owned();
        let robot = match &odometry {
            OdometrySource::Messages { topic } if !frame_of(topic).is_empty() => frame_of(topic).to_owned(),
            OdometrySource::Transforms { robot, .. } => robot.clone(),
            OdometrySource::Messages { .. } | OdometrySource::Nowhere => root(),
        };
        let mut mountings = BTreeMap::new();
        for laser in frames_of(scan_topic) {
            mountings.insert(laser.clone(), fixed.mounting(&robot, laser)?);
        }
        let odometry_topic = match &odometry {
            OdometrySource::Messages { topic } => Some(topic.as_str()),
            OdometrySource::Transforms { topic, .. } => Some(topic.as_str()),
            OdometrySource::Nowhere => None,
        };
        let clock = |topic: &str| self.topics.get(topic).map(|topic| topic.clock);
        let clocks_differ = odometry_topic
            .and_then(|topic| Some((clock(scan_topic)?, clock(topic)?)))
            .and_then(|(scan, odometry)| scan.differs_from(&odometry));
        Ok(Plan { scan_topic: scan_topic.to_owned(), odometry, mountings, clocks_differ })
    }

    /// Scans and odometry of two name spaces may be of two robots.
    fn of_one_robot(&self, scan: &str, odometry: &str) -> Result<(), String> {
        let space = |topic: &str| topic.trim_start_matches('/').split_once('/').map(|(space, _)| space.to_owned());
        match (space(scan), space(odometry)) {
            (Some(of_scan), Some(of_odometry)) if of_scan != of_odometry => Err(format!(
                "the scans on {scan:.100} and the odometry on {odometry:.100} may be of two robots: name both by \
                 --scan-topic and --odom-topic; {}",
                self.listed(|_| true)
            )),
            _ => Ok(()),
        }
    }

    fn scan_topic(&self, named: Option<&str>) -> Result<&str, String> {
        if let Some(named) = named {
            return self.named(named, &[LASER_SCAN], "--scan-topic");
        }
        match &self.of_type(LASER_SCAN)[..] {
            [only] => Ok(only),
            [] => Err(format!("no message of type {LASER_SCAN} in this bag; {}", self.listed(|_| true))),
            _ => {
                let listed = self.listed(|topic| topic.schema == LASER_SCAN);
                Err(format!("scans of several lasers: choose one by --scan-topic; {listed}"))
            }
        }
    }

    fn odometry(&self, named: Option<&str>, laser: &str, fixed: &Frames) -> Result<OdometrySource, String> {
        let topic = match named {
            Some(named) => Some(self.named(named, &[ODOMETRY, TRANSFORMS], "--odom-topic")?),
            None => match &self.of_type(ODOMETRY)[..] {
                [] => None,
                [only] => Some(*only),
                _ => {
                    let listed = self.listed(|topic| topic.schema == ODOMETRY);
                    return Err(format!("odometry from several sources: choose one by --odom-topic; {listed}"));
                }
            },
        };
        match topic {
            Some(topic) if self.topics.get(topic).is_some_and(|found| found.schema == ODOMETRY) => {
                Ok(OdometrySource::Messages { topic: topic.to_owned() })
            }
            topic => self.moving_robot(topic, laser, fixed),
        }
    }

    /// The transform that moves the robot: from a frame named for odometry (REP 105: `odom`).
    fn moving_robot(&self, topic: Option<&str>, laser: &str, fixed: &Frames) -> Result<OdometrySource, String> {
        let root = |frame| fixed.root(frame).map(|(root, _)| root);
        let mut pairs: BTreeMap<(&str, &str), &str> = BTreeMap::new();
        for ((on, parent, child), repeated) in &self.moving {
            let moves = !repeated.is_constant || repeated.times < ALWAYS_THE_SAME;
            if last_name(parent).contains("odom") && moves && topic.is_none_or(|topic| topic == on) {
                pairs.insert((parent, child), on);
            }
        }
        let several = pairs.len() > 1;
        if several {
            // Of several robots the one that carries the laser.
            pairs.retain(|(_, child), _| root(child) == root(laser));
        }
        match &pairs.iter().collect::<Vec<_>>()[..] {
            [((odom, robot), on)] => Ok(OdometrySource::Transforms {
                topic: (**on).to_owned(),
                odom: (*odom).to_owned(),
                robot: (*robot).to_owned(),
            }),
            [] if topic.is_none() && !several => Ok(OdometrySource::Nowhere),
            _ => {
                let moving: Vec<_> = self
                    .moving
                    .keys()
                    .take(SHOWN)
                    .map(|(on, parent, child)| format!("{parent} -> {child} on {on}"))
                    .collect();
                Err(format!(
                    "no single transform from a frame `odom` to the robot of the laser `{laser:.50}`; choose odometry \
                     by --odom-topic; there are: {}",
                    moving.join(", ")
                ))
            }
        }
    }

    fn of_type(&self, schema: &str) -> Vec<&str> {
        let is_of_type = |(_, topic): &(&String, &Topic)| topic.schema == schema && topic.encoding == "cdr";
        self.topics.iter().filter(is_of_type).map(|(name, _)| &**name).collect()
    }

    /// The topic that the user named, if it has messages of one of these types.
    fn named(&self, named: &str, schemas: &[&str], option: &str) -> Result<&str, String> {
        let can_be = |topic: &Topic| schemas.contains(&&*topic.schema) && topic.encoding == "cdr";
        match self.topics.get_key_value(named) {
            Some((name, topic)) if can_be(topic) => Ok(name),
            _ => Err(format!(
                "no message of type {} on {named:.100} ({option}); {}",
                schemas.join(" or "),
                self.listed(|_| true)
            )),
        }
    }

    fn listed(&self, which: impl Fn(&Topic) -> bool) -> String {
        let listed = self.topics.iter().filter(|(_, topic)| which(topic));
        let listed: Vec<_> = listed
            .map(|(name, Topic { schema, encoding, messages, .. })| {
                let encoded =
                    if encoding == "cdr" { String::new() } else { format!(", encoded as {encoding:.20}, not cdr") };
                format!("{name:.100} ({schema:.100}, {messages} messages{encoded})")
            })
            .collect();
        match listed.len() {
            0 => "it holds no messages".to_owned(),
            count if count > SHOWN => format!("there are: {}, and {} more", listed[..SHOWN].join(", "), count - SHOWN),
            _ => format!("there are: {}", listed.join(", ")),
        }
    }
}
