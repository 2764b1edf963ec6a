//! Semantic SLAM in the plane by expectation maximisation (S. L. Bowman, N. Atanasov, K. Daniilidis, G. J. Pappas,
//! "Probabilistic Data Association for Semantic SLAM", ICRA 2017).
//!
//! A recording holds odometry and detections: objects of a class at a range and bearing, without identity. Wanted are the
//! path x, the landmarks l with their classes, and which detection shows which landmark. The paper treats this data
//! association as a hidden variable D:
//!
//! - E step (eq. 5): w_kj = Σ over assignments D with D(k) = j of p(D | x, l, detections), for every keyframe.
//! - M step (eq. 6): x, l = arg min Σ w_kj ρ(detection k less landmark j as seen) + odometry.
//!
//! Here both go over all keyframes in each sweep, where the paper weighs a keyframe once; ρ is Cauchy's loss, and the
//! odometry's calibration (forward scale, turn scale, curvature) is estimated with the path, and so is how often an object in
//! view is detected: a map whose objects are in view and not detected is wrong.
//!
//! EM converges to a local optimum, so it needs a start in the right basin. That is found by a beam of hypotheses in a forward
//! pass, run with several densities of new landmarks. The sweeps refine each run, landmarks mapped twice are merged, clutter
//! is dropped, and the run of the highest objective is the result.
//!
//! | File | Task |
//! |---|---|
//! | `config` | the configuration |
//! | `keyframes` | the times at which the pose is estimated |
//! | `sensor_model` | densities of detections and motions |
//! | `hypothesis`, `beam` | the forward pass |
//! | `window` | the same online, a few keyframes at a time |
//! | `estimate`, `objective` | path, map and weights; how good they are |
//! | `history` | hypotheses and sweeps that led to the result |
//! | `e_step`, `m_step` | the sweeps |
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
mod m_step;
mod merging;
mod objective;
mod progress;
mod result;
mod sensor_model;
mod verdict;
mod window;

pub use config::{NEW_DENSITIES, SemanticConfig};
pub use estimate::Landmark;
pub use history::{Candidate, History, Sweep};
pub use result::{Mapped, RunScore, SemanticMap, Weight};
pub use verdict::Verdict;

use crate::detections::Recording;
use crate::factor_graph::{GraphError, VariableId};
use crate::geometry::Pose;
use crate::parameters::ConfigError;
use beam::{Beam, Pass};
use estimate::{Estimate, Pair};
use hypothesis::Hypothesis;
use keyframes::Keyframe;
use m_step::Problem;
use nalgebra::{Matrix2, Matrix3};
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
/// A value of the configuration is out of its range, nothing was seen, or a graph has no solution.
pub fn map(
    recording: &Recording,
    config: &SemanticConfig,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<SemanticMap, SemanticError> {
    with_mapping(recording, config, progress, |_, _| true, |mapping| mapping.map())
}

/// Maps a recording with known associations: the best that the other parts can reach. Detections of no object are left out.
///
/// # Errors
/// Those of [`map`].
pub fn map_known(
    recording: &Recording,
    objects: &Objects,
    config: &SemanticConfig,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<SemanticMap, SemanticError> {
    let is_known = |frame, detection| object(objects, frame, detection).is_some();
    with_mapping(recording, config, progress, is_known, |mapping| mapping.map_known(objects))
}

/// Prepares the `wanted` detections of a recording and maps them by `work`.
fn with_mapping(
    recording: &Recording,
    config: &SemanticConfig,
    progress: &(dyn Fn(f64) + Sync),
    wanted: impl Fn(usize, usize) -> bool,
    work: impl FnOnce(&Mapping<'_>) -> Result<SemanticMap, SemanticError>,
) -> Result<SemanticMap, SemanticError> {
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
struct Mapping<'a> {
    model: &'a SensorModel<'a>,
    keyframes: &'a [Keyframe],
    config: &'a SemanticConfig,
    progress: &'a Progress<'a>,
    /// The state at the first keyframe by the keyframes before it.
    before: Option<&'a Hypothesis>,
}

/// The result with one density of new landmarks.
struct Run {
    estimate: Estimate,
    objective: f64,
    history: History,
    /// Covariance of each pose.
    covariances: Vec<Matrix3<f64>>,
}

fn object(objects: &Objects, frame: usize, detection: usize) -> Option<u64> {
    objects.get(frame)?.get(detection).copied().flatten()
}

impl Mapping<'_> {
    /// One run for each density of new landmarks; the objective chooses.
    fn map(&self) -> Result<SemanticMap, SemanticError> {
        let found: Vec<_> = NEW_DENSITIES.par_iter().map(|density| self.run(*density)).collect();
        let mut found: Vec<Run> = found.into_iter().collect::<Result<_, _>>()?;
        let score = |(new_density, run): (f64, &Run)| RunScore {
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
    fn map_known(&self, objects: &Objects) -> Result<SemanticMap, SemanticError> {
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
    fn run(&self, new_density: f64) -> Result<Run, SemanticError> {
        let log_new = self.model.log_density_of_any_label(new_density);
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

    /// E and M steps from the estimate of a forward pass; `report` is called after each sweep.
    fn sweeps(&self, pass: Pass, mut report: impl FnMut(&Estimate)) -> Result<Estimate, SemanticError> {
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
    fn start(&self, pass: Pass) -> Estimate {
        let landmark = |position: &_| Landmark {
            position: *position,
            covariance: Matrix2::zeros(),
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
            detection_probability: self.model.sensors.detector.detection_probability,
        };
        e_step::class_posteriors(self.model, self.keyframes, &mut estimate, self.before);
        estimate
    }

    /// One E step and one M step.
    fn sweep(&self, estimate: &mut Estimate, tempering: f64) -> Result<(), SemanticError> {
        self.expect(estimate, tempering);
        let light: Vec<bool> =
            estimate.landmarks.iter().map(|landmark| landmark.weight < MIN_LANDMARK_WEIGHT).collect();
        estimate.retain_landmarks(|place| !light[place]);
        self.maximise(estimate, tempering)
    }

    /// One E step.
    fn expect(&self, estimate: &mut Estimate, tempering: f64) {
        e_step::e_step(self.model, self.keyframes, estimate, self.config.association, tempering, self.before);
    }

    /// One M step.
    fn maximise(&self, estimate: &mut Estimate, tempering: f64) -> Result<(), SemanticError> {
        self.problem(estimate, tempering)?.solve(estimate)
    }

    fn problem(&self, estimate: &Estimate, tempering: f64) -> Result<Problem, SemanticError> {
        Problem::new(self.model, self.keyframes, estimate, tempering, self.before)
    }

    fn objective(&self, estimate: &Estimate) -> f64 {
        estimate.objective(self.model, self.keyframes, self.config.landmark_cost)
    }

    /// The covariances of the poses; those of the landmarks are stored in the estimate.
    fn covariances(&self, estimate: &mut Estimate) -> Result<Vec<Matrix3<f64>>, SemanticError> {
        let problem = self.problem(estimate, 1.0)?;
        let covariances = problem.covariances()?;
        for (landmark, id) in estimate.landmarks.iter_mut().zip(problem.landmarks()) {
            landmark.covariance.copy_from(&covariances.block(*id)?);
        }
        let of_pose = |id: &VariableId| Ok(Matrix3::from_column_slice(covariances.block(*id)?.as_slice()));
        problem.poses().iter().map(of_pose).collect()
    }

    /// A run as a result.
    fn finish(&self, run: Run, runs: Vec<RunScore>, others: &[Run]) -> SemanticMap {
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
        let mapped = |((keyframe, pose), covariance): ((&Keyframe, &Pose), _)| Mapped {
            stamp: keyframe.stamp,
            pose: *pose,
            covariance,
            frame: keyframe.frame,
        };
        let keyframes: Vec<Mapped> = moments.map(mapped).collect();
        let agreeing = others.iter().filter(|other| is_same_path(&keyframes, &other.estimate.poses)).count();
        let agreeing = (!others.is_empty()).then_some(agreeing);
        SemanticMap {
            verdict: Verdict::new(self.model, self.keyframes, &estimate, agreeing),
            keyframes,
            landmarks: estimate.landmarks,
            weights,
            calibration: estimate.calibration.into(),
            detection_probability: estimate.detection_probability,
            objective,
            runs,
            detections: self.keyframes.iter().map(|keyframe| keyframe.seen.len()).sum(),
            history,
        }
    }
}

/// Whether each position of a path is within three standard deviations of where it was mapped.
fn is_same_path(mapped: &[Mapped], poses: &[Pose]) -> bool {
    mapped.iter().zip(poses).all(|(mapped, pose)| {
        let apart = pose.position() - mapped.pose.position();
        let position: Matrix2<f64> = mapped.covariance.fixed_view::<2, 2>(0, 0).into_owned();
        apart.norm_squared() <= 9.0 * position.symmetric_eigenvalues().max().max(1e-6)
    })
}
