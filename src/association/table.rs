//! The terms of a frame: how well each detection fits each landmark, and none.

use nalgebra::DMatrix;

/// Log-likelihood terms of a frame of K detections and M landmarks.
///
/// Pair term: ln L_kj = ln p(z_k | x, l_j) + ln p(class_k | π_j), the density of the measurement and, where there are
/// classes, [`class_log_likelihood`]; -∞ where the pair is gated out. Null term: ln u_k, the density of detections that
/// show no landmark of the map: clutter, or a landmark that is not mapped yet. Densities of both kinds are per the same
/// unit of the measurement.
///
/// A term that is not a number, or +∞, counts as -∞: nothing is known of such a pair, so it is gated out.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    pairs: DMatrix<f64>,
    nulls: Vec<f64>,
    constant: f64,
}

impl Table {
    /// K null terms, and the pair term of each detection k < K and landmark j < M = `landmarks`. Either may be 0.
    pub fn new(nulls: Vec<f64>, landmarks: usize, mut log_pair: impl FnMut(usize, usize) -> f64) -> Self {
        let pairs = DMatrix::from_fn(nulls.len(), landmarks, |detection, landmark| term(log_pair(detection, landmark)));
        Self { pairs, nulls: nulls.into_iter().map(term).collect(), constant: 0.0 }
    }

    /// The same frame, with landmarks that were not detected.
    ///
    /// `detection_probability` is P_D, in 0..1, of a landmark, or `None` where it was not surely in view. Of each
    /// landmark in view, pair terms grow by ln(P_D / (1 - P_D)) and [`constant`](Self::constant) by ln(1 - P_D): so an
    /// assignment has the factor P_D where it detects the landmark and 1 - P_D where it misses it. A landmark that is
    /// not surely in view keeps its terms; else the map would be punished for what is far off or hidden. P_D is kept
    /// 1e-9 away from 0 and 1; what is not a number counts as `None`.
    pub fn with_missed(mut self, detection_probability: impl Fn(usize) -> Option<f64>) -> Self {
        for (landmark, mut pairs) in self.pairs.column_iter_mut().enumerate() {
            let Some(probability) = detection_probability(landmark).filter(|p| !p.is_nan()) else { continue };
            let probability = probability.clamp(1e-9, 1.0 - 1e-9);
            pairs.add_scalar_mut(probability.ln() - (-probability).ln_1p());
            self.constant += (-probability).ln_1p();
        }
        self
    }

    /// The pair terms, a row per detection and a column per landmark (K x M).
    pub fn pairs(&self) -> &DMatrix<f64> {
        &self.pairs
    }

    /// The null terms, one per detection (K).
    pub fn nulls(&self) -> &[f64] {
        &self.nulls
    }

    /// What every assignment has in common: Σ ln(1 - P_D) over the landmarks in view. All log-likelihoods hold it.
    pub fn constant(&self) -> f64 {
        self.constant
    }
}

fn term(log: f64) -> f64 {
    if log < f64::INFINITY { log } else { f64::NEG_INFINITY }
}

/// ln p(class_k | π_j) = ln Σ_c π_j(c) C(class_k | c): how well a detected class fits a landmark of
/// uncertain class.
///
/// `confusion` has a row per true class and a column per detected class, each row a distribution; `posterior` is π_j,
/// which sums to one. -∞ where the class cannot be, or has no column.
///
/// ```
/// use ipslam::association::class_log_likelihood;
/// use nalgebra::dmatrix;
///
/// let confusion = dmatrix![0.9, 0.1; 0.2, 0.8];
/// let found = class_log_likelihood(&confusion, &[0.5, 0.5], 1);
/// assert!((found - 0.45f64.ln()).abs() < 1e-12);
/// ```
pub fn class_log_likelihood(confusion: &DMatrix<f64>, posterior: &[f64], detected: usize) -> f64 {
    let joint = posterior.iter().enumerate().map(|(class, p)| p * confusion.get((class, detected)).unwrap_or(&0.0));
    joint.sum::<f64>().ln()
}
