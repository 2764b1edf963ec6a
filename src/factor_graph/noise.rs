//! How far a factor is trusted: the covariance of its residual, and what an outlier may cost.

use super::GraphError;
use nalgebra::{Cholesky, DMatrix, DMatrixViewMut, DVector, Dyn};

/// The square root R of the information of a residual: RᵀR = Σ⁻¹. The residual R e has unit covariance.
#[derive(Clone, Debug, PartialEq)]
pub struct Noise(Root);

#[derive(Clone, Debug, PartialEq)]
enum Root {
    Diagonal(DVector<f64>),
    /// The Cholesky factor L of the covariance, whose inverse is R.
    Dense(DMatrix<f64>),
}

impl Noise {
    /// Independent errors with these standard deviations, in the units of the residual.
    ///
    /// # Errors
    /// One of them is not a positive, finite number.
    pub fn sigmas(sigmas: &[f64]) -> Result<Self, GraphError> {
        if sigmas.iter().all(|sigma| sigma.is_finite() && *sigma > 0.0 && sigma.recip().is_finite()) {
            Ok(Self(Root::Diagonal(DVector::from_iterator(sigmas.len(), sigmas.iter().map(|sigma| sigma.recip())))))
        } else {
            Err(GraphError::Noise)
        }
    }

    /// Errors with this covariance, in the squared units of the residual.
    ///
    /// # Errors
    /// The matrix is not symmetric and positive definite.
    pub fn covariance(covariance: &DMatrix<f64>) -> Result<Self, GraphError> {
        let is_symmetric =
            covariance.is_square() && (covariance - covariance.transpose()).amax() <= 1e-9 * covariance.amax();
        let cholesky = if is_symmetric { Cholesky::new(covariance.clone()) } else { None };
        cholesky.map(|cholesky: Cholesky<f64, Dyn>| Self(Root::Dense(cholesky.unpack()))).ok_or(GraphError::Noise)
    }

    /// The length of the residual that it fits.
    pub fn dimension(&self) -> usize {
        match &self.0 {
            Root::Diagonal(root) => root.len(),
            Root::Dense(factor) => factor.nrows(),
        }
    }

    /// Multiplies from the left by R.
    pub(super) fn whiten(&self, mut matrix: DMatrixViewMut<'_, f64>) {
        match &self.0 {
            Root::Diagonal(root) => {
                for mut column in matrix.column_iter_mut() {
                    column.component_mul_assign(root);
                }
            }
            Root::Dense(factor) => {
                factor.solve_lower_triangular_mut(&mut matrix);
            }
        }
    }
}

/// What a residual costs, by its norm d in standard deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Loss {
    /// ½ d²: the residual is normal.
    #[default]
    Squared,
    /// ½ c² log(1 + d²/c²), with c > 0 in standard deviations: large residuals hardly cost more than those of size c.
    Cauchy(f64),
    /// ½ d² up to k > 0 standard deviations and k (d - ½ k) from there.
    Huber(f64),
}

impl Loss {
    /// The cost of a residual of squared norm d², and the weight that gives the squared residual the same slope:
    /// (dρ/dd) / d.
    pub(super) fn cost_and_weight(self, squared: f64) -> (f64, f64) {
        match self {
            Self::Squared => (0.5 * squared, 1.0),
            Self::Cauchy(scale) => {
                let squared_scale = scale * scale;
                let ratio = squared / squared_scale;
                (0.5 * squared_scale * ratio.ln_1p(), (1.0 + ratio).recip())
            }
            Self::Huber(bound) if squared > bound * bound => {
                let norm = squared.sqrt();
                (bound * (norm - 0.5 * bound), bound / norm)
            }
            Self::Huber(_) => (0.5 * squared, 1.0),
        }
    }

    pub(super) fn is_valid(self) -> bool {
        match self {
            Self::Squared => true,
            Self::Cauchy(scale) | Self::Huber(scale) => scale.is_finite() && scale > 0.0,
        }
    }
}
