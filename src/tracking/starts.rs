//! How many starts scan matching needs: as many as there is doubt about the motion.

use nalgebra::Matrix3;

/// How well scans of this drive usually fit.
#[derive(Clone, Copy, Debug, Default)]
pub struct UsualFit {
    /// Log-likelihood that a map adds for a point, on average over the last scans \[nats\].
    gain: Option<f64>,
}

/// Half the axes of the ellipsoid that the starts have to cover, in standard deviations.
const COVERED: f64 = 2.0;
/// Length \[m\] by which a heading is converted to a distance: that of a typical wall.
pub(crate) const LEVER: f64 = 5.0;
/// Maximum number of starts.
const MOST: usize = 4096;
/// A scan that fits this share worse than usual may have been matched to a wrong place.
const POOR: f64 = 0.1;
/// It is matched again from this many times as many starts.
const AGAIN: usize = 16;
/// Weight of a new scan in the running average: it covers about ten of them.
const SHARE: f64 = 0.1;

/// The number of starts, at least `least`, so that from some of them the true motion is reached: those that a climb reaches from one
/// start are up to two `capture_sigma` \[m\] away.
pub fn starts(least: usize, covariance: &Matrix3<f64>, capture_sigma: f64) -> usize {
    let ellipsoid = 4.0 / 3.0 * std::f64::consts::PI * COVERED.powi(3) * covariance.determinant().max(0.0).sqrt();
    let reached = (2.0 * capture_sigma).powi(3) / LEVER;
    ((ellipsoid / reached) as usize).clamp(least, MOST.max(least))
}

/// The number of starts to match a scan again with that fits badly.
pub fn more(starts: usize) -> usize {
    (AGAIN * starts).min(MOST.max(starts))
}

impl UsualFit {
    /// Whether a scan fits worse than is usual: the motion is far off its prior, or the walls are new.
    pub fn is_poor(&self, gain: f64) -> bool {
        self.gain.is_some_and(|usual| gain < (1.0 - POOR) * usual)
    }

    /// Takes in how well a scan fits.
    pub fn add(&mut self, gain: f64) {
        self.gain = Some(self.gain.map_or(gain, |usual| usual + SHARE * (gain - usual)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn covariance(position: f64, heading: f64) -> Matrix3<f64> {
        Matrix3::from_diagonal(&Vector3::new(position, position, heading).map(|sigma| sigma * sigma))
    }

    /// By hand: 4/3 π 2³ · 0.3 · 0.3 · 0.5 m² rad against 0.3³/5, 279 starts.
    #[test]
    fn the_number_of_starts_follows_the_doubt() {
        let starts_of = |position, heading| starts(24, &covariance(position, heading), 0.15);
        assert_eq!((starts_of(0.05, 0.05), starts_of(0.3, 0.5), starts_of(3.0, 3.0)), (24, 279, MOST));
        // A start more or less at most, by rounding.
        assert!(starts_of(0.6, 0.5).abs_diff(4 * 279) <= 4, "{}", starts_of(0.6, 0.5));
        assert_eq!(starts(5000, &covariance(3.0, 3.0), 0.15), 5000, "as many as were asked for");
        assert_eq!(starts(24, &Matrix3::from_element(f64::NAN), 0.15), 24);
    }

    #[test]
    fn a_scan_that_fits_worse_than_usual_is_matched_again() {
        let mut fit = UsualFit::default();
        assert!(!fit.is_poor(0.1), "the first scan");
        (0..100).for_each(|_| fit.add(6.0));
        assert!(!fit.is_poor(5.5) && fit.is_poor(5.3));
        assert_eq!([24, 1000, 5000].map(more), [384, MOST, 5000]);
        (0..100).for_each(|_| fit.add(3.0));
        assert!(!fit.is_poor(2.9), "another building");
    }
}
