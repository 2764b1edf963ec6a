//! The relations metric of Kuemmerle et al., "On measuring the accuracy of SLAM algorithms", Autonomous Robots 27, 2009.
//!
//! A relation is the true motion δ* between two stamps; the trajectory's motion between them is δ = x₁⁻¹ x₂, and the
//! error is δ*⁻¹ δ (eq. 7 there, with the distance of the positions and the absolute angle as the two measures). Only
//! motions count, so that the trajectory may start anywhere and needs no alignment.

use super::{PoseErrors, PoseLookup};
use crate::geometry::{Pose, StampedPose};
use crate::io::relations::Relation;

/// Relations of stamps farther apart than this, in seconds, close a loop; the others are local.
pub const LOOP_SECONDS: f64 = 10.0;

/// Errors of the motions between pairs of stamps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelationErrors {
    /// Relations that were asked for.
    pub relations: usize,
    /// Relations left out, because the trajectory has no pose at one of their stamps.
    pub unmatched: usize,
    /// Of all relations that were matched; `None` where there are none, here and below.
    pub all: Option<PoseErrors>,
    /// Of those whose stamps are at most [`LOOP_SECONDS`] apart.
    pub local: Option<PoseErrors>,
    /// Of those whose stamps are farther apart.
    pub loop_closing: Option<PoseErrors>,
}

/// Compares the motions of a trajectory (`world_from_robot`, any world) with the true ones.
pub fn relation_errors(relations: &[Relation], trajectory: &[StampedPose]) -> RelationErrors {
    let poses = PoseLookup::new(trajectory);
    let (mut all, mut local, mut loop_closing) = (Vec::new(), Vec::new(), Vec::new());
    for relation in relations {
        let Some(error) = relation_error(relation, &poses) else { continue };
        let apart = (relation.second_stamp - relation.first_stamp).abs();
        all.push(error);
        if apart > LOOP_SECONDS { loop_closing.push(error) } else { local.push(error) }
    }
    RelationErrors {
        relations: relations.len(),
        unmatched: relations.len() - all.len(),
        all: PoseErrors::of(&all),
        local: PoseErrors::of(&local),
        loop_closing: PoseErrors::of(&loop_closing),
    }
}

/// δ*⁻¹ δ, or `None` where the trajectory has no pose at one of the stamps.
fn relation_error(relation: &Relation, poses: &PoseLookup) -> Option<Pose> {
    let world_from_first = poses.at(relation.first_stamp)?;
    let world_from_second = poses.at(relation.second_stamp)?;
    Some(world_from_second.seen_from(world_from_first).seen_from(relation.first_from_second))
}
