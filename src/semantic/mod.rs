//! Semantic SLAM by expectation maximisation, in the plane and in space (S. L. Bowman, N. Atanasov, K. Daniilidis, G. J. Pappas,
//! "Probabilistic Data Association for Semantic SLAM", ICRA 2017).
//!
//! A recording holds odometry and detections: objects of a class at a range and bearing, or in space at a pixel and a
//! disparity, and nobody tells which object. Wanted are the path x, the landmarks l with their classes, and which detection shows which landmark. The paper takes
//! the last one for a hidden variable D:
//!
//! - E step (eq. 5): w_kj = Σ over assignments D with D(k) = j of p(D | x, l, detections), for every keyframe.
//! - M step (eq. 6): x, l = arg min Σ w_kj ρ(detection k less landmark j as seen) + odometry.
//!
//! Here both go over all keyframes in each sweep, where the paper weighs a keyframe once; ρ is Cauchy's loss, and the
//! odometry's calibration (scale, turn scale, in the plane curvature) is estimated with the path, and so is how often an object in
//! view is detected: a map is wrong where its objects are in view and not seen.
//!
//! EM converges to a local optimum, so it needs a start in the right basin. That is found by a beam of hypotheses in a forward
//! pass, run with several densities of new landmarks. The sweeps refine each run, landmarks mapped twice are merged, clutter
//! is dropped, and the run of the highest objective is the result.
//!
//! All of it is written once. A [`World`] is what differs: what poses are, how they move, and how a landmark is seen.
//!
//! | File | Task |
//! |---|---|
//! | `config` | what can be set |
//! | `world` | the plane and space |
//! | `keyframes` | the moments whose pose is estimated |
//! | `sensor_model` | densities of detections and motions |
//! | `hypothesis`, `beam` | the forward pass |
//! | `linear` | the algebra of its filter |
//! | `window` | the same online, a few keyframes at a time |
//! | `estimate`, `objective` | path, map and weights; how good they are |
//! | `history` | hypotheses and sweeps that led to the result |
//! | `e_step`, `m_step` | the sweeps |
//! | `moving` | detections of objects that move |
//! | `merging` | landmarks mapped twice, and clutter |
//! | `result` | the result |
//! | `verdict` | whether the map is consistent with the data |
//! | `progress` | progress of several runs |
//!
//! The world's origin is the pose at the first keyframe. Metres, radians, seconds; log-likelihoods in nats.

mod beam;
mod config;
mod e_step;
mod estimate;
mod history;
mod hypothesis;
mod keyframes;
mod linear;
mod m_step;
mod merging;
mod moving;
mod objective;
mod progress;
mod result;
mod sensor_model;
mod verdict;
mod window;
mod world;

pub use config::{NEW_DENSITIES, SemanticConfig};
pub use estimate::Landmark;
pub use history::{Candidate, History, Sweep};
pub use result::{Mapped, RunScore, SemanticMap, Weight};
pub use verdict::Verdict;
pub use world::{Plane, Seen, Space, Square, World};

use crate::factor_graph::{GraphError, VariableId};
use crate::parameters::ConfigError;
use beam::{Beam, Pass};
use estimate::{Estimate, Pair};
use hypothesis::Hypothesis;
use keyframes::Keyframe;
use m_step::Problem;
use nalgebra::DMatrix;
use progress::Progress;
use rayon::prelude::*;
use sensor_model::SensorModel;
use std::collections::BTreeMap;

/// Annealing: the first sweep multiplies the noise of detections by this, the last one by 1. Otherwise the weights of
/// ambiguous landmarks would be decided before the path has converged.
const FIRST_TEMPERING: f64 = 3.0;
/// Landmarks whose weights sum to less are dropped: a single detection is as likely clutter.
const MIN_LANDMARK_WEIGHT: f64 = 1.5;

/// Why a recording cannot be mapped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SemanticError {
    /// A value of the configuration is out of its range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// There is nothing to map.
    #[error(
        "no frame has a detection that its sensor can see, or whose object is known where ids are given, so there is nothing to map; see [view] in sensors.toml"
    )]
    NothingSeen,
    /// The M step has no solution.
    #[error("the M step has no solution: {0}")]
    Graph(#[from] GraphError),
}

/// Which object each detection of each frame shows, where that is known.
pub type Objects = [Vec<Option<u64>>];

/// Maps a recording. `progress` is called with the share that is done, 0 to 1.
///
/// # Errors
/// The configuration cannot be, nothing was seen, or a graph has no solution.
pub fn map<W: World>(
    recording: &W::Recording,
    config: &SemanticConfig,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<SemanticMap<W>, SemanticError> {
    let moving = moving::moving(recording, &SensorModel::<W>::new(recording));
    let stands = |frame, detection| !moving.contains(&(frame, detection));
    let found = with_mapping(recording, config, progress, stands, |mapping| mapping.map())?;
    Ok(SemanticMap { moving: moving.into_iter().collect(), ..found })
}

/// Maps a recording with known associations: the best that the other parts can reach. Detections of no object are left out.
///
/// # Errors
/// Those of [`map`].
pub fn map_known<W: World>(
    recording: &W::Recording,
    objects: &Objects,
    config: &SemanticConfig,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<SemanticMap<W>, SemanticError> {
    let is_known = |frame, detection| object(objects, frame, detection).is_some();
    with_mapping(recording, config, progress, is_known, |mapping| mapping.map_known(objects))
}

/// Prepares a recording of which some detections are `wanted`, and does something with it.
fn with_mapping<W: World>(
    recording: &W::Recording,
    config: &SemanticConfig,
    progress: &(dyn Fn(f64) + Sync),
    wanted: impl Fn(usize, usize) -> bool,
    work: impl FnOnce(&Mapping<'_, W>) -> Result<SemanticMap<W>, SemanticError>,
) -> Result<SemanticMap<W>, SemanticError> {
    config.validate()?;
    let keyframes = keyframes::keyframes(recording, config.interval, wanted);
    if keyframes.is_empty() {
        return Err(SemanticError::NothingSeen);
    }
    let progress = Progress::new(progress, NEW_DENSITIES.len() * (keyframes.len() + config.sweeps));
    let model = SensorModel::new(recording);
    work(&Mapping { model: &model, keyframes: &keyframes, config, progress: &progress, before: None })
}

/// Keyframes that are mapped together.
#[derive(Clone, Copy)]
struct Mapping<'a, W: World> {
    model: &'a SensorModel<'a, W>,
    keyframes: &'a [Keyframe<W>],
    config: &'a SemanticConfig,
    progress: &'a Progress<'a>,
    /// What is known of the first one from those before it.
    before: Option<&'a Hypothesis<W>>,
}

/// What came of one density of new landmarks.
struct Run<W: World> {
    estimate: Estimate<W>,
    objective: f64,
    history: History<W>,
    /// Of each pose.
    covariances: Vec<W::PoseCovariance>,
}

fn object(objects: &Objects, frame: usize, detection: usize) -> Option<u64> {
    objects.get(frame)?.get(detection).copied().flatten()
}

impl<W: World> Mapping<'_, W> {
    /// One run for each density of new landmarks; the objective chooses.
    fn map(&self) -> Result<SemanticMap<W>, SemanticError> {
        let found: Vec<_> = NEW_DENSITIES.par_iter().map(|density| self.run(*density)).collect();
        let mut found: Vec<Run<W>> = found.into_iter().collect::<Result<_, _>>()?;
        let score = |(new_density, run): (f64, &Run<W>)| RunScore {
            new_density,
            objective: run.objective,
            landmarks: run.estimate.landmarks.len(),
        };
        let scores = NEW_DENSITIES.into_iter().zip(&found).map(score).collect();
        // Of equal ones the first.
        let places = (0..found.len()).rev();
        let best = places.max_by(|a, b| found[*a].objective.total_cmp(&found[*b].objective));
        let best = found.remove(best.ok_or(SemanticError::NothingSeen)?);
        Ok(self.finish(best, scores, &found))
    }

    /// The M step alone, under weights that are known.
    fn map_known(&self, objects: &Objects) -> Result<SemanticMap<W>, SemanticError> {
        let object = |frame, detection| object(objects, frame, detection);
        let mut estimate = self.start(beam::forward_known(self.model, self.keyframes, object));
        let mut history = History::default();
        for tempering in self.temperings() {
            self.maximise(&mut estimate, tempering)?;
            history.sweeps.push(Sweep::new(&estimate, self.objective(&estimate)));
        }
        self.progress.finish();
        estimate.detection_probability = e_step::detection_probability(self.model, self.keyframes, &estimate);
        let objective = self.objective(&estimate);
        let covariances = self.covariances(&mut estimate)?;
        Ok(self.finish(Run { estimate, objective, history, covariances }, Vec::new(), &[]))
    }

    /// Forward pass, sweeps and merging.
    fn run(&self, new_density: f64) -> Result<Run<W>, SemanticError> {
        let log_new = self.model.log_new(new_density);
        let mut beam = Beam::new(self.model, log_new, self.config);
        if self.config.window > 0 {
            return window::run(self, beam);
        }
        for keyframe in self.keyframes {
            beam.advance(keyframe);
            self.progress.advance();
        }
        let mut sweeps = Vec::new();
        let estimate = self.sweeps(beam.pass(self.keyframes), |estimate| {
            sweeps.push(Sweep::new(estimate, self.objective(estimate)));
            self.progress.advance();
        })?;
        // That of the last sweep is the objective of the estimate as it is.
        let objective = sweeps.last().map_or_else(|| self.objective(&estimate), |sweep| sweep.objective);
        let (mut estimate, objective) = merging::merge(self, estimate, objective)?;
        sweeps.push(Sweep::new(&estimate, objective));
        let covariances = self.covariances(&mut estimate)?;
        Ok(Run { estimate, objective, history: History { candidates: beam.candidates, sweeps }, covariances })
    }

    /// E and M steps from what a forward pass leads to; each sweep is reported.
    fn sweeps(&self, pass: Pass<W>, mut report: impl FnMut(&Estimate<W>)) -> Result<Estimate<W>, SemanticError> {
        let mut estimate = self.start(pass);
        self.maximise(&mut estimate, FIRST_TEMPERING)?;
        for tempering in self.temperings() {
            self.sweep(&mut estimate, tempering)?;
            report(&estimate);
        }
        Ok(estimate)
    }

    /// Tempering of each sweep, the last one 1.
    fn temperings(&self) -> impl Iterator<Item = f64> {
        let sweeps = self.config.sweeps;
        (1..=sweeps).map(move |sweep| FIRST_TEMPERING.powf(1.0 - sweep as f64 / sweeps as f64))
    }

    /// The estimate that a forward pass leads to.
    fn start(&self, pass: Pass<W>) -> Estimate<W> {
        let landmark = |position: &_| Landmark {
            position: *position,
            covariance: Square::of(&DMatrix::zeros(W::POINT, W::POINT)),
            classes: Vec::new(),
            weight: 0.0,
        };
        let places: BTreeMap<usize, usize> =
            pass.landmarks.keys().enumerate().map(|(place, number)| (*number, place)).collect();
        let pairs = |numbers: &Vec<usize>| {
            let shown = numbers.iter().enumerate();
            let pair = |(detection, number)| {
                places.get(number).map(|landmark| Pair { detection, landmark: *landmark, weight: 1.0 })
            };
            shown.filter_map(pair).collect()
        };
        let mut estimate = Estimate {
            landmarks: pass.landmarks.values().map(landmark).collect(),
            weights: pass.assignments.iter().map(pairs).collect(),
            numbers: pass.landmarks.into_keys().collect(),
            poses: pass.poses,
            calibration: pass.calibration,
            detection_probability: self.model.detection_probability(),
        };
        e_step::class_posteriors(self.model, self.keyframes, &mut estimate, self.before);
        estimate
    }

    /// One E step and one M step.
    fn sweep(&self, estimate: &mut Estimate<W>, tempering: f64) -> Result<(), SemanticError> {
        self.expect(estimate, tempering);
        let light: Vec<bool> =
            estimate.landmarks.iter().map(|landmark| landmark.weight < MIN_LANDMARK_WEIGHT).collect();
        estimate.retain_landmarks(|place| !light[place]);
        self.maximise(estimate, tempering)
    }

    /// One E step.
    fn expect(&self, estimate: &mut Estimate<W>, tempering: f64) {
        e_step::e_step(self.model, self.keyframes, estimate, self.config.association, tempering, self.before);
    }

    /// One M step.
    fn maximise(&self, estimate: &mut Estimate<W>, tempering: f64) -> Result<(), SemanticError> {
        self.problem(estimate, tempering)?.solve(estimate)
    }

    fn problem(&self, estimate: &Estimate<W>, tempering: f64) -> Result<Problem, SemanticError> {
        Problem::new(self.model, self.keyframes, estimate, tempering, self.before)
    }

    fn objective(&self, estimate: &Estimate<W>) -> f64 {
        estimate.objective(self.model, self.keyframes, self.config.landmark_cost)
    }

    /// The covariances of the poses; those of the landmarks are written to them.
    fn covariances(&self, estimate: &mut Estimate<W>) -> Result<Vec<W::PoseCovariance>, SemanticError> {
        let problem = self.problem(estimate, 1.0)?;
        let covariances = problem.covariances()?;
        for (landmark, id) in estimate.landmarks.iter_mut().zip(problem.landmarks()) {
            landmark.covariance = Square::of(&covariances.block(*id)?);
        }
        let of_pose = |id: &VariableId| Ok(Square::of(&covariances.block(*id)?));
        problem.poses().iter().map(of_pose).collect()
    }

    /// A run as a result.
    fn finish(&self, run: Run<W>, runs: Vec<RunScore>, others: &[Run<W>]) -> SemanticMap<W> {
        let Run { estimate, objective, history, covariances } = run;
        let mut weights = Vec::new();
        for (keyframe, pairs) in self.keyframes.iter().zip(&estimate.weights) {
            let Some(frame) = keyframe.frame else { continue };
            weights.extend(pairs.iter().map(|pair| Weight {
                frame,
                detection: keyframe.seen[pair.detection].0,
                landmark: pair.landmark,
                weight: pair.weight,
            }));
        }
        let moments = self.keyframes.iter().zip(&estimate.poses).zip(covariances);
        let mapped = |((keyframe, pose), covariance): ((&Keyframe<W>, &W::Pose), _)| Mapped {
            stamp: keyframe.stamp,
            pose: *pose,
            covariance,
            frame: keyframe.frame,
        };
        let keyframes: Vec<Mapped<W>> = moments.map(mapped).collect();
        let agreeing = others.iter().filter(|other| is_same_path(&keyframes, &other.estimate.poses)).count();
        let agreeing = (!others.is_empty()).then_some(agreeing);
        SemanticMap {
            verdict: Verdict::new(self.model, self.keyframes, &estimate, agreeing),
            keyframes,
            landmarks: estimate.landmarks,
            weights,
            calibration: estimate.calibration,
            detection_probability: estimate.detection_probability,
            objective,
            runs,
            moving: Vec::new(),
            detections: self.keyframes.iter().map(|keyframe| keyframe.seen.len()).sum(),
            history,
        }
    }
}

/// Whether each position of a path is within three standard deviations of where it was mapped.
fn is_same_path<W: World>(mapped: &[Mapped<W>], poses: &[W::Pose]) -> bool {
    mapped.iter().zip(poses).all(|(mapped, pose)| {
        let (apart, _) = W::apart(*pose, mapped.pose);
        let covariance = DMatrix::from_column_slice(W::POSE, W::POSE, mapped.covariance.entries());
        let position = covariance.view((0, 0), (W::POINT, W::POINT)).into_owned();
        apart * apart <= 9.0 * position.symmetric_eigenvalues().max().max(1e-6)
    })
}
