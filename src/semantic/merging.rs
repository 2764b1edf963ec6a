//! Landmarks that are mapped twice become one.
//!
//! After a while without a landmark, the forward pass may have mapped an object a second time, beside the first. Two landmarks
//! of one class whose positions agree within their joint covariance are merged. If the objective falls, the merge is undone.
//! Landmarks of clutter are dropped in the same way.

use super::estimate::Estimate;
use super::linear::{GATES, LOSS_SCALE};
use super::world::World;
use super::{Mapping, SemanticError};
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeSet;

/// No object is mapped this far from itself \[m\], or three times what one detection errs: without the bound, landmarks of a loop
/// that is not closed yet, which are uncertain by metres, would all be alike.
const FARTHEST: f64 = 1.5;

/// Two landmarks that may be one, and how far they are apart.
type Twins = (usize, usize, f64);

/// Landmarks of one class that may be the same, where their places are uncertain by another `sigma` \[m\]: the closest first,
/// each landmark in one pair at most.
fn twins<W: World>(mapping: &Mapping<'_, W>, estimate: &Estimate<W>, sigma: f64) -> Result<Vec<Twins>, SemanticError> {
    let problem = mapping.problem(estimate, 1.0)?;
    let covariances = problem.covariances()?;
    let landmarks = &estimate.landmarks;
    let farthest = FARTHEST.max(LOSS_SCALE * mapping.model.error);
    let mut all: Vec<Twins> = Vec::new();
    for (a, one) in landmarks.iter().enumerate() {
        for (b, other) in landmarks.iter().enumerate().skip(a + 1) {
            let [one_at, other_at]: [W::Numbers; 2] = [one.position.into(), other.position.into()];
            let apart = DVector::from_column_slice(one_at.as_ref()) - DVector::from_column_slice(other_at.as_ref());
            if one.class() != other.class() || apart.norm() > farthest {
                continue;
            }
            let joint = covariances.joint(&[problem.landmarks()[a], problem.landmarks()[b]])?;
            let size = W::POINT;
            let block = |row, column| joint.view((row, column), (size, size));
            let difference = block(0, 0) + block(size, size) - block(0, size) - block(size, 0);
            let squared = squared_distance(&apart, difference + DMatrix::identity(size, size) * (sigma * sigma));
            if squared < GATES[size - 2] {
                all.push((a, b, squared));
            }
        }
    }
    all.sort_by(|(.., a), (.., b)| a.total_cmp(b));
    let mut taken = vec![false; landmarks.len()];
    all.retain(|&(a, b, _)| !std::mem::replace(&mut taken[a], true) & !std::mem::replace(&mut taken[b], true));
    Ok(all)
}

fn squared_distance(apart: &DVector<f64>, covariance: DMatrix<f64>) -> f64 {
    covariance.try_inverse().map_or(f64::INFINITY, |inverse| (inverse * apart).dot(apart))
}

/// The estimate with these landmarks in one: the lighter one's pairs are the heavier one's.
fn merged<W: World>(estimate: &Estimate<W>, twins: &[Twins]) -> Estimate<W> {
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
pub fn merge<W: World>(
    mapping: &Mapping<'_, W>,
    mut best: Estimate<W>,
    mut objective: f64,
) -> Result<(Estimate<W>, f64), SemanticError> {
    while merge_all(mapping, &mut best, &mut objective)? {}
    let mut tried = BTreeSet::new();
    while merge_neighbours(mapping, &mut best, &mut objective, &mut tried)? {}
    while drop_lightest(mapping, &mut best, &mut objective)? {}
    Ok((best, objective))
}

/// Merges all landmarks that may be one by what the graph knows, or the closest half of them, or the closest half of those.
fn merge_all<W: World>(
    mapping: &Mapping<'_, W>,
    best: &mut Estimate<W>,
    objective: &mut f64,
) -> Result<bool, SemanticError> {
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

/// Merges two landmarks that are no farther apart than one detection errs: errors of detections from one place are alike,
/// and twins are farther apart than the graph believes. One at a time, for other objects may stand as near.
fn merge_neighbours<W: World>(
    mapping: &Mapping<'_, W>,
    best: &mut Estimate<W>,
    objective: &mut f64,
    tried: &mut BTreeSet<(usize, usize)>,
) -> Result<bool, SemanticError> {
    for pair in twins(mapping, best, mapping.model.error)? {
        if !tried.insert((best.numbers[pair.0], best.numbers[pair.1])) {
            continue;
        }
        let trial = merged(best, &[pair]);
        if try_out(mapping, trial, best, objective)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Drops the lightest landmark: its detections may be clutter.
fn drop_lightest<W: World>(
    mapping: &Mapping<'_, W>,
    best: &mut Estimate<W>,
    objective: &mut f64,
) -> Result<bool, SemanticError> {
    let landmarks = best.landmarks.iter().enumerate();
    let Some((lightest, _)) = landmarks.min_by(|(_, a), (_, b)| a.weight.total_cmp(&b.weight)) else {
        return Ok(false);
    };
    let mut trial = best.clone();
    trial.retain_landmarks(|place| place != lightest);
    try_out(mapping, trial, best, objective)
}

/// Takes a trial, after one sweep more, if it is better.
fn try_out<W: World>(
    mapping: &Mapping<'_, W>,
    mut trial: Estimate<W>,
    best: &mut Estimate<W>,
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
