//! Any bytes as a ROS 2 bag: reading ends, never panics, and hands out only entries that the rest can rely on.
//!
//! `cargo +nightly fuzz run mcap fuzz/corpus/mcap fuzz/seeds/mcap -- -max_total_time=60`

#![no_main]

use ipslam::geometry::Pose;
use ipslam::io::mcap::{ImuTopic, McapLog, Topics};
use ipslam::log::{LogEntry, LogReader, LogSource as _};
use libfuzzer_sys::fuzz_target;
use std::f64::consts::PI;
use std::path::PathBuf;
use std::sync::LazyLock;

/// A bag is read twice, so it has to be a file.
static BAG: LazyLock<PathBuf> =
    LazyLock::new(|| std::env::temp_dir().join(format!("ipslam-fuzz-{}.mcap", std::process::id())));

fn is_sound(pose: Pose) -> bool {
    pose.is_finite() && pose.heading > -PI && pose.heading <= PI
}

fn check(reader: &mut dyn LogReader) {
    let (mut laser, mut odometry, mut failed) = (0, 0, false);
    for entry in &mut *reader {
        assert!(!failed, "an entry after an error");
        match entry {
            Err(error) => {
                assert!(!error.to_string().is_empty());
                failed = true;
            }
            Ok(LogEntry::Odometry { stamp, odom_from_robot }) => {
                odometry += 1;
                assert!(stamp.is_finite() && is_sound(odom_from_robot));
            }
            Ok(LogEntry::Turn { stamp, by_gyro }) => assert!(stamp.is_finite() && by_gyro.is_finite()),
            Ok(LogEntry::Truth { .. }) => panic!("a bag has no truth"),
            Ok(LogEntry::Laser(reading)) => {
                laser += 1;
                assert!(reading.stamp.is_finite());
                assert!(is_sound(reading.odom_from_robot) && is_sound(reading.robot_from_laser));
                assert!(reading.first_angle.is_finite() && reading.angle_step.is_finite());
                assert!(reading.max_range > 0.0 && !reading.ranges.is_empty());
            }
        }
    }
    assert!(reader.next().is_none(), "an entry after the end");
    let stats = reader.stats();
    assert!((stats.laser, stats.odometry) == (laser, odometry));
    assert!(stats.first_malformed.is_some() == (stats.malformed > 0));
    assert!(stats.laser_without_odometry <= laser && stats.laser_without_mounting <= laser);
}

fuzz_target!(|data: &[u8]| {
    if std::fs::write(&*BAG, data).is_err() {
        return;
    }
    // Where there are several topics, these.
    let chosen = Topics { scan: vec!["/scan".to_owned()], odometry: Some("/odom".to_owned()), imu: ImuTopic::Named("/imu".to_owned()) };
    for topics in [Topics::default(), chosen] {
        match McapLog::new(&*BAG, &topics) {
            Ok(log) => log.open().map_or((), |mut reader| check(&mut *reader)),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
});
