//! Reads the recording of a mapping back.

use super::super::blueprint as shared;
use super::super::read::{ReadError, Store};
use super::super::rows::{Numbers, exactly, text};
use super::blueprint;
use crate::config::Config;
use crate::detections::{Detection, Frame, Odometry, Recording, Velocity};
use crate::geometry::StampedPose;
use crate::io::semantic::sensors;
use crate::semantic::{Objects, SemanticConfig};

/// What a recording holds of the result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MappingResult {
    /// [`SemanticMap::checksum`](crate::semantic::SemanticMap::checksum).
    pub checksum: u32,
    /// How many landmarks there are.
    pub landmarks: usize,
    /// The objective \[nats\].
    pub objective: f64,
}

/// A mapping of objects, read back.
#[derive(Debug)]
pub struct RecordedMapping {
    store: Store,
    /// What was mapped.
    pub recording: Recording,
    /// Which objects the detections show, if that was known.
    pub objects: Option<Vec<Vec<Option<u64>>>>,
    /// Everything that was set.
    pub config: SemanticConfig,
    /// [`History::checksums`](crate::semantic::History::checksums).
    pub checksums: Vec<u32>,
    /// The path.
    pub trajectory: Vec<StampedPose>,
    /// What came out.
    pub result: MappingResult,
}

impl RecordedMapping {
    /// Reads what a file holds.
    ///
    /// # Errors
    /// It is no recording of a mapping, or a damaged one.
    pub fn new(store: Store) -> Result<Self, ReadError> {
        let Config::Semantic(config) = store.info.config else {
            return Err(store.not("it is none of `ipslam semantic`"));
        };
        let damaged = |what: &str| store.not(&format!("its {what} is damaged"));
        let (mut sensors, mut numbers) = (None, Numbers::new(&NUMBERS));
        for chunk in store.chunks()? {
            let (_, chunk) = chunk?;
            numbers.add(&chunk);
            sensors = sensors.or_else(|| text(&chunk, blueprint::SENSORS));
        }
        let recording = sensors.and_then(|sensors| recording(&sensors, &numbers)).ok_or_else(|| damaged("log"))?;
        let ids: Vec<_> = rows(&numbers, blueprint::IDS).map(|row| row.iter().copied().map(id).collect()).collect();
        let checksum = |row: &[f64]| Some(*row.first()? as u32);
        let checksums = rows(&numbers, shared::CHECKSUM).map(checksum);
        let stamped = |row: &[f64]| {
            let &[x, y, heading, stamp] = row.as_array()?;
            Some(StampedPose { stamp, pose: exactly(x, y, heading) })
        };
        let poses = rows(&numbers, shared::POSE).map(stamped);
        let result = numbers.rows(shared::RESULT).next_back().and_then(|(_, row)| row.as_array());
        let &[checksum, landmarks, objective] = result.ok_or_else(|| damaged("result"))?;
        Ok(Self {
            recording,
            objects: Some(ids).filter(|ids| !ids.is_empty()),
            config,
            checksums: checksums.collect::<Option<_>>().ok_or_else(|| damaged("history"))?,
            trajectory: poses.collect::<Option<_>>().ok_or_else(|| damaged("trajectory"))?,
            result: MappingResult { checksum: checksum as u32, landmarks: landmarks as usize, objective },
            store,
        })
    }

    /// The file.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// Which objects the detections show, if that was known.
    pub fn objects(&self) -> Option<&Objects> {
        self.objects.as_deref()
    }
}

/// The numbers that a mapping is read from.
const NUMBERS: [(&str, &str); 7] = [
    (shared::ODOMETRY_READING, shared::ENTRY_TIMELINE),
    (blueprint::SPEEDS, shared::ENTRY_TIMELINE),
    (blueprint::DETECTIONS, shared::ENTRY_TIMELINE),
    (blueprint::IDS, shared::ENTRY_TIMELINE),
    (shared::CHECKSUM, shared::STEP_TIMELINE),
    (shared::POSE, blueprint::FRAME_TIMELINE),
    (shared::RESULT, shared::STEP_TIMELINE),
];

fn rows<'a>(numbers: &'a Numbers, path: &str) -> impl Iterator<Item = &'a [f64]> + use<'a> {
    numbers.rows(path).map(|(_, row)| row)
}

fn id(number: f64) -> Option<u64> {
    (!number.is_nan()).then_some(number as u64)
}

/// `None` where a row has another length than it can have.
fn recording(sensors: &str, numbers: &Numbers) -> Option<Recording> {
    let sensors = sensors::from_toml(sensors).ok()?;
    let speed = |row: &[f64]| {
        let &[forward, turn, stamp] = row.as_array()?;
        Some(Velocity { stamp, forward, turn })
    };
    let pose = |row: &[f64]| {
        let &[x, y, heading, stamp] = row.as_array()?;
        Some(StampedPose { stamp, pose: exactly(x, y, heading) })
    };
    let speeds = rows(numbers, blueprint::SPEEDS).map(speed).collect::<Option<Vec<_>>>()?;
    let poses = rows(numbers, shared::ODOMETRY_READING).map(pose).collect::<Option<Vec<_>>>()?;
    let odometry = if speeds.is_empty() { Odometry::Poses(poses) } else { Odometry::Velocities(speeds) };
    let classes = sensors.classes.len();
    let frame = |row: &[f64]| {
        let (stamp, numbers) = row.split_first()?;
        let (detections, rest) = numbers.as_chunks::<4>();
        let detection = |&[class, score, range, bearing]: &[f64; 4]| {
            let class = class as usize;
            (class < classes).then_some(Detection { class, score, range, bearing })
        };
        let detections = detections.iter().map(detection).collect::<Option<_>>()?;
        rest.is_empty().then_some(Frame { stamp: *stamp, detections })
    };
    let frames = rows(numbers, blueprint::DETECTIONS).map(frame).collect::<Option<_>>()?;
    Some(Recording { sensors, odometry, frames })
}
