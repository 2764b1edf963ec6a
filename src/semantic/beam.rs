//! The forward pass: a beam of hypotheses through all keyframes.
//!
//! After a while without a landmark, a robot does not know which of several alike it sees. The pass then goes on with all of
//! them, and what is seen later decides.

use super::history::Candidate;
use super::hypothesis::{Branch, Hypothesis};
use super::keyframes::Keyframe;
use super::progress::Progress;
use super::sensor_model::SensorModel;
use crate::detections::Detection;
use crate::geometry::Pose;
use nalgebra::{Point2, Vector3};
use std::collections::BTreeMap;

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
    /// Where each landmark is: as the filter knew it at the end, or where it was last seen if the filter forgot it.
    pub landmarks: BTreeMap<usize, Point2<f64>>,
    /// The odometry's calibration at the end.
    pub calibration: Vector3<f64>,
    /// All hypotheses of each keyframe; none where there is no choice.
    pub candidates: Vec<Vec<Candidate>>,
}

/// A keyframe in the past of a hypothesis.
struct Past {
    before: Option<usize>,
    pose: Pose,
    ids: Vec<usize>,
}

/// Runs the pass; `log_new` is the log-density of landmarks that are new.
pub fn forward(
    model: &SensorModel<'_>,
    keyframes: &[Keyframe],
    log_new: f64,
    beam: usize,
    branches: usize,
    progress: &Progress<'_>,
) -> Pass {
    let mut past: Vec<Past> = Vec::new();
    let mut hypotheses = vec![Hypothesis::start()];
    let mut candidates = Vec::with_capacity(keyframes.len());
    for keyframe in keyframes {
        progress.advance();
        hypotheses.iter_mut().for_each(|hypothesis| hypothesis.predict(model, keyframe));
        let seen: Vec<Detection> = keyframe.seen.iter().map(|(_, seen)| *seen).collect();
        let ways = |parent: &Hypothesis| parent.branches(model, &seen, log_new, branches);
        let mut kept = Vec::new();
        if !seen.is_empty() {
            let all = hypotheses.iter().map(ways).enumerate();
            let all = all.flat_map(|(parent, ways)| ways.into_iter().map(move |way| (parent, way))).collect();
            kept = select(all, beam);
        }
        // Where nothing fits at all, the frame is left out.
        let mut ids = vec![Vec::new(); hypotheses.len()];
        if !kept.is_empty() {
            hypotheses = children(hypotheses, &kept);
            let follow = |(child, (_, way)): (&mut Hypothesis, &(usize, Branch))| {
                child.log_likelihood = way.log_likelihood;
                child.follow(model, &seen, &way.landmarks)
            };
            ids = hypotheses.iter_mut().zip(&kept).map(follow).collect();
        }
        for (hypothesis, ids) in hypotheses.iter_mut().zip(ids) {
            past.push(Past { before: hypothesis.past, pose: hypothesis.pose, ids });
            hypothesis.past = Some(past.len() - 1);
        }
        let candidate = |&Hypothesis { pose, log_likelihood, .. }: &Hypothesis| Candidate { pose, log_likelihood };
        candidates.push(hypotheses.iter().map(candidate).collect());
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
    let tracked = last.landmarks.iter().map(|tracked| (tracked.id, tracked.position));
    let mut landmarks = last_seen(model, keyframes, &poses, &assignments);
    landmarks.extend(tracked);
    Pass { poses, assignments, landmarks, calibration: last.calibration, candidates }
}

/// The same where it is known which object each detection shows: one hypothesis, whose landmarks have the numbers of the
/// objects in the order in which they were first seen. `object` tells that of a detection by frame and number; keyframes
/// hold no detection without.
pub fn forward_known(
    model: &SensorModel<'_>,
    keyframes: &[Keyframe],
    object: impl Fn(usize, usize) -> Option<u64>,
) -> Pass {
    let mut hypothesis = Hypothesis::start();
    // Of each object its number, and the landmark that it is in the filter, which may forget it and map it anew.
    let mut objects: BTreeMap<u64, (usize, usize)> = BTreeMap::new();
    let (mut poses, mut assignments) = (Vec::new(), Vec::new());
    for keyframe in keyframes {
        hypothesis.predict(model, keyframe);
        let seen: Vec<Detection> = keyframe.seen.iter().map(|(_, seen)| *seen).collect();
        let shown = keyframe.seen.iter().filter_map(|(number, _)| object(keyframe.frame?, *number));
        let place = |object: u64| {
            let (_, id) = objects.get(&object)?;
            hypothesis.landmarks.iter().position(|landmark| landmark.id == *id)
        };
        let places: Vec<Option<usize>> = shown.clone().map(place).collect();
        let ids = hypothesis.follow(model, &seen, &places);
        let mut numbers = Vec::with_capacity(seen.len());
        for (object, id) in shown.zip(ids) {
            let next = objects.len();
            let known = objects.entry(object).or_insert((next, id));
            known.1 = id;
            numbers.push(known.0);
        }
        poses.push(hypothesis.pose);
        assignments.push(numbers);
    }
    let mut landmarks = last_seen(model, keyframes, &poses, &assignments);
    for (number, id) in objects.into_values() {
        let tracked = hypothesis.landmarks.iter().find(|tracked| tracked.id == id);
        landmarks.extend(tracked.map(|tracked| (number, tracked.position)));
    }
    Pass { poses, assignments, landmarks, calibration: hypothesis.calibration, candidates: Vec::new() }
}

/// Of each landmark the place where it was last seen.
fn last_seen(
    model: &SensorModel<'_>,
    keyframes: &[Keyframe],
    poses: &[Pose],
    assignments: &[Vec<usize>],
) -> BTreeMap<usize, Point2<f64>> {
    let frames = keyframes.iter().zip(poses).zip(assignments);
    let places = frames.flat_map(|((keyframe, pose), numbers)| {
        numbers.iter().zip(&keyframe.seen).map(|(number, (_, seen))| (*number, model.position(*pose, seen)))
    });
    places.collect()
}

/// The parent of each branch. The last branch of a parent takes it, and the others have copies, which are large.
fn children(parents: Vec<Hypothesis>, branches: &[(usize, Branch)]) -> Vec<Hypothesis> {
    let mut parents: Vec<Option<Hypothesis>> = parents.into_iter().map(Some).collect();
    let is_last = |at: usize| branches[at + 1..].iter().all(|(parent, _)| *parent != branches[at].0);
    let take = |(at, (parent, _)): (usize, &(usize, Branch))| {
        if is_last(at) { parents[*parent].take() } else { parents[*parent].clone() }
    };
    branches.iter().enumerate().filter_map(take).collect()
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
