//! Writes the recording of a mapping.

use super::super::log::{About, arrow, position};
use super::super::rows::Rows;
use super::super::{Begun, FULL_DISK, RecordError, blueprint as shared, check, file};
use super::blueprint;
use super::read::RecordedMapping;
use crate::config::Config;
use crate::detections::{Detection, Frame, Odometry, Recording, Velocity};
use crate::geometry::{Pose, StampedPose};
use crate::io::semantic::sensors;
use crate::semantic::{Candidate, Landmark, Objects, SemanticConfig, SemanticMap, Sweep, Weight};
use ::rerun::archetypes::Clear;
use ::rerun::blueprint::BlueprintActivation;
use ::rerun::{LineStrips2D, Points2D, RecordingStream, RecordingStreamResult, Scalars, TextDocument};
use nalgebra::{Point2, Vector2};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;

/// χ² with two degrees of freedom is below this with 95 %.
const CONFIDENCE: f64 = 5.99;
/// Corners of the polygon that stands for an ellipse.
const ELLIPSE_CORNERS: u32 = 24;

/// What was mapped, and how.
#[derive(Clone, Copy)]
pub struct Mapping<'a> {
    /// Name of the recording of detections.
    pub name: &'a str,
    /// What was mapped.
    pub recording: &'a Recording,
    /// Which objects the detections show, if that was known.
    pub objects: Option<&'a Objects>,
    /// Everything that was set.
    pub config: SemanticConfig,
    /// What came out.
    pub map: &'a SemanticMap,
}

/// Records a mapping to a new file, which takes the place of what is there once it is whole.
///
/// # Errors
/// The file cannot be made or written to.
pub fn record(path: &Path, mapping: Mapping<'_>) -> Result<(), RecordError> {
    record_under("", path, mapping, None)
}

/// Records a mapping to a new file, the recorded one beside it.
///
/// # Errors
/// As for [`record`].
pub fn record_beside(recorded: &RecordedMapping, path: &Path, mapping: Mapping<'_>) -> Result<(), RecordError> {
    record_under(shared::REPLAYED, path, mapping, Some(recorded))
}

fn record_under(
    root: &str,
    path: &Path,
    mapping: Mapping<'_>,
    recorded: Option<&RecordedMapping>,
) -> Result<(), RecordError> {
    let (partial, begun) = Begun::beside(path);
    let (stream, failed) = file(path, &partial, mapping.name)?;
    let roots = recorded.map_or(vec![root], |_| vec![shared::RECORDED, root]);
    blueprint::views(&roots).send(&stream, BlueprintActivation::default())?;
    if let Some(recorded) = recorded {
        blueprint::log_styles(&stream, shared::RECORDED)?;
        recorded.store().send(&stream, shared::RECORDED)?;
    }
    let writer = Writer { stream: &stream, root, mapping, links: links(mapping) };
    writer.log_inputs()?;
    writer.log_mapping()?;
    check(&stream).map_err(|reason| failed(format!("{reason} ({FULL_DISK})")))?;
    drop(stream);
    begun.map_or(Ok(()), Begun::finish).map_err(|error| failed(error.to_string()))
}

/// A weight, from where a detection is by the path to its landmark.
#[derive(Clone, Copy)]
struct Link {
    ends: [[f32; 2]; 2],
    weight: f64,
}

/// The links of each frame, the strongest last, so that they lie above.
fn links(Mapping { map, recording, .. }: Mapping<'_>) -> BTreeMap<usize, Vec<Link>> {
    let poses: BTreeMap<usize, Pose> =
        map.keyframes.iter().filter_map(|keyframe| Some((keyframe.frame?, keyframe.pose))).collect();
    let link = |shown: &Weight| {
        let seen = recording.frames.get(shown.frame)?.detections.get(shown.detection)?;
        let from = *poses.get(&shown.frame)? * (recording.sensors.robot_from_sensor * seen.position());
        let to = map.landmarks.get(shown.landmark)?.position;
        Some(Link { ends: [position(from), position(to)], weight: shown.weight })
    };
    let mut links: BTreeMap<usize, Vec<Link>> = BTreeMap::new();
    for weight in &map.weights {
        links.entry(weight.frame).or_default().extend(link(weight));
    }
    links.values_mut().for_each(|links| links.sort_by(|a, b| a.weight.total_cmp(&b.weight)));
    links
}

fn strips<'a>(links: impl Iterator<Item = &'a Link> + Clone) -> LineStrips2D {
    LineStrips2D::new(links.clone().map(|link| link.ends))
        .with_colors(links.map(|link| blueprint::weight_colour(link.weight)))
}

struct Writer<'a> {
    stream: &'a RecordingStream,
    root: &'a str,
    mapping: Mapping<'a>,
    links: BTreeMap<usize, Vec<Link>>,
}

impl Writer<'_> {
    fn path(&self, path: &str) -> String {
        shared::under(self.root, path)
    }

    /// What repeats the mapping.
    fn log_inputs(&self) -> RecordingStreamResult<()> {
        let Mapping { name, recording, objects, config, .. } = self.mapping;
        blueprint::log_styles(self.stream, self.root)?;
        let about = About {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            log: name.to_owned(),
            device: "CPU".to_owned(),
            continues: None,
            configuration: Config::Semantic(config),
        };
        // What was mapped is valid, and can be written.
        let about = toml::to_string(&about).unwrap_or_default();
        self.stream.log_static(self.path(shared::ABOUT), &TextDocument::new(about))?;
        let sensors = sensors::to_toml(&recording.sensors).unwrap_or_default();
        self.stream.log_static(self.path(blueprint::SENSORS), &TextDocument::new(sensors))?;
        match &recording.odometry {
            Odometry::Velocities(rows) => {
                let row = |&Velocity { stamp, forward, turn }: &Velocity| [forward, turn, stamp];
                self.log_rows(blueprint::SPEEDS, rows.iter().map(row))?;
            }
            Odometry::Poses(rows) => {
                let row = |&StampedPose { stamp, pose: Pose { x, y, heading } }: &StampedPose| [x, y, heading, stamp];
                self.log_rows(shared::ODOMETRY_READING, rows.iter().map(row))?;
            }
        }
        let row = |Frame { stamp, detections }: &Frame| {
            let number = |seen: &Detection| [seen.class as f64, seen.score, seen.range, seen.bearing];
            std::iter::once(*stamp).chain(detections.iter().flat_map(number)).collect::<Vec<_>>()
        };
        self.log_rows(blueprint::DETECTIONS, recording.frames.iter().map(row))?;
        let row = |ids: &Vec<Option<u64>>| ids.iter().map(|id| id.map_or(f64::NAN, |id| id as f64)).collect::<Vec<_>>();
        self.log_rows(blueprint::IDS, objects.unwrap_or_default().iter().map(row))
    }

    /// Rows of numbers, numbered from 0.
    fn log_rows(
        &self,
        path: &str,
        rows: impl Iterator<Item = impl IntoIterator<Item = f64>>,
    ) -> RecordingStreamResult<()> {
        let mut all = Rows::default();
        rows.zip(0..).for_each(|(row, number)| all.push(number, row));
        all.send(self.stream, &self.path(path))
    }

    /// The forward pass, the sweeps, the result, and each keyframe with the result.
    fn log_mapping(&self) -> RecordingStreamResult<()> {
        let Mapping { map, recording, .. } = self.mapping;
        let stream = self.stream;
        let history = &map.history;
        let stamps = map.keyframes.iter().map(|keyframe| keyframe.stamp);
        let odometry = recording.odometry.dead_reckoning(stamps);
        stream.log_static(self.path(blueprint::ODOMETRY), &path(odometry.iter().map(|stamped| stamped.pose)))?;
        for (step, checksum) in (0_i64..).zip(history.checksums()) {
            stream.set_time_sequence(shared::STEP_TIMELINE, step);
            stream.log(self.path(shared::CHECKSUM), &Scalars::new([f64::from(checksum)]))?;
        }
        for (keyframe, (step, candidates)) in (0_i64..).zip(&history.candidates).enumerate() {
            stream.set_time_sequence(shared::STEP_TIMELINE, step);
            self.log_candidates(keyframe, candidates)?;
        }
        for (step, sweep) in (history.candidates.len() as i64..).zip(&history.sweeps) {
            stream.set_time_sequence(shared::STEP_TIMELINE, step);
            self.log_sweep(sweep)?;
        }
        self.log_result((history.candidates.len() + history.sweeps.len()) as i64)?;
        stream.reset_time();
        self.log_frames()
    }

    fn log_candidates(&self, keyframe: usize, candidates: &[Candidate]) -> RecordingStreamResult<()> {
        let stream = self.stream;
        let Some(best) = candidates.first() else { return Ok(()) };
        stream.log(self.path(blueprint::ROBOT), &arrow(best.pose))?;
        let likelihood = |candidate: &Candidate| {
            // The likelihood beside the best one's: like a particle's weight.
            let share = (candidate.log_likelihood - best.log_likelihood).exp();
            shared::colour(shared::particle_colour(share))
        };
        // The likeliest is logged last, so that it lies above.
        let shown = || candidates.iter().rev();
        let places = Points2D::new(shown().map(|candidate| position(candidate.pose.position())));
        stream.log(self.path(blueprint::HYPOTHESES), &places.with_colors(shown().map(likelihood)))?;
        stream.log(self.path(blueprint::SEEN), &self.seen(keyframe, best.pose))?;
        stream.log(self.path(blueprint::HYPOTHESIS_COUNT), &Scalars::new([candidates.len() as f64]))
    }

    fn log_sweep(&self, sweep: &Sweep) -> RecordingStreamResult<()> {
        let stream = self.stream;
        stream.log(self.path(shared::STEP), &Clear::recursive())?;
        stream.log(self.path(blueprint::TRAJECTORY), &path(sweep.poses.iter().copied()))?;
        stream.log(self.path(blueprint::LANDMARKS), &self.landmarks(&sweep.landmarks))?;
        self.log_score(sweep.objective, sweep.landmarks.len())
    }

    fn log_score(&self, objective: f64, landmarks: usize) -> RecordingStreamResult<()> {
        self.stream.log(self.path(blueprint::OBJECTIVE), &Scalars::new([objective]))?;
        self.stream.log(self.path(blueprint::LANDMARK_COUNT), &Scalars::new([landmarks as f64]))
    }

    /// The result, on both timelines.
    fn log_result(&self, step: i64) -> RecordingStreamResult<()> {
        let Mapping { map, .. } = self.mapping;
        let stream = self.stream;
        stream.set_time_sequence(shared::STEP_TIMELINE, step);
        self.log_score(map.objective, map.landmarks.len())?;
        let result = [f64::from(map.checksum()), map.landmarks.len() as f64, map.objective];
        stream.log(self.path(shared::RESULT), &Scalars::new(result))?;
        stream.log(self.path(blueprint::WEIGHTS), &strips(self.links.values().flatten()))?;
        stream.set_time_sequence(blueprint::FRAME_TIMELINE, 0);
        stream.log(self.path(blueprint::TRAJECTORY), &path(map.keyframes.iter().map(|keyframe| keyframe.pose)))?;
        stream.log(self.path(blueprint::LANDMARKS), &self.landmarks(&map.landmarks))?;
        let ellipses = map.landmarks.iter().filter_map(ellipse);
        stream.log(self.path(blueprint::ELLIPSES), &LineStrips2D::new(ellipses))
    }

    fn log_frames(&self) -> RecordingStreamResult<()> {
        let stream = self.stream;
        for (number, keyframe) in self.mapping.map.keyframes.iter().enumerate() {
            stream.set_time_sequence(blueprint::FRAME_TIMELINE, number as i64);
            let Pose { x, y, heading } = keyframe.pose;
            stream.log(self.path(shared::POSE), &Scalars::new([x, y, heading, keyframe.stamp]))?;
            stream.log(self.path(blueprint::FRAME_ROBOT), &arrow(keyframe.pose))?;
            stream.log(self.path(blueprint::FRAME_SEEN), &self.seen(number, keyframe.pose))?;
            let links = keyframe.frame.and_then(|frame| self.links.get(&frame)).into_iter().flatten();
            stream.log(self.path(blueprint::FRAME_WEIGHTS), &strips(links))?;
        }
        Ok(())
    }

    /// The detections of a keyframe, as seen from a pose.
    fn seen(&self, keyframe: usize, world_from_robot: Pose) -> Points2D {
        let Mapping { map, recording, .. } = self.mapping;
        let frame = map.keyframes.get(keyframe).and_then(|keyframe| recording.frames.get(keyframe.frame?));
        let seen = || frame.into_iter().flat_map(|frame| frame.in_view(recording.sensors.view)).map(|(_, seen)| seen);
        let world_from_sensor = world_from_robot * recording.sensors.robot_from_sensor;
        Points2D::new(seen().map(|seen| position(world_from_sensor * seen.position())))
            .with_colors(seen().map(|seen| blueprint::colour_of(seen.class)))
    }

    fn landmarks(&self, landmarks: &[Landmark]) -> Points2D {
        let classes = &self.mapping.recording.sensors.classes;
        let label = |(number, landmark): (usize, &Landmark)| {
            format!("{number} {}", classes.get(landmark.class()).map_or("", String::as_str))
        };
        Points2D::new(landmarks.iter().map(|landmark| position(landmark.position)))
            .with_colors(landmarks.iter().map(|landmark| blueprint::colour_of(landmark.class())))
            .with_labels(landmarks.iter().enumerate().map(label))
    }
}

fn path(poses: impl Iterator<Item = Pose>) -> LineStrips2D {
    LineStrips2D::new([poses.map(|pose| position(pose.position())).collect::<Vec<_>>()])
}

/// Where zᵀ Σ⁻¹ z = [`CONFIDENCE`]: z = L (cos t, sin t) √χ², Σ = L Lᵀ.
fn ellipse(landmark: &Landmark) -> Option<Vec<[f32; 2]>> {
    let factor = landmark.covariance.cholesky()?.l() * CONFIDENCE.sqrt();
    let corner = |i| {
        let (sin, cos) = (TAU * f64::from(i) / f64::from(ELLIPSE_CORNERS)).sin_cos();
        let corner: Point2<f64> = landmark.position + factor * Vector2::new(cos, sin);
        position(corner)
    };
    Some((0..=ELLIPSE_CORNERS).map(corner).collect())
}
