//! The result of mapping a recording.

use super::estimate::Landmark;
use super::history::History;
use super::verdict::Verdict;
use super::world::{Plane, Space, Square, World};
use crate::detections::Sensors3;
use crate::geometry::{Pose3, StampedPose, StampedPose3};
use crate::report::Bits;
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

/// A weight of the E step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weight {
    /// Number of the frame in the recording.
    pub frame: usize,
    /// Number of the detection in the frame.
    pub detection: usize,
    /// Number of the landmark in the map.
    pub landmark: usize,
    /// Probability that the one shows the other.
    pub weight: f64,
}

/// One of the runs that the objective chose from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunScore {
    /// Density of new landmarks \[1/(m rad)\].
    pub new_density: f64,
    /// The objective \[nats\].
    pub objective: f64,
    /// Number of landmarks.
    pub landmarks: usize,
}

/// The estimate at a keyframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mapped<W: World = Plane> {
    /// Seconds.
    pub stamp: f64,
    /// `world_from_robot`.
    pub pose: W::Pose,
    /// Covariance of the pose in its own frame, by translation \[m\] and rotation \[rad\]; as seen from the first pose.
    pub covariance: W::PoseCovariance,
    /// Number of the frame in the recording; none where nothing was seen.
    pub frame: Option<usize>,
}

/// A recording, mapped.
#[derive(Clone, Debug)]
pub struct SemanticMap<W: World = Plane> {
    /// The moments whose pose was estimated.
    pub keyframes: Vec<Mapped<W>>,
    /// The map.
    pub landmarks: Vec<Landmark<W>>,
    /// Weights of at least 0.02, frame by frame.
    pub weights: Vec<Weight>,
    /// Of the odometry: in the plane forward scale, turn scale and curvature \[rad/m\], in space scale and turn scale.
    pub calibration: W::Calibration,
    /// How often a landmark in view is detected.
    pub detection_probability: f64,
    /// The objective \[nats\].
    pub objective: f64,
    /// All runs, in the order of [`NEW_DENSITIES`](super::NEW_DENSITIES); empty if the associations were known.
    pub runs: Vec<RunScore>,
    /// Frame and number of each detection that was left out because its object moves.
    pub moving: Vec<(usize, usize)>,
    /// Number of detections that were used.
    pub detections: usize,
    /// Whether the map is consistent with the data.
    pub verdict: Verdict,
    /// How the run came about that the objective chose.
    pub history: History<W>,
}

impl SemanticMap {
    /// The path.
    pub fn trajectory(&self) -> Vec<StampedPose> {
        self.keyframes.iter().map(|&Mapped { stamp, pose, .. }| StampedPose { stamp, pose }).collect()
    }
}

impl SemanticMap<Space> {
    /// The path.
    pub fn trajectory3(&self) -> Vec<StampedPose3> {
        self.keyframes.iter().map(|&Mapped { stamp, pose, .. }| StampedPose3 { stamp, pose }).collect()
    }

    /// The map, turned so that its z axis points up and x and y show it from above.
    pub fn upright(&self, sensors: &Sensors3) -> Self {
        let turn = self.above_from_world(sensors);
        let turned = Pose3::new(Point3::origin(), turn);
        let matrix = turn.to_rotation_matrix().into_inner();
        let mut map = self.clone();
        map.keyframes.iter_mut().for_each(|keyframe| keyframe.pose = turned * keyframe.pose);
        map.history.candidates.iter_mut().flatten().for_each(|candidate| candidate.pose = turned * candidate.pose);
        let sweeps = &mut map.history.sweeps;
        sweeps.iter_mut().flat_map(|sweep| &mut sweep.poses).for_each(|pose| *pose = turned * *pose);
        for landmark in sweeps.iter_mut().flat_map(|sweep| &mut sweep.landmarks).chain(&mut map.landmarks) {
            landmark.position = turn * landmark.position;
            landmark.covariance = matrix * landmark.covariance * matrix.transpose();
        }
        map
    }

    /// Up is where path and landmarks extend least, on the side to which the upper edge of pictures points, or against the view of
    /// a camera that sees the floor.
    fn above_from_world(&self, sensors: &Sensors3) -> UnitQuaternion<f64> {
        let path = self.keyframes.iter().map(|keyframe| keyframe.pose.position);
        let points: Vec<Point3<f64>> = path.chain(self.landmarks.iter().map(|landmark| landmark.position)).collect();
        let mean = points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / points.len().max(1) as f64;
        let square = |point: &Point3<f64>| (point.coords - mean) * (point.coords - mean).transpose();
        let spread = points.iter().map(square).sum::<Matrix3<f64>>().symmetric_eigen();
        let up = spread.eigenvectors.column(spread.eigenvalues.imin()).into_owned();
        let above = sensors.robot_from_camera.rotation * Vector3::new(0.0, -1.0, -1.0);
        let seen = self.keyframes.iter().map(|keyframe| keyframe.pose.rotation * above).sum::<Vector3<f64>>();
        let up = if up.dot(&seen) < 0.0 { -up } else { up };
        let along = if up.x.abs() < 0.9 { Vector3::x() } else { Vector3::z() };
        let x = (along - up * up.dot(&along)).normalize();
        let world_from_above = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, up.cross(&x), up]));
        UnitQuaternion::from_rotation_matrix(&world_from_above).inverse()
    }
}

impl<W: World> SemanticMap<W> {
    /// A number that changes with any bit of path, landmarks, weights, calibration or objective.
    pub fn checksum(&self) -> u32 {
        let mut bits = Bits::default();
        for keyframe in &self.keyframes {
            bits.add(W::coordinates(keyframe.pose));
            bits.add([keyframe.stamp]);
            bits.add(keyframe.covariance.entries().iter().copied());
        }
        for landmark in &self.landmarks {
            landmark.add_to(&mut bits);
        }
        for Weight { frame, detection, landmark, weight } in &self.weights {
            bits.add([*frame as f64, *detection as f64, *landmark as f64, *weight]);
        }
        bits.add(self.calibration.as_ref().iter().copied());
        bits.add([self.detection_probability, self.objective]);
        bits.finish()
    }
}
