//! Records a run for the Rerun viewer: to a file (`.rrd`), or live to a viewer that is running.
//!
//! In: [`StepReport`]s in the order of the steps, then the [`RunResult`]. Out: what [`layout`] names, on two
//! timelines: `step`, and `time`, the seconds since the first step's stamp. Stamps may go backwards in a log; `time`
//! then stands still until they have caught up.
//!
//! Recording never stops a run. What goes wrong after the start ends the recording, and [`Observer::failure`]
//! tells it; the observer ignores the steps that follow.

use super::{Observer, RunResult, StepReport};
use ::rerun::blueprint::BlueprintActivation;
use ::rerun::sink::SinkFlushError;
use ::rerun::{DEFAULT_CONNECT_URL, RecordingStream, RecordingStreamBuilder, RecordingStreamError};
use log::Recorder;
use std::path::{Path, PathBuf};
use std::time::Duration;

pub mod layout;
mod log;

/// Name under which the viewer keeps the layout of its views.
const APPLICATION: &str = "ipslam";
/// The recording is written out, and asked whether that worked, every so many steps.
const CHECK_EVERY: u32 = 100;
/// A file or viewer that takes no data for so long is given up.
const PATIENCE: Duration = Duration::from_secs(10);

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
        /// Where it was looked for.
        url: String,
        /// What was wrong.
        reason: String,
    },
    /// The recording cannot be set up.
    #[error("the recording cannot be started: {0}; run without recording")]
    Start(#[from] RecordingStreamError),
}

/// Records what it observes for the Rerun viewer.
///
/// The recording is complete after [`Observer::on_finish`], or once the observer is dropped.
pub struct RerunObserver {
    /// `None` once the recording ended.
    recorder: Option<Recorder>,
    failure: Option<String>,
    /// What to look at where the recording breaks off.
    hint: &'static str,
}

impl RerunObserver {
    /// Records to a new file, replacing what is there. `name` is shown as the name of the recording.
    ///
    /// # Errors
    /// The file cannot be made or written to.
    pub fn to_file(path: &Path, name: &str) -> Result<Self, RecordError> {
        let failed = |reason: String| RecordError::File { path: path.to_owned(), reason };
        let stream = builder(name).save(path).map_err(|error| match error {
            RecordingStreamError::FileSink(::rerun::sink::FileSinkError::CreateFile { source, .. }) => {
                failed(source.to_string())
            }
            other => failed(other.to_string()),
        })?;
        Self::start(stream, "is the disk full?", failed)
    }

    /// Streams to a viewer that is running, on this computer where no address is given. `name` is shown as the name
    /// of the recording.
    ///
    /// # Errors
    /// The address is none of a viewer, or none answers there within some seconds.
    pub fn connect(url: Option<&str>, name: &str) -> Result<Self, RecordError> {
        let url = url.unwrap_or(DEFAULT_CONNECT_URL);
        let stream = builder(name)
            .connect_grpc_opts(url)
            .map_err(|error| RecordError::Address { url: url.to_owned(), reason: error.to_string() })?;
        let failed = |reason| RecordError::NoViewer { url: url.to_owned(), reason };
        Self::start(stream, "was the viewer closed?", failed)
    }

    /// Sends the layout and the styles, and makes sure that they arrive.
    fn start(
        stream: RecordingStream,
        hint: &'static str,
        failed: impl Fn(String) -> RecordError,
    ) -> Result<Self, RecordError> {
        // By default the recording carries the time of the computer, as a third timeline.
        stream.set_log_time_enabled(false);
        layout::blueprint().send(&stream, BlueprintActivation::default())?;
        layout::log_styles(&stream)?;
        stream.flush_with_timeout(PATIENCE).map_err(|error| failed(reason(&error)))?;
        Ok(Self { recorder: Some(Recorder::new(stream)), failure: None, hint })
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
    fn on_step(&mut self, report: &StepReport<'_>) {
        self.record(|recorder| {
            recorder.log_step(report).map_err(|error| error.to_string())?;
            if report.step % CHECK_EVERY == CHECK_EVERY - 1 { check(recorder.stream()) } else { Ok(()) }
        });
    }

    fn on_finish(&mut self, result: &RunResult) {
        self.record(|recorder| {
            recorder.log_result(result).map_err(|error| error.to_string())?;
            check(recorder.stream())
        });
        self.recorder = None;
    }

    fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }
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
