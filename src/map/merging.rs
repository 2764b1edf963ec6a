//! A scan's clusters become part of the map (III-E of the paper).

use super::matching::{Circle, MatchingConfig, line_distance, match_clusters};
use super::{MapCluster, Slot};
use crate::ablation::{AblationConfig, MergingMethod};
use crate::clustering::Clustering;
use crate::geometry::Pose;
use crate::parameters::parameters;
use crate::ppca::{Cluster, Moments};
use nalgebra::Point2;

parameters! {
    /// How a scan is merged into a map.
    pub struct MergingConfig {
        /// An unmatched cluster becomes part of the map only with at least this many points (III-E), of those that `new_density`
        /// counts.
        min_points: f64 = 3.0, in 0.0..=f64::INFINITY;
        /// An unmatched cluster becomes part of the map only with at most this standard deviation across \[m\] (III-E).
        max_across: f64 = 0.03, in 0.0..=f64::INFINITY;
        /// For an unmatched cluster only points count to which no cluster of the map gives this density \[1/m²\]: what the map
        /// explains is no new observation (Table I, 6c-v; 0.01 in section V). Infinite: all points count.
        new_density: f64 = f64::INFINITY, in 0.0..=f64::INFINITY;
        /// Nats, before tempering, that a map's log-weight loses with each cluster that it grows by: of two maps that explain
        /// the scans as well, the one that needs fewer walls is likelier. Where a loop closes, that is the one that
        /// recognised them.
        cluster_cost: f64 = 3.0, in 0.0..=f64::INFINITY;
        /// A cluster seen in fewer steps than this is clutter once `clutter_age` steps have passed; 0 keeps all.
        min_sightings: u32 = 3, in 0.0..=f64::INFINITY;
        /// Steps after which a cluster that was hardly ever seen is dropped.
        clutter_age: u32 = 30, in 0.0..=f64::INFINITY;
    }
}

/// What one scan changes in one map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapChange {
    /// Clusters that are no longer part of the map.
    pub removed: Vec<Slot>,
    /// Clusters that are new in it, or new versions of removed ones.
    pub added: Vec<MapCluster>,
}

/// One old and one new cluster as one (III-E). The centre is the weighted average of both.
pub fn merge(old: &Cluster, new: &Cluster, method: MergingMethod) -> Cluster {
    let union = old.moments().union(&new.moments());
    match method {
        MergingMethod::Moments => union.fit().unwrap_or(*old),
        MergingMethod::Incremental => incremental(old, new, &union),
    }
}

/// Eq. 16 for the m points of a cluster at once: with x = v/|v|,
/// v ← n/(n+m) v + 1/(n+m) Σ (z - μ)(z - μ)ᵀ x, the sum being known from the new cluster's moments.
///
/// The total variance is that of all points, so what is not along x is across it.
fn incremental(old: &Cluster, new: &Cluster, union: &Moments) -> Cluster {
    let offset = new.mean.coords - union.mean;
    let second_moment = new.covariance() + offset * offset.transpose();
    let share = new.count / union.count;
    let v = old.direction * (old.along_variance * (1.0 - share)) + second_moment * old.direction * share;
    let along_variance = v.norm();
    if along_variance <= 0.0 {
        return *old;
    }
    let total = union.scatter.trace() / union.count;
    Cluster {
        mean: union.mean.into(),
        direction: v / along_variance,
        along_variance: along_variance.min(total),
        across_variance: (total - along_variance).max(0.0),
        count: union.count,
    }
}

/// How many points of each cluster of a scan no cluster of a map explains: the new observations of Table I, 6c-v. The scan is in the
/// robot's frame. No standard deviation of the map is taken to be less than `sigma_floor` \[m\].
pub fn new_points(
    near: &[(Slot, MapCluster)],
    points: &[Point2<f64>],
    clustering: &Clustering,
    world_from_robot: Pose,
    sigma_floor: f64,
    config: &MergingConfig,
) -> Vec<f64> {
    if config.new_density.is_infinite() {
        return counts(&clustering.clusters);
    }
    let map: Vec<Cluster> =
        near.iter().map(|(_, entry)| entry.cluster.with_variance_floor(sigma_floor * sigma_floor)).collect();
    let mut counts = vec![0.0; clustering.clusters.len()];
    for (&point, cluster) in points.iter().zip(&clustering.assignment) {
        let point = world_from_robot * point;
        if let Some(cluster) = cluster
            && map.iter().all(|wall| wall.log_density(point) < config.new_density.ln())
        {
            counts[*cluster] += 1.0;
        }
    }
    counts
}

/// How many points each cluster stands for.
pub fn counts(clusters: &[Cluster]) -> Vec<f64> {
    clusters.iter().map(|cluster| cluster.count).collect()
}

/// Merges a scan's clusters, given in the world's frame, into the clusters of a map that lie near them (III-D, III-E). Of each,
/// `new_points` support it as a cluster of its own.
pub fn merge_scan(
    near: &[(Slot, MapCluster)],
    scan: &[Cluster],
    new_points: &[f64],
    step: u32,
    matching: &MatchingConfig,
    config: &MergingConfig,
    ablation: &AblationConfig,
) -> MapChange {
    let map: Vec<&Cluster> = near.iter().map(|(_, entry)| &entry.cluster).collect();
    let matches = match_clusters(&map, scan, matching, ablation.matching);
    let mut entries: Vec<Entry> =
        near.iter().map(|&(slot, entry)| Entry { slot: Some(slot), entry, state: State::Kept }).collect();
    for ((cluster, &new_points), matched) in scan.iter().zip(new_points).zip(matches) {
        let merged = matched.map(|index| (index, merge(&entries[index].entry.cluster, cluster, ablation.merging)));
        if let Some((index, merged)) = merged
            && (!ablation.consolidate || merged.across_variance <= config.max_across.powi(2))
        {
            let entry = &mut entries[index];
            entry.entry.cluster = merged;
            entry.entry.sightings += u32::from(entry.entry.last_step != step);
            entry.entry.last_step = step;
            entry.state = State::Changed;
        } else if new_points >= config.min_points && cluster.across_variance <= config.max_across.powi(2) {
            let entry = MapCluster { cluster: *cluster, last_step: step, sightings: 1 };
            entries.push(Entry { slot: None, entry, state: State::Changed });
        }
    }
    if ablation.consolidate {
        consolidate(&mut entries, matching, config);
    }
    for entry in &mut entries {
        let forgotten = entry.entry.sightings < config.min_sightings
            && entry.entry.last_step.saturating_add(config.clutter_age) < step;
        if forgotten && entry.state == State::Kept {
            entry.state = State::Gone;
        }
    }
    MapChange {
        removed: entries.iter().filter(|e| e.state != State::Kept).filter_map(|e| e.slot).collect(),
        added: entries.iter().filter(|e| e.state == State::Changed).map(|e| e.entry).collect(),
    }
}

struct Entry {
    slot: Option<Slot>,
    entry: MapCluster,
    state: State,
}

#[derive(Clone, Copy, PartialEq)]
enum State {
    Kept,
    Changed,
    Gone,
}

/// A map whose clusters that have come to overlap are one (many steps after [`merge_scan`] matched them). The union of two
/// was seen as often as the one of them that was seen more often.
pub fn consolidated(map: &[MapCluster], matching: &MatchingConfig, config: &MergingConfig) -> Vec<MapCluster> {
    let entry = |&entry: &MapCluster| Entry { slot: None, entry, state: State::Changed };
    let mut entries: Vec<Entry> = map.iter().map(entry).collect();
    consolidate(&mut entries, matching, config);
    entries.iter().filter(|e| e.state == State::Changed).map(|e| e.entry).collect()
}

/// Joins each changed cluster with what it has come to overlap, as long as the union is still a line.
fn consolidate(entries: &mut [Entry], matching: &MatchingConfig, config: &MergingConfig) {
    let mut circles: Vec<Circle> = entries.iter().map(|entry| Circle::around(&entry.entry.cluster)).collect();
    for i in 0..entries.len() {
        if entries[i].state != State::Changed {
            continue;
        }
        for j in 0..entries.len() {
            if !circles[i].may_match(&circles[j], matching) || i == j || entries[j].state == State::Gone {
                continue;
            }
            let (a, b) = (&entries[i].entry, &entries[j].entry);
            if line_distance(&a.cluster, &b.cluster, matching).is_infinite() {
                continue;
            }
            let union = merge(&a.cluster, &b.cluster, MergingMethod::Moments);
            if union.across_variance <= config.max_across.powi(2) {
                let (last_step, sightings) = (a.last_step.max(b.last_step), a.sightings.max(b.sightings));
                entries[i].entry = MapCluster { cluster: union, last_step, sightings };
                circles[i] = Circle::around(&union);
                entries[j].state = State::Gone;
            }
        }
    }
}
