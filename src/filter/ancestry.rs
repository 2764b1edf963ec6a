//! The paths of all particles.

use crate::geometry::Pose;

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
