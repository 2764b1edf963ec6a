//! How well the map of a path agrees with itself.

use super::bend::Tie;
use super::search::Older;
use super::{Closer, Drive, SAME, is_near};
use crate::evaluator::failover::Failover;
use crate::geometry::Pose;

/// What windows all along a path say of it.
#[derive(Debug, Default)]
pub(super) struct Agreement {
    /// Sum of the shares that the map of before explains of each window from where the path has it.
    pub explained: f64,
    /// Places near the path that are the same.
    pub ties: Vec<Tie>,
}

/// Of a place that was only a little off, less may be explained than of one that was searched for everywhere.
const LEAST_EXPLAINED: f64 = 0.3;

/// Looks for each window of the path in the map of what is older, close to where the path has it.
pub(super) fn agreement(drive: &Drive, path: &[Pose], config: &Closer, evaluator: &mut Failover) -> Agreement {
    let mut older = Older::new(config);
    let mut agreement = Agreement::default();
    let mut searched = 0.0;
    for step in 0..path.len() {
        if drive.travelled[step] - searched < config.loops.search_distance {
            continue;
        }
        searched = drive.travelled[step];
        let Some(window) = drive.window(step, &config.loops) else { continue };
        older.follow(&drive.keyframes[..window.older], &path[..window.older], config);
        let found =
            drive.query(window, path, config).and_then(|query| older.search_near(&query, path[step], evaluator));
        if let Some(found) = found.filter(|found| found.explained >= LEAST_EXPLAINED) {
            let is_here = is_near(found.world_from_robot, path[step], SAME);
            agreement.explained += if is_here { found.explained } else { 0.0 };
            agreement.ties.push(Tie::new(found.world_from_robot, path, window));
        }
    }
    agreement
}
