//! A map that is made from the scans of one path.

use super::Closer;
use crate::evaluator::pose::LocalPose;
use crate::evaluator::table::ClusterTable;
use crate::geometry::Pose;
use crate::map::merging::{counts, merge_scan};
use crate::map::{Map, MapCluster, Pool, Slot};
use crate::ppca::Cluster;

/// One map, in a pool of its own.
#[derive(Debug)]
pub(super) struct OneMap {
    pub pool: Pool,
    pub map: Map,
    pub table: ClusterTable,
}

impl OneMap {
    /// The map of an earlier drive, or an empty one; its walls will be thickened to at most `capture_sigma` \[m\].
    pub fn new(earlier: &[Cluster], config: &Closer, capture_sigma: f64) -> Self {
        let mut pool = Pool::default();
        let map = Map::known(earlier, &mut pool, &config.merging);
        let mut table = ClusterTable::new(config.likelihood, config.ablation.latent, capture_sigma);
        table.update(&mut pool, Pose::IDENTITY);
        Self { pool, map, table }
    }

    /// Table I, 6c-ii to v: merges the clusters of a scan, given in the robot's frame.
    pub fn merge(&mut self, step: u32, world_from_robot: Pose, clusters: &[Cluster], config: &Closer) {
        let Closer { matching, merging, ablation, .. } = config;
        let reach = matching.reach(clusters);
        let near: Vec<(Slot, MapCluster)> =
            self.near(world_from_robot, reach as f32).into_iter().map(|slot| (slot, *self.pool.get(slot))).collect();
        let clusters: Vec<Cluster> = clusters.iter().map(|cluster| cluster.transformed(world_from_robot)).collect();
        let change = merge_scan(&near, &clusters, &counts(&clusters), step, matching, merging, ablation);
        self.map.slots.retain(|slot| !change.removed.contains(slot));
        self.map.slots.extend(change.added.into_iter().map(|entry| self.pool.insert(entry)));
        self.pool.keep_only([&self.map]);
        self.table.update(&mut self.pool, world_from_robot);
    }

    /// The clusters that lie this close to a pose \[m\].
    pub fn near(&self, world_from_robot: Pose, reach: f32) -> Vec<Slot> {
        let LocalPose { x, y, .. } = LocalPose::new(world_from_robot, self.table.anchor());
        self.table.near(&self.map.slots, x, y, reach)
    }

    pub fn clusters(&self) -> Vec<MapCluster> {
        self.pool.clusters_of(&self.map).map(|(_, entry)| *entry).collect()
    }
}
