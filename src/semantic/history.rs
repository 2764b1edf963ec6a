//! The hypotheses and sweeps that led to a map.

use super::estimate::{Estimate, Landmark};
use crate::geometry::Pose;
use crate::report::Bits;

/// A hypothesis of the forward pass at a keyframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// `world_from_robot`.
    pub pose: Pose,
    /// ln p(all detections up to then), under its assignments.
    pub log_likelihood: f64,
}

/// The result of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// The objective \[nats\].
    pub objective: f64,
    /// `world_from_robot` of each keyframe.
    pub poses: Vec<Pose>,
    /// The map, without covariances.
    pub landmarks: Vec<Landmark>,
}

impl Sweep {
    pub(super) fn new(estimate: &Estimate, objective: f64) -> Self {
        Self { objective, poses: estimate.poses.clone(), landmarks: estimate.landmarks.clone() }
    }
}

/// The forward pass and the sweeps that led to a map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// For each keyframe the hypotheses that the pass kept, the most likely first; empty if the associations were known.
    pub candidates: Vec<Vec<Candidate>>,
    /// After each sweep over all keyframes; the last is the result, after merging. Online the result alone.
    pub sweeps: Vec<Sweep>,
}

impl History {
    /// A number for each keyframe of the forward pass and each sweep, which changes with any bit of it.
    pub fn checksums(&self) -> Vec<u32> {
        let of_keyframe = |candidates: &Vec<Candidate>| {
            let mut bits = Bits::default();
            for Candidate { pose, log_likelihood } in candidates {
                bits.pose(*pose);
                bits.add([*log_likelihood]);
            }
            bits.finish()
        };
        let of_sweep = |Sweep { objective, poses, landmarks }: &Sweep| {
            let mut bits = Bits::default();
            bits.add([*objective]);
            poses.iter().for_each(|pose| bits.pose(*pose));
            landmarks.iter().for_each(|landmark| landmark.add_to(&mut bits));
            bits.finish()
        };
        self.candidates.iter().map(of_keyframe).chain(self.sweeps.iter().map(of_sweep)).collect()
    }
}
