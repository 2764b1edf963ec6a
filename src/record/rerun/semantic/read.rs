//! Reads the recording of a mapping back.

use super::super::blueprint as shared;
use super::super::read::{ReadError, Store};
use super::super::rows::{Numbers, text};
use super::blueprint;
use super::worlds::Recorded;
use crate::config::Config;
use crate::detections::DetectionKind;
use crate::io::semantic::sensors;
use crate::semantic::{Objects, Plane, SemanticConfig};

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
pub struct RecordedMapping<W: Recorded = Plane> {
    store: Store,
    /// What was mapped.
    pub recording: W::Recording,
    /// Which objects the detections show, if that was known.
    pub objects: Option<Vec<Vec<Option<u64>>>>,
    /// Everything that was set.
    pub config: SemanticConfig,
    /// [`History::checksums`](crate::semantic::History::checksums).
    pub checksums: Vec<u32>,
    /// Pose of each keyframe.
    pub poses: Vec<W::Pose>,
    /// What came out.
    pub result: MappingResult,
}

/// What the detections in a recording of a mapping are: of the plane, or of space.
///
/// # Errors
/// It is no recording of a mapping, or a damaged one.
pub fn kind(store: &Store) -> Result<DetectionKind, ReadError> {
    let mut found = None;
    for chunk in store.chunks()? {
        let (_, chunk) = chunk?;
        found = found.or_else(|| text(&chunk, blueprint::SENSORS));
    }
    let kind = found.and_then(|text| sensors::kind(&text).ok());
    kind.ok_or_else(|| store.not("its sensors are missing or damaged"))
}

impl<W: Recorded> RecordedMapping<W> {
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
        let [speeds, poses, detections] =
            [blueprint::SPEEDS, shared::ODOMETRY_READING, blueprint::DETECTIONS].map(|path| rows(&numbers, path));
        let recording = sensors.and_then(|sensors| W::recording(&sensors, speeds, poses, detections));
        let recording = recording.ok_or_else(|| damaged("log"))?;
        let ids: Vec<_> = rows(&numbers, blueprint::IDS).map(|row| row.iter().copied().map(id).collect()).collect();
        let checksum = |row: &[f64]| Some(*row.first()? as u32);
        let checksums = rows(&numbers, shared::CHECKSUM).map(checksum);
        let pose = |row: &[f64]| W::pose(row.split_last()?.1);
        let poses = rows(&numbers, shared::POSE).map(pose);
        let result = numbers.rows(shared::RESULT).next_back().and_then(|(_, row)| row.as_array());
        let &[checksum, landmarks, objective] = result.ok_or_else(|| damaged("result"))?;
        Ok(Self {
            recording,
            objects: Some(ids).filter(|ids| !ids.is_empty()),
            config,
            checksums: checksums.collect::<Option<_>>().ok_or_else(|| damaged("history"))?,
            poses: poses.collect::<Option<_>>().ok_or_else(|| damaged("trajectory"))?,
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
