//! One pose seen from another one.

use super::{Factor, Jacobian};
use crate::factor_graph::{GraphError, Values, VariableId};
use crate::geometry::{Pose, Pose3};
use nalgebra::{Matrix2, Matrix3, Matrix6, Vector2, Vector3, Vector6};

/// e = log(measured⁻¹ · pose), and its derivative by a step of the pose: the inverse right Jacobian of SE(2) at e.
pub(super) fn pose_error(measured: Pose, pose: Pose) -> (Vector3<f64>, Matrix3<f64>) {
    let error = pose.seen_from(measured).log();
    let jacobian = Pose::exp_jacobian(error);
    // [A v; 0 1] with A = [a b; -b a].
    let (a, b) = (jacobian[(0, 0)], jacobian[(0, 1)]);
    let inverse = Matrix2::new(a, -b, b, a) / (a * a + b * b);
    let last = -inverse * Vector2::new(jacobian[(0, 2)], jacobian[(1, 2)]);
    let derivative =
        Matrix3::new(inverse[(0, 0)], inverse[(0, 1)], last.x, inverse[(1, 0)], inverse[(1, 1)], last.y, 0.0, 0.0, 1.0);
    (error, derivative)
}

/// The same in space.
pub(super) fn pose3_error(measured: Pose3, pose: Pose3) -> (Vector6<f64>, Matrix6<f64>) {
    let error = pose.seen_from(measured).log();
    (error, Pose3::log_jacobian(error))
}

/// A pose seen from another one: e = log(measured⁻¹ · from⁻¹ · to), (forward, sideways \[m\], turn \[rad\]).
#[derive(Clone, Debug, PartialEq)]
pub struct Between {
    variables: [VariableId; 2],
    from_to: Pose,
}

impl Between {
    /// `from_to` is the measured pose of `to` in the frame of `from`.
    pub fn new(from: VariableId, to: VariableId, from_to: Pose) -> Self {
        Self { variables: [from, to], from_to }
    }
}

impl Factor for Between {
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
        let [from, to] = self.variables;
        let from_to = values.pose(to)?.seen_from(values.pose(from)?);
        let (error, derivative) = pose_error(self.from_to, from_to);
        residual.copy_from_slice(error.as_slice());
        if let Some(jacobian) = jacobian {
            // A step of `from` is a step of `to` backwards, carried to where `to` is.
            jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&(-derivative * from_to.inverse().adjoint()));
            jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&derivative);
        }
        Ok(())
    }
}

/// A vector that wanders, such as a bias: e = to - from.
#[derive(Clone, Debug, PartialEq)]
pub struct Walk {
    variables: [VariableId; 2],
    length: usize,
}

impl Walk {
    /// Of two vectors of that length.
    pub fn new(from: VariableId, to: VariableId, length: usize) -> Self {
        Self { variables: [from, to], length }
    }
}

impl Factor for Walk {
    fn variables(&self) -> &[VariableId] {
        &self.variables
    }

    fn dimension(&self) -> usize {
        self.length
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        let [from, to] = self.variables.map(|id| values.vector_of(id, self.length));
        residual.iter_mut().zip(to?).zip(from?).for_each(|((error, to), from)| *error = to - from);
        if let Some(jacobian) = jacobian {
            let (mut by_from, mut by_to) = jacobian.columns_range_pair_mut(..self.length, self.length..);
            by_from.fill_diagonal(-1.0);
            by_to.fill_diagonal(1.0);
        }
        Ok(())
    }
}
