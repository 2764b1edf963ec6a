//! The topics of a bag: what each holds, and the one of a type that the user named or that is the only one.

use super::clock::Clock;
use super::records::Channel;
use std::collections::{BTreeMap, BTreeSet};

/// Topics that are kept apart; a damaged file could hold any number.
const MAX_TOPICS: usize = 10_000;
/// Lasers that take turns on one topic, at most.
const MAX_FRAMES: usize = 16;
/// Topics that an error lists.
const SHOWN: usize = 20;

/// The topics that have messages, by name.
#[derive(Default)]
pub(super) struct SeenTopics(BTreeMap<String, Topic>);

/// A topic that has messages.
pub(super) struct Topic {
    pub(super) schema: String,
    encoding: String,
    is_understood: bool,
    messages: u64,
    /// The frames whose readings these are: of lasers, or of the robot.
    pub(super) frames: BTreeSet<String>,
    /// Of odometry, the frame in which the robot moves.
    pub(super) parent: String,
    pub(super) clock: Clock,
}

impl Topic {
    /// Counts a reading of this frame.
    pub(super) fn add(&mut self, stamp: Result<i64, String>, received: i64, frame: &str) {
        if let Ok(stamp) = stamp {
            self.clock.add(stamp, received);
        }
        if self.frames.len() < MAX_FRAMES && !self.frames.contains(frame) {
            self.frames.insert(frame.to_owned());
        }
    }

    /// The frame whose readings these are; empty where none is named.
    pub(super) fn frame(&self) -> &str {
        self.frames.iter().find(|frame| !frame.is_empty()).map_or("", String::as_str)
    }

    fn is_of(&self, schema: &str) -> bool {
        self.schema == schema && self.is_understood
    }
}

impl SeenTopics {
    /// Counts a message; `None` where there are too many topics already.
    pub(super) fn count(&mut self, channel: &Channel) -> Option<&mut Topic> {
        if !self.0.contains_key(&channel.topic) && self.0.len() < MAX_TOPICS {
            let (schema, encoding) = (channel.schema.clone(), channel.encoding.clone());
            let is_understood = channel.is_understood();
            let new = Topic {
                schema,
                encoding,
                is_understood,
                messages: 0,
                frames: BTreeSet::new(),
                parent: String::new(),
                clock: Clock::default(),
            };
            self.0.insert(channel.topic.clone(), new);
        }
        let topic = self.0.get_mut(&channel.topic)?;
        topic.messages += 1;
        Some(topic)
    }

    pub(super) fn get(&self, name: &str) -> Option<&Topic> {
        self.0.get(name)
    }

    /// The only topic of a type; `Ok(None)` where there is none, and `Err` asks by `several` for a choice by this option.
    pub(super) fn only(&self, schema: &str, several: &str, option: &str) -> Result<Option<&str>, String> {
        let of_type: Vec<&String> =
            self.0.iter().filter(|(_, topic)| topic.is_of(schema)).map(|(name, _)| name).collect();
        match &of_type[..] {
            [] => Ok(None),
            [only] => Ok(Some(only)),
            _ => {
                let listed = self.listed(|topic| topic.schema == schema);
                Err(format!("{several}: choose one by {option}; {listed}"))
            }
        }
    }

    /// The topics of a type, by name.
    pub(super) fn of_type(&self, schema: &str) -> impl Iterator<Item = (&str, &Topic)> {
        self.0.iter().filter(move |(_, topic)| topic.is_of(schema)).map(|(name, topic)| (name.as_str(), topic))
    }

    /// The topic that the user named by this option, if it has messages of one of these types.
    pub(super) fn named(&self, named: &str, schemas: &[&str], option: &str) -> Result<&str, String> {
        match self.0.get_key_value(named) {
            Some((name, topic)) if schemas.iter().any(|schema| topic.is_of(schema)) => Ok(name),
            _ => Err(format!("no message of type {} on {named:.100} ({option}); {}", schemas.join(" or "), self.all())),
        }
    }

    /// All topics, for an error.
    pub(super) fn all(&self) -> String {
        self.listed(|_| true)
    }

    fn listed(&self, which: impl Fn(&Topic) -> bool) -> String {
        let listed = self.0.iter().filter(|(_, topic)| which(topic));
        let listed: Vec<_> = listed
            .map(|(name, Topic { schema, encoding, is_understood, messages, .. })| {
                let encoded = if *is_understood {
                    String::new()
                } else {
                    format!(", encoded as {encoding:.20}, not cdr or ros1")
                };
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
