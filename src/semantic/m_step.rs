//! M step (eq. 6): the most likely path, calibration and landmarks, given the weights.

use super::SemanticError;
use super::estimate::Estimate;
use super::hypothesis::Hypothesis;
use super::keyframes::Keyframe;
use super::linear::LOSS_SCALE;
use super::sensor_model::SensorModel;
use super::world::World;
use crate::factor_graph::{Covariances, Graph, Loss, Noise, Prior, Solver, SolverConfig, Value, Values, VariableId};
use nalgebra::DMatrix;

/// The first pose is the origin \[m, rad\].
const ORIGIN_SIGMA: f64 = 1e-4;
/// A landmark's prior \[m\]: wider than any map, so that a landmark without detections does not make the graph singular.
const ANYWHERE_SIGMA: f64 = 1e4;

/// The graph of an estimate, and its variables.
pub struct Problem {
    graph: Graph,
    values: Values,
    poses: Vec<VariableId>,
    calibration: VariableId,
    landmarks: Vec<VariableId>,
}

impl Problem {
    /// The factors: odometry, the state `before` the keyframes or else the origin and the calibration's prior, and each
    /// pair by its weight. Noise of detections is `tempering` times as wide.
    pub fn new<W: World>(
        model: &SensorModel<'_, W>,
        keyframes: &[Keyframe<W>],
        estimate: &Estimate<W>,
        tempering: f64,
        before: Option<&Hypothesis<W>>,
    ) -> Result<Self, SemanticError> {
        let (mut graph, mut values) = (Graph::new(), Values::new());
        let poses: Vec<VariableId> = estimate.poses.iter().map(|pose| pose.add_to(&mut values)).collect();
        let calibration = values.add_vector(estimate.calibration.as_ref());
        let landmarks: Vec<VariableId> =
            estimate.landmarks.iter().map(|landmark| landmark.position.add_to(&mut values)).collect();
        match (poses.first(), before) {
            (Some(first), Some(before)) => {
                let known = landmarks.iter().zip(&estimate.numbers);
                let known = known.filter_map(|(id, number)| Some((*id, before.place(*number)?)));
                let (prior, noise) = known_before(before, *first, calibration, known)?;
                graph.add(prior, noise)?;
            }
            (Some(first), None) => {
                graph.add(W::origin().prior(*first), Noise::sigmas(&vec![ORIGIN_SIGMA; W::POSE])?)?;
                let sigmas = Noise::sigmas(model.calibration_sigmas().as_ref())?;
                graph.add(Prior::vector(calibration, W::CALIBRATED.as_ref()), sigmas)?;
            }
            (None, _) => {}
        }
        for (ends, keyframe) in poses.windows(2).zip(keyframes.iter().skip(1)) {
            let sigmas: Vec<f64> = model.motion_variances(&keyframe.motion).into_iter().map(f64::sqrt).collect();
            let factor = W::motion_factor([ends[0], ends[1]], calibration, &keyframe.motion);
            graph.add(factor, Noise::sigmas(&sigmas)?)?;
        }
        for (landmark, at) in landmarks.iter().zip(&estimate.landmarks) {
            graph.add(at.position.prior(*landmark), Noise::sigmas(&vec![ANYWHERE_SIGMA; W::POINT])?)?;
        }
        for ((keyframe, pose), pairs) in keyframes.iter().zip(&poses).zip(&estimate.weights) {
            for pair in pairs {
                let seen = &keyframe.seen[pair.detection].1;
                let factor = W::detection_factor(model.sensors(), *pose, landmarks[pair.landmark], seen);
                let mut sigmas = model.variances(seen);
                sigmas.as_mut().iter_mut().for_each(|variance| *variance = variance.sqrt() * tempering);
                let term = graph.add(factor, Noise::sigmas(sigmas.as_ref())?)?;
                graph.set_loss(term, Loss::Cauchy(LOSS_SCALE))?;
                graph.set_weight(term, pair.weight)?;
            }
        }
        Ok(Self { graph, values, poses, calibration, landmarks })
    }

    /// Solves it, and writes the solution to the estimate.
    pub fn solve<W: World>(&mut self, estimate: &mut Estimate<W>) -> Result<(), SemanticError> {
        // The next sweep changes the weights: a path that is exact to a millimetre is enough for it.
        let config = SolverConfig { iterations: 15, relative_tolerance: 1e-5, absolute_tolerance: 1e-3 };
        Solver::new(config).solve(&self.graph, &mut self.values)?;
        for (pose, id) in estimate.poses.iter_mut().zip(&self.poses) {
            *pose = Value::read(&self.values, *id)?;
        }
        estimate.calibration.as_mut().copy_from_slice(self.values.vector(self.calibration)?);
        for (landmark, id) in estimate.landmarks.iter_mut().zip(&self.landmarks) {
            landmark.position = Value::read(&self.values, *id)?;
        }
        Ok(())
    }

    /// The covariances at the solution.
    pub fn covariances(&self) -> Result<Covariances, SemanticError> {
        Ok(Covariances::new(&self.graph, &self.values)?)
    }

    /// The variables of the landmarks.
    pub fn landmarks(&self) -> &[VariableId] {
        &self.landmarks
    }

    /// The variables of the poses.
    pub fn poses(&self) -> &[VariableId] {
        &self.poses
    }
}

/// What a hypothesis knew: everything older than the window, summed up in one Gaussian of pose, calibration and landmarks.
fn known_before<W: World>(
    before: &Hypothesis<W>,
    pose: VariableId,
    calibration: VariableId,
    known: impl Iterator<Item = (VariableId, usize)>,
) -> Result<(Prior, Noise), SemanticError> {
    let (ids, places): (Vec<VariableId>, Vec<usize>) = known.unzip();
    let points = ids.iter().zip(&places).map(|(id, place)| before.landmarks[*place].position.prior(*id));
    let own = [before.pose.prior(pose), Prior::vector(calibration, before.calibration.as_ref())];
    let covariance = before.covariance_of(&places);
    // The origin is known exactly, and rounding leaves a covariance that is not quite positive.
    let least = DMatrix::identity(covariance.nrows(), covariance.ncols()) * (ORIGIN_SIGMA * ORIGIN_SIGMA);
    Ok((Prior::joint(own.into_iter().chain(points)), Noise::covariance(&(covariance + least))?))
}
