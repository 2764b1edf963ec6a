//! Gauss-Newton steps up the posterior density of a pose: eq. 18 together with eq. 17; twin of `shaders/refine.wgsl`.

use super::cull::{Candidates, LocalMap};
use super::likeliest::{Best, Placed, View};
use crate::evaluator::cholesky::Cholesky;
use crate::evaluator::pose::LocalPose;
use crate::evaluator::tiles::{TILE, Tile};
use crate::evaluator::{CONVERGED, MAX_STEP, Mode, PRIOR_TAIL, PosePrior, SLACK};
use crate::math::{ln, sin_cos, wrap};
use pulp::{Arch, Simd, WithSimd};

/// Climbs from each start to the nearest mode of the posterior of one scan in one map.
///
/// Steps are taken on the gradient alone and never refused for a lower value: a pose further back in a corridor always
/// explains more points than one that reaches into the unknown, and no step may be judged by that.
pub fn refine(map: &LocalMap, starts: &[LocalPose], prior: &PosePrior, tiles: &[Tile], iterations: u32) -> Vec<Mode> {
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
            climb.evaluate(view, prior);
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
    fn evaluate(&mut self, view: View<'_>, prior: &PosePrior) {
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

    /// Moves to the maximum of the model; false where it has none.
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
    fn at(pose: LocalPose, prior: &PosePrior) -> Self {
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
        // Cauchy's robust density: -c²/2 ln(1 + d²/c²) in place of -d²/2, whose weight falls with d².
        let distance2 = pull[0] * off[0] + pull[1] * off[1] + pull[2] * off[2];
        let tail = 1.0 + distance2 / PRIOR_TAIL;
        let weight = 1.0 / tail;
        let gradient = [-(cos * pull[0] + sin * pull[1]), -(cos * pull[1] - sin * pull[0]), -pull[2]];
        let information = [
            cos * cos * xx + 2.0 * cos * sin * xy + sin * sin * yy,
            cos * sin * (yy - xx) + (cos * cos - sin * sin) * xy,
            cos * xh + sin * yh,
            sin * sin * xx - 2.0 * cos * sin * xy + cos * cos * yy,
            cos * yh - sin * xh,
            hh,
        ];
        Self {
            log_density: -0.5 * PRIOR_TAIL * ln(tail),
            gradient: gradient.map(|number| weight * number),
            information: information.map(|number| weight * number),
        }
    }
}

/// The log-likelihood of a scan at a pose, and its derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// Σ max ln p over the points (eq. 18); the outlier density where no cluster is likelier.
    pub log_likelihood: f32,
    /// Its gradient by (forward, sideways, heading) of the robot.
    pub gradient: [f32; 3],
    /// Its negative Hessian, in the Gauss-Newton approximation: xx, xy, xh, yy, yh, hh.
    pub information: [f32; 6],
}

impl View<'_> {
    /// Σ max ln p over all points (eq. 18) from one pose, its gradient and its Gauss-Newton Hessian.
    pub fn linearise(self, pose: LocalPose) -> Evaluation {
        Arch::new().dispatch(Linearise { view: self, pose })
    }
}

struct Linearise<'a> {
    view: View<'a>,
    pose: LocalPose,
}

impl WithSimd for Linearise<'_> {
    type Output = Evaluation;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Evaluation {
        let View { tiles, candidates, log_outlier } = self.view;
        let (sin, cos) = sin_cos(self.pose.heading);
        let placed = Placed::new(simd, self.pose);
        let robot = self.pose;
        let [sin, cos, robot_x, robot_y] = [sin, cos, robot.x, robot.y].map(|value| simd.splat_f32s(value));
        let mut sums = [simd.splat_f32s(0.0); 10];
        for (index, tile) in tiles.iter().enumerate() {
            let (clusters, _) = candidates.of(index);
            let best = Best::of(simd, &placed, tile, clusters, log_outlier);
            // Offsets from the likeliest cluster: zero for an outlier, and along a segment, whose end is where it was
            // last seen and must not pull; a normal latent has no end.
            let mut axes = [[0.0f32; TILE]; 6];
            for (lane, &candidate) in best.candidate.iter().enumerate() {
                if let Some(cluster) = clusters.get(candidate as usize) {
                    for k in 0..3 {
                        axes[k][lane] = cluster.across[k];
                        axes[3 + k][lane] = if cluster.half_length == 0.0 { cluster.along[k] } else { 0.0 };
                    }
                }
            }
            let axes = axes.each_ref().map(|numbers| S::as_simd_f32s(numbers).0);
            let (xs, ys) = (S::as_simd_f32s(&best.x).0, S::as_simd_f32s(&best.y).0);
            for (vector, &log_density) in S::as_simd_f32s(&best.log_density).0.iter().enumerate() {
                let (x, y) = (xs[vector], ys[vector]);
                let (lever_x, lever_y) = (simd.sub_f32s(x, robot_x), simd.sub_f32s(y, robot_y));
                sums[0] = simd.add_f32s(sums[0], log_density);
                for axis in [0, 3] {
                    let [a, b, c] = [axes[axis][vector], axes[axis + 1][vector], axes[axis + 2][vector]];
                    let offset = simd.mul_add_e_f32s(a, x, simd.mul_add_e_f32s(b, y, c));
                    let slope = [
                        simd.mul_add_e_f32s(a, cos, simd.mul_f32s(b, sin)),
                        simd.negate_mul_add_e_f32s(a, sin, simd.mul_f32s(b, cos)),
                        simd.negate_mul_add_e_f32s(a, lever_y, simd.mul_f32s(b, lever_x)),
                    ];
                    for k in 0..3 {
                        sums[1 + k] = simd.negate_mul_add_e_f32s(offset, slope[k], sums[1 + k]);
                    }
                    for (k, (i, j)) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].into_iter().enumerate() {
                        sums[4 + k] = simd.mul_add_e_f32s(slope[i], slope[j], sums[4 + k]);
                    }
                }
            }
        }
        let [log_likelihood, halves @ ..] = sums.map(|lanes| simd.reduce_sum_f32s(lanes));
        let [gx, gy, gh, information @ ..] = halves.map(|half| 2.0 * half);
        Evaluation { log_likelihood, gradient: [gx, gy, gh], information }
    }
}
