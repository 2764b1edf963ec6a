//! `ipslam semantic`: a recording of detections in; trajectory, landmarks, weights and a summary out.

use super::UsageError;
use super::output::{OutArgs, Outputs};
#[cfg(feature = "images")]
use super::pictures::PicturesArgs;
use super::progress::{Bar, PERMILLE};
use super::recording::check_target;
use super::say::{print_line, say};
use super::visual_inertial;
use anyhow::{Context as _, ensure};
use clap::ValueEnum;
use ipslam::association::Policy;
use ipslam::detections::{DetectionKind, Recording, Recording3};
use ipslam::geometry::{StampedPose, StampedPose3};
#[cfg(feature = "images")]
use ipslam::io::pictures;
use ipslam::io::semantic::{self as recordings, ReadRecording, results, truth};
use ipslam::io::{WriteError, tum};
use ipslam::log::LogError;
use ipslam::metrics::space::space_errors;
use ipslam::metrics::trajectory::reference_errors;
use ipslam::picture::object_map;
#[cfg(feature = "record")]
use ipslam::record::rerun::semantic::{Mapping, Recorded};
use ipslam::semantic::{
    Objects, Plane, SemanticConfig, SemanticError, SemanticMap, Space, Weight, World, map, map_known,
};
use serde_json::{Value, json};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Maps the objects of a recording of detections, whose classes it knows and whose identities it does not; without
/// detections, the way of a camera with an inertial sensor.
#[derive(Debug, clap::Args)]
pub struct SemanticArgs {
    /// Folder of the recording: sensors.toml, odometry.csv, detections.csv; sensors.toml, imu.csv, tracks.csv; or sensors.toml,
    /// pictures.toml
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
    /// Which object each detection shows, as in ids.csv of `ipslam convert`: the upper bound of what association can reach
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["association", "beam", "window"])]
    known_ids: Option<PathBuf>,
    /// Record how the map came about to this file, for the Rerun viewer and for `ipslam replay`
    #[arg(long, value_name = "FILE.rrd")]
    record: Option<PathBuf>,
    #[cfg(feature = "images")]
    #[command(flatten)]
    pictures: PicturesArgs,
}

/// Of the outputs, what was made of pictures.
#[cfg(feature = "images")]
const PICTURES_RECORDING: &str = "recording";

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
    #[cfg(feature = "images")]
    if pictures::is_in(&args.recording) {
        let outputs = args.out.open(&name)?;
        let made = outputs.path(PICTURES_RECORDING);
        args.pictures.convert(&args.recording, &made)?;
        // Pictures became keyframes by how far the camera moved: none is left out for coming soon after another.
        let config = SemanticConfig { interval: 0.0, ..config };
        return map_and_write::<Space>(args, &name, config, &recordings::read3(&made)?, outputs);
    }
    #[cfg(feature = "images")]
    args.pictures.refuse(&args.recording)?;
    match recordings::read_kind(&args.recording)? {
        DetectionKind::Stereo => {
            let recording = recordings::read3(&args.recording)?;
            map_and_write::<Space>(args, &name, config, &recording, args.out.open(&name)?)
        }
        _ => {
            let recording = recordings::read(&args.recording)?;
            map_and_write::<Plane>(args, &name, config, &recording, args.out.open(&name)?)
        }
    }
}

fn map_and_write<W: Output>(
    args: &SemanticArgs,
    name: &str,
    config: SemanticConfig,
    ReadRecording { recording, warnings }: &ReadRecording<W::Recording>,
    mut outputs: Outputs,
) -> anyhow::Result<Vec<anyhow::Error>> {
    warnings.iter().for_each(|warning| say!("{warning}"));
    let ids = args.known_ids.as_deref().map(|path| W::read_ids(path, recording)).transpose()?;
    let task = Task::<W> { name, recording, objects: ids.as_deref(), config };
    let (found, seconds) = task.map().with_context(|| args.recording.display().to_string())?;
    let score = Score::of::<W>(&args.recording, recording, &found)?;
    task.write(&found, seconds, &score, &mut outputs)?;
    if let Some(path) = &args.record {
        outputs.note(W::record(path, &task, &found));
    }
    outputs.finish();
    found.verdict.doubts().iter().for_each(|doubt| say!("doubtful: {doubt}"));
    print_line!("{}{}", summary_line(&found, seconds), score.text());
    Ok(std::mem::take(&mut outputs.errors))
}

/// How a map of the plane or of space is written and scored.
pub trait Output: World {
    fn read_ids(path: &Path, recording: &Self::Recording) -> Result<truth::Ids, LogError>;
    fn write_trajectory(path: &Path, found: &SemanticMap<Self>) -> Result<(), WriteError>;
    /// The map with its z axis up.
    fn upright<'a>(recording: &Self::Recording, found: &'a SemanticMap<Self>) -> Cow<'a, SemanticMap<Self>>;
    /// The path of an upright map, from above.
    fn path(found: &SemanticMap<Self>) -> Vec<StampedPose>;
    /// The distance of an upright map's path to a true one after alignment \[m\], and the true one from above, in the frame of the map.
    fn compare(truth: &Path, found: &SemanticMap<Self>) -> Result<(Option<f64>, Vec<StampedPose>), LogError>;
    fn calibration(found: &SemanticMap<Self>) -> Value;
    fn record(path: &Path, task: &Task<'_, Self>, found: &SemanticMap<Self>) -> anyhow::Result<()>;
}

impl Output for Plane {
    fn read_ids(path: &Path, recording: &Recording) -> Result<truth::Ids, LogError> {
        truth::read_ids(path, &recording.frames)
    }

    fn write_trajectory(path: &Path, found: &SemanticMap) -> Result<(), WriteError> {
        tum::write(path, &found.trajectory())
    }

    fn upright<'a>(_: &Recording, found: &'a SemanticMap) -> Cow<'a, SemanticMap> {
        Cow::Borrowed(found)
    }

    fn path(found: &SemanticMap) -> Vec<StampedPose> {
        found.trajectory()
    }

    fn compare(truth: &Path, found: &SemanticMap) -> Result<(Option<f64>, Vec<StampedPose>), LogError> {
        let mut reference = tum::read(truth)?;
        let errors = reference_errors(&reference, &found.trajectory());
        let world_from_reference = errors.reference_from_world.inverse();
        reference.iter_mut().for_each(|StampedPose { pose, .. }| *pose = world_from_reference * *pose);
        Ok((errors.absolute.map(|absolute| absolute.rmse), reference))
    }

    fn calibration(found: &SemanticMap) -> Value {
        let [forward_scale, turn_scale, curvature] = found.calibration;
        json!({ "forward_scale": forward_scale, "turn_scale": turn_scale, "curvature": curvature })
    }

    #[cfg(feature = "record")]
    fn record(path: &Path, task: &Task<'_>, found: &SemanticMap) -> anyhow::Result<()> {
        ipslam::record::rerun::semantic::record(path, task.mapping(found))?;
        Ok(())
    }

    #[cfg(not(feature = "record"))]
    fn record(_: &Path, _: &Task<'_>, _: &SemanticMap) -> anyhow::Result<()> {
        anyhow::bail!("--record needs {}", super::recording::FEATURE)
    }
}

impl Output for Space {
    fn read_ids(path: &Path, recording: &Recording3) -> Result<truth::Ids, LogError> {
        truth::read_ids(path, &recording.frames)
    }

    fn write_trajectory(path: &Path, found: &SemanticMap<Self>) -> Result<(), WriteError> {
        tum::write3(path, &found.trajectory3())
    }

    fn upright<'a>(recording: &Recording3, found: &'a SemanticMap<Self>) -> Cow<'a, SemanticMap<Self>> {
        Cow::Owned(found.upright(&recording.sensors))
    }

    fn path(found: &SemanticMap<Self>) -> Vec<StampedPose> {
        found.trajectory3().iter().map(StampedPose3::from_above).collect()
    }

    fn compare(truth: &Path, found: &SemanticMap<Self>) -> Result<(Option<f64>, Vec<StampedPose>), LogError> {
        let reference = tum::read3(truth)?;
        let Some(errors) = space_errors(&reference, &found.trajectory3()) else { return Ok((None, Vec::new())) };
        let world_from_reference = errors.reference_from_world.inverse();
        let moved = |&StampedPose3 { stamp, pose }: &StampedPose3| {
            StampedPose3 { stamp, pose: world_from_reference * pose }.from_above()
        };
        Ok((Some(errors.position.rmse), reference.iter().map(moved).collect()))
    }

    fn calibration(found: &SemanticMap<Self>) -> Value {
        let [scale, turn_scale] = found.calibration;
        json!({ "scale": scale, "turn_scale": turn_scale })
    }

    #[cfg(feature = "record")]
    fn record(path: &Path, task: &Task<'_, Self>, found: &SemanticMap<Self>) -> anyhow::Result<()> {
        ipslam::record::rerun::semantic::record(path, task.mapping(found))?;
        Ok(())
    }

    #[cfg(not(feature = "record"))]
    fn record(_: &Path, _: &Task<'_, Self>, _: &SemanticMap<Self>) -> anyhow::Result<()> {
        anyhow::bail!("--record needs {}", super::recording::FEATURE)
    }
}

/// What is mapped, and how.
pub struct Task<'a, W: World = Plane> {
    pub name: &'a str,
    pub recording: &'a W::Recording,
    pub objects: Option<&'a Objects>,
    pub config: SemanticConfig,
}

impl<W: Output> Task<'_, W> {
    /// Maps it; returns the map and the run time \[s\].
    pub fn map(&self) -> Result<(SemanticMap<W>, f64), SemanticError> {
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

    /// Writes the outputs.
    pub fn write(
        &self,
        found: &SemanticMap<W>,
        seconds: f64,
        score: &Score,
        outputs: &mut Outputs,
    ) -> anyhow::Result<()> {
        let path = outputs.stage("trajectory.tum");
        outputs.note(W::write_trajectory(&path, found));
        for (name, text) in results::files(W::labels(W::sensors(self.recording)).0, found) {
            outputs.write(name, text.as_bytes());
        }
        let shown = W::upright(self.recording, found);
        match object_map(self.name, self.recording, &shown, &W::path(&shown), &score.reference) {
            Ok(files) => files.iter().for_each(|(name, bytes)| outputs.write(name, bytes)),
            Err(error) => outputs.note(Err(error)),
        }
        let summary = json!({
            "recording": self.name,
            "seconds": seconds,
            "keyframes": found.keyframes.len(),
            "detections": found.detections,
            "moving_detections": found.moving.len(),
            "landmarks": found.landmarks.len(),
            "objective": found.objective,
            "calibration": W::calibration(found),
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

#[cfg(feature = "record")]
impl<W: Recorded> Task<'_, W> {
    /// What is recorded of it.
    pub fn mapping<'a>(&'a self, map: &'a SemanticMap<W>) -> Mapping<'a, W> {
        let Self { name, recording, objects, config } = *self;
        Mapping { name, recording, objects, config, map }
    }
}

/// Whether to believe a map.
pub fn verdict<W: World>(found: &SemanticMap<W>) -> &'static str {
    if found.verdict.is_consistent() { "consistent" } else { "doubtful" }
}

fn summary_line<W: World>(found: &SemanticMap<W>, seconds: f64) -> String {
    let moving = match found.moving.len() {
        0 => String::new(),
        count => format!(", {count} of what moves left out"),
    };
    format!(
        "{} landmarks from {} detections in {} keyframes{moving}, {seconds:.1} s; objective {:.1}; {}",
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
    fn of<W: Output>(folder: &Path, recording: &W::Recording, found: &SemanticMap<W>) -> anyhow::Result<Self> {
        let existing = |name: &str| Some(folder.join(name)).filter(|path| path.is_file());
        let compared =
            existing(truth::TRAJECTORY).map(|path| W::compare(&path, &W::upright(recording, found))).transpose()?;
        let (rms, reference) = compared.unwrap_or_default();
        let ids = existing(truth::IDS).map(|path| W::read_ids(&path, recording)).transpose()?;
        Ok(Self { rms, right: ids.and_then(|ids| weight_on_right_landmark(&ids, &found.weights)), reference })
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
