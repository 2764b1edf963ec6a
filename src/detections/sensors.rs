//! What is known about the sensors of a recording.

use super::odometry::Motion;
use crate::geometry::Pose;
use crate::parameters::{ConfigError, check, parameters};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// What a detection is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum DetectionKind {
    /// Range and bearing in the plane.
    #[default]
    RangeBearing,
    /// Pixels and disparity, in space.
    Stereo,
}

/// The sensors of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensors {
    /// What a detection is.
    pub kind: DetectionKind,
    /// Names of the classes.
    pub classes: Vec<String>,
    /// Probability of a label: a row for each true class, a column for each class that the detector names. Rows sum
    /// to 1.
    pub confusion: Vec<Vec<f64>>,
    /// Numbers of the classes whose objects may move; those that do are not mapped.
    pub movable: Vec<usize>,
    /// Where the detector is mounted.
    pub robot_from_sensor: Pose,
    /// Errors of ranges and bearings.
    pub noise: DetectionNoise,
    /// What the detector can see.
    pub view: View,
    /// How often it misses and invents objects.
    pub detector: Detector,
    /// Errors of the odometry.
    pub odometry: OdometryNoise,
}

parameters! {
    /// Errors of ranges and bearings, as standard deviations.
    pub struct DetectionNoise {
        /// Of ranges \[m\].
        range: f64 = 0.1, in 1e-6..=1e3;
        /// Of bearings \[rad\].
        bearing: f64 = 0.02, in 1e-6..=3.2;
        /// Of the position, the same in every direction \[m\]; comes on top of both.
        position: f64 = 0.0, in 0.0..=1e3;
    }
}

impl DetectionNoise {
    /// Standard deviations of range \[m\] and bearing \[rad\] at a range \[m\].
    pub fn at(&self, range: f64) -> [f64; 2] {
        [self.range.hypot(self.position), self.bearing.hypot(self.position / range)]
    }
}

parameters! {
    /// What the detector can see.
    pub struct View {
        /// The nearest that it sees \[m\].
        min_range: f64 = 0.0, in 0.0..=1e6;
        /// The farthest that it sees \[m\].
        max_range: f64 = f64::INFINITY, in 0.0..=f64::INFINITY;
        /// The rightmost bearing that it sees \[rad\].
        min_bearing: f64 = -PI, in -3.2..=3.2;
        /// The leftmost bearing that it sees \[rad\].
        max_bearing: f64 = PI, in -3.2..=3.2;
    }
}

impl View {
    /// Whether it sees a range \[m\] and bearing \[rad\].
    pub fn holds(&self, range: f64, bearing: f64) -> bool {
        (self.min_range..=self.max_range).contains(&range) && (self.min_bearing..=self.max_bearing).contains(&bearing)
    }
}

parameters! {
    /// How often the detector misses and invents objects.
    pub struct Detector {
        /// Probability that an object in view is detected.
        detection_probability: f64 = 0.9, in 1e-3..=0.999;
        /// Expected false detections of a frame, per metre of range and radian of bearing \[1/(m rad)\].
        clutter_density: f64 = 0.003, in 1e-9..=1e3;
    }
}

parameters! {
    /// Errors of the odometry, which grow with the way and with time, as standard deviations.
    pub struct OdometryNoise {
        /// Ahead, after one metre \[m/√m\].
        forward_per_metre: f64 = 0.05, in 0.0..=10.0;
        /// Sideways, after one metre \[m/√m\].
        sideways_per_metre: f64 = 0.02, in 0.0..=10.0;
        /// Of the heading, after one metre \[rad/√m\].
        heading_per_metre: f64 = 0.03, in 0.0..=10.0;
        /// Of the heading, after turning by one radian \[rad/√rad\].
        heading_per_radian: f64 = 0.05, in 0.0..=10.0;
        /// Ahead and sideways, after one second \[m/√s\].
        position_per_second: f64 = 0.001, in 0.0..=10.0;
        /// Of the heading, after one second \[rad/√s\].
        heading_per_second: f64 = 0.001, in 0.0..=10.0;
    }
}

impl OdometryNoise {
    /// Variances of the end of a motion in the frame of its start, where it is small: ahead \[m²\], sideways \[m²\],
    /// heading \[rad²\].
    pub fn variances(&self, motion: &Motion) -> [f64; 3] {
        let Motion { distance, turned, duration, .. } = *motion;
        let waiting = self.position_per_second.powi(2) * duration;
        [
            self.forward_per_metre.powi(2) * distance + waiting,
            self.sideways_per_metre.powi(2) * distance + waiting,
            self.heading_per_metre.powi(2) * distance
                + self.heading_per_radian.powi(2) * turned
                + self.heading_per_second.powi(2) * duration,
        ]
    }
}

impl Sensors {
    /// Sensors with the defaults for all but the classes; labels are right with a probability, and wrong ones are
    /// equally likely.
    pub fn new(classes: Vec<String>, label_accuracy: f64) -> Self {
        Self {
            kind: DetectionKind::default(),
            confusion: even_confusion(classes.len(), label_accuracy),
            classes,
            movable: Vec::new(),
            robot_from_sensor: Pose::IDENTITY,
            noise: DetectionNoise::default(),
            view: View::default(),
            detector: Detector::default(),
            odometry: OdometryNoise::default(),
        }
    }

    /// Whether such sensors can be.
    ///
    /// # Errors
    /// The first value that cannot be, with what could.
    pub fn validate(&self) -> Result<(), ConfigError> {
        validate_labels(&self.classes, &self.confusion, &self.movable)?;
        self.noise.check("noise")?;
        self.view.check("view")?;
        self.detector.check("detector")?;
        self.odometry.check("odometry")?;
        let Pose { x, y, heading } = self.robot_from_sensor;
        for (name, value) in [("mounting.x", x), ("mounting.y", y), ("mounting.heading", heading)] {
            check(name, value, f64::MIN..=f64::MAX)?;
        }
        let View { min_range, max_range, min_bearing, max_bearing } = self.view;
        if max_range <= min_range {
            return Err(ConfigError::value("view.max_range", max_range, format!("above min_range, {min_range}")));
        }
        if max_bearing <= min_bearing {
            return Err(ConfigError::value(
                "view.max_bearing",
                max_bearing,
                format!("above min_bearing, {min_bearing}"),
            ));
        }
        Ok(())
    }
}

/// Whether classes and the probabilities of their labels can be.
pub(super) fn validate_labels(
    classes: &[String],
    confusion: &[Vec<f64>],
    movable: &[usize],
) -> Result<(), ConfigError> {
    check_classes(classes)?;
    let count = classes.len();
    if let Some(class) = movable.iter().find(|class| **class >= count) {
        return Err(ConfigError::value("movable", class, format!("numbers of classes, of which there are {count}")));
    }
    if confusion.len() != count || confusion.iter().any(|row| row.len() != count) {
        let expected = format!("{count} rows of {count} numbers, as there are {count} classes");
        return Err(ConfigError::value("confusion", "of another size", expected));
    }
    for (row, name) in confusion.iter().zip(classes) {
        let sum: f64 = row.iter().sum();
        if row.iter().any(|share| !(0.0..=1.0).contains(share)) || (sum - 1.0).abs() > 1e-3 {
            let expected =
                format!("numbers from 0 to 1 whose sum in each row is 1; in the row of `{name}` it is {sum}");
            return Err(ConfigError::value("confusion", format!("{row:?} for `{name}`"), expected));
        }
    }
    Ok(())
}

fn check_classes(classes: &[String]) -> Result<(), ConfigError> {
    if classes.is_empty() {
        return Err(ConfigError::value("classes", "[]", "the names of one class or more"));
    }
    for (number, name) in classes.iter().enumerate() {
        if name.is_empty() || name.trim() != name || name.contains(char::is_control) {
            let expected = "names without white space around them and without line breaks";
            return Err(ConfigError::value("classes", format!("{name:?}"), expected));
        }
        if classes.iter().take(number).any(|other| other == name) {
            return Err(ConfigError::value("classes", format!("`{name}` twice"), "a list of names that differ"));
        }
    }
    Ok(())
}

/// Labels that are right with a probability; the wrong ones are equally likely.
pub(super) fn even_confusion(classes: usize, accuracy: f64) -> Vec<Vec<f64>> {
    let (right, wrong) = match classes {
        1 => (1.0, 0.0),
        _ => (accuracy, (1.0 - accuracy) / classes.saturating_sub(1) as f64),
    };
    let row = |class| (0..classes).map(|label| if label == class { right } else { wrong }).collect();
    (0..classes).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensors() -> Sensors {
        Sensors::new(["tree", "car", "door"].map(str::to_owned).to_vec(), 0.9)
    }

    #[test]
    fn wrong_labels_are_equally_likely() {
        assert_eq!(sensors().confusion[1].iter().map(|p| (p * 1e9).round()).collect::<Vec<_>>(), [5e7, 9e8, 5e7]);
        assert_eq!(Sensors::new(vec!["disc".to_owned()], 0.9).confusion, [[1.0]]);
        sensors().validate().unwrap();
    }

    #[test]
    fn noise_of_the_position_matters_nearby() {
        let noise = DetectionNoise { range: 0.03, bearing: 0.03, position: 0.04 };
        let [range, bearing] = noise.at(1.0);
        assert!((range - 0.05).abs() < 1e-12 && (bearing - 0.05).abs() < 1e-12, "{range} {bearing}");
        assert!((noise.at(1e6)[1] - 0.03).abs() < 1e-9);
    }

    #[test]
    fn variances_grow_with_the_way_and_with_time() {
        let noise = OdometryNoise::default();
        let motion = Motion { distance: 2.0, turned: 3.0, duration: 4.0, ..Motion::default() };
        let twice = Motion { distance: 4.0, turned: 6.0, duration: 8.0, ..Motion::default() };
        for (once, twice) in noise.variances(&motion).iter().zip(noise.variances(&twice)) {
            assert!(*once > 0.0 && (twice - 2.0 * once).abs() < 1e-15, "{once} {twice}");
        }
        let waited = noise.variances(&Motion { duration: 1.0, ..Motion::default() });
        assert_eq!(waited, [0.001f64.powi(2); 3]);
    }

    #[test]
    fn what_cannot_be_is_told() {
        type Change = fn(&mut Sensors);
        let changes: [(Change, &str); 8] = [
            (|s| s.classes.clear(), "classes"),
            (|s| s.classes[1] = "tree".to_owned(), "`tree` twice"),
            (|s| s.classes[0] = " tree".to_owned(), "white space"),
            (|s| s.confusion[2][0] = 0.5, "whose sum in each row is 1"),
            (|s| s.confusion.truncate(2), "3 rows of 3 numbers"),
            (|s| s.noise.range = f64::NAN, "noise.range is NaN"),
            (|s| s.view.max_bearing = -3.3, "view.max_bearing"),
            (|s| s.robot_from_sensor.x = f64::INFINITY, "mounting.x"),
        ];
        for (change, expected) in changes {
            let mut sensors = sensors();
            change(&mut sensors);
            let message = sensors.validate().unwrap_err().to_string();
            assert!(message.contains(expected), "{message:?} does not say {expected:?}");
        }
    }
}
