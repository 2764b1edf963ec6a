//! Online mapping with a fixed-lag smoother: a sliding window of keyframes is optimised, and older poses are final.
//!
//! The forward pass is online anyway. Whenever half a window is new, E and M steps go over the window. Everything older is
//! summarised by the filter of the most likely hypothesis at the start of the window: a joint Gaussian of pose, calibration and
//! landmarks. Older poses are thus marginalised, not fixed: when the robot returns to old landmarks, the poses of the window and
//! the landmarks still move within their uncertainty. A step takes bounded time, and a pose is final half a window to one window
//! after it was recorded.
//!
//! At the end, one more E step weighs all detections by the path and the map that were found.

use super::beam::Beam;
use super::estimate::Estimate;
use super::history::{History, Sweep};
use super::keyframes::Keyframe;
use super::world::World;
use super::{MIN_LANDMARK_WEIGHT, Mapping, Run, SemanticError};

/// Goes through all keyframes once.
pub fn run<W: World>(mapping: &Mapping<'_, W>, mut beam: Beam<'_, W>) -> Result<Run<W>, SemanticError> {
    let half = (mapping.config.window / 2).max(1);
    let all = mapping.keyframes;
    let mut path: Vec<(W::Pose, W::PoseCovariance)> = Vec::with_capacity(all.len());
    let mut last: Option<Estimate<W>> = None;
    for first in (0..all.len()).step_by(half) {
        let end = (first + half).min(all.len());
        for keyframe in &all[first..end] {
            beam.advance(keyframe);
            mapping.progress.advance();
        }
        beam.keep_states();
        // The last keyframe before the window: its detections are in its state already.
        let boundary = first.checked_sub(half + 1);
        let mut window: Vec<Keyframe<W>> = all[boundary.unwrap_or(0)..end].to_vec();
        let before = boundary.and_then(|_| beam.state(window.len() - 1));
        if before.is_some() {
            window[0].seen.clear();
        }
        let found = estimate(&Mapping { keyframes: &window, before, ..*mapping }, &beam)?;
        let own = usize::from(before.is_some());
        path.truncate(end + own - window.len());
        path.extend(found.0.poses.iter().copied().zip(found.1).skip(own));
        last = Some(found.0);
    }
    let mut estimate = last.ok_or(SemanticError::NothingSeen)?;
    let (poses, covariances): (Vec<_>, Vec<_>) = path.into_iter().unzip();
    estimate.poses = poses;
    mapping.expect(&mut estimate, 1.0);
    let light: Vec<bool> = estimate.landmarks.iter().map(|landmark| landmark.weight < MIN_LANDMARK_WEIGHT).collect();
    estimate.retain_landmarks(|place| !light[place]);
    let objective = mapping.objective(&estimate);
    let sweeps = vec![Sweep::new(&estimate, objective)];
    Ok(Run { estimate, objective, history: History { candidates: beam.candidates, sweeps }, covariances })
}

/// E and M steps over a window, and the covariances of its poses.
fn estimate<W: World>(
    window: &Mapping<'_, W>,
    beam: &Beam<'_, W>,
) -> Result<(Estimate<W>, Vec<W::PoseCovariance>), SemanticError> {
    let mut pass = beam.pass(window.keyframes);
    if let (Some(before), Some(seen)) = (window.before, pass.assignments.first_mut()) {
        seen.clear();
        for known in &before.landmarks {
            pass.landmarks.entry(known.id).or_insert(known.position);
        }
    }
    let mut estimate = window.sweeps(pass, |_| ())?;
    let covariances = window.covariances(&mut estimate)?;
    Ok((estimate, covariances))
}
