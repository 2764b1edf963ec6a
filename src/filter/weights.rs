//! Weights of particles, in f64: their sum is one, whatever the scale of their logarithms.

/// ln Σ exp, of weights that may all be tiny.
fn log_sum_exp(logs: &[f64]) -> f64 {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if largest == f64::NEG_INFINITY {
        return largest;
    }
    largest + logs.iter().map(|log| (log - largest).exp()).sum::<f64>().ln()
}

/// Weights that sum to one from log-weights of any scale. Where no particle is possible, or a weight is not a number,
/// all are equally likely: nothing is known, and the filter goes on.
pub fn normalised(log_weights: &[f64]) -> Vec<f64> {
    let sum = log_sum_exp(log_weights);
    if !sum.is_finite() {
        return vec![1.0 / log_weights.len() as f64; log_weights.len()];
    }
    log_weights.iter().map(|log| (log - sum).exp()).collect()
}

/// 1 / Σ w²: how many particles of equal weight would be worth as much. Weights sum to one.
pub fn effective_sample_size(weights: &[f64]) -> f64 {
    1.0 / weights.iter().map(|w| w * w).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_of_any_scale_are_normalised() {
        let weights = normalised(&[-100_000.0, -100_000.0 + 2f64.ln(), f64::NEG_INFINITY]);
        assert!((weights[0] - 1.0 / 3.0).abs() < 1e-9 && (weights[1] - 2.0 / 3.0).abs() < 1e-9 && weights[2] == 0.0);
        assert_eq!(normalised(&[f64::NEG_INFINITY; 4]), vec![0.25; 4]);
        assert_eq!(normalised(&[f64::NAN, 0.0]), vec![0.5; 2]);
    }

    #[test]
    fn effective_sample_size_counts_equal_weights() {
        assert!((effective_sample_size(&[0.25; 4]) - 4.0).abs() < 1e-12);
        assert!((effective_sample_size(&[1.0, 0.0, 0.0]) - 1.0).abs() < 1e-12);
    }
}
