//! Bins of poses: KLD sampling counts them, and clouds are their connected components.

use crate::evaluator::pose::LocalPose;
use std::f64::consts::{PI, TAU};

/// Size of a bin \[m, m, rad\].
pub(super) const BIN: [f64; 3] = [0.5, 0.5, PI / 18.0];

/// The bin of a pose.
pub(super) fn bin(pose: LocalPose) -> [i32; 3] {
    let at = [pose.x, pose.y, pose.heading].map(f64::from);
    std::array::from_fn(|axis| (at[axis] / BIN[axis]).floor() as i32)
}

/// A bin and the 26 around it; headings wrap around.
pub(super) fn neighbours([x, y, heading]: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    let turn = (TAU / BIN[2]).round() as i32;
    let wrapped = move |heading: i32| (heading + turn / 2).rem_euclid(turn) - turn / 2;
    (0..27).map(move |n| [x + n % 3 - 1, y + n / 3 % 3 - 1, wrapped(heading + n / 9 - 1)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_are_half_a_metre_and_ten_degrees() {
        let pose = |x: f32, y: f32, degrees: f32| LocalPose { x, y, heading: degrees.to_radians() };
        assert_eq!(bin(pose(0.49, -0.01, 9.9)), [0, -1, 0]);
        assert_eq!(bin(pose(0.51, 0.49, 10.1)), [1, 0, 1]);
        assert_eq!(bin(pose(-7.3, 12.2, -179.0)), [-15, 24, -18]);
    }
}
