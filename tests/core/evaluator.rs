//! The evaluator, which computes in f32 near the robot, against eq. 9 and 18 in f64 in the world's frame.

use crate::oracle::{Likelihood, slow, slow_density, slow_point, thick};
use crate::{normals, uniforms, wall};
use ipslam::ablation::Latent;
use ipslam::evaluator::cholesky::unpacked;
use ipslam::evaluator::cpu::cull::{Candidates, LocalMap};
use ipslam::evaluator::cpu::{Evaluation, View};
use ipslam::evaluator::pose::LocalPose;
use ipslam::evaluator::table::ClusterTable;
use ipslam::evaluator::tiles::{Tile, tiles};
use ipslam::geometry::Pose;
use ipslam::likelihood::{ClusterParams, LikelihoodConfig};
use ipslam::map::{MapCluster, Pool, Slot};
use ipslam::ppca::Cluster;
use nalgebra::{Point2, Vector2};
use std::f64::consts::{PI, TAU};

/// Mean of the points, in nats. Coordinates of 15 m are rounded by 1 µm in f32; where a standard deviation is 1 cm and a
/// point lies three of them off, that changes ln p by 3 · 1 µm / 1 cm = 3e-4. Few points lie so, and the signs differ
/// from point to point.
const TOLERANCE: f64 = 1e-4;

/// A map in the frame of the evaluator, and looks at it.
struct Near {
    map: LocalMap,
    origin: Point2<f64>,
}

impl Near {
    fn new(clusters: &[Cluster], pose: Pose, config: &Likelihood) -> Self {
        let origin = pose.position().map(f64::round);
        let params = clusters.iter().map(|cluster| ClusterParams::new(cluster, origin, config, config.latent));
        Self { map: LocalMap::new(params, config.log_outlier()), origin }
    }

    fn look<T>(&self, pose: Pose, tiles: &[Tile], look: impl FnOnce(View<'_>, LocalPose) -> T) -> T {
        let pose = LocalPose::new(pose, self.origin);
        let mut candidates = Candidates::default();
        candidates.cover(&self.map, tiles, &[pose], [0.0; 2]);
        look(View { tiles, candidates: &candidates, log_outlier: self.map.log_outlier() }, pose)
    }

    fn log_likelihood(&self, pose: Pose, tiles: &[Tile]) -> f64 {
        let mut out = [f32::NAN];
        self.look(pose, tiles, |view, pose| view.log_likelihoods(&[pose], &mut out));
        f64::from(out[0])
    }

    fn linearise(&self, pose: Pose, tiles: &[Tile]) -> Evaluation {
        self.look(pose, tiles, |view, pose| view.linearise(pose))
    }

    fn explain(&self, pose: Pose, tiles: &[Tile]) -> Vec<Option<usize>> {
        self.look(pose, tiles, |view, pose| view.explain(pose))
    }
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

fn configs() -> Vec<Likelihood> {
    let config = LikelihoodConfig::default();
    let floored = LikelihoodConfig { sigma_floor: 0.15, ..config };
    let normal = LikelihoodConfig { sigma_floor: 0.01, outlier_density: 1e-8, ..config };
    let uniform = Likelihood::default();
    vec![
        uniform,
        Likelihood { config: floored, ..uniform },
        Likelihood { config: normal, latent: Latent::Normal, ..uniform },
    ]
}

#[test]
fn log_likelihood_is_that_of_equation_18() {
    let mut worst: f64 = 0.0;
    for centre in [Point2::origin(), Point2::new(10_000.0, -7_000.0)] {
        for (seed, config) in (0..20).flat_map(|seed| configs().into_iter().map(move |config| (seed, config))) {
            let Scene { mut clusters, pose, points } = scene(seed, centre);
            let tiles = tiles(&points, usize::MAX);
            let found = Near::new(&clusters, pose, &config).log_likelihood(pose, &tiles);
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
        let explained = Near::new(&clusters, pose, &config).explain(pose, &tiles(&points, usize::MAX));
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

/// Candidate lists leave out only what cannot be the maximum: from any pose of a group the sums are the same to the last
/// bit as over all clusters.
#[test]
fn culling_never_changes_the_maximum() {
    let (mut listed, mut all) = (0, 0);
    for (seed, config) in (0..50).flat_map(|seed| configs().into_iter().map(move |config| (seed, config))) {
        let Scene { clusters, pose, mut points } = scene(seed, Point2::new(40.0, 30.0));
        // Neighbours in a tile are neighbours in the world, as the beams of a laser are.
        points.sort_by(|a, b| a.y.atan2(a.x).total_cmp(&b.y.atan2(b.x)));
        let tiles = tiles(&points, usize::MAX);
        let Near { map, origin } = Near::new(&clusters, pose, &config);
        let mut z = normals(seed);
        let mut near = |_| {
            let [x, y, heading] = [0.1, 0.1, 0.05].map(|sigma| sigma * z.next().unwrap());
            LocalPose::new(pose * Pose::new(x, y, heading), origin)
        };
        let poses: Vec<LocalPose> = (0..20).map(&mut near).collect();
        let mut candidates = Candidates::default();
        candidates.cover(&map, &tiles, &poses, [0.0; 2]);
        let everything = Candidates::everything(&map, &tiles);
        listed += candidates.len();
        all += everything.len();
        let sums = |candidates: &Candidates| {
            let mut out = vec![f32::NAN; poses.len()];
            View { tiles: &tiles, candidates, log_outlier: map.log_outlier() }.log_likelihoods(&poses, &mut out);
            out
        };
        assert_eq!(sums(&candidates), sums(&everything), "seed {seed}, {config:?}");
        for &pose in &poses {
            let explained =
                |candidates| View { tiles: &tiles, candidates, log_outlier: map.log_outlier() }.explain(pose);
            assert_eq!(explained(&candidates), explained(&everything), "seed {seed}, {config:?}");
        }
        // Lists for one place are not those of another: something is left out, and it matters where.
        let elsewhere = LocalPose { x: poses[0].x + 5.0, ..poses[0] };
        let mut there = Candidates::default();
        there.cover(&map, &tiles, &[elsewhere], [0.0; 2]);
        assert_ne!(sums(&there), sums(&everything), "seed {seed}, {config:?}: lists that hold elsewhere do as well");
    }
    println!("{listed} candidates of {all}: {:.1} %", 100.0 * listed as f64 / all as f64);
    assert!(2 * listed < all, "next to nothing was left out");
}

/// The vector instructions against the formula of `ClusterParams`, to the rounding of a few operations.
#[test]
fn vectors_compute_what_the_formula_says() {
    for (seed, config) in (0..10).flat_map(|seed| configs().into_iter().map(move |config| (seed, config))) {
        let Scene { clusters, pose, points } = scene(seed, Point2::origin());
        let params: Vec<_> = clusters
            .iter()
            .map(|c| ClusterParams::new(c, pose.position().map(f64::round), &config, config.latent))
            .collect();
        let near = Near::new(&clusters, pose, &config);
        for &point in &points {
            let moved = pose * point - near.origin.coords;
            let expected = params.iter().map(|c| c.log_density(moved.x as f32, moved.y as f32));
            let expected = expected.fold(config.log_outlier(), f32::max);
            let found = near.log_likelihood(pose, &tiles(&[point], 1)) as f32;
            assert!((found - expected).abs() < 5e-3, "seed {seed}: {found}, not {expected}");
        }
    }
}

/// Against the f64 formula of walls that are as thick; and no wall, thick or not, reaches a place that it is not near.
#[test]
fn thick_walls_are_walls_with_more_variance_across() {
    let mut left_out = 0;
    // Where outliers are likely, a wall of half a metre reaches further than one of five metres.
    let doubting = LikelihoodConfig { outlier_density: 0.5, ..LikelihoodConfig::default() };
    let doubting = Likelihood { config: doubting, capture_sigma: 5.0, ..Likelihood::default() };
    let configs = configs().into_iter().map(|config| Likelihood { capture_sigma: 0.6, ..config });
    let configs: Vec<_> = configs.chain([doubting]).collect();
    for (seed, config) in (0..10).flat_map(|seed| configs.iter().map(move |&config| (seed, config))) {
        let Scene { clusters, pose, points } = scene(seed, Point2::origin());
        let mut pool = Pool::default();
        let entry = |&cluster: &Cluster| MapCluster { cluster, last_step: 0, sightings: 1 };
        let slots: Vec<Slot> = clusters.iter().map(|cluster| pool.insert(entry(cluster))).collect();
        let mut table = ClusterTable::new(config.config, config.latent, config.capture_sigma);
        table.update(&mut pool, pose);
        for sigma in [0.01, 0.1, 0.45, config.capture_sigma] {
            let walls = thick(&clusters, sigma);
            let beside = clusters.iter().map(|cluster| cluster.mean + 0.45 * cluster.normal());
            for point in points.iter().map(|&point| pose * point).chain(beside) {
                let [x, y] = (point - table.anchor()).map(|number| number as f32).into();
                let near = table.near(&slots, x, y, 0.0);
                left_out += slots.len() - near.len();
                for &slot in &slots {
                    let expected = slow_density(&walls[slot as usize], point, &config);
                    if expected > config.outlier_density.ln() {
                        assert!(near.contains(&slot), "seed {seed}, {config:?}: {slot} is near {point}");
                        let found = table.rows()[slot as usize].thickened(sigma as f32).log_density(x, y);
                        let error = (f64::from(found) - expected).abs();
                        assert!(error < 5e-3, "seed {seed}, {sigma} m: {found}, not {expected}");
                    }
                }
            }
        }
    }
    println!("{left_out} left out");
    assert!(left_out > 0, "every wall is near every place: nothing tested");
}

/// Where a wall lies along an axis its box is tight: a point just likelier than an outlier is still found.
#[test]
fn a_wall_reaches_as_far_as_it_is_likelier_than_an_outlier() {
    let config = Likelihood::default();
    let clusters = [wall([-1.0, 0.0], [1.0, 0.0], 0.0, 50.0)];
    let map = Near::new(&clusters, Pose::IDENTITY, &config);
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
            let evaluation = Near::new(&clusters, pose, &config).linearise(pose, &tiles);
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
            let other = Near::new(&clusters, pose, &config).linearise(there, &tiles).gradient.map(f64::from);
            assert!(
                (nalgebra::Vector3::from(other) - nalgebra::Vector3::from(expected)).norm() / size > 2e-3,
                "{config:?}"
            );
        }
    }
}

#[test]
fn information_is_positive_semidefinite() {
    for (seed, config) in (0..20).flat_map(|seed| configs().into_iter().map(move |config| (seed, config))) {
        let Scene { clusters, pose, points } = scene(seed, Point2::origin());
        let evaluation = Near::new(&clusters, pose, &config).linearise(pose, &tiles(&points, usize::MAX));
        let information = unpacked(evaluation.information);
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
    let map = Near::new(&clusters, Pose::IDENTITY, &Likelihood::default());
    let information = unpacked(map.linearise(Pose::IDENTITY, &tiles(&points, usize::MAX)).information);
    // 21 points with σ = 3 cm, the floor.
    assert_eq!(information[(0, 0)], 0.0);
    assert!((information[(1, 1)] / (21.0 / 0.03f64.powi(2)) - 1.0).abs() < 1e-5, "{information}");
}

#[test]
fn nothing_to_see_is_no_error() {
    let config = Likelihood::default();
    let (clusters, points) = room();
    let none = tiles(&[], 180);
    assert!(none.is_empty());
    let map = Near::new(&clusters, Pose::IDENTITY, &config);
    assert_eq!(map.log_likelihood(Pose::IDENTITY, &none), 0.0);
    assert!(map.explain(Pose::IDENTITY, &none).is_empty());

    let empty = Near::new(&[], Pose::IDENTITY, &config);
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
