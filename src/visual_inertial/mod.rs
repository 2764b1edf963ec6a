//! The way of a body that carries a camera and an inertial sensor: the geometric and the inertial term of semantic SLAM
//! (eq. 8 and 9; S. Bowman et al., "Probabilistic Data Association for Semantic SLAM", ICRA 2017).
//!
//! The state at each keyframe is pose, velocity and bias. The likeliest states are found in a factor graph, second by
//! second: new keyframes start where the inertial readings lead, and each solve moves all of them. The body has to
//! stand still at first: there the gyroscope's bias and the direction of gravity are read off.
//!
//! The world's origin is the body's position at the first keyframe; its z axis points up.

use crate::factor_graph::{GraphError, Solution, SolverConfig};
use crate::geometry::{Pose3, StampedPose3};
use crate::inertial::{ImuBias, Preintegration};
use keyframes::Keyframes;
use nalgebra::Vector3;

mod keyframes;
mod recording;
mod rest;

pub use recording::{Camera, Feature, FeatureFrame, Recording};
pub use rest::Rest;

/// From one keyframe to the next, at least \[s\]: most features stay in view for several of them.
const KEYFRAME_SECONDS: f64 = 0.25;
/// The graph is solved when so much time has been added \[s\]: for so long, inertial readings alone lead a few centimetres
/// astray.
const SOLVE_SECONDS: f64 = 1.0;

/// Why there is no estimate.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum VisualInertialError {
    /// There is no phase of rest at the start.
    #[error(
        "the body moves from the start: it has to stand still for a second after the first inertial reading, to tell the \
         gyroscope's bias and the direction of gravity"
    )]
    NoRest,
    /// Pictures without inertial readings between them.
    #[error("there is no inertial reading from {from} s to {to} s")]
    Gap {
        /// From here \[s\].
        from: f64,
        /// To here \[s\].
        to: f64,
    },
    /// There is nothing to estimate.
    #[error("less than two pictures come after the first inertial reading")]
    Empty,
    /// The graph has no solution.
    #[error(transparent)]
    Graph(#[from] GraphError),
}

/// The body at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Seconds.
    pub stamp: f64,
    /// `world_from_body`.
    pub pose: Pose3,
    /// In the world's frame \[m/s\].
    pub velocity: Vector3<f64>,
    /// Bias of the inertial sensor.
    pub bias: ImuBias,
}

/// The likeliest way.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// At each keyframe.
    pub states: Vec<State>,
    /// How the last search ended.
    pub solution: Solution,
}

impl Estimate {
    /// `world_from_body` at each of these moments \[s\], by the inertial readings since the keyframe before it; those before
    /// the first keyframe are left out.
    pub fn trajectory(&self, recording: &Recording, stamps: impl IntoIterator<Item = f64>) -> Vec<StampedPose3> {
        let pose_at = |stamp: f64| {
            let before = self.states.partition_point(|state| state.stamp <= stamp).checked_sub(1)?;
            let state = self.states.get(before)?;
            let Recording { imu, imu_noise, .. } = recording;
            let motion = Preintegration::between(imu, state.stamp, stamp, state.bias, imu_noise);
            let pose = motion.map_or(state.pose, |motion| motion.predict(state.pose, state.velocity).0);
            Some(StampedPose3 { stamp, pose })
        };
        stamps.into_iter().filter_map(pose_at).collect()
    }
}

/// Estimates the way.
///
/// # Errors
/// The body does not rest at first, inertial readings are missing, or the graph has no solution.
pub fn estimate(recording: &Recording) -> Result<Estimate, VisualInertialError> {
    let rest = Rest::at_start(&recording.imu).ok_or(VisualInertialError::NoRest)?;
    let mut keyframes = Keyframes::new(recording, &rest);
    let (mut next, mut solve_from) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
    for frame in recording.frames.iter().filter(|frame| frame.stamp >= rest.start) {
        if frame.stamp < next {
            continue;
        }
        next = frame.stamp + KEYFRAME_SECONDS;
        keyframes.add(frame)?;
        if frame.stamp >= solve_from {
            // More keyframes move the states again: to a millimetre is enough.
            keyframes.solve(SolverConfig { iterations: 10, relative_tolerance: 1e-4, absolute_tolerance: 1e-2 })?;
            solve_from = frame.stamp + SOLVE_SECONDS;
        }
    }
    let solution = keyframes.solve(SolverConfig::default())?;
    match keyframes.into_states() {
        states if states.len() < 2 => Err(VisualInertialError::Empty),
        states => Ok(Estimate { states, solution }),
    }
}
