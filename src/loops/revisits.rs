//! Ties between the visits to a place: the scan of a step, matched to the walls that an earlier visit saw there.

use super::bend::{MOTION, Tie, pose_of};
use super::{Closer, Drive, Keyframe, match_closely};
use crate::evaluator::cholesky::{packed, unpacked};
use crate::evaluator::cpu::Matched;
use crate::evaluator::pose::LocalPose;
use crate::evaluator::tiles::{Tile, reach};
use crate::evaluator::{MODE_TEMPER, PosePrior};
use crate::geometry::Pose;
use crate::likelihood::ClusterParams;
use crate::map::seen_through::share_behind;
use crate::ppca::Cluster;
use nalgebra::{Matrix3, Point2, Vector3};
use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::Range;

/// A step is tied to at most this many earlier visits, the nearest ones.
pub(super) const VISITS: usize = 3;
/// A visit came this close \[m\].
const NEAR: f64 = 2.0;
/// The walls of a visit are those seen within this much way of its nearest step \[m\]: on both sides of the robot, whichever
/// way it looked.
pub(super) const AROUND: f64 = 4.0;
/// How far off two visits may be \[m, rad\]: what a pose graph leaves open.
const OFF: [f64; 2] = [0.3, 0.1];
/// How far off they may be in a direction that a scan does not see \[m, rad\]: as far as a loop close by.
const UNKNOWN: [f64; 2] = [10.0, 1.0];
/// How far off a wall is still found \[m\]: as far as that.
const CAPTURE_SIGMA: f64 = 0.3;
/// Gauss-Newton steps, with thick walls and with walls as they are.
const ITERATIONS: u32 = 6;
/// Share of the points that the walls have to explain, less the share that lies behind them.
const LEAST_EXPLAINED: f64 = 0.5;
/// Motions from step to step by which the walls of a visit may err: as many as `AROUND` has, about.
const MOTIONS: f64 = 10.0;

/// Ties of these steps to earlier visits, and to the map of an earlier drive. Those known that the path holds, sorted by their newer
/// step, are taken over.
pub(super) fn revisits(drive: &Drive, path: &[Pose], steps: Range<usize>, known: &[Tie], config: &Closer) -> Vec<Tie> {
    let places = Places::of(path);
    let of_step = |step: usize| -> Vec<Tie> {
        let known = &known[known.partition_point(|tie| tie.newer < step)..];
        let known = &known[..known.partition_point(|tie| tie.newer == step)];
        let of_visit = |older: Option<usize>| {
            let is_same = |tie: &&Tie| {
                let is_one_visit = match (tie.older, older) {
                    (Some(one), Some(other)) => (drive.travelled[one] - drive.travelled[other]).abs() < 0.5 * AROUND,
                    (one, other) => one == other,
                };
                is_one_visit && tie.holds(path)
            };
            known.iter().find(is_same).copied().or_else(|| tie(drive, path, older, step, config))
        };
        let earlier = (!drive.earlier.clusters.is_empty()).then_some(None);
        let visits = places.nearest(drive, step, config.loops.window).into_iter().map(Some);
        visits.chain(earlier).filter_map(of_visit).collect()
    };
    steps.into_par_iter().flat_map_iter(of_step).collect()
}

/// How well the visits to all places agree on a path: the pairs of visits that a tie holds together, less the share of its rays with
/// which the later of each pair looks through walls that the earlier one saw.
pub(super) fn agreement(drive: &Drive, path: &[Pose], ties: &[Tie], config: &Closer) -> f64 {
    let places = Places::of(path);
    let looked_through = |step: usize| -> f64 {
        let tiles = &drive.keyframes[step].tiles;
        let by_visit = |older: usize| {
            let older_from_robot = path[step].seen_from(path[older]);
            let walls = walls_around(drive, path, older, older_from_robot, f64::from(reach(tiles)), config);
            share_behind(&rays(older_from_robot, tiles), walls.iter())
        };
        places.nearest(drive, step, config.loops.window).into_iter().map(by_visit).sum()
    };
    let held = ties.iter().filter(|tie| tie.holds(path)).count();
    // In the order of the steps: a sum of floats depends on it.
    let looked_through: Vec<f64> = (0..path.len()).into_par_iter().map(looked_through).collect();
    held as f64 - looked_through.iter().sum::<f64>()
}

/// The beams of a scan, each from the robot to a point.
fn rays(frame_from_robot: Pose, tiles: &[Tile]) -> Vec<[Point2<f64>; 2]> {
    let ray = |point: Point2<f64>| [frame_from_robot.position(), frame_from_robot * point];
    tiles.iter().flat_map(Tile::points).map(ray).collect()
}

/// The steps of a path by where they are, in cells as wide as visits are apart at most.
pub(super) struct Places<'a> {
    path: &'a [Pose],
    steps: HashMap<[i64; 2], Vec<usize>>,
}

impl<'a> Places<'a> {
    pub fn of(path: &'a [Pose]) -> Self {
        let mut steps = HashMap::<[i64; 2], Vec<usize>>::new();
        path.iter().enumerate().for_each(|(step, pose)| steps.entry(cell(pose)).or_default().push(step));
        Self { path, steps }
    }

    /// The nearest step of each visit at least `apart` \[m\] of way before a step.
    pub fn nearest(&self, drive: &Drive, step: usize, apart: f64) -> Vec<usize> {
        let (path, way) = (self.path, &drive.travelled);
        let before = way[..step].partition_point(|&there| there < way[step] - apart);
        let distance = |older: usize| (path[older].position() - path[step].position()).norm();
        let [x, y] = cell(&path[step]);
        let cells = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| [x.saturating_add(dx), y.saturating_add(dy)]));
        let around = cells.filter_map(|cell| self.steps.get(&cell)).flatten().copied();
        let mut near: Vec<usize> = around.filter(|&older| older < before && distance(older) <= NEAR).collect();
        near.sort_unstable();
        let nearer = |a: &usize, b: &usize| distance(*a).total_cmp(&distance(*b));
        let visits = near.chunk_by(|&one, &next| way[next] - way[one] <= AROUND);
        let mut visits: Vec<usize> = visits.filter_map(|visit| visit.iter().copied().min_by(nearer)).collect();
        visits.sort_by(nearer);
        visits.truncate(VISITS);
        visits
    }
}

fn cell(pose: &Pose) -> [i64; 2] {
    [pose.x, pose.y].map(|coordinate| (coordinate / NEAR).floor() as i64)
}

/// Matches the scan of a step to what was seen around an older one, or to the map of an earlier drive.
pub(super) fn tie(drive: &Drive, path: &[Pose], older: Option<usize>, newer: usize, config: &Closer) -> Option<Tie> {
    let tiles = &drive.keyframes[newer].tiles;
    let expected = path[newer].seen_from(pose_of(older, path));
    let reach = f64::from(reach(tiles)) + OFF[0];
    let walls = match older {
        Some(older) => walls_around(drive, path, older, expected, reach, config),
        None => {
            let is_near = |wall: &&Cluster| wall.may_be_within(reach, expected.position());
            drive.earlier.clusters.iter().filter(is_near).copied().collect()
        }
    };

    // Numbers of 32 bits are relative to a place near the robot.
    let origin = if older.is_some() { Point2::origin() } else { expected.position().map(f64::round) };
    let log_outlier = config.likelihood.log_outlier();
    let row = |wall| ClusterParams::new(wall, origin, &config.likelihood, config.ablation.latent);
    let rows: Vec<ClusterParams> = walls.iter().map(row).collect();
    let information_of = |sigmas: [f64; 2]| {
        let [position, heading] = sigmas.map(|sigma| sigma.powi(-2));
        Matrix3::from_diagonal(&Vector3::new(position, position, heading))
    };
    let prior = information_of(OFF);
    let expected = PosePrior { pose: LocalPose::new(expected, origin), information: packed(&prior) };
    let Matched { mode, likeliest } = match_closely(&rows, log_outlier, expected, tiles, CAPTURE_SIGMA, ITERATIONS);

    let older_from_newer = mode.pose.in_world(origin);
    let explained = likeliest.iter().flatten().count() as f64 / likeliest.len().max(1) as f64;
    let looked_through = || share_behind(&rays(older_from_newer, tiles), walls.iter());
    if explained < LEAST_EXPLAINED || explained - looked_through() < LEAST_EXPLAINED {
        return None;
    }
    // Where the scan says nothing, as along a corridor, the path as it was is no measurement.
    let information = (unpacked(mode.information) - prior) * MODE_TEMPER + information_of(UNKNOWN);
    let around = Vector3::from(MOTION).map(|sigma| MOTIONS * sigma * sigma);
    let covariance = information.try_inverse()? + Matrix3::from_diagonal(&around);
    Some(Tie { older, newer, older_from_newer, covariance })
}

/// The walls that a visit saw within `reach` \[m\] of a pose, both in the frame of its step `older`.
fn walls_around(drive: &Drive, path: &[Pose], older: usize, pose: Pose, reach: f64, config: &Closer) -> Vec<Cluster> {
    let way = &drive.travelled;
    let first = way.partition_point(|&there| there < way[older] - AROUND);
    let last = way.partition_point(|&there| there <= way[older] + AROUND);
    let is_wall = |wall: &Cluster| {
        wall.count >= config.merging.min_points
            && wall.across_variance <= config.merging.max_across.powi(2)
            && wall.may_be_within(reach, pose.position())
    };
    let seen = |(keyframe, then): (&Keyframe, &Pose)| {
        let older_from_then = then.seen_from(path[older]);
        keyframe.clusters.iter().map(|wall| wall.transformed(older_from_then)).filter(is_wall).collect::<Vec<_>>()
    };
    drive.keyframes[first..last].iter().zip(&path[first..last]).flat_map(seen).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clustering::cluster_scan;
    use crate::config::SlamConfig;
    use crate::evaluator::tiles::tiles;
    use crate::log::{LogEntry, LogSource};
    use crate::loops::is_near;
    use crate::motion::Motion;
    use crate::scan::Scan;
    use crate::simulate::Simulation;

    const SEED: u64 = 1;

    fn added(drive: &mut Drive, scan: &[Point2<f64>], clusters: Vec<Cluster>, moved: Pose) {
        let motion = Motion { mean: moved, covariance: Matrix3::identity() * 1e-6 };
        let tiles = tiles(scan, SlamConfig::default().likelihood.max_points);
        drive.add(Keyframe { stamp: 0.0, tiles, clusters, by_odometry: motion, tracked: motion });
    }

    /// The drive through the simulated building, and the true path.
    fn building() -> (Drive, Vec<Pose>) {
        let config = SlamConfig::default();
        let simulation = Simulation::building(SEED);
        let truth: HashMap<u64, Pose> = simulation.truth().map(|truth| (truth.stamp.to_bits(), truth.pose)).collect();
        let (mut drive, mut path) = (Drive::default(), Vec::<Pose>::new());
        for entry in simulation.open().unwrap() {
            let LogEntry::Laser(reading) = entry.unwrap() else { continue };
            let pose = truth[&reading.stamp.to_bits()];
            let moved = path.last().map_or(Pose::IDENTITY, |&last| pose.seen_from(last));
            if path.is_empty() || !config.tracking.is_too_near(moved) {
                let scan = Scan::from_reading(&reading, &config.scan);
                added(&mut drive, &scan.points, cluster_scan(&scan, &config.clustering).clusters, moved);
                path.push(pose);
            }
        }
        (drive, path)
    }

    /// Errors of ties (forward, sideways, heading) against the true path.
    fn off(tie: &Tie, truth: &[Pose]) -> Vector3<f64> {
        let Pose { x, y, heading } =
            tie.older_from_newer.seen_from(truth[tie.newer].seen_from(pose_of(tie.older, truth)));
        Vector3::new(x, y, heading)
    }

    /// Ties of every fifth step of the second half to the first half and to an earlier drive, where the path has the second half as
    /// `moved` says, and how many steps were asked.
    fn halves(drive: &Drive, truth: &[Pose], moved: impl Fn(Pose) -> Pose) -> (Vec<Tie>, usize) {
        let half = truth.len() / 2;
        let path: Vec<Pose> =
            truth.iter().enumerate().map(|(step, &pose)| if step < half { pose } else { moved(pose) }).collect();
        let config = SlamConfig::default().closer();
        let steps = || (half..truth.len()).step_by(5);
        let of_step = |step: usize| revisits(drive, &path, step..step + 1, &[], &config);
        let is_asked = |tie: &Tie| tie.older.is_none_or(|older| older < half);
        (steps().flat_map(of_step).filter(is_asked).collect(), steps().count())
    }

    /// The path has what comes later 20 cm and 3 degrees off: the ties have it where it is, within what they say of themselves.
    fn assert_right(drive: &Drive, truth: &[Pose], of_earlier: bool, enough: usize) {
        let (mut ties, steps) = halves(drive, truth, |pose| pose * Pose::new(0.12, -0.16, 0.05));
        ties.retain(|tie| tie.older.is_none() == of_earlier);
        let right = ties.iter().filter(|tie| {
            let off = off(tie, truth);
            off.xy().norm() < 0.05 && off.z.abs() < 0.01
        });
        // 99 % of the χ² distribution of three degrees of freedom.
        let within = ties.iter().filter(|tie| {
            let off = off(tie, truth);
            tie.covariance.try_inverse().is_some_and(|information| off.dot(&(information * off)) < 11.345)
        });
        let (right, within) = (right.count(), within.count());
        println!("seed {SEED}: {steps} steps, {} ties, {right} right, {within} within their covariance", ties.len());
        // Along a corridor a tie knows little, and one of ten may be wrong.
        let least = |count: usize, share: f64| count as f64 >= share * ties.len() as f64;
        assert!(ties.len() > enough && least(right, 0.65) && least(within, 0.8), "seed {SEED}: {ties:?}");
    }

    #[test]
    fn visits_are_tied_as_they_truly_were() {
        let (drive, truth) = building();
        assert_right(&drive, &truth, false, 50);
    }

    /// The map of the earlier drive: what the first half saw, in the world.
    #[test]
    fn scans_are_tied_to_the_map_of_an_earlier_drive() {
        let (mut drive, truth) = building();
        for (keyframe, &pose) in drive.keyframes.iter().zip(&truth).take(truth.len() / 2) {
            let walls = keyframe.clusters.iter().filter(|wall| wall.count >= 20.0);
            drive.earlier.clusters.extend(walls.map(|wall| wall.transformed(pose)));
        }
        assert_right(&drive, &truth, true, 20);
    }

    /// The second half of the drive goes over the first again. Where it is laid a room beside it, or turned about, most visits to a
    /// place show different walls.
    #[test]
    fn visits_agree_on_the_true_path_and_on_no_other() {
        let (drive, truth) = building();
        let config = SlamConfig::default().closer();
        let agreement_of = |moved: Pose| {
            let half = truth.len() / 2;
            let path: Vec<Pose> =
                (0..).zip(&truth).map(|(step, &pose)| if step < half { pose } else { moved * pose }).collect();
            agreement(&drive, &path, &revisits(&drive, &path, 0..path.len(), &[], &config), &config)
        };
        let centre =
            truth.iter().fold(Pose::IDENTITY, |sum, pose| Pose { x: sum.x + pose.x, y: sum.y + pose.y, ..sum });
        let count = truth.len() as f64;
        let centre = Pose { x: centre.x / count, y: centre.y / count, heading: 0.0 };
        let about = centre * Pose::new(0.0, 0.0, std::f64::consts::PI) * centre.inverse();
        let apart = [Pose::IDENTITY, Pose::new(4.0, 0.0, 0.0), about].map(agreement_of);
        println!("seed {SEED}: true, a room beside it, turned about: {apart:?}");
        assert!(apart[0] > 2.0 * apart[1].max(apart[2]), "seed {SEED}: {apart:?}");
    }

    /// A hall of 12 by 4 m, driven along; then its walls seen again, from a metre off the path. A wall between the two in the
    /// way of all rays, and it is not the hall.
    #[test]
    fn nothing_is_tied_through_a_wall() {
        let config = SlamConfig::default().closer();
        let hall = [[0.0, 0.0], [12.0, 0.0], [12.0, 4.0], [0.0, 4.0]];
        let wall = |a: [f64; 2], b: [f64; 2]| Cluster::wall(a, b, 0.01, 100.0);
        let walls: Vec<Cluster> = (0..4).map(|side| wall(hall[side], hall[(side + 1) % 4])).collect();
        let robot = Pose::new(7.0, 2.0, 0.0);
        // Of the walls beyond x = 5.5.
        let seen: Vec<Point2<f64>> = (0..90)
            .flat_map(|number| {
                let x = 1.0 + 0.05 * f64::from(number);
                [Point2::new(x, 0.0), Point2::new(x, 4.0), Point2::new(0.0, 0.04 * f64::from(number) + 0.2)]
            })
            .map(|point| robot.inverse() * point)
            .collect();
        for (partition, is_tied) in [(None, true), (Some(wall([6.0, 0.5], [6.0, 3.5])), false)] {
            let (mut drive, mut path) = (Drive::default(), Vec::new());
            for step in 0..20 {
                let pose = Pose::new(5.0 + 0.05 * f64::from(step), 2.0, 0.0);
                let seen = walls.iter().chain(&partition).map(|wall| wall.transformed(pose.inverse())).collect();
                added(&mut drive, &[], seen, if step == 0 { Pose::IDENTITY } else { Pose::new(0.05, 0.0, 0.0) });
                path.push(pose);
            }
            added(&mut drive, &seen, Vec::new(), Pose::new(50.0, 0.0, 0.0));
            path.push(robot * Pose::new(0.05, 0.1, 0.02));
            let ties = revisits(&drive, &path, 20..21, &[], &config);
            assert_eq!(!ties.is_empty(), is_tied, "{partition:?}: {ties:?}");
            for tie in ties {
                let truth = robot.seen_from(pose_of(tie.older, &path));
                assert!(is_near(tie.older_from_newer, truth, [0.02, 0.005]), "{tie:?}");
            }
        }
    }
}
