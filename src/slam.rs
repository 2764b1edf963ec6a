//! The IPSLAM filter: Table I of the paper, one scan at a time.
//!
//! `Slam::step` is the table, in its order. Two things are done once for all particles and not once for each, and
//! give the same: the scan is clustered in the robot's frame, because PPCA is equivariant under rigid motion; and
//! particles of one ancestor share its clusters until they differ.
//!
//! Maps and poses are counted apart: a map hypothesis may have several pose particles, which are propagated and
//! weighed, and of which one survives to have the scan merged into its map. `particles == maps` is the paper's filter.
//!
//! World's frame: the robot's pose at the first scan is the origin.

use crate::clustering::{Clustering, cluster_scan};
use crate::evaluator::cholesky::{Cholesky, packed, unpacked};
use crate::evaluator::failover::Failover;
use crate::evaluator::pose::LocalPose;
use crate::evaluator::sighting::Sighting;
use crate::evaluator::table::ClusterTable;
use crate::evaluator::tiles::{Tile, reach, tiles};
use crate::evaluator::{APART, Evaluator, Propagation, Proposal, Scene, Start};
use crate::filter::ancestry::Ancestry;
use crate::filter::resampling::resample;
use crate::filter::weights::{effective_sample_size, normalised};
use crate::geometry::Pose;
use crate::gpu::DeviceError;
use crate::log::{LaserReading, LogEntry};
use crate::loops::{Closed, Keyframe, Loops};
use crate::map::merging::{MapChange, merge_scan, new_points};
use crate::map::{LineMap, Map, MapCluster, Pool, Slot};
use crate::motion::Motion;
use crate::objects::{Detections, Landmark, ObjectMap, Objects, Observation};
use crate::ppca::Cluster;
use crate::random::{Draw, bits, uniform};
use crate::report::{Estimate, Estimator, Event, Loop, ReportedParticle, RunResult, StageTimes, StepReport, timed};
use crate::scan::Scan;
use crate::tracking::Tracker;
use crate::tracking::starts::UsualFit;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use std::sync::Arc;

pub use config::{FilterConfig, SlamConfig};

mod config;
mod tracking;

/// A map, and the robot in it.
#[derive(Clone, Debug)]
struct Hypothesis {
    map: Map,
    /// Shared with hypotheses of the same ancestor until they differ.
    landmarks: Arc<Vec<Landmark>>,
    world_from_robot: Pose,
    log_weight: f64,
    /// Sum of the log-weights of its whole path: the best particle is the one with the highest.
    score: f64,
    path: u32,
}

/// A pose drawn for the map of a hypothesis, and its weight.
#[derive(Clone, Copy, Debug)]
struct Particle {
    world_from_robot: Pose,
    /// The mode of the posterior that it was drawn around. The particle is weighed there: the distance of the draw from the
    /// mode says nothing about its map. Without scan matching, the pose itself.
    mode: Pose,
    /// ln of eq. 18 at the mode, plus that of the set of detections; `None` without scan matching.
    log_likelihood: Option<f64>,
    /// Inverse covariance of the Laplace approximation at the mode, packed; zeros without scan matching.
    information: [f32; 6],
    /// Log of the prior by odometry of a mode that is another one than that of the track; else 0.
    log_prior: f64,
    log_weight: f64,
    /// Tempered log-likelihood of the scan, and the log-prior, which were added to the log-weight.
    gain: f64,
}

/// A reading, placed relative to the pose of a step; step 0 is the start.
#[derive(Clone, Copy, Debug)]
struct Reading {
    stamp: f64,
    odom_from_robot: Pose,
    step: u32,
    step_from_robot: Pose,
    /// Of (forward, sideways, heading) in the robot's own frame, packed.
    covariance: [f32; 6],
}

/// The filter.
///
/// The covariance of an [`Estimate`] is that of the filter at the time of the reading. At a step it is the weighted mean square
/// deviation of the particles from the reported pose, Σ wᵢ (xᵢ - x) (xᵢ - x)ᵀ; of a single particle, the Laplace approximation
/// at its mode, scaled as the draws are. Between steps, the covariance of the motion since the step is added (the inverse
/// information of the last scan match, and the noise of the odometry after it). It describes how well the pose is known in the
/// map around the robot, not in the world: errors that all particles share, such as the heading of a common ancestor, do not
/// show in it, and with one map it contains no drift at all. Smoothing moves poses and does not change covariances.
#[derive(Debug)]
pub struct Slam {
    config: SlamConfig,
    hypotheses: Vec<Hypothesis>,
    best: usize,
    pool: Pool,
    /// The pool as the evaluator sees it.
    table: ClusterTable,
    evaluator: Failover,
    ancestry: Ancestry,
    readings: Vec<Reading>,
    /// At the start and at every step, of (forward, sideways, heading) in the robot's own frame, packed.
    covariances: Vec<[f32; 6]>,
    steps: u32,
    /// The motion since the last step.
    tracker: Tracker,
    usual_fit: UsualFit,
    loops: Loops,
    /// What a detector of objects sees.
    objects: Option<Objects>,
    /// The walls of an earlier drive.
    earlier: Vec<Cluster>,
    times: StageTimes,
}

impl Slam {
    /// A filter before the first reading. Table I, 2: all particles start at the origin of the world. The configuration is
    /// one that [`SlamConfig::validate`] accepts.
    pub fn new(config: SlamConfig) -> Self {
        Self::with_failover(config, Failover::new(None))
    }

    /// The same with another evaluator than the CPU's. When it fails, the step is repeated on the CPU, which evaluates all
    /// later steps too.
    pub fn with_evaluator(config: SlamConfig, evaluator: Box<dyn Evaluator>) -> Self {
        Self::with_failover(config, Failover::new(Some(evaluator)))
    }

    fn with_failover(config: SlamConfig, evaluator: Failover) -> Self {
        let mut ancestry = Ancestry::default();
        let path = ancestry.extend(None, Pose::IDENTITY);
        let start = Hypothesis {
            map: Map::default(),
            landmarks: Arc::default(),
            world_from_robot: Pose::IDENTITY,
            log_weight: 0.0,
            score: 0.0,
            path,
        };
        Self {
            hypotheses: vec![start; config.maps],
            best: 0,
            pool: Pool::default(),
            table: ClusterTable::new(config.likelihood, config.ablation.latent, config.proposal.capture_sigma),
            evaluator,
            ancestry,
            readings: Vec::new(),
            covariances: vec![[0.0; 6]],
            steps: 0,
            tracker: Tracker::new(config.motion, config.tracking),
            usual_fit: UsualFit::default(),
            loops: Loops::new(config.closer(), LineMap::default()),
            objects: None,
            earlier: Vec::new(),
            times: StageTimes::default(),
            config,
        }
    }

    /// The filter before its first reading, in the map of an earlier drive, where its first scan was taken at this pose.
    pub fn continuing(mut self, earlier: &LineMap, world_from_robot: Pose) -> Self {
        let map = Map::known(&earlier.clusters, &mut self.pool, &self.config.merging);
        let path = self.ancestry.extend(None, world_from_robot);
        let landmarks = Arc::default();
        self.hypotheses.fill(Hypothesis { map, landmarks, world_from_robot, log_weight: 0.0, score: 0.0, path });
        self.table.update(&mut self.pool, world_from_robot);
        self.loops = Loops::new(self.config.closer(), earlier.clone());
        self.earlier = earlier.clusters.clone();
        self
    }

    /// The filter before its first reading, with what a detector of objects sees in the drive. Of the frames between two steps the
    /// last one counts, and its eight nearest detections.
    pub fn detecting(self, detections: Detections) -> Self {
        Self { objects: Some(Objects::new(detections)), ..self }
    }

    /// `world_from_robot` at every step so far, on the path of the best particle.
    pub fn path(&self) -> Vec<Pose> {
        // Node 0 of a path is the start.
        self.ancestry.path(self.hypotheses[self.best].path).split_off(1)
    }

    /// The loops that were searched for and found so far.
    pub fn loops(&self) -> Vec<Loop> {
        self.loops.found(&self.path())
    }

    /// Tracks the robot; takes a step at the first scan and whenever the robot has moved far enough.
    fn add_laser(&mut self, reading: &LaserReading, observe: &mut dyn FnMut(&Event<'_>)) {
        let scan = Scan::from_reading(reading, &self.config.scan);
        observe(&Event::Scan(&scan));
        let tiles = tiles(&scan.points, self.config.likelihood.max_points);
        if self.steps == 0 {
            self.place_first_readings(reading.odom_from_robot);
            // Table I, 2: the robot is at the origin, whatever it did before its first scan.
            self.tracker.begin_step();
        }
        let mut times = std::mem::take(&mut self.times);
        timed(&mut times.track, || self.track(&tiles));
        self.times = times;
        if let Some(objects) = &mut self.objects {
            objects.follow(reading.stamp, self.tracker.tracked().mean);
        }
        if self.steps == 0 || !self.config.tracking.is_too_near(self.tracker.tracked().mean) {
            self.step(&scan, &tiles, reading.odom_from_robot, observe);
        }
        self.keep_reading(reading.stamp, reading.odom_from_robot);
    }

    /// Places the readings before the first scan by odometry relative to it, each with the covariance of the whole motion.
    fn place_first_readings(&mut self, odom_from_first_scan: Pose) {
        let Motion { covariance, .. } = self.tracker.by_odometry();
        for reading in &mut self.readings {
            reading.step_from_robot = reading.odom_from_robot.seen_from(odom_from_first_scan);
            reading.covariance = packed(&covariance);
        }
    }

    fn keep_reading(&mut self, stamp: f64, odom_from_robot: Pose) {
        let Motion { mean: step_from_robot, covariance } = self.tracker.tracked();
        let covariance = packed(&covariance);
        self.readings.push(Reading { stamp, odom_from_robot, step: self.steps, step_from_robot, covariance });
    }

    /// Table I, 6: one step of the filter.
    fn step(&mut self, scan: &Scan, tiles: &[Tile], odom_from_robot: Pose, observe: &mut dyn FnMut(&Event<'_>)) {
        let mut times = std::mem::take(&mut self.times);
        // 6c-i. The same for all particles, whatever their poses.
        let clustering = timed(&mut times.cluster, || cluster_scan(scan, &self.config.clustering));
        let seen = self.observe(scan);
        // 6a
        let mut particles = timed(&mut times.propagate, || self.propagate(tiles));
        timed(&mut times.propagate, || self.fit_to_objects(&mut particles, seen.as_ref()));
        if self.config.ablation.weigh_merged_map {
            // 6c-ii to v, for every particle
            self.move_maps(&particles);
            timed(&mut times.merge, || self.merge(scan, &clustering));
        }
        // 6c-vi. Scan matching has evaluated eq. 18 already, but not in a map that the scan was merged into since.
        if self.config.ablation.weigh_merged_map || particles.iter().any(|p| p.log_likelihood.is_none()) {
            timed(&mut times.weigh, || self.evaluate(&mut particles, tiles));
        }
        timed(&mut times.weigh, || self.add_set_likelihood(&mut particles, seen.as_ref()));
        self.add_tempered(&mut particles);
        let weights = normalised(&particles.iter().map(|particle| particle.log_weight).collect::<Vec<_>>());
        // 6d
        let (resampled, parents) = timed(&mut times.resample, || self.resample(&particles, &weights));
        self.covariances.push(packed(&self.covariance(&particles, &weights)));
        if !self.config.ablation.weigh_merged_map {
            // 6c-ii to v, for the survivors alone
            timed(&mut times.merge, || self.merge(scan, &clustering));
        }
        timed(&mut times.merge, || self.update_landmarks(seen.as_ref()));

        let reported: Vec<ReportedParticle> = particles
            .iter()
            .zip(&weights)
            .map(|(particle, &weight)| ReportedParticle { world_from_robot: particle.world_from_robot, weight })
            .collect();
        let best = &self.hypotheses[self.best];
        observe(&Event::Step(&StepReport {
            step: self.steps,
            stamp: scan.stamp,
            scan,
            scan_clusters: &clustering.clusters,
            odom_from_robot,
            world_from_robot: best.world_from_robot,
            particles: &reported,
            map: &self.clusters_of(best),
            effective_sample_size: effective_sample_size(&weights),
            resampled,
            parents: &parents,
            confidence: None,
            times,
        }));
        self.steps += 1;
        self.loops.add(Keyframe {
            stamp: scan.stamp,
            tiles: tiles.to_vec(),
            clusters: clustering.clusters,
            by_odometry: self.tracker.by_odometry(),
            tracked: self.tracker.tracked(),
        });
        self.tracker.begin_step();
        self.close_loop();
    }

    /// Searches for a loop when that is due. If one is closed, all maps are replaced by that of the corrected path. Eq. 18 cannot
    /// choose between the two: right after the correction, a second copy of a wall still fits better than the wall itself.
    fn close_loop(&mut self) {
        if !self.loops.is_due() {
            return;
        }
        // Node 0 of a path is the start.
        let best = self.ancestry.path(self.hypotheses[self.best].path);
        let objects = self.objects.as_ref();
        let log_likelihood = |path: &[Pose]| {
            objects.map_or(0.0, |objects| objects.mapped(|seen| path[seen.step as usize]).log_likelihood)
        };
        let Some(Closed { path, map }) = self.loops.close(&best[1..], &mut self.evaluator, &log_likelihood) else {
            return;
        };
        let Some(&world_from_robot) = path.last() else { return };
        let start = self.ancestry.extend(None, best[0]);
        let end = path.iter().fold(start, |end, &pose| self.ancestry.extend(Some(end), pose));
        let map = Map { slots: map.into_iter().map(|cluster| self.pool.insert(cluster)).collect() };
        let landmarks = Arc::new(self.mapped(|seen| path[seen.step as usize]));
        let score = self.hypotheses[self.best].score;
        self.hypotheses.fill(Hypothesis { map, landmarks, world_from_robot, log_weight: 0.0, score, path: end });
        self.pool.keep_only(self.hypotheses.iter().map(|hypothesis| &hypothesis.map));
        self.table.update(&mut self.pool, world_from_robot);
    }

    /// Table I, 6a: draws a pose for every particle from the motion (eq. 17) and, unless scan matching is switched off, from the
    /// posterior of the scan in the particle's own map.
    fn propagate(&mut self, tiles: &[Tile]) -> Vec<Particle> {
        let (anchor, particles_per_map) = (self.table.anchor(), self.config.particles / self.config.maps);
        let (tracked, by_odometry) = (self.tracker.tracked(), self.tracker.by_odometry());
        let start = |from: &Hypothesis| Start {
            mean: LocalPose::new(from.world_from_robot * tracked.mean, anchor),
            prior: LocalPose::new(from.world_from_robot * by_odometry.mean, anchor),
        };
        let starts: Vec<Start> = self.hypotheses.iter().map(start).collect();
        let information = by_odometry.covariance.try_inverse().unwrap_or_else(Matrix3::zeros);
        // At the first step there is no map to match, but for that of an earlier drive.
        let iterations = if self.steps == 0 && self.earlier.is_empty() { 0 } else { self.config.proposal.iterations };
        let how = Propagation {
            starts: &starts,
            particles_per_map,
            // A single map follows the mode; several are a sample.
            exact_first: self.config.maps == 1,
            prior_information: packed(&information),
            iterations,
            ..self.propagation()
        };
        let near = |(from, start): (&Hypothesis, &Start)| self.near(&from.map, start.mean, tiles, how.longest_way());
        let maps: Vec<Vec<Slot>> = self.hypotheses.iter().zip(&starts).map(near).collect();
        let proposals = self.evaluator.propagate(&Scene { table: &self.table, tiles, maps: &maps }, &how);
        let prior = self.tracker.prior_by_odometry();
        let particle = |(index, Proposal { drawn, mode }): (usize, Proposal)| {
            let from = &self.hypotheses[index / particles_per_map];
            let at_mode = mode.pose.in_world(anchor);
            let moved = at_mode.seen_from(from.world_from_robot);
            let is_of_track = iterations == 0 || mode.pose.is_near(starts[index / particles_per_map].mean, APART);
            Particle {
                world_from_robot: drawn.in_world(anchor),
                mode: at_mode,
                log_likelihood: (iterations > 0).then(|| f64::from(mode.log_likelihood)),
                information: mode.information,
                log_prior: if is_of_track { 0.0 } else { prior.log_density(moved) },
                // The poses of a map share its weight.
                log_weight: from.log_weight - (particles_per_map as f64).ln(),
                gain: 0.0,
            }
        };
        proposals.into_iter().enumerate().map(particle).collect()
    }

    /// What tracking and the proposal share. The noise is that of the motion as corrected by scans.
    fn propagation(&self) -> Propagation<'static> {
        let noise = Cholesky::of_covariance(&self.tracker.tracked().covariance);
        Propagation {
            seed: self.config.seed,
            step: self.steps,
            draw: Draw::Motion,
            starts: &[],
            particles_per_map: 0,
            exact_first: false,
            is_heavy_tailed: false,
            noise,
            prior_information: [0.0; 6],
            iterations: self.config.proposal.iterations,
            capture_sigma: self.config.proposal.capture_sigma as f32,
            spread: self.config.proposal.spread as f32,
        }
    }

    /// Table I, 6c-vi: the log-likelihood of the scan (eq. 18) at the mode of every particle, in its map as it is now.
    fn evaluate(&mut self, particles: &mut [Particle], tiles: &[Tile]) {
        let poses: Vec<LocalPose> = particles.iter().map(|p| LocalPose::new(p.mode, self.table.anchor())).collect();
        let of_a_map = poses.chunks(particles.len() / self.hypotheses.len());
        let near = |(from, poses): (&Hypothesis, &[LocalPose])| {
            let off = |pose: &LocalPose| (pose.x - poses[0].x).hypot(pose.y - poses[0].y);
            self.near(&from.map, poses[0], tiles, poses.iter().map(off).fold(0.0, f32::max))
        };
        let maps: Vec<Vec<Slot>> = self.hypotheses.iter().zip(of_a_map).map(near).collect();
        let log_likelihoods = self.evaluator.weigh(&Scene { table: &self.table, tiles, maps: &maps }, &poses);
        for (particle, log_likelihood) in particles.iter_mut().zip(log_likelihoods) {
            particle.log_likelihood = Some(f64::from(log_likelihood));
        }
    }

    /// Adds the tempered log-likelihood, and the prior of the mode, to the log-weight of every particle.
    fn add_tempered(&self, particles: &mut [Particle]) {
        for particle in particles {
            particle.gain = self.config.filter.temper * particle.log_likelihood.unwrap_or(0.0) + particle.log_prior;
            particle.log_weight += particle.gain;
        }
    }

    /// The frame of objects that this step has, if any.
    fn observe(&mut self, scan: &Scan) -> Option<Observation> {
        let (step_from_robot, reading) = (self.tracker.tracked().mean, self.readings.len());
        self.objects.as_mut()?.observe(self.steps, reading, step_from_robot, scan)
    }

    /// Moves the mode of every particle to where the detections fit the landmarks of its own map too, and its draw along: the same
    /// normal numbers, spread by the covariance there.
    fn fit_to_objects(&self, particles: &mut [Particle], seen: Option<&Observation>) {
        let Some((objects, seen)) = self.objects.as_ref().zip(seen) else { return };
        let (hypotheses, poses_per_map) = (&self.hypotheses, particles.len() / self.hypotheses.len());
        // What the scan says of the pose is as uncertain as draws are wide; what objects say is taken at its word.
        let wider = self.config.proposal.spread.powi(2);
        let fit = |(number, particle): (usize, &mut Particle)| {
            let before = unpacked(particle.information) / wider;
            let landmarks = &hypotheses[number / poses_per_map].landmarks;
            let (mode, information) = objects.fitted(landmarks, seen, particle.mode, &before)?;
            let [normal, spread] =
                [before, information].map(|information| Some(information.cholesky()?.l().transpose()));
            let drawn = particle.world_from_robot.seen_from(particle.mode);
            let drawn = spread?.solve_upper_triangular(&(normal? * Vector3::new(drawn.x, drawn.y, drawn.heading)))?;
            particle.world_from_robot = mode * Pose::new(drawn.x, drawn.y, drawn.z);
            (particle.mode, particle.information) = (mode, packed(&(information * wider)));
            Some(())
        };
        particles.par_iter_mut().enumerate().for_each(|particle| _ = fit(particle));
    }

    /// Multiplies eq. 18 of every particle by the likelihood of the set of detections, given the landmarks of its own map.
    fn add_set_likelihood(&mut self, particles: &mut [Particle], seen: Option<&Observation>) {
        let Some((objects, seen)) = self.objects.as_ref().zip(seen) else { return };
        let anchor = self.table.anchor();
        let of_a_map = particles.chunks(particles.len() / self.hypotheses.len());
        let rows = |(from, particles): (&Hypothesis, &[Particle])| {
            let robot = particles[0].mode.position();
            let off = |particle: &Particle| (particle.mode.position() - robot).norm();
            let distance = particles.iter().map(off).fold(0.0, f64::max);
            objects.rows(&from.landmarks, seen, robot, distance, anchor)
        };
        let landmarks: Vec<_> = self.hypotheses.iter().zip(of_a_map).map(rows).collect();
        let poses: Vec<LocalPose> = particles.iter().map(|p| LocalPose::new(p.mode, anchor)).collect();
        let sighting = Sighting { seen: &seen.seen(), horizon: &seen.horizon, landmarks: &landmarks };
        for (particle, log_likelihood) in particles.iter_mut().zip(self.evaluator.associate(&sighting, &poses)) {
            particle.log_likelihood = particle.log_likelihood.map(|scan| scan + f64::from(log_likelihood));
        }
    }

    /// Takes the detections into the landmarks of every map.
    fn update_landmarks(&mut self, seen: Option<&Observation>) {
        let Some((objects, seen)) = self.objects.as_ref().zip(seen) else { return };
        self.hypotheses.par_iter_mut().for_each(|hypothesis| {
            objects.update(Arc::make_mut(&mut hypothesis.landmarks), seen, hypothesis.world_from_robot);
        });
    }

    /// Table I, 6d: each map keeps one of its poses; maps are resampled where too few of them carry the weight.
    /// Returns whether they were, and the parent index of each survivor.
    fn resample(&mut self, particles: &[Particle], weights: &[f64]) -> (bool, Vec<u32>) {
        let (maps, poses_per_map) = (self.hypotheses.len(), particles.len() / self.hypotheses.len());
        let offset =
            |number: usize| f64::from(uniform(bits(self.config.seed, self.steps, number as u32, Draw::Resample)[0]));
        let map_weights: Vec<f64> = weights.chunks(poses_per_map).map(|weights| weights.iter().sum()).collect();
        let resampled = effective_sample_size(&map_weights) < self.config.filter.resample_below * maps as f64
            || self.config.filter.resample_below >= 1.0;
        let survivors = if resampled { resample(&map_weights, maps, offset(maps)) } else { (0..maps).collect() };
        self.hypotheses = survivors
            .iter()
            .enumerate()
            .map(|(number, &survivor)| {
                let poses = survivor * poses_per_map..(survivor + 1) * poses_per_map;
                let drawn = resample(&weights[poses.clone()], 1, offset(number)).first().copied().unwrap_or(0);
                let (from, particle) = (&self.hypotheses[survivor], &particles[poses.start + drawn]);
                Hypothesis {
                    map: from.map.clone(),
                    landmarks: Arc::clone(&from.landmarks),
                    world_from_robot: particle.world_from_robot,
                    log_weight: if resampled { 0.0 } else { map_weights[survivor].ln() },
                    score: from.score + particle.gain,
                    path: self.ancestry.extend(Some(from.path), particle.world_from_robot),
                }
            })
            .collect();
        let mut ends: Vec<u32> = self.hypotheses.iter().map(|hypothesis| hypothesis.path).collect();
        self.ancestry.compact(&mut ends);
        self.hypotheses.iter_mut().zip(ends).for_each(|(hypothesis, end)| hypothesis.path = end);
        self.best =
            (0..maps).max_by(|&a, &b| self.hypotheses[a].score.total_cmp(&self.hypotheses[b].score)).unwrap_or(0);
        (resampled, survivors.into_iter().map(|survivor| survivor as u32).collect())
    }

    /// Mean square deviation of the particles from the best pose, in its frame.
    fn covariance(&self, particles: &[Particle], weights: &[f64]) -> Matrix3<f64> {
        if let [Particle { information, .. }] = particles {
            let covariance = unpacked(*information).try_inverse().unwrap_or_else(Matrix3::zeros);
            return covariance * self.config.proposal.spread.powi(2);
        }
        let best = self.hypotheses[self.best].world_from_robot;
        let square = |(particle, &weight): (&Particle, &f64)| {
            let off = particle.world_from_robot.seen_from(best);
            let off = Vector3::new(off.x, off.y, off.heading);
            off * off.transpose() * weight
        };
        particles.iter().zip(weights).map(square).sum()
    }

    /// Moves the robot of each map to where its one particle is, so that the scan can be merged before the weighing.
    fn move_maps(&mut self, particles: &[Particle]) {
        for (hypothesis, particle) in self.hypotheses.iter_mut().zip(particles) {
            hypothesis.world_from_robot = particle.world_from_robot;
        }
    }

    /// Table I, 6c-ii to v: merges the scan's clusters, given in the robot's frame, into every map.
    fn merge(&mut self, scan: &Scan, clustering: &Clustering) {
        let SlamConfig { matching, merging, ablation, filter, likelihood, .. } = &self.config;
        let reach = matching.reach(&clustering.clusters);
        let change = |hypothesis: &Hypothesis| {
            let pose = hypothesis.world_from_robot;
            let local = LocalPose::new(pose, self.table.anchor());
            let slots = self.table.near(&hypothesis.map.slots, local.x, local.y, reach as f32);
            let near: Vec<(Slot, MapCluster)> = slots.into_iter().map(|slot| (slot, *self.pool.get(slot))).collect();
            let new_points = new_points(&near, &scan.points, clustering, pose, likelihood.sigma_floor, merging);
            let clusters_in_world: Vec<Cluster> =
                clustering.clusters.iter().map(|cluster| cluster.transformed(pose)).collect();
            merge_scan(&near, &clusters_in_world, &new_points, self.steps, matching, merging, ablation)
        };
        let changes: Vec<MapChange> = self.hypotheses.par_iter().map(change).collect();
        let without = |(hypothesis, change): (&mut Hypothesis, &MapChange)| {
            hypothesis.map.slots.retain(|slot| !change.removed.contains(slot));
        };
        self.hypotheses.par_iter_mut().zip(&changes).for_each(without);
        for (hypothesis, change) in self.hypotheses.iter_mut().zip(changes) {
            let growth = change.added.len() as f64 - change.removed.len() as f64;
            let cost = filter.temper * merging.cluster_cost * growth;
            hypothesis.log_weight -= cost;
            hypothesis.score -= cost;
            hypothesis.map.slots.extend(change.added.into_iter().map(|entry| self.pool.insert(entry)));
        }
        self.pool.keep_only(self.hypotheses.iter().map(|hypothesis| &hypothesis.map));
        self.table.update(&mut self.pool, self.hypotheses[self.best].world_from_robot);
    }

    /// The clusters of a map that can explain a point of the scan from any pose within `distance` \[m\] of this one.
    fn near(&self, map: &Map, pose: LocalPose, tiles: &[Tile], distance: f32) -> Vec<Slot> {
        self.table.near(&map.slots, pose.x, pose.y, reach(tiles) + distance)
    }

    /// The estimate at a reading, given the pose of its step; `None` before the first step.
    fn estimate(&self, reading: &Reading, world_from_step: Option<Pose>) -> Estimate {
        let &Reading { stamp, odom_from_robot, step, step_from_robot, covariance } = reading;
        let since_step = Motion { mean: step_from_robot, covariance: unpacked(covariance) };
        let covariance = unpacked(self.covariances[step as usize]);
        let placed = world_from_step.map(|mean| Motion { mean, covariance }.then(&since_step));
        Estimate {
            stamp,
            odom_from_robot,
            world_from_robot: placed.map(|placed| placed.mean),
            covariance: placed.map(|placed| placed.covariance_in_earlier_frame()),
            confidence: None,
        }
    }

    /// The landmarks of a path: `world_from_robot` at the step of each frame.
    fn mapped(&self, world_from_robot: impl Fn(&Observation) -> Pose) -> Vec<Landmark> {
        self.objects.as_ref().map_or_else(Vec::new, |objects| objects.mapped(world_from_robot).landmarks)
    }

    /// Of these the ones that are surely there.
    fn sure(&self, world_from_robot: impl Fn(&Observation) -> Pose) -> Vec<Landmark> {
        self.mapped(world_from_robot).into_iter().filter(Landmark::is_sure).collect()
    }

    fn clusters_of(&self, hypothesis: &Hypothesis) -> Vec<Cluster> {
        self.pool.clusters_of(&hypothesis.map).map(|(_, entry)| entry.cluster).collect()
    }
}

impl Estimator for Slam {
    fn add(&mut self, entry: &LogEntry, observe: &mut dyn FnMut(&Event<'_>)) {
        match entry {
            LogEntry::Odometry { stamp, odom_from_robot } => {
                self.tracker.add(*stamp, *odom_from_robot);
                self.keep_reading(*stamp, *odom_from_robot);
            }
            LogEntry::Laser(reading) => {
                self.tracker.add(reading.stamp, reading.odom_from_robot);
                self.add_laser(reading, observe);
            }
            LogEntry::Turn { by_gyro, .. } => {
                self.tracker.turn(*by_gyro);
                return;
            }
            LogEntry::Truth { .. } => return,
        }
        if let Some(reading) = self.readings.last() {
            let world_from_step = (self.steps > 0).then(|| self.hypotheses[self.best].world_from_robot);
            observe(&Event::Pose(&self.estimate(reading, world_from_step)));
        }
    }

    /// The best particle's map and whole path. Readings before the first scan are placed by odometry, seen from it.
    fn result(&self) -> RunResult {
        let best = &self.hypotheses[self.best];
        // Node 0 of a path is the start.
        let mut path = self.ancestry.path(best.path);
        let mut clusters = self.clusters_of(best);
        if let Some(Closed { path: bent, map }) = self.loops.finish(&path[1..]) {
            path.splice(1.., bent);
            clusters = map.into_iter().map(|entry| entry.cluster).collect();
        }
        let estimate = |reading: &Reading| self.estimate(reading, Some(path[reading.step as usize]));
        RunResult {
            map: LineMap { clusters, free: None },
            poses: self.readings.iter().map(estimate).collect(),
            refused_odometry: self.tracker.refused().to_vec(),
            odometry_errors: self.tracker.odometry_errors(),
            gyro: self.tracker.gyro(),
            loops: self.loops.found(&path[1..]),
            earlier: self.earlier.clone(),
            looked_through: 0.0,
            objects: self.objects.as_ref().map(|objects| ObjectMap {
                classes: objects.sensors().classes.clone(),
                landmarks: self.sure(|seen| path[seen.step as usize + 1]),
                frames_used: objects.observations().len(),
            }),
        }
    }

    fn landmarks(&self, poses: &[Estimate]) -> Vec<Landmark> {
        self.sure(|seen| poses.get(seen.reading).and_then(|estimate| estimate.world_from_robot).unwrap_or_default())
    }

    fn evaluator_failure(&self) -> Option<&DeviceError> {
        self.evaluator.failure()
    }
}
