//! What leaves the loop: every step is reported to observers, which record, draw or write, and never steer.

use crate::geometry::{Pose, StampedPose};
use crate::ppca::Cluster;
use crate::scan::Scan;
use serde::Serialize;

#[cfg(feature = "record")]
pub mod rerun;

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
    /// Where the time went.
    pub times: StageTimes,
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

/// Somebody who is told of every step. Errors are the observer's own to report: they never stop a run.
pub trait Observer {
    /// A step was done.
    fn on_step(&mut self, report: &StepReport<'_>);

    /// The run is over; nothing follows.
    fn on_finish(&mut self, result: &RunResult);

    /// What kept it from doing its work, if anything did.
    fn failure(&self) -> Option<&str>;
}
