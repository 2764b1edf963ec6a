//! Clusters of walls that are known, equivariance, and input of the worst kind.

use crate::{normals, poses, uniforms, wall_points};
use ipslam::clustering::{Clustering, ClusteringConfig, cluster_points, cluster_scan};
use ipslam::geometry::Pose;
use ipslam::scan::Scan;
use nalgebra::{Point2, Vector2};
use proptest::prelude::*;
use std::collections::BTreeMap;

const NOISE: f64 = 0.005;
const WALLS: [([f64; 2], [f64; 2]); 3] = [([0.0, 0.0], [4.0, 0.0]), ([6.0, 1.0], [6.5, 5.0]), ([0.0, 3.0], [3.0, 6.0])];
const POINTS_A_WALL: usize = 120;
const SEED: u64 = 41;

/// Points of all walls, one wall after the other.
fn points() -> Vec<Point2<f64>> {
    (0..).zip(WALLS).flat_map(|(i, (a, b))| wall_points(a, b, NOISE, POINTS_A_WALL, SEED + i)).collect()
}

#[test]
fn clusters_lie_on_the_walls_that_made_the_points() {
    let points = points();
    let Clustering { clusters, assignment } = cluster_points(&points, &ClusteringConfig::default());
    assert!(clusters.len() >= WALLS.len(), "seed {SEED}: {} clusters", clusters.len());
    let assigned = assignment.iter().flatten().count();
    assert!(assigned as f64 > 0.97 * points.len() as f64, "seed {SEED}: {assigned} of {}", points.len());
    for (number, cluster) in clusters.iter().enumerate() {
        let members: Vec<usize> = (0..points.len()).filter(|&i| assignment[i] == Some(number)).collect();
        assert_eq!(members.len() as f64, cluster.count);
        let of_wall = |i: usize| i / POINTS_A_WALL;
        assert!(members.iter().all(|&i| of_wall(i) == of_wall(members[0])), "seed {SEED}: {number} is of two walls");
        let (a, b) = WALLS[of_wall(members[0])];
        let along = (Point2::from(b) - Point2::from(a)).normalize();
        let across = Vector2::new(-along.y, along.x);
        // Five standard errors of a fitted line: σ/√n of its height, σ/(σ₁√n) of its angle.
        let error = 5.0 * NOISE / cluster.count.sqrt();
        let height = across.dot(&(cluster.mean - Point2::from(a)));
        let angle = across.dot(&cluster.direction).abs();
        assert!(height.abs() < error, "seed {SEED}: cluster {number} is {height} m off its wall");
        assert!(angle < error / cluster.along_variance.sqrt(), "seed {SEED}: cluster {number} is {angle} rad off");
        assert!(cluster.across_variance.sqrt() < 2.0 * NOISE, "seed {SEED}: {cluster:?}");
    }
}

/// Whether two clusterings are the same but for the numbers of the clusters; says where they are not.
fn compare(a: &Clustering, b: &Clustering) -> Result<(), String> {
    const TOLERANCE: f64 = 1e-9;
    let mut number = BTreeMap::new();
    for (i, (of_a, of_b)) in a.assignment.iter().zip(&b.assignment).enumerate() {
        match (of_a, of_b) {
            (Some(in_a), Some(in_b)) if *number.entry(*in_a).or_insert(*in_b) == *in_b => {}
            (None, None) => {}
            _ => return Err(format!("point {i} is in {of_a:?} and in {of_b:?}")),
        }
    }
    if a.clusters.len() != b.clusters.len() || number.len() != a.clusters.len() {
        return Err(format!("{} and {} clusters", a.clusters.len(), b.clusters.len()));
    }
    for (in_a, in_b) in number {
        let (x, y) = (&a.clusters[in_a], &b.clusters[in_b]);
        let apart = (x.mean - y.mean).norm().max((x.covariance() - y.covariance()).norm());
        if apart > TOLERANCE || x.count != y.count {
            return Err(format!("{x:?} and {y:?} are {apart} apart"));
        }
    }
    Ok(())
}

fn moved(clustering: &Clustering, pose: Pose) -> Clustering {
    let clusters = clustering.clusters.iter().map(|cluster| cluster.transformed(pose)).collect();
    Clustering { clusters, assignment: clustering.assignment.clone() }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// Why a scan can be clustered in the robot's frame, once for all particles.
    #[test]
    fn moving_and_clustering_commute(pose in poses()) {
        let points = points();
        let config = ClusteringConfig::default();
        let moved_points: Vec<_> = points.iter().map(|&point| pose * point).collect();
        let clustering = cluster_points(&points, &config);
        compare(&moved(&clustering, pose), &cluster_points(&moved_points, &config)).map_err(TestCaseError::fail)?;

        let mut perturbed = moved_points;
        perturbed[17] += Vector2::new(0.001, 0.001);
        prop_assert!(compare(&moved(&clustering, pose), &cluster_points(&perturbed, &config)).is_err());
    }
}

#[test]
fn any_points_will_do() {
    let config = ClusteringConfig::default();
    let nothing = |count: usize| Clustering { clusters: vec![], assignment: vec![None; count] };
    let point = Point2::new(1.0, 2.0);
    assert_eq!(cluster_points(&[], &config), nothing(0));
    assert_eq!(cluster_points(&[point], &config), nothing(1));
    assert_eq!(cluster_points(&[Point2::new(f64::NAN, 1.0), Point2::new(0.0, f64::INFINITY)], &config), nothing(2));

    let equal = cluster_points(&[point; 20], &config);
    assert_eq!(equal.assignment, vec![Some(0); 20]);
    assert_eq!((equal.clusters[0].mean, equal.clusters[0].along_variance), (point, 0.0));
}

#[test]
fn points_that_are_not_finite_change_nothing_else() {
    let points = points();
    let clustering = cluster_points(&points, &ClusteringConfig::default());
    let mut spoilt = points.clone();
    spoilt.insert(100, Point2::new(f64::NAN, 0.0));
    spoilt.push(Point2::new(f64::NEG_INFINITY, 0.0));
    let mut found = cluster_points(&spoilt, &ClusteringConfig::default());
    assert_eq!((found.assignment.remove(100), found.assignment.pop()), (None, Some(None)));
    assert_eq!(found, clustering);
}

/// A Gaussian of the plane leaves exp(-m²/2) of its points beyond the Mahalanobis distance m.
#[test]
fn one_point_in_a_hundred_is_an_outlier() {
    const SEED: u64 = 42;
    const COUNT: usize = 4_000;
    let numbers: Vec<f64> = normals(SEED).take(2 * COUNT).collect();
    let points: Vec<_> = numbers.chunks(2).map(|z| Point2::new(1.5 * z[0], 0.05 * z[1])).collect();
    let config = ClusteringConfig { max_across: f64::INFINITY, max_gap: f64::INFINITY, ..ClusteringConfig::default() };
    let Clustering { clusters, assignment } = cluster_points(&points, &config);
    assert_eq!(clusters.len(), 1, "seed {SEED}");
    let share = assignment.iter().filter(|cluster| cluster.is_none()).count() as f64 / COUNT as f64;
    let tolerance = 4.0 * f64::sqrt(0.01 * 0.99 / COUNT as f64);
    assert!((share - 0.01).abs() < tolerance, "seed {SEED}: {share}, not 1 %");
}

#[test]
fn a_point_off_the_wall_is_left_out() {
    let ([x, y], b) = WALLS[2];
    let mut points = wall_points([x, y], b, NOISE, 150, SEED);
    points.push(Point2::new(x + 2.0, y + 1.0));
    let assignment = cluster_points(&points, &ClusteringConfig::default()).assignment;
    assert_eq!(assignment[150], None);
    assert!(assignment.iter().flatten().count() > 145, "seed {SEED}");
}

#[test]
fn a_stretch_without_points_cuts() {
    // Too few points for the test of normality: only the gap speaks against one cluster.
    let points = [0.0, 0.1, 0.2, 1.0, 1.1, 1.2].map(|x| Point2::new(x, 0.5 * x));
    let gap = 0.8 * f64::hypot(1.0, 0.5);
    for (max_gap, expected) in
        [(f64::INFINITY, [0, 0, 0, 0, 0, 0]), (gap + 1e-6, [0; 6]), (gap - 1e-6, [0, 0, 0, 1, 1, 1])]
    {
        let config = ClusteringConfig { max_gap, ..ClusteringConfig::default() };
        assert_eq!(cluster_points(&points, &config).assignment, expected.map(Some), "max_gap {max_gap}");
    }
    let config = ClusteringConfig { max_gap: 0.4, min_points: 4, ..ClusteringConfig::default() };
    assert!(cluster_points(&points, &config).clusters.is_empty(), "pieces of three points are too small");
}

/// A wall that the laser looks along is one, and a wall with an opening two, though its points lie as far apart.
#[test]
fn a_gap_is_where_the_laser_saw_something_else() {
    // Too few points for the test of normality. What is elsewhere is on the same line, further on.
    let on_line = |x: &f64| Point2::new(*x, 0.5 * x);
    for (elsewhere, is_one) in [(&[][..], true), (&[5.0][..], true), (&[5.0, 5.1][..], false)] {
        let points = [0.0, 0.1, 0.2].iter().chain(elsewhere).chain(&[1.0, 1.1]).map(on_line).collect();
        let scan = Scan { points, ..Scan::default() };
        let assignment = cluster_scan(&scan, &ClusteringConfig::default()).assignment;
        assert_eq!(assignment[..3], [Some(0); 3]);
        // Two points alone are no cluster.
        assert_eq!(assignment[assignment.len() - 2..], [is_one.then_some(0); 2], "{elsewhere:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Every cluster is the fit of its members and no smaller than allowed, whatever the points.
    #[test]
    fn clusters_are_fits_of_their_members(seed in 0u64..1000, count in 0usize..150, size in 0.01..20.0f64) {
        let numbers: Vec<f64> = uniforms(seed).take(2 * count).collect();
        let points: Vec<_> = numbers.chunks(2).map(|u| Point2::new(size * u[0], size * u[1])).collect();
        let config = ClusteringConfig::default();
        let Clustering { clusters, assignment } = cluster_points(&points, &config);
        for (number, cluster) in clusters.iter().enumerate() {
            let members: Vec<_> = (0..count).filter(|&i| assignment[i] == Some(number)).map(|i| points[i]).collect();
            prop_assert!(members.len() >= config.min_points);
            let mean = members.iter().map(|p| p.coords).sum::<Vector2<f64>>() / members.len() as f64;
            prop_assert!((cluster.mean.coords - mean).norm() < 1e-9 && cluster.count == members.len() as f64);
        }
    }
}
