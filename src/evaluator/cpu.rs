//! The evaluator on the CPU.

use super::layout::{ClusterParams, LikelihoodConfig, LocalPose, TILE, Tile};
use crate::geometry::Pose;
use crate::ppca::Cluster;
use nalgebra::{Matrix3, Point2, Vector3};

/// The clusters of one map near the robot, ready to be looked through.
#[derive(Clone, Debug)]
pub struct LocalMap {
    origin: Point2<f64>,
    clusters: Vec<ClusterParams>,
    /// Centre and half size of each cluster's support box.
    boxes: Vec<[f32; 4]>,
    log_outlier: f32,
}

/// Sums of one look at a scan from a pose.
#[derive(Clone, Copy, Debug, Default)]
pub struct Evaluation {
    /// Σ max ln p over the points (eq. 18); the outlier density where no cluster is likelier.
    pub log_likelihood: f32,
    /// Its gradient by (forward, sideways, heading) of the robot.
    pub gradient: [f32; 3],
    /// Its negative Hessian, in the Gauss-Newton approximation: xx, xy, xh, yy, yh, hh.
    pub information: [f32; 6],
}

impl Evaluation {
    /// The information as a matrix.
    pub fn information_matrix(&self) -> Matrix3<f64> {
        let [xx, xy, xh, yy, yh, hh] = self.information.map(f64::from);
        Matrix3::new(xx, xy, xh, xy, yy, yh, xh, yh, hh)
    }

    /// The gradient as a vector.
    pub fn gradient_vector(&self) -> Vector3<f64> {
        Vector3::from(self.gradient.map(f64::from))
    }
}

impl LocalMap {
    /// A map of these clusters of the world, in a frame near the robot.
    pub fn new<'a>(
        clusters: impl IntoIterator<Item = &'a Cluster>,
        robot: Pose,
        likelihood: &LikelihoodConfig,
    ) -> Self {
        let origin = Point2::new(robot.x.round(), robot.y.round());
        let log_outlier = likelihood.log_outlier();
        let clusters: Vec<_> = clusters.into_iter().map(|c| ClusterParams::new(c, origin, likelihood)).collect();
        let boxes = clusters
            .iter()
            .map(|cluster| {
                let [width, height] = cluster.support(log_outlier);
                [cluster.mean[0], cluster.mean[1], width, height]
            })
            .collect();
        Self { origin, clusters, boxes, log_outlier }
    }

    /// Σ max ln p over all points (eq. 18).
    pub fn log_likelihood(&self, world_from_robot: Pose, tiles: &[Tile]) -> f64 {
        let mut sum = 0.0;
        self.look(world_from_robot, tiles, |tile, best, _, _, _| {
            sum += best.iter().take(tile.count as usize).sum::<f32>();
        });
        f64::from(sum)
    }

    /// The same with its gradient and Gauss-Newton Hessian.
    pub fn linearise(&self, world_from_robot: Pose, tiles: &[Tile]) -> Evaluation {
        let mut out = Evaluation::default();
        let (sin, cos) = (world_from_robot.heading as f32).sin_cos();
        self.look(world_from_robot, tiles, |tile, best, index, x, y| {
            for lane in 0..tile.count as usize {
                out.log_likelihood += best[lane];
                if index[lane] == u32::MAX {
                    continue;
                }
                let cluster = &self.clusters[index[lane] as usize];
                let (dx, dy) = (x[lane] - cluster.mean[0], y[lane] - cluster.mean[1]);
                let [ux, uy] = cluster.direction;
                let (along, across) = (ux * dx + uy * dy, ux * dy - uy * dx);
                // The cluster's axes in the robot's frame, and the lever of a turn.
                let (ax, ay) = (cos * ux + sin * uy, cos * uy - sin * ux);
                let (px, py) = (tile.x[lane], tile.y[lane]);
                out.add(across * cluster.across_scale, cluster.across_scale, [-ay, ax, ax * px + ay * py]);
                // The end of a segment is where it was last seen, so it must not pull; a normal latent has no end.
                if cluster.half_length == 0.0 {
                    out.add(along * cluster.along_scale, cluster.along_scale, [ax, ay, ay * px - ax * py]);
                }
            }
        });
        out
    }

    /// For each point its most likely cluster, by the order in which the clusters were given; `None` for an outlier.
    pub fn explain(&self, world_from_robot: Pose, tiles: &[Tile]) -> Vec<Option<usize>> {
        let mut out = Vec::with_capacity(tiles.len() * TILE);
        self.look(world_from_robot, tiles, |tile, _, index, _, _| {
            out.extend(index.iter().take(tile.count as usize).map(|&i| (i != u32::MAX).then_some(i as usize)));
        });
        out
    }

    /// For each tile: the highest ln p of each point, the cluster that gives it (`u32::MAX`: none, it is an outlier),
    /// and the points in the map's frame.
    fn look(
        &self,
        world_from_robot: Pose,
        tiles: &[Tile],
        mut each: impl FnMut(&Tile, &[f32; TILE], &[u32; TILE], &[f32; TILE], &[f32; TILE]),
    ) {
        let pose = LocalPose::new(world_from_robot, self.origin);
        let (sin, cos) = pose.heading.sin_cos();
        for tile in tiles {
            let [cx, cy] = tile.centre;
            let (centre_x, centre_y) = (pose.x + cos * cx - sin * cy, pose.y + sin * cx + cos * cy);
            let x: [f32; TILE] = std::array::from_fn(|lane| pose.x + cos * tile.x[lane] - sin * tile.y[lane]);
            let y: [f32; TILE] = std::array::from_fn(|lane| pose.y + sin * tile.x[lane] + cos * tile.y[lane]);
            let mut best = [self.log_outlier; TILE];
            let mut index = [u32::MAX; TILE];
            for (number, (bounds, cluster)) in self.boxes.iter().zip(&self.clusters).enumerate() {
                let near = (centre_x - bounds[0]).abs() <= bounds[2] + tile.radius
                    && (centre_y - bounds[1]).abs() <= bounds[3] + tile.radius;
                if !near {
                    continue;
                }
                let [ux, uy] = cluster.direction;
                for lane in 0..TILE {
                    let (dx, dy) = (x[lane] - cluster.mean[0], y[lane] - cluster.mean[1]);
                    let (along, across) = (ux * dx + uy * dy, ux * dy - uy * dx);
                    let beyond = (along.abs() - cluster.half_length).max(0.0) * cluster.along_scale;
                    let across = across * cluster.across_scale;
                    let log_density = cluster.log_peak - 0.5 * (beyond * beyond + across * across);
                    let better = log_density > best[lane];
                    best[lane] = if better { log_density } else { best[lane] };
                    index[lane] = if better { number as u32 } else { index[lane] };
                }
            }
            each(tile, &best, &index, &x, &y);
        }
    }
}

impl Evaluation {
    /// Adds a residual r with dr/d(pose) = scale · jacobian to the least-squares sums.
    fn add(&mut self, residual: f32, scale: f32, jacobian: [f32; 3]) {
        let [x, y, h] = jacobian.map(|j| j * scale);
        self.gradient[0] -= residual * x;
        self.gradient[1] -= residual * y;
        self.gradient[2] -= residual * h;
        for (sum, product) in self.information.iter_mut().zip([x * x, x * y, x * h, y * y, y * h, h * h]) {
            *sum += product;
        }
    }
}
