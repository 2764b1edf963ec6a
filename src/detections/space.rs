//! The same in space: a robot with six degrees of freedom, and a camera that sees where an object is and how far.

use super::odometry::Motion;
use super::{Frame, even_confusion, validate_labels};
use crate::geometry::{Pinhole, Pose3, StampedPose3};
use crate::parameters::{ConfigError, check, parameters};
use nalgebra::{Point3, Vector3, Vector6};

/// An object, as a detector saw it in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection3 {
    /// Number of the class that the detector names, in the list of [`Sensors3::classes`].
    pub class: usize,
    /// How sure the detector is, 0 to 1.
    pub score: f64,
    /// Where it is in the picture: u to the right, v down \[pixels\].
    pub pixel: [f64; 2],
    /// How near it is: f b / z \[pixels\], above 0. Of two cameras, b apart, it is the disparity; of an object of height b the
    /// height in the picture.
    pub disparity: f64,
}

/// A camera on a robot that also tells how far an object is.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensors3 {
    /// Names of the classes.
    pub classes: Vec<String>,
    /// Probability of a label: a row for each true class, a column for each class that the detector names. Rows sum
    /// to 1.
    pub confusion: Vec<Vec<f64>>,
    /// Numbers of the classes whose objects may move; those that do are not mapped.
    pub movable: Vec<usize>,
    /// The camera; of two the left one.
    pub camera: Pinhole,
    /// The distance of two cameras \[m\], or the height of the objects.
    pub baseline: f64,
    /// How far the objects reach from their middle towards the camera \[m\]: boxes are drawn around what is near, and pixels are
    /// of points, for which it is 0.
    pub reach: f64,
    /// Where it is mounted.
    pub robot_from_camera: Pose3,
    /// Errors of detections.
    pub noise: PixelNoise,
    /// How often it misses and invents objects.
    pub detector: Detector3,
    /// Errors of the odometry.
    pub odometry: OdometryNoise3,
}

parameters! {
    /// Errors in the picture, as standard deviations.
    pub struct PixelNoise {
        /// To the right \[pixels\].
        u: f64 = 2.0, in 1e-6..=1e4;
        /// Down \[pixels\].
        v: f64 = 2.0, in 1e-6..=1e4;
        /// Of the disparity \[pixels\].
        disparity: f64 = 2.0, in 1e-6..=1e4;
        /// Of all three, as a share of the disparity; comes on top. A box around an object errs by its size.
        share: f64 = 0.0, in 0.0..=1.0;
    }
}

parameters! {
    /// How often the detector misses and invents objects.
    pub struct Detector3 {
        /// Probability that an object in view is detected.
        detection_probability: f64 = 0.9, in 1e-3..=0.999;
        /// Expected false detections of a frame.
        clutter: f64 = 0.03, in 1e-9..=1e3;
    }
}

parameters! {
    /// Errors of the odometry, which grow with the way and with time, the same in every direction, as standard deviations.
    pub struct OdometryNoise3 {
        /// Of the position, after one metre \[m/√m\].
        position_per_metre: f64 = 0.05, in 0.0..=10.0;
        /// Of the orientation, after one metre \[rad/√m\].
        rotation_per_metre: f64 = 0.01, in 0.0..=10.0;
        /// Of the orientation, after turning by one radian \[rad/√rad\].
        rotation_per_radian: f64 = 0.03, in 0.0..=10.0;
        /// Of the position, after one second \[m/√s\].
        position_per_second: f64 = 0.001, in 0.0..=10.0;
        /// Of the orientation, after one second \[rad/√s\].
        rotation_per_second: f64 = 0.001, in 0.0..=10.0;
        /// Of the scale of the way, which is found.
        scale: f64 = 0.1, in 1e-6..=1.0;
        /// Of the scale of turns, which is found.
        turn_scale: f64 = 0.1, in 1e-6..=1.0;
    }
}

impl PixelNoise {
    /// Standard deviations of u, v and disparity \[pixels\] at a disparity.
    pub fn at(&self, disparity: f64) -> [f64; 3] {
        [self.u, self.v, self.disparity].map(|sigma| sigma.hypot(self.share * disparity))
    }
}

impl OdometryNoise3 {
    /// Variances of the end of a motion in its own frame, where it is small: position \[m²\], then orientation \[rad²\].
    pub fn variances(&self, motion: &Motion<Pose3>) -> [f64; 6] {
        let Motion { distance, turned, duration, .. } = *motion;
        let position = self.position_per_metre.powi(2) * distance + self.position_per_second.powi(2) * duration;
        let rotation = self.rotation_per_metre.powi(2) * distance
            + self.rotation_per_radian.powi(2) * turned
            + self.rotation_per_second.powi(2) * duration;
        [position, position, position, rotation, rotation, rotation]
    }
}

impl Sensors3 {
    /// A camera at the robot's own place, with the defaults for all but classes and camera; labels are right with a
    /// probability, and wrong ones are equally likely.
    pub fn new(classes: Vec<String>, label_accuracy: f64, camera: Pinhole, baseline: f64) -> Self {
        Self {
            confusion: even_confusion(classes.len(), label_accuracy),
            classes,
            movable: Vec::new(),
            camera,
            baseline,
            reach: 0.0,
            robot_from_camera: Pose3::identity(),
            noise: PixelNoise::default(),
            detector: Detector3::default(),
            odometry: OdometryNoise3::default(),
        }
    }

    /// Whether such sensors can be.
    ///
    /// # Errors
    /// The first value that cannot be, with what could.
    pub fn validate(&self) -> Result<(), ConfigError> {
        validate_labels(&self.classes, &self.confusion, &self.movable)?;
        self.noise.check("noise")?;
        self.detector.check("detector")?;
        self.odometry.check("odometry")?;
        check("camera.baseline", self.baseline, 1e-6..=1e3)?;
        check("camera.reach", self.reach, 0.0..=1e3)?;
        self.camera.focal.into_iter().try_for_each(|focal| check("camera.focal", focal, 1e-3..=1e6))?;
        self.camera.centre.into_iter().try_for_each(|centre| check("camera.centre", centre, -1e6..=1e6))?;
        let position = self.robot_from_camera.position;
        position.iter().try_for_each(|number| check("camera.position", *number, -1e3..=1e3))
    }

    /// How far ahead of the camera the middle of an object is \[m\].
    pub fn depth(&self, seen: &Detection3) -> f64 {
        self.camera.focal[0] * self.baseline / seen.disparity + self.reach
    }

    /// Where the object of a detection is, in the robot's frame \[m\].
    pub fn position(&self, seen: &Detection3) -> Point3<f64> {
        let (ray, depth) = (self.camera.ray(seen.pixel.into()), self.depth(seen));
        self.robot_from_camera * Point3::new(ray.x * depth, ray.y * (depth - self.reach), depth)
    }
}

/// What tells how the robot moved, in the order of time.
#[derive(Clone, Debug, PartialEq)]
pub enum Odometry3 {
    /// Speeds in the robot's frame; each holds until the next one, and the last to the end. Before the first the robot
    /// stands still.
    Velocities(Vec<Velocity3>),
    /// Poses of the robot in a frame that drifts. Before the first and after the last the robot stands still.
    Poses(Vec<StampedPose3>),
}

/// How fast the robot moves and turns in its own frame, from a moment on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Velocity3 {
    /// Seconds.
    pub stamp: f64,
    /// Speed \[m/s\].
    pub linear: Vector3<f64>,
    /// Speed of the turn \[rad/s\].
    pub angular: Vector3<f64>,
}

impl Odometry3 {
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
    pub fn motion(&self, from: f64, to: f64) -> Motion<Pose3> {
        let none =
            Motion { start_from_end: Pose3::identity(), distance: 0.0, turned: 0.0, duration: (to - from).max(0.0) };
        if from >= to {
            return none;
        }
        let append = |motion: Motion<Pose3>, step: Pose3, distance: f64, turned: f64| Motion {
            start_from_end: motion.start_from_end * step,
            distance: motion.distance + distance,
            turned: motion.turned + turned,
            ..motion
        };
        match self {
            Self::Velocities(rows) => {
                let held = rows.partition_point(|row| row.stamp <= from).saturating_sub(1);
                let rows = rows.get(held..).unwrap_or_default();
                let ends = rows.iter().skip(1).map(|row| row.stamp).chain([f64::INFINITY]);
                let parts = rows.iter().zip(ends).take_while(|(row, _)| row.stamp < to);
                parts.fold(none, |motion, (Velocity3 { stamp, linear, angular }, end)| {
                    let seconds = end.min(to) - stamp.max(from);
                    let (moved, turned) = (linear * seconds, angular * seconds);
                    let twist = Vector6::from_iterator(moved.iter().chain(turned.iter()).copied());
                    append(motion, Pose3::exp(twist), moved.norm(), turned.norm())
                })
            }
            Self::Poses(rows) => {
                let (first, end) =
                    (rows.partition_point(|row| row.stamp <= from), rows.partition_point(|row| row.stamp < to));
                let between = rows.get(first..end).unwrap_or_default().iter().map(|row| row.pose);
                let mut last = pose_at(rows, from);
                between.chain([pose_at(rows, to)]).fold(none, |motion, pose| {
                    let step = pose.seen_from(std::mem::replace(&mut last, pose));
                    append(motion, step, step.position.coords.norm(), step.rotation.angle())
                })
            }
        }
    }

    /// Where the robot would be at each stamp \[s\] if odometry were right; the first one is the origin.
    pub fn dead_reckoning(&self, stamps: impl IntoIterator<Item = f64>) -> Vec<StampedPose3> {
        let mut last: Option<StampedPose3> = None;
        let mut reckon = |stamp| {
            let pose = last.map_or(Pose3::identity(), |last| last.pose * self.motion(last.stamp, stamp).start_from_end);
            *last.insert(StampedPose3 { stamp, pose })
        };
        stamps.into_iter().map(&mut reckon).collect()
    }
}

/// Between two rows, what lies between them.
fn pose_at(rows: &[StampedPose3], stamp: f64) -> Pose3 {
    let next = rows.partition_point(|row| row.stamp <= stamp);
    let (before, after) = (next.checked_sub(1).and_then(|before| rows.get(before)), rows.get(next));
    match (before, after) {
        (Some(before), Some(after)) => {
            let share = (stamp - before.stamp) / (after.stamp - before.stamp);
            before.pose * Pose3::exp(after.pose.seen_from(before.pose).log() * share)
        }
        (Some(only), None) | (None, Some(only)) => only.pose,
        (None, None) => Pose3::identity(),
    }
}

/// Everything that was recorded on one way through space.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording3 {
    /// The sensors and their noise.
    pub sensors: Sensors3,
    /// How the robot moved, in the order of time.
    pub odometry: Odometry3,
    /// What the detector saw; stamps rise strictly.
    pub frames: Vec<Frame<Detection3>>,
}

impl Recording3 {
    /// How many detections there are.
    pub fn detections(&self) -> usize {
        self.frames.iter().map(|frame| frame.detections.len()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    #[track_caller]
    fn assert_near(found: Pose3, position: [f64; 3], rotation: [f64; 3]) {
        let off = (found.position - Point3::from(position)).norm()
            + (found.rotation.scaled_axis() - Vector3::from(rotation)).norm();
        assert!(off < 1e-12, "{found:?} is not {position:?}, {rotation:?}");
    }

    /// A quarter of a circle of radius 2 m upwards, then 3 m straight on.
    #[test]
    fn speeds_hold_until_the_next_ones() {
        let speed = |stamp, ahead, pitch| Velocity3 {
            stamp,
            linear: Vector3::new(ahead, 0.0, 0.0),
            angular: Vector3::new(0.0, pitch, 0.0),
        };
        let odometry =
            Odometry3::Velocities(vec![speed(1.0, PI, -FRAC_PI_2), speed(2.0, 3.0, 0.0), speed(3.0, 0.0, 0.0)]);
        let whole = odometry.motion(0.0, 9.0);
        assert_near(whole.start_from_end, [2.0, 0.0, 5.0], [0.0, -FRAC_PI_2, 0.0]);
        assert!((whole.distance - PI - 3.0).abs() < 1e-12 && (whole.turned - FRAC_PI_2).abs() < 1e-12, "{whole:?}");
        let parts = [0.5, 1.3, 2.0, 2.9, 9.0].windows(2).map(|pair| odometry.motion(pair[0], pair[1]).start_from_end);
        let joined = parts.fold(Pose3::identity(), |pose, step| pose * step);
        assert_near(joined, [2.0, 0.0, 5.0], [0.0, -FRAC_PI_2, 0.0]);
        assert_eq!(odometry.motion(2.5, 2.0).start_from_end, Pose3::identity());
    }

    #[test]
    fn poses_are_joined() {
        let at = |stamp, x, roll: f64| {
            let rotation = nalgebra::UnitQuaternion::from_euler_angles(roll, 0.0, 0.0);
            StampedPose3 { stamp, pose: Pose3::new(Point3::new(x, 1.0, 2.0), rotation) }
        };
        let odometry = Odometry3::Poses(vec![at(0.0, 0.0, 0.5), at(2.0, 4.0, 0.5), at(3.0, 4.0, 1.5)]);
        let motion = odometry.motion(1.0, 2.5);
        assert_near(motion.start_from_end, [2.0, 0.0, 0.0], [0.5, 0.0, 0.0]);
        assert!((motion.distance - 2.0).abs() < 1e-12 && (motion.turned - 0.5).abs() < 1e-12, "{motion:?}");
        assert_near(odometry.motion(-1.0, 99.0).start_from_end, [4.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
    }

    /// An object 4 m ahead, 1 m to the right and 0.5 m down, by similar triangles.
    #[test]
    fn a_detection_tells_the_place() {
        let camera = Pinhole { focal: [500.0, 400.0], centre: [320.0, 240.0] };
        let sensors = Sensors3::new(vec!["box".to_owned()], 1.0, camera, 0.2);
        let seen = Detection3 { class: 0, score: 1.0, pixel: [320.0 + 125.0, 240.0 + 50.0], disparity: 25.0 };
        assert!((sensors.position(&seen) - Point3::new(1.0, 0.5, 4.0)).norm() < 1e-12);
        let deep = Sensors3 { reach: 1.0, ..sensors.clone() };
        assert!((deep.position(&seen) - Point3::new(1.25, 0.5, 5.0)).norm() < 1e-12);
        assert!(sensors.validate().is_ok() && Sensors3 { baseline: 0.0, ..sensors }.validate().is_err());
    }
}
