//! Tracks the robot from scan to scan.

use super::Slam;
use crate::evaluator::cholesky::{packed, unpacked};
use crate::evaluator::pose::LocalPose;
use crate::evaluator::tiles::Tile;
use crate::evaluator::{Mode, Propagation, Scene, Start, best_modes};
use crate::motion::Motion;
use crate::random::Draw;
use crate::tracking::starts::{more, starts};

/// Modes of a scan match that are compared.
const MODES: usize = 4;

impl Slam {
    /// Tracks the robot from scan to scan in the best map: odometry, corrected by scan matching.
    pub(super) fn track(&mut self, tiles: &[Tile]) {
        let (least, covariance) = (self.config.tracking.starts as usize, self.tracker.tracked().covariance);
        if least == 0 || self.steps == 0 {
            return;
        }
        let points = count_of(tiles);
        // What the map adds for a point to the likelihood of clutter.
        let log_outlier = f64::from(self.table.log_outlier());
        let gain = |mode: &Mode| f64::from(mode.log_likelihood) / points.max(1.0) - log_outlier;
        let count = starts(least, &covariance, self.config.proposal.capture_sigma);
        let Some(mut mode) = self.match_from(count, tiles) else { return };
        // A scan soon after the last one sees little that is new: where it fits badly, the motion is not what odometry says.
        if count == least && self.usual_fit.is_poor(gain(&mode)) {
            // The first starts are the same. Where the walls are new all the same, nothing fits well, and the best of many is not the
            // true place.
            let again = self.match_from(more(count), tiles);
            mode = again.filter(|again| !self.usual_fit.is_poor(gain(again))).unwrap_or(mode);
        }
        self.usual_fit.add(gain(&mode));
        self.tracker.correct(Motion {
            mean: mode.pose.in_world(self.table.anchor()).seen_from(self.hypotheses[self.best].world_from_robot),
            covariance: unpacked(mode.information).try_inverse().unwrap_or(covariance),
        });
    }

    /// The best pose of the robot in the best map that is reached from this many starts, drawn from the motion.
    fn match_from(&mut self, starts: usize, tiles: &[Tile]) -> Option<Mode> {
        let tracked = self.tracker.tracked();
        let information = tracked.covariance.try_inverse()?;
        let best = &self.hypotheses[self.best];
        let expected = LocalPose::new(best.world_from_robot * tracked.mean, self.table.anchor());
        let how = Propagation {
            step: self.readings.len() as u32,
            draw: Draw::Tracking,
            starts: &[Start { mean: expected, prior: expected }],
            particles_per_map: starts,
            // The pose that odometry predicts.
            exact_first: true,
            is_heavy_tailed: true,
            prior_information: packed(&information),
            ..self.propagation()
        };
        let maps = [self.near(&best.map, expected, tiles, how.longest_way())];
        let proposals = self.evaluator.propagate(&Scene { table: &self.table, tiles, maps: &maps }, &how);
        let world_from_step = best.world_from_robot;
        let moved = |mode: &Mode| mode.pose.in_world(self.table.anchor()).seen_from(world_from_step);
        let can_be_driven = |mode: &Mode| self.tracker.can_be_driven(moved(mode));
        let modes = proposals.into_iter().map(|proposal| proposal.mode).filter(can_be_driven);
        // Starts and climbs allow for odometry as bad as configured; which of the modes is right is asked of odometry as this drive has
        // shown it.
        let prior = self.tracker.prior();
        let log_posterior = |mode: &Mode| prior.log_density(moved(mode)) + mode.tempered_log_likelihood();
        let modes = best_modes(modes, MODES).into_iter();
        modes.max_by(|one, other| log_posterior(one).total_cmp(&log_posterior(other)))
    }
}

/// Number of points of a scan.
fn count_of(tiles: &[Tile]) -> f64 {
    tiles.iter().map(|tile| f64::from(tile.count)).sum()
}
