//! The Anderson-Darling test against scipy, and its error rates against those that its critical values promise.

use crate::{normals, uniforms};
use ipslam::clustering::anderson_darling::{corrected_statistic, statistic};

/// `scipy.stats.anderson(x, 'norm').statistic`, scipy 1.17.1.
const PUBLISHED: [(&[f64], f64); 3] = [
    (&[-1.2, 0.3, 0.8, -0.4, 1.9, 0.1, -0.7, 0.5, -1.5, 1.1], 0.12035580696754344),
    (&[0.02, 0.05, 0.11, 0.19, 0.31, 0.47, 0.70, 1.02, 1.49, 2.2, 3.4, 5.9], 1.1283640341096675),
    // Far from zero, with ties.
    (
        &[
            1000.0, 1000.0, 1000.5, 1001.0, 1001.25, 1001.25, 1002.0, 1003.0, 1003.5, 1003.5, 1003.75, 1004.0, 1004.0,
            1004.25, 1004.5,
        ],
        0.6715718616188937,
    ),
];
/// Both sum a dozen logarithms in f64.
const TOLERANCE: f64 = 1e-10;

#[test]
fn is_that_of_scipy() {
    for (values, expected) in PUBLISHED {
        let mut reversed: Vec<f64> = values.iter().rev().copied().collect();
        let found = statistic(&mut reversed);
        assert!((found - expected).abs() < TOLERANCE, "{values:?}: {found}, not {expected}");
        let n = values.len() as f64;
        let corrected = corrected_statistic(&mut values.to_vec());
        assert!((corrected / expected - (1.0 + 0.75 / n + 2.25 / n / n)).abs() < TOLERANCE, "{values:?}: {corrected}");

        let mut perturbed = values.to_vec();
        perturbed[4] += 1e-3;
        let found = statistic(&mut perturbed);
        assert!((found - expected).abs() > TOLERANCE, "{perturbed:?} should not give {expected}");
    }
}

#[test]
fn has_nothing_to_say_of_few_or_equal_values() {
    for mut values in [vec![], vec![1.0], vec![1.0, 5.0], vec![3.0; 50]] {
        assert_eq!(corrected_statistic(&mut values), 0.0, "{values:?}");
    }
}

const SAMPLES: usize = 20_000;
const SAMPLE_SIZE: usize = 40;

fn share_rejected(mut numbers: impl Iterator<Item = f64>, size: usize, samples: usize, critical: f64) -> f64 {
    let mut sample = vec![0.0; size];
    let rejected = (0..samples).filter(|_| {
        sample.fill_with(|| numbers.next().unwrap());
        corrected_statistic(&mut sample) > critical
    });
    rejected.count() as f64 / samples as f64
}

/// D'Agostino & Stephens 1986, table 4.7: normal samples exceed a critical value as often as its level says.
#[test]
fn rejects_normal_samples_as_often_as_its_level_says() {
    const SEED: u64 = 31;
    for (critical, level) in [(1.035, 0.01), (0.752, 0.05), (0.631, 0.10)] {
        let share = share_rejected(normals(SEED), SAMPLE_SIZE, SAMPLES, critical);
        let tolerance = 4.0 * f64::sqrt(level * (1.0 - level) / SAMPLES as f64);
        println!("seed {SEED}: {share} above {critical}, {level} ± {tolerance} expected");
        assert!((share - level).abs() < tolerance, "seed {SEED}: {share} above {critical}, not {level} ± {tolerance}");
        // The critical value of another level would be noticed.
        assert!((share - 0.5 * level).abs() > tolerance && (share - 2.0 * level).abs() > tolerance);
    }
}

#[test]
fn rejects_uniform_samples() {
    const SEED: u64 = 32;
    assert_eq!(share_rejected(uniforms(SEED), 500, 100, 1.035), 1.0, "seed {SEED}");
}
