//! Points -> clusters: G-means with PPCA (III-B of the paper).
//!
//! 1. `split`: G-means (Hamerly & Elkan, NIPS 2003). A cluster whose points, projected on the line between the two
//!    halves that 2-means would make of it, fail the Anderson-Darling test of normality is split, until all pass.
//! 2. `mixture`: the clusters become a mixture of PPCA models and are refined by EM (Tipping & Bishop, Neural
//!    Computation 11, 1999).
//! 3. Points that are outliers even to their most likely cluster are left out, and the clusters are fitted again.
//!
//! Input: points in any frame \[m\]. Output: clusters in that frame. PPCA is equivariant under rigid motion, so a scan
//! is clustered once, in the robot's frame, for all particles.

use crate::parameters::parameters;
use crate::ppca::Cluster;
use crate::scan::Scan;
use nalgebra::Point2;

pub mod anderson_darling;
mod mixture;
mod split;

parameters! {
    /// How points become clusters.
    pub struct ClusteringConfig {
        /// The fewest points of a cluster; smaller ones are dropped with their points.
        min_points: usize = 3, in 2.0..=1e6;
        /// Split also what is thicker than this standard deviation across \[m\]; infinite in the paper. A corner or a curve
        /// of few points can pass for normal along its principal component and still be no line.
        max_across: f64 = 0.02, in 0.0..=f64::INFINITY;
        /// A cluster with a longer stretch without points is several \[m\]; infinite in the paper. Things that happen to
        /// lie on one line are no wall. Where a laser looks along a wall, the points of neighbouring beams may lie further apart.
        max_gap: f64 = 0.4, in 0.0..=f64::INFINITY;
        /// Laser noise \[m\]: no standard deviation of a cluster is taken to be smaller while points are shared out.
        noise: f64 = 0.01, in 1e-6..=1e3;
    }
}

/// Split where A*² is above this: the paper's 1.035, the 1 % point of the test.
const NORMALITY_THRESHOLD: f64 = 1.035;
/// At most this many rounds of EM; it has converged after fewer in nearly all scans.
const EM_ITERATIONS: usize = 10;
/// Points are outliers where less than this share of a cluster's own points would lie further out: 1 %, as for the test.
const OUTLIER_PROBABILITY: f64 = 0.01;

/// Clusters of a set of points and who belongs to whom.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clustering {
    /// The clusters, each of at least `min_points` points.
    pub clusters: Vec<Cluster>,
    /// For each point its cluster, or `None` for an outlier.
    pub assignment: Vec<Option<usize>>,
}

/// Points this far apart in the order of the beams are neighbours: the laser has seen nothing else between them, but for one point
/// that may be in front of the wall. Beams without return do not count: along a wall they often find none.
const NEIGHBOURS: usize = 2;

/// Clusters the points of a scan (III-B).
pub fn cluster_scan(scan: &Scan, config: &ClusteringConfig) -> Clustering {
    clustered(&scan.points, &|a, b| usize::abs_diff(a, b) <= NEIGHBOURS, config)
}

/// Clusters points in any order (III-B). Points that are not finite are left out as outliers.
pub fn cluster_points(points: &[Point2<f64>], config: &ClusteringConfig) -> Clustering {
    clustered(points, &|_, _| false, config)
}

/// Clusters points, of which some are neighbours whatever lies between them.
fn clustered(points: &[Point2<f64>], is_next: &dyn Fn(usize, usize) -> bool, config: &ClusteringConfig) -> Clustering {
    let finite: Vec<usize> = (0..points.len()).filter(|&i| points[i].coords.iter().all(|c| c.is_finite())).collect();
    let kept: Vec<Point2<f64>> = finite.iter().map(|&i| points[i]).collect();
    let groups = split::g_means(&kept, config);
    let components = mixture::refine(&kept, &groups, config);

    let mut members = vec![Vec::new(); components.len()];
    // A Gaussian of the plane holds 1 - exp(-m²/2) of its points within the Mahalanobis distance m.
    let outlier_distance2 = -2.0 * OUTLIER_PROBABILITY.ln();
    for (&index, &point) in finite.iter().zip(&kept) {
        if let Some(best) = mixture::most_likely(&components, point)
            && mixture::mahalanobis2(&components[best], point) <= outlier_distance2
        {
            members[best].push(index);
        }
    }

    let mut clustering = Clustering { clusters: Vec::new(), assignment: vec![None; points.len()] };
    for members in members {
        for piece in pieces(points, members, is_next, config.max_gap) {
            let Some(cluster) = Cluster::fit(piece.iter().map(|&i| points[i])) else { continue };
            if piece.len() >= config.min_points {
                piece.iter().for_each(|&i| clustering.assignment[i] = Some(clustering.clusters.len()));
                clustering.clusters.push(cluster);
            }
        }
    }
    clustering
}

/// Cuts a cluster's points where a stretch of its line longer than `max_gap` \[m\], between points that are no neighbours, holds
/// none.
fn pieces(
    points: &[Point2<f64>],
    mut members: Vec<usize>,
    is_next: &dyn Fn(usize, usize) -> bool,
    max_gap: f64,
) -> Vec<Vec<usize>> {
    let Some(cluster) = Cluster::fit(members.iter().map(|&i| points[i])) else { return Vec::new() };
    let along = |i: usize| cluster.direction.dot(&points[i].coords);
    members.sort_by(|&a, &b| along(a).total_cmp(&along(b)));
    let is_whole = |&a: &usize, &b: &usize| along(b) - along(a) <= max_gap || is_next(a, b);
    members.chunk_by(is_whole).map(<[usize]>::to_vec).collect()
}
