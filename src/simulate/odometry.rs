//! What the wheels say: the true motion with noise and a systematic error.
//!
//! For a step of d metres that turns by a radians, odometry reports
//! d' ~ N(d (1 + b₁), s₁² |d|) and a' ~ N(a (1 + b₂) + b₃ d, s₂² |a| + s₃² |d|).
//! The variances grow with the way, so the noise over a drive is the same however finely the drive is cut into steps.

use super::drive::Step;
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Errors of the odometry. The defaults drift by some metres and ten or twenty degrees over a drive of 250 m, as the
/// raw odometry of indoor robots does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OdometryNoise {
    /// b₁: share by which distances come out too long; may be negative.
    pub distance_bias: f64,
    /// b₂: share by which turns come out too large; may be negative.
    pub turn_bias: f64,
    /// b₃: turn reported per metre driven straight \[rad/m\]; may be negative.
    pub veer: f64,
    /// s₁: spread of the distance after one metre \[m/√m\].
    pub distance_spread: f64,
    /// s₂: spread of the turn after turning by one radian \[rad/√rad\].
    pub turn_spread: f64,
    /// s₃: spread of the turn after one metre \[rad/√m\].
    pub veer_spread: f64,
}

impl Default for OdometryNoise {
    fn default() -> Self {
        Self {
            distance_bias: 0.015,
            turn_bias: -0.01,
            veer: 0.0015,
            distance_spread: 0.03,
            turn_spread: 0.03,
            veer_spread: 0.01,
        }
    }
}

impl OdometryNoise {
    /// All errors larger by a factor; 0 gives perfect odometry.
    pub fn scaled(self, factor: f64) -> Self {
        Self {
            distance_bias: self.distance_bias * factor,
            turn_bias: self.turn_bias * factor,
            veer: self.veer * factor,
            distance_spread: self.distance_spread * factor,
            turn_spread: self.turn_spread * factor,
            veer_spread: self.veer_spread * factor,
        }
    }

    /// One reading of a step: (distance \[m\], turn \[rad\]).
    pub(super) fn measure(&self, step: &Step, rng: &mut ChaCha8Rng) -> (f64, f64) {
        let distance_variance = self.distance_spread.powi(2) * step.distance.abs();
        let turn_variance = self.turn_spread.powi(2) * step.turn.abs() + self.veer_spread.powi(2) * step.distance.abs();
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        (
            step.distance * (1.0 + self.distance_bias) + distance_variance.sqrt() * normal(),
            step.turn * (1.0 + self.turn_bias) + self.veer * step.distance + turn_variance.sqrt() * normal(),
        )
    }
}
