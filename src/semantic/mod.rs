//! Semantic SLAM in the plane by expectation maximisation (S. L. Bowman, N. Atanasov, K. Daniilidis, G. J. Pappas,
//! "Probabilistic Data Association for Semantic SLAM", ICRA 2017).
//!
//! A recording holds odometry and detections: objects of a class at a range and bearing, and nobody tells which object.
//! Wanted are the path x, the landmarks l with their classes, and which detection shows which landmark. The paper takes
//! the last one for a hidden variable D:
//!
//! - E step (eq. 5): w_kj = Σ over assignments D with D(k) = j of p(D | x, l, detections), for every keyframe.
//! - M step (eq. 6): x, l = arg min Σ w_kj ρ(detection k less landmark j as seen) + odometry.
//!
//! Here both go over all keyframes in each sweep, where the paper weighs a keyframe once; ρ is Cauchy's loss, and the
//! odometry's calibration (forward scale, turn scale, curvature) is estimated with the path.
//!
//! EM polishes and does not rescue: it needs a start in the right basin. That is found by a beam of hypotheses in a forward
//! pass, run with several densities of new landmarks. The sweeps polish each run, landmarks mapped twice are merged, and the
//! run of the highest objective is the result.
//!
//! | File | Task |
//! |---|---|
//! | `config` | what can be set |
//! | `keyframes` | the moments whose pose is estimated |
//! | `sensor_model` | densities of detections and motions |
//! | `hypothesis`, `beam` | the forward pass |
//! | `estimate` | path, map, weights, and the objective |
//! | `e_step`, `m_step` | the sweeps |
//! | `merging` | landmarks mapped twice |
//!
//! The world's origin is the pose at the first keyframe. Metres, radians, seconds; log-likelihoods in nats.

mod beam;
mod config;
mod e_step;
mod estimate;
mod hypothesis;
mod keyframes;
mod m_step;
mod merging;
mod sensor_model;

pub use config::{NEW_DENSITIES, SemanticConfig};
pub use estimate::Landmark;

use crate::detections::Recording;
use crate::factor_graph::GraphError;
use crate::geometry::StampedPose;
use crate::parameters::ConfigError;
use estimate::{Estimate, Pair};
use keyframes::Keyframe;
use nalgebra::Matrix2;
use sensor_model::SensorModel;

/// Annealing: the first sweep multiplies the noise of detections by this, the last one by 1. Else landmarks that are alike
/// would fix their weights before the path has settled.
const FIRST_TEMPERING: f64 = 3.0;
/// A landmark goes whose weights sum to less: one detection alone is as likely clutter.
const MIN_LANDMARK_WEIGHT: f64 = 1.5;

/// Why a recording cannot be mapped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SemanticError {
    /// A value of the configuration cannot be.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// There is nothing to map.
    #[error("no frame has a detection that its sensor can see, so there is nothing to map; see [view] in sensors.toml")]
    NothingSeen,
    /// The M step has no solution.
    #[error("the M step has no solution: {0}")]
    Graph(#[from] GraphError),
}

/// A weight of the E step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weight {
    /// Number of the frame in the recording.
    pub frame: usize,
    /// Number of the detection in the frame.
    pub detection: usize,
    /// Number of the landmark in the map.
    pub landmark: usize,
    /// Probability that the one shows the other.
    pub weight: f64,
}

/// One of the runs that the objective chose from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunScore {
    /// Density of new landmarks \[1/(m rad)\].
    pub new_density: f64,
    /// The objective \[nats\].
    pub objective: f64,
    /// How many landmarks it has.
    pub landmarks: usize,
}

/// A recording, mapped.
#[derive(Clone, Debug)]
pub struct SemanticMap {
    /// `world_from_robot` at the keyframes.
    pub trajectory: Vec<StampedPose>,
    /// The map.
    pub landmarks: Vec<Landmark>,
    /// Weights of at least 0.02, frame by frame.
    pub weights: Vec<Weight>,
    /// Forward scale, turn scale, curvature \[rad/m\] of the odometry.
    pub calibration: [f64; 3],
    /// The objective \[nats\].
    pub objective: f64,
    /// All runs, in the order of [`NEW_DENSITIES`].
    pub runs: Vec<RunScore>,
    /// How many detections were used.
    pub detections: usize,
}

/// Maps a recording.
///
/// # Errors
/// The configuration cannot be, nothing was seen, or a graph has no solution.
pub fn map(recording: &Recording, config: &SemanticConfig) -> Result<SemanticMap, SemanticError> {
    config.validate()?;
    let model = &SensorModel::new(&recording.sensors);
    let keyframes = &keyframes::keyframes(recording, config.interval)[..];
    if keyframes.is_empty() {
        return Err(SemanticError::NothingSeen);
    }
    let pass = Pass { model, keyframes, config };
    let mut runs = Vec::new();
    let mut best: Option<(Estimate, f64)> = None;
    for new_density in NEW_DENSITIES {
        let (estimate, objective) = pass.run(new_density)?;
        runs.push(RunScore { new_density, objective, landmarks: estimate.landmarks.len() });
        if best.as_ref().is_none_or(|(_, most)| objective > *most) {
            best = Some((estimate, objective));
        }
    }
    let (estimate, objective) = best.ok_or(SemanticError::NothingSeen)?;
    pass.finish(estimate, objective, runs)
}

/// A recording under way.
struct Pass<'a> {
    model: &'a SensorModel<'a>,
    keyframes: &'a [Keyframe],
    config: &'a SemanticConfig,
}

impl Pass<'_> {
    /// Forward pass, sweeps and merging: an estimate and its objective.
    fn run(&self, new_density: f64) -> Result<(Estimate, f64), SemanticError> {
        let mut estimate = self.start(new_density);
        self.maximise(&mut estimate, FIRST_TEMPERING)?;
        for sweep in 0..self.config.sweeps {
            let share = (sweep + 1) as f64 / self.config.sweeps as f64;
            self.sweep(&mut estimate, FIRST_TEMPERING.powf(1.0 - share))?;
        }
        let objective = self.objective(&estimate);
        merging::merge(self, estimate, objective)
    }

    /// The best hypothesis of the forward pass.
    fn start(&self, new_density: f64) -> Estimate {
        let (model, config) = (self.model, self.config);
        let log_new = model.log_density_of_any_label(new_density);
        let pass = beam::forward(model, self.keyframes, log_new, config.beam, config.branches);
        let tracked = &pass.last.landmarks;
        let landmarks = tracked.iter().map(|tracked| Landmark {
            position: tracked.position,
            covariance: Matrix2::zeros(),
            classes: tracked.classes.clone(),
            weight: tracked.sightings as f64,
        });
        let weigh = |ids: &Vec<usize>| {
            let places = ids.iter().enumerate().filter_map(|(detection, id)| {
                let landmark = tracked.iter().position(|tracked| tracked.id == *id)?;
                Some(Pair { detection, landmark, weight: 1.0 })
            });
            places.collect()
        };
        let weights = pass.assignments.iter().map(weigh).collect();
        Estimate { poses: pass.poses, calibration: pass.last.calibration, landmarks: landmarks.collect(), weights }
    }

    /// One E step and one M step.
    fn sweep(&self, estimate: &mut Estimate, tempering: f64) -> Result<(), SemanticError> {
        e_step::e_step(self.model, self.keyframes, estimate, self.config.association, tempering);
        let light: Vec<bool> =
            estimate.landmarks.iter().map(|landmark| landmark.weight < MIN_LANDMARK_WEIGHT).collect();
        estimate.retain_landmarks(|place| !light[place]);
        self.maximise(estimate, tempering)
    }

    /// One M step.
    fn maximise(&self, estimate: &mut Estimate, tempering: f64) -> Result<(), SemanticError> {
        m_step::m_step(self.model, self.keyframes, estimate, tempering).map(|_| ())
    }

    fn objective(&self, estimate: &Estimate) -> f64 {
        estimate.objective(self.model, self.keyframes, self.config.landmark_cost)
    }

    /// The estimate as a result, with covariances.
    fn finish(
        &self,
        mut estimate: Estimate,
        objective: f64,
        runs: Vec<RunScore>,
    ) -> Result<SemanticMap, SemanticError> {
        let problem = m_step::m_step(self.model, self.keyframes, &mut estimate, 1.0)?;
        let covariances = problem.covariances()?;
        for (landmark, id) in estimate.landmarks.iter_mut().zip(problem.landmarks()) {
            landmark.covariance.copy_from(&covariances.block(*id)?);
        }
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
        let stamped = |(keyframe, pose): (&Keyframe, &_)| StampedPose { stamp: keyframe.stamp, pose: *pose };
        Ok(SemanticMap {
            trajectory: self.keyframes.iter().zip(&estimate.poses).map(stamped).collect(),
            landmarks: estimate.landmarks,
            weights,
            calibration: estimate.calibration.into(),
            objective,
            runs,
            detections: self.keyframes.iter().map(|keyframe| keyframe.seen.len()).sum(),
        })
    }
}
