//! What the odometry of this drive is worth: its errors, as far as scans have shown them, in units of those that are configured.

use serde::Serialize;

/// By what the standard deviations of `[motion]` are multiplied.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OdometryErrors {
    /// Those of positions.
    pub position: f64,
    /// Those of headings.
    pub heading: f64,
}

impl Default for OdometryErrors {
    fn default() -> Self {
        Self { position: 1.0, heading: 1.0 }
    }
}

/// Errors of motions in standard deviations, in the order of their absolute values.
#[derive(Clone, Debug, Default)]
pub(super) struct Errors(Vec<f64>);

/// A normal distribution has half of its errors within so many standard deviations.
const MEDIAN: f64 = 0.674_489_750_196_082;
/// No error is smaller \[standard deviations\]: scans are not exact.
const LEAST: f64 = 0.01;

impl Errors {
    pub(super) fn add(&mut self, error: f64) {
        let error = error.abs();
        let place = self.0.partition_point(|&other| other < error);
        self.0.insert(place, error);
    }

    /// By what to multiply standard deviations so that half of the errors are as they should be: the median does not mind
    /// a wheel that spins now and then. Its logarithm counts as the share of its motions among them and `prior` more.
    pub(super) fn factor(&self, prior: f64) -> f64 {
        let Some(median) = self.0.get(self.0.len() / 2) else { return 1.0 };
        let count = self.0.len() as f64;
        (median / MEDIAN).max(LEAST).powf(count / (count + prior))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Draw, normals};

    #[test]
    fn the_factor_is_that_of_the_errors_with_outliers_or_without() {
        for (outliers, tolerance) in [(0, 0.05), (100, 0.15)] {
            let mut errors = Errors::default();
            for number in 0..2000 {
                let [normal, ..] = normals(7, 0, number, Draw::Motion);
                errors.add(if number < outliers { 1e3 } else { 0.3 * f64::from(normal) });
            }
            let factor = errors.factor(20.0);
            assert!((factor / 0.3 - 1.0).abs() < tolerance, "seed 7, {outliers} outliers: {factor}");
        }
    }

    #[test]
    fn few_errors_tell_little_and_none_nothing() {
        let mut errors = Errors::default();
        assert_eq!(errors.factor(20.0), 1.0);
        (0..20).for_each(|_| errors.add(-4.0 * MEDIAN));
        assert!((errors.factor(20.0) - 2.0).abs() < 1e-12, "half of the motions: the root of 4");
        assert_eq!(errors.factor(f64::INFINITY), 1.0);
    }
}
