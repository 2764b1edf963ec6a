//! A laser reading as points in the robot's frame.

use crate::geometry::Pose;
use crate::log::LaserReading;
use crate::parameters::{ConfigError, parameters};
use nalgebra::Point2;

parameters! {
    /// Which ranges count.
    pub struct ScanConfig {
        /// Shorter ranges are no measurement \[m\].
        min_range: f64 = 0.1, in 0.0..=1e6;
        /// Ranges from here on are not used, or no return \[m\].
        max_range: f64 = 30.0, in 0.0..=f64::INFINITY;
    }
}

impl ScanConfig {
    /// Whether its numbers are in their ranges, and leave some.
    pub(crate) fn validate(&self) -> Result<(), ConfigError> {
        self.check("scan")?;
        let Self { min_range, max_range } = *self;
        if min_range >= max_range {
            return Err(ConfigError::value("scan.max_range", max_range, format!("above scan.min_range, {min_range}")));
        }
        Ok(())
    }
}

/// The points of one laser sweep.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scan {
    /// Seconds.
    pub stamp: f64,
    /// End points of the beams that hit something, in the robot's frame \[m\], in the order of the beams.
    pub points: Vec<Point2<f64>>,
    /// Beams without return: at or above the maximum range, or +∞ (REP 117).
    pub no_return: usize,
    /// Beams whose range is no measurement: NaN, negative, or below the minimum range.
    pub invalid: usize,
}

impl Scan {
    /// Turns ranges into points, leaving out those that do not count.
    ///
    /// The reading's own maximum, where it is lower, counts as well.
    pub fn from_reading(reading: &LaserReading, config: &ScanConfig) -> Self {
        let ScanConfig { min_range, max_range } = *config;
        let max_range = max_range.min(reading.max_range);
        let mut scan = Scan { stamp: reading.stamp, ..Scan::default() };
        let sweep = Sweep { start_from_end: reading.start_from_end, beams: reading.ranges.len() };
        let moves = reading.start_from_end != Pose::IDENTITY;
        for (beam, &range) in reading.ranges.iter().enumerate() {
            if range.is_nan() || range < min_range {
                scan.invalid += 1;
            } else if range >= max_range {
                scan.no_return += 1;
            } else {
                let (sin, cos) = (reading.first_angle + beam as f64 * reading.angle_step).sin_cos();
                let point = reading.robot_from_laser * Point2::new(range * cos, range * sin);
                scan.points.push(if moves { sweep.at(beam) * point } else { point });
            }
        }
        scan
    }
}

/// Where the robot is at each beam of a sweep, seen from where it is at the first.
struct Sweep {
    start_from_end: Pose,
    beams: usize,
}

impl Sweep {
    /// At an even speed: position and heading change in proportion to the beams.
    fn at(&self, beam: usize) -> Pose {
        let share = beam as f64 / self.beams.saturating_sub(1).max(1) as f64;
        let Pose { x, y, heading } = self.start_from_end;
        Pose::new(share * x, share * y, share * heading)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn only_measurements_become_points() {
        let reading = LaserReading {
            stamp: 3.0,
            odom_from_robot: Pose::IDENTITY,
            robot_from_laser: Pose::new(0.1, 0.0, 0.0),
            start_from_end: Pose::IDENTITY,
            first_angle: -FRAC_PI_2,
            angle_step: FRAC_PI_2,
            max_range: 80.0,
            ranges: vec![1.0, 2.0, 3.0, f64::NAN, f64::INFINITY, -1.0, 0.01, 81.0, 35.0],
        };
        let scan = Scan::from_reading(&reading, &ScanConfig { min_range: 0.05, max_range: 30.0 });
        let expected = [(0.1, -1.0), (2.1, 0.0), (0.1, 3.0)];
        assert_eq!(scan.points.len(), expected.len());
        for (point, (x, y)) in scan.points.iter().zip(expected) {
            assert!((point.x - x).abs() < 1e-12 && (point.y - y).abs() < 1e-12, "{point} is not ({x}, {y})");
        }
        assert_eq!((scan.invalid, scan.no_return), (3, 3));
    }

    /// A robot that turns by a quarter while its laser sweeps sees a point ahead of it, each time, somewhere else.
    #[test]
    fn a_sweep_that_takes_time_is_moved_to_one_instant() {
        let reading = LaserReading {
            stamp: 0.0,
            odom_from_robot: Pose::IDENTITY,
            robot_from_laser: Pose::IDENTITY,
            start_from_end: Pose::new(1.0, 0.0, FRAC_PI_2),
            first_angle: 0.0,
            angle_step: 0.0,
            max_range: 80.0,
            ranges: vec![2.0; 3],
        };
        let scan = Scan::from_reading(&reading, &ScanConfig::default());
        let half = std::f64::consts::SQRT_2;
        for (point, (x, y)) in scan.points.iter().zip([(2.0, 0.0), (0.5 + half, half), (1.0, 2.0)]) {
            assert!((point.x - x).abs() < 1e-12 && (point.y - y).abs() < 1e-12, "{point} is not ({x}, {y})");
        }
    }
}
