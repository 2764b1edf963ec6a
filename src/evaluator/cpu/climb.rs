//! Gauss-Newton steps up the posterior density of a pose: eq. 18 together with eq. 17.

use super::look::{Evaluation, View};
use crate::evaluator::cull::{Candidates, LocalMap};
use crate::evaluator::layout::{LocalPose, Tile};
use crate::evaluator::symmetric::Cholesky;
use crate::evaluator::{CONVERGED, MAX_STEP, Mode, Prior, SLACK};
use crate::math::{sin_cos, wrap};

/// Climbs from each start to the nearest top of the posterior of one scan in one map.
///
/// Steps are taken on the gradient alone and never refused for a lower value: a pose further back in a corridor always
/// explains more points than one that reaches into the unknown, and no step may be judged by that.
pub fn refine(map: &LocalMap, starts: &[LocalPose], prior: &Prior, tiles: &[Tile], iterations: u32) -> Vec<Mode> {
    let mut candidates = Candidates::default();
    let mut climbs: Vec<Climb> = starts.iter().map(|&pose| Climb::new(pose)).collect();
    for iteration in 0..=iterations {
        let poses: Vec<LocalPose> = climbs.iter().filter(|c| !c.settled).map(|c| c.mode.pose).collect();
        if poses.is_empty() {
            break;
        }
        candidates.cover(map, tiles, &poses, SLACK);
        let view = View { tiles, candidates: &candidates, log_outlier: map.log_outlier() };
        for climb in climbs.iter_mut().filter(|climb| !climb.settled) {
            climb.look(view, prior);
            if climb.converged || iteration == iterations || !climb.step() {
                climb.settled = true;
            }
        }
    }
    climbs.into_iter().map(|climb| climb.mode).collect()
}

struct Climb {
    mode: Mode,
    gradient: [f32; 3],
    /// The last step moved next to nothing.
    converged: bool,
    settled: bool,
}

impl Climb {
    fn new(pose: LocalPose) -> Self {
        Self { mode: Mode { pose, ..Mode::default() }, gradient: [0.0; 3], converged: false, settled: false }
    }

    /// The quadratic model at the pose.
    fn look(&mut self, view: View<'_>, prior: &Prior) {
        let pose = self.mode.pose;
        let Evaluation { log_likelihood, gradient, information } = view.linearise(pose);
        let prior = PriorModel::at(pose, prior);
        self.gradient = std::array::from_fn(|k| gradient[k] + prior.gradient[k]);
        self.mode = Mode {
            pose,
            log_likelihood,
            log_posterior: log_likelihood + prior.log_density,
            information: std::array::from_fn(|k| information[k] + prior.information[k]),
        };
    }

    /// Moves to the top of the model; false where it has none.
    fn step(&mut self) -> bool {
        let Some(cholesky) = Cholesky::new(self.mode.information) else { return false };
        let step = cholesky.solve(self.gradient);
        let shrink = (0..3).fold(1.0f32, |shrink, k| shrink.min(MAX_STEP[k] / step[k].abs().max(1e-12)));
        let step = step.map(|s| s * shrink);
        self.converged = (0..3).all(|k| step[k].abs() < CONVERGED[k]);
        self.mode.pose = self.mode.pose.moved(step);
        true
    }
}

/// The log of the prior around a pose, but for a constant.
struct PriorModel {
    log_density: f32,
    gradient: [f32; 3],
    information: [f32; 6],
}

impl PriorModel {
    fn at(pose: LocalPose, prior: &Prior) -> Self {
        // The pose as the prior's robot sees it, and the turn between the two.
        let (sin, cos) = sin_cos(prior.pose.heading);
        let (dx, dy) = (pose.x - prior.pose.x, pose.y - prior.pose.y);
        let turn = wrap(pose.heading - prior.pose.heading);
        let off = [cos * dx + sin * dy, cos * dy - sin * dx, turn];
        let (sin, cos) = sin_cos(turn);
        let [xx, xy, xh, yy, yh, hh] = prior.information;
        let pull = [
            xx * off[0] + xy * off[1] + xh * off[2],
            xy * off[0] + yy * off[1] + yh * off[2],
            xh * off[0] + yh * off[1] + hh * off[2],
        ];
        Self {
            log_density: -0.5 * (pull[0] * off[0] + pull[1] * off[1] + pull[2] * off[2]),
            gradient: [-(cos * pull[0] + sin * pull[1]), -(cos * pull[1] - sin * pull[0]), -pull[2]],
            information: [
                cos * cos * xx + 2.0 * cos * sin * xy + sin * sin * yy,
                cos * sin * (yy - xx) + (cos * cos - sin * sin) * xy,
                cos * xh + sin * yh,
                sin * sin * xx - 2.0 * cos * sin * xy + cos * cos * yy,
                cos * yh - sin * xh,
                hh,
            ],
        }
    }
}
