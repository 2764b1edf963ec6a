//! The hypotheses and sweeps that led to a map.

use super::estimate::{Estimate, Landmark};
use super::world::{Plane, World};
use crate::report::Bits;

/// A hypothesis of the forward pass at a keyframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate<W: World = Plane> {
    /// `world_from_robot`.
    pub pose: W::Pose,
    /// ln p(all detections up to then), under its assignments.
    pub log_likelihood: f64,
}

/// The result of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep<W: World = Plane> {
    /// The objective \[nats\].
    pub objective: f64,
    /// `world_from_robot` of each keyframe.
    pub poses: Vec<W::Pose>,
    /// The map, without covariances.
    pub landmarks: Vec<Landmark<W>>,
}

impl<W: World> Sweep<W> {
    pub(super) fn new(estimate: &Estimate<W>, objective: f64) -> Self {
        Self { objective, poses: estimate.poses.clone(), landmarks: estimate.landmarks.clone() }
    }
}

/// How a map came about: the forward pass, then the sweeps.
#[derive(Clone, Debug, PartialEq)]
pub struct History<W: World = Plane> {
    /// Of each keyframe the hypotheses that the pass kept, the likeliest first; none where the associations were known.
    pub candidates: Vec<Vec<Candidate<W>>>,
    /// After each sweep over all keyframes; the last is the result, after merging. Online the result alone.
    pub sweeps: Vec<Sweep<W>>,
}

impl<W: World> Default for History<W> {
    fn default() -> Self {
        Self { candidates: Vec::new(), sweeps: Vec::new() }
    }
}

impl<W: World> History<W> {
    /// A number for each keyframe of the forward pass and each sweep, which changes with any bit of it.
    pub fn checksums(&self) -> Vec<u32> {
        let of_keyframe = |candidates: &Vec<Candidate<W>>| {
            let mut bits = Bits::default();
            for Candidate { pose, log_likelihood } in candidates {
                bits.add(W::coordinates(*pose));
                bits.add([*log_likelihood]);
            }
            bits.finish()
        };
        let of_sweep = |Sweep { objective, poses, landmarks }: &Sweep<W>| {
            let mut bits = Bits::default();
            bits.add([*objective]);
            poses.iter().for_each(|pose| bits.add(W::coordinates(*pose)));
            landmarks.iter().for_each(|landmark| landmark.add_to(&mut bits));
            bits.finish()
        };
        self.candidates.iter().map(of_keyframe).chain(self.sweeps.iter().map(of_sweep)).collect()
    }
}
