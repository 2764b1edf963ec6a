//! What is known: residuals of a few variables each, with their derivatives.
//!
//! A residual is e = predicted - measured, on SE(2) and SE(3) as e = log(measured⁻¹ · predicted). The derivative by a
//! variable is that by its step, at step zero.

use super::{GraphError, Values, VariableId};
use nalgebra::DMatrixViewMut;
use std::fmt::Debug;

mod inertial;
mod landmark;
mod motion;
mod odometry;
mod prior;
mod projection;
mod track;

pub use inertial::Inertial;
pub use landmark::{Prediction, RangeBearing, Sighting};
pub use motion::{Between, Walk};
pub use odometry::{Odometry, Odometry3};
pub use prior::Prior;
pub use projection::{Stereo, StereoCamera};
pub use track::Track;

/// The derivative of a residual: a row for each of its numbers, and a column for each degree of freedom of the
/// factor's variables, one variable after the other.
pub type Jacobian<'a> = DMatrixViewMut<'a, f64>;

/// A residual that depends on a few variables.
pub trait Factor: Debug + Send + Sync {
    /// The variables, each once. Any number of them.
    fn variables(&self) -> &[VariableId];

    /// The length of the residual.
    fn dimension(&self) -> usize;

    /// Writes the residual, and where it is asked for the Jacobian, which is zero at the call. Neither is divided by the
    /// noise.
    ///
    /// # Errors
    /// A variable does not exist or is not what the factor needs.
    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError>;
}
