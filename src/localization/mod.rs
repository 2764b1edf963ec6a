//! Localisation in a known map: adaptive Monte Carlo localisation (AMCL).
//!
//! Without an initial pose, particles are drawn uniformly from the free area, up to a million of them; every step moves and
//! weighs them ([`Evaluator::advance`], eq. 17 and 18) in the one map that they share. Beyond plain MCL:
//!
//! - KLD sampling ([`kld`](crate::filter::kld)) adapts the number of particles to the number of bins that they occupy, from the
//!   whole free area down to a thousand particles.
//! - Clusters of particles are places where the robot may be (`clouds`). Each cloud is resampled by itself and keeps its
//!   weight (`drawing`), and walls that the map lacks count against none of them (`estimate::held_back`): ambiguous places are
//!   all kept until a scan distinguishes them.
//! - Augmented MCL ([`recovery`](crate::filter::recovery)): where scans fit worse than before, particles from the whole free area
//!   are mixed in, so that a robot that was carried away is found again.
//! - The estimate is not the mean of the particles but the mode of the posterior near the heaviest cloud, found by Gauss-Newton
//!   in the map as it is ([`Evaluator::propagate`]). It can be relied on when no other place is left and the evidence for it,
//!   accumulated over the steps, is large enough (`estimate`).

use crate::evaluator::cholesky::{Cholesky, packed, unpacked};
use crate::evaluator::failover::Failover;
use crate::evaluator::pose::LocalPose;
use crate::evaluator::tiles::{Tile, reach, tiles};
use crate::evaluator::{Advance, Evaluator, ITERATIONS, Mode, Propagation, Scene, Start, Weighed, best_modes};
use crate::filter::recovery::Recovery;
use crate::filter::weights::{effective_sample_size, normalised};
use crate::geometry::Pose;
use crate::gpu::DeviceError;
use crate::grid::FreeArea;
use crate::log::LogEntry;
use crate::map::LineMap;
use crate::motion::Motion;
use crate::random::Draw;
use crate::report::{
    Confidence, Estimate, Estimator, Event, ReportedParticle, RunResult, StageTimes, StepReport, timed,
};
use crate::scan::Scan;
use crate::tracking::Tracker;
use crate::tracking::starts::LEVER;
use bins::BIN;
use clouds::Clouds;
use drawing::{Drawn, in_order};
use estimate::{best_known, is_plausible};
use nalgebra::{Matrix3, Point2};
use walls::Walls;

pub use beginning::{Beginning, BeginningError, find_beginning};
pub use config::LocalizationConfig;

mod beginning;
mod bins;
mod clouds;
mod config;
mod drawing;
mod estimate;
mod walls;

/// Prior of the first pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InitialPose {
    /// Most likely pose.
    pub world_from_robot: Pose,
    /// Standard deviation of its position, in x and y alike \[m\].
    pub position_sigma: f64,
    /// Standard deviation of its heading \[rad\].
    pub heading_sigma: f64,
}

/// Why a robot cannot be localised in a map.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LocalizationError {
    /// There is no wall that a scan could show.
    #[error("the map has no wall")]
    NoWall,
    /// Particles are drawn from the free area.
    #[error("the map does not tell where a robot can be")]
    NoFreeArea,
}

/// The filter.
///
/// The covariance of an [`Estimate`] is that of the pose given that the robot is in this place and not in another. At a step it
/// is the inverse information at the mode of the posterior of scan and cloud, plus 5 cm and 0.02 rad, as no map is more exact;
/// between steps, the covariance of the motion since the step is added. The probability of other places is in the
/// [`Confidence`].
#[derive(Debug)]
pub struct Localization {
    config: LocalizationConfig,
    free: FreeArea,
    walls: Walls,
    evaluator: Failover,
    particles: Vec<LocalPose>,
    /// Share of the weight that each of them has before it is weighed.
    shares: Vec<f64>,
    /// Accumulated evidence for the place of each of them.
    evidence: Vec<f64>,
    /// Standard deviation across a wall while particles are weighed, and in the first steps of a climb \[m\].
    capture_sigma: f64,
    /// Accumulated evidence for the estimate.
    best_evidence: f64,
    recovery: Recovery,
    /// Share of the particles that are drawn from the whole free area at the next step.
    from_anywhere: f64,
    /// The estimate of the last step.
    last: Option<Located>,
    estimates: Vec<Estimate>,
    steps: u32,
    /// Laser readings so far.
    scans: u32,
    /// The motion since the last step; scans correct it where the robot is located.
    tracker: Tracker,
    /// Times of tracking since the last step.
    times: StageTimes,
}

/// The pose of a step, and how far it can be relied on.
#[derive(Clone, Copy, Debug)]
struct Located {
    world_from_robot: Pose,
    /// Of (forward, sideways, heading) in the robot's own frame.
    covariance: Matrix3<f64>,
    confidence: Confidence,
}

/// Smallest standard deviation across a wall while particles are weighed \[m\]: walls are known far more exactly than
/// neighbouring particles are apart.
const MIN_SIGMA: f64 = 0.1;
/// Largest standard deviation across a wall while particles are weighed \[m\]: the size of a bin of KLD sampling. Between the
/// two limits it is half the distance of neighbouring particles. With thinner walls, a particle that is close to a wrong pose by
/// chance would win against the right one, which no particle is close to.
const MAX_SIGMA: f64 = 0.5;

impl Localization {
    /// A filter before the first reading, with a configuration that [`LocalizationConfig::validate`] accepts. The map and the
    /// initial pose are in the world's frame; without an initial pose the robot may be anywhere in the free area. Without an
    /// evaluator, or when it fails, particles are evaluated on the CPU.
    ///
    /// # Errors
    /// The map has no wall, or its free area is not known.
    pub fn new(
        map: LineMap,
        initial: Option<InitialPose>,
        config: LocalizationConfig,
        evaluator: Option<Box<dyn Evaluator>>,
    ) -> Result<Self, LocalizationError> {
        let free = map.free.ok_or(LocalizationError::NoFreeArea)?;
        if map.clusters.is_empty() {
            return Err(LocalizationError::NoWall);
        }
        let mut this = Self {
            config,
            free,
            walls: Walls::new(map.clusters, &config.likelihood),
            evaluator: Failover::new(evaluator),
            particles: Vec::new(),
            shares: Vec::new(),
            evidence: Vec::new(),
            capture_sigma: MAX_SIGMA,
            best_evidence: 0.0,
            // As if scans had been just good enough.
            recovery: Recovery::new(config.located_explained),
            from_anywhere: 0.0,
            last: None,
            estimates: Vec::new(),
            steps: 0,
            scans: 0,
            tracker: Tracker::new(config.motion, config.tracking),
            times: StageTimes::default(),
        };
        let first = this.first_particles(initial);
        this.replace_particles(first);
        Ok(this)
    }

    /// Forgets where the robot may be, and begins again around this pose.
    pub fn begin_at(&mut self, initial: InitialPose) {
        let first = self.first_particles(Some(initial));
        self.replace_particles(first);
        self.best_evidence = 0.0;
        self.recovery = Recovery::new(self.config.located_explained);
        self.from_anywhere = 0.0;
        self.last = None;
        self.tracker.begin_step();
    }

    /// Tracks the robot; takes a step at the first scan with points and whenever the robot has moved far enough.
    fn add_scan(&mut self, scan: &Scan, odom_from_robot: Pose, observe: &mut dyn FnMut(&Event<'_>)) {
        self.scans += 1;
        let tiles = tiles(&scan.points, self.config.likelihood.max_points);
        // A scan without points does not constrain the pose.
        if tiles.is_empty() {
            return;
        }
        let mut times = std::mem::take(&mut self.times);
        timed(&mut times.track, || self.track(&tiles));
        self.times = times;
        if self.last.is_none() || !self.config.tracking.is_too_near(self.tracker.tracked().mean) {
            self.step(scan, &tiles, odom_from_robot, observe);
        }
    }

    /// One step of the filter: predict and weigh, normalise, estimate, resample.
    fn step(&mut self, scan: &Scan, tiles: &[Tile], odom_from_robot: Pose, observe: &mut dyn FnMut(&Event<'_>)) {
        let mut times = std::mem::take(&mut self.times);
        let weighed = timed(&mut times.weigh, || self.predict_and_weigh(tiles));
        let temper = self.config.temper;
        let log_weight = |(weighed, share): (&Weighed, &f64)| share.ln() + temper * f64::from(weighed.log_likelihood);
        let log_weights: Vec<f64> = weighed.iter().zip(&self.shares).map(log_weight).collect();
        let mut weights = normalised(&log_weights);
        let (clouds, located) = timed(&mut times.estimate, || {
            let clouds = Clouds::of(&weighed, &self.shares);
            let located = self.estimate(&weighed, &mut weights, &clouds, tiles);
            (clouds, located)
        });
        let parents = timed(&mut times.resample, || {
            let drawn = self.resample(&weighed, &weights, &clouds, self.from_anywhere);
            self.replace_particles(drawn)
        });

        let anchor = self.walls.table.anchor();
        let reported = |(weighed, &weight): (&Weighed, &f64)| ReportedParticle {
            world_from_robot: weighed.pose.in_world(anchor),
            weight,
        };
        let particles: Vec<ReportedParticle> = weighed.iter().zip(&weights).map(reported).collect();
        observe(&Event::Step(&StepReport {
            step: self.steps,
            stamp: scan.stamp,
            scan,
            scan_clusters: &[],
            odom_from_robot,
            world_from_robot: located.world_from_robot,
            particles: &particles,
            map: &self.walls.clusters,
            effective_sample_size: effective_sample_size(&weights),
            resampled: true,
            parents: &parents,
            confidence: Some(located.confidence),
            times,
        }));
        self.last = Some(located);
        self.tracker.begin_step();
        self.steps += 1;
    }

    /// Draws the motion of every particle (eq. 17) and weighs it (eq. 18), with walls thickened to the spacing of particles.
    fn predict_and_weigh(&mut self, tiles: &[Tile]) -> Vec<Weighed> {
        let Pose { x, y, heading } = self.tracker.tracked().mean;
        let how = Advance {
            seed: self.config.seed,
            step: self.steps,
            motion: [x, y, heading].map(|number| number as f32),
            noise: Cholesky::of_covariance(&self.tracker.by_odometry().covariance),
            capture_sigma: self.capture_sigma as f32,
        };
        let scene = Scene { table: &self.walls.table, tiles, maps: &self.walls.slots };
        let mut weighed = self.evaluator.advance(&scene, &how, &self.particles);
        weighed.iter_mut().for_each(|weighed| weighed.pose.heading = crate::math::wrap(weighed.pose.heading));
        weighed
    }

    /// Between steps, scan matching tracks a robot that is located: odometry may be far off by the next step.
    fn track(&mut self, tiles: &[Tile]) {
        let Some(last) = self.last.filter(|last| last.confidence.is_located) else { return };
        let anchor = self.walls.table.anchor();
        let Motion { mean, covariance } = self.tracker.tracked();
        let expected = LocalPose::new(last.world_from_robot * mean, anchor).in_world(Point2::origin());
        let found = self.climb(expected, &covariance, tiles, true);
        let mean = found.pose.in_world(anchor).seen_from(last.world_from_robot);
        // In a long corridor, or where the map has few walls, scan matching may hold the pose back while the robot drives on.
        if is_plausible(mean, &self.tracker.by_odometry(), best_known(1.0)) {
            let covariance = unpacked(found.information).try_inverse().unwrap_or(covariance);
            self.tracker.correct(Motion { mean, covariance });
        }
    }

    /// The mode of the posterior of the scan near a pose in the evaluator's frame; the prior's covariance is of (forward,
    /// sideways, heading) in the frame of that pose. With heavy tails, starts cover gross errors of odometry too.
    fn climb(&mut self, mean: Pose, covariance: &Matrix3<f64>, tiles: &[Tile], is_heavy_tailed: bool) -> Mode {
        let mean = LocalPose::new(mean, Point2::origin());
        let information = covariance.try_inverse().unwrap_or_else(Matrix3::zeros);
        let how = Propagation {
            seed: self.config.seed,
            step: self.scans,
            draw: Draw::Tracking,
            starts: &[Start { mean, prior: mean }],
            particles_per_map: self.config.tracking.starts.max(1) as usize,
            // The expected pose.
            exact_first: true,
            is_heavy_tailed,
            noise: Cholesky::of_covariance(covariance),
            prior_information: packed(&information),
            iterations: ITERATIONS,
            capture_sigma: self.capture_sigma as f32,
            spread: 0.0,
        };
        let reach = reach(tiles) + how.longest_way();
        let maps = [self.walls.table.near(&self.walls.slots[0], mean.x, mean.y, reach)];
        let scene = Scene { table: &self.walls.table, tiles, maps: &maps };
        let modes = self.evaluator.propagate(&scene, &how).into_iter().map(|proposal| proposal.mode);
        best_modes(modes, 1).first().copied().unwrap_or_default()
    }

    /// Replaces the particles, sorted by place, and sets the thickness of walls to their spacing. Returns the parent of each.
    fn replace_particles(&mut self, Drawn { particles, bins }: Drawn) -> Vec<u32> {
        let volume = bins as f64 * BIN.iter().product::<f64>() / particles.len().max(1) as f64;
        self.capture_sigma = (0.5 * (LEVER * volume).cbrt()).clamp(MIN_SIGMA, MAX_SIGMA);
        let particles = in_order(particles);
        self.particles = particles.iter().map(|particle| particle.pose).collect();
        self.shares = particles.iter().map(|particle| particle.share).collect();
        self.evidence = particles.iter().map(|particle| particle.evidence).collect();
        particles.iter().map(|particle| particle.parent).collect()
    }
}

impl Estimator for Localization {
    fn add(&mut self, entry: &LogEntry, observe: &mut dyn FnMut(&Event<'_>)) {
        let (stamp, odom_from_robot) = match entry {
            LogEntry::Truth { .. } => return,
            LogEntry::Turn { by_gyro, .. } => {
                self.tracker.turn(*by_gyro);
                return;
            }
            LogEntry::Odometry { stamp, odom_from_robot } => {
                self.tracker.add(*stamp, *odom_from_robot);
                (*stamp, *odom_from_robot)
            }
            LogEntry::Laser(reading) => {
                self.tracker.add(reading.stamp, reading.odom_from_robot);
                let scan = Scan::from_reading(reading, &self.config.scan);
                observe(&Event::Scan(&scan));
                self.add_scan(&scan, reading.odom_from_robot, observe);
                (reading.stamp, reading.odom_from_robot)
            }
        };
        let of_step = |last: Located| Motion { mean: last.world_from_robot, covariance: last.covariance };
        let placed = self.last.map(|last| of_step(last).then(&self.tracker.tracked()));
        let estimate = Estimate {
            stamp,
            odom_from_robot,
            world_from_robot: placed.map(|placed| placed.mean),
            covariance: placed.map(|placed| placed.covariance_in_earlier_frame()),
            confidence: self.last.map(|last| last.confidence),
        };
        self.estimates.push(estimate);
        observe(&Event::Pose(&estimate));
    }

    fn result(&self) -> RunResult {
        let map = LineMap { clusters: self.walls.clusters.clone(), free: Some(self.free.clone()) };
        RunResult {
            map,
            poses: self.estimates.clone(),
            refused_odometry: self.tracker.refused().to_vec(),
            odometry_errors: self.tracker.odometry_errors(),
            gyro: self.tracker.gyro(),
            loops: Vec::new(),
            earlier: Vec::new(),
            looked_through: 0.0,
            objects: None,
        }
    }

    fn evaluator_failure(&self) -> Option<&DeviceError> {
        self.evaluator.failure()
    }
}

#[cfg(test)]
mod tests {
    use super::estimate::Cloud;
    use super::*;
    use crate::grid::{Cell, OccupancyGrid};
    use crate::motion::MotionConfig;
    use crate::ppca::Cluster;
    use crate::tracking::TrackingConfig;
    use std::f64::consts::TAU;

    /// A metre forward, turning to the left, known to 12 cm (with the 5 cm of a top to 13 cm) and 0.048 rad (0.052):
    /// √11.345 = 3.37 standard deviations are 44 cm and 0.175 rad.
    #[test]
    fn the_robot_is_expected_where_its_motion_leads_to() {
        let grid = OccupancyGrid::new(1.0, Pose::IDENTITY, 1, 1, vec![Cell::Free]).unwrap();
        let free = FreeArea::from_grid(&grid, []);
        let mut filter =
            Localization::new(LineMap { clusters: room(), free }, None, LocalizationConfig::default(), None).unwrap();
        filter.walls.log_peak = -(0.01 * TAU.sqrt()).ln();
        assert!(filter.is_expected(Pose::new(100.0, 0.0, 0.0)), "nothing is known at first");
        let world_from_robot = Pose::new(5.0, 3.0, 3.1);
        let confidence = Confidence { weight: 1.0, explained: 1.0, is_located: false };
        filter.last = Some(Located { world_from_robot, covariance: Matrix3::zeros(), confidence });
        filter.tracker = moved(Pose::new(1.0, 0.0, 0.1), 0.12, 0.048);
        let is_expected = |x, y, turn| filter.is_expected(world_from_robot * Pose::new(1.0 + x, y, 0.1 + turn));
        assert!(is_expected(0.0, 0.0, 0.0) && is_expected(0.43, 0.0, 0.0) && is_expected(0.0, -0.43, 0.0));
        assert!(is_expected(0.0, 0.0, 0.17) && is_expected(0.0, 0.0, -0.17));
        assert!(!is_expected(0.45, 0.0, 0.0) && !is_expected(0.0, -0.45, 0.0) && !is_expected(0.0, 0.0, 0.18));
        assert!(!is_expected(0.33, 0.33, 0.0), "both together");

        // Walls that are known to 16 cm: with the 12 cm of the motion 20 cm, of which 3.37 are 67 cm.
        filter.walls.log_peak = -(0.16 * TAU.sqrt()).ln();
        let is_expected = |x| filter.is_expected(world_from_robot * Pose::new(1.0 + x, 0.0, 0.1));
        assert!(is_expected(0.67) && !is_expected(0.68));
    }

    /// A wall that is known to 1 cm.
    fn wall(a: [f64; 2], b: [f64; 2]) -> Cluster {
        Cluster::wall(a, b, 0.01, 100.0)
    }

    /// Odometry of one motion that takes ten seconds, known to these standard deviations \[m, rad\].
    fn moved(mean: Pose, position_floor: f64, heading_floor: f64) -> Tracker {
        let motion = MotionConfig {
            position_per_distance: 0.0,
            position_per_turn: 0.0,
            heading_per_distance: 0.0,
            heading_per_turn: 0.0,
            position_floor,
            heading_floor,
            stamp_error: 0.0,
        };
        let mut tracker = Tracker::new(motion, TrackingConfig::default());
        tracker.add(0.0, Pose::IDENTITY);
        tracker.add(10.0, mean);
        tracker
    }

    /// The walls of a room of 6 by 4 m.
    fn room() -> Vec<Cluster> {
        let corners = [[0.0, 0.0], [6.0, 0.0], [6.0, 4.0], [0.0, 4.0]];
        (0..4).map(|side| wall(corners[side], corners[(side + 1) % 4])).collect()
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
        let map = LineMap { clusters, free: FreeArea::from_grid(&grid, []) };
        let mut filter = Localization::new(map, None, LocalizationConfig::default(), None).unwrap();
        let confidence = Confidence { weight: 1.0, explained: 1.0, is_located: true };
        filter.last = Some(Located { world_from_robot: before, covariance: Matrix3::zeros(), confidence });
        filter
    }

    /// What it thinks of a cloud around the robot.
    fn locate(mut filter: Localization) -> Confidence {
        let mean = LocalPose::new(ROBOT, filter.walls.table.anchor()).in_world(Point2::origin());
        let cloud = Cloud { mean, covariance: Matrix3::identity() * 0.01, weight: 1.0 };
        let place = filter.evaluate(&cloud, 10.0, &tiles_seen());
        let Located { world_from_robot, confidence, .. } = filter.judge(&place, true);
        let off = world_from_robot.seen_from(ROBOT);
        assert!(off.x.hypot(off.y) < 0.01 && off.heading.abs() < 0.01, "{world_from_robot:?}");
        confidence
    }

    #[test]
    fn a_robot_that_is_placed_is_looked_for_there_alone() {
        let mut filter = filter(room(), ROBOT);
        (filter.best_evidence, filter.from_anywhere) = (9.0, 0.5);
        let there = Pose::new(4.5, 2.5, -2.0);
        filter.begin_at(InitialPose { world_from_robot: there, position_sigma: 0.1, heading_sigma: 0.05 });
        assert!(filter.last.is_none() && filter.best_evidence == 0.0 && filter.from_anywhere == 0.0);
        let anchor = filter.walls.table.anchor();
        let off = |pose: &LocalPose| pose.in_world(anchor).seen_from(there);
        // Five standard deviations; the robot was ten times as far away.
        assert!(filter.particles.iter().map(off).all(|off| off.x.hypot(off.y) < 0.5 && off.heading.abs() < 0.25));
        assert!(filter.particles.len() > 100 && ROBOT.seen_from(there).x.abs() > 0.5);
    }

    /// The scan, the cloud and the map are the same; only the pose of the last step differs.
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
        let confidence = |x: f64| locate(filter([room(), vec![wall([x, 0.0], [x, 4.0])]].concat(), ROBOT));
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

    /// All particles are in one cloud, where scans fit badly: however few there are, some come from anywhere.
    #[test]
    fn a_robot_that_was_carried_away_is_sought_by_few_particles_too() {
        for count in [10, 1000] {
            let mut filter = filter(room(), ROBOT);
            (filter.config.max_particles, filter.config.min_particles) = (count, count);
            let pose = LocalPose::new(ROBOT, filter.walls.table.anchor());
            let (weighed, weights) =
                (vec![Weighed { pose, log_likelihood: 0.0 }; count], vec![1.0 / count as f64; count]);
            filter.evidence = vec![0.0; count];
            let clouds = Clouds::of(&weighed, &weights);
            let new = |from_anywhere: f64| {
                let Drawn { particles, .. } = filter.resample(&weighed, &weights, &clouds, from_anywhere);
                assert!(particles.len() <= count && particles.len() >= count / 2, "{} of {count}", particles.len());
                particles.iter().filter(|particle| particle.parent == u32::MAX).count()
            };
            assert_eq!((new(0.0), new(0.1), new(0.9)), (0, count / 10, count / 4));
        }
    }

    /// The scan says that the robot stands still.
    #[test]
    fn the_scan_corrects_odometry_but_cannot_hold_back_the_robot() {
        let tracked = |odometry: f64| {
            let mut filter = filter(room(), ROBOT);
            let mean = Pose::new(odometry, 0.0, 0.0);
            filter.tracker = moved(mean, 0.05, 0.05);
            let by_odometry = filter.tracker.by_odometry();
            filter.tracker.correct(Motion { mean, covariance: Matrix3::identity() });
            filter.track(&tiles_seen());
            assert_eq!(filter.tracker.by_odometry(), by_odometry);
            filter.tracker.tracked()
        };
        // √11.345 √(0.05² + 0.05²) are 0.238 m.
        let Motion { mean, covariance } = tracked(0.22);
        assert!(mean.x.hypot(mean.y) < 0.01 && mean.heading.abs() < 0.01, "{mean:?}");
        // What the scan says, and the floor.
        assert!(covariance.diagonal().iter().all(|variance| (0.0025..0.0035).contains(variance)), "{covariance}");
        assert_eq!(tracked(0.26).mean, Pose::new(0.26, 0.0, 0.0));
    }
}
