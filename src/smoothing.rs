//! After the filter: every scan is matched to the finished map, and the map is fitted to all scans.
//!
//! The filter decides which walls are the same and so closes the loops; but it saw each place with a map half built,
//! and takes a step only every now and then. Smoothing holds its decisions and alternates, as EM with hard assignments:
//!
//! 1. every scan's pose climbs the log of eq. 18 in the current map, from where it is;
//! 2. every cluster becomes the PPCA fit (eq. 11-13) of all points that it explains best, of all scans.
//!
//! At last what is no wall goes: clusters that more scans looked through than saw, such as where somebody walked by, and
//! those that explain least.
//!
//! Scans are read again from the log in each pass, so memory does not grow with their points. Of `ipslam run` with a single map
//! on CSAIL, its five readings (the filter, three passes, the pictures) take 2 % of the time.

use crate::ablation::{AblationConfig, MatchingRule};
use crate::evaluator::PosePrior;
use crate::evaluator::cpu::match_scan;
use crate::evaluator::pose::LocalPose;
use crate::evaluator::tiles::tiles;
use crate::geometry::Pose;
use crate::likelihood::{ClusterParams, LikelihoodConfig};
use crate::log::{LogEntry, LogError, LogSource, readings};
use crate::map::MapCluster;
use crate::map::matching::{MatchingConfig, match_clusters};
use crate::map::merging::{MergingConfig, consolidated};
use crate::parameters::parameters;
use crate::ppca::{Cluster, Moments};
use crate::report::{Estimate, RunResult};
use crate::scan::{Scan, ScanConfig};
use nalgebra::Point2;
use passing::passing;
use rayon::prelude::*;

mod passing;

parameters! {
    /// How a finished run is smoothed.
    pub struct SmoothingConfig {
        /// Passes over the log; 0 leaves the filter's result as it is, as in the paper.
        passes: usize = 3, in 0.0..=f64::INFINITY;
        /// The map is the smallest set of clusters that explains this share of what all clusters explain, and what 20 scans or
        /// more saw; the rest is clutter, seen in passing.
        keep_explained: f64 = 0.95, in 0.0..=1.0;
    }
}

/// Everything that smoothing takes from the configuration of the filter.
#[derive(Clone, Copy, Debug)]
pub struct Smoother {
    /// From ranges to points, as in the filter.
    pub scan: ScanConfig,
    /// How likely points are, as in the filter.
    pub likelihood: LikelihoodConfig,
    /// Which clusters are one wall, as in the filter.
    pub matching: MatchingConfig,
    /// When they are merged, as in the filter.
    pub merging: MergingConfig,
    /// What is switched to the paper's rules.
    pub ablation: AblationConfig,
    /// Passes, and what is clutter.
    pub smoothing: SmoothingConfig,
}

/// How far a pass is expected to move a scan, forward and sideways \[m\]: as far as walls are known (`sigma_floor`).
const POSITION_SIGMA: f64 = 0.03;
/// How far a pass is expected to turn a scan \[rad\]: as far as moves a wall 3 m off by as much.
const HEADING_SIGMA: f64 = 0.01;
/// A cluster that this many scans saw is a wall, though it explains little: they span two metres of way, unless the robot
/// stands.
const MANY_SCANS: u32 = 20;
/// A scan saw a cluster that explains at least this many of its points, and looked through one that so many beams pass.
const SEEN: f64 = 3.0;
/// Scans matched at a time; they share nothing but the map.
const BATCH: usize = 256;
/// Gauss-Newton steps a scan and pass.
const ITERATIONS: u32 = 5;

impl Smoother {
    /// Smooths the result of a run of this log in place. Frames stay: the world's origin is still the first pose of the
    /// filter. What an earlier drive saw of the walls counts as it did then. A result without poses or without clusters stays as
    /// it is. `progress` is handed the share that is done, 0 to 1.
    ///
    /// # Errors
    /// The log cannot be read again to the last pose of the result; the result is then that of the passes before.
    pub fn smooth(
        &self,
        source: &dyn LogSource,
        result: &mut RunResult,
        progress: &mut dyn FnMut(f64),
    ) -> Result<(), LogError> {
        let passes = self.smoothing.passes;
        for pass in 0..passes {
            let mut progress = |share| progress((pass as f64 + share) / passes as f64);
            let is_last = pass + 1 == passes;
            let mut support = match_scans(source, result, self, is_last, &mut progress)?;
            add_earlier(&mut support, &result.map.clusters, &result.earlier, &self.matching);
            result.map.clusters = refit(&support, self, is_last);
            result.looked_through = looked_through(&support);
        }
        Ok(())
    }
}

/// Moves every scan to where the map wants it, and gathers what each cluster then explains.
fn match_scans(
    source: &dyn LogSource,
    result: &mut RunResult,
    config: &Smoother,
    is_last: bool,
    progress: &mut dyn FnMut(f64),
) -> Result<Vec<Support>, LogError> {
    let before: Vec<Pose> = result.poses.iter().map(|estimate| estimate.world_from_robot.unwrap_or_default()).collect();
    let mut support = vec![Support::default(); result.map.clusters.len()];
    let mut is_laser = vec![false; before.len()];
    let mut batch: Vec<(usize, Pose, Scan)> = Vec::with_capacity(BATCH);
    let mut place = |batch: &mut Vec<(usize, Pose, Scan)>, result: &mut RunResult| {
        let map = &result.map.clusters;
        let place = |(index, robot_from_laser, scan): &(usize, Pose, Scan)| {
            let placed = place_scan(map, scan, before[*index], config);
            let laser = (placed.world_from_robot * *robot_from_laser).position();
            let passing = if is_last { passing(map, laser, &placed.points) } else { Vec::new() };
            (placed, passing)
        };
        let placed: Vec<(Placed, Vec<u32>)> = batch.par_iter().map(place).collect();
        for ((index, ..), (placed, passing)) in batch.drain(..).zip(placed) {
            result.poses[index].world_from_robot = Some(placed.world_from_robot);
            is_laser[index] = true;
            for (cluster, point) in placed.likeliest.into_iter().zip(placed.points) {
                cluster.into_iter().for_each(|cluster| support[cluster].add(index, point));
            }
            support.iter_mut().zip(passing).for_each(|(support, beams)| support.add_passing(index, beams));
        }
    };
    for reading in readings(source)?.take(before.len()) {
        let (index, entry) = reading?;
        if let LogEntry::Laser(reading) = entry {
            batch.push((index, reading.robot_from_laser, Scan::from_reading(&reading, &config.scan)));
        }
        if batch.len() == BATCH {
            place(&mut batch, result);
            progress(index as f64 / before.len() as f64);
        }
    }
    place(&mut batch, result);

    // Readings without a scan keep their place relative to the last scan.
    let mut last_laser: Option<(Pose, Pose)> = None;
    for ((Estimate { world_from_robot, .. }, before), is_laser) in result.poses.iter_mut().zip(before).zip(is_laser) {
        if is_laser {
            last_laser = world_from_robot.map(|after| (before, after));
        } else if let Some((laser_before, laser_after)) = last_laser {
            *world_from_robot = Some(laser_after * before.seen_from(laser_before));
        }
    }
    Ok(support)
}

/// What a cluster explains.
#[derive(Clone, Copy, Debug, Default)]
struct Support {
    moments: Moments,
    /// Scans that saw it.
    scans: u32,
    /// Scans that looked through it, and did not see it.
    through: u32,
    /// The last reading that had a point of it, and its points of that.
    last: Option<(usize, f64)>,
}

impl Support {
    fn add(&mut self, reading: usize, point: Point2<f64>) {
        self.moments.add(point, 1.0);
        let before = self.last.filter(|last| last.0 == reading).map_or(0.0, |last| last.1);
        self.scans += u32::from(before + 1.0 == SEEN);
        self.last = Some((reading, before + 1.0));
    }

    /// Beams of a reading, whose points were added, that went through it.
    fn add_passing(&mut self, reading: usize, beams: u32) {
        let saw_it = self.last.is_some_and(|last| last.0 == reading && last.1 >= SEEN);
        self.through += u32::from(f64::from(beams) >= SEEN && !saw_it);
    }

    /// A wall is seen wherever scans look; where somebody walked by, or a door was open mostly, they look through.
    fn is_wall(&self) -> bool {
        self.scans >= self.through
    }
}

/// Share of the points that lie on what is no wall.
fn looked_through(support: &[Support]) -> f64 {
    let (mut gone, mut all) = (0.0, 0.0);
    for support in support {
        all += support.moments.count;
        gone += if support.is_wall() { 0.0 } else { support.moments.count };
    }
    if all > 0.0 { gone / all } else { 0.0 }
}

/// A scan in its place: its points in the world, and for each the cluster of the map that explains it best.
struct Placed {
    world_from_robot: Pose,
    points: Vec<Point2<f64>>,
    likeliest: Vec<Option<usize>>,
}

fn place_scan(map: &[Cluster], scan: &Scan, guess: Pose, config: &Smoother) -> Placed {
    let tiles = tiles(&scan.points, usize::MAX);
    let reach = scan.points.iter().map(|p| p.coords.norm()).fold(0.0, f64::max) + 1.0;
    let near: Vec<usize> = (0..map.len()).filter(|&i| map[i].may_be_within(reach, guess.position())).collect();
    let origin = guess.position().map(f64::round);
    let params = near.iter().map(|&i| ClusterParams::new(&map[i], origin, &config.likelihood, config.ablation.latent));
    let (position, heading) = (POSITION_SIGMA.powi(-2) as f32, HEADING_SIGMA.powi(-2) as f32);
    let information = [position, 0.0, 0.0, position, 0.0, heading];
    let prior = PosePrior { pose: LocalPose::new(guess, origin), information };
    let matched = match_scan(params, config.likelihood.log_outlier(), &prior, &tiles, ITERATIONS);
    let world_from_robot = matched.mode.pose.in_world(origin);
    Placed {
        world_from_robot,
        points: scan.points.iter().map(|&point| world_from_robot * point).collect(),
        likeliest: matched.likeliest.into_iter().map(|cluster| cluster.map(|cluster| near[cluster])).collect(),
    }
}

/// Gives the points of an earlier drive, which are known by the moments of its walls, to the clusters that lie on these.
fn add_earlier(support: &mut Vec<Support>, map: &[Cluster], earlier: &[Cluster], config: &MatchingConfig) {
    let matches = match_clusters(map, earlier, config, MatchingRule::Collinear);
    for (wall, matched) in earlier.iter().zip(matches) {
        let cluster = matched.unwrap_or_else(|| {
            support.push(Support::default());
            support.len() - 1
        });
        let Support { moments, scans, .. } = &mut support[cluster];
        *moments = moments.union(&wall.moments());
        // It was no clutter then.
        *scans = MANY_SCANS.max(*scans);
    }
}

/// Fits every cluster to what it explains, joins those that have come to be one wall, and in the end drops what is no wall.
fn refit(support: &[Support], config: &Smoother, is_last: bool) -> Vec<Cluster> {
    let fit = |support: &Support| {
        let cluster = support.moments.fit()?;
        Some(MapCluster { cluster, last_step: 0, sightings: support.scans })
    };
    let mut map: Vec<MapCluster> = support.iter().filter(|support| support.is_wall()).filter_map(fit).collect();
    if config.ablation.consolidate {
        map = consolidated(&map, &config.matching, &config.merging);
    }
    if is_last {
        drop_clutter(&mut map, config.smoothing.keep_explained);
    }
    map.iter().map(|entry| entry.cluster).collect()
}

/// Keeps the fewest clusters that explain this share of the points that all explain, and what many scans saw. The order stays.
fn drop_clutter(map: &mut Vec<MapCluster>, share: f64) {
    let mut by_count: Vec<usize> = (0..map.len()).collect();
    by_count.sort_by(|&a, &b| map[b].cluster.count.total_cmp(&map[a].cluster.count));
    let mut left = share * map.iter().map(|entry| entry.cluster.count).sum::<f64>();
    let mut kept = vec![false; map.len()];
    for index in by_count {
        kept[index] = left > 0.0 || map[index].sightings >= MANY_SCANS;
        left -= map[index].cluster.count;
    }
    let mut kept = kept.into_iter();
    map.retain(|_| kept.next().unwrap_or(false));
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point2, Vector2};

    #[test]
    fn clutter_is_what_explains_least() {
        let cluster = |(count, sightings): (f64, u32)| MapCluster {
            cluster: Cluster {
                mean: Point2::origin(),
                direction: Vector2::x(),
                along_variance: 1.0,
                across_variance: 1e-4,
                count,
            },
            last_step: 0,
            sightings,
        };
        let map = [(5.0, 1), (60.0, 2), (1.0, 0), (30.0, 19), (4.0, 20)].map(cluster).to_vec();
        for (share, expected) in [
            (0.9, vec![60.0, 30.0, 4.0]),
            (0.91, vec![5.0, 60.0, 30.0, 4.0]),
            (1.0, vec![5.0, 60.0, 1.0, 30.0, 4.0]),
            (0.0, vec![4.0]),
        ] {
            let mut kept = map.clone();
            drop_clutter(&mut kept, share);
            assert_eq!(kept.iter().map(|c| c.cluster.count).collect::<Vec<_>>(), expected, "{share}");
        }
        drop_clutter(&mut Vec::new(), 0.9);
    }
    /// Three points or beams of one scan are one look.
    #[test]
    fn what_more_scans_look_through_than_see_is_no_wall() {
        let mut support = Support::default();
        let mut scan = |reading: usize, points: u32, beams: u32| {
            (0..points).for_each(|number| support.add(reading, Point2::new(f64::from(number), 0.0)));
            support.add_passing(reading, beams);
            (support.scans, support.through, support.is_wall())
        };
        assert_eq!(scan(1, 3, 9), (1, 0, true));
        assert_eq!(scan(2, 0, 2), (1, 0, true));
        assert_eq!(scan(3, 0, 3), (1, 1, true));
        assert_eq!(scan(4, 2, 300), (1, 2, false));
        assert_eq!(scan(5, 40, 0), (2, 2, true));
    }
}
