//! Which clusters of a scan are which clusters of the map (III-D of the paper).

use crate::ablation::MatchingRule;
use crate::parameters::parameters;
use crate::ppca::Cluster;
use nalgebra::Point2;
use std::borrow::Borrow;

parameters! {
    /// How scan clusters find their map clusters.
    pub struct MatchingConfig {
        /// Principal components further apart than this are not the same wall \[rad\]: 20°; 60° in the paper.
        max_angle: f64 = 0.349_065_850_398_865_9, in 0.0..=f64::INFINITY;
        /// Paper's rule: pairs further apart than this are not matched \[m\]. Collinear rule: the lines of a match are at
        /// most this far apart \[m\], beyond what the clusters' own thickness explains.
        max_distance: f64 = 0.1, in 0.0..=f64::INFINITY;
        /// Collinear rule: the longest gap between the segments of a match \[m\]. Segments whose own points lie further apart may
        /// be as far from each other.
        max_gap: f64 = 0.3, in 0.0..=f64::INFINITY;
    }
}

/// Room for the thickness of clusters \[m\], and for the gaps between their points.
const MARGIN: f64 = 1.0;
/// A wall may go on for this many times the distance of its points beyond the last of them: they are not quite evenly spread.
const SPACINGS: f64 = 1.5;
/// A longer gap may be a door \[m\], however far apart the points are.
const DOOR: f64 = 0.8;

/// How far the end of a cluster may be from that of another one of the same wall \[m\], as far as its points tell.
fn gap(cluster: &Cluster) -> f64 {
    (SPACINGS * cluster.length() / cluster.count.max(1.0)).min(DOOR)
}

impl MatchingConfig {
    /// No cluster further from the robot \[m\] can match one of these, given in its frame, or one that such a match makes longer.
    pub fn reach(&self, clusters: &[Cluster]) -> f64 {
        let furthest = clusters.iter().map(|c| c.mean.coords.norm() + c.length()).fold(0.0, f64::max);
        furthest + 2.0 * (self.max_gap + self.max_distance + MARGIN)
    }
}

/// A circle around a cluster, to leave aside at little cost what is too far off to be the same wall.
#[derive(Clone, Copy, Debug)]
pub(super) struct Circle {
    centre: Point2<f64>,
    radius: f64,
    gap: f64,
}

impl Circle {
    pub(super) fn around(cluster: &Cluster) -> Self {
        let radius = (3.0 * cluster.along_variance).sqrt() + cluster.across_variance.sqrt();
        Self { centre: cluster.mean, radius, gap: gap(cluster) }
    }

    /// Whether two clusters in these circles may match at all, by whichever rule.
    pub(super) fn may_match(&self, other: &Self, config: &MatchingConfig) -> bool {
        let max_gap = config.max_gap.max(self.gap).max(other.gap);
        let reach = self.radius + other.radius + max_gap + config.max_distance;
        (self.centre - other.centre).norm_squared() <= reach * reach
    }
}

/// For each scan cluster the index of its map cluster, if it has one. Both sets are in the world's frame.
pub fn match_clusters<C: Borrow<Cluster>>(
    map: &[C],
    scan: &[Cluster],
    config: &MatchingConfig,
    rule: MatchingRule,
) -> Vec<Option<usize>> {
    let circles: Vec<Circle> = map.iter().map(|cluster| Circle::around(cluster.borrow())).collect();
    match rule {
        MatchingRule::Paper => greedy(map, &circles, scan, config),
        MatchingRule::Collinear => scan.iter().map(|cluster| most_collinear(map, &circles, cluster, config)).collect(),
    }
}

/// Greedily the pairs of smallest distance, each cluster in one pair at most.
fn greedy<C: Borrow<Cluster>>(
    map: &[C],
    circles: &[Circle],
    scan: &[Cluster],
    config: &MatchingConfig,
) -> Vec<Option<usize>> {
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (s, scan_cluster) in scan.iter().enumerate() {
        for (m, map_cluster) in near(map, circles, scan_cluster, config) {
            let distance = paper_distance(map_cluster, scan_cluster, config.max_angle);
            if distance <= config.max_distance {
                pairs.push((distance, s, m));
            }
        }
    }
    pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut matches = vec![None; scan.len()];
    let mut taken = vec![false; map.len()];
    for (_, s, m) in pairs {
        if matches[s].is_none() && !taken[m] {
            matches[s] = Some(m);
            taken[m] = true;
        }
    }
    matches
}

/// The metric of III-D \[m\]. The paper leaves open which "other metric" serves where the centres lie within the sum of
/// the principal variances; it is the mean distance of each centre from the other's line, which does not grow along a
/// wall. Variances are compared as standard deviations: a distance can only be compared with a length.
pub fn paper_distance(a: &Cluster, b: &Cluster, max_angle: f64) -> f64 {
    if a.direction.dot(&b.direction).abs() < max_angle.cos() {
        return f64::INFINITY;
    }
    let apart = b.mean - a.mean;
    if apart.norm() <= a.along_variance.sqrt() + b.along_variance.sqrt() {
        0.5 * (a.normal().dot(&apart).abs() + b.normal().dot(&apart).abs())
    } else {
        apart.norm()
    }
}

/// The clusters of a map that may match a cluster, and their places in it.
fn near<'a, C: Borrow<Cluster>>(
    map: &'a [C],
    circles: &'a [Circle],
    cluster: &Cluster,
    config: &'a MatchingConfig,
) -> impl Iterator<Item = (usize, &'a Cluster)> {
    let circle = Circle::around(cluster);
    let is_near = move |candidate: &(usize, &Circle)| candidate.1.may_match(&circle, config);
    circles.iter().enumerate().filter(is_near).map(|(index, _)| (index, map[index].borrow()))
}

/// The map cluster on whose line a cluster lies best.
fn most_collinear<C: Borrow<Cluster>>(
    map: &[C],
    circles: &[Circle],
    cluster: &Cluster,
    config: &MatchingConfig,
) -> Option<usize> {
    let near = near(map, circles, cluster, config);
    let distances = near.map(|(index, candidate)| (index, line_distance(candidate, cluster, config)));
    let (best, distance) = distances.min_by(|a, b| a.1.total_cmp(&b.1))?;
    distance.is_finite().then_some(best)
}

/// How far two clusters are from lying on one line without a gap \[m\]; infinite where they are not the same wall.
pub fn line_distance(a: &Cluster, b: &Cluster, config: &MatchingConfig) -> f64 {
    let (long, short) = if a.along_variance >= b.along_variance { (a, b) } else { (b, a) };
    let apart = short.mean - long.mean;
    let (along, across) = (long.direction.dot(&apart), long.normal().dot(&apart));
    let half = 3f64.sqrt();
    let (long_half, short_half) = (half * long.along_variance.sqrt(), half * short.along_variance.sqrt());
    let alignment = long.direction.dot(&short.direction).abs();
    let max_gap = config.max_gap.max(gap(a)).max(gap(b));
    if alignment < config.max_angle.cos() || along.abs() - long_half - short_half * alignment > max_gap {
        return f64::INFINITY;
    }
    let tolerance = config.max_distance + long.across_variance.sqrt() + short.across_variance.sqrt();
    if across.abs() > tolerance { f64::INFINITY } else { across.abs() }
}
