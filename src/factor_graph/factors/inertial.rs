//! Inertial term (eq. 9).

use super::{Factor, Jacobian};
use crate::factor_graph::{GraphError, Values, VariableId};
use crate::geometry::{rotation_jacobian, rotation_log_jacobian};
use crate::inertial::{ImuBias, Preintegration};
use nalgebra::{Matrix3, UnitQuaternion, Vector3, Vector6};

/// A motion as an inertial sensor measured it, between two poses with velocities. With gravity g \[m/s²\] and the duration t,
///
/// - eₚ = Rᵢᵀ (pⱼ - pᵢ - vᵢ t - ½ g t²) - Δp(b) \[m\]
/// - eᵣ = log(ΔR(b)ᵀ Rᵢᵀ Rⱼ) \[rad\]
/// - eᵥ = Rᵢᵀ (vⱼ - vᵢ - g t) - Δv(b) \[m/s\]
///
/// (Forster et al., "On-Manifold Preintegration for Real-Time Visual-Inertial Odometry", 2017, eq. 45). Its noise is
/// [`Preintegration::covariance`].
#[derive(Clone, Debug, PartialEq)]
pub struct Inertial {
    variables: [VariableId; 5],
    motion: Preintegration,
    gravity: Vector3<f64>,
}

impl Inertial {
    /// `from` and `to` are pose and velocity at both ends, the velocity a vector of three in the world's frame; `bias` is a
    /// vector of six, [`ImuBias::to_vector`]; `gravity`, in the world's frame, points down.
    pub fn new(
        from: [VariableId; 2],
        to: [VariableId; 2],
        bias: VariableId,
        motion: Preintegration,
        gravity: Vector3<f64>,
    ) -> Self {
        Self { variables: [from[0], from[1], to[0], to[1], bias], motion, gravity }
    }
}

impl Factor for Inertial {
    fn variables(&self) -> &[VariableId] {
        &self.variables
    }

    fn dimension(&self) -> usize {
        9
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        let [from, from_velocity, to, to_velocity, bias] = self.variables;
        let vector = |id| values.vector_of(id, 3).map(Vector3::from_column_slice);
        let (from, to) = (values.pose3(from)?, values.pose3(to)?);
        let (from_velocity, to_velocity) = (vector(from_velocity)?, vector(to_velocity)?);
        let bias = ImuBias::from_vector(Vector6::from_column_slice(values.vector_of(bias, 6)?));
        let (motion, t) = (&self.motion, self.motion.duration);

        let back = from.rotation.inverse();
        let moved = back * (to.position - from.position - from_velocity * t - 0.5 * self.gravity * t * t);
        let sped = back * (to_velocity - from_velocity - self.gravity * t);
        let turned = back * to.rotation;
        let (rotation, position, velocity) = motion.corrected(bias);
        let turn_error = (rotation.inverse() * turned).scaled_axis();
        residual[..3].copy_from_slice((moved - position).as_slice());
        residual[3..6].copy_from_slice(turn_error.as_slice());
        residual[6..].copy_from_slice((sped - velocity).as_slice());

        if let Some(jacobian) = jacobian {
            let back = back.to_rotation_matrix().into_inner();
            let turned = turned.to_rotation_matrix().into_inner();
            let by_turn = rotation_log_jacobian(turn_error);
            let mut set = |row, column, block: Matrix3<f64>| {
                jacobian.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
            };
            // From: translation, rotation, velocity.
            set(0, 0, -Matrix3::identity());
            set(0, 3, moved.cross_matrix());
            set(0, 6, -back * t);
            set(3, 3, -by_turn * turned.transpose());
            set(6, 3, sped.cross_matrix());
            set(6, 6, -back);
            // To: translation, rotation, velocity.
            set(0, 9, turned);
            set(3, 12, by_turn);
            set(6, 15, back);
            // Bias. A step of ΔR(b) is one of the error backwards, carried to its end.
            let turn_change = motion.change(bias).fixed_rows::<3>(3).into_owned();
            let error_back = UnitQuaternion::from_scaled_axis(-turn_error).to_rotation_matrix().into_inner();
            let mut by_bias = -motion.by_bias;
            let rows = by_bias.fixed_rows::<3>(3).into_owned();
            by_bias.fixed_rows_mut::<3>(3).copy_from(&(by_turn * error_back * rotation_jacobian(turn_change) * rows));
            jacobian.fixed_view_mut::<9, 6>(0, 18).copy_from(&by_bias);
        }
        Ok(())
    }
}
