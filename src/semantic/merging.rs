//! Landmarks that are mapped twice become one.
//!
//! After a while without a landmark the forward pass may have mapped an object anew, beside its old self. Two landmarks of
//! one class whose places do not differ, by their joint covariance, are taken for one. The objective verifies it, and where
//! it falls, the merge is undone and half of the pairs are tried, those that are closest.

use super::estimate::Estimate;
use super::m_step::Problem;
use super::{Mapping, SemanticError};
use nalgebra::{Matrix2, Vector2};

/// 99.9 % of χ² with two degrees of freedom.
const GATE: f64 = 13.8;
/// No object is mapped this far from itself \[m\]: without the bound, landmarks of a loop that is not closed yet, which are
/// uncertain by metres, would all be alike.
const FARTHEST: f64 = 1.5;

/// Two landmarks that may be one, and how far they are apart.
type Twins = (usize, usize, f64);

/// Landmarks of one class that may be the same, the closest first; each landmark in one pair at most.
pub fn twins(problem: &Problem, estimate: &Estimate) -> Result<Vec<Twins>, SemanticError> {
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
            let squared = squared_distance(apart, difference);
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

/// The estimate with these landmarks in one: the lighter one's pairs are the heavier one's.
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

/// Merges as long as the objective rises.
pub fn merge(mapping: &Mapping<'_>, mut best: Estimate, mut objective: f64) -> Result<(Estimate, f64), SemanticError> {
    loop {
        let problem = mapping.problem(&best, 1.0)?;
        let mut twins = twins(&problem, &best)?;
        let mut rose = false;
        while !twins.is_empty() && !rose {
            let mut trial = merged(&best, &twins);
            // The first M step keeps the merged pairs as they are: it pulls both halves of the map together.
            mapping.maximise(&mut trial, 1.0)?;
            mapping.sweep(&mut trial, 1.0)?;
            mapping.sweep(&mut trial, 1.0)?;
            let found = mapping.objective(&trial);
            if found > objective {
                (best, objective, rose) = (trial, found, true);
            } else {
                twins.truncate(twins.len() / 2);
            }
        }
        if !rose {
            return Ok((best, objective));
        }
    }
}
