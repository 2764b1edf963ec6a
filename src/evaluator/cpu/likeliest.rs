//! The likeliest cluster of every point (the maximum of eq. 18), in explicit vector instructions; twins of
//! `shaders/shared/likeliest_cluster.wgsl` and `shaders/shared/likeliest_density.wgsl`.
//!
//! AVX-512, AVX2 or NEON are chosen when the program runs. A vector holds neighbouring points; each cluster is spread
//! over all lanes, so that nothing is gathered while maxima are sought.

use super::cull::Candidates;
use crate::evaluator::pose::LocalPose;
use crate::evaluator::tiles::{TILE, Tile};
use crate::likelihood::ClusterParams;
use crate::math::sin_cos;
use pulp::{Arch, Simd, WithSimd};

/// A scan, and the candidates that hold for the poses it is evaluated at.
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
    /// For each point the index in the map of its likeliest cluster; `None` for an outlier.
    pub fn explain(self, pose: LocalPose) -> Vec<Option<usize>> {
        Arch::new().dispatch(Explain { view: self, pose })
    }
}

/// A pose, spread over all lanes.
pub(super) struct Placed<S: Simd> {
    x: S::f32s,
    y: S::f32s,
    sin: S::f32s,
    cos: S::f32s,
}

impl<S: Simd> Placed<S> {
    #[inline(always)]
    pub fn new(simd: S, pose: LocalPose) -> Self {
        let (sin, cos) = sin_cos(pose.heading);
        let [x, y, sin, cos] = [pose.x, pose.y, sin, cos].map(|value| simd.splat_f32s(value));
        Self { x, y, sin, cos }
    }

    /// Points of the robot's frame in the evaluator's.
    #[inline(always)]
    pub fn point(&self, simd: S, x: S::f32s, y: S::f32s) -> (S::f32s, S::f32s) {
        let moved_x = simd.mul_add_e_f32s(self.cos, x, self.x);
        let moved_y = simd.mul_add_e_f32s(self.sin, x, self.y);
        (simd.negate_mul_add_e_f32s(self.sin, y, moved_x), simd.mul_add_e_f32s(self.cos, y, moved_y))
    }
}

/// ln p of points in one cluster, as [`ClusterParams::log_density`] has it.
#[inline(always)]
pub(super) fn log_density<S: Simd>(simd: S, cluster: &ClusterParams, x: S::f32s, y: S::f32s) -> S::f32s {
    let offset = |[a, b, c]: [f32; 3]| {
        let rest = simd.mul_add_e_f32s(simd.splat_f32s(b), y, simd.splat_f32s(c));
        simd.mul_add_e_f32s(simd.splat_f32s(a), x, rest)
    };
    let (along, across) = (offset(cluster.along), offset(cluster.across));
    // Without its sign bit. The `abs_f32s` of pulp is not inlined where tests are built, and takes as long as all the rest.
    let length = simd.and_f32s(along, simd.splat_f32s(f32::from_bits(!(-0.0_f32).to_bits())));
    let beyond = simd.sub_f32s(length, simd.splat_f32s(cluster.half_length));
    let beyond = simd.max_f32s(beyond, simd.splat_f32s(0.0));
    let log_density = simd.negate_mul_add_e_f32s(beyond, beyond, simd.splat_f32s(cluster.log_peak));
    simd.negate_mul_add_e_f32s(across, across, log_density)
}

/// The points of one tile in the evaluator's frame, the highest ln p of each, and which candidate gives it: the first
/// of the likeliest, or `u32::MAX` for an outlier and for a lane that does not count.
pub(super) struct Best {
    pub x: [f32; TILE],
    pub y: [f32; TILE],
    pub log_density: [f32; TILE],
    pub candidate: [u32; TILE],
}

impl Best {
    #[inline(always)]
    pub fn of<S: Simd>(simd: S, placed: &Placed<S>, tile: &Tile, clusters: &[ClusterParams], log_outlier: f32) -> Self {
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
