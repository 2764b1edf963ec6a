//! Association: the log-likelihood of a frame's detections from every pose, in the landmarks of its map, over all one-to-one
//! assignments; twin of `shaders/associate.wgsl`.
//!
//! Relative to all detections showing nothing of the map, F_j(s) is the log of the sum over the assignments of the first
//! j landmarks that use exactly the detections s:
//!
//! F_0(∅) = 0, F_{j+1}(s) = ln (exp F_j(s) + Σ_{k ∈ s} L_kj / u_k exp F_j(s \ k)), and
//! ln p(S) = Σ_k ln u_k + Σ_j ln (1 - P_D) + ln Σ_s exp F_M(s),
//!
//! the second sum over the landmarks in view. `association` does the same in f64, and gives the weights too.

use crate::evaluator::pose::LocalPose;
use crate::evaluator::sighting::{Horizon, LandmarkRow, MOST_SEEN, Seen};
use crate::math::{exp, ln, sin_cos};

/// ln of what cannot be.
const NEVER: f32 = -1e30;
/// A pair that is less likely than none by this \[nats\] changes no sum in f32.
const LEAST_PAIR: f32 = -17.0;
const LN_TAU: f32 = 1.837_877_1;

/// ln p(S) of a frame from one pose.
pub(super) fn associate(seen: &[Seen], horizon: &Horizon, landmarks: &[LandmarkRow], pose: LocalPose) -> f32 {
    let turn = sin_cos(pose.heading);
    let mut sums = [NEVER; 1 << MOST_SEEN];
    sums[0] = 0.0;
    let mut constant: f32 = seen.iter().map(|seen| seen.log_null).sum();
    for landmark in landmarks {
        let missed = if is_in_view(horizon, landmark, pose, turn) { landmark.log_missed } else { 0.0 };
        constant += missed;
        let mut pairs = [NEVER; MOST_SEEN];
        for (detection, (seen, pair)) in seen.iter().zip(&mut pairs).enumerate() {
            *pair = log_density(seen, landmark, pose, turn) + landmark.log_label[detection] + landmark.log_detected
                - missed
                - seen.log_null;
        }
        if pairs.iter().any(|&pair| pair > LEAST_PAIR) {
            let before = sums;
            for (set, sum) in sums.iter_mut().enumerate().take(1 << seen.len()) {
                *sum = grown(&before, &pairs, set);
            }
        }
    }
    constant + log_sum(&sums[..1 << seen.len()])
}

/// F_{j+1} of a set.
fn grown(before: &[f32], pairs: &[f32; MOST_SEEN], set: usize) -> f32 {
    let terms = || {
        let possible = pairs.iter().enumerate().filter(|&(k, &pair)| set >> k & 1 == 1 && pair > LEAST_PAIR);
        possible.map(|(k, pair)| before[set & !(1 << k)] + pair)
    };
    let largest = terms().fold(before[set], f32::max);
    let sum = terms().fold(exp(before[set] - largest), |sum, term| sum + exp(term - largest));
    largest + ln(sum)
}

fn log_sum(logs: &[f32]) -> f32 {
    let largest = logs.iter().copied().fold(NEVER, f32::max);
    largest + ln(logs.iter().map(|log| exp(log - largest)).sum())
}

/// ln N(z_k; l_j, R_k + Σ_j), in the evaluator's frame.
fn log_density(seen: &Seen, landmark: &LandmarkRow, pose: LocalPose, (sin, cos): (f32, f32)) -> f32 {
    let dx = pose.x + cos * seen.x - sin * seen.y - landmark.x;
    let dy = pose.y + sin * seen.x + cos * seen.y - landmark.y;
    let both = 2.0 * sin * cos * seen.xy;
    let xx = cos * cos * seen.xx - both + sin * sin * seen.yy + landmark.xx;
    let yy = sin * sin * seen.xx + both + cos * cos * seen.yy + landmark.yy;
    let xy = sin * cos * (seen.xx - seen.yy) + (cos * cos - sin * sin) * seen.xy + landmark.xy;
    let determinant = xx * yy - xy * xy;
    let square = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / determinant;
    -0.5 * (square + ln(determinant)) - LN_TAU
}

fn is_in_view(horizon: &Horizon, landmark: &LandmarkRow, pose: LocalPose, (sin, cos): (f32, f32)) -> bool {
    let (dx, dy) = (landmark.x - pose.x, landmark.y - pose.y);
    horizon.holds(cos * dx + sin * dy, cos * dy - sin * dx)
}
