//! The first pass over a bag: which topics make the log, and how its laser is mounted.

use super::Topics;
use super::frames::{Frames, Mounting};
use super::messages::{self, LASER_SCAN, LaserScan, ODOMETRY, Odometry, TRANSFORMS, Transforms};
use super::records::{Channel, Next, Records};
use crate::log::LogError;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Topics that are kept apart, and pairs of moving frames; a damaged file could hold any number.
const MAX_NAMES: usize = 10_000;
/// Topics that an error lists.
const SHOWN: usize = 20;

/// Where the entries of a log are to be found in a bag.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) scan_topic: String,
    pub(super) odometry: OdometrySource,
    /// `None` where the bag does not tell.
    pub(super) mounting: Option<Mounting>,
}

#[derive(Debug)]
pub(super) enum OdometrySource {
    /// Messages of type [`ODOMETRY`].
    Messages { topic: String },
    /// Transforms between two frames, on any topic that is not static.
    Transforms { odom: String, robot: String },
    /// The bag has none.
    Nowhere,
}

/// Reads a bag to its end, or as far as it goes.
///
/// # Errors
/// The bag cannot be opened, or it is not clear which of its topics make the log.
pub(super) fn survey(path: &Path, files: Vec<PathBuf>, topics: &Topics) -> Result<Plan, LogError> {
    let open_error = |source| LogError::Open { path: path.to_owned(), source };
    let mut records = Records::open(files).map_err(open_error)?;
    let mut found = Survey::default();
    let (mut messages, mut first_damage) = (0, None);
    let broke_off = loop {
        match records.next() {
            Ok(Next::Message { channel, data }) => {
                messages += 1;
                found.add(&channel, &data);
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
    /// Topic, parent and child of the transforms that move.
    moving: BTreeSet<(String, String, String)>,
}

/// A topic that has messages.
struct Topic {
    schema: String,
    encoding: String,
    messages: u64,
    /// The frame whose readings these are: of the laser, or of the robot; of the first message that tells it.
    frame: Option<String>,
}

impl Survey {
    fn add(&mut self, channel: &Channel, data: &[u8]) {
        if !self.topics.contains_key(&channel.topic) {
            if self.topics.len() == MAX_NAMES {
                return;
            }
            let (schema, encoding) = (channel.schema.clone(), channel.encoding.clone());
            self.topics.insert(channel.topic.clone(), Topic { schema, encoding, messages: 0, frame: None });
        }
        let Some(topic) = self.topics.get_mut(&channel.topic) else { return };
        topic.messages += 1;
        if channel.schema == TRANSFORMS {
            if let Ok(message) = messages::decode(data) {
                self.add_transforms(&channel.topic, &message);
            }
        } else if topic.frame.is_none() {
            topic.frame = match &*channel.schema {
                LASER_SCAN => messages::decode(data).ok().map(|scan: LaserScan| scan.header.frame().to_owned()),
                ODOMETRY => messages::decode(data).ok().map(|odometry: Odometry| odometry.child_frame().to_owned()),
                _ => None,
            };
        }
    }

    fn add_transforms(&mut self, topic: &str, message: &Transforms) {
        for stamped in &message.transforms {
            let (parent, child) = (stamped.header.frame(), stamped.child_frame());
            match stamped.transform.isometry() {
                Ok(parent_from_child) if is_static(topic) => self.fixed.insert(parent, child, parent_from_child),
                Ok(_) if self.moving.len() < MAX_NAMES => {
                    self.moving.insert((topic.to_owned(), parent.to_owned(), child.to_owned()));
                }
                _ => {}
            }
        }
    }

    /// Chooses the topics; `Err` tells why they cannot be chosen.
    fn plan(&self, topics: &Topics) -> Result<Plan, String> {
        let scan_topic = self.scan_topic(topics.scan.as_deref())?;
        let frame_of =
            |topic: &str| self.topics.get(topic).and_then(|topic| topic.frame.as_deref()).unwrap_or_default();
        let laser = frame_of(scan_topic);
        let odometry = self.odometry(topics.odometry.as_deref(), laser)?;
        let robot = match &odometry {
            OdometrySource::Messages { topic } => frame_of(topic),
            OdometrySource::Transforms { robot, .. } => robot,
            OdometrySource::Nowhere => self.fixed.root(laser).map_or(laser, |(root, _)| root),
        };
        let mounting = self.fixed.mounting(robot, laser)?;
        Ok(Plan { scan_topic: scan_topic.to_owned(), odometry, mounting })
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

    fn odometry(&self, named: Option<&str>, laser: &str) -> Result<OdometrySource, String> {
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
            topic => self.moving_robot(topic, laser),
        }
    }

    /// The transform that moves the robot: from a frame named for odometry (REP 105: `odom`).
    fn moving_robot(&self, topic: Option<&str>, laser: &str) -> Result<OdometrySource, String> {
        let root = |frame| self.fixed.root(frame).map(|(root, _)| root);
        let mut pairs: BTreeSet<(&str, &str)> = BTreeSet::new();
        for (on, parent, child) in &self.moving {
            if last_name(parent).contains("odom") && topic.is_none_or(|topic| topic == on) {
                pairs.insert((parent, child));
            }
        }
        let several = pairs.len() > 1;
        if several {
            // Of several robots the one that carries the laser.
            pairs.retain(|(_, child)| root(child) == root(laser));
        }
        match &pairs.iter().collect::<Vec<_>>()[..] {
            [(odom, robot)] => Ok(OdometrySource::Transforms { odom: (*odom).to_owned(), robot: (*robot).to_owned() }),
            [] if topic.is_none() && !several => Ok(OdometrySource::Nowhere),
            _ => {
                let moving: Vec<_> = self
                    .moving
                    .iter()
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
