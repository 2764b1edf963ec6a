//! Scan-matched proposals: a particle is drawn where the motion and the scan together put it.
//!
//! From a sampled pose, Gauss-Newton steps climb the log of eq. 18 plus the log of the motion model (eq. 17), and the
//! pose is drawn from the Laplace approximation at the top: the optimal proposal of FastSLAM 2.0, approximated. Drawn
//! from the posterior itself, a particle needs no correction for the proposal; its weight is that of eq. 18.

use crate::evaluator::cpu::LocalMap;
use crate::evaluator::layout::Tile;
use crate::geometry::Pose;
use nalgebra::{Cholesky, Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// How proposals climb.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ProposalConfig {
    /// At most this many Gauss-Newton steps; 0 proposes from the odometry alone, as in the paper.
    pub iterations: usize,
    /// Draws spread this many times as wide as the Laplace approximation of a posterior whose points err
    /// independently; neighbouring points do not, and what the map has wrong they have wrong together.
    pub spread: f64,
    /// Starts a look for the robot between steps, drawn from the motion model.
    pub tracking_starts: u32,
}

impl Default for ProposalConfig {
    fn default() -> Self {
        Self { iterations: 6, spread: 2.0, tracking_starts: 24 }
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
    /// Log-likelihood plus log prior there, but for a constant.
    pub log_posterior: f64,
}

/// The clusters around a robot, with their walls as they are and as far as they capture.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// With the likelihood's own `sigma_floor`.
    pub fine: LocalMap,
    /// With `capture_sigma` in its place.
    pub coarse: LocalMap,
}

impl Surroundings {
    /// Climbs coarsely, to be captured by walls further off, then finely.
    pub fn climb(&self, start: Pose, prior: &Prior, tiles: &[Tile], iterations: usize) -> Mode {
        let captured = climb(&self.coarse, start, prior, tiles, iterations / 2);
        climb(&self.fine, captured.world_from_robot, prior, tiles, iterations)
    }
}

/// Longest step of one iteration \[m, m, rad\]: a quadratic is trusted no further.
const MAX_STEP: [f64; 3] = [0.3, 0.3, 0.15];
/// A step that moves the robot less than this changes nothing \[m, m, rad\].
const CONVERGED: [f64; 3] = [5e-4, 5e-4, 2e-4];

/// Climbs from `start` to the nearest top of the posterior of one scan in one map.
///
/// Steps are taken on the gradient alone and never refused for a lower value: a pose further back in a corridor
/// always explains more points than one that reaches into the unknown, and no step may be judged by that.
pub fn climb(map: &LocalMap, start: Pose, prior: &Prior, tiles: &[Tile], iterations: usize) -> Mode {
    let (mut mode, mut gradient) = linearise(map, start, prior, tiles);
    for _ in 0..iterations {
        let Some(cholesky) = Cholesky::new(mode.information) else { break };
        let step = cholesky.solve(&gradient);
        let shrink = (0..3).map(|i| MAX_STEP[i] / step[i].abs().max(1e-12)).fold(1.0, f64::min);
        let step = step * shrink;
        (mode, gradient) = linearise(map, mode.world_from_robot * Pose::new(step.x, step.y, step.z), prior, tiles);
        if (0..3).all(|i| step[i].abs() < CONVERGED[i]) {
            break;
        }
    }
    mode
}

/// The quadratic model at a pose, and the gradient.
fn linearise(map: &LocalMap, pose: Pose, prior: &Prior, tiles: &[Tile]) -> (Mode, Vector3<f64>) {
    let evaluation = map.linearise(pose, tiles);
    let (log_prior, off, turn) = prior_at(pose, prior);
    let information = evaluation.information_matrix() + turn.transpose() * prior.information * turn;
    let gradient = evaluation.gradient_vector() - turn.transpose() * prior.information * off;
    let log_posterior = f64::from(evaluation.log_likelihood) + log_prior;
    (Mode { world_from_robot: pose, information, log_posterior }, gradient)
}

/// Log prior, the pose as the prior's robot sees it, and the turn between the two.
fn prior_at(pose: Pose, prior: &Prior) -> (f64, Vector3<f64>, Matrix3<f64>) {
    let seen = pose.seen_from(prior.world_from_robot);
    let off = Vector3::new(seen.x, seen.y, seen.heading);
    let (sin, cos) = seen.heading.sin_cos();
    let turn = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
    (-0.5 * (prior.information * off).dot(&off), off, turn)
}

/// A draw from the Laplace approximation at a mode, `spread` times as wide.
pub fn draw(mode: &Mode, spread: f64, normals: [f32; 4]) -> Pose {
    let Some(cholesky) = Cholesky::new(mode.information) else {
        return mode.world_from_robot;
    };
    let standard = Vector3::new(normals[0], normals[1], normals[2]).map(f64::from);
    let step = cholesky.l().transpose().solve_upper_triangular(&(standard * spread)).unwrap_or_else(Vector3::zeros);
    mode.world_from_robot * Pose::new(step.x, step.y, step.z)
}
