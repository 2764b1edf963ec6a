//! Odometry between any two moments.

use crate::geometry::{Pose, StampedPose};

/// What the wheels say, in the order of time.
#[derive(Clone, Debug, PartialEq)]
pub enum Odometry {
    /// Speeds; each holds until the next one, and the last to the end. Before the first the robot stands still.
    Velocities(Vec<Velocity>),
    /// Poses of the robot in a frame that drifts. Before the first and after the last the robot stands still.
    Poses(Vec<StampedPose>),
}

/// How fast the robot drives, from a moment on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Velocity {
    /// Seconds.
    pub stamp: f64,
    /// Speed ahead \[m/s\].
    pub forward: f64,
    /// Speed of the turn \[rad/s\], positive counter-clockwise.
    pub turn: f64,
}

/// The motion between two times, with the sums that its noise grows with.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion<P = Pose> {
    /// The pose at the end, seen from that at the start.
    pub start_from_end: P,
    /// Length of the path \[m\].
    pub distance: f64,
    /// All turning on the way, left and right added up \[rad\].
    pub turned: f64,
    /// Seconds that it took.
    pub duration: f64,
}

impl Motion {
    fn drive(&mut self, forward: f64, turn: f64, duration: f64) {
        let (distance, angle) = (forward * duration, turn * duration);
        self.append(arc(distance, angle), distance.abs(), angle.abs());
    }

    fn append(&mut self, start_from_end: Pose, distance: f64, turned: f64) {
        self.start_from_end = self.start_from_end * start_from_end;
        self.distance += distance;
        self.turned += turned;
    }
}

/// The end of a circular arc of a length \[m\] that turns by an angle \[rad\].
fn arc(length: f64, angle: f64) -> Pose {
    let half = angle / 2.0;
    let chord = if half.abs() < 1e-6 { length } else { length * half.sin() / half };
    Pose::new(chord * half.cos(), chord * half.sin(), angle)
}

impl Odometry {
    /// How many rows there are.
    pub fn len(&self) -> usize {
        match self {
            Self::Velocities(rows) => rows.len(),
            Self::Poses(rows) => rows.len(),
        }
    }

    /// Whether nothing was recorded.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The first and the last stamp \[s\].
    pub fn span(&self) -> Option<(f64, f64)> {
        match self {
            Self::Velocities(rows) => Some((rows.first()?.stamp, rows.last()?.stamp)),
            Self::Poses(rows) => Some((rows.first()?.stamp, rows.last()?.stamp)),
        }
    }

    /// The motion between two moments \[s\]; none where `to` does not come after `from`.
    pub fn motion(&self, from: f64, to: f64) -> Motion {
        let mut motion = Motion { duration: (to - from).max(0.0), ..Motion::default() };
        if from < to {
            match self {
                Self::Velocities(rows) => add_speeds(&mut motion, rows, from, to),
                Self::Poses(rows) => add_poses(&mut motion, rows, from, to),
            }
        }
        motion
    }

    /// Where the robot would be at each stamp \[s\] if odometry were right; the first one is the origin.
    pub fn dead_reckoning(&self, stamps: impl IntoIterator<Item = f64>) -> Vec<StampedPose> {
        let mut last: Option<StampedPose> = None;
        let mut reckon = |stamp| {
            let pose = last.map_or(Pose::IDENTITY, |last| last.pose * self.motion(last.stamp, stamp).start_from_end);
            *last.insert(StampedPose { stamp, pose })
        };
        stamps.into_iter().map(&mut reckon).collect()
    }
}

fn add_speeds(motion: &mut Motion, rows: &[Velocity], from: f64, to: f64) {
    let next = rows.partition_point(|row| row.stamp <= from);
    let (held, later) = rows.split_at(next);
    let (mut now, mut speeds) = (from, held.last().map_or((0.0, 0.0), |row| (row.forward, row.turn)));
    for row in later.iter().take_while(|row| row.stamp < to) {
        motion.drive(speeds.0, speeds.1, row.stamp - now);
        (now, speeds) = (row.stamp, (row.forward, row.turn));
    }
    motion.drive(speeds.0, speeds.1, to - now);
}

fn add_poses(motion: &mut Motion, rows: &[StampedPose], from: f64, to: f64) {
    let (first, end) = (rows.partition_point(|row| row.stamp <= from), rows.partition_point(|row| row.stamp < to));
    let between = rows.get(first..end).unwrap_or_default().iter().map(|row| row.pose);
    let mut last = pose_at(rows, from);
    for pose in between.chain([pose_at(rows, to)]) {
        let step = pose.seen_from(last);
        motion.append(step, step.position().coords.norm(), step.heading.abs());
        last = pose;
    }
}

/// Between two rows, what lies between them.
fn pose_at(rows: &[StampedPose], stamp: f64) -> Pose {
    let next = rows.partition_point(|row| row.stamp <= stamp);
    let (before, after) = (next.checked_sub(1).and_then(|before| rows.get(before)), rows.get(next));
    match (before, after) {
        (Some(before), Some(after)) => {
            before.pose.interpolated(after.pose, (stamp - before.stamp) / (after.stamp - before.stamp))
        }
        (Some(only), None) | (None, Some(only)) => only.pose,
        (None, None) => Pose::IDENTITY,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn velocities(rows: &[[f64; 3]]) -> Odometry {
        Odometry::Velocities(rows.iter().map(|&[stamp, forward, turn]| Velocity { stamp, forward, turn }).collect())
    }

    #[track_caller]
    fn assert_near(found: Pose, expected: Pose) {
        let off = found.seen_from(expected);
        assert!(off.position().coords.norm() + off.heading.abs() < 1e-12, "{found:?} is not {expected:?}");
    }

    /// A quarter of a circle of radius 2 m to the left, then 3 m straight on.
    #[test]
    fn speeds_hold_until_the_next_ones() {
        let odometry = velocities(&[[1.0, PI, FRAC_PI_2], [2.0, 3.0, 0.0], [3.0, 0.0, 0.0]]);
        let whole = odometry.motion(0.0, 9.0);
        assert_near(whole.start_from_end, Pose::new(2.0, 5.0, FRAC_PI_2));
        assert!((whole.distance - PI - 3.0).abs() < 1e-12 && (whole.turned - FRAC_PI_2).abs() < 1e-12, "{whole:?}");
        assert_eq!((whole.duration, odometry.span()), (9.0, Some((1.0, 3.0))));
        let parts = [0.5, 1.3, 2.0, 2.9, 9.0].windows(2).map(|pair| odometry.motion(pair[0], pair[1]).start_from_end);
        assert_near(parts.fold(Pose::IDENTITY, |pose, step| pose * step), whole.start_from_end);
        assert_near(odometry.motion(2.5, 2.0).start_from_end, Pose::IDENTITY);
    }

    #[test]
    fn a_turn_on_the_spot_and_an_almost_straight_line() {
        let odometry = velocities(&[[0.0, 0.0, -1.0], [2.0, 1.0, 1e-9]]);
        assert_near(odometry.motion(0.0, 2.0).start_from_end, Pose::new(0.0, 0.0, -2.0));
        assert_near(odometry.motion(2.0, 4.0).start_from_end, Pose::new(2.0, 2e-9, 2e-9));
    }

    #[test]
    fn poses_are_joined_and_the_frame_does_not_matter() {
        let rows = [(0.0, 0.0, 0.0, 3.0), (2.0, 4.0, 0.0, -3.0), (2.0, 4.0, 1.0, -3.0), (3.0, 4.0, 3.0, -3.0)];
        let stamped = |frame: Pose| {
            let at = |&(stamp, x, y, heading)| StampedPose { stamp, pose: frame * Pose::new(x, y, heading) };
            Odometry::Poses(rows.iter().map(at).collect())
        };
        let odometry = stamped(Pose::IDENTITY);
        // Half of the way; the heading takes the short way through π.
        assert_near(
            odometry.motion(-1.0, 1.0).start_from_end,
            Pose::new(2.0, 0.0, PI).seen_from(Pose::new(0.0, 0.0, 3.0)),
        );
        let end = Pose::new(4.0, 2.0, -3.0).seen_from(Pose::new(2.0, 0.0, PI));
        for frame in [Pose::IDENTITY, Pose::new(5.0, -7.0, 2.0)] {
            let motion = stamped(frame).motion(1.0, 2.5);
            assert_near(motion.start_from_end, end);
            assert!((motion.distance - 4.0).abs() < 1e-12, "{motion:?}");
        }
        assert_near(odometry.motion(3.0, 99.0).start_from_end, Pose::IDENTITY);
        let reckoned = odometry.dead_reckoning([1.0, 2.0, 2.5]);
        assert_near(reckoned[2].pose, end);
        assert_near(reckoned[0].pose, Pose::IDENTITY);
    }
}
