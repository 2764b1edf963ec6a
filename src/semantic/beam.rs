//! The forward pass: a beam of hypotheses through all keyframes.
//!
//! After a while without a landmark, it is ambiguous which of several similar landmarks the robot sees. The pass then keeps all
//! hypotheses, and later detections decide.

use super::config::SemanticConfig;
use super::history::Candidate;
use super::hypothesis::{Branch, Hypothesis};
use super::keyframes::Keyframe;
use super::sensor_model::SensorModel;
use super::world::World;
use std::collections::BTreeMap;

/// Two hypotheses whose robots are closer than this, in position \[m\] and orientation \[rad\], differ in labels and not in
/// places: the likelier is kept.
const NEIGHBOURHOOD: (f64, f64) = (0.1, 0.05);
/// A hypothesis is dropped that is less likely than the best by this \[nats\].
const MARGIN: f64 = 40.0;

/// The best hypothesis' estimate of the last keyframes.
#[derive(Clone, Debug)]
pub struct Pass<W: World> {
    /// Pose of each keyframe, as it was estimated then.
    pub poses: Vec<W::Pose>,
    /// For each keyframe, the number of the landmark of each detection.
    pub assignments: Vec<Vec<usize>>,
    /// Where each landmark is: as the filter knew it at the end, or where it was last seen if the filter forgot it.
    pub landmarks: BTreeMap<usize, W::Point>,
    /// The odometry's calibration at the end.
    pub calibration: W::Calibration,
}

/// A keyframe in the past of a hypothesis.
struct Past<W: World> {
    before: Option<usize>,
    pose: W::Pose,
    ids: Vec<usize>,
    /// The hypothesis then, where it was kept.
    state: Option<Box<Hypothesis<W>>>,
}

/// The pass so far.
pub struct Beam<'a, W: World> {
    model: &'a SensorModel<'a, W>,
    /// The log-density of landmarks that are new.
    log_new: f64,
    count: usize,
    branches: usize,
    /// The likeliest first.
    hypotheses: Vec<Hypothesis<W>>,
    past: Vec<Past<W>>,
    /// All hypotheses of each keyframe.
    pub candidates: Vec<Vec<Candidate<W>>>,
}

impl<'a, W: World> Beam<'a, W> {
    /// Nothing seen yet; `log_new` is the log-density of landmarks that are new.
    pub fn new(model: &'a SensorModel<'a, W>, log_new: f64, config: &SemanticConfig) -> Self {
        let (hypotheses, past, candidates) = (vec![Hypothesis::start(model)], Vec::new(), Vec::new());
        Self { model, log_new, count: config.beam, branches: config.branches, hypotheses, past, candidates }
    }

    /// A keyframe more.
    pub fn advance(&mut self, keyframe: &Keyframe<W>) {
        let model = self.model;
        self.hypotheses.iter_mut().for_each(|hypothesis| hypothesis.predict(model, keyframe));
        let seen: Vec<W::Detection> = keyframe.seen.iter().map(|(_, seen)| *seen).collect();
        let ways = |parent: &Hypothesis<W>| parent.branches(model, &seen, self.log_new, self.branches);
        let mut kept = Vec::new();
        if !seen.is_empty() {
            let all = self.hypotheses.iter().map(ways).enumerate();
            let all = all.flat_map(|(parent, ways)| ways.into_iter().map(move |way| (parent, way))).collect();
            kept = select(all, self.count);
        }
        // A frame that no assignment fits is left out.
        let mut ids = vec![Vec::new(); self.hypotheses.len()];
        if !kept.is_empty() {
            self.hypotheses = children(std::mem::take(&mut self.hypotheses), &kept);
            let follow = |(child, (_, way)): (&mut Hypothesis<W>, &(usize, Branch<W>))| {
                child.log_likelihood = way.log_likelihood;
                child.follow(model, &seen, &way.landmarks)
            };
            ids = self.hypotheses.iter_mut().zip(&kept).map(follow).collect();
        }
        for (hypothesis, ids) in self.hypotheses.iter_mut().zip(ids) {
            self.past.push(Past { before: hypothesis.past, pose: hypothesis.pose, ids, state: None });
            hypothesis.past = Some(self.past.len() - 1);
        }
        let candidate = |&Hypothesis { pose, log_likelihood, .. }: &Hypothesis<W>| Candidate { pose, log_likelihood };
        self.candidates.push(self.hypotheses.iter().map(candidate).collect());
    }

    /// Keeps all hypotheses as they are, for [`Beam::state`].
    pub fn keep_states(&mut self) {
        for hypothesis in &self.hypotheses {
            if let Some(past) = hypothesis.past.and_then(|place| self.past.get_mut(place)) {
                past.state = Some(Box::new(hypothesis.clone()));
            }
        }
    }

    /// Of the likeliest hypothesis, its past: the last keyframe first.
    fn history(&self) -> impl Iterator<Item = &Past<W>> {
        let past = |place: Option<usize>| self.past.get(place?);
        let last = self.hypotheses.first().and_then(|best| past(best.past));
        std::iter::successors(last, move |moment| past(moment.before))
    }

    /// The likeliest hypothesis as it was so many keyframes ago, where it was kept.
    pub fn state(&self, keyframes_ago: usize) -> Option<&Hypothesis<W>> {
        self.history().nth(keyframes_ago)?.state.as_deref()
    }

    /// What the likeliest hypothesis says of these keyframes, the last ones.
    pub fn pass(&self, keyframes: &[Keyframe<W>]) -> Pass<W> {
        let mut moments: Vec<&Past<W>> = self.history().take(keyframes.len()).collect();
        moments.reverse();
        let poses: Vec<W::Pose> = moments.iter().map(|moment| moment.pose).collect();
        let assignments: Vec<Vec<usize>> = moments.iter().map(|moment| moment.ids.clone()).collect();
        let mut landmarks = last_seen(self.model, keyframes, &poses, &assignments);
        let best = self.hypotheses.first();
        landmarks
            .extend(best.into_iter().flat_map(|best| &best.landmarks).map(|tracked| (tracked.id, tracked.position)));
        let calibration = best.map_or(W::CALIBRATED, |best| best.calibration);
        Pass { poses, assignments, landmarks, calibration }
    }
}

/// The same where it is known which object each detection shows: one hypothesis, whose landmarks have the numbers of the
/// objects in the order in which they were first seen. `object` tells that of a detection by frame and number; keyframes
/// hold no detection without.
pub fn forward_known<W: World>(
    model: &SensorModel<'_, W>,
    keyframes: &[Keyframe<W>],
    object: impl Fn(usize, usize) -> Option<u64>,
) -> Pass<W> {
    let mut hypothesis = Hypothesis::start(model);
    // Of each object its number, and the landmark that it is in the filter, which may forget it and map it anew.
    let mut objects: BTreeMap<u64, (usize, usize)> = BTreeMap::new();
    let (mut poses, mut assignments) = (Vec::new(), Vec::new());
    for keyframe in keyframes {
        hypothesis.predict(model, keyframe);
        let seen: Vec<W::Detection> = keyframe.seen.iter().map(|(_, seen)| *seen).collect();
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
    Pass { poses, assignments, landmarks, calibration: hypothesis.calibration }
}

/// Of each landmark the place where it was last seen.
fn last_seen<W: World>(
    model: &SensorModel<'_, W>,
    keyframes: &[Keyframe<W>],
    poses: &[W::Pose],
    assignments: &[Vec<usize>],
) -> BTreeMap<usize, W::Point> {
    let frames = keyframes.iter().zip(poses).zip(assignments);
    let places = frames.flat_map(|((keyframe, pose), numbers)| {
        numbers.iter().zip(&keyframe.seen).map(|(number, (_, seen))| (*number, model.position(*pose, seen)))
    });
    places.collect()
}

/// The parent of each branch. The last branch of a parent takes it, and the others have copies, which are large.
fn children<W: World>(parents: Vec<Hypothesis<W>>, branches: &[(usize, Branch<W>)]) -> Vec<Hypothesis<W>> {
    let mut parents: Vec<Option<Hypothesis<W>>> = parents.into_iter().map(Some).collect();
    let is_last = |at: usize| branches[at + 1..].iter().all(|(parent, _)| *parent != branches[at].0);
    let take = |(at, (parent, _)): (usize, &(usize, Branch<W>))| {
        if is_last(at) { parents[*parent].take() } else { parents[*parent].clone() }
    };
    branches.iter().enumerate().filter_map(take).collect()
}

/// The likeliest branch of each neighbourhood, the likeliest first, and at most `count`.
fn select<W: World>(mut all: Vec<(usize, Branch<W>)>, count: usize) -> Vec<(usize, Branch<W>)> {
    all.sort_by(|(_, a), (_, b)| b.log_likelihood.total_cmp(&a.log_likelihood));
    let mut kept: Vec<(usize, Branch<W>)> = Vec::new();
    for (parent, way) in all {
        let is_near = |(_, other): &(usize, Branch<W>)| {
            let (metres, radians) = W::apart(way.pose, other.pose);
            metres < NEIGHBOURHOOD.0 && radians < NEIGHBOURHOOD.1
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
