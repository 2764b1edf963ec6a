//! Symmetric matrices of three rows as the kernels have them, xx, xy, xh, yy, yh, hh, and their Cholesky factors; twin of
//! `shaders/shared/cholesky.wgsl`.

use nalgebra::Matrix3;

/// The six numbers of a symmetric matrix.
pub fn packed(matrix: &Matrix3<f64>) -> [f32; 6] {
    [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| matrix[at] as f32)
}

/// The symmetric matrix of six numbers.
pub fn unpacked([xx, xy, xh, yy, yh, hh]: [f32; 6]) -> Matrix3<f64> {
    Matrix3::new(xx, xy, xh, xy, yy, yh, xh, yh, hh).map(f64::from)
}

/// A lower triangle L with L Lᵀ = A: l00, l10, l11, l20, l21, l22.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cholesky(pub [f32; 6]);

impl Cholesky {
    /// Of a matrix; `None` where it is not positive definite.
    pub fn new([xx, xy, xh, yy, yh, hh]: [f32; 6]) -> Option<Self> {
        let l00 = positive_root(xx)?;
        let (l10, l20) = (xy / l00, xh / l00);
        let l11 = positive_root(yy - l10 * l10)?;
        let l21 = (yh - l20 * l10) / l11;
        let l22 = positive_root(hh - l20 * l20 - l21 * l21)?;
        Some(Self([l00, l10, l11, l20, l21, l22]))
    }

    /// Of a covariance: L z of standard normal z has it. All zero where the matrix is not positive definite.
    pub fn of_covariance(covariance: &Matrix3<f64>) -> Self {
        Self::new(packed(covariance)).unwrap_or(Self([0.0; 6]))
    }

    /// L z.
    pub fn times(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let [l00, l10, l11, l20, l21, l22] = self.0;
        [l00 * x, l10 * x + l11 * y, l20 * x + l21 * y + l22 * z]
    }

    /// The x of Lᵀ x = b: with standard normal b, a draw whose inverse covariance is A.
    pub fn solve_transposed(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let [l00, l10, l11, l20, l21, l22] = self.0;
        let z = z / l22;
        let y = (y - l21 * z) / l11;
        [(x - l10 * y - l20 * z) / l00, y, z]
    }

    /// The x of A x = b.
    pub fn solve(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let [l00, l10, l11, l20, l21, l22] = self.0;
        let x = x / l00;
        let y = (y - l10 * x) / l11;
        self.solve_transposed([x, y, (z - l20 * x - l21 * y) / l22])
    }
}

fn positive_root(square: f32) -> Option<f32> {
    (square > 0.0 && square.is_finite()).then(|| square.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    proptest! {
        /// The oracle: nalgebra's inverse in f64.
        #[test]
        fn solves(entries in proptest::array::uniform9(-1.0..1.0f64), b in proptest::array::uniform3(-1.0..1.0f32)) {
            let root = Matrix3::from_row_slice(&entries) + Matrix3::identity() * 4.0;
            let matrix = root * root.transpose();
            let cholesky = Cholesky::new(packed(&matrix)).unwrap();
            let b64 = Vector3::from(b.map(f64::from));
            let near = |found: [f32; 3], expected: Vector3<f64>| {
                (Vector3::from(found.map(f64::from)) - expected).norm() < 1e-4
            };
            let l = nalgebra::Cholesky::new(matrix).unwrap().l();
            prop_assert!(near(cholesky.solve(b), matrix.try_inverse().unwrap() * b64));
            prop_assert!(near(cholesky.times(b), l * b64));
            prop_assert!(near(cholesky.solve_transposed(b), l.transpose().try_inverse().unwrap() * b64));
            prop_assert!(!near(cholesky.solve(b), matrix.try_inverse().unwrap() * (b64 + Vector3::new(0.1, 0.0, 0.0))));
        }
    }

    #[test]
    fn what_is_not_positive_definite_is_refused() {
        for matrix in [[0.0; 6], [1.0, 2.0, 0.0, 1.0, 0.0, 1.0], [f32::NAN; 6], [1.0, 0.0, 0.0, 1.0, 0.0, -1.0]] {
            assert_eq!(Cholesky::new(matrix), None, "{matrix:?}");
        }
    }
}
