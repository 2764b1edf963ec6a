//! A wall as a cluster.

use ipslam::ppca::Cluster;

/// The cluster of a wall from `a` to `b`.
pub fn wall(a: [f64; 2], b: [f64; 2], across: f64, count: f64) -> Cluster {
    Cluster::wall(a, b, across, count)
}
