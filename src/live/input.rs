//! What the robot's topics say, as a bag that is recorded as it comes: the rest of the library reads it like any other.

use super::messages::{Header, StampedTransform, Time, Transforms};
use super::node::Publishers;
use crate::geometry::Pose;
use crate::io::mcap::McapWriter;
use futures::executor::block_on;
use futures::stream::{StreamExt as _, select_all};
use rustdds::RepresentationIdentifier;
use rustdds::no_key::{Decode, DefaultDecoder, DeserializerAdapter, SimpleDataReader};
use std::convert::Infallible;
use std::io::{self, PipeReader, PipeWriter};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// A scan that comes while the filter is this far behind is dropped \[s\]. What is behind is only the correction of the odometry,
/// which is a few per cent of the way off in these seconds; and the search for a loop takes some.
const MOST_BEHIND: f64 = 10.0;
/// The correction of the odometry is said to hold so long after the message that it is sent with, until the next one comes \[s\].
const VALID: f64 = 0.2;

/// A message as it came: CDR with its encapsulation header.
#[derive(Debug)]
pub(super) struct Raw;

/// Keeps the bytes of a message.
#[derive(Clone, Debug)]
pub(super) struct Keep;

impl DeserializerAdapter<Vec<u8>> for Raw {
    type Error = Infallible;
    type Decoded = Vec<u8>;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[RepresentationIdentifier::CDR_LE, RepresentationIdentifier::CDR_BE]
    }

    fn transform_decoded(message: Vec<u8>) -> Vec<u8> {
        message
    }
}

impl DefaultDecoder<Vec<u8>> for Raw {
    type Decoder = Keep;
    const DECODER: Keep = Keep;
}

impl Decode<'_, Vec<u8>> for Keep {
    type Error = Infallible;

    fn decode_bytes(self, fields: &[u8], encoding: RepresentationIdentifier) -> Result<Vec<u8>, Infallible> {
        let is_little_endian = encoding == RepresentationIdentifier::CDR_LE;
        Ok([&[0, u8::from(is_little_endian), 0, 0], fields].concat())
    }
}

/// What the thread that receives messages and the one of the filter know of each other.
#[derive(Clone, Debug, Default)]
pub struct Shared(Arc<Mutex<State>>);

/// How far the one and the other have come.
#[derive(Clone, Debug, Default)]
pub struct State {
    /// Scans received.
    pub scans: u64,
    /// Of these, those that were dropped as the filter was too far behind.
    pub dropped: u64,
    /// When the last scan was received.
    pub last_scan: Option<Instant>,
    /// Its stamp, and when it was received, by this computer's clock \[s\].
    newest: Option<[f64; 2]>,
    /// Stamp of the last scan that the filter took in, by either of these clocks \[s\].
    taken: Option<f64>,
    /// The frame of the odometry, and `world_from_odom`.
    pub(super) correction: Option<(String, Pose)>,
}

impl State {
    /// How far the filter is behind the robot \[s\].
    pub fn behind(&self) -> f64 {
        let (Some(newest), Some(taken)) = (self.newest, self.taken) else { return 0.0 };
        // By the clock that the filter does not go by, the difference is large.
        newest.map(|newest| newest - taken).into_iter().min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0)
    }

    /// Counts a scan of this stamp, received at this time \[s\]; returns whether it is kept.
    fn add_scan(&mut self, stamp: Option<f64>, received: f64) -> bool {
        self.scans += 1;
        self.last_scan = Some(Instant::now());
        self.newest = stamp.map(|stamp| [stamp, received]);
        let is_dropped = self.behind() > MOST_BEHIND;
        self.dropped += u64::from(is_dropped);
        !is_dropped
    }
}

impl Shared {
    /// As it is now.
    pub fn now(&self) -> State {
        self.state().clone()
    }

    /// The filter has taken in the scan of this stamp \[s\].
    pub(super) fn taken(&self, stamp: f64) {
        self.state().taken = Some(stamp);
    }

    pub(super) fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The stamp of a message that begins with a header \[s\].
fn stamp(message: &[u8]) -> Option<f64> {
    let (encapsulation, fields) = message.split_first_chunk::<4>()?;
    let (seconds, fields) = fields.split_first_chunk::<4>()?;
    let (nanoseconds, _) = fields.split_first_chunk::<4>()?;
    let is_little_endian = encapsulation[1] == 1;
    let number = |bytes: [u8; 4]| if is_little_endian { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) };
    Some(f64::from(number(*seconds).cast_signed()) + f64::from(number(*nanoseconds)) / 1e9)
}

/// A topic of the robot.
pub(super) struct RawReader {
    pub topic: String,
    pub message_type: String,
    pub reader: SimpleDataReader<Vec<u8>, Raw>,
}

/// Writes what comes to a pipe, on a thread of its own, until nobody reads it any more; and publishes the correction of the odometry
/// at once with every message of the robot, however busy the filter is.
pub(super) fn forward(
    readers: Vec<RawReader>,
    shared: Shared,
    publishers: Arc<Publishers>,
    map_frame: String,
) -> io::Result<PipeReader> {
    let (reader, writer) = io::pipe()?;
    let forwarding = Forwarding { shared, publishers, map_frame };
    // It ends where the pipe is closed.
    std::thread::Builder::new().name("topics".to_owned()).spawn(move || _ = forwarding.record(&readers, writer))?;
    Ok(reader)
}

struct Forwarding {
    shared: Shared,
    publishers: Arc<Publishers>,
    map_frame: String,
}

impl Forwarding {
    fn record(&self, readers: &[RawReader], pipe: PipeWriter) -> io::Result<()> {
        let mut bag = McapWriter::new(pipe)?;
        let mut streams = Vec::new();
        for RawReader { topic, message_type, reader } in readers {
            let number = bag.add_topic(topic, message_type)?;
            let of_topic = reader.as_async_stream().map(move |message| (number, message_type.as_str(), message));
            streams.push(of_topic.boxed_local());
        }
        let mut messages = select_all(streams);
        block_on(async {
            while let Some((topic, message_type, message)) = messages.next().await {
                // Anything may come over a network.
                let Ok(message) = message else { continue };
                let received = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
                let message = message.into_value();
                let is_scan = message_type.ends_with("/LaserScan");
                let stamp = stamp(&message).filter(|_| is_scan || message_type.ends_with("/Odometry"));
                self.publish_correction(stamp);
                if !is_scan || self.shared.state().add_scan(stamp, received.as_secs_f64()) {
                    bag.write(topic, received.as_nanos() as u64, &message)?;
                }
            }
            Ok(())
        })
    }

    fn publish_correction(&self, stamp: Option<f64>) {
        let correction = self.shared.state().correction.clone();
        let Some((stamp, (odom_frame, world_from_odom))) = stamp.zip(correction) else { return };
        let header = Header { stamp: Time::of(stamp + VALID), frame_id: self.map_frame.clone() };
        let transform = StampedTransform { header, child_frame_id: odom_frame, transform: world_from_odom.into() };
        // What cannot be sent now is out of date by the time it can be.
        let _ = self.publishers.transforms.publish(Transforms { transforms: vec![transform] });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_are_read_in_both_byte_orders() {
        let little = [0, 1, 0, 0, 5, 0, 0, 0, 0, 0xca, 0x9a, 0x3b >> 1, 9];
        assert!((stamp(&little).unwrap() - (5.0 + f64::from(0x1d9a_ca00_u32) / 1e9)).abs() < 1e-9);
        assert!((stamp(&[0, 0, 0, 0, 0, 0, 0, 5, 0, 0, 0, 7]).unwrap() - (5.0 + 7e-9)).abs() < 1e-9);
        assert_eq!(stamp(&[0, 1, 0, 0, 5, 0, 0, 0, 0, 0, 0]), None);
    }

    #[test]
    fn scans_are_dropped_while_the_filter_is_behind() {
        let shared = Shared::default();
        // The robot's clock is an hour behind this computer's.
        let add = |stamp: f64| shared.state().add_scan(Some(stamp), stamp + 3600.0);
        assert!(add(0.0) && add(60.0), "nothing was taken in yet, so that nothing is behind");
        shared.taken(60.0);
        assert!(add(69.0) && !add(71.0));
        assert!((shared.now().behind() - 11.0).abs() < 1e-9);
        // Where the times of receipt count, the filter goes by them.
        shared.taken(3600.0 + 71.0);
        assert!(add(72.0) && !add(82.0));
        let State { scans, dropped, .. } = shared.now();
        assert_eq!((scans, dropped), (6, 2));
    }
}
