//! Reads a recording back: what the run was started with, its log, and what every step found.
//!
//! The log in a recording is a [`LogSource`] like any other, and no more of it is in memory than of any other. A recording that breaks off, because the run or the machine
//! was stopped, is read as far as it goes.

use super::blueprint;
use super::chunks::Chunks;
pub use super::chunks::ReadError;
use super::earlier;
use super::entries::{Entries, RecordedReader};
use super::log::{About, AboutContinued};
use super::rows::{Numbers, exactly, positions, text};
use crate::geometry::Pose;
use crate::log::{LogError, LogReader, LogSource, LogStats};
use crate::map::LineMap;
use crate::pipeline::{Continued, RunInfo};
use crate::report::{StageTimes, StepReport};
use ::rerun::RecordingStream;
use nalgebra::Point2;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What a recording holds of one step.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedStep {
    /// From 0.
    pub step: u32,
    /// Pose of the best particle.
    pub world_from_robot: Pose,
    /// [`StepReport::checksum`](crate::report::StepReport::checksum).
    pub checksum: u32,
    /// 1 / Σ w².
    pub effective_sample_size: f64,
    /// Clusters in the best map.
    pub clusters: usize,
    /// Where the time went.
    pub times: StageTimes,
}

impl From<&StepReport<'_>> for RecordedStep {
    fn from(report: &StepReport<'_>) -> Self {
        Self {
            step: report.step,
            world_from_robot: report.world_from_robot,
            checksum: report.checksum(),
            effective_sample_size: report.effective_sample_size,
            clusters: report.map.len(),
            times: report.times,
        }
    }
}

/// What a recording holds of the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordedResult {
    /// [`RunResult::checksum`](crate::report::RunResult::checksum).
    pub checksum: u32,
    /// Whether it was smoothed.
    pub is_smoothed: bool,
}

/// A run, read back. Its log stays in the file and is read from there.
#[derive(Debug)]
pub struct RecordedRun {
    store: Store,
    /// Where the frames of the log begin in the file.
    places: Arc<[u64]>,
    /// Entries of its log.
    pub entries: u64,
    /// Its steps, in their order.
    pub steps: Vec<RecordedStep>,
    /// Its result; none where the recording breaks off before.
    pub result: Option<RecordedResult>,
    /// Positions of the final trajectory, one for each laser and odometry reading \[m\]; rounded to f32, and empty where
    /// the recording breaks off.
    pub trajectory: Vec<Point2<f64>>,
}

/// A recording, of whatever kind the run is. What it holds stays in the file.
#[derive(Debug)]
pub struct Store {
    path: PathBuf,
    /// Version of the program that recorded it.
    pub version: String,
    /// What it was started with.
    pub info: RunInfo,
}

impl Store {
    /// Opens a recording.
    ///
    /// # Errors
    /// The file cannot be opened, is no recording, or lacks the configuration of the run.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let not = |reason: &str| ReadError::NotARecording { path: path.to_owned(), reason: reason.to_owned() };
        let mut about = None;
        for chunk in Chunks::open(path)? {
            about = text(&chunk?.1, blueprint::ABOUT);
            if about.is_some() {
                break;
            }
        }
        let about = about.ok_or_else(|| not("it does not hold the configuration of the run"))?;
        let About { version, log, device, continues, configuration: config } =
            toml::from_str(&about).map_err(|error| not(&format!("its configuration is not understood: {error}")))?;
        let unusable = |source| ReadError::Configuration {
            path: path.to_owned(),
            version: version.clone(),
            source: Box::new(source),
        };
        config.validate().map_err(unusable)?;
        // Its map is behind in the file.
        let continues = continues.map(|AboutContinued { name, first_scan, world_from_robot }| Continued {
            name,
            map: LineMap::default(),
            first_scan,
            world_from_robot,
        });
        Ok(Self { path: path.to_owned(), version, info: RunInfo { log, device, config, continues } })
    }

    /// Name of the file, without its ending.
    pub fn name(&self) -> String {
        self.path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }

    pub(super) fn not(&self, reason: &str) -> ReadError {
        ReadError::NotARecording { path: self.path.clone(), reason: reason.to_owned() }
    }

    pub(super) fn chunks(&self) -> Result<Chunks, ReadError> {
        Chunks::open(&self.path)
    }

    /// Sends everything that belongs to a step to another recording, with paths that lie under `root`.
    pub(super) fn send(&self, stream: &RecordingStream, root: &str) -> Result<(), ReadError> {
        for chunk in self.chunks()? {
            let (_, chunk) = chunk?;
            let path = chunk.entity_path().to_string();
            if !chunk.is_static() && ["/world", "/plots"].iter().any(|shown| path.starts_with(shown)) {
                let path = blueprint::under(root, path.trim_start_matches('/'));
                stream.send_chunk(chunk.clone_with_new_entity_path(path.into()));
            }
        }
        Ok(())
    }
}

impl RecordedRun {
    /// Reads a recording.
    ///
    /// # Errors
    /// Those of [`Store::open`], and of [`RecordedRun::new`].
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        Self::new(Store::open(path)?)
    }

    /// Reads what a file holds.
    ///
    /// # Errors
    /// It cannot be read, or is damaged.
    pub fn new(mut store: Store) -> Result<Self, ReadError> {
        let mut trajectory = None;
        let (mut entries, mut numbers) = (Entries::default(), Numbers::new(&NUMBERS));
        let mut places = Vec::new();
        for chunk in store.chunks()? {
            let (place, chunk) = chunk?;
            if entries.add(&chunk).ok_or_else(|| store.not("its log is damaged"))? {
                places.push(place);
            }
            while entries.pop().is_some() {}
            numbers.add(&chunk);
            trajectory = trajectory.or_else(|| positions(&chunk, blueprint::TRAJECTORY));
        }
        if store.info.continues.is_some() {
            let map =
                earlier::map(&numbers).ok_or_else(|| store.not("the map of the earlier drive in it is damaged"))?;
            store.info.continues.iter_mut().for_each(|continued| continued.map = map.clone());
        }
        Ok(Self {
            store,
            places: places.into(),
            entries: entries.count(),
            steps: steps(&numbers),
            result: result(&numbers),
            trajectory: trajectory.unwrap_or_default(),
        })
    }

    /// What the file is, and how the run was made.
    pub fn store(&self) -> &Store {
        &self.store
    }
}

impl LogSource for RecordedRun {
    fn name(&self) -> String {
        self.store.name()
    }

    fn open(&self) -> Result<Box<dyn LogReader>, LogError> {
        let path = self.store.path.clone();
        let open_error = |error| LogError::Open { path: path.clone(), source: std::io::Error::other(error) };
        let chunks = Chunks::open(&path).map_err(open_error)?.at(Arc::clone(&self.places));
        let (entries, stats) = (Entries::default(), LogStats::default());
        Ok(Box::new(RecordedReader { path, chunks, entries, stats, all: self.entries }))
    }
}

/// The numbers that are recorded of an earlier drive and of each step of a run.
const NUMBERS: [(&str, &str); 8] = [
    (blueprint::EARLIER_WALLS, blueprint::ENTRY_TIMELINE),
    (blueprint::EARLIER_FREE, blueprint::ENTRY_TIMELINE),
    (blueprint::POSE, blueprint::STEP_TIMELINE),
    (blueprint::CHECKSUM, blueprint::STEP_TIMELINE),
    (blueprint::EFFECTIVE_SAMPLE_SIZE, blueprint::STEP_TIMELINE),
    (blueprint::CLUSTERS, blueprint::STEP_TIMELINE),
    (blueprint::SECONDS, blueprint::STEP_TIMELINE),
    (blueprint::RESULT, blueprint::STEP_TIMELINE),
];

fn steps(numbers: &Numbers) -> Vec<RecordedStep> {
    let step = |(step, pose): (i64, &[f64])| {
        let &[x, y, heading] = pose.as_array()?;
        Some(RecordedStep {
            step: step as u32,
            world_from_robot: exactly(x, y, heading),
            checksum: *numbers.at(blueprint::CHECKSUM, step)?.first()? as u32,
            effective_sample_size: *numbers.at(blueprint::EFFECTIVE_SAMPLE_SIZE, step)?.first()?,
            clusters: *numbers.at(blueprint::CLUSTERS, step)?.first()? as usize,
            times: StageTimes::from_seconds(numbers.at(blueprint::SECONDS, step)?.try_into().ok()?),
        })
    };
    // The last step may have been written in part.
    numbers.rows(blueprint::POSE).map_while(step).collect()
}

fn result(numbers: &Numbers) -> Option<RecordedResult> {
    let (_, row) = numbers.rows(blueprint::RESULT).next_back()?;
    let &[checksum, is_smoothed] = row.as_array()?;
    Some(RecordedResult { checksum: checksum as u32, is_smoothed: is_smoothed == 1.0 })
}
