//! Any bytes as a CARMEN log: reading ends, never panics, and hands out only entries that the rest can rely on.
//!
//! `cargo +nightly fuzz run carmen fuzz/corpus/carmen fuzz/seeds/carmen -- -max_total_time=60`

#![no_main]

use ipslam::geometry::Pose;
use ipslam::io::carmen::{CarmenReader, CarmenWriter};
use ipslam::log::{LogEntry, LogReader as _};
use libfuzzer_sys::fuzz_target;
use std::f64::consts::PI;
use std::io::Cursor;

fn is_sound(pose: Pose) -> bool {
    pose.is_finite() && pose.heading > -PI && pose.heading <= PI
}

fuzz_target!(|data: &[u8]| {
    let Ok(mut reader) = CarmenReader::from_reader("fuzz", Cursor::new(data.to_vec())) else { return };
    let mut writer = CarmenWriter::new(Vec::new());
    let (mut entries, mut laser, mut odometry, mut failed) = (0_u64, 0, 0, false);
    for entry in reader.by_ref() {
        assert!(!failed, "an entry after an error");
        let entry = match entry {
            Ok(entry) => entry,
            Err(error) => {
                assert!(!error.to_string().is_empty());
                failed = true;
                continue;
            }
        };
        entries += 1;
        match &entry {
            LogEntry::Odometry { stamp, odom_from_robot } => {
                odometry += 1;
                assert!(stamp.is_finite() && is_sound(*odom_from_robot));
            }
            LogEntry::Truth { stamp, world_from_robot } => assert!(stamp.is_finite() && is_sound(*world_from_robot)),
            LogEntry::Turn { .. } => panic!("a CARMEN log has no gyroscope"),
            LogEntry::Laser(reading) => {
                laser += 1;
                assert!(reading.stamp.is_finite());
                assert!(is_sound(reading.odom_from_robot) && is_sound(reading.robot_from_laser));
                assert!(reading.first_angle.is_finite() && reading.angle_step.is_finite());
                assert!(reading.max_range > 0.0 && !reading.ranges.is_empty());
            }
        }
        // The pose of the laser can be too large for a number; all else can be written.
        assert!(writer.write(&entry).is_ok() || matches!(entry, LogEntry::Laser(_)));
    }
    assert!(reader.next().is_none(), "an entry after the end");
    let stats = reader.stats();
    assert!((stats.laser, stats.odometry) == (laser, odometry) && stats.malformed <= stats.lines);
    assert!(entries <= stats.lines && stats.first_malformed.is_some() == (stats.malformed > 0));
});
