//! Records a run for the Rerun viewer: to a file (`.rrd`), or live to a viewer that is running.
//!
//! In: what the run starts with, entries of the log and steps in their order, then the result. Out: what
//! [`blueprint`] names, on two timelines: `step`, and `time`, the seconds since the first step's stamp. Stamps may go
//! backwards in a log; `time` then stands still until they have caught up. The entries of the log have a timeline of their
//! own. With them and the configuration the run can be repeated: [`read`] does the reading.
//!
//! Recording never stops a run. What goes wrong after the start ends the recording, and [`Observer::failure`]
//! returns the reason; the observer ignores the steps that follow.

use crate::pipeline::RunInfo;
use crate::report::{Event, Observer};
use ::rerun::blueprint::BlueprintActivation;
use ::rerun::sink::{FileSink, FileSinkError, FileSinkOptions, SinkFlushError};
use ::rerun::{DEFAULT_CONNECT_URL, RecordingStream, RecordingStreamBuilder, RecordingStreamError};
use log::Recorder;
use read::{ReadError, RecordedRun};
use std::path::{Path, PathBuf};
use std::time::Duration;

pub mod blueprint;
mod chunks;
mod earlier;
mod entries;
mod frames;
mod log;
pub mod read;
mod rows;
pub mod semantic;

/// Application id: the viewer keeps one blueprint for each.
const APPLICATION: &str = "ipslam";
/// Steps between flushes of the recording, each of which checks that it was written.
const CHECK_EVERY: u32 = 100;
/// A file or viewer that takes no data for so long is given up.
const PATIENCE: Duration = Duration::from_secs(10);

/// How much a recording holds of each step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Level {
    /// What repeats the run and shows it: a sample of the particles, the scan's points, the best map.
    #[default]
    Light,
    /// All particles with their weights and ancestry, the scan's clusters, and ellipses of the map as well.
    Full,
}

/// Why a recording could not be started.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The file cannot be written.
    #[error("{path}: the recording cannot be written: {reason}; choose a folder that exists and can be written to")]
    File {
        /// The file.
        path: PathBuf,
        /// What was wrong.
        reason: String,
    },
    /// The address is none of a viewer.
    #[error("{url} is no address of a Rerun viewer: {reason}; give one such as {DEFAULT_CONNECT_URL}")]
    Address {
        /// The address as it was given.
        url: String,
        /// What was wrong.
        reason: String,
    },
    /// No viewer answers.
    #[error(
        "no Rerun viewer answers at {url}: {reason}; start one of version {} first (`rerun`), or record to a file",
        ::rerun::build_info().version
    )]
    NoViewer {
        /// Where it was sought.
        url: String,
        /// What was wrong.
        reason: String,
    },
    /// The recording that was run again cannot be read any more.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The recording cannot be set up.
    #[error("the recording cannot be started: {0}; run without recording")]
    Start(#[from] RecordingStreamError),
}

/// Records what it observes for the Rerun viewer.
///
/// The recording is complete after [`Event::Finished`], or once the observer is dropped.
pub struct RerunObserver {
    /// `None` once the recording ended.
    recorder: Option<Recorder>,
    failure: Option<String>,
    /// What may have cut the recording short.
    hint: &'static str,
    /// Of a recording to a file, until its first step is in it.
    begun: Option<Begun>,
}

/// A file that takes the place of another one once it is worth more than that: when a step is in it.
struct Begun {
    partial: PathBuf,
    path: PathBuf,
}

impl Begun {
    /// Where to write for a file of this path; what is no regular file (a pipe, a device) is written to directly.
    fn beside(path: &Path) -> (PathBuf, Option<Self>) {
        if std::fs::metadata(path).is_ok_and(|metadata| !metadata.is_file()) {
            return (path.to_owned(), None);
        }
        // A link stays a link: the file that it leads to is replaced.
        let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let partial = path.with_file_name(format!(".{name}.{}.partial", std::process::id()));
        (partial.clone(), Some(Self { partial, path }))
    }

    /// Takes the place.
    fn finish(self) -> std::io::Result<()> {
        std::fs::rename(&self.partial, &self.path)
    }
}

impl Drop for Begun {
    fn drop(&mut self) {
        // Where nothing came of it; what took its place is not there any more.
        let _ = std::fs::remove_file(&self.partial);
    }
}

impl RerunObserver {
    /// Records to a new file. It takes the place of what is there once its first step is in it.
    ///
    /// # Errors
    /// The file cannot be made or written to.
    pub fn to_file(path: &Path, info: &RunInfo, level: Level) -> Result<Self, RecordError> {
        let (partial, begun) = Begun::beside(path);
        let (stream, failed) = file(path, &partial, &info.log)?;
        blueprint::views(&info.config).send(&stream, BlueprintActivation::default())?;
        Self::start(stream, "", level, info, FULL_DISK, begun, failed)
    }

    /// Records the replay of a recorded run to a new file, the recorded run beside it.
    ///
    /// # Errors
    /// As for [`RerunObserver::to_file`].
    pub fn beside(recorded: &RecordedRun, path: &Path, info: &RunInfo, level: Level) -> Result<Self, RecordError> {
        let (partial, begun) = Begun::beside(path);
        let (stream, failed) = file(path, &partial, &format!("{}, replayed", info.log))?;
        blueprint::comparison_blueprint().send(&stream, BlueprintActivation::default())?;
        // The styles of a recorded run differ where a replay shares its plots.
        blueprint::log_styles(&stream, blueprint::RECORDED)?;
        recorded.store().send(&stream, blueprint::RECORDED)?;
        Self::start(stream, blueprint::REPLAYED, level, info, FULL_DISK, begun, failed)
    }

    /// Streams to a viewer that is running, on this computer where no address is given.
    ///
    /// # Errors
    /// The address is none of a viewer, or none answers there within some seconds.
    pub fn connect(url: Option<&str>, info: &RunInfo, level: Level) -> Result<Self, RecordError> {
        let url = url.unwrap_or(DEFAULT_CONNECT_URL);
        let stream = builder(&info.log)
            .connect_grpc_opts(url)
            .map_err(|error| RecordError::Address { url: url.to_owned(), reason: error.to_string() })?;
        stream.set_log_time_enabled(false);
        blueprint::views(&info.config).send(&stream, BlueprintActivation::default())?;
        let failed = |reason| RecordError::NoViewer { url: url.to_owned(), reason };
        Self::start(stream, "", level, info, "was the viewer closed?", None, failed)
    }

    /// Sends what does not change, and makes sure that it arrives.
    fn start(
        stream: RecordingStream,
        root: &'static str,
        level: Level,
        info: &RunInfo,
        hint: &'static str,
        begun: Option<Begun>,
        failed: impl Fn(String) -> RecordError,
    ) -> Result<Self, RecordError> {
        let recorder = Recorder::new(stream, root, level, info)?;
        let this = Self { recorder: Some(recorder), failure: None, hint, begun };
        this.recorder.as_ref().map_or(Ok(()), |recorder| check(recorder.stream())).map_err(failed)?;
        Ok(this)
    }

    /// Does something with the recorder, and ends the recording where that fails.
    fn record(&mut self, log: impl FnOnce(&mut Recorder) -> Result<(), String>) {
        let Some(recorder) = &mut self.recorder else { return };
        if let Err(reason) = log(recorder) {
            self.failure =
                Some(format!("the recording broke off at step {}: {reason} ({})", recorder.step(), self.hint));
            // Closing would wait for a viewer that hangs, as long as it takes: the run does not.
            let recorder = self.recorder.take();
            // Where no thread can be had it is closed here.
            let _closing = std::thread::Builder::new().spawn(move || drop(recorder));
        }
    }
}

impl Observer for RerunObserver {
    fn on_event(&mut self, event: &Event<'_>) {
        let mut begun = self.begun.take();
        self.record(|recorder| {
            let logged = match event {
                Event::Entry(entry) => recorder.log_entry(entry),
                Event::Step(report) => recorder.log_step(report),
                Event::Finished { result, is_smoothed } => recorder.log_result(result, *is_smoothed),
                Event::Scan(_) | Event::Pose(_) => Ok(()),
            };
            logged.map_err(|error| error.to_string())?;
            match event {
                Event::Step(_) if begun.is_some() => {
                    check(recorder.stream())?;
                    let Some(begun) = begun.take() else { return Ok(()) };
                    let path = begun.path.clone();
                    begun.finish().map_err(|error| format!("{}: {error}", path.display()))
                }
                Event::Step(report) if report.step % CHECK_EVERY == CHECK_EVERY - 1 => check(recorder.stream()),
                Event::Finished { .. } => check(recorder.stream()),
                _ => Ok(()),
            }
        });
        self.begun = begun;
        if let Event::Finished { .. } = event {
            self.recorder = None;
        }
    }

    fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }
}

const FULL_DISK: &str = "is the disk full?";

/// A stream to the file `partial`, and what to say of the file `path` where it takes nothing.
fn file(
    path: &Path,
    partial: &Path,
    name: &str,
) -> Result<(RecordingStream, impl Fn(String) -> RecordError + use<>), RecordError> {
    let named = path.to_owned();
    let failed = move |reason: String| RecordError::File { path: named.clone(), reason };
    // The footer that a file has by default lists every chunk, and is kept in memory until the end.
    let sink =
        FileSink::with_options(partial, FileSinkOptions { write_footer: false }).map_err(|error| match error {
            FileSinkError::CreateFile { source, .. } => failed(source.to_string()),
            other => failed(other.to_string()),
        })?;
    let stream = builder(name).set_sinks((sink,)).map_err(|error| failed(error.to_string()))?;
    // By default the recording carries the time of the computer, as another timeline.
    stream.set_log_time_enabled(false);
    Ok((stream, failed))
}

fn builder(name: &str) -> RecordingStreamBuilder {
    // Who asks for a recording gets one, whatever the environment says (`RERUN=off`).
    RecordingStreamBuilder::new(APPLICATION).recording_name(name).enabled(true)
}

/// Whether everything so far has arrived.
fn check(stream: &RecordingStream) -> Result<(), String> {
    stream.flush_with_timeout(PATIENCE).map_err(|error| reason(&error))
}

fn reason(error: &SinkFlushError) -> String {
    match error {
        SinkFlushError::Timeout => format!("no data was taken for {} s", PATIENCE.as_secs()),
        SinkFlushError::Failed { message } => message.clone(),
    }
}
