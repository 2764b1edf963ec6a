//! Ablations: switches that replace each departure from the paper by the paper's own rule.

use crate::parameters::parameters;
use serde::{Deserialize, Serialize};

parameters! {
    /// Ablations. All but the defaults are the paper's, and the preset `paper` sets them together.
    pub struct AblationConfig {
        /// Distribution of the latent number ζ of a cluster (eq. 7).
        latent: Latent = Latent::Uniform;
        /// Which rule matches the clusters of a scan with those of the map (III-D).
        matching: MatchingRule = MatchingRule::Collinear;
        /// How the parameters of a matched pair become one cluster's (III-E).
        merging: MergingMethod = MergingMethod::Moments;
        /// Map clusters that came to overlap become one, where the union is no thicker than `merging.max_across`.
        consolidate: bool = true;
        /// A particle is weighed by its map after the scan was merged into it (Table I, 6c), not before.
        weigh_merged_map: bool = false;
    }
}

/// Distribution of the latent number ζ along a cluster (eq. 7).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Latent {
    /// The paper's N(0, 1). Density is that of eq. 9.
    Normal,
    /// Uniform over the segment of the same variance, each metre of wall as likely as any other: a wall seen in part
    /// does not pull the robot towards its middle, and a map in fewer, longer clusters is no less likely.
    Uniform,
}

/// The rules of matching.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MatchingRule {
    /// III-D to the letter: two metrics, greedy, one to one.
    Paper,
    /// Each scan cluster goes to the map cluster whose line it lies on, several to one: a wall that a doorway or a
    /// table cuts in two stays one wall.
    Collinear,
}

/// The ways to merge two clusters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MergingMethod {
    /// Incremental PCA, eq. 15-16.
    Incremental,
    /// Moments add up, so the merged cluster is exactly the one of all points together; eq. 16 only tends to it.
    Moments,
}
