//! `ipslam convert` and `ipslam semantic` of a folder of pictures: they become a recording of detections and odometry.

use super::UsageError;
use super::progress::{Bar, PERMILLE};
use super::say::say;
use anyhow::{Context as _, anyhow};
use ipslam::images::{Detector, FrontEnd, Shown};
use ipslam::io::{pictures, semantic, visual_inertial, write_whole};
use ipslam::picture::keyframe_picture;
use std::path::{Path, PathBuf};

/// How objects are found in pictures.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Folders of pictures")]
pub struct PicturesArgs {
    /// Network that detects objects: a single-shot detector (SSD) as ONNX
    #[arg(long, value_name = "FILE.onnx", requires = "labels")]
    detector: Option<PathBuf>,
    /// Names of its classes, a line each, the background first
    #[arg(long, value_name = "FILE.txt", requires = "detector")]
    labels: Option<PathBuf>,
    /// Folder for a picture of each keyframe with its features, tracks and objects
    #[arg(long, value_name = "DIR", requires = "detector")]
    figures: Option<PathBuf>,
}

impl PicturesArgs {
    /// Refuses options for pictures where there are none.
    pub fn refuse(&self, input: &Path) -> Result<(), UsageError> {
        let text =
            || format!("{}: there is no {} in it, and --detector is for pictures", input.display(), pictures::PICTURES);
        if self.detector.is_some() { Err(UsageError(text())) } else { Ok(()) }
    }

    /// Makes the folder of a recording.
    pub fn convert(&self, input: &Path, output: &Path) -> anyhow::Result<()> {
        let (Some(detector), Some(labels)) = (&self.detector, &self.labels) else {
            let folder = input.display();
            let remedy = "objects in pictures need a detector: name one with --detector, and its classes with --labels";
            return Err(UsageError(format!("{folder}: {remedy}")).into());
        };
        let found = pictures::read(input)?;
        let detector = Detector::load(detector, labels)?;
        let mut front_end = FrontEnd::new(found.sensors, &detector, found.least_score)?;
        if let Some(figures) = &self.figures {
            std::fs::create_dir_all(figures)
                .with_context(|| format!("{}: no folder for figures", figures.display()))?;
        }
        let mut bar = Bar::new(Some(PERMILLE));
        for (number, (stamp, path)) in found.files.iter().enumerate() {
            let picture = pictures::read_picture(path)?;
            let shown = front_end.add(*stamp, &picture).with_context(|| path.display().to_string())?;
            if let (Some(figures), Some(shown)) = (&self.figures, shown) {
                draw(figures, path, &picture, &shown, detector.labels())?;
            }
            bar.update(PERMILLE * (number as u64 + 1) / found.files.len() as u64, |_| "pictures".to_owned());
        }
        bar.finish();
        let (recording, tracks) = front_end.finish(found.way).with_context(|| input.display().to_string())?;
        semantic::write3(output, &recording).context("the recording is not complete")?;
        visual_inertial::write_tracks(output, &tracks)?;
        let features: usize = tracks.iter().map(|frame| frame.features.len()).sum();
        say!(
            "{}: {} keyframes of {} pictures, {features} features, {} detections",
            output.display(),
            tracks.len(),
            found.files.len(),
            recording.detections()
        );
        Ok(())
    }
}

fn draw(folder: &Path, path: &Path, picture: &image::RgbImage, shown: &Shown, labels: &[String]) -> anyhow::Result<()> {
    let png = keyframe_picture(picture, shown, labels)?;
    let name = path.file_stem().ok_or_else(|| anyhow!("{}: a picture without a name", path.display()))?;
    let path = folder.join(name).with_extension("png");
    Ok(write_whole(&path, |file| file.write_all(&png))?)
}
