//! A wall as a cluster.

use ipslam::ppca::Cluster;
use nalgebra::Point2;

/// The cluster of a wall from `a` to `b` that is seen evenly: variance length²/12 along it.
pub fn wall(a: [f64; 2], b: [f64; 2], across: f64, count: f64) -> Cluster {
    let (a, b) = (Point2::from(a), Point2::from(b));
    Cluster {
        mean: nalgebra::center(&a, &b),
        direction: (b - a).normalize(),
        along_variance: (b - a).norm_squared() / 12.0,
        across_variance: across * across,
        count,
    }
}
