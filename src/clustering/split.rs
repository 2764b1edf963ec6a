//! G-means: how many clusters, and a first assignment of the points (III-B).

use super::{ClusteringConfig, NORMALITY_THRESHOLD, anderson_darling};
use crate::ppca::{Cluster, Moments};
use nalgebra::Point2;

/// The test says little about fewer points.
const MIN_TESTED: usize = 8;
/// 2-means has settled long before, or circles between two assignments.
const MAX_ITERATIONS: usize = 20;

/// Groups of point indices; each point is in exactly one group.
pub fn g_means(points: &[Point2<f64>], config: &ClusteringConfig) -> Vec<Vec<usize>> {
    let mut undecided = vec![(0..points.len()).collect::<Vec<_>>()];
    let mut groups = Vec::new();
    while let Some(group) = undecided.pop() {
        match halves(points, &group, config) {
            Some((left, right)) => undecided.extend([right, left]),
            None if group.is_empty() => {}
            None => groups.push(group),
        }
    }
    groups
}

/// The two halves of a group that is not one Gaussian, or `None` where it passes for one.
fn halves(points: &[Point2<f64>], group: &[usize], config: &ClusteringConfig) -> Option<(Vec<usize>, Vec<usize>)> {
    if group.len() < MIN_TESTED.max(2 * config.min_points) {
        return None;
    }
    let whole = Cluster::fit(group.iter().map(|&i| points[i]))?;
    // Where 2-means of a Gaussian would settle: a half normal's mean is √(2/π) standard deviations off.
    let step = whole.direction * (2.0 * whole.along_variance / std::f64::consts::PI).sqrt();
    let mut centres = [whole.mean - step, whole.mean + step];
    let mut sides = vec![false; group.len()];
    for _ in 0..MAX_ITERATIONS {
        let mut moments = [Moments::default(); 2];
        let mut changed = false;
        for (side, &i) in sides.iter_mut().zip(group) {
            let nearer_second = (points[i] - centres[1]).norm_squared() < (points[i] - centres[0]).norm_squared();
            changed |= nearer_second != *side;
            *side = nearer_second;
            moments[usize::from(nearer_second)].add(points[i], 1.0);
        }
        if !changed || moments.iter().any(|m| m.count == 0.0) {
            break;
        }
        centres = moments.map(|m| m.mean.into());
    }
    let between = centres[1] - centres[0];
    let mut projected: Vec<f64> = group.iter().map(|&i| between.dot(&points[i].coords)).collect();
    let normal = anderson_darling::corrected_statistic(&mut projected) <= NORMALITY_THRESHOLD;
    let thin = whole.across_variance <= config.max_across * config.max_across;
    if normal && thin {
        return None;
    }
    let side = |wanted: bool| -> Vec<usize> {
        group.iter().zip(&sides).filter(|&(_, &s)| s == wanted).map(|(&i, _)| i).collect()
    };
    let (left, right) = (side(false), side(true));
    (!left.is_empty() && !right.is_empty()).then_some((left, right))
}
