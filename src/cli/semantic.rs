//! `ipslam semantic`: a recording of detections in; trajectory, landmarks, weights and a summary out.

use super::UsageError;
use super::output::{OutArgs, Outputs};
use super::progress::{Bar, PERMILLE};
use super::recording::{check_target, record_mapping};
use super::say::{print_line, say};
use super::visual_inertial;
use anyhow::{Context as _, ensure};
use clap::ValueEnum;
use ipslam::association::Policy;
use ipslam::detections::Recording;
use ipslam::geometry::StampedPose;
use ipslam::io::semantic::{self as recordings, results, truth};
use ipslam::io::tum;
use ipslam::metrics::trajectory::reference_errors;
use ipslam::picture::object_map;
#[cfg(feature = "record")]
use ipslam::record::rerun::semantic::Mapping;
use ipslam::semantic::{Objects, SemanticConfig, SemanticError, SemanticMap, Weight, map, map_known};
use serde_json::json;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Maps the objects of a recording of detections, whose classes it knows and whose identities it does not; without
/// detections, the way of a camera with an inertial sensor.
#[derive(Debug, clap::Args)]
pub struct SemanticArgs {
    /// Folder of the recording: sensors.toml, odometry.csv, detections.csv; or sensors.toml, imu.csv, tracks.csv
    recording: PathBuf,
    #[command(flatten)]
    out: OutArgs,
    /// How detections are given to landmarks
    #[arg(long, value_enum, default_value_t)]
    association: Association,
    /// Hypotheses that the forward pass keeps
    #[arg(long, value_name = "COUNT", default_value_t = SemanticConfig::default().beam)]
    beam: usize,
    /// Keyframes that are estimated at once, as online; older ones stay as they are [default: all]
    #[arg(long, value_name = "COUNT")]
    window: Option<NonZeroUsize>,
    /// Which object each detection shows, as ids.csv of `ipslam convert` tells: the best that could be reached
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["association", "beam", "window"])]
    known_ids: Option<PathBuf>,
    /// Record how the map came about to this file, for the Rerun viewer and for `ipslam replay`
    #[arg(long, value_name = "FILE.rrd")]
    record: Option<PathBuf>,
}

/// How detections are given to landmarks.
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum Association {
    /// By their probability over all one-to-one assignments
    #[default]
    Soft,
    /// Each detection to its likeliest landmark
    Max,
    /// The likeliest one-to-one assignment
    Hungarian,
    /// The component of largest weight and density
    MaxMixture,
}

impl Association {
    fn policy(self) -> Policy {
        match self {
            Self::Soft => Policy::Soft,
            Self::Max => Policy::Max,
            Self::Hungarian => Policy::Hungarian,
            Self::MaxMixture => Policy::MaxMixture,
        }
    }
}

/// Maps the recording. Outputs that could not be written are returned as a list.
pub fn semantic(args: &SemanticArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    let config = SemanticConfig {
        association: args.association.policy(),
        beam: args.beam,
        window: args.window.map_or(0, NonZeroUsize::get),
        ..SemanticConfig::default()
    };
    config.validate()?;
    let folder = std::path::absolute(&args.recording).unwrap_or_else(|_| args.recording.clone());
    let name = folder.file_name().map_or_else(|| "recording".into(), |name| name.to_string_lossy().into_owned());
    if visual_inertial::is_recording(&args.recording) {
        let not_yet =
            || UsageError("--record: what a camera and an inertial sensor saw cannot be recorded yet".to_owned());
        ensure!(args.record.is_none(), not_yet());
        let mut outputs = args.out.open(&name)?;
        visual_inertial::estimate(&args.recording, &name, &mut outputs)?;
        return Ok(std::mem::take(&mut outputs.errors));
    }
    if let Some(path) = &args.record {
        check_target(path, &args.recording)?;
    }
    let read = recordings::read(&args.recording)?;
    for warning in &read.warnings {
        say!("{warning}");
    }
    let recording = read.recording;
    let mut outputs = args.out.open(&name)?;
    let ids = args.known_ids.as_deref().map(|path| truth::read_ids(path, &recording)).transpose()?;
    let task = Task { name: &name, recording: &recording, objects: ids.as_deref(), config };
    let (found, seconds) = task.map().with_context(|| args.recording.display().to_string())?;
    let score = Score::of(&args.recording, &recording, &found)?;
    task.write(&found, seconds, &score, &mut outputs)?;
    if let Some(path) = &args.record {
        outputs.note(record_mapping(path, &task, &found));
    }
    outputs.finish();
    found.verdict.doubts().iter().for_each(|doubt| say!("doubtful: {doubt}"));
    print_line!("{}{}", summary_line(&found, seconds), score.text());
    Ok(std::mem::take(&mut outputs.errors))
}

/// What is mapped, and how.
pub struct Task<'a> {
    pub name: &'a str,
    pub recording: &'a Recording,
    pub objects: Option<&'a Objects>,
    pub config: SemanticConfig,
}

impl Task<'_> {
    /// Maps it; returns the run time in seconds too.
    pub fn map(&self) -> Result<(SemanticMap, f64), SemanticError> {
        let began = Instant::now();
        let bar = Mutex::new(Bar::new(Some(PERMILLE)));
        let progress = |share: f64| {
            if let Ok(mut bar) = bar.try_lock() {
                bar.update((share * PERMILLE as f64) as u64, |_| "mapping".to_owned());
            }
        };
        let found = match self.objects {
            Some(objects) => map_known(self.recording, objects, &self.config, &progress),
            None => map(self.recording, &self.config, &progress),
        };
        bar.into_inner().unwrap_or_else(PoisonError::into_inner).finish();
        Ok((found?, began.elapsed().as_secs_f64()))
    }

    /// What is recorded of it.
    #[cfg(feature = "record")]
    pub fn mapping<'a>(&'a self, map: &'a SemanticMap) -> Mapping<'a> {
        let Self { name, recording, objects, config } = *self;
        Mapping { name, recording, objects, config, map }
    }

    /// Writes the outputs.
    pub fn write(&self, found: &SemanticMap, seconds: f64, score: &Score, outputs: &mut Outputs) -> anyhow::Result<()> {
        let path = outputs.stage("trajectory.tum");
        outputs.note(tum::write(&path, &found.trajectory()));
        for (name, text) in results::files(self.recording, found) {
            outputs.write(name, text.as_bytes());
        }
        match object_map(self.name, self.recording, found, &score.reference) {
            Ok(files) => files.iter().for_each(|(name, bytes)| outputs.write(name, bytes)),
            Err(error) => outputs.note(Err(error)),
        }
        let summary = json!({
            "recording": self.name,
            "seconds": seconds,
            "keyframes": found.keyframes.len(),
            "detections": found.detections,
            "landmarks": found.landmarks.len(),
            "objective": found.objective,
            "calibration": {
                "forward_scale": found.calibration[0],
                "turn_scale": found.calibration[1],
                "curvature": found.calibration[2],
            },
            "detection_probability": found.detection_probability,
            "runs": found.runs.iter().map(|run| json!({
                "new_density": run.new_density,
                "objective": run.objective,
                "landmarks": run.landmarks,
            })).collect::<Vec<_>>(),
            "verdict": verdict(found),
            "doubts": found.verdict.doubts(),
            "evidence": found.verdict,
            "settings": serde_json::to_value(self.config)?,
            "rms_error": score.rms,
            "weight_on_right_landmark": score.right,
        });
        outputs.write("summary.json", format!("{summary:#}\n").as_bytes());
        Ok(())
    }
}

/// Whether to believe a map.
pub fn verdict(found: &SemanticMap) -> &'static str {
    if found.verdict.is_consistent() { "consistent" } else { "doubtful" }
}

fn summary_line(found: &SemanticMap, seconds: f64) -> String {
    format!(
        "{} landmarks from {} detections in {} keyframes, {seconds:.1} s; objective {:.1}; {}",
        found.landmarks.len(),
        found.detections,
        found.keyframes.len(),
        found.objective,
        verdict(found),
    )
}

/// How good the map is, where the recording holds the truth.
#[derive(Default)]
pub struct Score {
    /// Root of the mean squared distance to the true positions, after alignment [m].
    rms: Option<f64>,
    /// Share of the detections' weight that is on the landmark of their object.
    right: Option<f64>,
    /// The true path, in the frame of the map.
    reference: Vec<StampedPose>,
}

impl Score {
    fn of(folder: &Path, recording: &Recording, found: &SemanticMap) -> anyhow::Result<Self> {
        let existing = |name: &str| Some(folder.join(name)).filter(|path| path.is_file());
        let mut reference = existing(truth::TRAJECTORY).map(|path| tum::read(&path)).transpose()?.unwrap_or_default();
        let errors = reference_errors(&reference, &found.trajectory());
        let world_from_reference = errors.reference_from_world.inverse();
        reference.iter_mut().for_each(|StampedPose { pose, .. }| *pose = world_from_reference * *pose);
        let ids = existing(truth::IDS).map(|path| truth::read_ids(&path, recording)).transpose()?;
        Ok(Self {
            rms: errors.absolute.map(|absolute| absolute.rmse),
            right: ids.and_then(|ids| weight_on_right_landmark(&ids, &found.weights)),
            reference,
        })
    }

    fn text(&self) -> String {
        let rms = self.rms.map(|rms| format!("; rms error {rms:.3} m"));
        let right = self.right.map(|right| format!("; {:.1} % of the weight on the right landmark", 100.0 * right));
        rms.into_iter().chain(right).collect()
    }
}

/// An object's landmark is the one with most of its weight; what lies on other landmarks is wrong, doubles included.
fn weight_on_right_landmark(ids: &truth::Ids, weights: &[Weight]) -> Option<f64> {
    let mut by_object: BTreeMap<u64, BTreeMap<usize, f64>> = BTreeMap::new();
    for weight in weights {
        let id = ids.get(weight.frame).and_then(|frame| frame.get(weight.detection)).copied().flatten();
        if let Some(id) = id {
            *by_object.entry(id).or_default().entry(weight.landmark).or_default() += weight.weight;
        }
    }
    let sum = |weights: &BTreeMap<usize, f64>| weights.values().sum::<f64>();
    let most = |weights: &BTreeMap<usize, f64>| weights.values().copied().fold(0.0, f64::max);
    let total: f64 = by_object.values().map(sum).sum();
    let right: f64 = by_object.values().map(most).sum();
    (total > 0.0).then(|| right / total)
}
