//! A pose graph bends the path so that it closes a loop.

use super::{Drive, Keyframe, SAME, Window, is_near};
use crate::factor_graph::{Between, Graph, GraphError, Loss, Noise, Prior, Solver, Values, VariableId};
use crate::geometry::Pose;
use nalgebra::{DMatrix, Matrix3, Vector3};

/// Two steps that are in the same place, or a step that is in the map of an earlier drive.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tie {
    /// `None` for the world: the map of an earlier drive stays where it is.
    pub older: Option<usize>,
    pub newer: usize,
    pub older_from_newer: Pose,
    /// Of (forward, sideways, heading) of the newer one.
    pub covariance: Matrix3<f64>,
}

impl Tie {
    /// The last step of a window is here: as seen from the older step that was closest, or in the world, if no older step was as
    /// close as `near` \[m\].
    pub fn new(world_from_robot: Pose, path: &[Pose], window: Window, near: f64) -> Self {
        let off = |step: &usize| (path[*step].position() - world_from_robot.position()).norm();
        let closest = (0..window.older).min_by(|a, b| off(a).total_cmp(&off(b)));
        let older = closest.filter(|step| off(step) <= near);
        Self::of_window(world_from_robot.seen_from(pose_of(older, path)), older, window.last)
    }

    /// The last step of a window is here.
    pub fn of_window(older_from_newer: Pose, older: Option<usize>, newer: usize) -> Self {
        let covariance = Matrix3::from_diagonal(&Vector3::from(TIE).map(|sigma| sigma * sigma));
        Self { older, newer, older_from_newer, covariance }
    }

    /// Whether a path has the two where this has them.
    pub fn holds(&self, path: &[Pose]) -> bool {
        is_near(path[self.newer].seen_from(pose_of(self.older, path)), self.older_from_newer, SAME)
    }
}

/// That of a step, or the origin of the world.
pub(super) fn pose_of(step: Option<usize>, path: &[Pose]) -> Pose {
    step.map_or(Pose::IDENTITY, |step| path[step])
}

/// A path that was bent.
#[derive(Debug)]
pub(super) struct Bent {
    pub path: Vec<Pose>,
    /// The error of the pose graph \[nats\].
    pub cost: f64,
}

/// What may be wrong with the motions from step to step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Doubt {
    /// They drift.
    None,
    /// They drift, and the match of a scan may have failed: where scans and odometry disagree more than they usually do.
    OfMatches,
}

/// The first pose stays \[m, m, rad\].
const ORIGIN: [f64; 3] = [1e-3; 3];
/// How well a window tells where its last step was from an older one, forward, sideways, heading \[m, m, rad\]: on drives with a
/// reference, 84 % of the loops that were found were within 0.15 m and 0.04 rad of it.
const TIE: [f64; 3] = [0.1, 0.1, 0.03];
/// The least error of a motion from step to step, of any kind.
pub(super) const MOTION: [f64; 3] = [0.01, 0.01, 0.003];
/// Motions whose squared distance from odometry, in units of the usual one, is this are as likely wrong as not.
const UNUSUAL: f64 = 50.0;
/// Ties may be wrong: beyond this many standard deviations they pull no harder.
const TIE_TAIL: f64 = 3.0;

/// The motions from step to step, and their covariances.
#[derive(Debug)]
pub(super) struct Chain {
    /// The step that each is from.
    from: Vec<usize>,
    motions: Vec<Pose>,
    covariances: Vec<Matrix3<f64>>,
}

impl Chain {
    /// As this path has them.
    pub fn new(drive: &Drive, path: &[Pose], doubt: Doubt) -> Self {
        let motion = |(&from, pose): (&usize, &Pose)| pose.seen_from(path[from]);
        Self::with_motions(drive, drive.from.iter().zip(path).map(motion).collect(), doubt)
    }

    /// As the scans of each step have tracked them, before any loop was closed.
    pub fn as_tracked(drive: &Drive) -> Self {
        let motions = drive.keyframes.iter().map(|keyframe| keyframe.tracked.mean).collect();
        Self::with_motions(drive, motions, Doubt::None)
    }

    fn with_motions(Drive { keyframes, from, .. }: &Drive, motions: Vec<Pose>, doubt: Doubt) -> Self {
        let usual = usual(keyframes, &motions);
        let least = Matrix3::from_diagonal(&Vector3::from(MOTION).map(|sigma| sigma * sigma));
        let covariance = |(keyframe, &moved): (&Keyframe, &Pose)| match doubt {
            Doubt::None => keyframe.tracked.covariance + least,
            Doubt::OfMatches => doubted(keyframe, moved, &usual) + least,
        };
        let covariances = keyframes.iter().zip(&motions).map(covariance).collect();
        Self { from: from.clone(), motions, covariances }
    }

    /// The path, from `path` on, that keeps the motions and all ties as well as it can, and new ones in any case. `None` where
    /// there is no such path.
    pub fn bent(&self, path: &[Pose], ties: &[Tie], new: &[Tie]) -> Option<Bent> {
        self.solve(path, ties, new).ok()
    }

    fn solve(&self, path: &[Pose], ties: &[Tie], new: &[Tie]) -> Result<Bent, GraphError> {
        let mut values = Values::new();
        let steps: Vec<VariableId> = path.iter().map(|&pose| values.add_pose(pose)).collect();
        let add = |graph: &mut Graph, tie: &Tie| match tie.older {
            Some(older) => {
                let between = Between::new(steps[older], steps[tie.newer], tie.older_from_newer);
                graph.add(between, noise(&tie.covariance)?)
            }
            None => graph.add(Prior::pose(steps[tie.newer], tie.older_from_newer), noise(&tie.covariance)?),
        };
        let mut graph = Graph::new();
        graph.add(Prior::pose(steps[0], path[0]), Noise::sigmas(&ORIGIN)?)?;
        for (step, (&moved, covariance)) in self.motions.iter().zip(&self.covariances).enumerate().skip(1) {
            graph.add(Between::new(steps[self.from[step]], steps[step], moved), noise(covariance)?)?;
        }
        for tie in ties {
            let term = add(&mut graph, tie)?;
            graph.set_loss(term, Loss::Cauchy(TIE_TAIL))?;
        }
        for new in new {
            add(&mut graph, new)?;
        }
        let cost = Solver::default().solve(&graph, &mut values)?.error;
        let path: Result<Vec<Pose>, GraphError> = steps.into_iter().map(|step| values.pose(step)).collect();
        Ok(Bent { path: path?, cost })
    }
}

/// How far a motion is off odometry: forward, sideways, heading.
fn off(keyframe: &Keyframe, moved: Pose) -> Vector3<f64> {
    let Pose { x, y, heading } = moved.seen_from(keyframe.by_odometry.mean);
    Vector3::new(x, y, heading)
}

/// How far motions of this drive usually are off odometry: robust standard deviations.
fn usual(keyframes: &[Keyframe], motions: &[Pose]) -> Vector3<f64> {
    let offs: Vec<Vector3<f64>> =
        keyframes.iter().zip(motions).skip(1).map(|(keyframe, &moved)| off(keyframe, moved).abs()).collect();
    let median = |axis: usize| {
        let mut numbers: Vec<f64> = offs.iter().map(|off| off[axis]).collect();
        numbers.sort_by(f64::total_cmp);
        numbers.get(numbers.len() / 2).copied().unwrap_or(0.0)
    };
    // A normal distribution has half of its errors within 0.674 standard deviations.
    Vector3::from_fn(|axis, _| (median(axis) / 0.6745).max(MOTION[axis]))
}

/// The covariance of a motion where a match may have failed. Where scans and odometry disagree more than they usually do, one of
/// them is wrong, and nobody knows which: that of a mixture of the two, around what the scans say.
fn doubted(keyframe: &Keyframe, moved: Pose, usual: &Vector3<f64>) -> Matrix3<f64> {
    let off = off(keyframe, moved);
    let squared = off.component_div(usual).norm_squared();
    let share = squared / (squared + UNUSUAL);
    let Keyframe { tracked, by_odometry, .. } = keyframe;
    tracked.covariance * (1.0 - share) + (by_odometry.covariance + off * off.transpose()) * share
}

fn noise(covariance: &Matrix3<f64>) -> Result<Noise, GraphError> {
    let symmetric = 0.5 * (covariance + covariance.transpose());
    Noise::covariance(&DMatrix::from_column_slice(3, 3, symmetric.as_slice()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::{Motion, Travel};
    use nalgebra::Matrix3;

    /// Ten metres ahead, in steps of half a metre.
    fn corridor() -> (Vec<Keyframe>, Vec<Pose>) {
        let step = Pose::new(0.5, 0.0, 0.0);
        let by_odometry = Travel::measured(step).motion(&crate::motion::MotionConfig::default(), Pose::IDENTITY);
        let keyframe = Keyframe {
            stamp: 0.0,
            tiles: Vec::new(),
            clusters: Vec::new(),
            by_odometry,
            tracked: Motion { mean: step, covariance: Matrix3::identity() * 1e-6 },
        };
        (vec![keyframe; 21], vec![step; 21])
    }

    fn bend(keyframes: &[Keyframe], motions: &[Pose], older_from_newer: Pose) -> Bent {
        let mut path = vec![Pose::IDENTITY];
        motions[1..].iter().for_each(|&moved| path.push(path[path.len() - 1] * moved));
        let covariance = Matrix3::from_diagonal(&Vector3::from(TIE).map(|sigma| sigma * sigma));
        let tie = Tie { older: Some(0), newer: 20, older_from_newer, covariance };
        let mut drive = Drive::default();
        keyframes.iter().for_each(|keyframe| drive.add(keyframe.clone()));
        Chain::new(&drive, &path, Doubt::OfMatches).bent(&path, &[], std::slice::from_ref(&tie)).unwrap()
    }

    /// Five usual errors forward and five in heading, whose squares are 50: scans and odometry are as likely right. By hand, for
    /// example forward: ½ 0.0004 + ½ (0.04 + 0.5²).
    #[test]
    fn a_motion_in_doubt_has_the_covariance_of_a_mixture() {
        let diagonal = |x, y, heading| Matrix3::from_diagonal(&Vector3::new(x, y, heading));
        let by_odometry = Motion { mean: Pose::new(2.0, 1.0, 0.3), covariance: diagonal(0.04, 0.04, 0.01) };
        let tracked = Motion {
            mean: by_odometry.mean * Pose::new(0.5, 0.0, 0.25),
            covariance: diagonal(0.0004, 0.0001, 0.000025),
        };
        let keyframe = Keyframe { stamp: 0.0, tiles: Vec::new(), clusters: Vec::new(), by_odometry, tracked };
        let usual = Vector3::new(0.1, 0.1, 0.05);
        let mixture = Matrix3::new(0.1452, 0.0, 0.0625, 0.0, 0.02005, 0.0, 0.0625, 0.0, 0.0362625);
        let covariance = doubted(&keyframe, tracked.mean, &usual);
        assert!((covariance - mixture).abs().max() < 1e-12, "{covariance}");
        // Where both agree, it is that of the scans.
        let agreeing = Keyframe { by_odometry: Motion { mean: tracked.mean, ..by_odometry }, ..keyframe };
        let covariance = doubted(&agreeing, tracked.mean, &usual);
        assert!((covariance - agreeing.tracked.covariance).abs().max() < 1e-12, "{covariance}");
    }

    #[test]
    fn a_loop_within_the_drift_costs_little_and_one_beyond_it_much() {
        let (keyframes, motions) = corridor();
        let exact = bend(&keyframes, &motions, Pose::new(10.0, 0.0, 0.0));
        assert!(exact.cost < 1e-9, "{}", exact.cost);
        // 20 motions of 1 cm and a tie of 10 cm: √(20 · 1² + 10²) = 10.95 cm along the corridor.
        let near = bend(&keyframes, &motions, Pose::new(10.1095, 0.0, 0.0));
        assert!((near.cost - 0.5).abs() < 0.05, "{}", near.cost);
        let far = bend(&keyframes, &motions, Pose::new(12.0, 0.0, 0.0));
        assert!(far.cost > 100.0, "{}", far.cost);
    }

    /// One motion of all disagrees with odometry: the correction goes there.
    #[test]
    fn the_path_is_bent_where_it_is_in_doubt() {
        let (keyframes, mut motions) = corridor();
        motions[8] = Pose::new(0.5, 0.0, 0.4);
        let Bent { path, cost } = bend(&keyframes, &motions, Pose::new(10.0, 0.0, 0.0));
        let turns: Vec<f64> = path.windows(2).map(|pair| pair[1].seen_from(pair[0]).heading).collect();
        assert!(turns[7].abs() < 0.05 && turns.iter().all(|turn| turn.abs() < 0.05), "{turns:?}");
        assert!(cost < 3.0, "{cost}");
    }
}
