//! Which particles survive.

/// Systematic resampling: the parent indices of `count` survivors. Each index is drawn `count · weight` times on average,
/// and never more than one away from that. `weights` need not sum to one; without any, all indices are 0.
///
/// `offset` in (0, 1) is the only random number.
pub fn resample(weights: &[f64], count: usize, offset: f64) -> Vec<usize> {
    let total: f64 = weights.iter().sum();
    let mut drawn = Vec::with_capacity(count);
    let mut index = 0;
    let mut cumulative = weights.first().copied().unwrap_or(0.0);
    for tooth in 0..count {
        let target = (tooth as f64 + offset) / count as f64 * total;
        while cumulative < target && index + 1 < weights.len() {
            index += 1;
            cumulative += weights[index];
        }
        drawn.push(index);
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::weights::normalised;

    /// Over all offsets each particle is drawn count · weight times, and in each draw within one of it.
    #[test]
    fn resampling_is_unbiased() {
        let weights = normalised(&[0.1f64.ln(), 0.35f64.ln(), 0.05f64.ln(), 0.5f64.ln()]);
        let (count, offsets) = (7, 10_000);
        let mut drawn = [0usize; 4];
        for o in 0..offsets {
            let mut once = [0usize; 4];
            resample(&weights, count, (o as f64 + 0.5) / offsets as f64).into_iter().for_each(|i| once[i] += 1);
            for (i, &times) in once.iter().enumerate() {
                assert!((times as f64 - count as f64 * weights[i]).abs() < 1.0 + 1e-9);
                drawn[i] += times;
            }
        }
        for (i, &times) in drawn.iter().enumerate() {
            assert!((times as f64 / offsets as f64 - count as f64 * weights[i]).abs() < 1e-3, "particle {i}");
        }
    }
}
