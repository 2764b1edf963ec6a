//! What is kept of a drive grows with the places that it sees and not with the time that it takes.
//!
//! A place that enough earlier visits have shown gains nothing by one more. The steps of such a visit are forgotten once they are
//! settled: each moves with the step of the earlier visit that its scan matches. Where the robot goes on to a new place, its first
//! motion is from there too, so that the pose graph holds together.

use super::bend::Tie;
use super::revisits::{AROUND, Places, VISITS, tie};
use super::{Closer, Drive, Keyframe};
use crate::geometry::Pose;
use crate::motion::Motion;

/// What is left of the steps of a drive.
pub(super) struct Thinned {
    /// Which steps stay.
    kept: Vec<bool>,
    /// The number that each of them has then.
    number: Vec<usize>,
}

impl Thinned {
    /// How many of the first steps stay.
    pub fn count(&self, before: usize) -> usize {
        self.kept[..before].iter().filter(|kept| **kept).count()
    }

    /// The same of what is kept of each step, or of the first of them.
    pub fn retain<T>(&self, of_steps: &mut Vec<T>) {
        let mut kept = self.kept.iter();
        of_steps.retain(|_| kept.next().copied().unwrap_or(true));
    }

    /// The ties between steps that stay.
    pub fn retain_ties(&self, ties: &mut Vec<Tie>) {
        ties.retain(|tie| self.kept[tie.newer] && tie.older.is_none_or(|older| self.kept[older]));
        for tie in ties {
            (tie.newer, tie.older) = (self.number[tie.newer], tie.older.map(|older| self.number[older]));
        }
    }
}

impl Drive {
    /// Forgets the steps before `before` that visited places which enough earlier visits have shown: those that match one of them, and
    /// those in between. Returns what is left, if something was forgotten.
    pub fn forget_covered(&mut self, path: &[Pose], before: usize, config: &Closer) -> Option<Thinned> {
        let (places, asked) = (Places::of(path), self.asked);
        self.asked = before.max(asked);
        let (mut kept, mut last_tie) = (vec![true; path.len()], f64::NEG_INFINITY);
        for step in asked.max(1)..before {
            // Visits that stay for good.
            let apart = (self.travelled[step] - self.travelled[asked]).max(config.loops.window);
            let visits = places.nearest(self, step, apart);
            if visits.len() < VISITS {
                continue;
            }
            let tied = visits.into_iter().find_map(|older| tie(self, path, Some(older), step, config));
            let (older, by_odometry, tracked) = match tied.filter(|tie| tie.holds(path)) {
                Some(Tie { older: Some(older), older_from_newer: mean, covariance, .. }) => {
                    last_tie = self.travelled[step];
                    (older, Motion { mean, covariance }, Motion { mean, covariance })
                }
                // Somebody in the way: it is where the steps around it are.
                _ if !kept[step - 1] && self.travelled[step] - last_tie <= AROUND => {
                    let Keyframe { by_odometry, tracked, .. } = self.keyframes[step];
                    (self.from[step], by_odometry, tracked)
                }
                _ => continue,
            };
            kept[step] = false;
            self.moves_with[self.steps[step] as usize] = older as u32;
            let next = step + 1;
            self.from[next] = older;
            self.keyframes[next].by_odometry = by_odometry.then(&self.keyframes[next].by_odometry);
            self.keyframes[next].tracked = tracked.then(&self.keyframes[next].tracked);
        }
        kept.contains(&false).then(|| self.without(kept, asked))
    }

    /// Leaves out steps, none of them before `first`.
    fn without(&mut self, kept: Vec<bool>, first: usize) -> Thinned {
        let mut next = 0;
        let number = |&stays: &bool| {
            next += usize::from(stays);
            next - usize::from(stays)
        };
        let number: Vec<usize> = kept.iter().map(number).collect();
        for (&step, (&stays, &number)) in self.steps.iter().zip(kept.iter().zip(&number)).skip(first) {
            if stays {
                self.moves_with[step as usize] = number as u32;
            }
        }
        let thinned = Thinned { kept, number };
        thinned.retain(&mut self.keyframes);
        thinned.retain(&mut self.travelled);
        thinned.retain(&mut self.steps);
        thinned.retain(&mut self.from);
        self.from.iter_mut().for_each(|from| *from = thinned.number[*from]);
        self.asked = thinned.count(self.asked);
        thinned
    }

    /// The poses of the keyframes on a path of all steps.
    pub fn of_keyframes(&self, path: &[Pose]) -> Vec<Pose> {
        self.steps.iter().map(|&step| path[step as usize]).collect()
    }

    /// A path of all steps whose keyframes have moved: what was forgotten moves with the keyframe that it was tied to.
    pub fn moved(&self, path: &[Pose], keyframes: &[Pose]) -> Vec<Pose> {
        let moved = |(step, &keyframe): (usize, &u32)| {
            let (keyframe, of) = (keyframes[keyframe as usize], self.steps[keyframe as usize] as usize);
            if of == step { keyframe } else { keyframe * path[step].seen_from(path[of]) }
        };
        self.moves_with.iter().enumerate().map(moved).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluator::tiles::tiles;
    use crate::loops::is_near;
    use crate::loops::revisits::revisits;
    use crate::ppca::Cluster;
    use crate::slam::SlamConfig;
    use nalgebra::{Matrix3, Point2};
    use std::f64::consts::TAU;

    /// Steps of half a metre round a circle, in a hall of 30 by 24 m whose walls are all in view.
    const LAP: usize = 100;

    fn round(step: usize) -> Pose {
        let (sin, cos) = (TAU * step as f64 / LAP as f64).sin_cos();
        let radius = 0.5 * LAP as f64 / TAU;
        Pose::new(radius * sin, radius * (1.0 - cos), crate::geometry::wrap_angle(TAU * step as f64 / LAP as f64))
    }

    /// What is kept of a drive of so many laps, as it is left after every ten steps: the drive, its ties and the whole path.
    fn drive(laps: usize) -> (Drive, Vec<Tie>, Vec<Pose>) {
        let config = SlamConfig::default().closer();
        let corners = [[-15.0, -5.0], [15.0, -5.0], [15.0, 19.0], [-15.0, 19.0]];
        let walls: Vec<Cluster> =
            (0..4).map(|side| Cluster::wall(corners[side], corners[(side + 1) % 4], 0.01, 100.0)).collect();
        let along =
            |wall: &Cluster, number: i32| wall.mean + wall.direction * (f64::from(number) / 50.0 * wall.length());
        let seen: Vec<Point2<f64>> =
            walls.iter().flat_map(|wall| (-24..=24).map(move |number| along(wall, number))).collect();
        let (mut drive, mut ties, mut whole) = (Drive::default(), Vec::new(), Vec::<Pose>::new());
        for step in 0..laps * LAP {
            let pose = round(step);
            let mean = whole.last().map_or(Pose::IDENTITY, |&last| pose.seen_from(last));
            let motion = Motion { mean, covariance: Matrix3::identity() * 1e-6 };
            let points: Vec<Point2<f64>> = seen.iter().map(|&point| pose.inverse() * point).collect();
            let keyframe = Keyframe {
                stamp: step as f64,
                tiles: tiles(&points, points.len()),
                clusters: walls.iter().map(|wall| wall.transformed(pose.inverse())).collect(),
                by_odometry: motion,
                tracked: motion,
            };
            drive.add(keyframe);
            whole.push(pose);
            if step % 10 == 9 {
                let mut path = drive.of_keyframes(&whole);
                let first = path.len() - 10;
                ties.extend(revisits(&drive, &path, first..path.len(), &[], &config));
                let older = path.len() - 40.min(path.len());
                if let Some(thinned) = drive.forget_covered(&path, older, &config) {
                    thinned.retain(&mut path);
                    thinned.retain_ties(&mut ties);
                }
                assert_eq!(path.len(), drive.keyframes.len());
            }
        }
        (drive, ties, whole)
    }

    /// Three visits of 50 m and the last 20 m are kept.
    #[test]
    fn a_place_that_is_covered_is_kept_no_more() {
        let [two, six, nine] = [2, 6, 9].map(|laps| drive(laps).0.keyframes.len());
        assert_eq!(two, 2 * LAP);
        assert!((3 * LAP..=4 * LAP).contains(&six), "{six}");
        assert!(nine.abs_diff(six) <= 5, "{six} and {nine}");
    }

    /// What is left is tied as it was, to within the error of a match, and moves as a whole.
    #[test]
    fn what_is_left_holds_together() {
        let (drive, ties, whole) = drive(6);
        let kept = drive.of_keyframes(&whole);
        assert!(ties.is_sorted_by_key(|tie| tie.newer) && ties.len() > LAP && ties.iter().all(|tie| tie.holds(&kept)));
        let mut jumps = 0;
        for (step, Keyframe { by_odometry, tracked, .. }) in drive.keyframes.iter().enumerate().skip(1) {
            let from = drive.from[step];
            jumps += usize::from(from + 1 != step);
            let motion = kept[step].seen_from(kept[from]);
            assert!(
                [by_odometry, tracked].into_iter().all(|other| is_near(other.mean, motion, [0.02, 0.005])),
                "{step}"
            );
        }
        assert!((1..=5).contains(&jumps), "{jumps} motions are from an earlier visit");
        let turned = Pose::new(3.0, -2.0, 0.5);
        let moved: Vec<Pose> = kept.iter().map(|&pose| turned * pose).collect();
        let moved = drive.moved(&whole, &moved);
        assert_eq!(moved.len(), whole.len());
        assert!(moved.into_iter().zip(&whole).all(|(moved, &pose)| is_near(moved, turned * pose, [1e-9, 1e-9])));
    }

    /// Where the walls of one visit move, what was tied to it moves along: by at most as far as the next one.
    #[test]
    fn what_was_forgotten_moves_with_the_visit_that_it_is_tied_to() {
        let (drive, _, whole) = drive(6);
        let kept = drive.of_keyframes(&whole);
        // The first half of the circle moves.
        let moved: Vec<Pose> =
            kept.iter().map(|&pose| if pose.x > 0.0 { Pose::new(0.0, 0.7, 0.0) * pose } else { pose }).collect();
        let moved = drive.moved(&whole, &moved);
        let forgotten = (4 * LAP..5 * LAP).filter(|&step| whole[step].x.abs() > 1.0);
        assert!(forgotten.clone().filter(|&step| !drive.steps.contains(&(step as u32))).count() > LAP / 2);
        for step in forgotten {
            let expected = if whole[step].x > 0.0 { 0.7 } else { 0.0 };
            assert!((moved[step].y - whole[step].y - expected).abs() < 1e-6, "{step}");
        }
    }
}
