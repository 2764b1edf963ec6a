//! How likely a measurement is, given a map (eq. 18): its configuration, and a cluster as it is evaluated, in f32 and in a
//! frame near the robot.

use crate::ablation::Latent;
use crate::math::ln;
use crate::parameters::parameters;
use crate::ppca::Cluster;
use bytemuck::{Pod, Zeroable};
use nalgebra::{Point2, Vector2};
use std::f32::consts::SQRT_2;

parameters! {
    /// How likely a measurement is, given a map (eq. 18).
    pub struct LikelihoodConfig {
        /// No standard deviation of a cluster is taken to be smaller \[m\]: what the map and the laser get wrong together.
        sigma_floor: f64 = 0.03, in 1e-6..=1e3;
        /// Uniform latent: standard deviation of the fall-off beyond a segment's ends \[m\]. Walls go on where they have
        /// not been seen, so an end says little.
        end_sigma: f64 = 0.1, in 1e-6..=1e3;
        /// Density \[1/m²\] of a point that no cluster explains; no point is less likely than this.
        outlier_density: f64 = 0.01, in 1e-30..=1e6;
        /// At most this many points of a scan are used, evenly spread over its beams.
        max_points: usize = 180, in 1.0..=f64::INFINITY;
    }
}

impl LikelihoodConfig {
    /// ln of the density of a point that no cluster explains.
    pub fn log_outlier(&self) -> f32 {
        self.outlier_density.ln() as f32
    }
}

/// A cluster as the kernels see it, in the evaluator's frame: for a point (x, y),
/// ln p = `log_peak` - max(|a| - `half_length`, 0)² - c², where a = `along` · (x, y, 1) and c = `across` · (x, y, 1) are
/// its offsets from the mean in units of √2 standard deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ClusterParams {
    /// Offset along the cluster; the unit is that of the fall-off beyond its ends.
    pub along: [f32; 3],
    /// Half the length of the part where every place is as likely, in the unit of `along`; 0 for a normal latent.
    pub half_length: f32,
    /// Offset across it.
    pub across: [f32; 3],
    /// ln p at the mean.
    pub log_peak: f32,
}

impl ClusterParams {
    /// A cluster of the world as the kernels see it, relative to `origin`.
    pub fn new(cluster: &Cluster, origin: Point2<f64>, config: &LikelihoodConfig, latent: Latent) -> Self {
        let mean = cluster.mean - origin;
        let floored = cluster.with_variance_floor(config.sigma_floor * config.sigma_floor);
        let across = floored.across_variance.sqrt();
        let (half_length, along, log_peak) = match latent {
            Latent::Normal => (0.0, floored.along_variance.sqrt(), floored.log_density(floored.mean)),
            // Density across, times that of one place in a metre of wall.
            Latent::Uniform => {
                ((3.0 * cluster.along_variance).sqrt(), config.end_sigma, -(std::f64::consts::TAU.sqrt() * across).ln())
            }
        };
        let offset = |axis: Vector2<f64>, sigma: f64| {
            let scaled = axis / (std::f64::consts::SQRT_2 * sigma);
            [scaled.x as f32, scaled.y as f32, -scaled.dot(&mean) as f32]
        };
        Self {
            along: offset(cluster.direction, along),
            half_length: (half_length / (std::f64::consts::SQRT_2 * along)) as f32,
            across: offset(cluster.normal(), across),
            log_peak: log_peak as f32,
        }
    }

    /// The same cluster, its standard deviation across at least this \[m\].
    pub fn thickened(self, capture_sigma: f32) -> Self {
        let [x, y, _] = self.across;
        let thinner = (1.0 / (SQRT_2 * capture_sigma * (x * x + y * y).sqrt())).min(1.0);
        Self { across: self.across.map(|number| number * thinner), log_peak: self.log_peak + ln(thinner), ..self }
    }

    /// ln p at a point.
    pub fn log_density(&self, x: f32, y: f32) -> f32 {
        let [along, across] = [self.along, self.across].map(|[a, b, c]| a * x + b * y + c);
        let beyond = (along.abs() - self.half_length).max(0.0);
        self.log_peak - beyond * beyond - across * across
    }
}
