//! A pose fitted to what a frame shows of the map: a particle goes where the objects fit too.
//!
//! The scan and the motion leave a Gaussian around the mode of a particle's pose, N(x; m, I⁻¹), and along a bare corridor they say
//! little. A detection z_k, in the robot's frame, of a landmark l_j is another measurement of it: with d = (forward, sideways,
//! turn) the step from the mode and l_j' the landmark seen from there, l_j' = z_k + H_k d plus an error of covariance
//! S_kj = R_k + Σ_j. So the information grows to I + Σ_kj w_kj H_kᵀ S_kj⁻¹ H_k, and the mode moves by
//!
//! d = (I + Σ w Hᵀ S⁻¹ H)⁻¹ Σ w Hᵀ S⁻¹ (l' - z).
//!
//! The weights w_kj are those of the frame under the whole Gaussian: covariances R_k + Σ_j + H_k I⁻¹ H_kᵀ.

use super::observation::{Detected, Observation};
use super::table::Associated;
use super::{Landmark, Objects};
use crate::geometry::Pose;
use nalgebra::{Matrix2x3, Matrix3, Rotation2, Vector2, Vector3};

impl Objects {
    /// The mode of a pose and the information about (forward, sideways, turn) there, once a frame is taken in. `None` where the
    /// information is none, or the frame shows nothing of the map.
    pub fn fitted(
        &self,
        landmarks: &[Landmark],
        observation: &Observation,
        mode: Pose,
        information: &Matrix3<f64>,
    ) -> Option<(Pose, Matrix3<f64>)> {
        let covariance = information.cholesky()?.inverse();
        let inflated = |seen: &Detected| {
            let moves = moves(seen.position);
            let covariance = seen.covariance + moves * covariance * moves.transpose();
            Detected { covariance, ..*seen }.moved(mode)
        };
        let detected: Vec<Detected> = observation.detected.iter().map(inflated).collect();
        let Associated { near, weights, .. } = self.associated(landmarks, observation, mode, &detected);
        let (mut found, mut pull) = (Matrix3::zeros(), Vector3::zeros());
        let turn = Rotation2::new(-mode.heading).into_inner();
        for (k, seen) in observation.detected.iter().enumerate() {
            let moves = moves(seen.position);
            for (j, landmark) in near.iter().map(|&number| &landmarks[number]).enumerate() {
                let weight = weights.pairs[(k, j)];
                let covariance = seen.covariance + turn * landmark.covariance * turn.transpose();
                let Some(precision) = covariance.try_inverse().filter(|_| weight > 0.0) else { continue };
                let off = (mode.inverse() * landmark.position).coords - seen.position;
                found += weight * moves.transpose() * precision * moves;
                pull += weight * moves.transpose() * precision * off;
            }
        }
        let information = information + found;
        let step = information.cholesky()?.solve(&pull);
        (pull != Vector3::zeros()).then(|| (mode * Pose::new(step.x, step.y, step.z), information))
    }
}

/// H: how far a detection moves over the ground, by the robot's axes, where the robot takes a small step (forward, sideways, turn).
fn moves(position: Vector2<f64>) -> Matrix2x3<f64> {
    Matrix2x3::new(1.0, 0.0, -position.y, 0.0, 1.0, position.x)
}
