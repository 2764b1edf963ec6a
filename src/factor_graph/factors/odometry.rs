//! Odometry, calibrated on the way.

use super::motion::{pose_error, pose3_error};
use super::{Factor, Jacobian};
use crate::factor_graph::{GraphError, Values, VariableId};
use crate::geometry::{Pose, Pose3};
use nalgebra::{Matrix3, Matrix6x2, Vector3, Vector6};

/// Odometry whose calibration is estimated with the path.
///
/// The measured motion is taken for an arc, driven at constant speed and turn: (u, v, w) = log(measured), forward and
/// sideways \[m\] and turn \[rad\]. The calibration is a vector of three numbers: forward scale s, turn scale t and
/// curvature k \[rad/m\]. The calibrated motion is
///
/// m = exp(s u, s v, t w + k u)
///
/// and the residual e = log(m⁻¹ · from⁻¹ · to), (forward, sideways \[m\], turn \[rad\]). With (1, 1, 0) it is that of
/// [`Between`](super::Between).
#[derive(Clone, Debug, PartialEq)]
pub struct Odometry {
    variables: [VariableId; 3],
    twist: Vector3<f64>,
}

impl Odometry {
    /// The calibration of exact odometry.
    pub const CALIBRATED: [f64; 3] = [1.0, 1.0, 0.0];

    /// `from_to` is the pose of `to` in the frame of `from`, as odometry measured it.
    pub fn new(from: VariableId, to: VariableId, calibration: VariableId, from_to: Pose) -> Self {
        Self { variables: [from, to, calibration], twist: from_to.log() }
    }

    /// The calibrated twist (s u, s v, t w + k u) of a measured one, and its derivative by (s, t, k).
    pub fn calibrated(measured: Vector3<f64>, calibration: Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        let (scale, turn_scale, curvature) = (calibration.x, calibration.y, calibration.z);
        let twist =
            Vector3::new(scale * measured.x, scale * measured.y, turn_scale * measured.z + curvature * measured.x);
        (twist, Matrix3::new(measured.x, 0.0, 0.0, measured.y, 0.0, 0.0, 0.0, measured.z, measured.x))
    }
}

impl Factor for Odometry {
    fn variables(&self) -> &[VariableId] {
        &self.variables
    }

    fn dimension(&self) -> usize {
        3
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        let [from, to, calibration] = self.variables;
        let numbers = values.vector_of(calibration, 3)?;
        let (twist, twist_by_calibration) = Self::calibrated(self.twist, Vector3::from_column_slice(numbers));
        let from_to = values.pose(to)?.seen_from(values.pose(from)?);
        let calibrated = Pose::exp(twist);
        let (error, derivative) = pose_error(calibrated, from_to);
        residual.copy_from_slice(error.as_slice());
        if let Some(jacobian) = jacobian {
            jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&(-derivative * from_to.inverse().adjoint()));
            jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&derivative);
            // A step of the calibrated motion, carried to the end of the error.
            let by_twist = -derivative * calibrated.seen_from(from_to).adjoint() * Pose::exp_jacobian(twist);
            jacobian.fixed_view_mut::<3, 3>(0, 6).copy_from(&(by_twist * twist_by_calibration));
        }
        Ok(())
    }
}

/// The same in space: a motion log(measured) = (u, w), translation \[m\] and rotation vector \[rad\], is calibrated by two
/// numbers, scale s and turn scale t:
///
/// m = exp(s u, t w), e = log(m⁻¹ · from⁻¹ · to)
#[derive(Clone, Debug, PartialEq)]
pub struct Odometry3 {
    variables: [VariableId; 3],
    twist: Vector6<f64>,
}

impl Odometry3 {
    /// The calibration of odometry that tells the truth.
    pub const CALIBRATED: [f64; 2] = [1.0, 1.0];

    /// `from_to` is the pose of `to` in the frame of `from`, as odometry measured it.
    pub fn new(from: VariableId, to: VariableId, calibration: VariableId, from_to: Pose3) -> Self {
        Self { variables: [from, to, calibration], twist: from_to.log() }
    }

    /// The calibrated twist (s u, t w) of a measured one, and its derivative by (s, t).
    pub fn calibrated(measured: Vector6<f64>, [scale, turn_scale]: [f64; 2]) -> (Vector6<f64>, Matrix6x2<f64>) {
        let (mut twist, mut derivative) = (measured * scale, Matrix6x2::zeros());
        twist.fixed_rows_mut::<3>(3).copy_from(&(measured.fixed_rows::<3>(3) * turn_scale));
        derivative.fixed_view_mut::<3, 1>(0, 0).copy_from(&measured.fixed_rows::<3>(0));
        derivative.fixed_view_mut::<3, 1>(3, 1).copy_from(&measured.fixed_rows::<3>(3));
        (twist, derivative)
    }
}

impl Factor for Odometry3 {
    fn variables(&self) -> &[VariableId] {
        &self.variables
    }

    fn dimension(&self) -> usize {
        6
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        let [from, to, calibration] = self.variables;
        let numbers = values.vector_of(calibration, 2)?;
        let (twist, twist_by_calibration) = Self::calibrated(self.twist, [numbers[0], numbers[1]]);
        let from_to = values.pose3(to)?.seen_from(values.pose3(from)?);
        let calibrated = Pose3::exp(twist);
        let (error, derivative) = pose3_error(calibrated, from_to);
        residual.copy_from_slice(error.as_slice());
        if let Some(jacobian) = jacobian {
            jacobian.fixed_view_mut::<6, 6>(0, 0).copy_from(&(-derivative * from_to.inverse().adjoint()));
            jacobian.fixed_view_mut::<6, 6>(0, 6).copy_from(&derivative);
            // A step of the calibrated motion, carried to the end of the error.
            let by_twist = -derivative * calibrated.seen_from(from_to).adjoint() * Pose3::exp_jacobian(twist);
            jacobian.fixed_view_mut::<6, 2>(0, 12).copy_from(&(by_twist * twist_by_calibration));
        }
        Ok(())
    }
}
