//! Eq. 9, 17 and 18 written out in f64, in the world's frame: slow, and as they stand in the paper and in the
//! documentation of `ClusterParams`.

#![allow(dead_code)] // Not every test needs all of it.

use ipslam::ablation::Latent;
use ipslam::geometry::Pose;
use ipslam::likelihood::LikelihoodConfig;
use ipslam::ppca::Cluster;
use nalgebra::{Matrix2, Matrix3, Point2, Vector2, Vector3};
use std::f64::consts::TAU;
use std::ops::Deref;

/// How likely points are: the configuration of eq. 18, the distribution along a cluster, and how thick walls are at first.
#[derive(Clone, Copy, Debug)]
pub struct Likelihood {
    pub config: LikelihoodConfig,
    pub latent: Latent,
    pub capture_sigma: f64,
}

impl Default for Likelihood {
    fn default() -> Self {
        Self { config: LikelihoodConfig::default(), latent: Latent::Uniform, capture_sigma: 0.15 }
    }
}

impl Deref for Likelihood {
    type Target = LikelihoodConfig;

    fn deref(&self) -> &LikelihoodConfig {
        &self.config
    }
}

/// ln max p of one point of the world.
pub fn slow_point(clusters: &[Cluster], point: Point2<f64>, config: &Likelihood) -> f64 {
    let densities = clusters.iter().map(|cluster| slow_density(cluster, point, config));
    densities.fold(config.outlier_density.ln(), f64::max)
}

/// ln p of one point of the world in one cluster.
pub fn slow_density(cluster: &Cluster, point: Point2<f64>, config: &Likelihood) -> f64 {
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
            let half = 0.5 * (a - b).norm();
            let beyond = f64::max(offset.dot(&cluster.direction).abs() - half, 0.0);
            let across = offset.perp(&cluster.direction);
            -0.5 * (TAU * sigma * sigma).ln()
                - 0.5 * (beyond / config.end_sigma).powi(2)
                - 0.5 * (across / sigma).powi(2)
        }
    }
}

/// Σ max ln p over points of the robot's frame (eq. 18).
pub fn slow(clusters: &[Cluster], pose: Pose, points: &[Point2<f64>], config: &Likelihood) -> f64 {
    points.iter().map(|&point| slow_point(clusters, pose * point, config)).sum()
}

/// The same clusters, their standard deviation across at least this.
pub fn thick(clusters: &[Cluster], sigma: f64) -> Vec<Cluster> {
    let thick = |c: &Cluster| Cluster { across_variance: c.across_variance.max(sigma * sigma), ..*c };
    clusters.iter().map(thick).collect()
}

/// Gauss-Newton steps from `start` up the log of eq. 18 plus that of a robust prior around `prior`, by differences of the
/// residuals: thick walls for half of the steps, then walls as they are. At most 0.3 m, 0.3 m, 0.15 rad a step.
pub fn slow_climb(
    clusters: &[Cluster],
    start: Pose,
    prior: (Pose, Matrix3<f64>),
    points: &[Point2<f64>],
    config: &Likelihood,
    iterations: u32,
) -> Pose {
    let thick = thick(clusters, config.capture_sigma);
    let captured = slow_steps(&thick, start, prior, points, config, iterations / 2);
    slow_steps(clusters, captured, prior, points, config, iterations)
}

fn slow_steps(
    clusters: &[Cluster],
    start: Pose,
    (mean, prior_information): (Pose, Matrix3<f64>),
    points: &[Point2<f64>],
    config: &Likelihood,
    iterations: u32,
) -> Pose {
    const STEP: f64 = 1e-6;
    let moved = |pose: Pose, axis: usize, by: f64| {
        let mut step = [0.0; 3];
        step[axis] = by;
        pose * Pose::new(step[0], step[1], step[2])
    };
    let derivative = |pose: Pose, f: &dyn Fn(Pose) -> f64| {
        Vector3::from_fn(|axis, _| (f(moved(pose, axis, STEP)) - f(moved(pose, axis, -STEP))) / (2.0 * STEP))
    };
    let off = |pose: Pose| {
        let seen = pose.seen_from(mean);
        Vector3::new(seen.x, seen.y, seen.heading)
    };
    let mut pose = start;
    for _ in 0..iterations {
        let jacobian = Matrix3::from_fn(|row, axis| derivative(pose, &|p| off(p)[row])[axis]);
        // Cauchy's weight of the prior, 1 / (1 + d²/c²) with c = 2.3849.
        let weight = 1.0 / (1.0 + (off(pose).transpose() * prior_information * off(pose))[0] / 5.68775);
        let mut information = jacobian.transpose() * prior_information * jacobian * weight;
        let mut gradient = -(jacobian.transpose() * prior_information * off(pose)) * weight;
        for &point in points {
            let world = pose * point;
            let density = |cluster: &&Cluster| slow_density(cluster, world, config);
            let Some(best) = clusters.iter().max_by(|a, b| density(a).total_cmp(&density(b))) else { continue };
            if density(&best) <= config.outlier_density.ln() {
                continue;
            }
            let floor = config.sigma_floor.powi(2);
            let mut residual = |axis: Vector2<f64>, sigma: f64| {
                let residual = |pose: Pose| (pose * point - best.mean).dot(&axis) / sigma;
                let slope = derivative(pose, &residual);
                information += slope * slope.transpose();
                gradient -= slope * residual(pose);
            };
            residual(best.normal(), best.across_variance.max(floor).sqrt());
            if config.latent == Latent::Normal {
                residual(best.direction, best.along_variance.max(floor).sqrt());
            }
        }
        let Some(inverse) = information.try_inverse() else { break };
        let step = inverse * gradient;
        let shrink = (0..3).map(|k| [0.3, 0.3, 0.15][k] / step[k].abs().max(1e-12)).fold(1.0, f64::min);
        pose = pose * Pose::new(step.x * shrink, step.y * shrink, step.z * shrink);
    }
    pose
}
