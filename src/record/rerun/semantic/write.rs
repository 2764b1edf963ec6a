//! Writes the recording of a mapping.

use super::super::log::{About, arrow, position};
use super::super::rows::Rows;
use super::super::{Begun, FULL_DISK, RecordError, blueprint as shared, check, file};
use super::blueprint;
use super::read::RecordedMapping;
use super::worlds::Recorded;
use crate::config::Config;
use crate::semantic::{Candidate, Landmark, Mapped, Objects, Plane, Seen, SemanticConfig, SemanticMap, Sweep, Weight};
use ::rerun::archetypes::Clear;
use ::rerun::blueprint::BlueprintActivation;
use ::rerun::{LineStrips2D, Points2D, RecordingStream, RecordingStreamResult, Scalars, TextDocument};
use nalgebra::{Point2, Vector2};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;

/// χ² with two degrees of freedom is below this with 95 %.
const CONFIDENCE: f64 = 5.99;
/// Corners of the polygon that stands for an ellipse.
const ELLIPSE_CORNERS: u32 = 24;

/// What was mapped, and how.
#[derive(Clone, Copy)]
pub struct Mapping<'a, W: Recorded = Plane> {
    /// Name of the recording of detections.
    pub name: &'a str,
    /// What was mapped.
    pub recording: &'a W::Recording,
    /// Which objects the detections show, if that was known.
    pub objects: Option<&'a Objects>,
    /// Everything that was set.
    pub config: SemanticConfig,
    /// What came out.
    pub map: &'a SemanticMap<W>,
}

/// Records a mapping to a new file, which takes the place of what is there once it is whole.
///
/// # Errors
/// The file cannot be made or written to.
pub fn record<W: Recorded>(path: &Path, mapping: Mapping<'_, W>) -> Result<(), RecordError> {
    record_under("", path, mapping, None)
}

/// Records a mapping to a new file, the recorded one beside it.
///
/// # Errors
/// As for [`record`].
pub fn record_beside<W: Recorded>(
    recorded: &RecordedMapping<W>,
    path: &Path,
    mapping: Mapping<'_, W>,
) -> Result<(), RecordError> {
    record_under(shared::REPLAYED, path, mapping, Some(recorded))
}

fn record_under<W: Recorded>(
    root: &str,
    path: &Path,
    mapping: Mapping<'_, W>,
    recorded: Option<&RecordedMapping<W>>,
) -> Result<(), RecordError> {
    let (partial, begun) = Begun::beside(path);
    let (stream, failed) = file(path, &partial, mapping.name)?;
    let roots = recorded.map_or(vec![root], |_| vec![shared::RECORDED, root]);
    blueprint::views(&roots, has_pictures::<W>(mapping.recording)).send(&stream, BlueprintActivation::default())?;
    if let Some(recorded) = recorded {
        blueprint::log_styles(&stream, shared::RECORDED)?;
        recorded.store().send(&stream, shared::RECORDED)?;
    }
    let (shown, frames) = (W::upright(mapping.recording, mapping.map), W::frames(mapping.recording));
    let links = links(mapping.recording, &frames, &shown);
    let writer = Writer { stream: &stream, root, mapping, shown, frames, links };
    writer.log_inputs()?;
    writer.log_mapping()?;
    check(&stream).map_err(|reason| failed(format!("{reason} ({FULL_DISK})")))?;
    drop(stream);
    begun.map_or(Ok(()), Begun::finish).map_err(|error| failed(error.to_string()))
}

/// Whether there is a camera view.
fn has_pictures<W: Recorded>(recording: &W::Recording) -> bool {
    W::frames(recording).iter().flat_map(|(_, seen)| seen).any(|(_, seen)| W::pixel(seen).is_some())
}

/// A weight, from where a detection is by the path to its landmark.
#[derive(Clone, Copy)]
struct Link {
    detection: usize,
    landmark: usize,
    ends: [[f32; 2]; 2],
    weight: f64,
}

/// The links of each frame, the strongest last, so that they lie above.
fn links<W: Recorded>(
    recording: &W::Recording,
    frames: &[Seen<W::Detection>],
    shown: &SemanticMap<W>,
) -> BTreeMap<usize, Vec<Link>> {
    let sensors = W::sensors(recording);
    let poses: BTreeMap<usize, W::Pose> =
        shown.keyframes.iter().filter_map(|keyframe| Some((keyframe.frame?, keyframe.pose))).collect();
    let landmarks: Vec<[f32; 2]> =
        shown.landmarks.iter().map(|landmark| position(landmark.from_above().position)).collect();
    let link = |&Weight { frame, detection, landmark, weight }: &Weight| {
        let (_, seen) = frames.get(frame)?.1.iter().find(|(number, _)| *number == detection)?;
        let from = above::<W>(W::position(sensors, *poses.get(&frame)?, seen));
        Some(Link { detection, landmark, ends: [from, *landmarks.get(landmark)?], weight })
    };
    let mut links: BTreeMap<usize, Vec<Link>> = BTreeMap::new();
    for weight in &shown.weights {
        links.entry(weight.frame).or_default().extend(link(weight));
    }
    links.values_mut().for_each(|links| links.sort_by(|a, b| a.weight.total_cmp(&b.weight)));
    links
}

/// A point from above.
fn above<W: Recorded>(point: W::Point) -> [f32; 2] {
    let numbers: W::Numbers = point.into();
    position(Point2::from_slice(&numbers.as_ref()[..2]))
}

fn strips<'a>(links: impl Iterator<Item = &'a Link> + Clone) -> LineStrips2D {
    LineStrips2D::new(links.clone().map(|link| link.ends))
        .with_colors(links.map(|link| blueprint::weight_colour(link.weight)))
}

struct Writer<'a, W: Recorded> {
    stream: &'a RecordingStream,
    root: &'a str,
    mapping: Mapping<'a, W>,
    /// The map with z up.
    shown: Cow<'a, SemanticMap<W>>,
    frames: Vec<Seen<W::Detection>>,
    links: BTreeMap<usize, Vec<Link>>,
}

impl<W: Recorded> Writer<'_, W> {
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
        let sensors = W::sensors_text(W::sensors(recording));
        self.stream.log_static(self.path(blueprint::SENSORS), &TextDocument::new(sensors))?;
        let (path, odometry) = W::odometry(recording);
        self.log_rows(path, odometry.into_iter())?;
        self.log_rows(blueprint::DETECTIONS, W::detections(recording).into_iter())?;
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
        let stream = self.stream;
        let history = &self.shown.history;
        stream.log_static(self.path(blueprint::ODOMETRY), &path::<W>(self.reckoned()))?;
        for (step, checksum) in (0_i64..).zip(self.mapping.map.history.checksums()) {
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

    /// The path by odometry alone.
    fn reckoned(&self) -> impl Iterator<Item = W::Pose> {
        let mut last: Option<(f64, W::Pose)> = None;
        self.shown.keyframes.iter().map(move |keyframe| {
            let moved = |(stamp, pose): (f64, W::Pose)| {
                pose * W::motion(self.mapping.recording, stamp, keyframe.stamp).start_from_end
            };
            let pose = last.map_or(keyframe.pose, moved);
            last = Some((keyframe.stamp, pose));
            pose
        })
    }

    fn log_candidates(&self, keyframe: usize, candidates: &[Candidate<W>]) -> RecordingStreamResult<()> {
        let stream = self.stream;
        let Some(best) = candidates.first() else { return Ok(()) };
        stream.log(self.path(blueprint::ROBOT), &arrow(W::from_above(best.pose)))?;
        let likelihood = |candidate: &Candidate<W>| {
            // The likelihood beside the best one's: like a particle's weight.
            let share = (candidate.log_likelihood - best.log_likelihood).exp();
            shared::colour(shared::particle_colour(share))
        };
        // The likeliest is logged last, so that it lies above.
        let shown = || candidates.iter().rev();
        let places = Points2D::new(shown().map(|candidate| position(W::from_above(candidate.pose).position())));
        stream.log(self.path(blueprint::HYPOTHESES), &places.with_colors(shown().map(likelihood)))?;
        stream.log(self.path(blueprint::SEEN), &self.seen(keyframe, best.pose))?;
        stream.log(self.path(blueprint::HYPOTHESIS_COUNT), &Scalars::new([candidates.len() as f64]))
    }

    fn log_sweep(&self, sweep: &Sweep<W>) -> RecordingStreamResult<()> {
        let stream = self.stream;
        stream.log(self.path(shared::STEP), &Clear::recursive())?;
        stream.log(self.path(blueprint::TRAJECTORY), &path::<W>(sweep.poses.iter().copied()))?;
        stream.log(self.path(blueprint::LANDMARKS), &self.landmarks(&sweep.landmarks))?;
        self.log_score(sweep.objective, sweep.landmarks.len())
    }

    fn log_score(&self, objective: f64, landmarks: usize) -> RecordingStreamResult<()> {
        self.stream.log(self.path(blueprint::OBJECTIVE), &Scalars::new([objective]))?;
        self.stream.log(self.path(blueprint::LANDMARK_COUNT), &Scalars::new([landmarks as f64]))
    }

    /// The result, on both timelines.
    fn log_result(&self, step: i64) -> RecordingStreamResult<()> {
        let (map, shown) = (self.mapping.map, &self.shown);
        let stream = self.stream;
        stream.set_time_sequence(shared::STEP_TIMELINE, step);
        self.log_score(map.objective, map.landmarks.len())?;
        let result = [f64::from(map.checksum()), map.landmarks.len() as f64, map.objective];
        stream.log(self.path(shared::RESULT), &Scalars::new(result))?;
        stream.log(self.path(blueprint::WEIGHTS), &strips(self.links.values().flatten()))?;
        stream.set_time_sequence(blueprint::FRAME_TIMELINE, 0);
        stream
            .log(self.path(blueprint::TRAJECTORY), &path::<W>(shown.keyframes.iter().map(|keyframe| keyframe.pose)))?;
        stream.log(self.path(blueprint::LANDMARKS), &self.landmarks(&shown.landmarks))?;
        let ellipses = shown.landmarks.iter().filter_map(|landmark| ellipse(&landmark.from_above()));
        stream.log(self.path(blueprint::ELLIPSES), &LineStrips2D::new(ellipses))
    }

    fn log_frames(&self) -> RecordingStreamResult<()> {
        let stream = self.stream;
        for (number, (keyframe, shown)) in self.mapping.map.keyframes.iter().zip(&self.shown.keyframes).enumerate() {
            stream.set_time_sequence(blueprint::FRAME_TIMELINE, number as i64);
            let row = W::coordinates(keyframe.pose).into_iter().chain([keyframe.stamp]);
            stream.log(self.path(shared::POSE), &Scalars::new(row))?;
            stream.log(self.path(blueprint::FRAME_ROBOT), &arrow(W::from_above(shown.pose)))?;
            stream.log(self.path(blueprint::FRAME_SEEN), &self.seen(number, shown.pose))?;
            let links = keyframe.frame.and_then(|frame| self.links.get(&frame)).into_iter().flatten();
            stream.log(self.path(blueprint::FRAME_WEIGHTS), &strips(links.clone()))?;
            self.log_picture(keyframe, links)?;
        }
        Ok(())
    }

    /// The camera view: detections, where the landmarks in it would be seen, and the weights between them.
    fn log_picture<'l>(
        &self,
        keyframe: &Mapped<W>,
        links: impl Iterator<Item = &'l Link>,
    ) -> RecordingStreamResult<()> {
        let Mapping { map, recording, .. } = self.mapping;
        let pixel = |(number, seen): &(usize, W::Detection)| Some((*number, (W::pixel(seen)?, W::label(seen))));
        let seen = keyframe.frame.and_then(|frame| self.frames.get(frame)).into_iter().flat_map(|(_, seen)| seen);
        let seen: BTreeMap<usize, ([f32; 2], usize)> = seen.filter_map(pixel).collect();
        let mut predicted = BTreeMap::new();
        let mut lines = Vec::new();
        for link in links {
            let Some(landmark) = map.landmarks.get(link.landmark) else { continue };
            let place = W::pixel_of(W::sensors(recording), keyframe.pose, landmark.position);
            if let (Some(to), Some((from, _))) = (place, seen.get(&link.detection)) {
                predicted.insert(link.landmark, (to, landmark.class()));
                lines.push(Link { ends: [*from, to], ..*link });
            }
        }
        if seen.is_empty() {
            return Ok(());
        }
        let points = |places: &BTreeMap<usize, ([f32; 2], usize)>| {
            let colours = places.values().map(|(_, class)| blueprint::colour_of(*class));
            Points2D::new(places.values().map(|(at, _)| *at)).with_colors(colours)
        };
        let stream = self.stream;
        stream.log(self.path(blueprint::CAMERA_SEEN), &points(&seen))?;
        let numbers = predicted.keys().map(ToString::to_string);
        stream.log(self.path(blueprint::CAMERA_LANDMARKS), &points(&predicted).with_labels(numbers))?;
        stream.log(self.path(blueprint::CAMERA_WEIGHTS), &strips(lines.iter()))
    }

    /// The detections of a keyframe, as seen from a pose of the upright map.
    fn seen(&self, keyframe: usize, pose: W::Pose) -> Points2D {
        let frame = self.shown.keyframes.get(keyframe).and_then(|keyframe| self.frames.get(keyframe.frame?));
        let seen = || frame.into_iter().flat_map(|(_, seen)| seen).map(|(_, seen)| seen);
        let sensors = W::sensors(self.mapping.recording);
        Points2D::new(seen().map(|seen| above::<W>(W::position(sensors, pose, seen))))
            .with_colors(seen().map(|seen| blueprint::colour_of(W::label(seen))))
    }

    fn landmarks(&self, landmarks: &[Landmark<W>]) -> Points2D {
        let (classes, _) = W::labels(W::sensors(self.mapping.recording));
        let label = |(number, landmark): (usize, &Landmark<W>)| {
            format!("{number} {}", classes.get(landmark.class()).map_or("", String::as_str))
        };
        Points2D::new(landmarks.iter().map(|landmark| above::<W>(landmark.position)))
            .with_colors(landmarks.iter().map(|landmark| blueprint::colour_of(landmark.class())))
            .with_labels(landmarks.iter().enumerate().map(label))
    }
}

fn path<W: Recorded>(poses: impl Iterator<Item = W::Pose>) -> LineStrips2D {
    LineStrips2D::new([poses.map(|pose| position(W::from_above(pose).position())).collect::<Vec<_>>()])
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
