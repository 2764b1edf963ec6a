//! Reads a recording back: what the run was started with, its log, and what every step found.
//!
//! The log in a recording is a [`LogSource`] like any other. A recording that breaks off, because the run or the machine
//! was stopped, is read as far as it goes.

use super::blueprint;
use super::frames::{WholeFrames, whole_frames};
use super::log::About;
use crate::config::ConfigError;
use crate::geometry::Pose;
use crate::log::{LaserReading, LogEntry, LogError, LogReader, LogSource, LogStats};
use crate::pipeline::RunInfo;
use crate::report::{StageTimes, StepReport};
use ::rerun::components::{LineStrip2D, Scalar, Text};
use ::rerun::log::Chunk;
use ::rerun::{
    ChunkStore, ChunkStoreConfig, ComponentDescriptor, EntityPath, LineStrips2D, RecordingStream, Scalars, StoreKind,
    TextDocument, TimelineName,
};
use nalgebra::Point2;
use std::collections::BTreeMap;
use std::io::Read as _;
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

/// A run, read back.
#[derive(Debug)]
pub struct RecordedRun {
    store: Store,
    entries: Arc<[LogEntry]>,
    /// Its steps, in their order.
    pub steps: Vec<RecordedStep>,
    /// Its result; none where the recording breaks off before.
    pub result: Option<RecordedResult>,
}

/// What a file holds, of whatever kind the run is.
#[derive(Debug)]
pub struct Store {
    path: PathBuf,
    chunks: ChunkStore,
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
        let open = |source| ReadError::Open { path: path.to_owned(), source };
        let not = |reason: &str| ReadError::NotARecording { path: path.to_owned(), reason: reason.to_owned() };
        let mut file = std::fs::File::open(path).map_err(open)?;
        if file.metadata().map_err(open)?.is_dir() {
            return Err(open(std::io::ErrorKind::IsADirectory.into()));
        }
        let WholeFrames { bytes, damage } = whole_frames(&mut file).map_err(open)?;
        let stores = ChunkStore::from_rrd_reader(&ChunkStoreConfig::ALL_DISABLED, &mut file.take(bytes))
            .map_err(|error| not(&format!("{error:#}")))?;
        let recordings = stores.into_iter().filter(|(id, _)| id.kind() == StoreKind::Recording);
        let mut recordings: Vec<ChunkStore> = recordings.map(|(_, store)| store).collect();
        let nothing = damage.unwrap_or_else(|| "it holds no recording".to_owned());
        let chunks = recordings.pop().ok_or_else(|| not(&nothing))?;
        if !recordings.is_empty() {
            return Err(not("it holds several recordings"));
        }

        let about = text(&chunks, blueprint::ABOUT).ok_or_else(|| not("it does not tell how the run was made"))?;
        let About { version, log, device, configuration: config } =
            toml::from_str(&about).map_err(|error| not(&format!("its configuration is not understood: {error}")))?;
        let unusable = |source| ReadError::Configuration {
            path: path.to_owned(),
            version: version.clone(),
            source: Box::new(source),
        };
        config.validate().map_err(unusable)?;
        Ok(Self { path: path.to_owned(), chunks, version, info: RunInfo { log, device, config } })
    }

    /// Name of the file, without its ending.
    pub fn name(&self) -> String {
        self.path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }

    pub(super) fn not(&self, reason: &str) -> ReadError {
        ReadError::NotARecording { path: self.path.clone(), reason: reason.to_owned() }
    }

    fn chunks(&self, path: &str) -> impl Iterator<Item = &Arc<Chunk>> {
        chunks(&self.chunks, path)
    }

    pub(super) fn text(&self, path: &str) -> Option<String> {
        text(&self.chunks, path)
    }

    /// Rows of numbers, by their time on a timeline.
    pub(super) fn rows(&self, path: &str, timeline: &'static str) -> BTreeMap<i64, Vec<f64>> {
        let ComponentDescriptor { component, .. } = Scalars::descriptor_scalars();
        let mut rows = BTreeMap::new();
        for chunk in self.chunks(path).filter(|chunk| !chunk.is_static()) {
            let times = chunk.iter_component_indices(TimelineName::from(timeline), component);
            let numbers = chunk.iter_component::<Scalar>(component);
            for ((time, _), numbers) in times.zip(numbers) {
                rows.insert(time.as_i64(), numbers.as_slice().iter().map(|number| number.0.0).collect());
            }
        }
        rows
    }

    /// Sends what is to be seen to another recording, with paths that lie under `root`.
    pub(super) fn send(&self, stream: &RecordingStream, root: &str) {
        let shown = |chunk: &&Arc<Chunk>| {
            let path = chunk.entity_path().to_string();
            !chunk.is_static() && ["/world", "/plots"].iter().any(|shown| path.starts_with(shown))
        };
        for chunk in self.chunks.iter_physical_chunks().filter(shown) {
            let path = blueprint::under(root, chunk.entity_path().to_string().trim_start_matches('/'));
            stream.send_chunk(chunk.clone_with_new_entity_path(path.into()));
        }
    }
}

fn chunks<'a>(store: &'a ChunkStore, path: &str) -> impl Iterator<Item = &'a Arc<Chunk>> + use<'a> {
    let path: EntityPath = path.into();
    store.iter_physical_chunks().filter(move |chunk| chunk.entity_path() == &path)
}

fn text(store: &ChunkStore, path: &str) -> Option<String> {
    let component = TextDocument::descriptor_text().component;
    let of_chunk = |chunk: &Arc<Chunk>| {
        let texts = chunk.iter_component::<Text>(component).next()?;
        texts.as_slice().first().map(|text| text.as_str().to_owned())
    };
    chunks(store, path).find_map(of_chunk)
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
    /// Its log is damaged.
    pub fn new(store: Store) -> Result<Self, ReadError> {
        let entries = entries(&store).ok_or_else(|| store.not("its log is damaged"))?.into();
        let (steps, result) = (steps(&store), result(&store));
        Ok(Self { entries, steps, result, store })
    }

    /// What the file holds.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// Entries of the log.
    pub fn entries(&self) -> &[LogEntry] {
        &self.entries
    }

    /// Positions of the final trajectory, one for each laser and odometry reading \[m\]; rounded to f32, and empty where
    /// the recording breaks off.
    pub fn trajectory(&self) -> Vec<Point2<f64>> {
        let component = LineStrips2D::descriptor_strips().component;
        let of_chunk = |chunk: &Arc<Chunk>| {
            let strips = chunk.iter_component::<LineStrip2D>(component).next()?;
            let corners = strips.as_slice().first()?.0.iter();
            Some(corners.map(|corner| Point2::new(f64::from(corner.x()), f64::from(corner.y()))).collect())
        };
        let mut chunks = self.store.chunks(blueprint::TRAJECTORY).filter(|chunk| !chunk.is_static());
        chunks.find_map(of_chunk).unwrap_or_default()
    }
}

impl LogSource for RecordedRun {
    fn name(&self) -> String {
        self.store.name()
    }

    fn open(&self) -> Result<Box<dyn LogReader>, LogError> {
        Ok(Box::new(RecordedReader { entries: Arc::clone(&self.entries), stats: LogStats::default() }))
    }
}

/// The entries of a recorded log.
struct RecordedReader {
    entries: Arc<[LogEntry]>,
    /// Its lines are the entries that were handed out.
    stats: LogStats,
}

impl Iterator for RecordedReader {
    type Item = Result<LogEntry, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        let entry = self.entries.get(self.stats.lines as usize)?.clone();
        self.stats.lines += 1;
        match entry {
            LogEntry::Laser(_) => self.stats.laser += 1,
            LogEntry::Odometry { .. } => self.stats.odometry += 1,
            LogEntry::Truth { .. } => {}
        }
        Some(Ok(entry))
    }
}

impl LogReader for RecordedReader {
    fn stats(&self) -> &LogStats {
        &self.stats
    }

    fn progress(&self) -> Option<(u64, u64)> {
        Some((self.stats.lines, self.entries.len() as u64))
    }
}

/// The log. `None` where a row has another length than it can have.
fn entries(store: &Store) -> Option<Vec<LogEntry>> {
    let mut entries: BTreeMap<i64, LogEntry> = BTreeMap::new();
    for (entry, row) in store.rows(blueprint::LASER, blueprint::ENTRY_TIMELINE) {
        let (
            &[x, y, heading, stamp, ahead, left, turned, first_angle, angle_step, max_range, forward, sideways, turn],
            ranges,
        ) = row.split_first_chunk::<13>()?;
        let reading = LaserReading {
            stamp,
            odom_from_robot: exactly(x, y, heading),
            robot_from_laser: exactly(ahead, left, turned),
            start_from_end: exactly(forward, sideways, turn),
            first_angle,
            angle_step,
            max_range,
            ranges: ranges.to_vec(),
        };
        entries.insert(entry, LogEntry::Laser(reading));
    }
    for (entry, row) in store.rows(blueprint::ODOMETRY_READING, blueprint::ENTRY_TIMELINE) {
        let [x, y, heading, stamp] = row.try_into().ok()?;
        entries.insert(entry, LogEntry::Odometry { stamp, odom_from_robot: exactly(x, y, heading) });
    }
    for (entry, row) in store.rows(blueprint::TRUTH, blueprint::ENTRY_TIMELINE) {
        let [x, y, heading, stamp] = row.try_into().ok()?;
        entries.insert(entry, LogEntry::Truth { stamp, world_from_robot: exactly(x, y, heading) });
    }
    // What follows a gap came after something that is lost.
    let whole = (0..).zip(entries).take_while(|(number, (entry, _))| number == entry);
    Some(whole.map(|(_, (_, entry))| entry).collect())
}

fn steps(store: &Store) -> Vec<RecordedStep> {
    let rows = |path| store.rows(path, blueprint::STEP_TIMELINE);
    let [checksums, sizes, clusters, seconds] =
        [blueprint::CHECKSUM, blueprint::EFFECTIVE_SAMPLE_SIZE, blueprint::CLUSTERS, blueprint::SECONDS].map(rows);
    let step = |(step, pose): (i64, Vec<f64>)| {
        let [x, y, heading] = pose.try_into().ok()?;
        let seconds = seconds.get(&step)?.as_slice().try_into().ok()?;
        Some(RecordedStep {
            step: step as u32,
            world_from_robot: exactly(x, y, heading),
            checksum: *checksums.get(&step)?.first()? as u32,
            effective_sample_size: *sizes.get(&step)?.first()?,
            clusters: *clusters.get(&step)?.first()? as usize,
            times: StageTimes::from_seconds(seconds),
        })
    };
    // The last step may have been written in part.
    rows(blueprint::POSE).into_iter().map_while(step).collect()
}

fn result(store: &Store) -> Option<RecordedResult> {
    let (_, row) = store.rows(blueprint::RESULT, blueprint::STEP_TIMELINE).pop_last()?;
    let [checksum, is_smoothed] = row.try_into().ok()?;
    Some(RecordedResult { checksum: checksum as u32, is_smoothed: is_smoothed == 1.0 })
}

/// A pose as it was: its heading is not wrapped again.
pub(super) fn exactly(x: f64, y: f64, heading: f64) -> Pose {
    Pose { x, y, heading }
}
