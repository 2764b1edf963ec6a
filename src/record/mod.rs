//! What leaves the loop: every step is reported to observers, which record, draw or write, and never steer.

use crate::config::Config;
use crate::geometry::{Pose, StampedPose};
use crate::log::LogEntry;
use crate::ppca::Cluster;
use crate::scan::Scan;
use crc32fast::Hasher;
use serde::{Deserialize, Serialize};
use web_time::Instant;

#[cfg(feature = "record")]
pub mod rerun;

/// What a run is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Task {
    /// Finding path and map.
    Mapping,
    /// Finding the robot in a map that is known.
    Localization,
}

/// What a run starts with: with the entries of its log, all that it takes to map it again.
#[derive(Clone, Debug, PartialEq)]
pub struct RunInfo {
    /// What it is for.
    pub task: Task,
    /// Name of the log.
    pub log: String,
    /// What evaluates the particles, in the words of its driver.
    pub device: String,
    /// Everything that was set.
    pub config: Config,
}

/// One pose particle as it is reported.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportedParticle {
    /// Pose in the map's frame.
    pub world_from_robot: Pose,
    /// Normalised weight, before resampling; all weights sum to one.
    pub weight: f64,
}

/// Seconds that one step spent in each stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct StageTimes {
    /// Clustering the scan.
    pub cluster: f64,
    /// Following the robot between steps.
    pub track: f64,
    /// Drawing the poses of all particles.
    pub propagate: f64,
    /// Weights.
    pub weigh: f64,
    /// Normalising and resampling.
    pub resample: f64,
    /// Matching and merging clusters into the maps.
    pub merge: f64,
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
    /// Share of what the map could explain of the scan at best that it does explain from there, less the share of the
    /// scan's points that are behind walls of the map, 0 to 1.
    pub explained: f64,
    /// Whether the pose can be relied on: both were enough for some steps, at poses that the robot can have moved between.
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
    /// For each map that is left, the number of the one that it was before; that of itself where none was resampled. In a
    /// known map, for each particle that is left; [`u32::MAX`] for one from anywhere.
    pub parents: &'a [u32],
    /// In a known map, how far the pose can be relied on.
    pub confidence: Option<Confidence>,
    /// Where the time went.
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
        bits.0.finalize()
    }
}

/// What a finished run found.
#[derive(Clone, Debug, Default)]
pub struct RunResult {
    /// The best particle's map, in the world's frame.
    pub map: Vec<Cluster>,
    /// `world_from_robot` of the best particle at every laser and odometry reading, in the order of the log.
    pub trajectory: Vec<StampedPose>,
    /// `odom_from_robot` at the same readings, as recorded.
    pub odometry: Vec<StampedPose>,
}

impl RunResult {
    /// A number that changes with any bit of the map or the trajectory.
    pub fn checksum(&self) -> u32 {
        let mut bits = Bits::default();
        bits.map(&self.map);
        for StampedPose { stamp, pose } in &self.trajectory {
            bits.add([*stamp]);
            bits.pose(*pose);
        }
        bits.0.finalize()
    }
}

/// The bits of numbers, summed up.
#[derive(Default)]
struct Bits(Hasher);

impl Bits {
    fn add(&mut self, numbers: impl IntoIterator<Item = f64>) {
        numbers.into_iter().for_each(|number| self.0.update(&number.to_le_bytes()));
    }

    fn pose(&mut self, Pose { x, y, heading }: Pose) {
        self.add([x, y, heading]);
    }

    fn map(&mut self, map: &[Cluster]) {
        for Cluster { mean, direction, along_variance, across_variance, count } in map {
            self.add([mean.x, mean.y, direction.x, direction.y, *along_variance, *across_variance, *count]);
        }
    }
}

/// Somebody who is told of every step. Errors are the observer's own to report: they never stop a run.
pub trait Observer {
    /// The next entry of the log, before the step that it may lead to.
    fn on_entry(&mut self, entry: &LogEntry);

    /// A step was done.
    fn on_step(&mut self, report: &StepReport<'_>);

    /// The run is over; nothing follows. `is_smoothed` tells whether the result is what [`smooth`](crate::smoothing::smooth)
    /// made of the whole log.
    fn on_finish(&mut self, result: &RunResult, is_smoothed: bool);

    /// What kept it from doing its work, if anything did.
    fn failure(&self) -> Option<&str>;
}
