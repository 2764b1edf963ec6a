//! The algebra of the filter: products of the covariance Σ of pose, calibration and landmarks with the derivatives H of
//! what is seen. Matrices of one pair have a fixed size, those of a frame or of the whole map have not.

use crate::factor_graph::Prediction;
use nalgebra::{Cholesky, DMatrix, DVector, SMatrix, SVector};
use std::f64::consts::TAU;

/// Scale c of Cauchy's loss ½ c² ln(1 + d²/c²), in standard deviations: real detections have gross outliers, and of a few hundred
/// normal errors none is expected beyond three standard deviations.
pub const LOSS_SCALE: f64 = 3.0;

/// 99.9 % of χ², with as many degrees of freedom as a landmark has coordinates: two and three.
pub const GATES: [f64; 2] = [13.8, 16.3];

/// A detection and a landmark that it may show, whose numbers start at the row `first` of Σ.
#[derive(Clone, Copy, Debug)]
pub struct Pair<L: Linear> {
    /// The landmark as it would be seen.
    pub prediction: L,
    /// Where the landmark's position starts in Σ.
    pub first: usize,
    /// Measured less predicted.
    pub innovation: L::Numbers,
    /// Of the detection.
    pub variances: L::Numbers,
}

/// How well a detection fits a landmark.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    /// The squared distance between the two \[standard deviations\].
    pub squared: f64,
    /// The variances of the detection are multiplied by this. Beyond [`LOSS_SCALE`] standard deviations they grow with the
    /// square of the distance, so that an outlier does not pull.
    pub inflation: f64,
    /// Its log-density with this noise.
    pub log_density: f64,
}

/// What is seen of a landmark, linear around the estimate.
pub trait Linear: Copy + std::fmt::Debug {
    /// What a detection measures.
    type Numbers: Copy;
    /// H Σ Hᵀ of one landmark.
    type Spread: Copy;

    /// What would be measured.
    fn mean(&self) -> Self::Numbers;

    /// H Σ Hᵀ of a landmark whose position starts at the row `first`.
    fn spread(&self, first: usize, all: &DMatrix<f64>) -> Self::Spread;

    /// How well a detection fits, under H Σ Hᵀ + R; no result where that is not positive.
    fn fit(pair: &Pair<Self>, spread: &Self::Spread) -> Option<Fit>;

    /// Of all pairs of a frame together: what was measured less what was predicted, and its covariance H Σ Hᵀ + R.
    fn innovations(pairs: &[Pair<Self>], all: &DMatrix<f64>) -> Option<(DVector<f64>, DMatrix<f64>)>;

    /// Σ Hᵀ of all pairs of a frame: the first `rows` rows.
    fn cross(pairs: &[Pair<Self>], rows: usize, all: &DMatrix<f64>) -> DMatrix<f64>;

    /// Σ with one landmark more, at its end, which is where its prediction agrees with a detection of these variances.
    fn grown(&self, variances: Self::Numbers, all: DMatrix<f64>) -> DMatrix<f64>;
}

impl<const P: usize, const D: usize> Prediction<P, D> {
    /// H Σ H'ᵀ of two landmarks.
    fn covariance(&self, a: usize, other: &Self, b: usize, all: &DMatrix<f64>) -> SMatrix<f64, D, D> {
        let pose = all.fixed_view::<P, P>(0, 0) * other.by_pose.transpose()
            + all.fixed_view::<P, D>(0, b) * other.by_point.transpose();
        let landmark = all.fixed_view::<D, P>(a, 0) * other.by_pose.transpose()
            + all.fixed_view::<D, D>(a, b) * other.by_point.transpose();
        self.by_pose * pose + self.by_point * landmark
    }
}

impl<const P: usize, const D: usize> Linear for Prediction<P, D> {
    type Numbers = [f64; D];
    type Spread = SMatrix<f64, D, D>;

    fn mean(&self) -> [f64; D] {
        self.mean.into()
    }

    fn spread(&self, first: usize, all: &DMatrix<f64>) -> Self::Spread {
        self.covariance(first, self, first, all)
    }

    fn fit(pair: &Pair<Self>, spread: &Self::Spread) -> Option<Fit> {
        let (innovation, variances) = (SVector::from(pair.innovation), SVector::from(pair.variances));
        // Squared distance and log-determinant, the noise as large.
        let measure = |inflation: f64| {
            let covariance = spread + SMatrix::from_diagonal(&(variances * inflation));
            let factor = Cholesky::new(covariance)?;
            let whitened = factor.l_dirty().solve_lower_triangular(&innovation)?;
            let log_determinant: f64 = factor.l_dirty().diagonal().iter().map(|root| 2.0 * root.ln()).sum();
            Some((whitened.norm_squared(), log_determinant))
        };
        let (squared, log_determinant) = measure(1.0)?;
        let inflation = (squared / (LOSS_SCALE * LOSS_SCALE)).max(1.0);
        let (least, log_determinant) = if inflation > 1.0 { measure(inflation)? } else { (squared, log_determinant) };
        Some(Fit { squared, inflation, log_density: log_normal(least, log_determinant, D) })
    }

    fn innovations(pairs: &[Pair<Self>], all: &DMatrix<f64>) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let mut innovation = DVector::zeros(D * pairs.len());
        let mut covariance = DMatrix::zeros(D * pairs.len(), D * pairs.len());
        let block = |covariance: &mut DMatrix<f64>, row: usize, column: usize, block: &SMatrix<f64, D, D>| {
            covariance.fixed_view_mut::<D, D>(D * row, D * column).copy_from(block);
        };
        for (row, pair) in pairs.iter().enumerate() {
            for (column, other) in pairs.iter().enumerate().take(row) {
                let shared = pair.prediction.covariance(pair.first, &other.prediction, other.first, all);
                block(&mut covariance, row, column, &shared);
                block(&mut covariance, column, row, &shared.transpose());
            }
            let spread = pair.prediction.spread(pair.first, all);
            let noise = SVector::from(pair.variances) * Self::fit(pair, &spread)?.inflation;
            block(&mut covariance, row, row, &(spread + SMatrix::from_diagonal(&noise)));
            innovation.fixed_rows_mut::<D>(D * row).copy_from(&SVector::from(pair.innovation));
        }
        Some((innovation, covariance))
    }

    fn cross(pairs: &[Pair<Self>], rows: usize, all: &DMatrix<f64>) -> DMatrix<f64> {
        let mut cross = DMatrix::zeros(rows, D * pairs.len());
        for (column, Pair { prediction, first, .. }) in pairs.iter().enumerate() {
            let by_pose = all.view((0, 0), (rows, P)) * prediction.by_pose.transpose();
            let by_point = all.view((0, *first), (rows, D)) * prediction.by_point.transpose();
            cross.columns_mut(D * column, D).copy_from(&(by_pose + by_point));
        }
        cross
    }

    fn grown(&self, variances: [f64; D], all: DMatrix<f64>) -> DMatrix<f64> {
        let before = all.nrows();
        let mut grown = all.resize(before + D, before + D, 0.0);
        // by_pose dx + by_point dl = noise.
        let Some(by_measurement) = self.by_point.try_inverse() else { return grown };
        let by_pose = -by_measurement * self.by_pose;
        let rows = by_pose * grown.view((0, 0), (P, before));
        let noise = SMatrix::from_diagonal(&SVector::from(variances));
        let own = rows.columns(0, P) * by_pose.transpose() + by_measurement * noise * by_measurement.transpose();
        grown.view_mut((before, 0), (D, before)).copy_from(&rows);
        grown.view_mut((0, before), (before, D)).copy_from(&rows.transpose());
        grown.view_mut((before, before), (D, D)).copy_from(&own);
        grown
    }
}

/// The logarithm of a normal density of some dimension, by the squared distance and the covariance's log-determinant.
pub fn log_normal(squared: f64, log_determinant: f64, dimension: usize) -> f64 {
    -0.5 * (squared + log_determinant + dimension as f64 * TAU.ln())
}
