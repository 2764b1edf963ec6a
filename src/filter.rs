//! The particle filter on the host, in f64: weights, resampling, ancestry (IV of the paper).

use crate::geometry::Pose;

/// ln Σ exp, of weights that may all be tiny.
fn log_sum_exp(logs: &[f64]) -> f64 {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if largest == f64::NEG_INFINITY {
        return largest;
    }
    largest + logs.iter().map(|log| (log - largest).exp()).sum::<f64>().ln()
}

/// Weights that sum to one from log-weights of any scale. Where no particle is possible, or a weight is not a number,
/// all are equally likely: nothing is known, and the filter goes on.
pub fn normalised(log_weights: &[f64]) -> Vec<f64> {
    let sum = log_sum_exp(log_weights);
    if !sum.is_finite() {
        return vec![1.0 / log_weights.len() as f64; log_weights.len()];
    }
    log_weights.iter().map(|log| (log - sum).exp()).collect()
}

/// 1 / Σ w²: how many particles of equal weight would be worth as much. Weights sum to one.
pub fn effective_sample_size(weights: &[f64]) -> f64 {
    1.0 / weights.iter().map(|w| w * w).sum::<f64>()
}

/// Systematic resampling: `count` indices, each drawn `count · weight` times on average, within one of it.
///
/// `offset` in (0, 1) is the only random number.
pub fn resample(weights: &[f64], count: usize, offset: f64) -> Vec<usize> {
    let total: f64 = weights.iter().sum();
    let mut drawn = Vec::with_capacity(count);
    let mut index = 0;
    let mut cumulative = weights.first().copied().unwrap_or(0.0);
    for tooth in 0..count {
        let target = (tooth as f64 + offset) / count as f64 * total;
        while cumulative < target && index + 1 < weights.len() {
            index += 1;
            cumulative += weights[index];
        }
        drawn.push(index);
    }
    drawn
}

/// The paths of all particles, which share what they have in common.
#[derive(Clone, Debug, Default)]
pub struct Ancestry {
    nodes: Vec<Node>,
    compacted: usize,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    parent: Option<u32>,
    world_from_robot: Pose,
}

impl Ancestry {
    /// Adds a pose to the path that ends in `parent`; the result is the new end.
    pub fn extend(&mut self, parent: Option<u32>, world_from_robot: Pose) -> u32 {
        self.nodes.push(Node { parent, world_from_robot });
        (self.nodes.len() - 1) as u32
    }

    /// The poses from the first step to this end.
    pub fn path(&self, end: u32) -> Vec<Pose> {
        let mut path: Vec<Pose> = std::iter::successors(Some(end), |&node| self.nodes[node as usize].parent)
            .map(|node| self.nodes[node as usize].world_from_robot)
            .collect();
        path.reverse();
        path
    }

    /// Forgets paths that died out, when enough has gathered to be worth it. Ends are renumbered in place.
    pub fn compact(&mut self, ends: &mut [u32]) {
        const SLACK: usize = 1 << 16;
        if self.nodes.len() < 2 * self.compacted + SLACK {
            return;
        }
        let mut alive = vec![false; self.nodes.len()];
        for &end in ends.iter() {
            let mut node = Some(end);
            while let Some(n) = node.filter(|&n| !alive[n as usize]) {
                alive[n as usize] = true;
                node = self.nodes[n as usize].parent;
            }
        }
        // A parent comes before its children, so one pass renumbers.
        let mut renumbered = vec![0u32; self.nodes.len()];
        let mut kept = Vec::new();
        for (old, node) in self.nodes.iter().enumerate().filter(|&(old, _)| alive[old]) {
            renumbered[old] = kept.len() as u32;
            kept.push(Node { parent: node.parent.map(|p| renumbered[p as usize]), ..*node });
        }
        ends.iter_mut().for_each(|end| *end = renumbered[*end as usize]);
        self.compacted = kept.len();
        self.nodes = kept;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_of_any_scale_are_normalised() {
        let weights = normalised(&[-100_000.0, -100_000.0 + 2f64.ln(), f64::NEG_INFINITY]);
        assert!((weights[0] - 1.0 / 3.0).abs() < 1e-9 && (weights[1] - 2.0 / 3.0).abs() < 1e-9 && weights[2] == 0.0);
        assert_eq!(normalised(&[f64::NEG_INFINITY; 4]), vec![0.25; 4]);
        assert_eq!(normalised(&[f64::NAN, 0.0]), vec![0.5; 2]);
    }

    #[test]
    fn effective_sample_size_counts_equal_weights() {
        assert!((effective_sample_size(&[0.25; 4]) - 4.0).abs() < 1e-12);
        assert!((effective_sample_size(&[1.0, 0.0, 0.0]) - 1.0).abs() < 1e-12);
    }

    /// Over all offsets each particle is drawn count · weight times, and in each draw within one of it.
    #[test]
    fn resampling_is_unbiased() {
        let weights = normalised(&[0.1f64.ln(), 0.35f64.ln(), 0.05f64.ln(), 0.5f64.ln()]);
        let (count, offsets) = (7, 10_000);
        let mut drawn = [0usize; 4];
        for o in 0..offsets {
            let mut once = [0usize; 4];
            resample(&weights, count, (o as f64 + 0.5) / offsets as f64).into_iter().for_each(|i| once[i] += 1);
            for (i, &times) in once.iter().enumerate() {
                assert!((times as f64 - count as f64 * weights[i]).abs() < 1.0 + 1e-9);
                drawn[i] += times;
            }
        }
        for (i, &times) in drawn.iter().enumerate() {
            assert!((times as f64 / offsets as f64 - count as f64 * weights[i]).abs() < 1e-3, "particle {i}");
        }
    }

    #[test]
    fn paths_survive_compaction() {
        let mut ancestry = Ancestry::default();
        let mut ends =
            vec![ancestry.extend(None, Pose::new(0.0, 0.0, 0.0)), ancestry.extend(None, Pose::new(0.0, 1.0, 0.0))];
        for step in 1..50_000 {
            ends = ends.iter().map(|&end| ancestry.extend(Some(end), Pose::new(f64::from(step), 0.0, 0.0))).collect();
            if step == 100 {
                ends[1] = ends[0];
            }
            ancestry.compact(&mut ends);
        }
        assert!(ancestry.nodes.len() < 100_100, "{} nodes", ancestry.nodes.len());
        for &end in &ends {
            let path = ancestry.path(end);
            assert_eq!(path.len(), 50_000);
            assert!(path.iter().enumerate().all(|(step, pose)| pose.x == step as f64 && pose.y == 0.0));
        }
    }
}
