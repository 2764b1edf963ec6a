//! The most likely cluster of a point, found fast.
//!
//! A density threshold gives every Gaussian an ellipse outside of which it cannot reach the threshold. Clusters are
//! listed in the cells of a grid that their ellipse's bounding box touches, so the few of one cell hold the answer of
//! the whole map, without approximation.

use crate::ppca::Cluster;
use nalgebra::{Point2, Vector2};

/// Points whose density is lower under every cluster are not displayed (section V of the paper); in 1/m².
const LEAST_DENSITY: f64 = 1e-8;
/// Least variance of a cluster, in m²: a perfect line still has a density.
const VARIANCE_FLOOR: f64 = 1e-6;
/// Most cells along a side of the grid.
const MOST_CELLS: f64 = 256.0;

/// Clusters by the places that they can explain.
#[derive(Clone, Debug)]
pub(super) struct ClusterGrid {
    clusters: Vec<Cluster>,
    corner: Point2<f64>,
    /// Side of a cell, in metres.
    cell: f64,
    columns: usize,
    /// Indices into `clusters`, row by row.
    candidates: Vec<Vec<u32>>,
}

impl ClusterGrid {
    /// Sorts a map, in the world's frame; clusters that are not finite are left out.
    pub(super) fn new(map: &[Cluster]) -> Self {
        let clusters: Vec<Cluster> = map
            .iter()
            .filter(|cluster| super::svg::is_drawable_cluster(cluster))
            .map(|cluster| cluster.with_variance_floor(VARIANCE_FLOOR))
            .collect();
        let boxes: Vec<_> = clusters.iter().map(support).collect();
        let corner = boxes.iter().map(|b| b.0).reduce(|a, b| a.inf(&b)).unwrap_or_default();
        let far = boxes.iter().map(|b| b.1).reduce(|a, b| a.sup(&b)).unwrap_or_default();
        let cell = ((far - corner).amax() / MOST_CELLS).max(0.1);
        let index = |point: Point2<f64>| ((point - corner) / cell).map(|v| v as usize);
        let size = index(far).add_scalar(1);
        let mut candidates = vec![Vec::new(); size.x * size.y];
        for (i, &(low, high)) in boxes.iter().enumerate() {
            let (low, high) = (index(low), index(high));
            for row in low.y..=high.y {
                for column in low.x..=high.x {
                    candidates[row * size.x + column].push(i as u32);
                }
            }
        }
        Self { clusters, corner, cell, columns: size.x, candidates }
    }

    /// The cluster of the highest density at a point, or `None` where no density reaches the threshold.
    pub(super) fn most_likely(&self, point: Point2<f64>) -> Option<&Cluster> {
        let offset = (point - self.corner) / self.cell;
        if !(offset.x >= 0.0 && offset.y >= 0.0 && (offset.x as usize) < self.columns) {
            return None;
        }
        let candidates = self.candidates.get(offset.y as usize * self.columns + offset.x as usize)?;
        let densities = candidates.iter().map(|&i| {
            let cluster = &self.clusters[i as usize];
            (cluster.log_density(point), cluster)
        });
        let (density, best) = densities.max_by(|a, b| a.0.total_cmp(&b.0))?;
        (density >= LEAST_DENSITY.ln()).then_some(best)
    }
}

/// Corners of the box around the ellipse on which the density has fallen to the threshold. Its half sides are
/// r √C₁₁ and r √C₂₂, r² = 2 ln(p(μ) / threshold) being the squared Mahalanobis distance there.
fn support(cluster: &Cluster) -> (Point2<f64>, Point2<f64>) {
    let squared = 2.0 * (cluster.log_density(cluster.mean) - LEAST_DENSITY.ln());
    let covariance = cluster.covariance();
    let half = Vector2::new(covariance.m11.sqrt(), covariance.m22.sqrt()) * squared.max(0.0).sqrt();
    (cluster.mean - half, cluster.mean + half)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Draw, bits, uniform};

    /// The oracle: every cluster asked.
    fn slow(map: &[Cluster], point: Point2<f64>) -> Option<&Cluster> {
        let best = map.iter().max_by(|a, b| a.log_density(point).total_cmp(&b.log_density(point)))?;
        (best.log_density(point).exp() >= 1e-8).then_some(best)
    }

    #[test]
    fn grid_finds_what_asking_every_cluster_finds() {
        let number = |particle, lane: usize| f64::from(uniform(bits(5, 0, particle, Draw::Motion)[lane]));
        let map: Vec<Cluster> = (0..60)
            .map(|i| {
                let angle = 3.2 * number(i, 2);
                Cluster {
                    mean: Point2::new(30.0 * number(i, 0) - 20.0, 20.0 * number(i, 1)),
                    direction: Vector2::new(angle.cos(), angle.sin()),
                    along_variance: 0.01 + number(i, 3),
                    across_variance: 4e-4,
                    count: 10.0,
                }
            })
            .collect();
        let grid = ClusterGrid::new(&map);
        let (mut found, mut missed) = (0, 0);
        for i in 1000..6000 {
            let point = Point2::new(50.0 * number(i, 0) - 30.0, 40.0 * number(i, 1) - 10.0);
            assert_eq!(grid.most_likely(point), slow(&map, point), "seed 5, {point}");
            if slow(&map, point).is_some() { found += 1 } else { missed += 1 }
        }
        assert!(found > 200 && missed > 200, "both cases are met: {found}, {missed}");
    }

    #[test]
    fn degenerate_maps_are_legal() {
        assert!(ClusterGrid::new(&[]).most_likely(Point2::origin()).is_none());
        let line = Cluster::fit([Point2::new(0.0, 0.0), Point2::new(2.0, 0.0)]).unwrap();
        let broken = Cluster { mean: Point2::new(f64::NAN, 0.0), ..line };
        let grid = ClusterGrid::new(&[broken, line]);
        assert!(grid.most_likely(Point2::new(1.0, 0.001)).is_some());
        assert!(grid.most_likely(Point2::new(f64::NAN, 0.0)).is_none());
        assert!(grid.most_likely(Point2::new(1.0, 1.0)).is_none());
    }
}
