//! The evaluator, which computes in f32 near the robot, against eq. 9 and 18 in f64 in the world's frame.

use crate::{normals, uniforms, wall};
use ipslam::evaluator::cpu::LocalMap;
use ipslam::evaluator::layout::{ClusterParams, Latent, LikelihoodConfig, LocalPose, tiles};
use ipslam::geometry::Pose;
use ipslam::ppca::Cluster;
use nalgebra::{Matrix2, Point2, Vector2};
use std::f64::consts::{PI, TAU};

/// Mean of the points, in nats. Coordinates of 15 m are rounded by 1 µm in f32; where a standard deviation is 1 cm and a
/// point lies three of them off, that changes ln p by 3 · 1 µm / 1 cm = 3e-4. Few points lie so, and the signs differ
/// from point to point.
const TOLERANCE: f64 = 1e-4;

/// ln max p of one point, written from eq. 9 and from the documentation of `ClusterParams`.
fn slow_point(clusters: &[Cluster], point: Point2<f64>, config: &LikelihoodConfig) -> f64 {
    let densities = clusters.iter().map(|cluster| {
        let offset = point - cluster.mean;
        let [ux, uy] = [cluster.direction.x, cluster.direction.y];
        match config.latent {
            Latent::Normal => {
                let floor = config.sigma_floor.powi(2);
                let (l1, l2) = (cluster.along_variance.max(floor), cluster.across_variance.max(floor));
                let (xx, xy, yy) = (l1 * ux * ux + l2 * uy * uy, (l1 - l2) * ux * uy, l1 * uy * uy + l2 * ux * ux);
                let covariance = Matrix2::new(xx, xy, xy, yy);
                let distance2 = (offset.transpose() * covariance.try_inverse().unwrap() * offset)[0];
                -TAU.ln() - 0.5 * covariance.determinant().ln() - 0.5 * distance2
            }
            Latent::Uniform => {
                let sigma = cluster.across_variance.sqrt().max(config.sigma_floor);
                let [a, b] = cluster.endpoints();
                let beyond = f64::max(offset.dot(&(a - b)).abs() / (a - b).norm() - 0.5 * (a - b).norm(), 0.0);
                let across = offset.perp(&cluster.direction);
                -0.5 * (TAU * sigma * sigma).ln()
                    - 0.5 * (beyond / config.end_sigma).powi(2)
                    - 0.5 * (across / sigma).powi(2)
            }
        }
    });
    densities.fold(config.outlier_density.ln(), f64::max)
}

fn slow(clusters: &[Cluster], pose: Pose, points: &[Point2<f64>], config: &LikelihoodConfig) -> f64 {
    points.iter().map(|&point| slow_point(clusters, pose * point, config)).sum()
}

/// A robot among walls, with points on them and some elsewhere.
struct Scene {
    clusters: Vec<Cluster>,
    pose: Pose,
    points: Vec<Point2<f64>>,
}

fn scene(seed: u64, centre: Point2<f64>) -> Scene {
    let (mut u, mut z) = (uniforms(seed), normals(seed));
    let mut between = |low: f64, high: f64| low + (high - low) * u.next().unwrap();
    let clusters: Vec<Cluster> = (0..40)
        .map(|_| {
            let (a, angle, length) =
                ([between(-12.0, 12.0), between(-12.0, 12.0)], between(-PI, PI), between(0.2, 6.0));
            let b = [a[0] + length * angle.cos(), a[1] + length * angle.sin()];
            let cluster = wall(a, b, between(0.0, 0.05), 50.0);
            Cluster { mean: cluster.mean + centre.coords, ..cluster }
        })
        .collect();
    let pose = Pose::new(centre.x + between(-3.0, 3.0), centre.y + between(-3.0, 3.0), between(-PI, PI));
    let points = (0..203)
        .map(|i| {
            let cluster = &clusters[i % clusters.len()];
            let scatter = if i % 10 == 0 { 1.0 } else { 0.03 };
            let along = cluster.direction * (0.6 * cluster.length() * between(-1.0, 1.0));
            pose.inverse() * (cluster.mean + along + Vector2::from_fn(|_, _| scatter * z.next().unwrap()))
        })
        .collect();
    Scene { clusters, pose, points }
}

fn configs() -> Vec<LikelihoodConfig> {
    let uniform = LikelihoodConfig::default();
    let normal = LikelihoodConfig { latent: Latent::Normal, sigma_floor: 0.01, outlier_density: 1e-8, ..uniform };
    vec![uniform, uniform.capturing(), normal]
}

#[test]
fn log_likelihood_is_that_of_equation_18() {
    let mut worst: f64 = 0.0;
    for centre in [Point2::origin(), Point2::new(10_000.0, -7_000.0)] {
        for (seed, config) in (0..20).flat_map(|seed| configs().into_iter().map(move |config| (seed, config))) {
            let Scene { mut clusters, pose, points } = scene(seed, centre);
            let tiles = tiles(&points, usize::MAX);
            let found = LocalMap::new(&clusters, pose, &config).log_likelihood(pose, &tiles);
            let expected = slow(&clusters, pose, &points, &config);
            let error = (found - expected).abs() / points.len() as f64;
            worst = worst.max(error);
            assert!(error < TOLERANCE, "seed {seed}, {centre}, {config:?}: {found}, not {expected}");

            let off = clusters[3].normal() * 0.1;
            clusters[3].mean += off;
            let perturbed = slow(&clusters, pose, &points, &config);
            let error = (found - perturbed).abs() / points.len() as f64;
            assert!(error > TOLERANCE, "seed {seed}, {config:?}: a wall that is 10 cm off goes unnoticed");
        }
    }
    println!("worst difference: {worst:.1e} nats a point, {TOLERANCE:.1e} allowed");
}

#[test]
fn points_are_explained_by_their_likeliest_cluster() {
    let mut outliers = 0;
    for (seed, config) in (0..10).flat_map(|seed| configs().into_iter().map(move |config| (seed, config))) {
        let Scene { clusters, pose, points } = scene(seed, Point2::origin());
        let explained = LocalMap::new(&clusters, pose, &config).explain(pose, &tiles(&points, usize::MAX));
        assert_eq!(explained.len(), points.len());
        for (&point, cluster) in points.iter().zip(explained) {
            let best = slow_point(&clusters, pose * point, &config);
            let chosen = cluster.map(|i| slow_point(&clusters[i..=i], pose * point, &config));
            outliers += usize::from(chosen.is_none());
            // A near tie may be decided either way: what is chosen has to be as likely as the best.
            assert!((chosen.unwrap_or(config.outlier_density.ln()) - best).abs() < 0.01, "seed {seed}: {cluster:?}");
        }
    }
    assert!((100..3_000).contains(&outliers), "{outliers} outliers: nothing tested");
}

/// The boxes leave out only what cannot be the maximum: the sum is the same to the last bit without them.
#[test]
fn support_boxes_never_change_the_maximum() {
    for (seed, config) in (0..50).flat_map(|seed| configs().into_iter().map(move |config| (seed, config))) {
        let Scene { clusters, pose, points } = scene(seed, Point2::new(40.0, 30.0));
        // One point a tile: a tile's own size is the slack of a box.
        let tiles: Vec<_> = points.iter().flat_map(|&point| tiles(&[point], 1)).collect();
        let origin = Point2::new(pose.x.round(), pose.y.round());
        let params: Vec<_> = clusters.iter().map(|cluster| ClusterParams::new(cluster, origin, &config)).collect();
        let at = LocalPose::new(pose, origin);
        let (sin, cos) = at.heading.sin_cos();
        let every_cluster = |px: f32, py: f32| {
            let (x, y) = (at.x + cos * px - sin * py, at.y + sin * px + cos * py);
            params.iter().fold(config.log_outlier(), |best, cluster| {
                let (dx, dy) = (x - cluster.mean[0], y - cluster.mean[1]);
                let [ux, uy] = cluster.direction;
                let (along, across) = (ux * dx + uy * dy, ux * dy - uy * dx);
                let beyond = (along.abs() - cluster.half_length).max(0.0) * cluster.along_scale;
                let across = across * cluster.across_scale;
                best.max(cluster.log_peak - 0.5 * (beyond * beyond + across * across))
            })
        };
        let expected = tiles.iter().fold(0.0, |sum, tile| {
            sum + (0..tile.count as usize).map(|lane| every_cluster(tile.x[lane], tile.y[lane])).sum::<f32>()
        });
        let found = LocalMap::new(&clusters, pose, &config).log_likelihood(pose, &tiles);
        assert_eq!(found, f64::from(expected), "seed {seed}, {config:?}");
    }
}

/// Where a wall lies along an axis its box is tight: a point just likelier than an outlier is still found.
#[test]
fn a_wall_reaches_as_far_as_it_is_likelier_than_an_outlier() {
    let config = LikelihoodConfig::default();
    let clusters = [wall([-1.0, 0.0], [1.0, 0.0], 0.0, 50.0)];
    let map = LocalMap::new(&clusters, Pose::IDENTITY, &config);
    let peak = -(TAU.sqrt() * config.sigma_floor).ln();
    let reach = (2.0 * (peak - config.outlier_density.ln())).sqrt();
    for (share, expected) in [(0.995, Some(0)), (1.005, None)] {
        let across = Point2::new(0.3, share * reach * config.sigma_floor);
        let beyond = Point2::new(1.0 + share * reach * config.end_sigma, 0.0);
        for point in [across, beyond] {
            assert_eq!(map.explain(Pose::IDENTITY, &tiles(&[point], 1)), [expected], "{point}");
        }
    }
}

/// Four walls around the robot, and points on them: no point is near a tie or beyond an end.
fn room() -> (Vec<Cluster>, Vec<Point2<f64>>) {
    let corners = [[-3.0, -2.0], [3.0, -2.0], [3.5, 2.0], [-3.0, 2.5]];
    let clusters: Vec<_> = (0..4).map(|i| wall(corners[i], corners[(i + 1) % 4], 0.02, 50.0)).collect();
    let points = clusters
        .iter()
        .flat_map(|cluster| {
            (-8..=8).map(|i| cluster.mean + cluster.direction * (0.05 * f64::from(i) * cluster.length()))
        })
        .collect();
    (clusters, points)
}

/// Differences of the slow formula by (forward, sideways, heading), at several poses that fit a little badly.
#[test]
fn gradient_is_the_derivative() {
    const STEP: f64 = 1e-6;
    let (clusters, points) = room();
    let tiles = tiles(&points, usize::MAX);
    for config in configs() {
        for pose in [Pose::new(0.02, -0.03, 0.004), Pose::new(-0.01, 0.02, -0.006)] {
            let evaluation = LocalMap::new(&clusters, pose, &config).linearise(pose, &tiles);
            let value = |step: Pose| slow(&clusters, pose * step, &points, &config);
            let steps = [Pose::new(STEP, 0.0, 0.0), Pose::new(0.0, STEP, 0.0), Pose::new(0.0, 0.0, STEP)];
            let expected = steps.map(|step| (value(step) - value(step.inverse())) / (2.0 * STEP));
            let size = expected.iter().fold(0.0, |size: f64, e| size.max(e.abs()));
            for (axis, (&found, expected)) in evaluation.gradient.iter().zip(expected).enumerate() {
                let error = (f64::from(found) - expected).abs() / size;
                assert!(error < 2e-3, "{config:?} {pose:?} axis {axis}: {found}, not {expected}");
            }
            let log_likelihood = f64::from(evaluation.log_likelihood);
            assert!((log_likelihood - value(Pose::IDENTITY)).abs() < TOLERANCE * points.len() as f64);
            // The gradient of another place is another one.
            let there = pose * Pose::new(0.005, 0.005, 0.0);
            let other = LocalMap::new(&clusters, pose, &config).linearise(there, &tiles).gradient_vector();
            assert!((other - nalgebra::Vector3::from(expected)).norm() / size > 2e-3, "{config:?}");
        }
    }
}

#[test]
fn information_is_positive_semidefinite() {
    for (seed, config) in (0..20).flat_map(|seed| configs().into_iter().map(move |config| (seed, config))) {
        let Scene { clusters, pose, points } = scene(seed, Point2::origin());
        let evaluation = LocalMap::new(&clusters, pose, &config).linearise(pose, &tiles(&points, usize::MAX));
        let information = evaluation.information_matrix();
        let eigenvalues = information.symmetric_eigenvalues();
        assert_eq!(information, information.transpose());
        assert!(eigenvalues.max() > 0.0 && eigenvalues.min() > -1e-5 * eigenvalues.max(), "seed {seed}: {eigenvalues}");
    }
}

/// One wall says nothing of where along it the robot is.
#[test]
fn information_along_a_single_wall_is_zero() {
    let clusters = [wall([-5.0, 1.0], [5.0, 1.0], 0.02, 50.0)];
    let points: Vec<_> = (-10..=10).map(|i| Point2::new(0.1 * f64::from(i), 1.0)).collect();
    let map = LocalMap::new(&clusters, Pose::IDENTITY, &LikelihoodConfig::default());
    let information = map.linearise(Pose::IDENTITY, &tiles(&points, usize::MAX)).information_matrix();
    // 21 points with σ = 3 cm, the floor.
    assert_eq!(information[(0, 0)], 0.0);
    assert!((information[(1, 1)] / (21.0 / 0.03f64.powi(2)) - 1.0).abs() < 1e-5, "{information}");
}

#[test]
fn nothing_to_see_is_no_error() {
    let config = LikelihoodConfig::default();
    let (clusters, points) = room();
    let none = tiles(&[], 180);
    assert!(none.is_empty());
    let map = LocalMap::new(&clusters, Pose::IDENTITY, &config);
    assert_eq!(map.log_likelihood(Pose::IDENTITY, &none), 0.0);
    assert!(map.explain(Pose::IDENTITY, &none).is_empty());

    let empty = LocalMap::new(&[], Pose::IDENTITY, &config);
    let tiles = tiles(&points, usize::MAX);
    let expected = points.len() as f64 * config.outlier_density.ln();
    assert!((empty.log_likelihood(Pose::IDENTITY, &tiles) - expected).abs() < TOLERANCE * points.len() as f64);
    assert_eq!(empty.explain(Pose::IDENTITY, &tiles), vec![None; points.len()]);
    assert_eq!(empty.linearise(Pose::IDENTITY, &tiles).gradient, [0.0; 3]);
}

#[test]
fn tiles_hold_every_so_manieth_point() {
    let points: Vec<_> = (0..361).map(|i| Point2::new(f64::from(i), -0.5 * f64::from(i))).collect();
    for (most, stride) in [(usize::MAX, 1), (361, 1), (360, 2), (180, 3), (1, 361)] {
        let tiles = tiles(&points, most);
        let held: Vec<f32> = tiles.iter().flat_map(|tile| tile.x[..tile.count as usize].to_vec()).collect();
        let expected: Vec<f32> = points.iter().step_by(stride).map(|point| point.x as f32).collect();
        assert_eq!(held, expected, "at most {most}");
        for tile in &tiles {
            for lane in 0..tile.x.len() {
                let off = (tile.x[lane] - tile.centre[0]).hypot(tile.y[lane] - tile.centre[1]);
                assert!(off <= tile.radius, "{off} m off, outside {}", tile.radius);
            }
        }
    }
}
