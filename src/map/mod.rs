//! Maps of clusters that share what they have in common.
//!
//! A cluster never changes once it is in the [`Pool`]; merging makes a new one. A [`Map`] is a list of pool slots, so
//! copying a particle copies no cluster, and particles of one ancestor share its clusters until they differ.

use crate::grid::FreeArea;
use crate::ppca::Cluster;
use merging::MergingConfig;
use nalgebra::Vector2;

mod from_grid;
pub mod matching;
pub mod merging;
pub(crate) mod seen_through;

pub use from_grid::clusters_of_grid;

/// A map on its own: of a finished run, of a file, or known to localisation. In the world's frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LineMap {
    /// The walls.
    pub clusters: Vec<Cluster>,
    /// Where a robot can be, if that is known.
    pub free: Option<FreeArea>,
}

/// Walls of one building are at right angles to within this \[rad\].
const SQUARE: f64 = 0.03;

impl LineMap {
    /// The direction that most metres of wall have, or are at right angles to, -π/4 to π/4 \[rad\]; 0 without walls. Angles count
    /// four times, so that a right angle is a full turn.
    pub fn main_direction(&self) -> f64 {
        let fourfold = |cluster: &Cluster| 4.0 * cluster.direction.y.atan2(cluster.direction.x);
        let agreeing = |angle: f64, other: &Cluster| {
            other.length() * (((fourfold(other) - angle).cos() - 1.0) / (4.0 * SQUARE).powi(2)).exp()
        };
        let metres = |angle: f64| self.clusters.iter().map(|other| agreeing(angle, other)).sum::<f64>();
        let angles = self.clusters.iter().map(fourfold);
        let Some(best) = angles.max_by(|&a, &b| metres(a).total_cmp(&metres(b))) else { return 0.0 };
        let vector = |other: &Cluster| {
            let (sin, cos) = fourfold(other).sin_cos();
            Vector2::new(cos, sin) * agreeing(best, other)
        };
        let sum: Vector2<f64> = self.clusters.iter().map(vector).sum();
        sum.y.atan2(sum.x) / 4.0
    }
}

/// A cluster of a map, and when it was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapCluster {
    /// The cluster, in the world's frame.
    pub cluster: Cluster,
    /// The step that last saw it.
    pub last_step: u32,
    /// How many steps saw it.
    pub sightings: u32,
}

/// Place of a cluster in the pool.
pub type Slot = u32;

/// Every cluster of every map.
#[derive(Clone, Debug, Default)]
pub struct Pool {
    clusters: Vec<MapCluster>,
    free: Vec<Slot>,
    inserted: Vec<Slot>,
}

/// One map hypothesis: slots of the pool, each once, in the order in which they were added.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Map {
    /// The clusters of this map.
    pub slots: Vec<Slot>,
}

impl Map {
    /// The map of an earlier drive, its walls seen often enough to be no clutter.
    pub fn known(walls: &[Cluster], pool: &mut Pool, merging: &MergingConfig) -> Self {
        let sightings = merging.min_sightings;
        let slots = walls.iter().map(|&cluster| pool.insert(MapCluster { cluster, last_step: 0, sightings })).collect();
        Self { slots }
    }
}

impl Pool {
    /// Puts a cluster in.
    pub fn insert(&mut self, cluster: MapCluster) -> Slot {
        let slot = if let Some(slot) = self.free.pop() {
            self.clusters[slot as usize] = cluster;
            slot
        } else {
            self.clusters.push(cluster);
            (self.clusters.len() - 1) as Slot
        };
        self.inserted.push(slot);
        slot
    }

    /// Slots that clusters were put into since this was asked last; some may have been freed since.
    pub fn take_inserted(&mut self) -> Vec<Slot> {
        std::mem::take(&mut self.inserted)
    }

    /// The cluster in a slot.
    pub fn get(&self, slot: Slot) -> &MapCluster {
        &self.clusters[slot as usize]
    }

    /// Slots that there are, free ones included: all are below this.
    pub fn capacity(&self) -> usize {
        self.clusters.len()
    }

    /// Frees what none of these maps holds.
    pub fn keep_only<'a>(&mut self, maps: impl IntoIterator<Item = &'a Map>) {
        let mut held = vec![false; self.clusters.len()];
        for map in maps {
            map.slots.iter().for_each(|&slot| held[slot as usize] = true);
        }
        // Lowest slots last, so that they are taken first and the pool stays compact.
        self.free = (0..self.clusters.len() as Slot).rev().filter(|&slot| !held[slot as usize]).collect();
    }

    /// Clusters in use, by the last count of [`Pool::keep_only`].
    pub fn len(&self) -> usize {
        self.clusters.len() - self.free.len()
    }

    /// Whether no cluster is in use.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The clusters of a map, in its order.
    pub fn clusters_of<'a>(&'a self, map: &'a Map) -> impl Iterator<Item = (Slot, &'a MapCluster)> {
        map.slots.iter().map(|&slot| (slot, &self.clusters[slot as usize]))
    }
}
