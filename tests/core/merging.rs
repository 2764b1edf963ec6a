//! Merging of clusters (III-E): incremental PCA against PCA, and what becomes part of a map.

use crate::{normals, wall};
use ipslam::ablation::{AblationConfig, MergingMethod};
use ipslam::clustering::Clustering;
use ipslam::config::SlamConfig;
use ipslam::geometry::Pose;
use ipslam::map::MapCluster;
use ipslam::map::matching::MatchingConfig;
use ipslam::map::merging::{MergingConfig, consolidated, merge, merge_scan, new_points};
use ipslam::ppca::Cluster;
use nalgebra::{Point2, Vector2};
use proptest::prelude::*;

const SEED: u64 = 51;
const BATCHES: usize = 500;
const BATCH: usize = 20;
/// The Gaussian that the batches are drawn from: angle [rad] and standard deviations [m].
const ANGLE: f64 = 0.6;
const ALONG: f64 = 1.0;
const ACROSS: f64 = 0.1;

/// Points of the Gaussian around (3, -4).
fn gaussian(count: usize) -> Vec<Point2<f64>> {
    let (u, v) = (Vector2::new(ANGLE.cos(), ANGLE.sin()), Vector2::new(-ANGLE.sin(), ANGLE.cos()));
    let numbers: Vec<f64> = normals(SEED).take(2 * count).collect();
    numbers.chunks(2).map(|z| Point2::new(3.0, -4.0) + u * (ALONG * z[0]) + v * (ACROSS * z[1])).collect()
}

/// Whether a cluster's principal component is that of the Gaussian, within five standard errors of `count` points:
/// σ₁σ₂/((σ₁² - σ₂²)√n) of the angle, σ₁²√(2/n) of the variance along. The variance across is allowed the same, because
/// incremental PCA knows it only as the total variance less that along.
fn check(cluster: &Cluster, count: f64) -> Result<(), String> {
    let normal = Vector2::new(-ANGLE.sin(), ANGLE.cos());
    let angle = cluster.direction.dot(&normal).abs();
    let angle_error = 5.0 * ALONG * ACROSS / (ALONG * ALONG - ACROSS * ACROSS) / count.sqrt();
    let along = (cluster.along_variance / (ALONG * ALONG) - 1.0).abs();
    let across = (cluster.across_variance - ACROSS * ACROSS).abs() / (ALONG * ALONG);
    let variance_error = 5.0 * (2.0 / count).sqrt();
    let report = format!(
        "seed {SEED}: angle {angle} of {angle_error}, variance along {along} and across {across} of {variance_error}"
    );
    println!("{report}");
    if angle < angle_error && along < variance_error && across < variance_error { Ok(()) } else { Err(report) }
}

/// Eq. 16 tends to the principal component, from a start half a radian off.
#[test]
fn incremental_pca_converges_to_pca() {
    let points = gaussian(BATCHES * BATCH);
    let mut batches = points.chunks(BATCH).map(|batch| Cluster::fit(batch.iter().copied()).unwrap());
    let first = batches.next().unwrap();
    let off = ANGLE + 0.5;
    let mut merged = Cluster { direction: Vector2::new(off.cos(), off.sin()), ..first };
    let after_one = merge(&merged, &first, MergingMethod::Incremental);
    for batch in batches {
        merged = merge(&merged, &batch, MergingMethod::Incremental);
    }
    let whole = Cluster::fit(points.iter().copied()).unwrap();
    assert_eq!(merged.count, whole.count);
    assert!((merged.mean - whole.mean).norm() < 1e-9);
    check(&whole, whole.count).unwrap();
    check(&merged, whole.count).unwrap();
    assert!(check(&after_one, whole.count).is_err(), "one batch is not enough");
}

/// Eq. 16 with a cluster of one point, m being the number of points with it.
#[test]
fn one_point_is_merged_as_in_equation_16() {
    let old = Cluster {
        mean: Point2::new(1.0, 2.0),
        direction: Vector2::new(0.8, 0.6),
        along_variance: 2.0,
        across_variance: 0.1,
        count: 9.0,
    };
    let z = Point2::new(3.0, 2.5);
    let merged = merge(&old, &Cluster::fit([z]).unwrap(), MergingMethod::Incremental);
    let (m, mean) = (10.0, (old.mean.coords * 9.0 + z.coords) / 10.0);
    let offset = z.coords - mean;
    let v = old.direction * (old.along_variance * (m - 1.0) / m) + offset * offset.dot(&old.direction) / m;
    assert!((merged.mean.coords - mean).norm() < 1e-12, "{merged:?}");
    assert!((merged.direction * merged.along_variance - v).norm() < 1e-12, "{merged:?}, v = {v}");
    assert!((merged.direction.norm() - 1.0).abs() < 1e-12 && merged.count == m);
}

fn points() -> impl Strategy<Value = Vec<Point2<f64>>> {
    proptest::collection::vec((-5.0..5.0, -2.0..2.0).prop_map(|(x, y)| Point2::new(x, x - y)), 1..40)
}

proptest! {
    #[test]
    fn merged_moments_are_those_of_all_points(a in points(), b in points(), shift in 0.01..1.0f64) {
        let fit = |points: &[Point2<f64>]| Cluster::fit(points.iter().copied()).unwrap();
        let whole = fit(&[a.clone(), b.clone()].concat());
        let merged = merge(&fit(&a), &fit(&b), MergingMethod::Moments);
        let apart = |x: &Cluster| (x.mean - whole.mean).norm() + (x.covariance() - whole.covariance()).norm();
        prop_assert!(apart(&merged) < 1e-9 && (merged.count - whole.count).abs() < 1e-12, "{:?} {:?}", merged, whole);

        let moved: Vec<_> = b.iter().map(|p| p + Vector2::new(shift, 0.0)).collect();
        prop_assert!(apart(&merge(&fit(&a), &fit(&moved), MergingMethod::Moments)) > 1e-9);
    }
}

fn configs() -> [(MatchingConfig, MergingConfig, AblationConfig); 2] {
    [SlamConfig::default(), SlamConfig::paper()].map(|config| (config.matching, config.merging, config.ablation))
}

#[test]
fn only_well_supported_thin_clusters_are_added() {
    for (matching, merging, ablation) in configs() {
        let with = |across: f64, count: f64| wall([0.0, 0.0], [2.0, 0.0], across, count);
        for (cluster, added) in [
            (with(0.9 * merging.max_across, merging.min_points), true),
            (with(0.9 * merging.max_across, merging.min_points - 1.0), false),
            (with(1.1 * merging.max_across, merging.min_points), false),
        ] {
            let change = merge_scan(&[], &[cluster], &[cluster.count], 7, &matching, &merging, &ablation);
            let expected = MapCluster { cluster, last_step: 7, sightings: 1 };
            assert_eq!(change.added, if added { vec![expected] } else { vec![] }, "{merging:?}");
            assert!(change.removed.is_empty());
        }
    }
}

/// A wall along the y axis, 2 m ahead of a robot that faces it, of which the map has the lower half: the upper half is new.
#[test]
fn points_that_the_map_explains_are_not_new() {
    let points: Vec<Point2<f64>> = (0..40).map(|i| Point2::new(2.0, 0.1 * f64::from(i) - 1.95)).collect();
    let world_from_robot = Pose::new(3.0, -1.0, std::f64::consts::FRAC_PI_2);
    let cluster = Cluster::fit(points.iter().copied()).unwrap();
    let assignment = (0..40).map(|i| (i != 39).then_some(0)).collect();
    let clustering = Clustering { clusters: vec![cluster], assignment };
    // Seen from the robot, y is to the left: of the world that is -x.
    let half = wall([3.0, 1.0], [5.0, 1.0], 0.01, 20.0);
    let near = [(0, MapCluster { cluster: half, last_step: 0, sightings: 1 })];
    let count = |new_density: f64, pose: Pose| {
        let config = MergingConfig { new_density, ..MergingConfig::default() };
        new_points(&near, &points, &clustering, pose, 0.01, &config)[0]
    };
    assert_eq!(count(f64::INFINITY, world_from_robot), 40.0, "all count");
    // By eq. 9, written out apart: the half, a Gaussian of variance 4/12 m² along, explains all but six of the 39.
    assert_eq!(count(0.01, world_from_robot), 6.0);
    assert_eq!(count(0.01, Pose::new(3.0, -2.0, world_from_robot.heading)), 39.0, "another wall");
    assert_eq!(count(0.0, world_from_robot), 0.0, "nothing is less likely");
}

#[test]
fn a_match_replaces_the_old_cluster_and_leaves_others_alone() {
    for (matching, merging, ablation) in configs() {
        let old = wall([0.0, 0.0], [2.0, 0.0], 0.01, 50.0);
        let other = wall([0.0, 5.0], [2.0, 5.0], 0.01, 50.0);
        let entry = |cluster| MapCluster { cluster, last_step: 6, sightings: 4 };
        let new = wall([0.5, 0.01], [2.5, 0.01], 0.01, 40.0);
        let near = [(3, entry(old)), (8, entry(other))];
        let change = merge_scan(&near, &[new], &[new.count], 7, &matching, &merging, &ablation);
        assert_eq!(change.removed, [3]);
        let cluster = merge(&old, &new, ablation.merging);
        assert_eq!(change.added, [MapCluster { cluster, last_step: 7, sightings: 5 }]);
    }
}

#[test]
fn consolidation_joins_what_is_one_wall() {
    let SlamConfig { matching, merging, .. } = SlamConfig::default();
    let half = wall([0.0, 0.0], [2.0, 0.0], 0.01, 50.0);
    for (other, joined, what) in [
        (wall([2.1, 0.0], [4.0, 0.0], 0.01, 50.0), true, "the other half"),
        (wall([0.5, 0.02], [1.5, 0.02], 0.01, 20.0), true, "a part of it"),
        (wall([0.0, 0.3], [2.0, 0.3], 0.01, 50.0), false, "a parallel wall"),
        (wall([1.0, -1.0], [1.0, 1.0], 0.01, 50.0), false, "a crossing wall"),
        (wall([2.5, 0.0], [4.0, 0.0], 0.01, 50.0), false, "a wall behind a gap"),
    ] {
        let entry = |cluster| MapCluster { cluster, last_step: 0, sightings: 3 };
        let map = consolidated(&[entry(half), entry(other)], &matching, &merging);
        let map: Vec<Cluster> = map.iter().map(|entry| entry.cluster).collect();
        if joined {
            let [union] = map[..] else { panic!("{what}: {map:?}") };
            let expected = merge(&half, &other, MergingMethod::Moments);
            assert!((union.mean - expected.mean).norm() < 1e-12 && union.count == expected.count, "{what}: {union:?}");
        } else {
            assert_eq!(map, [half, other], "{what}");
        }
    }
}

/// A scan that sees the doorway closed makes one wall of two.
#[test]
fn a_scan_joins_two_halves_of_the_map() {
    let SlamConfig { matching, merging, ablation, .. } = SlamConfig::default();
    let halves = [wall([0.0, 0.0], [2.0, 0.0], 0.01, 50.0), wall([3.0, 0.0], [5.0, 0.0], 0.01, 50.0)];
    let near: Vec<_> =
        (0..).zip(halves).map(|(slot, cluster)| (slot, MapCluster { cluster, last_step: 5, sightings: 4 })).collect();
    let between = wall([1.8, 0.0], [3.2, 0.0], 0.01, 30.0);
    let mut change = merge_scan(&near, &[between], &[between.count], 6, &matching, &merging, &ablation);
    change.removed.sort_unstable();
    assert_eq!(change.removed, [0, 1]);
    let [joined] = change.added[..] else { panic!("{:?}", change.added) };
    assert_eq!((joined.cluster.count, joined.last_step), (130.0, 6));
}

#[test]
fn what_was_hardly_seen_is_dropped_with_age() {
    let SlamConfig { matching, merging, ablation, .. } = SlamConfig::default();
    let cluster = wall([0.0, 0.0], [2.0, 0.0], 0.01, 50.0);
    for (sightings, step, dropped) in [
        (merging.min_sightings - 1, 10 + merging.clutter_age, false),
        (merging.min_sightings - 1, 11 + merging.clutter_age, true),
        (merging.min_sightings, 11 + merging.clutter_age, false),
    ] {
        let entry = MapCluster { cluster, last_step: 10, sightings };
        let change = merge_scan(&[(4, entry)], &[], &[], step, &matching, &merging, &ablation);
        assert_eq!(change.removed, if dropped { vec![4] } else { vec![] }, "{sightings} sightings, step {step}");
        assert!(change.added.is_empty());
    }
}
