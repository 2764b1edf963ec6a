//! Scan-matched proposals: a particle is drawn where the motion and the scan together put it.
//!
//! From a sampled pose, Gauss-Newton steps climb the tempered log of eq. 18 plus the log of the motion model (eq. 17).
//! The Laplace approximation at the top is the proposal; a draw from it is weighed by target / proposal, so the filter
//! still samples from the same posterior (Doucet's optimal proposal, approximated, as in FastSLAM 2.0).

use crate::evaluator::cpu::{Evaluation, LocalMap};
use crate::evaluator::layout::{LocalPose, Tile};
use crate::geometry::Pose;
use nalgebra::{Cholesky, Const, Matrix3, Point2, Vector3};
use serde::{Deserialize, Serialize};

/// How proposals climb.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ProposalConfig {
    /// At most this many Gauss-Newton steps; 0 proposes from the odometry alone, as in the paper.
    pub iterations: usize,
    /// Starts a look for the robot between steps, drawn from the motion model.
    pub tracking_starts: u32,
}

impl Default for ProposalConfig {
    fn default() -> Self {
        Self { iterations: 6, tracking_starts: 24 }
    }
}

/// Where the motion alone expects a particle.
#[derive(Clone, Copy, Debug)]
pub struct Prior {
    /// The mean.
    pub world_from_robot: Pose,
    /// Inverse covariance of (forward, sideways, heading) in the robot's frame.
    pub information: Matrix3<f64>,
}

/// A top of the posterior density of one particle's pose.
#[derive(Clone, Copy, Debug)]
pub struct Mode {
    /// Where it is.
    pub world_from_robot: Pose,
    /// Negative Hessian there, by (forward, sideways, heading) in the robot's frame.
    pub information: Matrix3<f64>,
    /// Tempered log-likelihood plus log prior, but for a constant.
    pub log_posterior: f64,
    /// Share of the scan's points that the map explains.
    pub explained: f64,
}

/// One scan against one map.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// The map near the robot.
    pub map: &'a LocalMap,
    /// The scan.
    pub tiles: &'a [Tile],
    /// Origin of the evaluator's frame in the world.
    pub origin: Point2<f64>,
}

/// Longest step of one iteration [m, m, rad]: a quadratic is trusted no further.
const MAX_STEP: [f64; 3] = [0.3, 0.3, 0.15];
/// A step that moves the robot less than this changes nothing [m, m, rad].
const CONVERGED: [f64; 3] = [5e-4, 5e-4, 2e-4];

impl Target<'_> {
    /// Climbs from `start` to the nearest top.
    ///
    /// Steps are taken on the gradient alone and never refused for a lower value: a pose further back in a corridor
    /// always explains more points than one that reaches into the unknown, and no step may be judged by that.
    pub fn climb(&self, start: Pose, prior: &Prior, iterations: usize) -> Mode {
        let (mut mode, mut gradient) = self.at(start, prior);
        for _ in 0..iterations {
            let Some(cholesky) = Cholesky::new(mode.information) else { break };
            let step = cholesky.solve(&gradient);
            let shrink = (0..3).map(|i| MAX_STEP[i] / step[i].abs().max(1e-12)).fold(1.0, f64::min);
            let step = step * shrink;
            (mode, gradient) = self.at(mode.world_from_robot * Pose::new(step.x, step.y, step.z), prior);
            if (0..3).all(|i| step[i].abs() < CONVERGED[i]) {
                break;
            }
        }
        mode
    }

    /// The quadratic model at a pose, and the gradient.
    fn at(&self, pose: Pose, prior: &Prior) -> (Mode, Vector3<f64>) {
        let evaluation = self.map.linearise(LocalPose::new(pose, self.origin), self.tiles);
        let (log_prior, off, turn) = prior_at(pose, prior);
        let information = evaluation.information_matrix() + turn.transpose() * prior.information * turn;
        let gradient = evaluation.gradient_vector() - turn.transpose() * prior.information * off;
        let mode = Mode {
            world_from_robot: pose,
            information,
            log_posterior: f64::from(evaluation.log_likelihood) + log_prior,
            explained: explained(&evaluation, self.tiles),
        };
        (mode, gradient)
    }

    /// Tempered log-likelihood plus log prior of a pose, but for a constant.
    pub fn log_posterior(&self, pose: Pose, prior: &Prior) -> f64 {
        f64::from(self.map.weigh(LocalPose::new(pose, self.origin), self.tiles)) + prior_at(pose, prior).0
    }
}

fn explained(evaluation: &Evaluation, tiles: &[Tile]) -> f64 {
    let points: u32 = tiles.iter().map(|tile| tile.count).sum();
    f64::from(evaluation.explained) / f64::from(points.max(1))
}

/// Log prior, the pose as the prior's robot sees it, and the turn between the two.
fn prior_at(pose: Pose, prior: &Prior) -> (f64, Vector3<f64>, Matrix3<f64>) {
    let seen = pose.seen_from(prior.world_from_robot);
    let off = Vector3::new(seen.x, seen.y, seen.heading);
    let (sin, cos) = seen.heading.sin_cos();
    let turn = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
    (-0.5 * (prior.information * off).dot(&off), off, turn)
}

/// A draw from the Laplace approximation at a mode and the log of its density, but for the constant that all share.
pub fn draw(mode: &Mode, temper: f64, normals: Vector3<f64>) -> (Pose, f64) {
    let Some(cholesky) = Cholesky::<f64, Const<3>>::new(mode.information * temper) else {
        return (mode.world_from_robot, 0.0);
    };
    let factor = cholesky.l();
    let step = factor.transpose().solve_upper_triangular(&normals).unwrap_or_else(Vector3::zeros);
    let log_density = -0.5 * normals.norm_squared() + factor.diagonal().map(f64::ln).sum();
    (mode.world_from_robot * Pose::new(step.x, step.y, step.z), log_density)
}
