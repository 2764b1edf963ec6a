//! After the filter: every scan is matched to the finished map, and the map is fitted to all scans.
//!
//! The filter decides which walls are the same and so closes the loops; but it saw each place with a map half built,
//! and takes a step only every now and then. Smoothing holds its decisions and alternates, as EM with hard assignments:
//!
//! 1. every scan's pose climbs the log of eq. 18 in the current map, from where it is;
//! 2. every cluster becomes the PPCA fit (eq. 11-13) of all points that it explains best, of all scans.
//!
//! Scans are read again from the log in each pass, so memory does not grow with their points.

use crate::config::Config;
use crate::evaluator::cpu::LocalMap;
use crate::evaluator::layout::{ClusterParams, LocalPose, Tile, tiles};
use crate::geometry::Pose;
use crate::io::{LogEntry, LogError, LogSource};
use crate::map::merging::consolidated;
use crate::ppca::{Cluster, Moments};
use crate::proposal::{Prior, Target};
use crate::record::RunResult;
use crate::scan::Scan;
use nalgebra::{Matrix3, Point2, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How a finished run is smoothed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SmoothingConfig {
    /// Passes over the log; 0 leaves the filter's result as it is, as in the paper.
    pub passes: usize,
    /// How far a pass is expected to move a scan, forward and sideways [m].
    pub position: f64,
    /// ... and in heading [rad].
    pub heading: f64,
    /// A cluster stays in the map only if it explains this share of all measured points best ...
    pub min_share: f64,
    /// ... and was seen by this many scans.
    pub min_scans: u32,
}

impl Default for SmoothingConfig {
    fn default() -> Self {
        Self { passes: 4, position: 0.03, heading: 0.01, min_share: 3e-4, min_scans: 5 }
    }
}

/// Scans matched at a time; they share nothing but the map.
const BATCH: usize = 256;
/// Gauss-Newton steps a scan and pass.
const ITERATIONS: usize = 5;

/// Smooths a run of this log in place. Frames stay: the world's origin is still the first pose of the filter.
pub fn smooth(source: &dyn LogSource, result: &mut RunResult, config: &Config) -> Result<(), LogError> {
    for pass in 1..=config.smoothing.passes {
        let support = match_scans(source, result, config)?;
        refit(&mut result.map, &support, config, pass == config.smoothing.passes);
    }
    Ok(())
}

/// What a cluster explains best: points, and the number of scans that they are from.
#[derive(Clone, Copy, Debug, Default)]
struct Support {
    moments: Moments,
    scans: u32,
}

/// Moves every scan to where the map wants it, and gathers what each cluster then explains.
fn match_scans(source: &dyn LogSource, result: &mut RunResult, config: &Config) -> Result<Vec<Support>, LogError> {
    let before: Vec<Pose> = result.trajectory.iter().map(|stamped| stamped.pose).collect();
    let mut support = vec![Support::default(); result.map.len()];
    let mut is_laser = vec![false; before.len()];
    let mut batch: Vec<(usize, Scan)> = Vec::with_capacity(BATCH);
    let mut place = |batch: &mut Vec<(usize, Scan)>, result: &mut RunResult| {
        let map = &result.map;
        let placed: Vec<Placed> =
            batch.par_iter().map(|(index, scan)| place_scan(map, scan, before[*index], config)).collect();
        for ((index, _), placed) in batch.drain(..).zip(placed) {
            result.trajectory[index].pose = placed.world_from_robot;
            is_laser[index] = true;
            placed.add_to(&mut support);
        }
    };
    let entries = source.open()?.filter(|entry| !matches!(entry, Ok(LogEntry::Truth { .. })));
    for (index, entry) in entries.take(before.len()).enumerate() {
        if let LogEntry::Laser(reading) = entry? {
            batch.push((index, Scan::from_reading(&reading, config.scan.min_range, config.scan.max_range)));
        }
        if batch.len() == BATCH {
            place(&mut batch, result);
        }
    }
    place(&mut batch, result);

    // Readings without a scan keep their place relative to the last scan.
    let mut last_laser = None;
    for index in 0..before.len() {
        if is_laser[index] {
            last_laser = Some(index);
        } else if let Some(laser) = last_laser {
            result.trajectory[index].pose = result.trajectory[laser].pose * before[index].seen_from(before[laser]);
        }
    }
    Ok(support)
}

/// A scan in its place: which point of the world belongs to which cluster of the map.
struct Placed {
    world_from_robot: Pose,
    explained: Vec<(usize, Point2<f64>)>,
}

impl Placed {
    fn add_to(&self, support: &mut [Support]) {
        let mut seen: Vec<usize> = self.explained.iter().map(|&(cluster, _)| cluster).collect();
        seen.sort_unstable();
        seen.dedup();
        seen.into_iter().for_each(|cluster| support[cluster].scans += 1);
        for &(cluster, point) in &self.explained {
            support[cluster].moments.add(point, 1.0);
        }
    }
}

fn place_scan(map: &[Cluster], scan: &Scan, guess: Pose, config: &Config) -> Placed {
    let tiles = tiles(&scan.points, usize::MAX);
    let reach = scan.points.iter().map(|p| p.coords.norm()).fold(0.0, f64::max) + 1.0;
    let near: Vec<usize> =
        (0..map.len()).filter(|&i| (map[i].mean - guess.position()).norm() < reach + 0.5 * map[i].length()).collect();
    let origin = Point2::new(guess.x.round(), guess.y.round());
    let likelihood = &config.likelihood;
    let local =
        LocalMap::new(near.iter().map(|&i| ClusterParams::new(&map[i], origin, likelihood)), likelihood.log_outlier());
    let (position, heading) = (config.smoothing.position.powi(-2), config.smoothing.heading.powi(-2));
    let prior = Prior {
        world_from_robot: guess,
        information: Matrix3::from_diagonal(&Vector3::new(position, position, heading)),
    };
    let target = Target { map: &local, tiles: &tiles, origin };
    let world_from_robot = target.climb(guess, &prior, ITERATIONS).world_from_robot;
    let explained = local
        .explain(LocalPose::new(world_from_robot, origin), &tiles)
        .into_iter()
        .zip(&scan.points)
        .filter_map(|(cluster, &point)| Some((near[cluster?], world_from_robot * point)))
        .collect();
    Placed { world_from_robot, explained }
}

/// Fits every cluster to what it explains, joins those that have come to be one wall, and in the end drops clutter.
fn refit(map: &mut Vec<Cluster>, support: &[Support], config: &Config, last: bool) {
    let measured: f64 = support.iter().map(|s| s.moments.count).sum();
    let needed = if last { config.smoothing.min_share * measured } else { 0.0 };
    let fitted: Vec<Cluster> = support
        .iter()
        .filter(|s| s.moments.count >= needed && (!last || s.scans >= config.smoothing.min_scans))
        .filter_map(|s| s.moments.fit())
        .collect();
    *map = consolidated(&fitted, &config.matching, &config.merging);
}
