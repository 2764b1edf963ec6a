//! The walls of a known map, and how much of a scan they explain.

use super::{MAX_SIGMA, MIN_SIGMA};
use crate::ablation::Latent;
use crate::evaluator::table::ClusterTable;
use crate::evaluator::tiles::{Tile, reach};
use crate::geometry::Pose;
use crate::likelihood::{ClusterParams, LikelihoodConfig};
use crate::map::{MapCluster, Pool, Slot};
use crate::ppca::Cluster;
use nalgebra::Point2;
use std::f64::consts::TAU;

/// The map that all particles share.
#[derive(Debug)]
pub(super) struct Walls {
    /// In the world's frame.
    pub clusters: Vec<Cluster>,
    /// As the evaluator sees them.
    pub table: ClusterTable,
    /// Every cluster, for the one map of the scene.
    pub slots: [Vec<Slot>; 1],
    /// ln of the density of a point in the middle of a wall, averaged over all metres of wall: the most that a point can gain in
    /// a map of this resolution.
    pub log_peak: f64,
}

impl Walls {
    pub fn new(clusters: Vec<Cluster>, likelihood: &LikelihoodConfig) -> Self {
        let mut pool = Pool::default();
        for &cluster in &clusters {
            pool.insert(MapCluster { cluster, last_step: 0, sightings: 1 });
        }
        let mut table = ClusterTable::new(*likelihood, Latent::Uniform, MAX_SIGMA);
        // Particles may be anywhere, so the anchor is near the middle of the map and stays there.
        table.update(&mut pool, middle(&clusters));
        let log_peak = log_peak(&clusters, likelihood);
        Self { slots: [(0..clusters.len() as Slot).collect()], clusters, table, log_peak }
    }

    /// The gain in log-likelihood from a pose, as a share of the largest possible one, less the share of the points that are behind
    /// walls of the map: 0 to 1. `log_likelihood` is that of the scan there (eq. 18).
    pub fn explained(&self, world_from_robot: Pose, log_likelihood: f64, tiles: &[Tile]) -> f64 {
        let points: f64 = tiles.iter().map(|tile| f64::from(tile.count)).sum();
        let log_outlier = f64::from(self.table.log_outlier());
        let most = self.most(tiles);
        let gained = log_likelihood - points * log_outlier;
        let share = if most > 0.0 { gained / most } else { 0.0 };
        let behind = self.points_behind(world_from_robot, tiles);
        (share - behind as f64 / points).clamp(0.0, 1.0)
    }

    /// The largest log-likelihood ratio that the map can give a scan, against one of outliers alone.
    pub fn most(&self, tiles: &[Tile]) -> f64 {
        let points: f64 = tiles.iter().map(|tile| f64::from(tile.count)).sum();
        points * (self.log_peak - f64::from(self.table.log_outlier()))
    }

    /// The number of points that are behind a wall, seen from this pose. The likelihood (eq. 18) does not consider what is between
    /// the robot and a point; a wrong place that resembles the right one is recognised by it.
    fn points_behind(&self, world_from_robot: Pose, tiles: &[Tile]) -> usize {
        let (robot, reach) = (world_from_robot.position(), f64::from(reach(tiles)));
        let walls: Vec<&Cluster> = self.clusters.iter().filter(|wall| wall.may_be_within(reach, robot)).collect();
        let is_behind = |point: &Point2<f64>| walls.iter().any(|wall| wall.separates(robot, *point, MIN_SIGMA));
        tiles.iter().flat_map(Tile::points).map(|point| world_from_robot * point).filter(is_behind).count()
    }

    /// Standard deviation across a wall \[m\], averaged over all metres of wall.
    pub fn sigma(&self) -> f64 {
        (-self.log_peak).exp() / TAU.sqrt()
    }
}

fn log_peak(clusters: &[Cluster], likelihood: &LikelihoodConfig) -> f64 {
    let of = |cluster: &Cluster| ClusterParams::new(cluster, Point2::origin(), likelihood, Latent::Uniform).log_peak;
    let (mut length, mut sum) = (0.0, 0.0);
    for cluster in clusters {
        length += cluster.length();
        sum += cluster.length() * f64::from(of(cluster));
    }
    if length > 0.0 { sum / length } else { f64::from(likelihood.log_outlier()) }
}

/// The middle of a box around all walls.
fn middle(clusters: &[Cluster]) -> Pose {
    let mut means = clusters.iter().map(|cluster| cluster.mean);
    let first = means.next().unwrap_or_default();
    let (low, high) = means.fold((first, first), |(low, high), mean| (low.inf(&mean), high.sup(&mean)));
    let middle = nalgebra::center(&low, &high);
    Pose::new(middle.x, middle.y, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A metre of wall that is known to 3 cm and three metres that are known to 10 cm: 1/(√(2π) σ) in their middle.
    #[test]
    fn the_peak_is_averaged_over_metres_of_wall() {
        let likelihood = LikelihoodConfig { sigma_floor: 0.03, outlier_density: 0.01, ..LikelihoodConfig::default() };
        let wall = |length: f64, sigma: f64| Cluster::wall([3.0, 5.0], [3.0 + length, 5.0], sigma, 10.0);
        let found = log_peak(&[wall(1.0, 0.001), wall(3.0, 0.1)], &likelihood);
        let expected = 0.25 * 13.298_f64.ln() + 0.75 * 3.989_4_f64.ln();
        assert!((found - expected).abs() < 1e-4, "{found}, not {expected}");
        assert!((log_peak(&[], &likelihood) - 0.01_f64.ln()).abs() < 1e-6);
    }
}
