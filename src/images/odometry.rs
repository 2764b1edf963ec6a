//! Visual odometry: the way of a camera by its tracks alone, up to its scale.
//!
//! The geometric term of semantic SLAM (eq. 8) by itself. Each keyframe starts where the motion between the last two
//! pictures leads, and is then moved, with those before it, to where the tracks agree best. What one camera sees does
//! not tell how long the way is: the first step has length 1.

use super::tracks::{Keyframe, SIGMA};
use crate::factor_graph::{
    Factor as _, Graph, GraphError, Noise, Prior, Solution, Solver, SolverConfig, Track, Values, VariableId,
};
use crate::geometry::{Pinhole, Pose3, StampedPose3};
use nalgebra::{DMatrix, Point2, Point3};
use std::collections::BTreeMap;

/// So many keyframes are moved when one more comes: few tracks are longer.
const WINDOW: usize = 8;
/// Of what is held fast \[steps, rad\].
const FAST: f64 = 1e-5;
/// Of what is free \[steps, rad\].
const FREE: f64 = 10.0;
/// Of Cauchy's loss, in standard deviations: where all features are right, it has 95 % of the efficiency of squares.
const LOSS_SCALE: f64 = 2.385;
/// Views from which a track counts: two more than its place needs.
const LEAST_VIEWS: usize = 3;

/// A view of a track.
#[derive(Clone, Copy, Debug)]
struct View {
    keyframe: usize,
    pixel: Point2<f64>,
    /// Standard deviation \[pixels\].
    sigma: f64,
}

/// All keyframes so far.
#[derive(Clone, Debug)]
pub struct VisualOdometry {
    camera: Pinhole,
    path: Vec<StampedPose3>,
    tracks: BTreeMap<u64, Vec<View>>,
}

impl VisualOdometry {
    /// Nothing seen yet.
    pub fn new(camera: Pinhole) -> Self {
        Self { camera, path: Vec::new(), tracks: BTreeMap::new() }
    }

    /// `world_from_camera` at all keyframes; the first is the origin.
    pub fn path(&self) -> &[StampedPose3] {
        &self.path
    }

    /// One keyframe more.
    ///
    /// # Errors
    /// The graph has no solution.
    pub fn add(&mut self, stamp: f64, keyframe: &Keyframe) -> Result<(), GraphError> {
        let pose = match self.path[..] {
            [] => Pose3::identity(),
            [.., last] => last.pose * self.motion(keyframe),
        };
        let number = self.path.len();
        for (feature, scale) in keyframe.features.iter().zip(&keyframe.scales) {
            let view = View { keyframe: number, pixel: feature.pixel, sigma: SIGMA * scale };
            self.tracks.entry(feature.track).or_default().push(view);
        }
        self.path.push(StampedPose3 { stamp, pose });
        if number > 1 {
            let config = SolverConfig { iterations: 10, relative_tolerance: 1e-3, absolute_tolerance: 1e-2 };
            self.solve(number.saturating_sub(WINDOW - 1), config)?;
        }
        Ok(())
    }

    /// Moves all keyframes to where the tracks agree best.
    ///
    /// # Errors
    /// The graph has no solution.
    pub fn finish(&mut self) -> Result<Solution, GraphError> {
        self.solve(0, SolverConfig { relative_tolerance: 1e-6, ..SolverConfig::default() })
    }

    /// The motion to the next keyframe: its direction and turn by the two pictures, or else as before, its length as before.
    fn motion(&self, keyframe: &Keyframe) -> Pose3 {
        let last = match self.path[..] {
            [.., before, last] => last.pose.seen_from(before.pose),
            _ => Pose3::new(Point3::new(0.0, 0.0, 1.0), Default::default()),
        };
        let length = last.position.coords.norm();
        let seen = keyframe.motion.as_ref().map(|motion| motion.first_from_second);
        seen.map_or(last, |seen| Pose3::new((length * seen.position.coords).into(), seen.rotation))
    }

    /// Moves the keyframes from `first` on; two of them are held fast, or, at the start, the length of the first step.
    fn solve(&mut self, first: usize, config: SolverConfig) -> Result<Solution, GraphError> {
        let (mut graph, mut values) = (Graph::new(), Values::new());
        let ids: Vec<VariableId> = self.path[first..].iter().map(|pose| values.add_pose3(pose.pose)).collect();
        let [one, two, ..] = ids[..] else { return Err(GraphError::Empty) };
        let (one_pose, two_pose) = (self.path[first].pose, self.path[first + 1].pose);
        graph.add(Prior::pose3(one, one_pose), Noise::sigmas(&[FAST; 6])?)?;
        if first == 0 {
            graph.add(Prior::pose3(two, two_pose), Noise::covariance(&along(one_pose, two_pose))?)?;
        } else {
            graph.add(Prior::pose3(two, two_pose), Noise::sigmas(&[FAST; 6])?)?;
        }
        for views in self.tracks.values() {
            let views = &views[views.partition_point(|view| view.keyframe < first)..];
            if views.len() < LEAST_VIEWS {
                continue;
            }
            let sigma = views.iter().map(|view| view.sigma).sum::<f64>() / views.len() as f64;
            let seen = views.iter().map(|view| (ids[view.keyframe - first], view.pixel));
            let track = Track::new(seen, self.camera, Pose3::identity()).with_loss(LOSS_SCALE * sigma);
            let sigmas = vec![sigma; track.dimension()];
            graph.add(track, Noise::sigmas(&sigmas)?)?;
        }
        let solution = Solver::new(config).solve(&graph, &mut values)?;
        for (pose, id) in self.path[first..].iter_mut().zip(ids) {
            pose.pose = values.pose3(id)?;
        }
        Ok(solution)
    }
}

/// Holds the distance of the second pose from the first, and nothing else.
fn along(one: Pose3, two: Pose3) -> DMatrix<f64> {
    let direction = two.rotation.inverse() * (two.position - one.position).normalize();
    let mut covariance = DMatrix::identity(6, 6) * (FREE * FREE);
    let held = direction * direction.transpose() * (FREE * FREE - FAST * FAST);
    let mut position = covariance.view_mut((0, 0), (3, 3));
    position -= held;
    covariance
}
