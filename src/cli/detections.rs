//! `--detections`: what a detector of objects saw in the drive of a log.

use super::UsageError;
use super::recording::RecordingArgs;
use super::say::say;
use anyhow::ensure;
use ipslam::io::semantic::read_detections;
use ipslam::objects::Detections;
use std::path::PathBuf;

/// Which detections to use.
#[derive(Debug, clap::Args)]
pub struct DetectionArgs {
    /// Objects that a detector saw in this drive, by the clock of the log: t,class,score,range,bearing (docs/formats.md), with
    /// the sensors.toml beside it. They weigh the particles beside the scans, and come to the map
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["more", "earlier"])]
    detections: Option<PathBuf>,
}

impl DetectionArgs {
    /// Reads them; `None` where there are none.
    pub fn read(&self, recording: &RecordingArgs) -> anyhow::Result<Option<Detections>> {
        let Some(path) = &self.detections else { return Ok(None) };
        ensure!(
            !recording.is_asked_for(),
            UsageError(
                "--detections cannot be recorded yet, and a recording without them could not repeat the run: leave out --record \
                 and --connect"
                    .to_owned()
            )
        );
        let (detections, warnings) = read_detections(path)?;
        warnings.iter().for_each(|warning| say!("warning: {warning}"));
        Ok(Some(detections))
    }
}
