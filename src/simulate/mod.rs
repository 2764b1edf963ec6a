//! A simulated robot: worlds of any size, a drive through them, a laser, drifting odometry and the truth.
//!
//! | part | what it is |
//! |---|---|
//! | [`Plan`] | a floor plan and a tour: [`building()`] is built in, [`random_offices`] draws one of any size, the parts of [`look_alike_wings`] are alike |
//! | [`World`] | the walls, and exact ray casting against them |
//! | [`Step`] | the true motion, ten steps a second |
//! | [`OdometryNoise`] | true motion to reported motion |
//! | [`Laser`] | true pose to ranges |
//! | [`Object`] | what a detector of objects can see, and how it errs |
//! | [`Simulation`] | all of it as a log that can be mapped directly |
//! | [`Damage`] | any log, made harder |
//!
//! The world's frame is that of the plan. Odometry starts at the true pose, so that `odom` and `world` are one frame at
//! the start of a log and drift apart from there. Random numbers come from ChaCha8 with one stream for each use, so the
//! same seed gives the same log.

mod building;
mod damage;
mod drive;
mod laser;
mod objects;
mod odometry;
mod offices;
mod plan;
mod wings;
mod world;

pub use building::building;
pub use damage::Damage;
use drive::Drive;
pub use drive::{STEP_RATE, Step, arc};
pub use laser::Laser;
pub use objects::{Object, camera};
pub use odometry::OdometryNoise;
pub use offices::random_offices;
pub use plan::Plan;
pub use wings::look_alike_wings;
pub use world::{Wall, World};

use crate::detections::{Frame, Sensors};
use crate::geometry::{Pose, StampedPose};
use crate::log::{LaserReading, LogEntry, LogError, LogReader, LogSource, LogStats};
use nalgebra::Point2;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use std::collections::VecDeque;
use std::sync::Arc;

/// Steps from one sweep of the laser to the next: five sweeps a second.
const STEPS_PER_SWEEP: u64 = 2;

/// What each stream of random numbers is for.
#[derive(Clone, Copy)]
enum Stream {
    Odometry = 0,
    Laser = 1,
    World = 2,
    Detector = 3,
}

fn generator(seed: u64, stream: Stream) -> ChaCha8Rng {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(stream as u64);
    generator
}

/// An option of the simulation that cannot be.
#[derive(Debug, thiserror::Error)]
#[error("{what} is {value}, but has to be {expected}")]
pub struct SimulationError {
    what: &'static str,
    value: String,
    expected: &'static str,
}

impl SimulationError {
    fn new(what: &'static str, value: impl ToString, expected: &'static str) -> Self {
        Self { what, value: value.to_string(), expected }
    }
}

/// What can be chosen about a simulation, besides its plan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SimulationConfig {
    /// Seed of all noise.
    pub seed: u64,
    /// The laser.
    pub laser: Laser,
    /// Errors of the odometry.
    pub odometry: OdometryNoise,
    /// Seconds to drive, at most a million, repeating the tour as often as it takes; `None` drives it once.
    pub duration: Option<f64>,
}

/// A log that is made while it is read: odometry ten times a second, the laser and the truth five times.
///
/// Memory holds the walls and the way-points, however long the drive. Every reader starts at the first entry and gets
/// the same entries. Stamps start at 0.
#[derive(Clone, Debug)]
pub struct Simulation {
    name: String,
    world: Arc<World>,
    tour: Arc<[Point2<f64>]>,
    objects: Arc<[Object]>,
    config: SimulationConfig,
    steps: u64,
}

impl Simulation {
    /// The built-in building, driven once (about five minutes) with the default laser and odometry.
    pub fn building(seed: u64) -> Self {
        Self::assemble("building".to_owned(), building(), SimulationConfig { seed, ..SimulationConfig::default() })
    }

    /// A simulation of any plan.
    ///
    /// # Errors
    /// Fails on options outside the ranges that their documentation gives, on a tour that does not lead 2 m away from
    /// its start or not back to it, and on coordinates more than 1000 km from the origin or not finite.
    pub fn new(name: String, plan: Plan, config: SimulationConfig) -> Result<Self, SimulationError> {
        config.check()?;
        let ends = plan.walls.iter().flat_map(|wall| [wall.a, wall.b]);
        if let Some(point) = ends.chain(plan.tour.iter().copied()).find(|p| !(p.x.abs() <= 1e6 && p.y.abs() <= 1e6)) {
            return Err(SimulationError::new("a point of the plan", point, "within 1000 km of the origin"));
        }
        let start = plan.tour.first().copied().unwrap_or_default();
        let farthest = plan.tour.iter().map(|point| (point - start).norm()).fold(0.0, f64::max);
        if farthest < 2.0 {
            return Err(SimulationError::new("the tour's farthest way from its start", farthest, "2 m or more"));
        }
        if let Some(end) = plan.tour.last().filter(|&&end| end != start) {
            return Err(SimulationError::new("the tour's end", end, "where it starts"));
        }
        Ok(Self::assemble(name, plan, config))
    }

    fn assemble(name: String, plan: Plan, config: SimulationConfig) -> Self {
        let tour: Arc<[Point2<f64>]> = plan.tour.into();
        let steps = match config.duration {
            Some(seconds) => (seconds * STEP_RATE) as u64 + 1,
            None => Drive::new(Arc::clone(&tour), false).count() as u64,
        };
        let (world, objects) = (Arc::new(World::new(plan.walls)), plan.objects.into());
        Self { name, world, tour, objects, config, steps }
    }

    /// The walls.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// What was chosen.
    pub fn config(&self) -> &SimulationConfig {
        &self.config
    }

    /// How many sweeps of the laser the log holds.
    pub fn sweeps(&self) -> u64 {
        self.steps.div_ceil(STEPS_PER_SWEEP)
    }

    /// The true motion, ten steps a second from second 0.
    pub fn steps(&self) -> impl Iterator<Item = Step> + use<> {
        self.drive().zip(0..self.steps).map(|(step, _)| step)
    }

    /// `world_from_robot` at every sweep of the laser.
    pub fn truth(&self) -> impl Iterator<Item = StampedPose> + use<> {
        let steps = self.steps().zip(0u64..).step_by(STEPS_PER_SWEEP as usize);
        steps.map(|(step, index)| StampedPose { stamp: stamp(index), pose: step.world_from_robot })
    }

    /// What a detector of objects sees at every sweep of the laser. The classes are those of the plan.
    pub fn frames(&self, sensors: &Sensors) -> Vec<Frame> {
        let mut rng = generator(self.config.seed, Stream::Detector);
        let frame = |at: StampedPose| objects::frame(at.stamp, &self.world, &self.objects, at.pose, sensors, &mut rng);
        self.truth().map(frame).collect()
    }

    fn drive(&self) -> Drive {
        Drive::new(Arc::clone(&self.tour), self.config.duration.is_some())
    }
}

impl LogSource for Simulation {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn open(&self) -> Result<Box<dyn LogReader>, LogError> {
        Ok(Box::new(SimulationReader {
            drive: self.drive(),
            simulation: self.clone(),
            odometry_rng: generator(self.config.seed, Stream::Odometry),
            laser_rng: generator(self.config.seed, Stream::Laser),
            odom_from_robot: Pose::IDENTITY,
            step: 0,
            pending: VecDeque::new(),
            stats: LogStats::default(),
            handed_out: 0,
        }))
    }
}

struct SimulationReader {
    simulation: Simulation,
    drive: Drive,
    odometry_rng: ChaCha8Rng,
    laser_rng: ChaCha8Rng,
    odom_from_robot: Pose,
    step: u64,
    /// Entries of the current step that were not handed out yet.
    pending: VecDeque<LogEntry>,
    stats: LogStats,
    handed_out: u64,
}

impl SimulationReader {
    /// Drives one step and makes its entries.
    fn advance(&mut self) -> Option<()> {
        if self.step >= self.simulation.steps {
            return None;
        }
        let step = self.drive.next()?;
        let SimulationConfig { laser, odometry, .. } = self.simulation.config;
        self.odom_from_robot = if self.step == 0 {
            step.world_from_robot
        } else {
            let (distance, turn) = odometry.measure(&step, &mut self.odometry_rng);
            self.odom_from_robot * arc(distance, turn)
        };
        let (stamp, odom_from_robot) = (stamp(self.step), self.odom_from_robot);
        self.pending.push_back(LogEntry::Odometry { stamp, odom_from_robot });
        if self.step.is_multiple_of(STEPS_PER_SWEEP) {
            self.pending.push_back(LogEntry::Laser(LaserReading {
                stamp,
                odom_from_robot,
                robot_from_laser: laser.robot_from_laser,
                start_from_end: Pose::IDENTITY,
                first_angle: laser.first_angle(),
                angle_step: laser.angle_step(),
                max_range: laser.max_range,
                ranges: laser.sweep(&self.simulation.world, step.world_from_robot, &mut self.laser_rng),
            }));
            self.pending.push_back(LogEntry::Truth { stamp, world_from_robot: step.world_from_robot });
        }
        self.step += 1;
        Some(())
    }
}

impl Iterator for SimulationReader {
    type Item = Result<LogEntry, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.pending.is_empty() {
            self.advance()?;
        }
        let entry = self.pending.pop_front()?;
        self.handed_out += 1;
        match entry {
            LogEntry::Odometry { .. } => self.stats.odometry += 1,
            LogEntry::Laser(_) => self.stats.laser += 1,
            LogEntry::Turn { .. } | LogEntry::Truth { .. } => {}
        }
        Some(Ok(entry))
    }
}

impl LogReader for SimulationReader {
    fn stats(&self) -> &LogStats {
        &self.stats
    }

    /// Entries handed out so far and in all.
    fn progress(&self) -> Option<(u64, u64)> {
        Some((self.handed_out, self.simulation.steps + 2 * self.simulation.sweeps()))
    }
}

impl SimulationConfig {
    fn check(&self) -> Result<(), SimulationError> {
        let Self { laser, odometry, .. } = self;
        if !(2..=100_000).contains(&laser.beams) {
            return Err(SimulationError::new("number of beams", laser.beams, "2 to 100000"));
        }
        let positive = |value: f64| value > 0.0 && value.is_finite();
        let spread = |value: f64| (0.0..1e6).contains(&value);
        let share = |value: f64| (0.0..=1.0).contains(&value);
        let bias = |value: f64| value.abs() <= 1.0;
        let checks = [
            ("field of view", laser.field_of_view, laser.field_of_view <= std::f64::consts::TAU, "at most 2π rad"),
            ("field of view", laser.field_of_view, positive(laser.field_of_view), "above 0 rad"),
            ("maximum range", laser.max_range, positive(laser.max_range), "above 0 m and finite"),
            ("range noise", laser.range_noise, spread(laser.range_noise), "0 m or more"),
            ("share of dropouts", laser.dropouts, share(laser.dropouts), "0 to 1"),
            ("share of sweeps with people", laser.people, share(laser.people), "0 to 1"),
            ("distance bias of the odometry", odometry.distance_bias, bias(odometry.distance_bias), "-1 to 1"),
            ("turn bias of the odometry", odometry.turn_bias, bias(odometry.turn_bias), "-1 to 1"),
            ("veer of the odometry", odometry.veer, bias(odometry.veer), "-1 to 1 rad/m"),
            (
                "distance spread of the odometry",
                odometry.distance_spread,
                spread(odometry.distance_spread),
                "0 or more",
            ),
            ("turn spread of the odometry", odometry.turn_spread, spread(odometry.turn_spread), "0 or more"),
            ("veer spread of the odometry", odometry.veer_spread, spread(odometry.veer_spread), "0 or more"),
        ];
        let duration =
            self.duration.map(|seconds| ("duration", seconds, (0.0..=1e6).contains(&seconds), "0 to 1000000 s"));
        match checks.into_iter().chain(duration).find(|check| !check.2) {
            Some((what, value, _, expected)) => Err(SimulationError::new(what, value, expected)),
            None if !laser.robot_from_laser.is_finite() => {
                Err(SimulationError::new("pose of the laser", format!("{:?}", laser.robot_from_laser), "finite"))
            }
            None => Ok(()),
        }
    }
}

/// Seconds since the start.
fn stamp(step: u64) -> f64 {
    step as f64 / STEP_RATE
}
