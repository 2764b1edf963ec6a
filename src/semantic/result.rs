//! The result of mapping a recording.

use super::estimate::Landmark;
use super::history::History;
use super::verdict::Verdict;
use super::world::{Plane, Space, Square, World};
use crate::geometry::{StampedPose, StampedPose3};
use crate::report::Bits;

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
