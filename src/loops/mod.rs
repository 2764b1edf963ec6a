//! Loops: places that the robot comes back to are searched for, and the path is bent so that each of them is one place.
//!
//! Drift beyond the spread of the particles cannot be mended by particles. So while the robot drives, the walls of its last
//! metres are laid over the older part of the map, wherever on it the robot may be (`search`). Where they fit, a pose graph
//! bends the path (`bend`): it holds the motions from step to step, and the scans of all visits to a place against each other
//! (`revisits`), so that what is known well stays as it is. Then the map is rebuilt from the scans of all steps (`rebuild`). When the
//! log is over, the path is bent once more as a whole.
//!
//! What was found is a hypothesis and no fact: rooms look alike. So it has to be the only place of its kind, the drift of this
//! drive or matches that failed have to explain it, and the visits to all places have to agree better than before. Far off, where one
//! more place looks alike, it stays open until a second window agrees.
//!
//! In a run that continues the map of an earlier drive, that map is part of the older map, and it stays where it is: each step whose
//! scan it explains is tied to it. So a loop bends the path only between the places that were known before.

use crate::ablation::AblationConfig;
use crate::evaluator::PosePrior;
use crate::evaluator::cpu::{Matched, match_scan};
use crate::evaluator::failover::Failover;
use crate::evaluator::tiles::Tile;
use crate::geometry::Pose;
use crate::likelihood::{ClusterParams, LikelihoodConfig};
use crate::map::matching::MatchingConfig;
use crate::map::merging::MergingConfig;
use crate::map::{LineMap, MapCluster};
use crate::motion::Motion;
use crate::parameters::parameters;
use crate::ppca::Cluster;
use crate::report::Loop;
use bend::{Bent, Chain, Doubt, Tie, pose_of};
use one_map::OneMap;
use rebuild::rebuild;
use revisits::{agreement, revisits};
use search::{BACK, Found, OlderMap, Query};

mod bend;
mod covered;
mod one_map;
mod rebuild;
mod revisits;
mod search;

parameters! {
    /// How loops are searched for.
    pub struct LoopConfig {
        /// A loop is searched for each time the robot has driven this far \[m\]; 0 for never, as in the paper.
        search_distance: f64 = 5.0, in 0.0..=f64::INFINITY;
        /// The walls of this many metres of way are searched for \[m\]: several rooms, as one room is like another.
        window: f64 = 10.0, in 1.0..=f64::INFINITY;
    }
}

/// What loops take of the configuration of the filter.
#[derive(Clone, Copy, Debug)]
pub struct Closer {
    /// How loops are searched for.
    pub loops: LoopConfig,
    /// How likely points are, as in the filter.
    pub likelihood: LikelihoodConfig,
    /// Which clusters are one wall, as in the filter.
    pub matching: MatchingConfig,
    /// When they are merged, as in the filter.
    pub merging: MergingConfig,
    /// What is switched to the paper's rules.
    pub ablation: AblationConfig,
}

/// What a step of the filter leaves behind for loops.
#[derive(Clone, Debug)]
pub struct Keyframe {
    /// Stamp of its scan \[s\].
    pub stamp: f64,
    /// The scan, in the robot's frame.
    pub tiles: Vec<Tile>,
    /// Its clusters, in the robot's frame.
    pub clusters: Vec<Cluster>,
    /// The motion since the step before, by odometry alone (eq. 17).
    pub by_odometry: Motion,
    /// The same motion as scans have corrected it.
    pub tracked: Motion,
}

/// A path that closes a loop, and the map that goes with it.
#[derive(Clone, Debug)]
pub struct Closed {
    /// `world_from_robot` of every step.
    pub path: Vec<Pose>,
    /// Its map, in the world's frame.
    pub map: Vec<MapCluster>,
}

/// Steps along the path, a window of metres at a time.
#[derive(Debug, Default)]
struct Drive {
    /// The map of an earlier drive that this one continues, if it does.
    earlier: LineMap,
    keyframes: Vec<Keyframe>,
    /// Way up to each of them \[m\].
    travelled: Vec<f64>,
    /// The step of the filter that each of them is of. Elsewhere in this room they are called steps.
    steps: Vec<u32>,
    /// The keyframe that the motion of each is from: the one before, unless that was forgotten (`covered`).
    from: Vec<usize>,
    /// The keyframe that each step of the filter moves with: its own, unless that was forgotten.
    moves_with: Vec<u32>,
    /// Of the keyframes before this one it was asked whether their places are covered: they stay.
    asked: usize,
}

/// The last metres before a step, and what is older than them and as many metres more: there is nothing to find in what the
/// robot can still see.
#[derive(Clone, Copy, Debug)]
struct Window {
    /// Steps before this one are older.
    older: usize,
    /// The first step of the window.
    first: usize,
    /// The last one.
    last: usize,
}

/// Searches for loops.
#[derive(Debug)]
pub struct Loops {
    config: Closer,
    drive: Drive,
    /// The way at the last search \[m\].
    searched: f64,
    older: OlderMap,
    /// Between different visits to one place, of the steps before `tied`.
    ties: Vec<Tie>,
    tied: usize,
    found: Vec<Loop>,
}

/// Share of the walls that the older map has to explain: more than half, as it cannot have seen all of them.
const LEAST_EXPLAINED: f64 = 0.5;
/// A place is the only one of its kind where no other one explains more than this share of what it does.
const ALONE: f64 = 0.5;
/// So close together, places are the same \[m, rad\].
const SAME: [f64; 2] = [0.3, 0.1];
/// Half of the 99.9 % quantile of the χ² distribution of three degrees of freedom: a loop that bends the path at a lower cost
/// \[nats\] is within the drift of this drive.
const DRIFT: f64 = 8.13;
/// What a loop may cost at all: a match that failed is off by many standard deviations \[nats\].
const FAILURE: f64 = 100.0;
/// Two windows that were found agree where they are this close to the way driven between them \[m, rad\]: each is off by some
/// decimetres, and so may the way be.
const AGREES: [f64; 2] = [1.0, 0.2];
/// For so long \[m\]: a robot whose scans are matched drifts by about one per cent of its way.
const AGREES_FOR: f64 = 100.0;
/// The path is bent, and looked over for more visits to the same places, this many times.
const PASSES: usize = 3;
/// Where the robot was is settled once it has driven this far without a loop that says otherwise \[m\]: the way through several
/// buildings. Their scans take 20 MB.
const SETTLED: f64 = 2000.0;
/// A map of fewer steps is too little to search in.
const LEAST_STEPS: usize = 5;

impl Drive {
    fn add(&mut self, keyframe: Keyframe) {
        let Pose { x, y, .. } = keyframe.tracked.mean;
        let before = self.travelled.last().copied().unwrap_or(0.0);
        self.travelled.push(before + x.hypot(y));
        self.from.push(self.keyframes.len().saturating_sub(1));
        self.steps.push(self.moves_with.len() as u32);
        self.moves_with.push(self.keyframes.len() as u32);
        self.keyframes.push(keyframe);
    }

    fn window(&self, last: usize, config: &LoopConfig) -> Option<Window> {
        let way = self.travelled[last];
        let before = |metres: f64| self.travelled[..=last].partition_point(|&travelled| travelled < way - metres);
        let (older, first) = (before(2.0 * config.window), before(config.window));
        (older >= LEAST_STEPS).then_some(Window { older, first, last })
    }

    fn query(&self, window: Window, path: &[Pose], config: &Closer) -> Option<Query> {
        let steps = window.first..window.last + 1;
        Query::new(&self.keyframes[steps.clone()], &path[steps], config)
    }
}

impl Loops {
    /// Nothing has been seen, except in an earlier drive: `earlier` is its map, in the world's frame, or empty.
    pub fn new(config: Closer, earlier: LineMap) -> Self {
        Self {
            older: OlderMap::new(&earlier, &config),
            config,
            drive: Drive { earlier, ..Drive::default() },
            searched: 0.0,
            ties: Vec::new(),
            tied: 0,
            found: Vec::new(),
        }
    }

    /// Adds a step.
    pub fn add(&mut self, keyframe: Keyframe) {
        if self.config.loops.search_distance > 0.0 {
            self.drive.add(keyframe);
        }
    }

    /// The loops that were found so far; `path` is `world_from_robot` at every step.
    pub fn found(&self, path: &[Pose]) -> Vec<Loop> {
        let is_closed = |found: &Loop| {
            let older = found.older.map(|step| step as usize);
            let older_from_robot = path[found.step as usize].seen_from(pose_of(older, path));
            is_near(older_from_robot, found.older_from_robot, [3.0 * SAME[0], 3.0 * SAME[1]])
        };
        self.found.iter().map(|found| Loop { is_closed: is_closed(found), ..*found }).collect()
    }

    /// Whether it is time to search.
    pub fn is_due(&self) -> bool {
        self.drive.travelled.last().is_some_and(|way| way - self.searched >= self.config.loops.search_distance)
    }

    /// Searches for a loop, and closes the one that it finds. `path` is `world_from_robot` at every step, and `log_likelihood` that
    /// of all else that was seen on a path: it may refuse a loop, as another place that looks alike.
    pub fn close(
        &mut self,
        path: &[Pose],
        evaluator: &mut Failover,
        log_likelihood: &dyn Fn(&[Pose]) -> f64,
    ) -> Option<Closed> {
        self.searched = *self.drive.travelled.last()?;
        let whole = path;
        let path = &self.forget_covered(whole);
        let steps = std::mem::replace(&mut self.tied, path.len())..path.len();
        self.ties.extend(revisits(&self.drive, path, steps, &[], &self.config));
        let window = self.drive.window(path.len() - 1, &self.config.loops)?;
        let found = self.search(window, path, evaluator)?;
        // Without an earlier drive every place is one of this drive.
        let near = if self.drive.earlier.clusters.is_empty() { f64::INFINITY } else { BACK };
        let new = Tie::new(found.world_from_robot, path, window, near);
        let mut ties = self.agreeing(&found, whole, path);
        // Close by are few places; farther off, one more looks alike.
        let is_close = found.distance(path[window.last]) <= self.config.loops.window;
        let (step, is_confirmed) = (new.newer, !ties.is_empty());
        ties.push(new);
        let hypothesis = self.bend(path, &ties, window)?;
        let is_believed = hypothesis.is_drift || is_confirmed || is_close && hypothesis.cost <= FAILURE;
        let bent = self.drive.moved(whole, &hypothesis.path);
        let is_closed = is_believed && log_likelihood(&bent) >= log_likelihood(whole);
        self.found.push(Loop {
            stamp: self.drive.keyframes[step].stamp,
            older_stamp: new.older.map(|older| self.drive.keyframes[older].stamp),
            step: self.drive.steps[step],
            older: new.older.map(|older| self.drive.steps[older]),
            older_from_robot: new.older_from_newer,
            correction: found.distance(path[step]),
            explained: found.explained,
            is_closed,
        });
        is_closed.then(|| {
            self.ties = hypothesis.ties;
            self.rebuild(whole, &hypothesis.path)
        })
    }

    /// The ties of loops that did not close when they were found and that put the robot where this one has it, each by a window of other
    /// metres: next to a room that looks like another one are rooms that do not.
    fn agreeing(&self, found: &Found, whole: &[Pose], path: &[Pose]) -> Vec<Tie> {
        let Drive { travelled, moves_with, .. } = &self.drive;
        let (now, robot) = (path.len() - 1, whole[whole.len() - 1]);
        let tie = |before: &Loop| {
            let step = before.step as usize;
            let older = before.older.map(|older| older as usize);
            let there = pose_of(older, whole) * before.older_from_robot;
            let newer = moves_with[step] as usize;
            let apart = travelled[now] - travelled[newer];
            let is_other = (self.config.loops.search_distance..=AGREES_FOR).contains(&apart);
            let agrees = is_near(found.world_from_robot, there * robot.seen_from(whole[step]), AGREES);
            (is_other && agrees).then(|| {
                let older = older.map(|older| moves_with[older] as usize);
                Tie::of_window(there.seen_from(pose_of(older, path)), older, newer)
            })
        };
        self.found.iter().filter(|before| !before.is_closed).filter_map(tie).collect()
    }

    /// Forgets visits to places that are covered, of steps that are settled. Returns the path of what is left.
    fn forget_covered(&mut self, path: &[Pose]) -> Vec<Pose> {
        let mut of_keyframes = self.drive.of_keyframes(path);
        let way = &self.drive.travelled;
        let settled = way.partition_point(|there| there + SETTLED < self.searched).min(self.older.path.len());
        if let Some(thinned) = self.drive.forget_covered(&of_keyframes, settled, &self.config) {
            self.tied = thinned.count(self.tied);
            thinned.retain_ties(&mut self.ties);
            thinned.retain(&mut self.older.path);
            thinned.retain(&mut of_keyframes);
        }
        of_keyframes
    }

    /// The whole path bent once more, where loops have bent it in parts: with the motions as they were tracked, and the ties of all
    /// visits to a place. `None` where no loop was closed, or where the visits agree no better on it.
    pub fn finish(&self, path: &[Pose]) -> Option<Closed> {
        if !self.found(path).iter().any(|found| found.is_closed) {
            return None;
        }
        let whole = path;
        let path = &self.drive.of_keyframes(whole);
        let chain = Chain::as_tracked(&self.drive);
        let ties = self.visits(path, &self.ties);
        let before = self.agreement(path, &ties);
        let (bent, ties) = self.settle(&chain, path.to_vec(), ties)?;
        (self.agreement(&bent, &self.visits(&bent, &ties)) > before).then(|| self.rebuild(whole, &bent))
    }

    /// Rebuilds the map from the scans that are kept, and moves the whole path with them.
    fn rebuild(&self, whole: &[Pose], path: &[Pose]) -> Closed {
        let Drive { earlier, keyframes, .. } = &self.drive;
        let Closed { path: kept, map } = rebuild(&earlier.clusters, keyframes, path, &self.config);
        Closed { path: self.drive.moved(whole, &kept), map }
    }

    /// The place of the older map that explains the window, if it is the only one of its kind and another one than where the robot
    /// is thought to be.
    fn search(&mut self, window: Window, path: &[Pose], evaluator: &mut Failover) -> Option<Found> {
        let robot = path[window.last];
        self.older.follow(&self.drive, path, window.older, &self.config);
        let query = self.drive.query(window, path, &self.config)?;
        let is_found = |found: &Found| found.explained >= LEAST_EXPLAINED;
        let is_here = |found: &Found| is_near(found.world_from_robot, robot, SAME);
        if self.older.search_near(&query, robot, evaluator).is_some_and(|near| is_found(&near) && is_here(&near)) {
            return None;
        }
        let places = self.older.search(&query, evaluator);
        let found = *places.first().filter(|first| is_found(first) && !is_here(first))?;
        // The place where the robot is thought to be is one of them.
        if self.older.evaluate(robot, &query).explained >= found.explained {
            return None;
        }
        let is_alone = places.get(1).is_none_or(|second| second.explained < ALONE * found.explained);
        is_alone.then_some(found)
    }

    /// The path with these new ties; `None` where the visits to all places agree no better on it: a place that looks alike.
    fn bend(&self, path: &[Pose], new: &[Tie], window: Window) -> Option<Hypothesis> {
        // Where in the earlier map the window is, is the question: what its scans were matched to there does not count.
        let is_known = |tie: &&Tie| tie.older.is_some() || tie.newer < window.first;
        let known: Vec<Tie> = self.ties.iter().filter(is_known).copied().collect();
        // As if no match had failed, first: where the drift explains the loop, nothing else is in doubt.
        for doubt in [Doubt::None, Doubt::OfMatches] {
            let chain = Chain::new(&self.drive, path, doubt);
            let before = chain.bent(path, &known, &[])?;
            let Bent { path, cost } = chain.bent(path, &known, new)?;
            let cost = cost - before.cost;
            if doubt == Doubt::None && cost > DRIFT {
                continue;
            }
            let ties = self.visits(&path, &known);
            // The ties of all visits tell where the robot was better than a window does.
            let (path, ties) = self.settle(&chain, path, ties)?;
            let agrees_better = self.agreement(&path, &ties) > self.agreement(&before.path, &known);
            return agrees_better.then_some(Hypothesis { path, ties, cost, is_drift: doubt == Doubt::None });
        }
        None
    }

    /// The path, bent again and again so that it keeps the motions and the ties of all visits, and the ties before it was bent last.
    fn settle(&self, chain: &Chain, mut path: Vec<Pose>, mut ties: Vec<Tie>) -> Option<(Vec<Pose>, Vec<Tie>)> {
        for pass in 0..PASSES {
            if pass > 0 {
                ties = self.visits(&path, &ties);
            }
            Bent { path, .. } = chain.bent(&path, &ties, &[])?;
        }
        Some((path, ties))
    }

    /// The ties of all steps.
    fn visits(&self, path: &[Pose], known: &[Tie]) -> Vec<Tie> {
        revisits(&self.drive, path, 0..path.len(), known, &self.config)
    }

    fn agreement(&self, path: &[Pose], ties: &[Tie]) -> f64 {
        agreement(&self.drive, path, ties, &self.config)
    }
}

/// A path that closes a loop.
#[derive(Debug)]
struct Hypothesis {
    path: Vec<Pose>,
    /// Between the visits to one place, as that path has them.
    ties: Vec<Tie>,
    /// The error that the loop adds to the pose graph \[nats\].
    cost: f64,
    /// Whether the drift explains it, without a match that has failed.
    is_drift: bool,
}

/// Matches a scan to walls that are first taken to be thick, so that one some way off is found, and then as they are.
fn match_closely(
    walls: &[ClusterParams],
    log_outlier: f32,
    prior: PosePrior,
    tiles: &[Tile],
    capture_sigma: f64,
    iterations: u32,
) -> Matched {
    let thick = walls.iter().map(|wall| wall.thickened(capture_sigma as f32));
    let captured = match_scan(thick, log_outlier, &prior, tiles, iterations);
    let prior = PosePrior { pose: captured.mode.pose, ..prior };
    match_scan(walls.iter().copied(), log_outlier, &prior, tiles, iterations)
}

/// Whether two poses are this close together \[m, rad\].
fn is_near(one: Pose, other: Pose, [distance, turn]: [f64; 2]) -> bool {
    let off = one.seen_from(other);
    off.x.hypot(off.y) < distance && off.heading.abs() < turn
}
