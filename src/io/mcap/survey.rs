//! The first pass over a bag: which topics it has, and which transforms.

use super::decode::decode;
use super::messages::{LASER_SCAN, LaserScan, ODOMETRY, Odometry, TRANSFORMS, Transforms};
use super::records::{Channel, Next};
use super::storage::Storage;
use super::topics::SeenTopics;
use super::transforms::SeenTransforms;
use crate::log::LogError;
use std::path::{Path, PathBuf};

/// What a bag holds.
#[derive(Default)]
pub(super) struct Survey {
    pub(super) topics: SeenTopics,
    pub(super) transforms: SeenTransforms,
}

/// Reads a bag to its end, or as far as it goes.
///
/// # Errors
/// The bag cannot be opened, or none of its messages can be read.
pub(super) fn survey(path: &Path, files: Vec<PathBuf>) -> Result<Survey, LogError> {
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
            // The second pass counts and reports all.
            Ok(Next::Damage(reason)) => _ = first_damage.get_or_insert(reason),
            Ok(Next::End) => break None,
            Err(source) => break Some(source),
        }
    };
    match (first_damage, broke_off) {
        (Some(reason), _) if messages == 0 => {
            Err(LogError::Bag { path: path.to_owned(), reason: format!("no message can be read; {reason}") })
        }
        (None, Some(source)) if messages == 0 => Err(LogError::Read { path: path.to_owned(), line: 0, source }),
        _ => Ok(found),
    }
}

impl Survey {
    fn add(&mut self, channel: &Channel, received: i64, data: &[u8]) {
        let Some(topic) = self.topics.count(channel) else { return };
        match &*channel.schema {
            LASER_SCAN => {
                if let Ok(scan) = decode::<LaserScan>(channel, data) {
                    topic.add(scan.header.stamp(), received, scan.header.frame());
                }
            }
            ODOMETRY => {
                if let Ok(odometry) = decode::<Odometry>(channel, data) {
                    topic.add(odometry.header.stamp(), received, odometry.child_frame());
                }
            }
            TRANSFORMS => {
                if let Ok(message) = decode::<Transforms>(channel, data) {
                    // The stamp of one of its transforms shows the clock of the topic.
                    if let Some(stamped) = message.transforms.first() {
                        topic.add(stamped.header.stamp(), received, "");
                    }
                    self.transforms.add(&channel.topic, &message);
                }
            }
            _ => {}
        }
    }
}
