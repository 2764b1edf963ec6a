//! A path is followed again, scan by scan, and its map rebuilt.

use super::{Closed, Closer, Keyframe, OneMap, SAME, is_near, match_closely};
use crate::evaluator::PosePrior;
use crate::evaluator::pose::LocalPose;
use crate::evaluator::tiles::reach;
use crate::geometry::Pose;
use crate::likelihood::ClusterParams;
use crate::ppca::Cluster;

/// How far off a path is that was bent \[m\]: what a pose graph spreads over a loop.
const POSITION_SIGMA: f64 = 0.1;
/// The same of headings \[rad\].
const HEADING_SIGMA: f64 = 0.02;
/// How far off a wall is still found \[m\].
const CAPTURE_SIGMA: f64 = 0.15;
/// Gauss-Newton steps a scan, with thick walls and with walls as they are.
const ITERATIONS: u32 = 5;
/// Room around the points of a scan \[m\].
const MARGIN: f32 = 1.0;

/// Matches every scan to the map of an earlier drive and of the scans before it, from where the path has it, and merges it.
pub(super) fn rebuild(earlier: &[Cluster], keyframes: &[Keyframe], path: &[Pose], config: &Closer) -> Closed {
    let mut map = OneMap::new(earlier, config, CAPTURE_SIGMA);
    let mut rebuilt: Vec<Pose> = Vec::with_capacity(path.len());
    for (step, (keyframe, &pose)) in keyframes.iter().zip(path).enumerate() {
        // Without an earlier drive there is no map to match the first scan to.
        let matched = if step == 0 && earlier.is_empty() { pose } else { matched(&map, keyframe, pose) };
        // A scan that shows little may be matched to something else: the path knows better.
        let pose = if is_near(matched, pose, SAME) { matched } else { pose };
        map.merge(step as u32, pose, &keyframe.clusters, config);
        rebuilt.push(pose);
    }
    Closed { path: rebuilt, map: map.clusters() }
}

fn matched(map: &OneMap, keyframe: &Keyframe, pose: Pose) -> Pose {
    let (position, heading) = (POSITION_SIGMA.powi(-2) as f32, HEADING_SIGMA.powi(-2) as f32);
    let information = [position, 0.0, 0.0, position, 0.0, heading];
    let (anchor, log_outlier) = (map.table.anchor(), map.table.log_outlier());
    let near = map.near(pose, reach(&keyframe.tiles) + MARGIN);
    let rows: Vec<ClusterParams> = near.iter().map(|&slot| map.table.rows()[slot as usize]).collect();
    let prior = PosePrior { pose: LocalPose::new(pose, anchor), information };
    match_closely(&rows, log_outlier, prior, &keyframe.tiles, CAPTURE_SIGMA, ITERATIONS).mode.pose.in_world(anchor)
}
