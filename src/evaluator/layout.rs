//! Plain data of the evaluator, in f32 and in a frame near the robot.

use crate::geometry::Pose;
use crate::math::{ln, sin_cos};
use crate::ppca::Cluster;
use bytemuck::{Pod, Zeroable};
use nalgebra::{Point2, Vector2};
use serde::{Deserialize, Serialize};
use std::f32::consts::SQRT_2;

/// How likely a measurement is, given a map (eq. 18).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LikelihoodConfig {
    /// The distribution of the latent number ζ.
    pub latent: Latent,
    /// No standard deviation of a cluster is taken to be smaller \[m\]: what the map and the laser get wrong together.
    pub sigma_floor: f64,
    /// No standard deviation across a wall is taken to be smaller in the first steps of a climb \[m\]: how far off a
    /// wall is still found.
    pub capture_sigma: f64,
    /// Uniform latent: standard deviation of the fall-off beyond a segment's ends \[m\]. Walls go on where they have
    /// not been seen, so an end says little.
    pub end_sigma: f64,
    /// Density \[1/m²\] of a point that no cluster explains; no point is less likely than this.
    pub outlier_density: f64,
    /// Log-likelihoods are multiplied by this: neighbouring beams do not err independently. 1 in the paper.
    pub temper: f64,
    /// At most this many points of a scan are used, evenly spread over its beams.
    pub max_points: usize,
}

/// Distribution of the latent number ζ along a cluster (eq. 7).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Latent {
    /// The paper's N(0, 1). Density is that of eq. 9.
    Normal,
    /// Uniform over the segment of the same variance, each metre of wall as likely as any other: a wall seen in part
    /// does not pull the robot towards its middle, and a map in fewer, longer clusters is no less likely.
    Uniform,
}

impl Default for LikelihoodConfig {
    fn default() -> Self {
        Self {
            latent: Latent::Uniform,
            sigma_floor: 0.03,
            capture_sigma: 0.15,
            end_sigma: 0.1,
            outlier_density: 0.01,
            temper: 0.025,
            max_points: 180,
        }
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
    pub fn new(cluster: &Cluster, origin: Point2<f64>, config: &LikelihoodConfig) -> Self {
        let mean = cluster.mean - origin;
        let floored = cluster.with_variance_floor(config.sigma_floor * config.sigma_floor);
        let across = floored.across_variance.sqrt();
        let (half_length, along, log_peak) = match config.latent {
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

/// A pose in the evaluator's frame: that of the world, moved to an origin near the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LocalPose {
    /// Metres.
    pub x: f32,
    /// Metres.
    pub y: f32,
    /// Radians.
    pub heading: f32,
}

impl LocalPose {
    /// Into the evaluator's frame.
    pub fn new(world_from_robot: Pose, origin: Point2<f64>) -> Self {
        Self {
            x: (world_from_robot.x - origin.x) as f32,
            y: (world_from_robot.y - origin.y) as f32,
            heading: world_from_robot.heading as f32,
        }
    }

    /// Back into the world.
    pub fn in_world(self, origin: Point2<f64>) -> Pose {
        Pose::new(f64::from(self.x) + origin.x, f64::from(self.y) + origin.y, f64::from(self.heading))
    }

    /// The pose after a motion (forward, sideways, turn) of the robot. The heading is not wrapped.
    pub fn moved(self, motion: [f32; 3]) -> Self {
        let (sin, cos) = sin_cos(self.heading);
        let [forward, sideways, turn] = motion;
        Self {
            x: self.x + cos * forward - sin * sideways,
            y: self.y + sin * forward + cos * sideways,
            heading: self.heading + turn,
        }
    }
}

/// Points a tile: what one look for candidate clusters serves.
pub const TILE: usize = 16;

/// Consecutive points of a scan, with the circle around them.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Tile {
    /// Points in the robot's frame \[m\]; the last tile repeats its last point.
    pub x: [f32; TILE],
    /// As `x`.
    pub y: [f32; TILE],
    /// Centre of a circle around them \[m\].
    pub centre: [f32; 2],
    /// Its radius \[m\].
    pub radius: f32,
    /// How many of them count.
    pub count: u32,
}

impl Tile {
    /// The points that count, in the robot's frame \[m\].
    pub fn points(&self) -> impl Iterator<Item = Point2<f64>> + '_ {
        let point = |(&x, &y): (&f32, &f32)| Point2::new(f64::from(x), f64::from(y));
        self.x.iter().zip(&self.y).take(self.count as usize).map(point)
    }

    /// No point of it is further from the robot \[m\].
    pub fn reach(&self) -> f32 {
        self.centre[0].hypot(self.centre[1]) + self.radius
    }
}

/// No point is further from the robot \[m\].
pub fn reach(tiles: &[Tile]) -> f32 {
    tiles.iter().map(Tile::reach).fold(0.0, f32::max)
}

/// Every so-manieth point, so that there are at most `max_points`, in tiles.
pub fn tiles(points: &[Point2<f64>], max_points: usize) -> Vec<Tile> {
    let stride = points.len().div_ceil(max_points.max(1)).max(1);
    let used: Vec<Point2<f64>> = points.iter().copied().step_by(stride).collect();
    used.chunks(TILE)
        .map(|chunk| {
            let last = chunk[chunk.len() - 1];
            let at = |lane: usize| chunk.get(lane).copied().unwrap_or(last);
            let low = chunk.iter().fold(last.coords, |low, p| low.inf(&p.coords));
            let high = chunk.iter().fold(last.coords, |high, p| high.sup(&p.coords));
            let centre: Vector2<f64> = 0.5 * (low + high);
            let radius = chunk.iter().map(|p| (p.coords - centre).norm()).fold(0.0, f64::max);
            Tile {
                x: std::array::from_fn(|lane| at(lane).x as f32),
                y: std::array::from_fn(|lane| at(lane).y as f32),
                centre: [centre.x as f32, centre.y as f32],
                // Room for the rounding to f32.
                radius: (radius * (1.0 + 1e-6) + 1e-4) as f32,
                count: chunk.len() as u32,
            }
        })
        .collect()
}
