//! `ipslam convert` of a published set: its detections become a recording.

use super::say::say;
use anyhow::{Context as _, ensure};
use ipslam::io::datasets::{self, ConvertError, Converted, Dataset, Dataset3, Options, imu_tracks};
use ipslam::io::semantic::truth;
use ipslam::io::{tum, visual_inertial};
use std::path::Path;

/// What is chosen of a set.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Sets of detections")]
pub struct DatasetArgs {
    /// Robot, or drive, where the set has several
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    robot: Option<u32>,
    /// Classes that its landmarks are given in turn; 3 for MR.CLAM, else 1
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    classes: Option<usize>,
    /// Share of detections with a wrong class; 0.1 with more than one class
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    wrong_labels: Option<f64>,
    /// Seed of what is drawn, wrong classes for one; 1 by default
    #[arg(long, allow_negative_numbers = true)]
    seed: Option<u64>,
    /// The first and the last row that is used, of Starry Night
    #[arg(long, value_name = "ROW", num_args = 2)]
    rows: Option<Vec<usize>>,
}

impl DatasetArgs {
    /// Whether any option is given.
    pub fn are_given(&self) -> bool {
        self.options() != Options::default()
    }

    fn options(&self) -> Options {
        let Self { robot, classes, wrong_labels, seed, .. } = *self;
        let rows = self.rows.as_deref().and_then(|rows| Some((*rows.first()?, *rows.last()?)));
        Options { robot, classes, wrong_labels, seed, rows }
    }

    /// Makes the folder of a recording.
    pub fn convert(&self, set: Dataset, input: &Path, output: &Path) -> anyhow::Result<()> {
        ensure_new(output)?;
        let converted = set.read(input, &self.options()).map_err(inner)?;
        datasets::write(output, &converted).context("the recording is not complete")?;
        let Converted { recording, notes, .. } = &converted;
        report(output, notes, [recording.frames.len(), recording.detections(), recording.odometry.len()]);
        Ok(())
    }

    /// The same of a robot of space.
    pub fn convert3(&self, set: Dataset3, input: &Path, output: &Path) -> anyhow::Result<()> {
        ensure_new(output)?;
        let converted = set.read(input, &self.options()).map_err(inner)?;
        datasets::write3(output, &converted).context("the recording is not complete")?;
        let Converted { recording, notes, .. } = &converted;
        report(output, notes, [recording.frames.len(), recording.detections(), recording.odometry.len()]);
        Ok(())
    }
}

fn inner(error: ConvertError) -> anyhow::Error {
    match error {
        ConvertError::Log(error) => error.into(),
        ConvertError::Option(error) => error.into(),
    }
}

fn report(output: &Path, notes: &[String], [frames, detections, odometry]: [usize; 3]) {
    notes.iter().for_each(|note| say!("note: {note}"));
    say!("{}: {frames} frames, {detections} detections, {odometry} rows of odometry", output.display());
}

/// Makes the folder of a recording of a camera with an inertial sensor.
pub fn convert_imu_tracks(input: &Path, output: &Path) -> anyhow::Result<()> {
    ensure_new(output)?;
    let (recording, truth) = imu_tracks::read(input)?;
    visual_inertial::write(output, &recording).context("the recording is not complete")?;
    tum::write3(&output.join(truth::TRAJECTORY), &truth)?;
    let features: usize = recording.frames.iter().map(|frame| frame.features.len()).sum();
    let (frames, readings) = (recording.frames.len(), recording.imu.len());
    say!("{}: {frames} pictures, {features} features, {readings} inertial readings", output.display());
    Ok(())
}

/// Files of another recording would be taken for the truth about this one.
pub fn ensure_new(output: &Path) -> anyhow::Result<()> {
    let is_new =
        !output.exists() || (output.is_dir() && output.read_dir().is_ok_and(|mut files| files.next().is_none()));
    ensure!(is_new, "{}: a recording needs a new folder: name one that does not exist or is empty", output.display());
    Ok(())
}
