//! The first pass over a bag: which topics it has, and which transforms.

use super::decode::decode;
use super::messages::{IMU, Imu, LASER_SCAN, LaserScan, ODOMETRY, Odometry, TRANSFORMS, Transforms};
use super::records::{Channel, Next};
use super::storage::{Origin, Storage};
use super::topics::{SeenTopics, Topic};
use super::transforms::SeenTransforms;
use crate::log::LogError;
use std::path::Path;

/// What a bag holds.
#[derive(Default)]
pub(super) struct Survey {
    pub(super) topics: SeenTopics,
    pub(super) transforms: SeenTransforms,
}

/// What a stream holds shows in its first seconds \[ns\]: a robot that is switched on tells its transforms within one.
const FIRST_OF_STREAM: i64 = 5_000_000_000;

/// Reads a bag to its end, or as far as it goes. Of a stream it reads the first seconds of scans.
///
/// # Errors
/// The bag cannot be opened, or none of its messages can be read.
pub(super) fn survey(path: &Path, origin: &Origin) -> Result<Survey, LogError> {
    let open_error = |source| LogError::Open { path: path.to_owned(), source };
    let mut records = Storage::open(origin).map_err(open_error)?;
    let mut found = Survey::default();
    let (mut messages, mut first_damage) = (0, None);
    let broke_off = loop {
        match records.next() {
            Ok(Next::Message { channel, received, data }) => {
                messages += 1;
                found.add(&channel, received, &data);
                let is_enough = |topic: &Topic| topic.clock.span() >= FIRST_OF_STREAM;
                if matches!(origin, Origin::Stream(_))
                    && channel.schema == LASER_SCAN
                    && found.topics.get(&channel.topic).is_some_and(is_enough)
                {
                    break None;
                }
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
                    if topic.parent.is_empty() {
                        topic.parent = odometry.header.frame().to_owned();
                    }
                }
            }
            IMU => {
                if let Ok(imu) = decode::<Imu>(channel, data) {
                    topic.add(imu.header.stamp(), received, imu.header.frame());
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
