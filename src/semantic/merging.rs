//! Landmarks that are mapped twice become one.
//!
//! After a while without a landmark, the forward pass may have mapped an object a second time, beside the first. Two landmarks
//! of one class whose positions agree within their joint covariance are merged. If the objective falls, the merge is undone.
//! Landmarks of clutter are dropped in the same way.

use super::estimate::Estimate;
use super::{Mapping, SemanticError};
use nalgebra::{Matrix2, Vector2};

/// 99.9 % of χ² with two degrees of freedom.
const GATE: f64 = 13.8;
/// Largest distance of two landmarks that are merged \[m\]: without the bound, all landmarks of a loop that is not closed yet
/// would agree, as they are uncertain by metres.
const FARTHEST: f64 = 1.5;

/// Two landmarks that may be one, and how far they are apart.
type Twins = (usize, usize, f64);

/// Landmarks of one class that may be the same, where their places are uncertain by another `sigma` \[m\]: the closest first,
/// each landmark in one pair at most.
fn twins(mapping: &Mapping<'_>, estimate: &Estimate, sigma: f64) -> Result<Vec<Twins>, SemanticError> {
    let problem = mapping.problem(estimate, 1.0)?;
    let covariances = problem.covariances()?;
    let landmarks = &estimate.landmarks;
    let mut all: Vec<Twins> = Vec::new();
    for (a, one) in landmarks.iter().enumerate() {
        for (b, other) in landmarks.iter().enumerate().skip(a + 1) {
            let apart = one.position - other.position;
            if one.class() != other.class() || apart.norm() > FARTHEST {
                continue;
            }
            let joint = covariances.joint(&[problem.landmarks()[a], problem.landmarks()[b]])?;
            let block = |row, column| -> Matrix2<f64> { joint.fixed_view::<2, 2>(row, column).into_owned() };
            let difference = block(0, 0) + block(2, 2) - block(0, 2) - block(2, 0);
            let squared = squared_distance(apart, difference + Matrix2::identity() * (sigma * sigma));
            if squared < GATE {
                all.push((a, b, squared));
            }
        }
    }
    all.sort_by(|(.., a), (.., b)| a.total_cmp(b));
    let mut taken = vec![false; landmarks.len()];
    all.retain(|&(a, b, _)| !std::mem::replace(&mut taken[a], true) & !std::mem::replace(&mut taken[b], true));
    Ok(all)
}

fn squared_distance(apart: Vector2<f64>, covariance: Matrix2<f64>) -> f64 {
    covariance.try_inverse().map_or(f64::INFINITY, |inverse| (inverse * apart).dot(&apart))
}

/// The estimate with these landmarks merged: the heavier one takes over the pairs of the lighter one.
fn merged(estimate: &Estimate, twins: &[Twins]) -> Estimate {
    let mut merged = estimate.clone();
    let mut into: Vec<usize> = (0..estimate.landmarks.len()).collect();
    for &(a, b, _) in twins {
        let (kept, gone) = if estimate.landmarks[a].weight >= estimate.landmarks[b].weight { (a, b) } else { (b, a) };
        into[gone] = kept;
    }
    for pair in merged.weights.iter_mut().flatten() {
        pair.landmark = into[pair.landmark];
    }
    merged.retain_landmarks(|place| into[place] == place);
    merged
}

/// Merges landmarks, and drops them, as long as the objective rises.
pub fn merge(mapping: &Mapping<'_>, mut best: Estimate, mut objective: f64) -> Result<(Estimate, f64), SemanticError> {
    while merge_all(mapping, &mut best, &mut objective)? {}
    while merge_neighbours(mapping, &mut best, &mut objective)? {}
    while drop_lightest(mapping, &mut best, &mut objective)? {}
    Ok((best, objective))
}

/// Merges all landmarks that may be one by what the graph knows, or the closest half of them, or the closest half of those.
fn merge_all(mapping: &Mapping<'_>, best: &mut Estimate, objective: &mut f64) -> Result<bool, SemanticError> {
    let mut twins = twins(mapping, best, 0.0)?;
    while !twins.is_empty() {
        let mut trial = merged(best, &twins);
        // The first M step keeps the merged pairs as they are: it pulls both halves of the map together.
        mapping.maximise(&mut trial, 1.0)?;
        mapping.sweep(&mut trial, 1.0)?;
        if try_out(mapping, trial, best, objective)? {
            return Ok(true);
        }
        twins.truncate(twins.len() / 2);
    }
    Ok(false)
}

/// Merges two landmarks that are no farther apart than the error of one detection: errors of detections from one place are
/// correlated, so the covariance of the graph is too small. One pair at a time, as distinct objects may be as close.
fn merge_neighbours(mapping: &Mapping<'_>, best: &mut Estimate, objective: &mut f64) -> Result<bool, SemanticError> {
    let noise = mapping.model.sensors.noise;
    for pair in twins(mapping, best, noise.range.hypot(noise.position))? {
        let trial = merged(best, &[pair]);
        if try_out(mapping, trial, best, objective)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Drops the lightest landmark: its detections may be clutter.
fn drop_lightest(mapping: &Mapping<'_>, best: &mut Estimate, objective: &mut f64) -> Result<bool, SemanticError> {
    let landmarks = best.landmarks.iter().enumerate();
    let Some((lightest, _)) = landmarks.min_by(|(_, a), (_, b)| a.weight.total_cmp(&b.weight)) else {
        return Ok(false);
    };
    let mut trial = best.clone();
    trial.retain_landmarks(|place| place != lightest);
    try_out(mapping, trial, best, objective)
}

/// Accepts a trial if its objective is higher after one more sweep.
fn try_out(
    mapping: &Mapping<'_>,
    mut trial: Estimate,
    best: &mut Estimate,
    objective: &mut f64,
) -> Result<bool, SemanticError> {
    mapping.sweep(&mut trial, 1.0)?;
    let found = mapping.objective(&trial);
    let is_better = found > *objective;
    if is_better {
        (*best, *objective) = (trial, found);
    }
    Ok(is_better)
}
