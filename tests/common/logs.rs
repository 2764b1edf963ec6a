//! Entries of logs, read to the end and compared.

use ipslam::geometry::{Pose, wrap_angle};
use ipslam::log::{LogEntry, LogError, LogReader, LogStats};

/// What a reader told.
pub struct Outcome {
    pub entries: Vec<LogEntry>,
    pub error: Option<LogError>,
    pub stats: LogStats,
}

/// Reads to the end, behind which there has to be nothing.
pub fn drain(reader: &mut dyn LogReader) -> Outcome {
    let mut outcome = Outcome { entries: Vec::new(), error: None, stats: LogStats::default() };
    for entry in &mut *reader {
        assert!(outcome.error.is_none(), "an entry after an error");
        match entry {
            Ok(entry) => outcome.entries.push(entry),
            Err(error) => outcome.error = Some(error),
        }
    }
    assert!(reader.next().is_none(), "an entry after the end");
    outcome.stats = reader.stats().clone();
    outcome
}

/// Each number within a tolerance \[m, m, rad\].
pub fn same_pose(a: Pose, b: Pose, tolerance: f64) -> bool {
    (a.x - b.x).abs() <= tolerance
        && (a.y - b.y).abs() <= tolerance
        && wrap_angle(a.heading - b.heading).abs() <= tolerance
}

/// Every number; stamps and ranges bit for bit, poses and the angles of beams each within a tolerance.
pub fn same(a: &LogEntry, b: &LogEntry, tolerance: f64, angle_tolerance: f64) -> bool {
    match (a, b) {
        (
            LogEntry::Odometry { stamp, odom_from_robot },
            LogEntry::Odometry { stamp: other_stamp, odom_from_robot: other },
        ) => stamp == other_stamp && same_pose(*odom_from_robot, *other, tolerance),
        (
            LogEntry::Truth { stamp, world_from_robot },
            LogEntry::Truth { stamp: other_stamp, world_from_robot: other },
        ) => stamp == other_stamp && same_pose(*world_from_robot, *other, tolerance),
        (LogEntry::Laser(a), LogEntry::Laser(b)) => {
            let bits = |ranges: &[f64]| ranges.iter().map(|range| range.to_bits()).collect::<Vec<_>>();
            a.stamp == b.stamp
                && same_pose(a.odom_from_robot, b.odom_from_robot, tolerance)
                && same_pose(a.robot_from_laser, b.robot_from_laser, tolerance)
                && same_pose(a.start_from_end, b.start_from_end, tolerance)
                && (a.first_angle - b.first_angle).abs() <= angle_tolerance
                && (a.angle_step - b.angle_step).abs() <= angle_tolerance
                && a.max_range == b.max_range
                && bits(&a.ranges) == bits(&b.ranges)
        }
        _ => false,
    }
}
