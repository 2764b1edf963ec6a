//! `--record` and `--connect`: the run for the Rerun viewer, with the feature `record`.

use clap::ValueEnum;
use ipslam::pipeline::RunInfo;
use ipslam::report::Observer;
use std::path::{Path, PathBuf};

/// Where to record.
#[derive(Clone, Debug, clap::Args)]
pub struct RecordingArgs {
    /// Record every step to this file, for the Rerun viewer and for `ipslam replay`; of several logs the second goes to FILE-2.rrd, and
    /// so on
    #[arg(long, value_name = "FILE.rrd")]
    record: Option<PathBuf>,
    /// How much of each step is recorded
    #[arg(long, value_enum, default_value_t)]
    record_level: RecordLevel,
    /// Show every step in a running Rerun viewer, on this machine where no URL is given
    #[arg(long, value_name = "URL", num_args = 0..=1, require_equals = true)]
    connect: Option<Option<String>>,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
pub enum RecordLevel {
    /// What repeats the run and shows it, with a sample of the particles
    #[default]
    Light,
    /// All particles, weights and ancestry, clusters of each scan, and ellipses of the map
    Full,
}

#[cfg(feature = "record")]
impl From<RecordLevel> for ipslam::record::rerun::Level {
    fn from(level: RecordLevel) -> Self {
        match level {
            RecordLevel::Light => Self::Light,
            RecordLevel::Full => Self::Full,
        }
    }
}

impl RecordingArgs {
    /// Whether anything is recorded or shown.
    pub fn is_asked_for(&self) -> bool {
        self.record.is_some() || self.connect.is_some()
    }

    /// The same for the log of this number, from 1.
    pub fn of_log(&self, number: usize) -> Self {
        let numbered = |path: PathBuf| {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy();
            let ending = path.extension().map_or_else(String::new, |ending| format!(".{}", ending.to_string_lossy()));
            path.with_file_name(format!("{stem}-{number}{ending}"))
        };
        let record = self.record.clone();
        Self { record: if number > 1 { record.map(numbered) } else { record }, ..self.clone() }
    }

    /// The observers that record or show a run that reads these files.
    #[cfg(feature = "record")]
    pub fn observers<'a>(
        &self,
        info: &RunInfo,
        inputs: impl IntoIterator<Item = &'a Path>,
    ) -> anyhow::Result<Vec<Box<dyn Observer>>> {
        use ipslam::record::rerun::RerunObserver;
        let level = self.record_level.into();
        let mut observers: Vec<Box<dyn Observer>> = Vec::new();
        if let Some(path) = &self.record {
            inputs.into_iter().try_for_each(|input| refuse_input(path, Some(input)))?;
            observers.push(Box::new(RerunObserver::to_file(path, info, level)?));
        }
        if let Some(url) = &self.connect {
            observers.push(Box::new(RerunObserver::connect(url.as_deref(), info, level)?));
        }
        Ok(observers)
    }

    /// Without the feature there are none.
    #[cfg(not(feature = "record"))]
    pub fn observers<'a>(
        &self,
        _info: &RunInfo,
        _inputs: impl IntoIterator<Item = &'a Path>,
    ) -> anyhow::Result<Vec<Box<dyn Observer>>> {
        anyhow::ensure!(self.record.is_none() && self.connect.is_none(), "--record and --connect need {FEATURE}");
        Ok(Vec::new())
    }
}

/// Refuses to record to a file that is part of the recording of detections in this folder.
#[cfg(feature = "record")]
pub fn check_target(path: &Path, folder: &Path) -> anyhow::Result<()> {
    // An unreadable folder is reported when its files are read.
    let mut inputs = std::fs::read_dir(folder).into_iter().flatten().flatten();
    inputs.try_for_each(|input| refuse_input(path, Some(&input.path())))
}

/// Without the feature nothing can.
#[cfg(not(feature = "record"))]
pub fn check_target(_path: &Path, _folder: &Path) -> anyhow::Result<()> {
    anyhow::bail!("--record needs {FEATURE}")
}

/// A recording would destroy what the run reads, by whichever name it goes.
#[cfg(feature = "record")]
pub fn refuse_input(recording: &Path, input: Option<&Path>) -> anyhow::Result<()> {
    // What is not there yet is no input.
    let is_input = input.is_some_and(|input| same_file::is_same_file(recording, input).unwrap_or(false));
    anyhow::ensure!(!is_input, "{}: this file is read by the run; record to another one", recording.display());
    Ok(())
}

/// What a program lacks that was built without the recorder.
#[cfg(not(feature = "record"))]
pub const FEATURE: &str = "the feature `record`, which this program was built without; build it with \
                           `cargo build --release --features record`";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_log_has_its_own_recording() {
        let named =
            |name: &str| RecordingArgs { record: Some(name.into()), record_level: RecordLevel::Full, connect: None };
        let of_log = |name, number| named(name).of_log(number).record;
        assert_eq!(of_log("a/run.rrd", 1), Some("a/run.rrd".into()));
        assert_eq!(of_log("a/run.rrd", 2), Some("a/run-2.rrd".into()));
        assert_eq!(of_log("run", 12), Some("run-12".into()));
    }
}
