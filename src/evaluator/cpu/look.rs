//! One look at a scan: its points against the candidates of their tiles (eq. 18), in explicit vector instructions.
//!
//! AVX-512, AVX2 or NEON are chosen when the program runs. A vector holds neighbouring points; each cluster is spread
//! over all lanes, so that nothing is gathered while maxima are sought.

use crate::evaluator::cull::Candidates;
use crate::evaluator::layout::{ClusterParams, LocalPose, TILE, Tile};
use crate::math::sin_cos;
use pulp::{Arch, Simd, WithSimd};

/// Sums of one look at a scan from a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// Σ max ln p over the points (eq. 18); the outlier density where no cluster is likelier.
    pub log_likelihood: f32,
    /// Its gradient by (forward, sideways, heading) of the robot.
    pub gradient: [f32; 3],
    /// Its negative Hessian, in the Gauss-Newton approximation: xx, xy, xh, yy, yh, hh.
    pub information: [f32; 6],
}

/// A scan, and the candidates that hold for the poses it is looked at from.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// The points.
    pub tiles: &'a [Tile],
    /// What they may be explained by.
    pub candidates: &'a Candidates,
    /// ln of the density of a point that no cluster explains.
    pub log_outlier: f32,
}

impl View<'_> {
    /// Σ max ln p over all points (eq. 18), from each pose.
    pub fn log_likelihoods(self, poses: &[LocalPose], out: &mut [f32]) {
        Arch::new().dispatch(LogLikelihoods { view: self, poses, out });
    }

    /// The same with its gradient and Gauss-Newton Hessian, from one pose.
    pub fn linearise(self, pose: LocalPose) -> Evaluation {
        Arch::new().dispatch(Linearise { view: self, pose })
    }

    /// For each point the place in the map of its most likely cluster; `None` for an outlier.
    pub fn explain(self, pose: LocalPose) -> Vec<Option<usize>> {
        Arch::new().dispatch(Explain { view: self, pose })
    }
}

struct LogLikelihoods<'a> {
    view: View<'a>,
    poses: &'a [LocalPose],
    out: &'a mut [f32],
}

impl WithSimd for LogLikelihoods<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let View { tiles, candidates, log_outlier } = self.view;
        let (numbers, _) = S::as_simd_f32s(&LANE_NUMBERS);
        for (pose, out) in self.poses.iter().zip(self.out) {
            let placed = Placed::new(simd, *pose);
            let mut sum = simd.splat_f32s(0.0);
            for (index, tile) in tiles.iter().enumerate() {
                let (clusters, _) = candidates.of(index);
                let (xs, _) = S::as_simd_f32s(&tile.x);
                let (ys, _) = S::as_simd_f32s(&tile.y);
                let count = simd.splat_f32s(tile.count as f32);
                for ((&x, &y), &number) in xs.iter().zip(ys).zip(numbers) {
                    let (x, y) = placed.point(simd, x, y);
                    let mut best = simd.splat_f32s(log_outlier);
                    for cluster in clusters {
                        best = simd.max_f32s(best, log_density(simd, cluster, x, y));
                    }
                    let counts = simd.less_than_f32s(number, count);
                    sum = simd.add_f32s(sum, simd.select_f32s(counts, best, simd.splat_f32s(0.0)));
                }
            }
            *out = simd.reduce_sum_f32s(sum);
        }
    }
}

/// 0, 1, 2 ..: which point of a tile a lane holds.
const LANE_NUMBERS: [f32; TILE] = {
    let mut numbers = [0.0; TILE];
    let mut lane = 0;
    while lane < TILE {
        numbers[lane] = lane as f32;
        lane += 1;
    }
    numbers
};

/// A pose, spread over all lanes.
struct Placed<S: Simd> {
    x: S::f32s,
    y: S::f32s,
    sin: S::f32s,
    cos: S::f32s,
}

impl<S: Simd> Placed<S> {
    #[inline(always)]
    fn new(simd: S, pose: LocalPose) -> Self {
        let (sin, cos) = sin_cos(pose.heading);
        let [x, y, sin, cos] = [pose.x, pose.y, sin, cos].map(|value| simd.splat_f32s(value));
        Self { x, y, sin, cos }
    }

    /// Points of the robot's frame in the evaluator's.
    #[inline(always)]
    fn point(&self, simd: S, x: S::f32s, y: S::f32s) -> (S::f32s, S::f32s) {
        let moved_x = simd.mul_add_e_f32s(self.cos, x, self.x);
        let moved_y = simd.mul_add_e_f32s(self.sin, x, self.y);
        (simd.negate_mul_add_e_f32s(self.sin, y, moved_x), simd.mul_add_e_f32s(self.cos, y, moved_y))
    }
}

/// ln p of points in one cluster, as [`ClusterParams::log_density`] has it.
#[inline(always)]
fn log_density<S: Simd>(simd: S, cluster: &ClusterParams, x: S::f32s, y: S::f32s) -> S::f32s {
    let offset = |[a, b, c]: [f32; 3]| {
        let rest = simd.mul_add_e_f32s(simd.splat_f32s(b), y, simd.splat_f32s(c));
        simd.mul_add_e_f32s(simd.splat_f32s(a), x, rest)
    };
    let (along, across) = (offset(cluster.along), offset(cluster.across));
    let beyond = simd.sub_f32s(simd.abs_f32s(along), simd.splat_f32s(cluster.half_length));
    let beyond = simd.max_f32s(beyond, simd.splat_f32s(0.0));
    let log_density = simd.negate_mul_add_e_f32s(beyond, beyond, simd.splat_f32s(cluster.log_peak));
    simd.negate_mul_add_e_f32s(across, across, log_density)
}

/// The points of one tile in the evaluator's frame, the highest ln p of each, and which candidate gives it: the first
/// of the likeliest, or `u32::MAX` for an outlier and for a lane that does not count.
struct Best {
    x: [f32; TILE],
    y: [f32; TILE],
    log_density: [f32; TILE],
    candidate: [u32; TILE],
}

impl Best {
    #[inline(always)]
    fn of<S: Simd>(simd: S, placed: &Placed<S>, tile: &Tile, clusters: &[ClusterParams], log_outlier: f32) -> Self {
        let mut out = Self { x: [0.0; TILE], y: [0.0; TILE], log_density: [0.0; TILE], candidate: [u32::MAX; TILE] };
        let (xs, _) = S::as_simd_f32s(&tile.x);
        let (ys, _) = S::as_simd_f32s(&tile.y);
        let (out_x, _) = S::as_mut_simd_f32s(&mut out.x);
        let (out_y, _) = S::as_mut_simd_f32s(&mut out.y);
        let (out_density, _) = S::as_mut_simd_f32s(&mut out.log_density);
        let (out_candidate, _) = S::as_mut_simd_u32s(&mut out.candidate);
        for vector in 0..xs.len() {
            let (x, y) = placed.point(simd, xs[vector], ys[vector]);
            let mut best = simd.splat_f32s(log_outlier);
            let mut candidate = simd.splat_u32s(u32::MAX);
            for (number, cluster) in clusters.iter().enumerate() {
                let log_density = log_density(simd, cluster, x, y);
                let better = simd.less_than_f32s(best, log_density);
                best = simd.select_f32s(better, log_density, best);
                candidate = simd.select_u32s(better, simd.splat_u32s(number as u32), candidate);
            }
            out_x[vector] = x;
            out_y[vector] = y;
            out_density[vector] = best;
            out_candidate[vector] = candidate;
        }
        for lane in tile.count as usize..TILE {
            out.log_density[lane] = 0.0;
            out.candidate[lane] = u32::MAX;
        }
        out
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

struct Explain<'a> {
    view: View<'a>,
    pose: LocalPose,
}

impl WithSimd for Explain<'_> {
    type Output = Vec<Option<usize>>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let View { tiles, candidates, log_outlier } = self.view;
        let placed = Placed::new(simd, self.pose);
        let mut out = Vec::with_capacity(tiles.len() * TILE);
        for (index, tile) in tiles.iter().enumerate() {
            let (clusters, numbers) = candidates.of(index);
            let best = Best::of(simd, &placed, tile, clusters, log_outlier);
            let explained = best.candidate.iter().take(tile.count as usize);
            out.extend(explained.map(|&candidate| numbers.get(candidate as usize).map(|&number| number as usize)));
        }
        out
    }
}
