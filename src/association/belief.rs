//! The marginals of a large block, approximately, by loopy belief propagation (J. Williams, R. Lau, "Approximate
//! evaluation of marginal association probabilities with belief propagation", IEEE TAES 50, 2014).
//!
//! Messages μ go from detections to landmarks, and messages ν from landmarks to detections:
//!
//! μ_kj = L_kj / (u_k + Σ_{i≠j} L_ki ν_ki), ν_kj = 1 / (m_j + Σ_{i≠k} μ_ij), until ν stays what it is.
//! Then w_kj = L_kj ν_kj / (u_k + Σ_i L_ki ν_ki), and the sum over all assignments is about
//!
//! Π_k (u_k + Σ_j L_kj ν_kj) Π_j (m_j + Σ_k μ_kj) / Π_kj (1 + μ_kj ν_kj),
//!
//! which is exact where pairs make no loop. The product is that of Bethe's free energy, and never too large.

use crate::association::block::{Marginals, Scaled};
use nalgebra::DMatrix;

/// Rounds at most. They end once no message changes by more than [`TOLERANCE`] of its value.
const ROUNDS: usize = 500;
const TOLERANCE: f64 = 1e-10;
/// Messages end here: two of them can be multiplied. A message is as large where an option is as good as forced.
const LARGEST: f64 = 1e150;

/// Weights and log-likelihood of a block that is scaled by its most likely assignment.
pub(super) fn marginals(block: &Scaled) -> Marginals {
    let Scaled { pairs, nulls, missed, log_scale } = block;
    let (rows, columns) = pairs.shape();
    let mut wanted = DMatrix::zeros(rows, columns);
    let mut free = DMatrix::from_element(rows, columns, 1.0);
    for _ in 0..ROUNDS {
        for row in 0..rows {
            let offers: Vec<f64> = pairs.row(row).component_mul(&free.row(row)).iter().copied().collect();
            for (column, rest) in sums_without_each(nulls[row], &offers).into_iter().enumerate() {
                wanted[(row, column)] = message(pairs[(row, column)], rest);
            }
        }
        let mut change = 0.0_f64;
        for column in 0..columns {
            let demands: Vec<f64> = wanted.column(column).iter().copied().collect();
            for (row, rest) in sums_without_each(missed[column], &demands).into_iter().enumerate() {
                let before = std::mem::replace(&mut free[(row, column)], message(1.0, rest));
                change = change.max((free[(row, column)] / before - 1.0).abs());
            }
        }
        if change <= TOLERANCE {
            break;
        }
    }

    let mut weights = pairs.component_mul(&free);
    let row_sums: Vec<f64> = weights.row_iter().zip(nulls).map(|(row, null)| null + row.sum()).collect();
    weights.row_iter_mut().zip(&row_sums).for_each(|(mut row, sum)| row /= *sum);
    let column_sums = wanted.column_iter().zip(missed).map(|(column, missed)| missed + column.sum());
    let log_product = row_sums.iter().copied().chain(column_sums).map(f64::ln).sum::<f64>();
    let counted_twice = wanted.component_mul(&free).iter().map(|both| both.ln_1p()).sum::<f64>();
    Marginals {
        nulls: nulls.iter().zip(&row_sums).map(|(null, sum)| null / sum).collect(),
        pairs: weights,
        log_sum: log_product - counted_twice + log_scale,
    }
}

fn message(numerator: f64, denominator: f64) -> f64 {
    if numerator > 0.0 { (numerator / denominator).min(LARGEST) } else { 0.0 }
}

/// Of each value, `base` and the sum of all other values. Nothing is subtracted, so small rests keep their digits.
fn sums_without_each(base: f64, values: &[f64]) -> Vec<f64> {
    let (mut rests, mut earlier, mut later) = (Vec::with_capacity(values.len()), base, 0.0);
    for value in values {
        rests.push(earlier);
        earlier += value;
    }
    for (rest, value) in rests.iter_mut().zip(values).rev() {
        *rest += later;
        later += value;
    }
    rests
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::association::Table;
    use crate::association::block::Block;
    use crate::association::{exact, optimal};
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    const SEED: u64 = 7;

    /// Largest and mean error of a weight, and largest error of a log-likelihood, over 300 dense random blocks of 2 to
    /// 8 detections and 2 to 12 landmarks, with terms spread over `range` nats.
    fn errors(range: f64) -> [f64; 3] {
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let (mut largest, mut sum, mut count, mut largest_log) = (0.0_f64, 0.0, 0.0, 0.0_f64);
        for _ in 0..300 {
            let (detections, landmarks) = (random.random_range(2..=8), random.random_range(2..=12));
            let nulls = (0..detections).map(|_| range * (random.random::<f64>() - 1.0)).collect();
            let table = Table::new(nulls, landmarks, |_, _| range * random.random::<f64>());
            let block = Block::whole(&table);
            let exact = exact::marginals(&block.scaled_by_rows().unwrap()).unwrap();
            let found = marginals(&optimal::scaled(&block).unwrap());
            for (a, b) in found.pairs.iter().chain(&found.nulls).zip(exact.pairs.iter().chain(&exact.nulls)) {
                (largest, sum, count) = (largest.max((a - b).abs()), sum + (a - b).abs(), count + 1.0);
            }
            largest_log = largest_log.max((found.log_sum - exact.log_sum).abs());
        }
        [largest, sum / count, largest_log]
    }

    /// Largest errors are those where two detections fit two landmarks in both ways about equally well, and nothing
    /// else is likely: the approximation of such a pair of assignments is the better one alone (2 x 2: Bethe's permanent
    /// is the larger product).
    #[test]
    fn errors_are_as_documented() {
        for (range, limits) in [(1.0, [0.06, 0.003, 0.3]), (3.0, [0.16, 0.005, 0.8]), (10.0, [0.45, 0.01, 1.3])] {
            let errors = errors(range);
            let kept = errors.iter().zip(limits).all(|(&error, limit)| error < limit);
            assert!(kept, "range {range}, seed {SEED}: {errors:?} exceed {limits:?}");
            // It is an approximation: else this test compares a thing with itself.
            assert!(errors[0] > 0.01, "range {range}, seed {SEED}: {errors:?}");
        }
    }
}
