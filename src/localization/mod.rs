//! Where is the robot in a map that is known? Adaptive Monte Carlo localisation.
//!
//! Without an initial pose, particles start all over the free area, a million of them if need be; every step moves and
//! weighs them ([`Evaluator::advance`], eq. 17 and 18) in the one map that they share. Three things make it practical:
//!
//! - The number of particles follows the doubt ([`kld`](crate::filter::kld)): as many as it takes to tell the bins apart that particles are
//!   found in, from the whole free area down to a thousand.
//! - Particles that hang together are a place where the robot may be (`clouds`). Each is drawn from by itself and keeps its
//!   weight (`drawing`), and what a map lacks speaks against none (`estimate::held_back`): places that look alike are all kept
//!   until something tells them apart.
//! - Where scans fit worse than they used to, particles from anywhere are mixed in ([`recovery`](crate::filter::recovery)),
//!   so that a robot that was carried away is found again.
//! - The estimate is not the mean of the particles but the top of the posterior around their heaviest cloud, climbed to in
//!   the map as it is ([`Evaluator::propagate`]). It can be relied on where no other place is left, and where what the map
//!   explains of the scans speaks for it over all the way (`estimate`).

use crate::evaluator::cholesky::{Cholesky, packed, unpacked};
use crate::evaluator::failover::Failover;
use crate::evaluator::pose::LocalPose;
use crate::evaluator::tiles::{Tile, reach, tiles};
use crate::evaluator::{Advance, Evaluator, ITERATIONS, Mode, Propagation, Scene, Start, Weighed, best_mode};
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
use clouds::{Clouds, LIGHTEST_CLOUD};
use drawing::{BIN, Drawn, in_order};
use estimate::{BEST_KNOWN, Cloud, Place, best_known, credit, held_back, is_plausible};
use nalgebra::{Matrix3, Point2};
use walls::Walls;

pub use config::LocalizationConfig;

mod clouds;
mod config;
mod drawing;
mod estimate;
mod walls;

/// Where the robot is believed to be at first.
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
    /// There is nothing that a scan could show.
    #[error("the map has no wall")]
    NoWall,
    /// Without the free area it is not known where particles may be.
    #[error("the map does not tell where a robot can be")]
    NoFreeArea,
}

/// The filter.
///
/// The covariance of an [`Estimate`] is that of the pose given that the robot is in this place and not in another: at a step,
/// the inverse of the information at the top of the posterior, of scan and cloud, and 5 cm and 0.02 rad that no map is better
/// than; between steps, that and what tracking leaves open since, carried to the reading. How likely another place is, the
/// [`Confidence`] tells.
#[derive(Debug)]
pub struct Localization {
    config: LocalizationConfig,
    free: FreeArea,
    walls: Walls,
    evaluator: Failover,
    particles: Vec<LocalPose>,
    /// Share of the weight that each of them has until it is weighed.
    shares: Vec<f64>,
    /// What speaks for the place of each of them.
    credits: Vec<f64>,
    /// Standard deviation across a wall while particles are weighed, and in the first steps of a climb \[m\].
    capture_sigma: f64,
    /// What speaks for the estimate.
    credit: f64,
    recovery: Recovery,
    /// Share of the particles that come from anywhere at the next step.
    from_anywhere: f64,
    /// The estimate of the last step.
    last: Option<Located>,
    estimates: Vec<Estimate>,
    steps: u32,
    /// Laser readings so far.
    scans: u32,
    /// The motion since the last step; scans correct it where the robot is located.
    tracker: Tracker,
    /// Of tracking between steps, since the last one.
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

/// Smallest standard deviation across a wall while particles are weighed \[m\]: a cell of KLD sampling holds many particles,
/// and what walls are known to is far less than what lies between two of them.
const MIN_SIGMA: f64 = 0.1;
/// Largest standard deviation across a wall while particles are weighed \[m\]: a bin of KLD sampling. In between it is half
/// the distance of neighbouring particles: fewer do not come closer to the true pose, and one that came close to a wrong one
/// by chance would win.
const MAX_SIGMA: f64 = 0.5;
/// A wall so far off \[m\] moves by as much when the robot turns as when it steps.
const LEVER: f64 = 5.0;

impl Localization {
    /// A filter that has seen nothing, with a configuration that [`LocalizationConfig::validate`] accepts. The map and the initial pose
    /// are in the world's frame; without an initial pose the robot may be anywhere in the free area. Without an evaluator,
    /// or where it fails, the CPU does its work.
    ///
    /// # Errors
    /// The map has no wall, or does not tell where a robot can be.
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
            walls: Walls::new(map.clusters, &config),
            evaluator: Failover::new(evaluator),
            particles: Vec::new(),
            shares: Vec::new(),
            credits: Vec::new(),
            capture_sigma: MAX_SIGMA,
            credit: 0.0,
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
        this.take(first);
        Ok(this)
    }

    /// Follows the robot; takes a step where it has moved far enough, and at the first scan with points.
    fn add_scan(&mut self, scan: &Scan, odom_from_robot: Pose, observe: &mut dyn FnMut(&Event<'_>)) {
        self.scans += 1;
        let tiles = tiles(&scan.points, self.config.likelihood.max_points);
        // A scan without points says nothing of where the robot is.
        if tiles.is_empty() {
            return;
        }
        let mut times = std::mem::take(&mut self.times);
        timed(&mut times.track, || self.track(&tiles));
        self.times = times;
        if self.steps == 0 || !self.config.tracking.is_too_near(self.tracker.tracked().mean) {
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
            self.take(drawn)
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

    /// Draws the motion of every particle (eq. 17) and weighs it (eq. 18), among walls as thick as particles are sparse.
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

    /// Between steps, a robot that is located is followed by its scans: odometry may be far off by the next step.
    fn track(&mut self, tiles: &[Tile]) {
        let Some(last) = self.last.filter(|last| last.confidence.is_located) else { return };
        let anchor = self.walls.table.anchor();
        let Motion { mean, covariance } = self.tracker.tracked();
        let expected = LocalPose::new(last.world_from_robot * mean, anchor).in_world(Point2::origin());
        let found = self.climb(expected, &covariance, tiles, true);
        let mean = found.pose.in_world(anchor).seen_from(last.world_from_robot);
        // In a long corridor, or where the map shows little, a scan may hold back the pose while the robot drives on.
        if is_plausible(mean, &self.tracker.by_odometry(), best_known(1.0)) {
            let covariance = unpacked(found.information).try_inverse().unwrap_or(covariance);
            self.tracker.correct(Motion { mean, covariance });
        }
    }

    /// Looks at every place where the robot may be, corrects their weights, and judges the heaviest.
    fn estimate(&mut self, weighed: &[Weighed], weights: &mut [f64], clouds: &Clouds, tiles: &[Tile]) -> Located {
        let mut places: Vec<Place> =
            clouds.clouds.iter().map(|members| self.place(members, weighed, weights, tiles)).collect();
        let most = self.config.temper * self.walls.most(tiles);
        let held = held_back(&places, most, self.config.located_explained);
        for ((place, members), factor) in places.iter_mut().zip(&clouds.clouds).zip(held) {
            place.scale(factor);
            members.iter().for_each(|&number| weights[number as usize] *= factor);
        }
        let total: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|weight| *weight /= total);
        places.iter_mut().for_each(|place| place.scale(1.0 / total));

        let fit = places.iter().map(|place| place.explained).fold(0.0, f64::max);
        let is_alone = places.iter().filter(|place| place.weight >= LIGHTEST_CLOUD).count() <= 1;
        let heaviest = places.into_iter().reduce(|a, b| if b.weight > a.weight { b } else { a });
        let heaviest = heaviest.unwrap_or_else(|| self.look(&Cloud::heaviest(weighed, weights), 0.0, tiles));
        self.from_anywhere = self.recovery.update(fit.max(heaviest.explained));
        self.judge(&heaviest, is_alone)
    }

    /// What there is to say of the place of a cloud. All of its particles take over what speaks for it.
    fn place(&mut self, members: &[u32], weighed: &[Weighed], weights: &[f64], tiles: &[Tile]) -> Place {
        let of = |numbers: &[f64]| members.iter().map(|&number| numbers[number as usize]).collect::<Vec<f64>>();
        let particles: Vec<Weighed> = members.iter().map(|&number| weighed[number as usize]).collect();
        let (weights, shares, credits) = (of(weights), of(&self.shares), of(&self.credits));
        let share: f64 = shares.iter().sum();
        let before = shares.iter().zip(credits).map(|(share, credit)| share * credit).sum::<f64>() / share;
        let cloud = Cloud::heaviest(&particles, &weights);
        let place = Place { share, weight: weights.iter().sum(), ..self.look(&cloud, before, tiles) };
        members.iter().for_each(|&number| self.credits[number as usize] = place.credit);
        place
    }

    /// The MAP estimate of the pose around a cloud, by Gauss-Newton steps from its mean, and what speaks for it.
    fn look(&mut self, cloud: &Cloud, before: f64, tiles: &[Tile]) -> Place {
        // Its few particles may lie in one place.
        let mode = self.climb(cloud.mean, &(cloud.covariance + best_known(1.0)), tiles, false);
        let world_from_robot = mode.pose.in_world(self.walls.table.anchor());
        let explained = self.walls.explained(world_from_robot, f64::from(mode.log_likelihood), tiles);
        let credit = credit(before, explained, &self.config);
        let covariance = unpacked(mode.information).try_inverse().unwrap_or(cloud.covariance) + best_known(1.0);
        Place {
            world_from_robot,
            covariance,
            share: 1.0,
            weight: cloud.weight,
            concentrated: cloud.weight,
            explained,
            credit,
        }
    }

    /// How far a place can be relied on.
    fn judge(&mut self, place: &Place, is_alone: bool) -> Located {
        self.credit = place.credit;
        let is_located = is_alone && self.is_expected(place.world_from_robot) && place.is_sure(&self.config);
        let confidence = Confidence { weight: place.concentrated, explained: place.explained, is_located };
        Located { world_from_robot: place.world_from_robot, covariance: place.covariance, confidence }
    }

    /// The top of the posterior of the scan around a pose of the evaluator's frame; the covariance is of (forward,
    /// sideways, heading) in its own. Where odometry may be wrong beyond reason, starts are drawn with heavy tails.
    fn climb(&mut self, mean: Pose, covariance: &Matrix3<f64>, tiles: &[Tile], is_heavy_tailed: bool) -> Mode {
        let mean = LocalPose::new(mean, Point2::origin());
        let information = covariance.try_inverse().unwrap_or_else(Matrix3::zeros);
        let how = Propagation {
            seed: self.config.seed,
            step: self.scans,
            draw: Draw::Tracking,
            starts: &[Start { mean, prior: mean }],
            particles_per_map: self.config.tracking.starts.max(1) as usize,
            // Where it is expected.
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
        best_mode(self.evaluator.propagate(&scene, &how)).unwrap_or_default()
    }

    /// Can the robot have come here since the last step? At a place that only looks like the right one the estimate jumps.
    /// Where walls are known badly it does so anywhere.
    fn is_expected(&self, world_from_robot: Pose) -> bool {
        let Some(last) = self.last else { return true };
        let times = (self.walls.sigma() / BEST_KNOWN.x).max(1.0);
        is_plausible(world_from_robot.seen_from(last.world_from_robot), &self.tracker.by_odometry(), best_known(times))
    }

    /// Goes on with these particles, in the order of their places, and with walls as thick as they are sparse. Returns the
    /// parent of each.
    fn take(&mut self, Drawn { particles, bins }: Drawn) -> Vec<u32> {
        let volume = bins as f64 * BIN.iter().product::<f64>() / particles.len().max(1) as f64;
        self.capture_sigma = (0.5 * (LEVER * volume).cbrt()).clamp(MIN_SIGMA, MAX_SIGMA);
        let particles = in_order(particles);
        self.particles = particles.iter().map(|particle| particle.pose).collect();
        self.shares = particles.iter().map(|particle| particle.share).collect();
        self.credits = particles.iter().map(|particle| particle.credit).collect();
        particles.iter().map(|particle| particle.parent).collect()
    }
}

impl Estimator for Localization {
    fn add(&mut self, entry: &LogEntry, observe: &mut dyn FnMut(&Event<'_>)) {
        let (stamp, odom_from_robot) = match entry {
            LogEntry::Truth { .. } => return,
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
            loops: Vec::new(),
            looked_through: 0.0,
        }
    }

    fn evaluator_failure(&self) -> Option<&DeviceError> {
        self.evaluator.failure()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Cell, OccupancyGrid};
    use crate::motion::MotionConfig;
    use crate::ppca::Cluster;
    use crate::tracking::TrackingConfig;
    use nalgebra::Vector2;
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

    /// A wall around its middle, known to 1 cm.
    fn wall(x: f64, y: f64, length: f64, direction: Vector2<f64>) -> Cluster {
        let along_variance = length * length / 12.0;
        Cluster { mean: Point2::new(x, y), direction, along_variance, across_variance: 1e-4, count: 100.0 }
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
        let place = filter.look(&cloud, 10.0, &tiles_seen());
        let Located { world_from_robot, confidence, .. } = filter.judge(&place, true);
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
