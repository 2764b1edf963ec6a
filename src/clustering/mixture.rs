//! A mixture of PPCA models refined by EM (Tipping & Bishop 1999, section 3; III-A and III-B of the paper).

use super::{ClusteringConfig, EM_ITERATIONS};
use crate::ppca::{Cluster, Moments};
use nalgebra::Point2;

/// EM has converged where the mean log-likelihood of a point rises by less than this.
const CONVERGED: f64 = 1e-4;

/// One component: a cluster and ln π of its share of the points.
#[derive(Clone, Copy, Debug)]
pub struct Component {
    cluster: Cluster,
    log_share: f64,
    log_normaliser: f64,
}

impl Component {
    fn new(cluster: Cluster, points: usize, noise: f64) -> Self {
        let cluster = cluster.with_variance_floor(noise * noise);
        Self {
            cluster,
            log_share: (cluster.count / points as f64).ln(),
            log_normaliser: cluster.log_density(cluster.mean),
        }
    }

    /// ln (π p(z)).
    fn log_joint(&self, point: Point2<f64>) -> f64 {
        self.log_share + self.log_normaliser - 0.5 * mahalanobis2(self, point)
    }
}

/// Squared Mahalanobis distance of a point from a component's cluster.
pub fn mahalanobis2(component: &Component, point: Point2<f64>) -> f64 {
    let cluster = &component.cluster;
    let offset = point - cluster.mean;
    let (along, across) = (cluster.direction.dot(&offset), cluster.normal().dot(&offset));
    along * along / cluster.along_variance + across * across / cluster.across_variance
}

/// Index of the component with the highest π p(z).
pub fn most_likely(components: &[Component], point: Point2<f64>) -> Option<usize> {
    (0..components.len()).max_by(|&a, &b| components[a].log_joint(point).total_cmp(&components[b].log_joint(point)))
}

/// EM from a first assignment of the points. Components that die out are dropped.
pub fn refine(points: &[Point2<f64>], groups: &[Vec<usize>], config: &ClusteringConfig) -> Vec<Component> {
    let mut components: Vec<Component> = groups
        .iter()
        .filter(|group| group.len() >= config.min_points)
        .filter_map(|group| Cluster::fit(group.iter().map(|&i| points[i])))
        .map(|cluster| Component::new(cluster, points.len(), config.noise))
        .collect();
    let mut before = f64::NEG_INFINITY;
    let mut joint = Vec::new();
    for _ in 0..EM_ITERATIONS {
        let mut moments = vec![Moments::default(); components.len()];
        let mut total = 0.0;
        for &point in points {
            // E step: responsibilities, in logs until the largest is taken out.
            joint.clear();
            joint.extend(components.iter().map(|component| component.log_joint(point)));
            let largest = joint.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if largest == f64::NEG_INFINITY {
                continue;
            }
            let sum: f64 = joint.iter().map(|&j| negligible_or_exp(j - largest)).sum();
            total += largest + sum.ln();
            for (moments, &j) in moments.iter_mut().zip(&joint) {
                moments.add(point, negligible_or_exp(j - largest) / sum);
            }
        }
        // M step: weighted mean and covariance, and their principal axes (eq. 11-13).
        components = moments
            .iter()
            .filter(|moments| moments.count >= 0.5 * config.min_points as f64)
            .filter_map(Moments::fit)
            .map(|cluster| Component::new(cluster, points.len(), config.noise))
            .collect();
        let mean = total / points.len() as f64;
        if mean - before < CONVERGED {
            break;
        }
        before = mean;
    }
    components
}

/// exp of what is at most zero; far down it is zero, which spares most of the work.
fn negligible_or_exp(log: f64) -> f64 {
    if log < -20.0 { 0.0 } else { log.exp() }
}
