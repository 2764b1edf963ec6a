//! Counter-based random numbers: a draw is a pure function of (seed, step, particle, draw).
//!
//! Philox4x32-10 (Salmon, Moraes, Dror, Shaw: Parallel random numbers: as easy as 1, 2, 3; SC 2011). The key is the
//! seed, the counter is (step, particle, draw, 0), so any draw can be made anywhere, in any order, by any number of
//! threads, and comes out the same. It needs 32-bit products only, which a shader can do too; twin of
//! `shaders/shared/random.wgsl`.

use crate::math::{ln, sin_cos};

/// Which draw of a particle in a step; each asks for its own numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Draw {
    /// Noise of the motion model (eq. 17).
    Motion = 0,
    /// Sample of the scan-matched proposal.
    Proposal = 1,
    /// Offset of the resampling comb.
    Resample = 2,
    /// Starts of scan matching between steps.
    Tracking = 3,
    /// A pose anywhere in a known map.
    Anywhere = 4,
    /// A label that a detector gets wrong.
    Label = 5,
    /// An object that is put somewhere.
    Object = 6,
    /// How a detection errs.
    Detection = 7,
    /// How odometry is made worse.
    Wheels = 8,
    /// How a range is made worse.
    Range = 9,
    /// Whether a range becomes any other.
    Stray = 10,
    /// When something happens to a log, and who walks along.
    Event = 11,
    /// Which features of a picture are compared, and which pairs are tried.
    Picture = 12,
}

/// Four independent words of 32 random bits.
pub fn bits(seed: u64, step: u32, particle: u32, draw: Draw) -> [u32; 4] {
    philox4x32_10([step, particle, draw as u32, 0], [seed as u32, (seed >> 32) as u32])
}

/// A number in (0, 1): 23 bits, offset by half a step so that 0 and 1 never come; exact in f32.
pub fn uniform(word: u32) -> f32 {
    ((word >> 9) as f32 + 0.5) * (1.0 / 8_388_608.0)
}

/// Four independent standard normal numbers (Box-Muller).
pub fn normals(seed: u64, step: u32, particle: u32, draw: Draw) -> [f32; 4] {
    let [a, b, c, d] = bits(seed, step, particle, draw).map(uniform);
    let (r, s) = ((-2.0 * ln(a)).sqrt(), (-2.0 * ln(c)).sqrt());
    let (sin_b, cos_b) = sin_cos(std::f32::consts::TAU * b);
    let (sin_d, cos_d) = sin_cos(std::f32::consts::TAU * d);
    [r * cos_b, r * sin_b, s * cos_d, s * sin_d]
}

fn philox4x32_10(mut counter: [u32; 4], mut key: [u32; 2]) -> [u32; 4] {
    for _ in 0..10 {
        let (high0, low0) = multiply(0xD251_1F53, counter[0]);
        let (high1, low1) = multiply(0xCD9E_8D57, counter[2]);
        counter = [high1 ^ counter[1] ^ key[0], low1, high0 ^ counter[3] ^ key[1], low0];
        key = [key[0].wrapping_add(0x9E37_79B9), key[1].wrapping_add(0xBB67_AE85)];
    }
    counter
}

fn multiply(a: u32, b: u32) -> (u32, u32) {
    let product = u64::from(a) * u64::from(b);
    ((product >> 32) as u32, product as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Known-answer vectors published with the Random123 library (kat_vectors, philox4x32 10).
    #[test]
    fn known_answers() {
        assert_eq!(philox4x32_10([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(philox4x32_10([u32::MAX; 4], [u32::MAX; 2]), [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
        assert_eq!(
            philox4x32_10([0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344], [0xa409_3822, 0x299f_31d0]),
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
        );
    }

    #[test]
    fn normals_have_the_moments_of_a_normal() {
        let count = 100_000;
        let mut sums = [0.0f64; 4];
        for particle in 0..count {
            for z in normals(7, 3, particle, Draw::Motion).map(f64::from) {
                for (power, sum) in sums.iter_mut().enumerate() {
                    *sum += z.powi(power as i32 + 1);
                }
            }
        }
        let n = 4.0 * f64::from(count);
        // Moments 0, 1, 0, 3; the spread of each mean is sqrt(var / n), with variances 1, 2, 15 and 96.
        for ((sum, expected), variance) in sums.iter().zip([0.0, 1.0, 0.0, 3.0]).zip([1.0, 2.0, 15.0, 96.0]) {
            let tolerance = 5.0 * f64::sqrt(variance / n);
            assert!((sum / n - expected).abs() < tolerance, "seed 7: {} is not {expected} ± {tolerance}", sum / n);
        }
    }

    #[test]
    fn every_coordinate_changes_the_draw() {
        let base = bits(1, 2, 3, Draw::Motion);
        for other in [
            bits(2, 2, 3, Draw::Motion),
            bits(1, 3, 3, Draw::Motion),
            bits(1, 2, 4, Draw::Motion),
            bits(1, 2, 3, Draw::Proposal),
        ] {
            assert_ne!(base, other);
        }
        assert!(uniform(0) > 0.0 && uniform(u32::MAX) < 1.0);
    }
}
