//! Reads a recording back: what the run was started with, its log, and what every step found.
//!
//! The log in a recording is a [`LogSource`] like any other, and no more of it is in memory than of any other. A recording that breaks off, because the run or the machine
//! was stopped, is read as far as it goes.

use super::blueprint;
use super::chunks::Chunks;
use super::entries::{Entries, RecordedReader};
use super::log::About;
use crate::config::ConfigError;
use crate::geometry::Pose;
use crate::log::{LogError, LogReader, LogSource, LogStats};
use crate::pipeline::RunInfo;
use crate::report::{StageTimes, StepReport};
use ::rerun::components::{LineStrip2D, Scalar, Text};
use ::rerun::log::Chunk;
use ::rerun::{LineStrips2D, RecordingStream, Scalars, TextDocument, TimelineName};
use nalgebra::Point2;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Why a recording could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file cannot be opened.
    #[error("{path}: cannot be opened: {source}")]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is no recording of ipslam.
    #[error("{path}: {reason}; a recording is needed that `ipslam run --record` of this version made")]
    NotARecording {
        /// The file.
        path: PathBuf,
        /// What was found.
        reason: String,
    },
    /// Its configuration is none that this version knows.
    #[error("{path}: recorded by version {version}: {source}")]
    Configuration {
        /// The file.
        path: PathBuf,
        /// Of the program that made it.
        version: String,
        /// What is wrong.
        source: Box<ConfigError>,
    },
}

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
    /// The file cannot be opened, is no recording, or one that does not tell how the run was made.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let not = |reason: &str| ReadError::NotARecording { path: path.to_owned(), reason: reason.to_owned() };
        let mut about = None;
        for chunk in Chunks::open(path)? {
            about = text(&chunk?.1, blueprint::ABOUT);
            if about.is_some() {
                break;
            }
        }
        let about = about.ok_or_else(|| not("it does not tell how the run was made"))?;
        let About { version, log, device, configuration: config } =
            toml::from_str(&about).map_err(|error| not(&format!("its configuration is not understood: {error}")))?;
        let unusable = |source| ReadError::Configuration {
            path: path.to_owned(),
            version: version.clone(),
            source: Box::new(source),
        };
        config.validate().map_err(unusable)?;
        Ok(Self { path: path.to_owned(), version, info: RunInfo { log, device, config } })
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
    pub fn new(store: Store) -> Result<Self, ReadError> {
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

/// The text that a chunk holds, if it is of this path.
pub(super) fn text(chunk: &Chunk, path: &str) -> Option<String> {
    if *chunk.entity_path() != path.into() {
        return None;
    }
    let texts = chunk.iter_component::<Text>(TextDocument::descriptor_text().component).next()?;
    texts.as_slice().first().map(|text| text.as_str().to_owned())
}

/// The corners of the first line that a chunk holds, if it is of this path.
fn positions(chunk: &Chunk, path: &str) -> Option<Vec<Point2<f64>>> {
    if chunk.is_static() || *chunk.entity_path() != path.into() {
        return None;
    }
    let strips = chunk.iter_component::<LineStrip2D>(LineStrips2D::descriptor_strips().component).next()?;
    let corners = strips.as_slice().first()?.0.iter();
    Some(corners.map(|corner| Point2::new(f64::from(corner.x()), f64::from(corner.y()))).collect())
}

/// The rows of numbers that a chunk holds, each with its time on a timeline.
pub(super) fn rows(chunk: &Chunk, timeline: &'static str) -> Vec<(i64, Vec<f64>)> {
    let component = Scalars::descriptor_scalars().component;
    let times = chunk.iter_component_indices(TimelineName::from(timeline), component);
    let numbers = chunk.iter_component::<Scalar>(component);
    let row = |numbers: &[Scalar]| numbers.iter().map(|number| number.0.0).collect();
    times.zip(numbers).map(|((time, _), numbers)| (time.as_i64(), row(numbers.as_slice()))).collect()
}

/// Rows of numbers, by path and then by time.
pub(super) struct Numbers {
    /// Paths to keep, each with the timeline of its rows.
    paths: &'static [(&'static str, &'static str)],
    rows: BTreeMap<&'static str, BTreeMap<i64, Vec<f64>>>,
}

impl Numbers {
    pub(super) const fn new(paths: &'static [(&'static str, &'static str)]) -> Self {
        Self { paths, rows: BTreeMap::new() }
    }

    /// Keeps what a chunk holds of these paths.
    pub(super) fn add(&mut self, chunk: &Chunk) {
        let is_of = |(path, _): &&(&str, &str)| *chunk.entity_path() == (*path).into();
        if let Some((path, timeline)) = self.paths.iter().find(is_of)
            && !chunk.is_static()
        {
            self.rows.entry(path).or_default().extend(rows(chunk, timeline));
        }
    }

    /// The rows of a path, in the order of their times.
    pub(super) fn rows<'a>(&'a self, path: &str) -> impl DoubleEndedIterator<Item = (i64, &'a [f64])> + use<'a> {
        self.rows.get(path).into_iter().flatten().map(|(&time, row)| (time, row.as_slice()))
    }

    fn at(&self, path: &str, time: i64) -> Option<&[f64]> {
        self.rows.get(path)?.get(&time).map(Vec::as_slice)
    }
}

/// The numbers that are recorded of each step of a run.
const NUMBERS: [(&str, &str); 6] = [
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

/// A pose as it was: its heading is not wrapped again.
pub(super) fn exactly(x: f64, y: f64, heading: f64) -> Pose {
    Pose { x, y, heading }
}
