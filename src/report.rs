//! What estimators report: every reading, every step and the result, as [`Event`]s to observers, which record, draw or
//! write, and never steer.

use crate::geometry::{Pose, StampedPose};
use crate::gpu::DeviceError;
use crate::log::LogEntry;
use crate::map::LineMap;
use crate::objects::{Landmark, ObjectMap};
use crate::ppca::Cluster;
use crate::scan::Scan;
use crate::tracking::{GyroUse, OdometryErrors};
use crc32fast::Hasher;
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::Serialize;
use std::ops::AddAssign;
use web_time::Instant;

/// One thing after the other in a run.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Event<'a> {
    /// The next entry of the log, before anything that follows from it.
    Entry(&'a LogEntry),
    /// The points of a laser reading.
    Scan(&'a Scan),
    /// A step of the filter was taken.
    Step(&'a StepReport<'a>),
    /// Where the robot is, after each odometry and laser reading.
    Pose(&'a Estimate),
    /// The run is over; nothing follows.
    Finished {
        /// What it found.
        result: &'a RunResult,
        /// Whether it is what [`smoothing`](crate::smoothing) made of the whole log.
        is_smoothed: bool,
    },
}

/// Receives every event of a run. Errors are the observer's own to report: they never stop a run.
pub trait Observer {
    /// Handles an event.
    fn on_event(&mut self, event: &Event<'_>);

    /// Why the observer failed, if it did.
    fn failure(&self) -> Option<&str> {
        None
    }
}

/// What turns the entries of a log into poses: a filter, with a map that it makes or a map that is known.
pub trait Estimator {
    /// Takes in the next entry of a log, in the order of the log; reports the scan, step and pose that follow from it.
    fn add(&mut self, entry: &LogEntry, observe: &mut dyn FnMut(&Event<'_>));

    /// The result so far; empty before the first reading.
    fn result(&self) -> RunResult;

    /// The objects that are surely there, as they are seen from these poses of the readings so far; none where nothing detects objects.
    fn landmarks(&self, _poses: &[Estimate]) -> Vec<Landmark> {
        Vec::new()
    }

    /// Why the CPU took over from the filter's evaluator; `None` if it did not.
    fn evaluator_failure(&self) -> Option<&DeviceError>;
}

/// Where the robot is at one reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Stamp of the reading \[s\].
    pub stamp: f64,
    /// Raw odometry at the reading.
    pub odom_from_robot: Pose,
    /// The MAP estimate of the pose; `None` before the first scan.
    pub world_from_robot: Option<Pose>,
    /// Filtered covariance, by the readings up to this one: of (x \[m\], y \[m\], heading \[rad\]) along the world's axes,
    /// as [`Slam`](crate::slam::Slam) and [`Localization`](crate::localization::Localization) define it. `None` without a pose.
    pub covariance: Option<Matrix3<f64>>,
    /// How far the pose can be relied on, in a known map; `None` in mapping.
    pub confidence: Option<Confidence>,
}

/// One pose particle as it is reported.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportedParticle {
    /// Pose in the map's frame.
    pub world_from_robot: Pose,
    /// Normalised weight, before resampling; all weights sum to one.
    pub weight: f64,
}

/// Seconds that a step, or a run, spent in each stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct StageTimes {
    /// Clustering the scan.
    pub cluster: f64,
    /// Tracking the robot between steps.
    pub track: f64,
    /// Drawing the poses of all particles (eq. 17), with scan matching. In a known map part of `weigh`.
    pub propagate: f64,
    /// Weighing them (eq. 18); in a known map with drawing, which the same call does.
    pub weigh: f64,
    /// The MAP estimate of the pose in a known map.
    pub estimate: f64,
    /// Normalising and resampling.
    pub resample: f64,
    /// Matching and merging clusters into the maps.
    pub merge: f64,
}

impl StageTimes {
    /// The stages in the order of a step, as recordings and summaries name them.
    pub const NAMES: [&str; 7] = ["cluster", "track", "propagate", "weigh", "estimate", "resample", "merge"];

    /// Seconds, in the order of [`StageTimes::NAMES`].
    pub fn seconds(&self) -> [f64; 7] {
        let Self { cluster, track, propagate, weigh, estimate, resample, merge } = *self;
        [cluster, track, propagate, weigh, estimate, resample, merge]
    }

    /// The inverse of [`StageTimes::seconds`].
    pub fn from_seconds([cluster, track, propagate, weigh, estimate, resample, merge]: [f64; 7]) -> Self {
        Self { cluster, track, propagate, weigh, estimate, resample, merge }
    }
}

impl AddAssign for StageTimes {
    fn add_assign(&mut self, other: Self) {
        let (mine, others) = (self.seconds(), other.seconds());
        *self = Self::from_seconds(std::array::from_fn(|stage| mine[stage] + others[stage]));
    }
}

/// Does some work and adds the seconds that it took.
pub(crate) fn timed<T>(seconds: &mut f64, work: impl FnOnce() -> T) -> T {
    let began = Instant::now();
    let result = work();
    *seconds += began.elapsed().as_secs_f64();
    result
}

/// How far the pose of a step can be relied on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Confidence {
    /// Share of the weight of all particles that lies around the pose.
    pub weight: f64,
    /// Gain of the scan's log-likelihood at the pose, as a share of the largest gain that the map can give, less the share of the
    /// scan's points that are behind walls of the map; 0 to 1.
    pub explained: f64,
    /// Whether the pose can be relied on: both were large enough for several steps, at poses that the robot can have moved between.
    pub is_located: bool,
}

/// What one step of the filter did.
#[derive(Clone, Debug)]
pub struct StepReport<'a> {
    /// Steps so far, from 0.
    pub step: u32,
    /// Stamp of the scan \[s\].
    pub stamp: f64,
    /// The scan, in the robot's frame.
    pub scan: &'a Scan,
    /// The scan's clusters, in the robot's frame.
    pub scan_clusters: &'a [Cluster],
    /// Raw odometry at the scan.
    pub odom_from_robot: Pose,
    /// Pose of the best particle.
    pub world_from_robot: Pose,
    /// All pose particles.
    pub particles: &'a [ReportedParticle],
    /// The best particle's map, in the world's frame.
    pub map: &'a [Cluster],
    /// 1 / Σ w², from 1 to the number of particles.
    pub effective_sample_size: f64,
    /// Whether this step resampled.
    pub resampled: bool,
    /// Parent index of each survivor: of each map, the identity where the step did not resample; in a known map of each
    /// particle, [`u32::MAX`] for one drawn anywhere.
    pub parents: &'a [u32],
    /// In a known map, how far the pose can be relied on.
    pub confidence: Option<Confidence>,
    /// Seconds by stage.
    pub times: StageTimes,
}

impl StepReport<'_> {
    /// A number that changes with any bit of the particles, their weights, their ancestry or the best map.
    pub fn checksum(&self) -> u32 {
        let mut bits = Bits::default();
        for particle in self.particles {
            bits.pose(particle.world_from_robot);
            bits.add([particle.weight]);
        }
        bits.add(self.parents.iter().map(|&parent| f64::from(parent)));
        bits.pose(self.world_from_robot);
        bits.map(self.map);
        bits.finish()
    }
}

/// A loop: a place that the robot returned to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Loop {
    /// Stamp of the step that came back \[s\].
    pub stamp: f64,
    /// Stamp of the step that had been there before \[s\]; `None` for a place in the map of an earlier drive.
    pub older_stamp: Option<f64>,
    /// The step that came back.
    pub step: u32,
    /// The step that had been there before; `None` for a place in the map of an earlier drive.
    pub older: Option<u32>,
    /// The robot at `step`, seen from where it was at `older`, or in the world.
    pub older_from_robot: Pose,
    /// Distance of the pose before the correction from there \[m\].
    pub correction: f64,
    /// Share of the walls of the last metres that the older map explains, less the share that lies behind its walls.
    pub explained: f64,
    /// Whether the path that was found closes it.
    pub is_closed: bool,
}

/// The result of a run.
#[derive(Clone, Debug, Default)]
pub struct RunResult {
    /// The best particle's map, or the map that is known, in the world's frame.
    pub map: LineMap,
    /// The pose at every odometry and laser reading, in the order of the log: the k-th is that of the k-th entry of
    /// [`readings`](crate::log::readings).
    pub poses: Vec<Estimate>,
    /// Stamps \[s\] of the odometry that was refused, as no robot can have driven it, in the order of the log.
    pub refused_odometry: Vec<f64>,
    /// What the odometry of this drive is worth.
    pub odometry_errors: OdometryErrors,
    /// What a gyroscope had to say, where the robot has one.
    pub gyro: Option<GyroUse>,
    /// The loops that were searched for and found, in the order of the log.
    pub loops: Vec<Loop>,
    /// The walls of an earlier drive that the map was made from, as that drive left them.
    pub earlier: Vec<Cluster>,
    /// Of all points that clusters explained, the share on those that were left out of the map because more scans looked through
    /// them than saw them: 0 to 1, 0 before smoothing.
    pub looked_through: f64,
    /// Objects, where detections were given.
    pub objects: Option<ObjectMap>,
}

impl RunResult {
    /// `world_from_robot` at every reading where it can be relied on, in the order of the log.
    pub fn trajectory(&self) -> Vec<StampedPose> {
        let stamped = |(estimate, pose): (&Estimate, Pose)| StampedPose { stamp: estimate.stamp, pose };
        self.relied_on().map(stamped).collect()
    }

    /// `odom_from_robot` at the readings of [`RunResult::trajectory`], as recorded.
    pub fn odometry(&self) -> Vec<StampedPose> {
        let stamped =
            |(estimate, _): (&Estimate, Pose)| StampedPose { stamp: estimate.stamp, pose: estimate.odom_from_robot };
        self.relied_on().map(stamped).collect()
    }

    /// The estimates that can be relied on, and their poses.
    pub fn relied_on(&self) -> impl Iterator<Item = (&Estimate, Pose)> {
        self.poses.iter().filter_map(|estimate| Some((estimate, estimate.relied_on()?)))
    }

    /// The same, seen in a world that is turned by this angle about its origin \[rad\]. What is known of the free area is left out.
    pub fn turned(&self, angle: f64) -> Self {
        let turn = Pose::new(0.0, 0.0, angle);
        let turned = |clusters: &[Cluster]| clusters.iter().map(|cluster| cluster.transformed(turn)).collect();
        let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), angle).into_inner();
        let estimate = |estimate: &Estimate| Estimate {
            world_from_robot: estimate.world_from_robot.map(|pose| turn * pose),
            covariance: estimate.covariance.map(|covariance| rotation * covariance * rotation.transpose()),
            ..*estimate
        };
        let turned_loop = |found: &Loop| Loop {
            older_from_robot: if found.older.is_none() {
                turn * found.older_from_robot
            } else {
                found.older_from_robot
            },
            ..*found
        };
        Self {
            map: LineMap { clusters: turned(&self.map.clusters), free: None },
            poses: self.poses.iter().map(estimate).collect(),
            loops: self.loops.iter().map(turned_loop).collect(),
            earlier: turned(&self.earlier),
            objects: self.objects.as_ref().map(|objects| objects.moved(turn)),
            ..self.clone()
        }
    }

    /// A number that changes with any bit of the map or the trajectory.
    pub fn checksum(&self) -> u32 {
        let mut bits = Bits::default();
        bits.map(&self.map.clusters);
        for landmark in self.objects.iter().flat_map(|objects| &objects.landmarks) {
            bits.add([landmark.position.x, landmark.position.y, landmark.existence]);
        }
        for (estimate, pose) in self.relied_on() {
            bits.add([estimate.stamp]);
            bits.pose(pose);
        }
        bits.finish()
    }
}

impl Estimate {
    /// The pose, where it can be relied on: in a known map, where the robot is located.
    pub fn relied_on(&self) -> Option<Pose> {
        self.world_from_robot.filter(|_| self.confidence.is_none_or(|confidence| confidence.is_located))
    }
}

/// Checksum of the bits of numbers.
#[derive(Default)]
pub(crate) struct Bits(Hasher);

impl Bits {
    pub fn add(&mut self, numbers: impl IntoIterator<Item = f64>) {
        numbers.into_iter().for_each(|number| self.0.update(&number.to_le_bytes()));
    }

    pub fn pose(&mut self, Pose { x, y, heading }: Pose) {
        self.add([x, y, heading]);
    }

    pub fn finish(self) -> u32 {
        self.0.finalize()
    }

    fn map(&mut self, map: &[Cluster]) {
        for Cluster { mean, direction, along_variance, across_variance, count } in map {
            self.add([mean.x, mean.y, direction.x, direction.y, *along_variance, *across_variance, *count]);
        }
    }
}
