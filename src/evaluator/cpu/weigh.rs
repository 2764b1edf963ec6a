//! Weighing: the log-likelihood of a scan from every pose (eq. 18), in explicit vector instructions; twin of
//! `shaders/weigh.wgsl`.

use super::cull::{Candidates, LocalMap};
use super::likeliest::{Placed, View, log_density};
use crate::evaluator::pose::LocalPose;
use crate::evaluator::tiles::{TILE, Tile};
use pulp::{Arch, Simd, WithSimd};

/// Log-likelihoods of a group of poses that lie close together.
pub(super) fn weigh(map: &LocalMap, tiles: &[Tile], poses: &[LocalPose]) -> Vec<f32> {
    let mut candidates = Candidates::default();
    candidates.cover(map, tiles, poses, [0.0; 2]);
    let mut out = vec![0.0; poses.len()];
    View { tiles, candidates: &candidates, log_outlier: map.log_outlier() }.log_likelihoods(poses, &mut out);
    out
}

impl View<'_> {
    /// Σ max ln p over all points (eq. 18), from each pose.
    pub fn log_likelihoods(self, poses: &[LocalPose], out: &mut [f32]) {
        Arch::new().dispatch(LogLikelihoods { view: self, poses, out });
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
