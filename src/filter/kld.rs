//! KLD sampling: how many particles a distribution takes (D. Fox, "Adapting the sample size in particle filters through
//! KLD-sampling", IJRR 2003).

use std::collections::HashSet;
use std::hash::Hash;

/// ε: the divergence from the true distribution that is allowed.
const ERROR: f64 = 0.05;
/// z(1-δ), the standard normal quantile of the probability that it is kept; 2.33 is 99 %.
const Z: f64 = 2.33;

/// A number of particles, and the bins that they fall in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleSize {
    /// Particles.
    pub particles: usize,
    /// Bins that they occupy.
    pub bins: usize,
}

/// Draws the bins of particles 0, 1, 2 .. until there are enough for the bins seen so far, between `min` and `max`.
pub fn sample_size<Bin: Eq + Hash>(min: usize, max: usize, bin_of: impl Fn(u32) -> Bin) -> SampleSize {
    let mut bins = HashSet::new();
    let (mut particles, mut enough) = (0, min);
    while particles < enough.min(max) {
        if bins.insert(bin_of(particles as u32)) {
            enough = bound(bins.len()).max(min);
        }
        particles += 1;
    }
    SampleSize { particles, bins: bins.len() }
}

/// The bound on the number of particles for k bins (eq. 7 there): (k-1)/2ε · (1 - 2/(9(k-1)) + √(2/(9(k-1))) z(1-δ))³.
fn bound(bins: usize) -> usize {
    let k = bins.saturating_sub(1) as f64;
    if k < 1.0 {
        return 0;
    }
    let a = 2.0 / (9.0 * k);
    let root = 1.0 - a + a.sqrt() * Z;
    (k / (2.0 * ERROR) * root * root * root).ceil() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eq. 5 there: χ² of k - 1 degrees of freedom over 2 ε, by the table of its 99 % quantiles; eq. 7 approximates it.
    #[test]
    fn the_bound_is_that_of_the_table() {
        for (bins, quantile) in [(2, 6.635), (6, 15.086), (11, 23.209), (101, 135.807)] {
            let (found, expected) = (bound(bins) as f64, quantile / 0.1);
            assert!((found - expected).abs() < 0.02 * expected + 1.0, "{bins} bins: {found} is not {expected}");
        }
        assert_eq!(bound(1), 0);
    }

    #[test]
    fn more_bins_take_more_particles() {
        let one = sample_size(20, 10_000, |_| 0);
        assert_eq!(one, SampleSize { particles: 20, bins: 1 });
        let hundred = sample_size(20, 10_000, |number| number % 101);
        assert_eq!(hundred, SampleSize { particles: bound(101), bins: 101 });
        assert_eq!(sample_size(20, 50, |number| number), SampleSize { particles: 50, bins: 50 });
    }
}
