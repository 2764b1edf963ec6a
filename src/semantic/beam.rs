//! The forward pass: a beam of hypotheses through all keyframes.
//!
//! After a while without a landmark, a robot does not know which of several alike it sees. The pass then goes on with all of
//! them, and what is seen later decides.

use super::hypothesis::{Branch, Hypothesis};
use super::keyframes::Keyframe;
use super::sensor_model::SensorModel;
use crate::detections::Detection;
use crate::geometry::Pose;

/// Two hypotheses whose robots are closer than this, in position \[m\] and heading \[rad\], differ in labels and not in
/// places: the likelier is kept.
const NEIGHBOURHOOD: (f64, f64) = (0.1, 0.05);
/// A hypothesis is dropped that is less likely than the best by this \[nats\].
const MARGIN: f64 = 40.0;

/// What the best hypothesis says.
#[derive(Clone, Debug)]
pub struct Pass {
    /// Pose of each keyframe, as it was estimated then.
    pub poses: Vec<Pose>,
    /// For each keyframe, the number of the landmark of each detection.
    pub assignments: Vec<Vec<usize>>,
    /// Its filter at the end.
    pub last: Hypothesis,
}

/// A keyframe in the past of a hypothesis.
struct Past {
    before: Option<usize>,
    pose: Pose,
    ids: Vec<usize>,
}

/// Runs the pass; `log_new` is the log-density of landmarks that are new.
pub fn forward(model: &SensorModel<'_>, keyframes: &[Keyframe], log_new: f64, beam: usize, branches: usize) -> Pass {
    let mut past: Vec<Past> = Vec::new();
    let mut hypotheses = vec![Hypothesis::start()];
    for keyframe in keyframes {
        hypotheses.iter_mut().for_each(|hypothesis| hypothesis.predict(model, keyframe));
        let seen: Vec<Detection> = keyframe.seen.iter().map(|(_, seen)| *seen).collect();
        if !seen.is_empty() {
            let ways = |parent: &Hypothesis| parent.branches(model, &seen, log_new, branches);
            let all = hypotheses.iter().map(ways).enumerate();
            let all = all.flat_map(|(parent, ways)| ways.into_iter().map(move |way| (parent, way))).collect();
            let kept = select(all, beam);
            // Where nothing fits at all, the frame is left out.
            if !kept.is_empty() {
                hypotheses = kept
                    .into_iter()
                    .map(|(parent, way)| {
                        let mut child = hypotheses[parent].clone();
                        let ids = child.follow(model, &seen, &way);
                        past.push(Past { before: child.past, pose: child.pose, ids });
                        child.past = Some(past.len() - 1);
                        child
                    })
                    .collect();
                continue;
            }
        }
        for hypothesis in &mut hypotheses {
            past.push(Past { before: hypothesis.past, pose: hypothesis.pose, ids: Vec::new() });
            hypothesis.past = Some(past.len() - 1);
        }
    }
    let last = hypotheses.into_iter().next().unwrap_or_else(Hypothesis::start);
    let (mut poses, mut assignments) = (Vec::new(), Vec::new());
    let mut next = last.past;
    while let Some(moment) = next.and_then(|place| past.get_mut(place)) {
        poses.push(moment.pose);
        assignments.push(std::mem::take(&mut moment.ids));
        next = moment.before;
    }
    poses.reverse();
    assignments.reverse();
    Pass { poses, assignments, last }
}

/// The likeliest branch of each neighbourhood, the likeliest first, and at most `count`.
fn select(mut all: Vec<(usize, Branch)>, count: usize) -> Vec<(usize, Branch)> {
    all.sort_by(|(_, a), (_, b)| b.log_likelihood.total_cmp(&a.log_likelihood));
    let mut kept: Vec<(usize, Branch)> = Vec::new();
    for (parent, way) in all {
        let is_near = |(_, other): &(usize, Branch)| {
            let off = way.pose.seen_from(other.pose);
            off.position().coords.norm() < NEIGHBOURHOOD.0 && off.heading.abs() < NEIGHBOURHOOD.1
        };
        let is_likely = kept.first().is_none_or(|(_, best)| way.log_likelihood >= best.log_likelihood - MARGIN);
        if kept.len() == count || !is_likely {
            break;
        }
        if !kept.iter().any(is_near) {
            kept.push((parent, way));
        }
    }
    kept
}
