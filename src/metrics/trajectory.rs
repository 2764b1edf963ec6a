//! Errors of a trajectory against reference poses: ATE and RPE as Sturm et al. define them, "A benchmark for the
//! evaluation of RGB-D SLAM systems", IROS 2012, here in the plane.
//!
//! With reference poses Qᵢ and the trajectory's poses Pᵢ at their stamps (found by [`PoseLookup`]):
//! - Absolute trajectory error: |trans(Qᵢ) - S trans(Pᵢ)|, where the rigid motion S makes the sum of the squares least
//!   (Horn, Umeyama; rotation and translation, no scale).
//! - Relative pose error: Eᵢ = (Qᵢ⁻¹ Qⱼ)⁻¹ (Pᵢ⁻¹ Pⱼ), over every i and the j that lies nearest to a fixed time or a fixed
//!   length of path after it. Pairs that miss it by more than a quarter are left out (the last poses have none).
//!
//! Neither depends on the frame that the trajectory is in.

use super::{ErrorStats, PoseErrors, PoseLookup};
use crate::geometry::{Pose, StampedPose};
use nalgebra::{Point2, Vector2};

/// The time over which the relative pose error is taken, in seconds.
pub const RELATIVE_SECONDS: f64 = 1.0;
/// The length of path, along the reference, over which the relative pose error is taken, in metres.
pub const RELATIVE_METRES: f64 = 10.0;
/// By which part of itself a time or length may be missed: enough for poses half a second apart.
const RELATIVE_TOLERANCE: f64 = 0.25;

/// Errors against reference poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceErrors {
    /// Poses of the reference.
    pub reference_poses: usize,
    /// Poses of the reference left out, because the trajectory has none at their stamp (or their stamp comes again).
    pub unmatched: usize,
    /// The alignment S: takes the trajectory's world to that of the reference.
    pub reference_from_world: Pose,
    /// Absolute trajectory error, in metres; `None` where no pose was matched.
    pub absolute: Option<ErrorStats>,
    /// Relative pose error over [`RELATIVE_SECONDS`]; `None` where no two poses are that far apart.
    pub relative_in_time: Option<PoseErrors>,
    /// Relative pose error over [`RELATIVE_METRES`]; `None` where no two poses are that far apart.
    pub relative_in_path: Option<PoseErrors>,
}

/// Compares a trajectory (`world_from_robot`, any world) with reference poses (`reference_from_robot`) in log order.
pub fn reference_errors(reference: &[StampedPose], trajectory: &[StampedPose]) -> ReferenceErrors {
    let pairs = pair_up(reference, trajectory);
    let reference_from_world = align(&pairs);
    let distances: Vec<f64> = pairs
        .iter()
        .map(|pair| (reference_from_world * pair.found.position() - pair.reference.position()).norm())
        .collect();
    ReferenceErrors {
        reference_poses: reference.len(),
        unmatched: reference.len() - pairs.len(),
        reference_from_world,
        absolute: ErrorStats::of(&distances),
        relative_in_time: relative_errors(&pairs, |pair| pair.stamp, RELATIVE_SECONDS),
        relative_in_path: relative_errors(&pairs, |pair| pair.path, RELATIVE_METRES),
    }
}

/// A reference pose and the trajectory's pose at its stamp.
#[derive(Clone, Copy)]
struct Pair {
    stamp: f64,
    /// Length of the reference's path up to here \[m\].
    path: f64,
    reference: Pose,
    found: Pose,
}

/// In the order of the reference.
fn pair_up(reference: &[StampedPose], trajectory: &[StampedPose]) -> Vec<Pair> {
    let (trajectory, by_stamp) = (PoseLookup::new(trajectory), PoseLookup::new(reference));
    let mut pairs = Vec::new();
    let mut path = 0.0;
    let mut previous: Option<Pose> = None;
    for &StampedPose { stamp, pose } in reference {
        path += previous.map_or(0.0, |previous| (pose.position() - previous.position()).norm());
        previous = Some(pose);
        // Of poses with one stamp the lookup knows only the last: only that one has a counterpart.
        let is_last_of_its_stamp = by_stamp.at(stamp) == Some(pose);
        if let Some(found) = trajectory.at(stamp).filter(|_| is_last_of_its_stamp) {
            pairs.push(Pair { stamp, path, reference: pose, found });
        }
    }
    pairs
}

/// The rigid motion that takes the positions found closest to those of the reference, in least squares.
///
/// In the plane the best rotation is that of Σ rₖ fₖ* with centred positions r, f as complex numbers. Where all
/// positions of one side coincide it is undetermined and left at 0.
fn align(pairs: &[Pair]) -> Pose {
    if pairs.is_empty() {
        return Pose::IDENTITY;
    }
    let mean = |position: fn(&Pair) -> Point2<f64>| {
        pairs.iter().map(|pair| position(pair).coords).sum::<Vector2<f64>>() / pairs.len() as f64
    };
    let reference_mean = mean(|pair| pair.reference.position());
    let found_mean = mean(|pair| pair.found.position());
    let (mut along, mut across) = (0.0, 0.0);
    for pair in pairs {
        let r = pair.reference.position().coords - reference_mean;
        let f = pair.found.position().coords - found_mean;
        along += f.dot(&r);
        across += f.perp(&r);
    }
    let rotation = Pose::new(0.0, 0.0, across.atan2(along));
    let translation = reference_mean - rotation * found_mean;
    Pose::new(translation.x, translation.y, rotation.heading)
}

/// Relative pose errors over `step`, in the unit of `position` (stamp or path).
fn relative_errors(pairs: &[Pair], position: impl Fn(&Pair) -> f64, step: f64) -> Option<PoseErrors> {
    let mut pairs = pairs.to_vec();
    pairs.sort_by(|a, b| position(a).total_cmp(&position(b)));
    let mut errors = Vec::new();
    for (i, first) in pairs.iter().enumerate() {
        let (later, target) = (&pairs[i + 1..], position(first) + step);
        let miss = |pair: &Pair| (position(pair) - target).abs();
        let split = later.partition_point(|pair| position(pair) < target);
        let around = later.get(split.saturating_sub(1)..).unwrap_or_default().iter().take(2);
        let Some(second) = around.min_by(|a, b| miss(a).total_cmp(&miss(b))) else { continue };
        if miss(second) <= RELATIVE_TOLERANCE * step {
            let true_motion = second.reference.seen_from(first.reference);
            errors.push(second.found.seen_from(first.found).seen_from(true_motion));
        }
    }
    PoseErrors::of(&errors)
}
