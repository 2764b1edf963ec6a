//! Data association against an enumeration of all assignments, written out here a second time.

use crate::uniforms;
use ipslam::association::{Assignment, Policy, Table, Weights, associate, best_assignments, class_log_likelihood};
use nalgebra::{DMatrix, dmatrix};
use std::collections::HashSet;

const SEED: u64 = 20_170_529;
const NONE: f64 = f64::NEG_INFINITY;

/// Relative, of weights, and of log-likelihoods above 1. Rounding makes less than 1e-14 of it.
const TOLERANCE: f64 = 1e-12;
/// Weights below this may have underflowed.
const LEAST_WEIGHT: f64 = 1e-90;

/// How the terms of a table are drawn.
#[derive(Clone, Copy, Debug)]
enum Kind {
    /// A few nats apart.
    Moderate,
    /// Likewise, and half of the pairs are gated out.
    Gated,
    /// Thousands of nats apart.
    Extreme,
    /// All detections are at the first landmark, and hundreds of nats from all else.
    Contested,
    /// A third of the terms is not possible, those of no landmark included.
    Closed,
}

const KINDS: [Kind; 5] = [Kind::Moderate, Kind::Gated, Kind::Extreme, Kind::Contested, Kind::Closed];

/// A random table. Terms are multiples of 2⁻¹⁰, so that sums of them are exact and only what follows is compared.
fn table(kind: Kind, detections: usize, landmarks: usize, seed: u64) -> Table {
    let mut numbers = uniforms(seed);
    let mut uniform = || numbers.next().unwrap();
    let mut draw = |range: f64, gated: f64| {
        let possible = uniform() >= gated;
        let value = (range * (uniform() - 0.5) * 1024.0).round() / 1024.0;
        if possible { value } else { NONE }
    };
    let (range, gated, gated_null) = match kind {
        Kind::Moderate => (8.0, 0.0, 0.0),
        Kind::Gated => (8.0, 0.5, 0.0),
        Kind::Extreme => (3000.0, 0.1, 0.0),
        Kind::Contested => (100.0, 0.0, 0.0),
        Kind::Closed => (20.0, 0.3, 0.3),
    };
    let nulls = (0..detections).map(|_| draw(range, gated_null)).collect();
    let first = if matches!(kind, Kind::Contested) { 900.0 } else { 0.0 };
    Table::new(nulls, landmarks, |_, landmark| draw(range, gated) + if landmark == 0 { first } else { 0.0 })
}

/// All assignments that are possible, the likeliest first, then in lexicographic order.
fn enumerate(table: &Table) -> Vec<Assignment> {
    fn extend(table: &Table, taken: &mut Vec<Option<usize>>, log: f64, found: &mut Vec<Assignment>) {
        if log == NONE {
            return;
        }
        let detection = taken.len();
        if detection == table.nulls().len() {
            found.push(Assignment { landmarks: taken.clone(), log_likelihood: log + table.constant() });
            return;
        }
        for option in std::iter::once(None).chain((0..table.pairs().ncols()).map(Some)) {
            if option.is_none() || !taken.contains(&option) {
                let term = option.map_or(table.nulls()[detection], |landmark| table.pairs()[(detection, landmark)]);
                taken.push(option);
                extend(table, taken, log + term, found);
                taken.pop();
            }
        }
    }
    let mut found = Vec::new();
    extend(table, &mut Vec::new(), 0.0, &mut found);
    found.sort_by(|a, b| b.log_likelihood.total_cmp(&a.log_likelihood).then_with(|| a.landmarks.cmp(&b.landmarks)));
    found
}

/// Weights by their definition. Without any assignment, all null weights are 1.
fn brute_force(table: &Table) -> Weights {
    let assignments = enumerate(table);
    let (detections, landmarks) = table.pairs().shape();
    let (mut pairs, mut nulls) = (DMatrix::zeros(detections, landmarks), vec![0.0; detections]);
    let Some(largest) = assignments.first().map(|best| best.log_likelihood) else {
        return Weights { pairs, nulls: vec![1.0; detections], log_likelihood: NONE };
    };
    let mut total = 0.0;
    // The smallest first, for the least rounding.
    for Assignment { landmarks, log_likelihood } in assignments.iter().rev() {
        let weight = (log_likelihood - largest).exp();
        total += weight;
        for (detection, landmark) in landmarks.iter().enumerate() {
            *landmark.map_or(&mut nulls[detection], |landmark| &mut pairs[(detection, landmark)]) += weight;
        }
    }
    nulls.iter_mut().for_each(|null| *null /= total);
    Weights { pairs: pairs / total, nulls, log_likelihood: largest + total.ln() }
}

/// What differs between two results by more than the tolerances, if anything.
fn difference(found: &Weights, expected: &Weights) -> Option<String> {
    assert_eq!(found.pairs.shape(), expected.pairs.shape());
    assert_eq!(found.nulls.len(), expected.nulls.len());
    let numbers = |weights: &Weights| -> Vec<f64> { weights.pairs.iter().chain(&weights.nulls).copied().collect() };
    let agree = |a: f64, b: f64, tolerance: f64| a == b || (a - b).abs() <= tolerance;
    for (i, (a, b)) in numbers(found).into_iter().zip(numbers(expected)).enumerate() {
        let tolerance = TOLERANCE * b + LEAST_WEIGHT;
        if !agree(a, b, tolerance) {
            return Some(format!("weight {i}: {a:e} is not {b:e}, within {tolerance:e}"));
        }
    }
    let (a, b) = (found.log_likelihood, expected.log_likelihood);
    let tolerance = TOLERANCE * b.abs().max(1.0);
    (!agree(a, b, tolerance)).then(|| format!("log-likelihood: {a} is not {b}, within {tolerance:e}"))
}

fn assert_equal(found: &Weights, expected: &Weights, what: &str) {
    if let Some(difference) = difference(found, expected) {
        panic!("{what}: {difference}");
    }
}

/// Of every detection, the weights sum to one.
fn assert_normalised(weights: &Weights, what: &str) {
    for (detection, null) in weights.nulls.iter().enumerate() {
        let sum = weights.pairs.row(detection).sum() + null;
        assert!((sum - 1.0).abs() < TOLERANCE, "{what}, detection {detection}: weights sum to {sum}");
    }
}

/// Small tables of every kind, shape and several seeds.
fn small_tables() -> impl Iterator<Item = (String, Table)> {
    let shapes = (0..=6).flat_map(|detections| (0..=6).map(move |landmarks| (detections, landmarks)));
    shapes.flat_map(|(detections, landmarks)| {
        KINDS.into_iter().flat_map(move |kind| {
            (0..3).map(move |repetition| {
                let seed = SEED + repetition;
                let what = format!("{kind:?}, {detections} x {landmarks}, seed {seed}");
                let table = table(kind, detections, landmarks, seed);
                (what, table.with_missed(|landmark| (landmark % 2 == 0).then_some(0.5)))
            })
        })
    })
}

#[test]
fn soft_weights_are_those_of_all_assignments() {
    let mut impossible = 0;
    for (what, table) in small_tables() {
        let expected = brute_force(&table);
        let found = associate(&table, Policy::Soft);
        assert_normalised(&found, &what);
        assert_eq!(associate(&table, Policy::MaxMixture), found, "{what}");
        if expected.log_likelihood == NONE {
            // What other blocks of the frame are like is still told.
            assert_eq!(found.log_likelihood, NONE, "{what}");
            impossible += 1;
        } else {
            assert_equal(&found, &expected, &what);
        }
    }
    assert!((10..200).contains(&impossible), "{impossible} tables without any assignment");
}

/// What the other tests compare with can tell results apart.
#[test]
fn a_weight_that_is_off_is_found() {
    let expected = brute_force(&table(Kind::Moderate, 4, 5, SEED));
    let perturbed = |change: &dyn Fn(&mut Weights)| {
        let mut weights = expected.clone();
        change(&mut weights);
        difference(&weights, &expected)
    };
    assert_eq!(perturbed(&|_| ()), None);
    assert!(perturbed(&|weights| weights.pairs[(2, 3)] *= 1.0 + 1e-11).is_some());
    assert!(perturbed(&|weights| weights.nulls[1] *= 1.0 - 1e-11).is_some());
    assert!(perturbed(&|weights| weights.log_likelihood += 1e-10).is_some());
    assert!(perturbed(&|weights| weights.pairs[(0, 0)] = f64::NAN).is_some());
    assert!(perturbed(&|weights| weights.log_likelihood = NONE).is_some());
}

/// More detections than the exact sum has room for, but few landmarks: sets are then those of landmarks.
#[test]
fn many_detections_of_few_landmarks_are_exact() {
    for kind in KINDS {
        let table = table(kind, 15, 3, SEED);
        let what = format!("{kind:?}, seed {SEED}");
        assert_equal(&associate(&table, Policy::Soft), &brute_force(&table), &what);
    }
}

/// Two frames that share no landmark, in one table: weights are those of each, log-likelihoods add up.
#[test]
fn blocks_are_independent() {
    let (a, b) = (table(Kind::Moderate, 4, 3, SEED), table(Kind::Extreme, 3, 5, SEED));
    // Detections and landmarks of the two take turns, as far as they go.
    let detections = [(0, 0), (1, 0), (0, 1), (1, 1), (0, 2), (1, 2), (0, 3)];
    let landmarks = [(1, 0), (0, 0), (1, 1), (0, 1), (1, 2), (0, 2), (1, 3), (1, 4)];
    let nulls = detections.iter().map(|&(frame, k)| [&a, &b][frame].nulls()[k]).collect();
    let both = Table::new(nulls, landmarks.len(), |detection, landmark| {
        let ((frame, k), (other, j)) = (detections[detection], landmarks[landmark]);
        if frame == other { [&a, &b][frame].pairs()[(k, j)] } else { NONE }
    });
    for policy in [Policy::Soft, Policy::Max, Policy::Hungarian] {
        let parts = [associate(&a, policy), associate(&b, policy)];
        let expected = Weights {
            pairs: DMatrix::from_fn(detections.len(), landmarks.len(), |detection, landmark| {
                let ((frame, k), (other, j)) = (detections[detection], landmarks[landmark]);
                if frame == other { parts[frame].pairs[(k, j)] } else { 0.0 }
            }),
            nulls: detections.iter().map(|&(frame, k)| parts[frame].nulls[k]).collect(),
            log_likelihood: parts[0].log_likelihood + parts[1].log_likelihood,
        };
        assert_equal(&associate(&both, policy), &expected, &format!("{policy:?}, seed {SEED}"));
    }
}

/// A chain has no loop, and belief propagation is exact there. Twelve detections on thirteen landmarks are too many for
/// the exact sum.
#[test]
fn belief_propagation_is_exact_on_a_chain() {
    for kind in [Kind::Moderate, Kind::Extreme, Kind::Contested] {
        let dense = table(kind, 12, 13, SEED);
        let chain = Table::new(dense.nulls().to_vec(), 13, |detection, landmark| {
            if (detection..detection + 2).contains(&landmark) { dense.pairs()[(detection, landmark)] } else { NONE }
        });
        let (found, expected) = (associate(&chain, Policy::Soft), brute_force(&chain));
        let error = (&found.pairs - &expected.pairs).amax();
        assert!(error < 1e-8, "{kind:?}, seed {SEED}: weights are off by {error:e}");
        let error = (found.log_likelihood - expected.log_likelihood).abs();
        assert!(error < 1e-8, "{kind:?}, seed {SEED}: log-likelihood is off by {error:e}");
        assert_normalised(&found, &format!("{kind:?}, seed {SEED}"));
    }
}

#[test]
fn large_blocks_of_any_range_have_weights() {
    for kind in KINDS {
        for (detections, landmarks) in [(12, 40), (40, 12), (20, 20)] {
            let what = format!("{kind:?}, {detections} x {landmarks}, seed {SEED}");
            let weights = associate(&table(kind, detections, landmarks, SEED), Policy::Soft);
            assert_normalised(&weights, &what);
            let inside = weights.pairs.iter().chain(&weights.nulls).all(|weight| (0.0..=1.0).contains(weight));
            assert!(inside && weights.log_likelihood.is_finite(), "{what}");
        }
    }
}

#[test]
fn hungarian_takes_the_likeliest_assignment() {
    for (what, table) in small_tables() {
        let found = associate(&table, Policy::Hungarian);
        assert_normalised(&found, &what);
        for pairs in found.pairs.column_iter() {
            assert!(pairs.sum() <= 1.0, "{what}: a landmark with several detections");
        }
        let Some(best) = enumerate(&table).into_iter().next() else {
            assert_eq!(found.log_likelihood, NONE, "{what}");
            continue;
        };
        let landmark = |detection: usize| found.pairs.row(detection).iter().position(|&weight| weight == 1.0);
        let landmarks: Vec<_> = (0..found.nulls.len()).map(landmark).collect();
        let told = found.log_likelihood;
        assert!((told - best.log_likelihood).abs() < TOLERANCE, "{what}: {told}, not {best:?}");
        // No two of the random assignments are equally likely, but for those whose terms are few.
        if landmarks != best.landmarks {
            let taken = landmarks
                .iter()
                .enumerate()
                .map(|(k, landmark)| landmark.map_or(table.nulls()[k], |landmark| table.pairs()[(k, landmark)]));
            let taken = taken.sum::<f64>() + table.constant();
            assert_eq!(taken, best.log_likelihood, "{what}: {landmarks:?} is not as likely as {best:?}");
        }
    }
}

#[test]
fn max_takes_the_likeliest_option_of_each() {
    let table = Table::new(vec![-5.0, 0.0, -1.0], 2, |k, j| [[-1.0, -2.0], [-1.0, -0.5], [-1.0, NONE]][k][j]);
    let found = associate(&table, Policy::Max);
    let pairs = dmatrix![1.0, 0.0; 0.0, 0.0; 0.0, 0.0];
    assert_eq!(found, Weights { pairs, nulls: vec![0.0, 1.0, 1.0], log_likelihood: -2.0 });
    // The second one likewise at the first landmark.
    let shared = Table::new(vec![-5.0; 2], 1, |_, _| -1.0);
    assert_eq!(associate(&shared, Policy::Max).pairs, dmatrix![1.0; 1.0]);
}

#[test]
fn the_best_assignments_are_those_of_the_sorted_list() {
    for (what, table) in small_tables() {
        let expected = enumerate(&table);
        let every: HashSet<_> = expected.iter().map(|assignment| &assignment.landmarks).collect();
        for count in [0, 1, 6, 40] {
            let found = best_assignments(&table, count, f64::INFINITY);
            assert_eq!(found.len(), count.min(expected.len()), "{what}");
            for (number, (found, expected)) in found.iter().zip(&expected).enumerate() {
                assert_eq!(found.log_likelihood, expected.log_likelihood, "{what}: number {number} of {count}");
                assert!(every.contains(&found.landmarks), "{what}: number {number} of {count}: {found:?}");
            }
            let distinct = found.iter().enumerate().all(|(i, a)| found[..i].iter().all(|b| a.landmarks != b.landmarks));
            assert!(distinct, "{what}: one assignment twice");
        }
        let Some(best) = expected.first() else { continue };
        let likely = expected.iter().filter(|other| other.log_likelihood >= best.log_likelihood - 1.5).count();
        assert_eq!(best_assignments(&table, 40, 1.5).len(), likely.min(40), "{what}: within 1.5 nats");
    }
}

#[test]
fn ties_are_broken_the_same_way_every_time() {
    let table = Table::new(vec![0.0; 3], 3, |_, _| 0.0);
    // One more than there are: a list that does not end must not take all memory.
    let all = best_assignments(&table, 35, f64::INFINITY);
    assert_eq!(all, enumerate(&table));
    assert_eq!(all.len(), 34);
    assert_eq!(best_assignments(&table, 5, f64::INFINITY), best_assignments(&table, 5, f64::INFINITY));
}

/// The log-probabilities of all assignments sum to one.
#[test]
fn assignments_have_probabilities() {
    let table = table(Kind::Moderate, 4, 4, SEED).with_missed(|_| Some(0.8));
    let sum = associate(&table, Policy::Soft).log_likelihood;
    let count = enumerate(&table).len() + 1;
    let probabilities =
        best_assignments(&table, count, f64::INFINITY).into_iter().map(|best| (best.log_likelihood - sum).exp());
    let total: f64 = probabilities.sum();
    assert!((total - 1.0).abs() < TOLERANCE, "seed {SEED}: {total}");
}

/// Two landmarks of P_D 0.9 and one out of view, one detection: by hand.
#[test]
fn missed_landmarks_count() {
    let pairs = [0.5, 0.25, 2.0];
    let table = Table::new(vec![0.1f64.ln()], 3, |_, landmark| f64::ln(pairs[landmark]));
    let table = table.with_missed(|landmark| (landmark < 2).then_some(0.9));
    let terms = [0.9 * 0.1 * 0.5, 0.1 * 0.9 * 0.25, 0.1 * 0.1 * 2.0, 0.1 * 0.1 * 0.1];
    let sum: f64 = terms.iter().sum();
    let found = associate(&table, Policy::Soft);
    assert!((found.log_likelihood - sum.ln()).abs() < TOLERANCE, "{} is not {}", found.log_likelihood, sum.ln());
    for (found, term) in found.pairs.iter().chain(&found.nulls).zip(terms) {
        assert!((found - term / sum).abs() < TOLERANCE, "{found} is not {}", term / sum);
    }
    let certain = Table::new(vec![0.0], 2, |_, _| 0.0).with_missed(|landmark| Some([0.0, 1.0][landmark]));
    assert!(associate(&certain, Policy::Soft).pairs[(0, 1)] > 1.0 - 1e-8);
    let unknown = Table::new(vec![0.0], 1, |_, _| 0.0);
    assert_eq!(unknown.clone().with_missed(|_| Some(f64::NAN)), unknown);
}

#[test]
fn what_is_no_number_is_gated_out() {
    let wild = [[f64::NAN, 0.0], [f64::INFINITY, NONE]];
    let table = Table::new(vec![0.0, 0.0], 2, |k, j| wild[k][j]);
    assert_eq!(table.pairs(), &dmatrix![NONE, 0.0; NONE, NONE]);
    for policy in [Policy::Soft, Policy::Max, Policy::Hungarian, Policy::MaxMixture] {
        assert_normalised(&associate(&table, policy), &format!("{policy:?}"));
        let impossible = associate(&Table::new(vec![f64::NAN], 0, |_, _| 0.0), policy);
        assert_eq!((impossible.nulls, impossible.log_likelihood), (vec![1.0], NONE), "{policy:?}");
    }
    assert_eq!(best_assignments(&Table::new(vec![NONE], 0, |_, _| 0.0), 3, f64::INFINITY), []);
}

#[test]
fn nothing_seen_is_certain() {
    for landmarks in [0, 3] {
        let table = Table::new(Vec::new(), landmarks, |_, _| 0.0).with_missed(|_| Some(0.5));
        let constant = landmarks as f64 * 0.5f64.ln();
        for policy in [Policy::Soft, Policy::Max, Policy::Hungarian, Policy::MaxMixture] {
            let found = associate(&table, policy);
            assert_eq!((found.nulls.len(), found.pairs.shape()), (0, (0, landmarks)), "{policy:?}");
            assert!((found.log_likelihood - constant).abs() < TOLERANCE, "{policy:?}: {}", found.log_likelihood);
        }
        assert_eq!(best_assignments(&table, 2, f64::INFINITY).len(), 1);
    }
}

#[test]
fn classes_weigh_by_the_confusion_of_the_detector() {
    // Chairs are told apart from doors and windows, those less so.
    let confusion = dmatrix![0.9, 0.05, 0.05; 0.1, 0.6, 0.3; 0.0, 0.4, 0.6];
    for (detected, expected) in [(0, 0.2 * 0.9 + 0.5 * 0.1), (1, 0.2 * 0.05 + 0.5 * 0.6 + 0.3 * 0.4)] {
        let found = class_log_likelihood(&confusion, &[0.2, 0.5, 0.3], detected);
        assert!((found - f64::ln(expected)).abs() < TOLERANCE, "class {detected}: {found}");
    }
    assert_eq!(class_log_likelihood(&confusion, &[0.0, 0.0, 1.0], 0), NONE);
    assert_eq!(class_log_likelihood(&confusion, &[0.2, 0.5, 0.3], 3), NONE);
}
