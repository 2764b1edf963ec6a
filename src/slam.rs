//! The IPSLAM filter: Table I of the paper, one scan at a time.

use crate::clustering::cluster_points;
use crate::config::Config;
use crate::evaluator::cpu::LocalMap;
use crate::evaluator::layout::{ClusterParams, Tile, tiles};
use crate::filter::{Ancestry, effective_sample_size, normalised, resample};
use crate::geometry::{Pose, StampedPose};
use crate::io::{LaserReading, LogEntry};
use crate::map::merging::{MapChange, merge_scan};
use crate::map::{Map, MapCluster, Pool, Slot};
use crate::motion::Motion;
use crate::ppca::Cluster;
use crate::proposal::{Prior, Target, draw};
use crate::random::{Draw, normals, uniform};
use crate::record::{ReportedParticle, RunResult, StageTimes, StepReport};
use crate::scan::Scan;
use nalgebra::{Cholesky, Matrix3, Point2, Vector3};
use rayon::prelude::*;
use std::time::Instant;

/// A map, and the robot in it.
#[derive(Clone, Debug)]
struct Hypothesis {
    map: Map,
    world_from_robot: Pose,
    log_weight: f64,
    /// Sum of the log-weights of its whole path: the best particle is the one with the highest.
    score: f64,
    path: u32,
}

/// A pose drawn for the map of a hypothesis.
#[derive(Clone, Copy, Debug)]
struct Particle {
    hypothesis: usize,
    world_from_robot: Pose,
    log_weight: f64,
    gain: f64,
}

/// Where a reading lies: relative to the best particle's pose at a step.
#[derive(Clone, Copy, Debug)]
struct Reading {
    stamp: f64,
    odom_from_robot: Pose,
    step: u32,
    step_from_robot: Pose,
}

/// The filter.
#[derive(Debug)]
pub struct Slam {
    config: Config,
    hypotheses: Vec<Hypothesis>,
    best: usize,
    pool: Pool,
    ancestry: Ancestry,
    readings: Vec<Reading>,
    steps: u32,
    /// The motion since the last step: by odometry alone, and with the scans since.
    by_odometry: Motion,
    tracked: Motion,
    last_odometry: Pose,
    times: StageTimes,
    pub log: Vec<f64>,
}

impl Slam {
    /// A filter that has seen nothing.
    pub fn new(config: Config) -> Self {
        Self {
            config,
            hypotheses: Vec::new(),
            best: 0,
            pool: Pool::default(),
            ancestry: Ancestry::default(),
            readings: Vec::new(),
            steps: 0,
            by_odometry: Motion::none(),
            tracked: Motion::none(),
            last_odometry: Pose::IDENTITY,
            times: StageTimes::default(),
            log: Vec::new(),
        }
    }

    /// Takes in the next entry of a log; reports where it led to a step.
    pub fn add(&mut self, entry: &LogEntry, on_step: &mut dyn FnMut(&StepReport<'_>)) {
        match entry {
            LogEntry::Odometry { stamp, odom_from_robot } => {
                let since = odom_from_robot.seen_from(self.last_odometry);
                let step_from_robot = self.tracked.mean * since;
                self.remember(*stamp, *odom_from_robot, step_from_robot);
            }
            LogEntry::Laser(reading) => self.laser(reading, on_step),
            LogEntry::Truth { .. } => {}
        }
    }

    fn remember(&mut self, stamp: f64, odom_from_robot: Pose, step_from_robot: Pose) {
        let step = self.steps.saturating_sub(1);
        self.readings.push(Reading { stamp, odom_from_robot, step, step_from_robot });
    }

    fn laser(&mut self, reading: &LaserReading, on_step: &mut dyn FnMut(&StepReport<'_>)) {
        let scan = Scan::from_reading(reading, self.config.scan.min_range, self.config.scan.max_range);
        let tiles = tiles(&scan.points, self.config.likelihood.max_points);
        if self.steps == 0 {
            self.last_odometry = reading.odom_from_robot;
            self.begin();
        } else {
            let began = Instant::now();
            self.track(reading.odom_from_robot, &tiles);
            self.times.track += began.elapsed().as_secs_f64();
            let moved = self.tracked.mean;
            let filter = &self.config.filter;
            if moved.x.hypot(moved.y) < filter.step_distance && moved.heading.abs() < filter.step_turn {
                self.remember(reading.stamp, reading.odom_from_robot, moved);
                return;
            }
        }
        self.step(&scan, &tiles, reading, on_step);
        self.remember(reading.stamp, reading.odom_from_robot, Pose::IDENTITY);
    }

    /// Table I, 2: all particles start at the origin of the world.
    fn begin(&mut self) {
        let path = self.ancestry.extend(None, Pose::IDENTITY);
        let hypothesis =
            Hypothesis { map: Map::default(), world_from_robot: Pose::IDENTITY, log_weight: 0.0, score: 0.0, path };
        self.hypotheses = vec![hypothesis; self.config.maps];
    }

    /// Table I, 6: one step of the filter.
    fn step(&mut self, scan: &Scan, tiles: &[Tile], reading: &LaserReading, on_step: &mut dyn FnMut(&StepReport<'_>)) {
        let mut clock = Instant::now();
        let mut lap = |stage: &mut f64| {
            *stage += clock.elapsed().as_secs_f64();
            clock = Instant::now();
        };
        let clusters = cluster_points(&scan.points, &self.config.clustering).clusters;
        lap(&mut self.times.cluster);
        let particles = self.propose(tiles);
        lap(&mut self.times.refine);
        let weights = normalised(&particles.iter().map(|p| p.log_weight).collect::<Vec<_>>());
        let reported: Vec<_> = particles
            .iter()
            .zip(&weights)
            .map(|(p, &weight)| ReportedParticle { world_from_robot: p.world_from_robot, weight })
            .collect();
        let ess = effective_sample_size(&weights);
        let resampled = self.select(&particles, &weights);
        lap(&mut self.times.resample);
        self.merge(&clusters);
        lap(&mut self.times.merge);

        let map = self.best_map();
        on_step(&StepReport {
            step: self.steps,
            stamp: scan.stamp,
            scan,
            scan_clusters: &clusters,
            odom_from_robot: reading.odom_from_robot,
            world_from_robot: self.hypotheses[self.best].world_from_robot,
            particles: &reported,
            map: &map,
            effective_sample_size: ess,
            resampled,
            times: std::mem::take(&mut self.times),
        });
        self.steps += 1;
        self.by_odometry = Motion::none();
        self.tracked = Motion::none();
    }

    /// Follows the robot from scan to scan in the best map: odometry, corrected by matching the scan.
    fn track(&mut self, odom_from_robot: Pose, tiles: &[Tile]) {
        let increment = Motion::from_odometry(self.last_odometry, odom_from_robot, &self.config.motion);
        self.last_odometry = odom_from_robot;
        self.by_odometry = self.by_odometry.then(&increment);
        let predicted = self.tracked.then(&increment);
        self.tracked = predicted;
        let (Some(information), Some(spread)) =
            (predicted.covariance.try_inverse(), Cholesky::new(predicted.covariance))
        else {
            return;
        };
        if self.config.proposal.tracking_starts == 0 {
            return;
        }
        let best = &self.hypotheses[self.best];
        let centre = best.world_from_robot * predicted.mean;
        let origin = Point2::new(centre.x.round(), centre.y.round());
        let map = self.local_map(&best.map, origin, centre, tiles, &self.config.likelihood);
        let wide = self.local_map(&best.map, origin, centre, tiles, &self.config.likelihood.capturing());
        let coarse = Target { map: &wide, tiles, origin };
        let target = Target { map: &map, tiles, origin };
        let prior = Prior { world_from_robot: centre, information };
        let count = self.readings.len() as u32;
        let mode = (0..self.config.proposal.tracking_starts)
            .into_par_iter()
            .map(|start| {
                let noise = normals(self.config.seed, count, start, Draw::Tracking);
                let noise = if start == 0 {
                    Vector3::zeros()
                } else {
                    Vector3::new(noise[0], noise[1], noise[2]).map(f64::from)
                };
                let off = spread.l() * noise;
                let found =
                    coarse.climb(centre * Pose::new(off.x, off.y, off.z), &prior, self.config.proposal.iterations / 2);
                target.climb(found.world_from_robot, &prior, self.config.proposal.iterations)
            })
            .collect::<Vec<_>>()
            .into_iter()
            .reduce(|a, b| if b.log_posterior > a.log_posterior { b } else { a });
        if let Some(mode) = mode {
            self.tracked.mean = mode.world_from_robot.seen_from(best.world_from_robot);
            if let Some(covariance) = mode.information.try_inverse() {
                self.tracked.covariance = covariance;
            }
        }
    }

    /// Table I, 6a and 6c-vi: draws a pose for every particle and weighs it.
    fn propose(&self, tiles: &[Tile]) -> Vec<Particle> {
        let likelihood = &self.config.likelihood;
        let first = self.steps == 0;
        let spread = Cholesky::new(self.tracked.covariance).map_or_else(Matrix3::zeros, |c| c.l());
        let information = self.by_odometry.covariance.try_inverse().unwrap_or_else(Matrix3::zeros);
        let each = self.config.particles / self.config.maps;
        (0..self.hypotheses.len() * each)
            .into_par_iter()
            .map(|index| {
                let hypothesis = index / each;
                let from = &self.hypotheses[hypothesis];
                let mut particle = Particle {
                    hypothesis,
                    world_from_robot: from.world_from_robot,
                    log_weight: from.log_weight - (each as f64).ln(),
                    gain: 0.0,
                };
                if first {
                    return particle;
                }
                let random = |d| {
                    let n = normals(self.config.seed, self.steps, index as u32, d);
                    Vector3::new(n[0], n[1], n[2]).map(f64::from)
                };
                let off = spread * random(Draw::Motion);
                let start = from.world_from_robot * self.tracked.mean * Pose::new(off.x, off.y, off.z);
                let origin = Point2::new(start.x.round(), start.y.round());
                let map = self.local_map(&from.map, origin, start, tiles, likelihood);
                let wide = self.local_map(&from.map, origin, start, tiles, &likelihood.capturing());
                let coarse = Target { map: &wide, tiles, origin };
                let target = Target { map: &map, tiles, origin };
                let prior = Prior { world_from_robot: from.world_from_robot * self.by_odometry.mean, information };
                let start = coarse.climb(start, &prior, self.config.proposal.iterations / 2).world_from_robot;
                let mode = target.climb(start, &prior, self.config.proposal.iterations);
                let (pose, log_proposal) = draw(&mode, likelihood.temper, random(Draw::Proposal));
                particle.world_from_robot = pose;
                particle.gain = likelihood.temper * target.log_posterior(pose, &prior) - log_proposal;
                particle.log_weight += particle.gain;
                particle
            })
            .collect()
    }

    /// Table I, 6d: as many survivors as there are maps. Returns whether maps were resampled.
    fn select(&mut self, particles: &[Particle], weights: &[f64]) -> bool {
        let each = particles.len() / self.hypotheses.len();
        let offset = |k: usize| {
            f64::from(uniform(crate::random::bits(self.config.seed, self.steps, k as u32, Draw::Resample)[0]))
        };
        // Each map keeps one of its poses, drawn by weight, and the weight of all of them.
        let chosen: Vec<usize> = (0..self.hypotheses.len())
            .map(|h| h * each + resample(&weights[h * each..(h + 1) * each], 1, offset(h + 1))[0])
            .collect();
        let map_weights: Vec<f64> = weights.chunks(each).map(|w| w.iter().sum()).collect();
        let resampled =
            effective_sample_size(&map_weights) < self.config.filter.resample_below * map_weights.len() as f64;
        let survivors = if resampled {
            resample(&map_weights, self.config.maps, offset(0))
        } else {
            (0..self.hypotheses.len()).collect()
        };
        self.hypotheses = survivors
            .into_iter()
            .map(|h| {
                let (from, particle) = (&self.hypotheses[h], &particles[chosen[h]]);
                Hypothesis {
                    map: from.map.clone(),
                    world_from_robot: particle.world_from_robot,
                    log_weight: if resampled { 0.0 } else { map_weights[h].ln() },
                    score: from.score + particle.gain,
                    path: self.ancestry.extend(Some(from.path), particle.world_from_robot),
                }
            })
            .collect();
        self.best = (0..self.hypotheses.len())
            .max_by(|&a, &b| self.hypotheses[a].score.total_cmp(&self.hypotheses[b].score))
            .unwrap_or(0);
        let mut ends: Vec<u32> = self.hypotheses.iter().map(|h| h.path).collect();
        self.ancestry.compact(&mut ends);
        self.hypotheses.iter_mut().zip(ends).for_each(|(h, end)| h.path = end);
        resampled
    }

    /// Table I, 6c-ii to v: merges the scan's clusters into every map.
    fn merge(&mut self, clusters: &[Cluster]) {
        let reach = clusters.iter().map(|c| c.mean.coords.norm() + c.length()).fold(0.0, f64::max) + 2.0;
        let changes: Vec<MapChange> = self
            .hypotheses
            .par_iter()
            .map(|hypothesis| {
                let pose = hypothesis.world_from_robot;
                let near: Vec<(Slot, MapCluster)> = self
                    .pool
                    .clusters_of(&hypothesis.map)
                    .filter(|(_, c)| (c.cluster.mean - pose.position()).norm() < reach + 0.5 * c.cluster.length())
                    .map(|(slot, c)| (slot, *c))
                    .collect();
                let scan: Vec<Cluster> = clusters.iter().map(|c| c.transformed(pose)).collect();
                merge_scan(&near, &scan, self.steps, &self.config.matching, &self.config.merging)
            })
            .collect();
        for (hypothesis, change) in self.hypotheses.iter_mut().zip(changes) {
            let growth = change.added.len() as f64 - change.removed.len() as f64;
            hypothesis.log_weight -= self.config.merging.cluster_cost * growth;
            hypothesis.score -= self.config.merging.cluster_cost * growth;
            hypothesis.map.slots.retain(|slot| !change.removed.contains(slot));
            hypothesis.map.slots.extend(change.added.into_iter().map(|cluster| self.pool.insert(cluster)));
        }
        if self.steps % 8 == 0 {
            self.pool.keep_only(self.hypotheses.iter().map(|h| &h.map));
        }
    }

    fn local_map(
        &self,
        map: &Map,
        origin: Point2<f64>,
        robot: Pose,
        tiles: &[Tile],
        likelihood: &crate::evaluator::layout::LikelihoodConfig,
    ) -> LocalMap {
        let reach =
            tiles.iter().map(|t| f64::from(t.centre[0].hypot(t.centre[1]) + t.radius)).fold(0.0, f64::max) + 1.0;
        LocalMap::new(
            self.pool
                .clusters_of(map)
                .map(|(_, c)| &c.cluster)
                .filter(|c| (c.mean - robot.position()).norm() < reach + 0.5 * c.length())
                .map(|c| ClusterParams::new(c, origin, likelihood)),
            likelihood.log_outlier(),
        )
    }

    fn best_map(&self) -> Vec<Cluster> {
        self.hypotheses
            .get(self.best)
            .map(|h| self.pool.clusters_of(&h.map).map(|(_, c)| c.cluster).collect())
            .unwrap_or_default()
    }

    /// The best particle's whole path and map.
    pub fn finish(&self) -> RunResult {
        let path = self.hypotheses.get(self.best).map(|h| self.ancestry.path(h.path)).unwrap_or_default();
        let pose = |r: &Reading| path.get(r.step as usize + 1).map_or(r.step_from_robot, |&p| p * r.step_from_robot);
        RunResult {
            map: self.best_map(),
            trajectory: self.readings.iter().map(|r| StampedPose { stamp: r.stamp, pose: pose(r) }).collect(),
            odometry: self.readings.iter().map(|r| StampedPose { stamp: r.stamp, pose: r.odom_from_robot }).collect(),
        }
    }
}
