//! Where in the older part of the map are the walls of the last metres?

use super::{Closer, Drive, Keyframe, OneMap, is_near};
use crate::evaluator::cholesky::Cholesky;
use crate::evaluator::failover::Failover;
use crate::evaluator::pose::LocalPose;
use crate::evaluator::tiles::{Tile, reach, tiles};
use crate::evaluator::{Advance, ITERATIONS, Propagation, Scene, Start, Weighed, distinct};
use crate::geometry::{Pose, wrap_angle};
use crate::likelihood::ClusterParams;
use crate::map::seen_through::share_behind;
use crate::map::{LineMap, Slot};
use crate::ppca::Cluster;
use crate::random::Draw;
use nalgebra::Point2;
use std::collections::BTreeSet;
use std::f64::consts::TAU;

/// The walls of the last metres, in the frame of the last step.
#[derive(Debug)]
pub(super) struct Query {
    /// Points along the walls: each metre of wall counts the same, however many beams it took.
    tiles: Vec<Tile>,
    /// The same points.
    points: Vec<Point2<f64>>,
    /// Points of the scans, each after where the robot was that saw it.
    rays: Vec<[Point2<f64>; 2]>,
}

/// A place that was found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    pub world_from_robot: Pose,
    /// Share of what the older map could explain of the query at best, less the share of the scans' points that lie behind older
    /// walls.
    pub explained: f64,
}

/// The older part of the map: that of an earlier drive, and what the steps saw that have become old.
#[derive(Debug)]
pub(super) struct OlderMap {
    map: OneMap,
    /// The poses of these steps.
    pub path: Vec<Pose>,
    /// Where the robot may be in the map of an earlier drive, on the grid of starts.
    free: Vec<Point2<f64>>,
}

/// Points along walls lie this far apart \[m\].
const SPACING: f64 = 0.25;
/// Maximum number of points.
const MOST_POINTS: usize = 96;
/// Maximum number of rays that are tested against walls.
const MOST_RAYS: usize = 256;
/// A wall that fewer steps saw may be somebody who walks by.
const LEAST_SIGHTINGS: u32 = 2;
/// Starts lie on a grid with this edge \[m\], and so many headings.
const EDGE: f64 = 1.0;
const HEADINGS: u32 = 24;
/// A robot that is back is this close to where it was \[m\].
pub(super) const BACK: f64 = 2.0;
/// Standard deviation of a wall to find it from the next start \[m\]: half of what a start is off at most, for a wall 5 m away.
const CAPTURE_SIGMA: f64 = 0.5;
/// Number of the best places that are evaluated from the mode near them.
const CLOSELY: usize = 12;
/// Places this close together are one \[m, rad\].
const APART: [f64; 2] = [1.0, 0.4];
/// A path that has moved by more than this has another map \[m, rad\].
const MOVED: [f64; 2] = [0.1, 0.03];

impl Query {
    /// Of these steps; `None` where they saw no wall.
    pub fn new(keyframes: &[Keyframe], path: &[Pose], config: &Closer) -> Option<Self> {
        let robot_from_world = path.last()?.inverse();
        let mut map = OneMap::new(&[], config, CAPTURE_SIGMA);
        for (step, (keyframe, &pose)) in keyframes.iter().zip(path).enumerate() {
            map.merge(step as u32, pose, &keyframe.clusters, config);
        }
        let walls = map.clusters();
        let walls = walls.iter().filter(|wall| wall.sightings >= LEAST_SIGHTINGS);
        let points: Vec<Point2<f64>> =
            walls.flat_map(|wall| along(&wall.cluster)).map(|point| robot_from_world * point).collect();
        let ray = |(keyframe, &pose): (&Keyframe, &Pose)| {
            let robot_from_then = robot_from_world * pose;
            let seen = move |point: Point2<f64>| [robot_from_then.position(), robot_from_then * point];
            keyframe.tiles.iter().flat_map(Tile::points).map(seen).collect::<Vec<_>>()
        };
        let rays: Vec<[Point2<f64>; 2]> = keyframes.iter().zip(path).flat_map(ray).collect();
        let rays = rays.iter().copied().step_by(rays.len().div_ceil(MOST_RAYS).max(1)).collect();
        let tiles = tiles(&points, MOST_POINTS);
        (!tiles.is_empty()).then_some(Self { tiles, points, rays })
    }
}

/// Points along a wall.
fn along(wall: &Cluster) -> impl Iterator<Item = Point2<f64>> {
    let [from, to] = wall.endpoints();
    let count = (wall.length() / SPACING).ceil().max(1.0) as u32;
    (0..count).map(move |number| from + (to - from) * ((f64::from(number) + 0.5) / f64::from(count)))
}

impl Found {
    /// How far it is from there \[m\].
    pub fn distance(&self, pose: Pose) -> f64 {
        (self.world_from_robot.position() - pose.position()).norm()
    }
}

impl OlderMap {
    pub fn new(earlier: &LineMap, config: &Closer) -> Self {
        let free = earlier.free.as_ref().map_or_else(Vec::new, |free| free.points(EDGE));
        Self { map: OneMap::new(&earlier.clusters, config, CAPTURE_SIGMA), path: Vec::new(), free }
    }

    /// Takes in the steps before `older`; all of them again where the path has moved.
    pub fn follow(&mut self, drive: &Drive, path: &[Pose], older: usize, config: &Closer) {
        if self.path.iter().zip(path).any(|(was, is)| !is_near(*was, *is, MOVED)) {
            self.map = OneMap::new(&drive.earlier.clusters, config, CAPTURE_SIGMA);
            self.path.clear();
        }
        let steps = drive.keyframes.iter().zip(path).enumerate();
        for (step, (keyframe, &pose)) in steps.take(older).skip(self.path.len()) {
            self.map.merge(step as u32, pose, &keyframe.clusters, config);
            self.path.push(pose);
        }
    }

    /// The places where the walls of the query are, anywhere near the older path or free in the map of an earlier drive, those first
    /// that explain most of it.
    pub fn search(&self, query: &Query, evaluator: &mut Failover) -> Vec<Found> {
        self.best_of(&self.starts(), CLOSELY, query, evaluator)
    }

    /// Where the walls of the query are close to where the robot is thought to be.
    pub fn search_near(&self, query: &Query, robot: Pose, evaluator: &mut Failover) -> Option<Found> {
        let step = |number: i32| f64::from(number) * 0.5 * EDGE;
        let turn = |number: i32| f64::from(number) * 0.5 * TAU / f64::from(HEADINGS);
        let around = |range: i32| -range..=range;
        let starts: Vec<Pose> = around(2)
            .flat_map(|h| around(3).flat_map(move |x| around(3).map(move |y| Pose::new(step(x), step(y), turn(h)))))
            .map(|off| Pose::new(robot.x + off.x, robot.y + off.y, wrap_angle(robot.heading + off.heading)))
            .collect();
        self.best_of(&starts, 2, query, evaluator).first().copied()
    }

    /// Weighs all starts among thick walls, climbs from the best of them and evaluates what it finds.
    fn best_of(&self, starts: &[Pose], closely: usize, query: &Query, evaluator: &mut Failover) -> Vec<Found> {
        let anchor = self.map.table.anchor();
        let starts: Vec<LocalPose> = starts.iter().map(|&pose| LocalPose::new(pose, anchor)).collect();
        let how = Advance {
            seed: 0,
            step: 0,
            motion: [0.0; 3],
            noise: Cholesky([0.0; 6]),
            capture_sigma: CAPTURE_SIGMA as f32,
        };
        let maps = [self.map.map.slots.clone()];
        let scene = Scene { table: &self.map.table, tiles: &query.tiles, maps: &maps };
        let mut weighed = evaluator.advance(&scene, &how, &starts);
        weighed.sort_by(|a, b| b.log_likelihood.total_cmp(&a.log_likelihood));
        let places = weighed.into_iter().map(|Weighed { pose, .. }| pose);
        let best = distinct(places, closely, |one, other| one.is_near(*other, APART));
        let mut evaluated: Vec<Found> =
            self.climb(&best, query, evaluator).into_iter().map(|pose| self.evaluate(pose, query)).collect();
        evaluated.sort_by(|a, b| b.explained.total_cmp(&a.explained));
        let is_same = |one: &Found, other: &Found| is_near(other.world_from_robot, one.world_from_robot, APART);
        distinct(evaluated, closely, is_same)
    }

    /// All places near the older path and in the free area, in any direction; neighbours close together.
    fn starts(&self) -> Vec<Pose> {
        let cell = |number: f64| (number / EDGE).round() as i32;
        let back = (BACK / EDGE).ceil() as i32;
        // Blocks first, so that those that follow each other are close together.
        let ordered = |x: i32, y: i32| (x.div_euclid(4), y.div_euclid(4), x, y);
        let mut cells: BTreeSet<_> = self.free.iter().map(|free| ordered(cell(free.x), cell(free.y))).collect();
        for pose in &self.path {
            let (x, y) = (cell(pose.x), cell(pose.y));
            for (x, y) in (x - back..=x + back).flat_map(|x| (y - back..=y + back).map(move |y| (x, y))) {
                let middle = Point2::new(f64::from(x) * EDGE, f64::from(y) * EDGE);
                if (middle - pose.position()).norm() <= BACK {
                    cells.insert(ordered(x, y));
                }
            }
        }
        let heading = |number: u32| wrap_angle(f64::from(number) * TAU / f64::from(HEADINGS));
        let place = |&(_, _, x, y): &(i32, i32, i32, i32), number: u32| {
            Pose::new(f64::from(x) * EDGE, f64::from(y) * EDGE, heading(number))
        };
        let mut starts = Vec::new();
        for block in cells.iter().collect::<Vec<_>>().chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            starts.extend((0..HEADINGS).flat_map(|number| block.iter().map(move |cell| place(cell, number))));
        }
        starts
    }

    /// The modes of the posterior of the query, from each of these poses.
    fn climb(&self, from: &[LocalPose], query: &Query, evaluator: &mut Failover) -> Vec<Pose> {
        let OneMap { map, table, .. } = &self.map;
        let starts: Vec<Start> = from.iter().map(|&pose| Start { mean: pose, prior: pose }).collect();
        let (position, heading) = (EDGE.powi(-2) as f32, (TAU / f64::from(HEADINGS)).powi(-2) as f32);
        let how = Propagation {
            seed: 0,
            step: 0,
            draw: Draw::Tracking,
            starts: &starts,
            particles_per_map: 1,
            exact_first: true,
            is_heavy_tailed: false,
            noise: Cholesky([0.0; 6]),
            prior_information: [position, 0.0, 0.0, position, 0.0, heading],
            iterations: 2 * ITERATIONS,
            capture_sigma: CAPTURE_SIGMA as f32,
            spread: 0.0,
        };
        let reach = reach(&query.tiles) + how.longest_way();
        let near = |start: &Start| table.near(&map.slots, start.mean.x, start.mean.y, reach);
        let maps: Vec<Vec<Slot>> = starts.iter().map(near).collect();
        let proposals = evaluator.propagate(&Scene { table, tiles: &query.tiles, maps: &maps }, &how);
        proposals.into_iter().map(|proposal| proposal.mode.pose.in_world(table.anchor())).collect()
    }

    /// How well the query fits at a place.
    pub fn evaluate(&self, world_from_robot: Pose, query: &Query) -> Found {
        let OneMap { pool, table, .. } = &self.map;
        let near = self.map.near(world_from_robot, reach(&query.tiles));
        let rows: Vec<ClusterParams> = near.iter().map(|&slot| table.rows()[slot as usize]).collect();
        let log_outlier = table.log_outlier();
        let peak = rows.iter().map(|row| row.log_peak).fold(log_outlier, f32::max);
        let gain = |point: &Point2<f64>| {
            let point = world_from_robot * *point;
            let LocalPose { x, y, .. } = LocalPose::new(Pose::new(point.x, point.y, 0.0), table.anchor());
            f64::from(rows.iter().map(|row| row.log_density(x, y)).fold(log_outlier, f32::max) - log_outlier)
        };
        let most = query.points.len() as f64 * f64::from(peak - log_outlier);
        let share = if most > 0.0 { query.points.iter().map(gain).sum::<f64>() / most } else { 0.0 };
        let rays: Vec<[Point2<f64>; 2]> =
            query.rays.iter().map(|ray| ray.map(|point| world_from_robot * point)).collect();
        let explained = share - share_behind(&rays, near.iter().map(|&slot| &pool.get(slot).cluster));
        Found { world_from_robot, explained }
    }
}
