//! Ties between the visits to a place: the scan of a step, matched to the walls that an earlier visit saw there.

use super::bend::{MOTION, Tie};
use super::{Closer, Drive, Keyframe, share_behind};
use crate::evaluator::PosePrior;
use crate::evaluator::cholesky::{packed, unpacked};
use crate::evaluator::cpu::{Matched, match_scan};
use crate::evaluator::pose::LocalPose;
use crate::evaluator::tiles::{Tile, reach};
use crate::geometry::Pose;
use crate::likelihood::ClusterParams;
use crate::ppca::Cluster;
use nalgebra::{Matrix3, Point2, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// A step is tied to at most this many earlier visits, the nearest ones.
const VISITS: usize = 3;
/// A visit came this close \[m\].
const NEAR: f64 = 2.0;
/// The walls of a visit are those seen within this much way of its nearest step \[m\]: on both sides of the robot, whichever
/// way it looked.
const AROUND: f64 = 4.0;
/// How far off two visits may be \[m, rad\]: what a pose graph leaves open.
const OFF: [f64; 2] = [0.3, 0.1];
/// How far off a wall is still found \[m\]: as far as that.
const CAPTURE_SIGMA: f64 = 0.3;
/// Gauss-Newton steps, with thick walls and with walls as they are.
const ITERATIONS: u32 = 6;
/// Share of the points that the walls have to explain, less the share that lies behind them.
const LEAST_EXPLAINED: f64 = 0.5;
/// Log-likelihoods are worth this, as in the filter: points do not err independently.
const TEMPER: f64 = 0.025;
/// Motions from step to step by which the walls of a visit may err: as many as `AROUND` has, about.
const MOTIONS: f64 = 10.0;

/// Ties of these steps to earlier visits. Those known that the path holds, sorted by their newer step, are taken over.
pub(super) fn revisits(drive: &Drive, path: &[Pose], steps: Range<usize>, known: &[Tie], config: &Closer) -> Vec<Tie> {
    let of_step = |step: usize| -> Vec<Tie> {
        let known = &known[known.partition_point(|tie| tie.newer < step)..];
        let known = &known[..known.partition_point(|tie| tie.newer == step)];
        let of_visit = |older: usize| {
            let is_same = |tie: &&Tie| {
                (drive.travelled[tie.older] - drive.travelled[older]).abs() < 0.5 * AROUND && tie.holds(path)
            };
            known.iter().find(is_same).copied().or_else(|| tie(drive, path, older, step, config))
        };
        nearest(drive, path, step, config.loops.window).into_iter().filter_map(of_visit).collect()
    };
    steps.into_par_iter().flat_map_iter(of_step).collect()
}

/// The nearest step of each visit at least `apart` \[m\] of way before a step.
fn nearest(drive: &Drive, path: &[Pose], step: usize, apart: f64) -> Vec<usize> {
    let way = &drive.travelled;
    let before = way[..step].partition_point(|&there| there < way[step] - apart);
    let distance = |older: usize| (path[older].position() - path[step].position()).norm();
    let near: Vec<usize> = (0..before).filter(|&older| distance(older) <= NEAR).collect();
    let nearer = |a: &usize, b: &usize| distance(*a).total_cmp(&distance(*b));
    let visits = near.chunk_by(|&one, &next| way[next] - way[one] <= AROUND);
    let mut visits: Vec<usize> = visits.filter_map(|visit| visit.iter().copied().min_by(nearer)).collect();
    visits.sort_by(nearer);
    visits.truncate(VISITS);
    visits
}

/// Matches the scan of a step to what was seen around an older one.
fn tie(drive: &Drive, path: &[Pose], older: usize, newer: usize, config: &Closer) -> Option<Tie> {
    let tiles = &drive.keyframes[newer].tiles;
    let expected = path[newer].seen_from(path[older]);
    let walls = walls_around(drive, path, older, expected, f64::from(reach(tiles)) + OFF[0], config);

    let (origin, log_outlier) = (Point2::origin(), config.likelihood.log_outlier());
    let rows = || walls.iter().map(|wall| ClusterParams::new(wall, origin, &config.likelihood, config.ablation.latent));
    let [position, heading] = OFF.map(|sigma| sigma.powi(-2));
    let prior = Matrix3::from_diagonal(&Vector3::new(position, position, heading));
    let from = |pose: LocalPose| PosePrior { pose, information: packed(&prior) };
    let thick = rows().map(|row| row.thickened(CAPTURE_SIGMA as f32));
    let captured = match_scan(thick, log_outlier, &from(LocalPose::new(expected, origin)), tiles, ITERATIONS);
    let Matched { mode, likeliest } = match_scan(rows(), log_outlier, &from(captured.mode.pose), tiles, ITERATIONS);

    let older_from_newer = mode.pose.in_world(origin);
    let explained = likeliest.iter().flatten().count() as f64 / likeliest.len().max(1) as f64;
    let ray = |point: Point2<f64>| [older_from_newer.position(), older_from_newer * point];
    let rays: Vec<[Point2<f64>; 2]> = tiles.iter().flat_map(Tile::points).map(ray).collect();
    if explained < LEAST_EXPLAINED || explained - share_behind(&rays, walls.iter()) < LEAST_EXPLAINED {
        return None;
    }
    let information = (unpacked(mode.information) - prior) * TEMPER + prior;
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
