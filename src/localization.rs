//! Where is the robot in a map that is known? Adaptive Monte Carlo localisation.
//!
//! Without a prior, particles start all over the free area, a million of them if need be; every step moves and weighs them
//! ([`Evaluator::advance`], eq. 17 and 18) in the one map that they share. Three things make it practical:
//!
//! - The number of particles follows the doubt (KLD sampling; D. Fox, "Adapting the sample size in particle filters through
//!   KLD-sampling", IJRR 2003): as many as it takes to tell the bins apart that particles are found in, from the whole
//!   free area down to a thousand.
//! - Where scans fit worse than they used to, particles from anywhere are mixed in (augmented MCL; S. Thrun, W. Burgard,
//!   D. Fox, "Probabilistic Robotics", table 8.3), so that a robot that was carried away is found again.
//! - The pose that is told is not the mean of the particles but the top of the posterior around their mode, climbed to in
//!   the map as it is ([`Evaluator::propagate`]); and it is told only where the mode has nearly all of the weight, the map
//!   explains the scan there, the scan does not look through the map's walls, and the robot can have come there from the
//!   top before.

use crate::config::Config;
use crate::evaluator::failover::Failover;
use crate::evaluator::grouping::sort_by_place;
use crate::evaluator::layout::{ClusterParams, LikelihoodConfig, LocalPose, Tile, reach, tiles};
use crate::evaluator::symmetric::{noise_of, packed, unpacked};
use crate::evaluator::table::ClusterTable;
use crate::evaluator::{Advance, Evaluator, EvaluatorError, Mode, Propagation, Scene, Start, Weighed, highest};
use crate::filter::{effective_sample_size, normalised, resample};
use crate::geometry::Pose;
use crate::grid::FreeArea;
use crate::log::LogEntry;
use crate::map::{MapCluster, Pool, Slot};
use crate::motion::Motion;
use crate::ppca::Cluster;
use crate::random::{Draw, bits, normals};
use crate::record::{Confidence, ReportedParticle, StageTimes, StepReport, timed};
use crate::scan::Scan;
use nalgebra::{Matrix3, Point2, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};
use std::f64::consts::{PI, TAU};

/// How a robot is found in a known map.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LocalizationConfig {
    /// Most particles.
    pub max_particles: usize,
    /// Fewest particles.
    pub min_particles: usize,
    /// KLD sampling: the divergence from the true distribution that is allowed ...
    pub kld_error: f64,
    /// ... with a probability whose standard normal quantile this is.
    pub kld_quantile: f64,
    /// Log-likelihoods are multiplied by this, in place of [`LikelihoodConfig::temper`]: places that look alike are told
    /// apart by what comes after them, so both have to be kept till then.
    pub temper: f64,
    /// In place of [`LikelihoodConfig::capture_sigma`]: least standard deviation across a wall while particles are
    /// weighed \[m\] ...
    pub least_sigma: f64,
    /// ... and greatest. In between it is half the distance of neighbouring particles: fewer do not come closer to the true
    /// pose, and one that came close to a wrong one by chance would win.
    pub most_sigma: f64,
    /// Share by which the long memory of how well scans fit is renewed each step.
    pub slow_memory: f64,
    /// The same of the short memory.
    pub fast_memory: f64,
    /// The robot is located where one place has this share of the weight ...
    pub located_weight: f64,
    /// ... the map explains this share of what it could explain of the scan at best, less the share of the points that
    /// are behind its walls ...
    pub located_explained: f64,
    /// ... and both have been so, at poses that the robot can have moved between, for about this many steps: rooms look
    /// alike, but not the way from one to the next.
    pub located_steps: u32,
}

impl Default for LocalizationConfig {
    fn default() -> Self {
        Self {
            max_particles: 100_000,
            min_particles: 1000,
            kld_error: 0.05,
            kld_quantile: 2.33,
            temper: 0.01,
            least_sigma: 0.1,
            most_sigma: 0.5,
            slow_memory: 0.02,
            fast_memory: 0.3,
            located_weight: 0.95,
            located_explained: 0.6,
            located_steps: 6,
        }
    }
}

/// A map to find the robot in.
#[derive(Clone, Debug)]
pub struct KnownMap {
    /// Its walls, in the world's frame.
    pub clusters: Vec<Cluster>,
    /// Where the robot can be.
    pub free: FreeArea,
}

/// Where the robot is believed to be at first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Most likely pose.
    pub world_from_robot: Pose,
    /// Standard deviation of its position \[m\].
    pub position: f64,
    /// Standard deviation of its heading \[rad\].
    pub heading: f64,
}

/// What is known of the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The likeliest pose.
    pub world_from_robot: Pose,
    /// How far it can be relied on.
    pub confidence: Confidence,
}

/// Particles, each with the number of the one that it was before, and how many bins they are in.
struct Drawn {
    particles: Vec<(LocalPose, u32)>,
    bins: usize,
}

/// Particles around a place with much of the weight, in the evaluator's frame.
struct Cloud {
    mean: Pose,
    /// Of (forward, sideways, heading) in the frame of the mean, or of one close by.
    covariance: Matrix3<f64>,
    /// Share of all weight.
    weight: f64,
}

/// The filter.
#[derive(Debug)]
pub struct Localization {
    config: Config,
    map: KnownMap,
    /// ln of the density of a point in the middle of a wall of the map.
    log_peak: f64,
    prior: Option<Prior>,
    table: ClusterTable,
    /// Standard deviation across a wall at least while particles are weighed, and in the first steps of a climb \[m\].
    capture_sigma: f64,
    /// Every cluster, for the one map that all particles share.
    slots: [Vec<Slot>; 1],
    evaluator: Failover,
    particles: Vec<LocalPose>,
    estimate: Option<Estimate>,
    /// How well scans fit: long and short memory. At first as if they had just been good enough.
    memory: [f64; 2],
    /// Steps at which the pose could be relied on, less those at which it could not; up to twice as many as are wanted.
    good_steps: u32,
    /// Of the looks between steps, since the last one.
    times: StageTimes,
    steps: u32,
    /// Laser readings so far.
    readings: u32,
    /// The motion since the last step, by odometry alone ...
    by_odometry: Motion,
    /// ... and corrected by the scans, where the robot is located.
    tracked: Motion,
    last_odometry: Option<Pose>,
}

/// Size of a bin of KLD sampling, and of the search for the mode \[m, m, rad\].
const BIN: [f64; 3] = [0.5, 0.5, PI / 18.0];
/// A wall so far off \[m\] moves by as much when the robot turns as when it steps.
const LEVER: f64 = 5.0;
/// No pose is known better than this in (forward, sideways, heading), whatever particles or a map say: standard
/// deviations \[m, m, rad\].
const BEST_KNOWN: Vector3<f64> = Vector3::new(0.05, 0.05, 0.02);
/// 99 % of normal vectors of three numbers are no longer than this, squared (χ²).
const NEARLY_ALL: f64 = 11.345;
/// A cloud is what lies this close around its mean \[m, rad\].
const CLOUD: [f64; 2] = [1.0, 0.5];

impl Localization {
    /// A filter that has seen nothing, with a valid configuration ([`Config::validate`]). Without a prior the robot may be
    /// anywhere in the free area.
    pub fn new(map: KnownMap, prior: Option<Prior>, config: Config, evaluator: Option<Box<dyn Evaluator>>) -> Self {
        let table = table(&map, &config);
        let slots = (0..map.clusters.len() as Slot).collect();
        let mut this = Self {
            config,
            log_peak: log_peak(&map.clusters, &config.likelihood),
            map,
            prior,
            table,
            capture_sigma: config.localization.most_sigma,
            slots: [slots],
            evaluator: Failover::new(evaluator),
            particles: Vec::new(),
            estimate: None,
            memory: [config.localization.located_explained; 2],
            good_steps: 0,
            times: StageTimes::default(),
            steps: 0,
            readings: 0,
            by_odometry: Motion::none(),
            tracked: Motion::none(),
            last_odometry: None,
        };
        let first = this.first_particles();
        this.take(first);
        this
    }

    /// Why the CPU took over from the evaluator that the filter was given.
    pub fn evaluator_failure(&self) -> Option<&EvaluatorError> {
        self.evaluator.failure()
    }

    /// Where the robot is by the last step and its motion since; `None` before the first scan.
    pub fn estimate(&self) -> Option<Estimate> {
        let moved = |estimate: Estimate| Estimate {
            world_from_robot: estimate.world_from_robot * self.tracked.mean,
            ..estimate
        };
        self.estimate.map(moved)
    }

    /// Takes in the next entry of a log, in the order of the log; reports where it led to a step.
    pub fn add(&mut self, entry: &LogEntry, on_step: &mut dyn FnMut(&StepReport<'_>)) {
        match entry {
            LogEntry::Odometry { odom_from_robot, .. } => self.follow(*odom_from_robot),
            LogEntry::Laser(reading) => {
                self.follow(reading.odom_from_robot);
                self.readings += 1;
                let scan = Scan::from_reading(reading, self.config.scan.min_range, self.config.scan.max_range);
                let tiles = tiles(&scan.points, self.config.likelihood.max_points);
                // A scan without points says nothing of where the robot is.
                if tiles.is_empty() {
                    return;
                }
                let mut track_seconds = 0.0;
                timed(&mut track_seconds, || self.track(&tiles));
                self.times.track += track_seconds;
                if self.steps == 0 || !self.config.filter.is_too_near(self.tracked.mean) {
                    self.step(&scan, &tiles, reading.odom_from_robot, on_step);
                }
            }
            LogEntry::Truth { .. } => {}
        }
    }

    fn follow(&mut self, odom_from_robot: Pose) {
        if let Some(last) = self.last_odometry.replace(odom_from_robot) {
            let since = Motion::from_odometry(last, odom_from_robot, &self.config.motion);
            self.by_odometry = self.by_odometry.then(&since);
            self.tracked = self.tracked.then(&since);
        }
    }

    /// Moves, weighs and draws anew.
    fn step(&mut self, scan: &Scan, tiles: &[Tile], odom_from_robot: Pose, on_step: &mut dyn FnMut(&StepReport<'_>)) {
        let mut times = std::mem::take(&mut self.times);
        let weighed = timed(&mut times.weigh, || self.advance(tiles));
        let temper = self.config.localization.temper;
        let log_weights: Vec<f64> = weighed.iter().map(|w| temper * f64::from(w.log_likelihood)).collect();
        let weights = normalised(&log_weights);
        let cloud = timed(&mut times.resample, || self.heaviest(&weighed, &weights));
        let estimate = timed(&mut times.propagate, || self.locate(&cloud, tiles));
        let anywhere = self.remember(estimate.confidence.explained);
        let parents = timed(&mut times.resample, || {
            let drawn = self.resample(&weighed, &weights, anywhere);
            self.take(drawn)
        });

        let anchor = self.table.anchor();
        let report = |(weighed, &weight): (&Weighed, &f64)| ReportedParticle {
            world_from_robot: weighed.pose.in_world(anchor),
            weight,
        };
        let particles: Vec<ReportedParticle> = weighed.iter().zip(&weights).map(report).collect();
        let report = StepReport {
            step: self.steps,
            stamp: scan.stamp,
            scan,
            scan_clusters: &[],
            odom_from_robot,
            world_from_robot: estimate.world_from_robot,
            particles: &particles,
            map: &self.map.clusters,
            effective_sample_size: effective_sample_size(&weights),
            resampled: true,
            parents: &parents,
            confidence: Some(estimate.confidence),
            times,
        };
        on_step(&report);
        self.estimate = Some(estimate);
        self.by_odometry = Motion::none();
        self.tracked = Motion::none();
        self.steps += 1;
    }

    fn advance(&mut self, tiles: &[Tile]) -> Vec<Weighed> {
        let Pose { x, y, heading } = self.tracked.mean;
        let how = Advance {
            seed: self.config.seed,
            step: self.steps,
            motion: [x, y, heading].map(|number| number as f32),
            noise: noise_of(&self.by_odometry.covariance),
            capture_sigma: self.capture_sigma as f32,
        };
        let scene = Scene { table: &self.table, tiles, maps: &self.slots };
        let mut weighed = self.evaluator.advance(&scene, &how, &self.particles);
        weighed.iter_mut().for_each(|weighed| weighed.pose.heading = crate::math::wrap(weighed.pose.heading));
        weighed
    }

    /// Where most of the weight is.
    fn heaviest(&self, weighed: &[Weighed], weights: &[f64]) -> Cloud {
        let least = 1e-6 / weights.len() as f64;
        let heavy = || weighed.iter().zip(weights).filter(|(_, weight)| **weight > least);
        let mut bins: HashMap<[i32; 3], f64> = HashMap::new();
        for (Weighed { pose, .. }, weight) in heavy() {
            *bins.entry(bin(*pose)).or_default() += weight;
        }
        // Of equal bins always the same: the order of a hash map is not.
        let heaviest = bins.into_iter().max_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        let middle = heaviest.map_or([0.0; 3], |(bin, _)| std::array::from_fn(|i| (f64::from(bin[i]) + 0.5) * BIN[i]));
        let mut mean = Pose::new(middle[0], middle[1], middle[2]);
        let mut cloud = Cloud { mean, covariance: Matrix3::zeros(), weight: 0.0 };
        // The bin may have cut the cloud in two: its mean moves to where it is.
        for _ in 0..3 {
            let (mut weight, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
            for (Weighed { pose, .. }, w) in heavy() {
                let off = pose.in_world(Point2::origin()).seen_from(mean);
                if off.x.hypot(off.y) < CLOUD[0] && off.heading.abs() < CLOUD[1] {
                    let off = Vector3::new(off.x, off.y, off.heading);
                    weight += w;
                    first += off * *w;
                    second += off * off.transpose() * *w;
                }
            }
            if weight <= 0.0 {
                break;
            }
            let off = first / weight;
            let covariance = second / weight - off * off.transpose();
            mean = mean * Pose::new(off.x, off.y, off.z);
            cloud = Cloud { mean, covariance, weight };
        }
        cloud
    }

    /// The top of the posterior of the scan around a pose of the evaluator's frame; the covariance is of (forward,
    /// sideways, heading) in its own.
    fn climb(&mut self, mean: Pose, covariance: &Matrix3<f64>, tiles: &[Tile]) -> Mode {
        let mean = LocalPose::new(mean, Point2::origin());
        let information = covariance.try_inverse().unwrap_or_else(Matrix3::zeros);
        let how = Propagation {
            seed: self.config.seed,
            step: self.readings,
            draw: Draw::Tracking,
            starts: &[Start { mean, prior: mean }],
            particles_a_map: self.config.proposal.tracking_starts.max(1) as usize,
            // Where it is expected.
            exact_first: true,
            noise: noise_of(covariance),
            prior_information: packed(&information),
            iterations: self.config.proposal.iterations.max(1),
            capture_sigma: self.capture_sigma as f32,
            spread: 0.0,
        };
        let reach = reach(tiles) + how.longest_way();
        let maps = [self.table.near(&self.slots[0], mean.x, mean.y, reach)];
        let scene = Scene { table: &self.table, tiles, maps: &maps };
        highest(self.evaluator.propagate(&scene, &how)).unwrap_or_default()
    }

    /// Between steps, a robot that is located is followed by its scans: odometry may be far off by the next step.
    fn track(&mut self, tiles: &[Tile]) {
        let Some(estimate) = self.estimate.filter(|estimate| estimate.confidence.is_located) else { return };
        let anchor = self.table.anchor();
        let expected = LocalPose::new(estimate.world_from_robot * self.tracked.mean, anchor).in_world(Point2::origin());
        let covariance = self.tracked.covariance;
        let found = self.climb(expected, &covariance, tiles);
        let mean = found.pose.in_world(anchor).seen_from(estimate.world_from_robot);
        // In a long corridor, or where the map shows little, a scan may hold back the pose while the robot drives on.
        if is_plausible(mean, &self.by_odometry, best_known(1.0)) {
            self.tracked.mean = mean;
            self.tracked.covariance = unpacked(found.information).try_inverse().unwrap_or(covariance);
        }
    }

    /// Climbs to the top of the posterior around a cloud, and judges it.
    fn locate(&mut self, cloud: &Cloud, tiles: &[Tile]) -> Estimate {
        // Its few particles may lie in one place.
        let best = self.climb(cloud.mean, &(cloud.covariance + best_known(1.0)), tiles);
        let top = best.pose.in_world(self.table.anchor());

        let points: f64 = tiles.iter().map(|tile| f64::from(tile.count)).sum();
        let log_outlier = f64::from(self.table.log_outlier());
        let most = points * (self.log_peak - log_outlier);
        let gained = f64::from(best.log_likelihood) - points * log_outlier;
        let share = if most > 0.0 { gained / most } else { 0.0 };
        let explained = (share - self.points_behind_walls(top, tiles) as f64 / points).clamp(0.0, 1.0);
        let LocalizationConfig { located_weight, located_explained, located_steps, .. } = self.config.localization;
        let is_good = cloud.weight >= located_weight && explained >= located_explained && self.is_expected(top);
        // A bad step costs a good one, so that a moment of doubt is no new start.
        let good = if is_good { self.good_steps + 1 } else { self.good_steps.saturating_sub(1) };
        self.good_steps = good.min(located_steps.saturating_mul(2));
        let is_located = is_good && self.good_steps >= located_steps;
        let confidence = Confidence { weight: cloud.weight, explained, is_located };
        Estimate { world_from_robot: top, confidence }
    }

    /// How many points are behind a wall of the map, seen from here. The likelihood (eq. 18) does not ask what
    /// is between the robot and a point; a place that only looks like the right one is given away by it.
    fn points_behind_walls(&self, world_from_robot: Pose, tiles: &[Tile]) -> usize {
        let (robot, reach) = (world_from_robot.position(), f64::from(reach(tiles)));
        let walls: Vec<&Cluster> = self.map.clusters.iter().filter(|wall| wall.may_be_within(reach, robot)).collect();
        let least_sigma = self.config.localization.least_sigma;
        let is_behind = |point: &Point2<f64>| walls.iter().any(|wall| wall.separates(robot, *point, least_sigma));
        tiles.iter().flat_map(Tile::points).map(|point| world_from_robot * point).filter(is_behind).count()
    }

    /// Can the robot have come here from the last top? At a place that only looks like the right one the tops jump. Where
    /// walls are known badly they do so anywhere.
    fn is_expected(&self, top: Pose) -> bool {
        let Some(last) = self.estimate else { return true };
        let wall_sigma = (-self.log_peak).exp() / TAU.sqrt();
        let times = (wall_sigma / BEST_KNOWN.x).max(1.0);
        is_plausible(top.seen_from(last.world_from_robot), &self.by_odometry, best_known(times))
    }

    /// Renews both memories; returns the share of particles that should come from anywhere.
    fn remember(&mut self, explained: f64) -> f64 {
        let LocalizationConfig { slow_memory, fast_memory, .. } = self.config.localization;
        let [slow, fast] = self.memory;
        let [slow, fast] = [slow + slow_memory * (explained - slow), fast + fast_memory * (explained - fast)];
        self.memory = [slow, fast];
        if slow > 0.0 { (1.0 - fast / slow).max(0.0) } else { 0.0 }
    }

    /// Draws anew, a share of the particles from anywhere. KLD sampling tells how many there are, systematic resampling
    /// which: in the order of their places, so that no place gains or loses particles by chance.
    fn resample(&self, weighed: &[Weighed], weights: &[f64], anywhere: f64) -> Drawn {
        let mut cumulative = weights.to_vec();
        cumulative.iter_mut().fold(0.0, |sum, weight| {
            *weight += sum;
            *weight
        });
        let total = cumulative.last().copied().unwrap_or(0.0);
        let words = |number| bits(self.config.seed, self.steps, number, Draw::Resample);
        let (count, bins) = self.enough(|number| {
            let words = words(number);
            if fraction(words[0], 0) < anywhere {
                return self.anywhere(self.steps, number);
            }
            let target = fraction(words[1], words[2]) * total;
            weighed[cumulative.partition_point(|&sum| sum <= target).min(weighed.len() - 1)].pose
        });
        let from_anywhere = (anywhere * count as f64).round() as usize;
        let offset = fraction(words(u32::MAX)[0], 0);
        let parents = resample(weights, count - from_anywhere.min(count), offset).into_iter();
        let mut particles: Vec<(LocalPose, u32)> =
            parents.map(|parent| (weighed[parent].pose, parent as u32)).collect();
        particles.extend((0..from_anywhere as u32).map(|number| (self.anywhere(self.steps, number), u32::MAX)));
        Drawn { particles, bins }
    }

    /// KLD sampling: so many draws are enough for the bins that they fall in, and how many bins these are.
    fn enough(&self, draw: impl Fn(u32) -> LocalPose) -> (usize, usize) {
        let LocalizationConfig { max_particles, min_particles, .. } = self.config.localization;
        let mut bins: HashSet<[i32; 3]> = HashSet::new();
        let (mut drawn, mut enough) = (0, min_particles);
        while drawn < enough.min(max_particles) {
            if bins.insert(bin(draw(drawn as u32))) {
                enough = enough_for(bins.len(), &self.config.localization).max(min_particles);
            }
            drawn += 1;
        }
        (drawn, bins.len())
    }

    /// Goes on with these particles, in the order of their places, and with walls as thick as they are sparse. Returns
    /// the number of the particle that each was before.
    fn take(&mut self, Drawn { mut particles, bins }: Drawn) -> Vec<u32> {
        sort_by_place(&mut particles, |particle| particle.0);
        let LocalizationConfig { least_sigma, most_sigma, .. } = self.config.localization;
        let volume = bins as f64 * BIN.iter().product::<f64>() / particles.len().max(1) as f64;
        self.capture_sigma = (0.5 * (LEVER * volume).cbrt()).clamp(least_sigma, most_sigma);
        let parents;
        (self.particles, parents) = particles.into_iter().unzip();
        parents
    }

    /// Particles of the prior, as many as its bins take.
    fn first_particles(&self) -> Drawn {
        let place = |number: u32| match self.prior {
            None => self.anywhere(u32::MAX, number),
            Some(Prior { world_from_robot, position, heading }) => {
                let [x, y, turn, _] = normals(self.config.seed, u32::MAX, number, Draw::Motion).map(f64::from);
                let Pose { x: x0, y: y0, heading: heading0 } = world_from_robot;
                let pose = Pose::new(x0 + position * x, y0 + position * y, heading0 + heading * turn);
                LocalPose::new(pose, self.table.anchor())
            }
        };
        let (count, bins) = self.enough(place);
        Drawn { particles: (0..count as u32).map(|number| (place(number), number)).collect(), bins }
    }

    /// A pose anywhere in the free area.
    fn anywhere(&self, step: u32, number: u32) -> LocalPose {
        let words = bits(self.config.seed, step, number, Draw::Anywhere);
        let position = self.map.free.sample([fraction(words[0], 0), fraction(words[1], 0)]);
        let heading = TAU * fraction(words[2], 0) - PI;
        LocalPose::new(Pose::new(position.x, position.y, heading), self.table.anchor())
    }
}

/// The clusters of a map, for walls as thick as they ever are.
fn table(map: &KnownMap, config: &Config) -> ClusterTable {
    let mut pool = Pool::default();
    for &cluster in &map.clusters {
        pool.insert(MapCluster { cluster, last_step: 0, sightings: 1 });
    }
    let capture_sigma = config.localization.most_sigma;
    let mut table = ClusterTable::new(LikelihoodConfig { capture_sigma, ..config.likelihood });
    // Particles may be anywhere, so the anchor is near the middle of the map and stays there.
    table.update(&mut pool, middle(&map.clusters));
    table
}

/// ln of the density of a point in the middle of a wall, of all metres of wall on average: as much as a map of its
/// resolution can say of a point.
fn log_peak(clusters: &[Cluster], likelihood: &LikelihoodConfig) -> f64 {
    let of = |cluster: &Cluster| ClusterParams::new(cluster, Point2::origin(), likelihood).log_peak;
    let (mut length, mut sum) = (0.0, 0.0);
    for cluster in clusters {
        length += cluster.length();
        sum += cluster.length() * f64::from(of(cluster));
    }
    if length > 0.0 { sum / length } else { f64::from(likelihood.log_outlier()) }
}

/// Whether this can have been the motion: nearly all are as close to the mean, with this much more of doubt.
fn is_plausible(mean: Pose, motion: &Motion, more: Matrix3<f64>) -> bool {
    let off = mean.seen_from(motion.mean);
    let off = Vector3::new(off.x, off.y, off.heading);
    let information = (motion.covariance + more).try_inverse();
    information.is_none_or(|information| off.dot(&(information * off)) <= NEARLY_ALL)
}

/// The covariance of a pose that is known so many times worse than [`BEST_KNOWN`].
fn best_known(times: f64) -> Matrix3<f64> {
    Matrix3::from_diagonal(&BEST_KNOWN.map(|sigma| (times * sigma).powi(2)))
}

/// The bin of a pose.
fn bin(pose: LocalPose) -> [i32; 3] {
    let at = [pose.x, pose.y, pose.heading].map(f64::from);
    std::array::from_fn(|axis| (at[axis] / BIN[axis]).floor() as i32)
}

/// The middle of a box around all walls.
fn middle(clusters: &[Cluster]) -> Pose {
    let mut means = clusters.iter().map(|cluster| cluster.mean);
    let first = means.next().unwrap_or_default();
    let (low, high) = means.fold((first, first), |(low, high), mean| (low.inf(&mean), high.sup(&mean)));
    let middle = nalgebra::center(&low, &high);
    Pose::new(middle.x, middle.y, 0.0)
}

/// A number in [0, 1] of 64 random bits.
fn fraction(high: u32, low: u32) -> f64 {
    (f64::from(high) + f64::from(low) / 4_294_967_296.0) / 4_294_967_296.0
}

/// So many particles keep the error of the distribution over `bins` bins below what is allowed (Fox 2003, eq. 7).
fn enough_for(bins: usize, config: &LocalizationConfig) -> usize {
    let LocalizationConfig { kld_error, kld_quantile, .. } = *config;
    let others = bins.saturating_sub(1) as f64;
    if others < 1.0 {
        return 0;
    }
    let a = 2.0 / (9.0 * others);
    let root = 1.0 - a + a.sqrt() * kld_quantile;
    (others / (2.0 * kld_error) * root * root * root).ceil() as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Cell, OccupancyGrid};
    use nalgebra::Vector2;

    /// Eq. 5 there: χ² of k - 1 degrees of freedom over 2 ε, by the table of its 99 % quantiles; eq. 7 approximates it.
    #[test]
    fn enough_particles_are_those_of_the_table() {
        let config = LocalizationConfig { kld_error: 0.05, kld_quantile: 2.326, ..LocalizationConfig::default() };
        for (bins, quantile) in [(2, 6.635), (6, 15.086), (11, 23.209), (101, 135.807)] {
            let (found, expected) = (enough_for(bins, &config) as f64, quantile / 0.1);
            assert!((found - expected).abs() < 0.02 * expected + 1.0, "{bins} bins: {found} is not {expected}");
        }
        assert_eq!(enough_for(1, &config), 0);
    }

    /// A metre of wall that is known to 3 cm and three metres that are known to 10 cm: 1/(√(2π) σ) in their middle.
    #[test]
    fn a_map_can_say_as_much_as_its_metres_of_wall() {
        let likelihood = LikelihoodConfig { sigma_floor: 0.03, outlier_density: 0.01, ..LikelihoodConfig::default() };
        let wall = |length: f64, sigma: f64| Cluster {
            mean: Point2::new(3.0, 5.0),
            direction: Vector2::x(),
            along_variance: length * length / 12.0,
            across_variance: sigma * sigma,
            count: 10.0,
        };
        let found = log_peak(&[wall(1.0, 0.001), wall(3.0, 0.1)], &likelihood);
        let expected = 0.25 * 13.298_f64.ln() + 0.75 * 3.989_4_f64.ln();
        assert!((found - expected).abs() < 1e-4, "{found}, not {expected}");
        assert!((log_peak(&[], &likelihood) - 0.01_f64.ln()).abs() < 1e-6);
    }

    /// A metre forward, turning to the left, known to 12 cm (with the 5 cm of a top to 13 cm) and 0.048 rad (0.052):
    /// √11.345 = 3.37 standard deviations are 44 cm and 0.175 rad.
    #[test]
    fn the_robot_is_expected_where_its_motion_leads_to() {
        let grid = OccupancyGrid::new(1.0, Pose::IDENTITY, 1, 1, vec![Cell::Free]).unwrap();
        let map = KnownMap { clusters: Vec::new(), free: FreeArea::from_grid(&grid, []).unwrap() };
        let mut filter = Localization::new(map, None, Config::default(), None);
        filter.log_peak = -(0.01 * TAU.sqrt()).ln();
        assert!(filter.is_expected(Pose::new(100.0, 0.0, 0.0)), "nothing is known at first");
        let world_from_robot = Pose::new(5.0, 3.0, 3.1);
        let confidence = Confidence { weight: 1.0, explained: 1.0, is_located: false };
        filter.estimate = Some(Estimate { world_from_robot, confidence });
        let covariance = Matrix3::from_diagonal(&Vector3::new(0.12_f64, 0.12, 0.048).map(|sigma| sigma * sigma));
        filter.by_odometry = Motion { mean: Pose::new(1.0, 0.0, 0.1), covariance };
        let is_expected = |x, y, turn| filter.is_expected(world_from_robot * Pose::new(1.0 + x, y, 0.1 + turn));
        assert!(is_expected(0.0, 0.0, 0.0) && is_expected(0.43, 0.0, 0.0) && is_expected(0.0, -0.43, 0.0));
        assert!(is_expected(0.0, 0.0, 0.17) && is_expected(0.0, 0.0, -0.17));
        assert!(!is_expected(0.45, 0.0, 0.0) && !is_expected(0.0, -0.45, 0.0) && !is_expected(0.0, 0.0, 0.18));
        assert!(!is_expected(0.33, 0.33, 0.0), "both together");

        // Walls that are known to 16 cm: with the 12 cm of the motion 20 cm, of which 3.37 are 67 cm.
        filter.log_peak = -(0.16 * TAU.sqrt()).ln();
        let is_expected = |x| filter.is_expected(world_from_robot * Pose::new(1.0 + x, 0.0, 0.1));
        assert!(is_expected(0.67) && !is_expected(0.68));
    }

    /// A wall around its middle, known to 1 cm.
    fn wall(x: f64, y: f64, length: f64, direction: Vector2<f64>) -> Cluster {
        let along_variance = length * length / 12.0;
        Cluster { mean: Point2::new(x, y), direction, along_variance, across_variance: 1e-4, count: 100.0 }
    }

    /// The walls of a room of 6 by 4 m.
    fn room() -> Vec<Cluster> {
        let (x, y) = (Vector2::x(), Vector2::y());
        vec![wall(3.0, 0.0, 6.0, x), wall(3.0, 4.0, 6.0, x), wall(0.0, 2.0, 4.0, y), wall(6.0, 2.0, 4.0, y)]
    }

    /// Where the robot is in the room.
    const ROBOT: Pose = Pose { x: 2.0, y: 1.5, heading: 0.3 };

    /// What it sees of the room's walls, in the world's frame.
    fn seen() -> Vec<Point2<f64>> {
        let point = |wall: &Cluster, step: i32| wall.mean + wall.direction * (f64::from(step) / 40.0 * wall.length());
        room().iter().flat_map(|wall| (-18..=18).map(move |step| point(wall, step))).collect()
    }

    /// The same as the filter takes it.
    fn tiles_seen() -> Vec<Tile> {
        let points: Vec<Point2<f64>> = seen().into_iter().map(|point| ROBOT.inverse() * point).collect();
        tiles(&points, 180)
    }

    /// A filter with these walls, and good reasons to believe in the pose where it last was.
    fn filter(clusters: Vec<Cluster>, before: Pose) -> Localization {
        let grid = OccupancyGrid::new(1.0, Pose::IDENTITY, 6, 4, vec![Cell::Free; 24]).unwrap();
        let map = KnownMap { clusters, free: FreeArea::from_grid(&grid, []).unwrap() };
        let mut filter = Localization::new(map, None, Config::default(), None);
        let confidence = Confidence { weight: 1.0, explained: 1.0, is_located: true };
        filter.estimate = Some(Estimate { world_from_robot: before, confidence });
        filter.good_steps = 10;
        filter
    }

    /// What it thinks of a cloud around the robot.
    fn locate(mut filter: Localization) -> Confidence {
        let mean = LocalPose::new(ROBOT, filter.table.anchor()).in_world(Point2::origin());
        let cloud = Cloud { mean, covariance: Matrix3::identity() * 0.01, weight: 1.0 };
        let Estimate { world_from_robot, confidence } = filter.locate(&cloud, &tiles_seen());
        let off = world_from_robot.seen_from(ROBOT);
        assert!(off.x.hypot(off.y) < 0.01 && off.heading.abs() < 0.01, "{world_from_robot:?}");
        confidence
    }

    /// The scan, the cloud and the map are the same; only where the robot was before is not.
    #[test]
    fn a_pose_that_jumped_is_not_relied_on() {
        let is_located = |moved: Pose| locate(filter(room(), ROBOT * moved)).is_located;
        assert!(is_located(Pose::IDENTITY) && is_located(Pose::new(0.1, 0.0, 0.0)));
        assert!(!is_located(Pose::new(0.3, 0.0, 0.0)) && !is_located(Pose::new(0.0, 0.0, 0.2)));
    }

    /// Every point lies on a wall of the map, but some are behind another one, which goes through all of the room.
    #[test]
    fn a_pose_that_looks_through_walls_is_not_relied_on() {
        let open = locate(filter(room(), ROBOT));
        let confidence = |x: f64| locate(filter([room(), vec![wall(x, 2.0, 4.0, Vector2::y())]].concat(), ROBOT));
        // The line to the point meets the wall at this height; margins are 0.3 m.
        let height = |point: &Point2<f64>, x: f64| ROBOT.y + (point.y - ROBOT.y) * (x - ROBOT.x) / (point.x - ROBOT.x);
        let is_behind = |point: &&Point2<f64>, x: f64| point.x > x + 0.3 && (0.3..3.7).contains(&height(point, x));
        for x in [3.0, 5.0] {
            let behind = seen().iter().filter(|point| is_behind(point, x)).count() as f64 / seen().len() as f64;
            let (found, expected) = (confidence(x).explained, open.explained - behind);
            assert!(behind > 0.1 && (found - expected).abs() < 1e-2, "wall at {x} m: {found}, not {expected}");
        }
        assert!(open.is_located && confidence(5.0).is_located && !confidence(3.0).is_located);
    }

    /// The scan says that the robot stands still.
    #[test]
    fn the_scan_corrects_odometry_but_cannot_hold_back_the_robot() {
        let tracked = |odometry: f64| {
            let mut filter = filter(room(), ROBOT);
            let motion = |sigma: f64| Motion {
                mean: Pose::new(odometry, 0.0, 0.0),
                covariance: Matrix3::identity() * (sigma * sigma),
            };
            filter.by_odometry = motion(0.05);
            filter.tracked = motion(1.0);
            filter.track(&tiles_seen());
            assert_eq!(filter.by_odometry, motion(0.05));
            filter.tracked
        };
        // √11.345 √(0.05² + 0.05²) are 0.238 m.
        let Motion { mean, covariance } = tracked(0.22);
        assert!(mean.x.hypot(mean.y) < 0.01 && mean.heading.abs() < 0.01, "{mean:?}");
        assert!(covariance.diagonal().iter().all(|variance| (0.0..1e-3).contains(variance)), "{covariance}");
        assert_eq!(tracked(0.26).mean, Pose::new(0.26, 0.0, 0.0));
    }

    #[test]
    fn bins_are_half_a_metre_and_ten_degrees() {
        let pose = |x: f32, y: f32, degrees: f32| LocalPose { x, y, heading: degrees.to_radians() };
        assert_eq!(bin(pose(0.49, -0.01, 9.9)), [0, -1, 0]);
        assert_eq!(bin(pose(0.51, 0.49, 10.1)), [1, 0, 1]);
        assert_eq!(bin(pose(-7.3, 12.2, -179.0)), [-15, 24, -18]);
    }
}
