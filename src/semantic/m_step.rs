//! M step (eq. 6): the most likely path, calibration and landmarks, given the weights.

use super::SemanticError;
use super::estimate::Estimate;
use super::hypothesis::Hypothesis;
use super::keyframes::Keyframe;
use super::sensor_model::{CALIBRATION_SIGMAS, LOSS_SCALE, SensorModel, motion_variances};
use crate::factor_graph::{
    Covariances, Graph, Loss, Noise, Odometry, Prior, RangeBearing, Solver, SolverConfig, Values, VariableId,
};
use crate::geometry::Pose;
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
    pub fn new(
        model: &SensorModel<'_>,
        keyframes: &[Keyframe],
        estimate: &Estimate,
        tempering: f64,
        before: Option<&Hypothesis>,
    ) -> Result<Self, SemanticError> {
        let (mut graph, mut values) = (Graph::new(), Values::new());
        let poses: Vec<VariableId> = estimate.poses.iter().map(|pose| values.add_pose(*pose)).collect();
        let calibration = values.add_vector(estimate.calibration.as_slice());
        let landmarks: Vec<VariableId> =
            estimate.landmarks.iter().map(|landmark| values.add_point(landmark.position)).collect();
        match (poses.first(), before) {
            (Some(first), Some(before)) => {
                let known = landmarks.iter().zip(&estimate.numbers);
                let known = known.filter_map(|(id, number)| Some((*id, before.place(*number)?)));
                let (prior, noise) = known_before(before, *first, calibration, known)?;
                graph.add(prior, noise)?;
            }
            (Some(first), None) => {
                graph.add(Prior::pose(*first, Pose::IDENTITY), Noise::sigmas(&[ORIGIN_SIGMA; 3])?)?;
                graph.add(Prior::vector(calibration, &Odometry::CALIBRATED), Noise::sigmas(&CALIBRATION_SIGMAS)?)?;
            }
            (None, _) => {}
        }
        for (ends, keyframe) in poses.windows(2).zip(keyframes.iter().skip(1)) {
            let variances = motion_variances(model.sensors.odometry.variances(&keyframe.motion));
            let factor = Odometry::new(ends[0], ends[1], calibration, keyframe.motion.start_from_end);
            graph.add(factor, Noise::sigmas(variances.map(f64::sqrt).as_slice())?)?;
        }
        for (landmark, at) in landmarks.iter().zip(&estimate.landmarks) {
            graph.add(Prior::point(*landmark, at.position), Noise::sigmas(&[ANYWHERE_SIGMA; 2])?)?;
        }
        for ((keyframe, pose), pairs) in keyframes.iter().zip(&poses).zip(&estimate.weights) {
            for pair in pairs {
                let seen = &keyframe.seen[pair.detection].1;
                let factor = RangeBearing::new(*pose, landmarks[pair.landmark], seen.range, seen.bearing)
                    .from_sensor(model.sensors.robot_from_sensor);
                let sigmas = model.variances(seen).map(f64::sqrt) * tempering;
                let term = graph.add(factor, Noise::sigmas(sigmas.as_slice())?)?;
                graph.set_loss(term, Loss::Cauchy(LOSS_SCALE))?;
                graph.set_weight(term, pair.weight)?;
            }
        }
        Ok(Self { graph, values, poses, calibration, landmarks })
    }

    /// Solves it, and writes the solution to the estimate.
    pub fn solve(&mut self, estimate: &mut Estimate) -> Result<(), SemanticError> {
        // The next sweep changes the weights: a path that is exact to a millimetre is enough for it.
        let config = SolverConfig { iterations: 15, relative_tolerance: 1e-5, absolute_tolerance: 1e-3 };
        Solver::new(config).solve(&self.graph, &mut self.values)?;
        for (pose, id) in estimate.poses.iter_mut().zip(&self.poses) {
            *pose = self.values.pose(*id)?;
        }
        estimate.calibration.copy_from_slice(self.values.vector(self.calibration)?);
        for (landmark, id) in estimate.landmarks.iter_mut().zip(&self.landmarks) {
            landmark.position = self.values.point(*id)?;
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

/// The prior of a window: everything older, summarised in one Gaussian of pose, calibration and landmarks.
fn known_before(
    before: &Hypothesis,
    pose: VariableId,
    calibration: VariableId,
    known: impl Iterator<Item = (VariableId, usize)>,
) -> Result<(Prior, Noise), SemanticError> {
    let (ids, places): (Vec<VariableId>, Vec<usize>) = known.unzip();
    let points = ids.iter().zip(&places).map(|(id, place)| Prior::point(*id, before.landmarks[*place].position));
    let own = [Prior::pose(pose, before.pose), Prior::vector(calibration, before.calibration.as_slice())];
    let covariance = before.covariance_of(&places);
    // The origin is known exactly, and rounding leaves a covariance that is not quite positive.
    let least = DMatrix::identity(covariance.nrows(), covariance.ncols()) * (ORIGIN_SIGMA * ORIGIN_SIGMA);
    Ok((Prior::joint(own.into_iter().chain(points)), Noise::covariance(&(covariance + least))?))
}
