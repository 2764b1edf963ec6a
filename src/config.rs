//! Everything that can be set about a run, with the defaults and the paper's own values.

use crate::clustering::ClusteringConfig;
use crate::evaluator::layout::{Latent, LikelihoodConfig};
use crate::map::matching::{MatchingConfig, MatchingRule};
use crate::map::merging::{MergingConfig, MergingMethod};
use crate::motion::MotionConfig;
use crate::proposal::ProposalConfig;
use crate::smoothing::SmoothingConfig;
use serde::{Deserialize, Serialize};

/// The configuration of a run. A file may set any part of it; what it leaves out keeps its default.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Pose particles, at least as many as maps.
    pub particles: usize,
    /// Map hypotheses. `particles == maps` is the paper's filter.
    pub maps: usize,
    /// From ranges to points.
    pub scan: ScanConfig,
    /// From points to clusters.
    pub clustering: ClusteringConfig,
    /// From odometry to motion.
    pub motion: MotionConfig,
    /// From motion and scan to a proposal.
    pub proposal: ProposalConfig,
    /// From points and map to a weight.
    pub likelihood: LikelihoodConfig,
    /// Which map cluster a scan cluster is.
    pub matching: MatchingConfig,
    /// How it becomes part of the map.
    pub merging: MergingConfig,
    /// When the filter takes a step, and when it resamples.
    pub filter: FilterConfig,
    /// What comes after it.
    pub smoothing: SmoothingConfig,
}

/// Which ranges count.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScanConfig {
    /// Shorter ranges are no measurement [m].
    pub min_range: f64,
    /// Ranges from here on are not used, or no return [m].
    pub max_range: f64,
}

/// When the filter acts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FilterConfig {
    /// A step is taken once the robot has moved this far [m] ...
    pub step_distance: f64,
    /// ... or turned this far [rad]. Both zero: a step every scan, as in the paper.
    pub step_turn: f64,
    /// Resample where the effective sample size falls below this share of the maps; 1 resamples every step.
    pub resample_below: f64,
    /// Weigh a particle by its map after the scan was merged into it (Table I, 6c), not before.
    pub weigh_merged_map: bool,
}

impl Default for ScanConfig {
    fn default() -> Self {
        Self { min_range: 0.1, max_range: 30.0 }
    }
}

impl Default for FilterConfig {
    fn default() -> Self {
        Self { step_distance: 0.3, step_turn: 0.2, resample_below: 0.5, weigh_merged_map: false }
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            seed: 1,
            particles: 100,
            maps: 100,
            scan: ScanConfig::default(),
            clustering: ClusteringConfig::default(),
            motion: MotionConfig::default(),
            proposal: ProposalConfig::default(),
            likelihood: LikelihoodConfig::default(),
            matching: MatchingConfig::default(),
            merging: MergingConfig::default(),
            filter: FilterConfig::default(),
            smoothing: SmoothingConfig::default(),
        }
    }
}

impl Config {
    /// Table I to the letter, with the paper's numbers where it gives any.
    pub fn paper() -> Self {
        Self {
            particles: 201,
            maps: 201,
            clustering: ClusteringConfig {
                min_points: 5,
                max_across: f64::INFINITY,
                max_gap: f64::INFINITY,
                ..ClusteringConfig::default()
            },
            motion: MotionConfig::default(),
            proposal: ProposalConfig { iterations: 0, spread: 1.0, tracking_starts: 0 },
            likelihood: LikelihoodConfig {
                latent: Latent::Normal,
                sigma_floor: 0.01,
                capture_sigma: 0.01,
                end_sigma: 0.01,
                outlier_density: 1e-8,
                temper: 1.0,
                max_points: usize::MAX,
            },
            matching: MatchingConfig {
                rule: MatchingRule::Paper,
                max_angle: 60f64.to_radians(),
                max_distance: 0.5,
                max_gap: 0.0,
            },
            merging: MergingConfig {
                method: MergingMethod::Incremental,
                min_points: 10.0,
                max_across: 0.1,
                consolidate: false,
                cluster_cost: 0.0,
                min_sightings: 0,
                clutter_age: 0,
            },
            filter: FilterConfig { step_distance: 0.0, step_turn: 0.0, resample_below: 1.0, weigh_merged_map: true },
            smoothing: SmoothingConfig { passes: 0, ..SmoothingConfig::default() },
            ..Self::default()
        }
    }
}
