//! The CARMEN log reader and writer, from outside: tables of lines, damaged files, real logs, round trips.

use crate::logs::{Outcome, drain, same_pose};
use crate::needs::data;
use flate2::{Compression, write::GzEncoder};
use ipslam::geometry::Pose;
use ipslam::io::carmen::{CarmenLog, CarmenReader, CarmenWriter, implied_angles};
use ipslam::io::mcap::Topics;
use ipslam::io::{Stream, open_stream};
use ipslam::log::{LaserReading, LogEntry, LogError, LogSource as _};
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};
use std::io::{Cursor, Read, Write as _};

/// Numbers are written with all their digits; the laser's pose is a sum, rounded within 100 km of the origin.
const TOLERANCE: f64 = 1e-9;

fn same(a: &LogEntry, b: &LogEntry) -> bool {
    crate::logs::same(a, b, TOLERANCE, TOLERANCE)
}

fn read_from(bytes: impl Read + Send + 'static) -> Outcome {
    drain(&mut CarmenReader::from_reader("test.clf", bytes).unwrap())
}

fn read(bytes: impl AsRef<[u8]>) -> Outcome {
    read_from(Cursor::new(bytes.as_ref().to_vec()))
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// One laser reading of three beams a right angle apart, which is what `FLASER 3` implies.
fn three_beams(stamp: f64, odom_from_robot: Pose, robot_from_laser: Pose, ranges: [f64; 3]) -> LaserReading {
    LaserReading {
        stamp,
        odom_from_robot,
        robot_from_laser,
        start_from_end: Pose::IDENTITY,
        first_angle: -FRAC_PI_2,
        angle_step: FRAC_PI_2,
        max_range: f64::INFINITY,
        ranges: ranges.to_vec(),
    }
}

fn good_lines() {
    let robot = Pose::new(1.0, 2.0, FRAC_PI_2);
    // A laser 0.5 m ahead of a robot that looks along y is 0.5 m further in y.
    let ahead = Pose::new(0.5, 0.0, 0.0);
    let with_angles = |robot_from_laser, odom_from_robot| {
        LogEntry::Laser(LaserReading {
            stamp: 10.5,
            odom_from_robot,
            robot_from_laser,
            start_from_end: Pose::IDENTITY,
            first_angle: -1.0,
            angle_step: 0.5,
            max_range: 8.0,
            ranges: vec![1.0, 2.0, 3.0],
        })
    };
    let flaser = |mounting, ranges| LogEntry::Laser(three_beams(10.5, robot, mounting, ranges));
    let backward = Pose::new(0.0, 0.0, PI);
    let table: [(&str, LogEntry); 12] = [
        (
            "ODOM 1 2 1.5707963267948966 0.1 0.2 0.3 10.5 host 0.5",
            LogEntry::Odometry { stamp: 10.5, odom_from_robot: robot },
        ),
        (
            "TRUEPOS 3 4 0.5 1 2 1.5 10.5 host 0.5",
            LogEntry::Truth { stamp: 10.5, world_from_robot: Pose::new(3.0, 4.0, 0.5) },
        ),
        (
            "FLASER 3 1 2 3 1 2 1.5707963267948966 1 2 1.5707963267948966 10.5 host 0.5",
            flaser(Pose::IDENTITY, [1.0, 2.0, 3.0]),
        ),
        (
            "FLASER 3 1 2 3 1 2.5 1.5707963267948966 1 2 1.5707963267948966 10.5 host 0.5",
            flaser(ahead, [1.0, 2.0, 3.0]),
        ),
        (
            "  FLASER\t3  -1 nan inf 1 2 1.5707963267948966 1 2 1.5707963267948966 10.5 h\u{f6}st 0.5 \r",
            flaser(Pose::IDENTITY, [-1.0, f64::NAN, f64::INFINITY]),
        ),
        (
            "RLASER 3 1 2 3 1 2 1.5707963267948966 1 2 1.5707963267948966 10.5 host 0.5",
            flaser(backward, [1.0, 2.0, 3.0]),
        ),
        (
            "RLASER 3 1 2 3 1 1.5 -1.5707963267948966 1 2 1.5707963267948966 10.5 host 0.5",
            flaser(Pose::new(-0.5, 0.0, PI), [1.0, 2.0, 3.0]),
        ),
        (
            "ROBOTLASER1 0 -1 1 0.5 8 0.01 0 3 1 2 3 0 1 2.5 1.5707963267948966 1 2 1.5707963267948966 \
             0.1 0.2 0.3 0.4 1e6 10.5 host 0.5",
            with_angles(ahead, robot),
        ),
        (
            "ROBOTLASER2 0 -1 1 0.5 8 0.01 2 3 1 2 3 2 77 78 1 2 1.5707963267948966 1 2 1.5707963267948966 \
             0.1 0.2 0.3 0.4 1e6 10.5 host 0.5",
            with_angles(backward, robot),
        ),
        ("RAWLASER1 0 -1 1 0.5 8 0.01 0 3 1 2 3 0 10.5 host 0.5", with_angles(Pose::IDENTITY, Pose::IDENTITY)),
        ("RAWLASER2 0 -1 1 0.5 8 0.01 0 3 1 2 3 1 9 10.5 host 0.5", with_angles(backward, Pose::IDENTITY)),
        ("RAWLASER4 0 -1 1 0.5 8 0.01 0 3 1 2 3 0 10.5 host 0.5", with_angles(Pose::IDENTITY, Pose::IDENTITY)),
    ];
    for (line, expected) in table {
        // With and without the line's end; plain and gzip.
        for bytes in [line.as_bytes().to_vec(), format!("{line}\n").into_bytes(), gzip(line.as_bytes())] {
            let outcome = read(bytes);
            assert!(outcome.error.is_none(), "{line}: {:?}", outcome.error);
            assert_eq!(outcome.entries.len(), 1, "{line}: {:?}", outcome.stats);
            assert!(same(&outcome.entries[0], &expected), "{line}: {:?}, not {expected:?}", outcome.entries[0]);
            assert_eq!((outcome.stats.malformed, outcome.stats.lines), (0, 1), "{line}");
        }
    }
}

fn malformed_lines_are_left_out_and_counted() {
    let before = "ODOM 0 0 0 0 0 0 1 host 0";
    let after = "ODOM 0 0 0 0 0 0 2 host 0";
    let long = format!("ODOM 0 0 0 0 0 0 1 {} 0", "h".repeat(1 << 20));
    let table: [(&[u8], &str); 25] = [
        (b"ODOM 0 0 0 0 0 0 1 host", "9 fields should follow, 8 do"),
        (b"ODOM 0 0 0 0 0 0 1 host 0 0", "9 fields should follow, 10 do"),
        (b"ODOM 0 0 0 0 0 0 1.5.2 host 0", "ipc_timestamp is no number: `1.5.2`"),
        (b"ODOM 0 0 0 0 0 0 inf host 0", "ipc_timestamp is not finite"),
        (b"ODOM nan 0 0 0 0 0 1 host 0", "the pose is not finite"),
        (b"ODOM 0 0 inf 0 0 0 1 host 0", "the pose is not finite"),
        (b"ODOM 0 0 1e300 0 0 0 1 host 0", "the pose has no angle"),
        (b"ODOM 0,5 0 0 0 0 0 1 host 0", "the pose is no number: `0,5`"),
        (b"ODOM \xff\xfe 0 0 0 0 0 1 host 0", "the pose is no number"),
        (b"TRUEPOS 0 0 0 0 0 0 1 host", "9 fields should follow, 8 do"),
        (b"TRUEPOS 0 0 nan 0 0 0 1 host 0", "the true pose is not finite"),
        (b"FLASER", "the line ends before num_readings"),
        (b"FLASER 0 0 0 0 0 0 0 1 host 0", "no beams"),
        (b"FLASER -3 1 2 3 0 0 0 0 0 0 1 host 0", "num_readings is no whole number: `-3`"),
        (b"FLASER 4 1 2 3 0 0 0 0 0 0 1 host 0", "13 fields should follow, 12 do"),
        (b"FLASER 2 1 2 3 0 0 0 0 0 0 1 host 0", "11 fields should follow, 12 do"),
        (b"FLASER 18446744073709551615 1 0 0 0 0 0 0 1 host 0", "fields should follow, 10 do"),
        (b"FLASER 3 1 x 3 0 0 0 0 0 0 1 host 0", "a range is no number: `x`"),
        (b"FLASER 3 1 2 3 0 0 0 0 nan 0 1 host 0", "the robot's pose is not finite"),
        (b"FLASER 1 1 1e308 0 0 -1e308 0 0 1 host 0", "too far apart"),
        (b"RAWLASER1 0 -1 1 0.5 8 0.01 0 9 1 2 3 0 10.5 host 0.5", "9 ranges and more should follow, 7 fields do"),
        (b"RAWLASER1 0 -1 1 0 8 0.01 0 3 1 2 3 0 10.5 host 0.5", "angular_resolution is zero"),
        (b"ROBOTLASER1 0 -1 1 0.5 8 0.01 0 1 1 0 0 0 0 0 0 0 1 host 0", "14 fields should follow, 9 do"),
        (b"PARAM robot_front_laser_max far host 0", "robot_front_laser_max is no number: `far`"),
        (b"Odometry 0 0 0", "no CARMEN message begins with `Odometry`"),
    ];
    for (line, reason) in table.into_iter().chain([(long.as_bytes(), "longer than 1048576 bytes")]) {
        let shown = String::from_utf8_lossy(&line[..line.len().min(80)]);
        let outcome = read([before.as_bytes(), line, after.as_bytes()].join(&b'\n'));
        assert_eq!(outcome.entries.len(), 2, "{shown}: {:?}", outcome.stats);
        assert!(outcome.error.is_none(), "{shown}");
        assert_eq!((outcome.stats.malformed, outcome.stats.lines), (1, 3), "{shown}");
        let message = outcome.stats.first_malformed.unwrap();
        assert!(message.starts_with("test.clf:2: ") && message.contains(reason), "{shown}: {message}");
        assert!(message.len() < 200, "{message}");
    }
}

fn bytes_that_are_no_text_do_not_stop_reading() {
    let outcome = read(b"# \xff\xfe\nODOM 0 0 0 0 0 0 1 h\xf6st 0\n\xff\x00\x80\n\x00\nODOM 0 0 0 0 0 0 2 host 0\n");
    assert!(outcome.error.is_none());
    assert_eq!((outcome.entries.len(), outcome.stats.malformed, outcome.stats.lines), (2, 2, 5));
}

fn only_the_first_malformed_line_is_kept() {
    let outcome = read("# comment\n\nODOM 0\nODOM 1\nODOM 0 0 0 0 0 0 1 host 0\n");
    assert_eq!((outcome.stats.malformed, outcome.stats.lines, outcome.entries.len()), (2, 5, 1));
    assert!(outcome.stats.first_malformed.unwrap().starts_with("test.clf:3: "));
}

fn a_cut_line_is_no_whole_one() {
    let line = "FLASER 3 1.25 2.5 3.75 0.5 0.5 0.25 0.5 0.5 0.25 10.5 host 0.125";
    let last_word = line.rfind(' ').unwrap();
    for length in 7..=last_word {
        let outcome = read(format!("SYNC\n{}", &line[..length]));
        assert_eq!((outcome.entries.len(), outcome.stats.malformed), (0, 1), "cut after {length} bytes");
    }
    assert_eq!(read(line).entries.len(), 1);
}

fn angles_follow_from_the_number_of_beams() {
    // Degrees, from the lasers' manuals: SICK LMS modes, a 270 degree SICK at half a degree.
    let table = [
        (180, -90.0, 1.0),
        (181, -90.0, 1.0),
        (360, -90.0, 0.5),
        (361, -90.0, 0.5),
        (401, -50.0, 0.25),
        (541, -135.0, 0.5),
        (91, -90.0, 2.0),
    ];
    for (beams, first, step) in table {
        let line = format!("FLASER {beams} {} 0 0 0 0 0 0 1 host 0", "1 ".repeat(beams));
        let [LogEntry::Laser(reading)] = &read(line).entries[..] else { panic!("{beams} beams: no reading") };
        assert_eq!(reading.ranges.len(), beams);
        assert!((reading.first_angle.to_degrees() - first).abs() < 1e-9, "{beams}: {}", reading.first_angle);
        assert!((reading.angle_step.to_degrees() - step).abs() < 1e-9, "{beams}: {}", reading.angle_step);
    }
    for beams in [0, 1] {
        assert!(implied_angles(beams).1.is_finite());
    }
}

fn parameters_mount_the_lasers() {
    let log = "PARAM robot_frontlaser_offset 0.2 nohost 0\n\
               PARAM robot_front_laser_max 80.9 1134863807.6 b21 1134863807.6\n\
               PARAM robot_rearlaser_offset -0.3 nohost 0\n\
               PARAM robot_rearlaser_side_offset 0.1 nohost 0\n\
               PARAM robot_rearlaser_angular_offset 3 nohost 0\n\
               PARAM robot_rear_laser_max 0 nohost 0\n\
               PARAM robot_rear_laser_name back nohost 0\n\
               FLASER 3 1 2 3 1 2 0 1 2 0 1 host 0\n\
               RLASER 3 1 2 3 1 2 0 1 2 0 1 host 0\n\
               FLASER 3 1 2 3 1.5 2 0 1 2 0 1 host 0\n\
               RAWLASER3 0 -1 1 0.5 -1 0.01 0 3 1 2 3 0 1 host 0\n";
    let outcome = read(log);
    assert_eq!((outcome.stats.malformed, outcome.stats.skipped.len()), (0, 0), "{:?}", outcome.stats);
    let expected = [
        (Pose::new(0.2, 0.0, 0.0), 80.9),
        (Pose::new(-0.3, 0.1, 3.0), f64::INFINITY),
        (Pose::new(0.5, 0.0, 0.0), 80.9),
        (Pose::IDENTITY, f64::INFINITY),
    ];
    assert_eq!(outcome.entries.len(), expected.len());
    for (entry, (mounting, max_range)) in outcome.entries.iter().zip(expected) {
        let LogEntry::Laser(reading) = entry else { panic!("{entry:?}") };
        assert!(same_pose(reading.robot_from_laser, mounting, TOLERANCE), "{reading:?}");
        assert_eq!((reading.max_range, reading.odom_from_robot), (max_range, Pose::new(1.0, 2.0, 0.0)));
    }
}

fn raw_sweeps_take_the_last_odometry_and_give_way_to_sweeps_with_poses() {
    let raw = |laser, stamp| format!("RAWLASER{laser} 0 -1 1 0.5 8 0.01 0 3 1 2 3 0 {stamp} host 0\n");
    let log = raw(1, 1)
        + "ODOM 1 2 0.5 0 0 0 2 host 0\n"
        + &raw(1, 3)
        + "FLASER 3 1 2 3 4 5 0.5 4 5 0.5 4 host 0\n"
        + &raw(1, 5)
        + &raw(2, 6);
    let outcome = read(log);
    let poses = outcome.entries.iter().filter_map(|entry| match entry {
        LogEntry::Laser(reading) => Some((reading.stamp, reading.odom_from_robot)),
        _ => None,
    });
    let (first, last) = (Pose::new(1.0, 2.0, 0.5), Pose::new(4.0, 5.0, 0.5));
    assert!(poses.eq([(1.0, Pose::IDENTITY), (3.0, first), (4.0, last), (6.0, last)]), "{:?}", outcome.entries);
    assert_eq!(outcome.stats.laser_without_odometry, 1);
    assert_eq!(outcome.stats.skipped["RAWLASER1"], 1);
}

fn order_of_lines_is_kept_and_backward_stamps_are_counted() {
    let log = [5.0, 4.0, 4.0, 6.0, 3.0].map(|stamp| format!("ODOM 0 0 0 0 0 0 {stamp} host 0\n")).concat();
    let outcome = read(log);
    let stamps = outcome.entries.iter().map(|entry| match entry {
        LogEntry::Odometry { stamp, .. } => *stamp,
        _ => f64::NAN,
    });
    assert!(stamps.eq([5.0, 4.0, 4.0, 6.0, 3.0]));
    assert_eq!(outcome.stats.backward_stamps, 2);
}

fn other_messages_are_counted_by_name_without_bound() {
    let names: String = (0..1000).map(|k| format!("NAME{k} 1\nNAME0 2\n")).collect();
    let outcome = read(format!("SYNC a 1 host 0\n{names}"));
    assert_eq!((outcome.stats.skipped["SYNC"], outcome.stats.skipped["NAME0"]), (1, 1001));
    assert_eq!(outcome.stats.skipped.values().sum::<u64>(), 2001);
    assert!(outcome.stats.skipped.len() < 100);
}

fn gzip_is_told_by_content_and_may_have_members() {
    let lines = ["ODOM 0 0 0 0 0 0 1 host 0\n", "ODOM 0 0 0 0 0 0 2 host 0\n"];
    let outcome = read([gzip(lines[0].as_bytes()), gzip(lines[1].as_bytes())].concat());
    assert!(outcome.error.is_none());
    assert_eq!((outcome.entries.len(), outcome.stats.lines), (2, 2));

    let folder = tempfile::tempdir().unwrap();
    for (name, bytes, log_name) in [
        ("plain.clf.gz", lines[0].as_bytes().to_vec(), "plain"),
        ("packed.clf", gzip(lines[0].as_bytes()), "packed"),
        ("run.2.log.gz", gzip(lines[0].as_bytes()), "run.2"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        let log = CarmenLog::new(&path);
        assert_eq!(log.name(), log_name);
        for _pass in 0..2 {
            let mut reader = log.open().unwrap();
            assert_eq!(drain(&mut *reader).entries.len(), 1, "{name}");
            assert_eq!(reader.progress(), Some((bytes.len() as u64, bytes.len() as u64)));
        }
    }
}

fn a_truncated_gzip_gives_its_whole_lines_then_an_error() {
    let odometry = |k: u32| format!("ODOM {}.5 0 0 0 0 0 {k} host {}\n", k.wrapping_mul(2_654_435_761), k ^ 0x5a5a);
    let log: String = (0..5000).map(odometry).collect();
    let packed = gzip(log.as_bytes());
    for kept in [packed.len() / 3, packed.len() - 9, packed.len() - 1] {
        let outcome = read(&packed[..kept]);
        let whole = outcome.entries.len() as u64;
        assert!(whole > 1000, "{whole} of 5000 lines from {kept} of {} bytes", packed.len());
        assert_eq!((outcome.stats.lines, outcome.stats.malformed), (whole, 0));
        match outcome.error {
            Some(LogError::Read { line, .. }) => assert_eq!(line, whole),
            other => panic!("{other:?}"),
        }
    }
    assert!(read(&packed).error.is_none());
}

/// Line by line, while the pipe is open; then once more from the first line.
fn a_stream_is_read_as_it_comes() {
    let line = |i: u32| format!("ODOM {i} 2 0 0 0 0 {i}.5 host 0\n");
    let (pipe, mut writer) = std::io::pipe().unwrap();
    let stream = Stream::new("pipe", pipe, || false).unwrap();
    writer.write_all(line(0).as_bytes()).unwrap();
    let log = open_stream(stream, &Topics::default(), None).unwrap();
    let mut reader = log.open().unwrap();
    let mut stamps = Vec::new();
    for i in 0..5 {
        match reader.next().unwrap().unwrap() {
            LogEntry::Odometry { stamp, .. } => stamps.push(stamp),
            other => panic!("{other:?}"),
        }
        // Only now there is a next one.
        writer.write_all(line(i + 1).as_bytes()).unwrap();
    }
    assert_eq!(stamps, [0.5, 1.5, 2.5, 3.5, 4.5]);
    drop(writer);
    assert_eq!(drain(&mut *reader).entries.len(), 1);
    assert_eq!(drain(&mut *log.open().unwrap()).entries.len(), 6);
}

fn files_of_another_kind_are_refused() {
    let jpeg = [&[0xff, 0xd8, 0xff, 0xe0, 0, 16][..], b"JFIF\0\n", &[0x80, 0x0a, 0x00, 0xff].repeat(300)].concat();
    let tum = "# timestamp tx ty tz qx qy qz qw\n".to_owned() + &"1.5 0 0 0 0 0 0 1\n".repeat(2000);
    let table: [(Vec<u8>, &str, u64); 6] = [
        (Vec::new(), "the file is empty", 0),
        (b"# only a comment\n\n".to_vec(), "no CARMEN message in the first 2 lines", 2),
        (b"IMU 1 2 3\n".to_vec(), "no CARMEN message in the first 1 lines", 1),
        (tum.as_bytes().to_vec(), "no CARMEN message in the first 1001 lines", 1001),
        (gzip(tum.as_bytes()), "no CARMEN message in the first 1001 lines", 1001),
        (jpeg, "no CARMEN message", 302),
    ];
    for (bytes, expected, lines) in table {
        let outcome = read(&bytes);
        let error = outcome.error.expect(expected);
        assert!(matches!(error, LogError::NotThisFormat { .. }), "{error:?}");
        let error = error.to_string();
        assert!(error.starts_with("test.clf: ") && error.contains(expected) && error.contains("FLASER"), "{error}");
        assert_eq!((outcome.entries.len(), outcome.stats.lines), (0, lines), "{error}");
    }
    // One line short of the decision.
    let late = "IMU 1\n".repeat(999) + "ODOM 0 0 0 0 0 0 1 host 0\n";
    assert_eq!(read(late).entries.len(), 1);
}

fn endless_lines_are_not_kept() {
    let outcome = read_from(std::io::repeat(0));
    assert!(matches!(outcome.error, Some(LogError::NotThisFormat { .. })));

    let odometry = "ODOM 0 0 0 0 0 0 1 host 0\n";
    let long = std::io::repeat(b'7').take(64 << 20);
    let outcome = read_from(odometry.as_bytes().chain(long).chain("\n".as_bytes()).chain(odometry.as_bytes()));
    assert_eq!((outcome.entries.len(), outcome.stats.malformed, outcome.stats.lines), (2, 1, 3));
}

fn what_cannot_be_opened_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    for (path, what) in [(folder.path().join("missing.clf"), "missing.clf"), (folder.path().to_owned(), "a folder")] {
        let error = CarmenLog::new(path).open().err().expect(what);
        assert!(matches!(error, LogError::Open { .. }), "{error:?}");
        assert!(error.to_string().contains(what), "{error}");
    }
}

/// Expected counts were taken from the files with `grep -c`.
fn real_logs() {
    struct Expected {
        file: &'static str,
        laser: u64,
        odometry: u64,
        beams: usize,
        neff: u64,
        backward: Option<u64>,
        mounting: Pose,
        max_range: f64,
    }
    let inf = f64::INFINITY;
    let raw = Expected {
        file: "csail/mit-csail.clf.gz",
        laser: 1988,
        odometry: 0,
        beams: 361,
        neff: 0,
        backward: Some(0),
        mounting: Pose::IDENTITY,
        max_range: inf,
    };
    let table = [
        Expected {
            file: "intel/intel-dense.clf.gz",
            laser: 8132,
            odometry: 13631,
            beams: 180,
            backward: Some(630),
            ..raw
        },
        Expected {
            file: "carmen-corrected/freiburg-101-corrected.log.gz",
            laser: 292,
            odometry: 4569,
            beams: 360,
            neff: 292,
            backward: None,
            mounting: Pose::new(-0.04, 0.0, 0.0),
            max_range: 80.99,
        },
        Expected {
            file: "carmen-corrected/belgioioso-corrected.log.gz",
            laser: 395,
            odometry: 4442,
            neff: 395,
            backward: None,
            mounting: Pose::new(-0.04, 0.0, 0.0),
            max_range: 80.99,
            ..raw
        },
        raw,
    ];
    for expected in table {
        let mut reader = CarmenLog::new(data(expected.file)).open().unwrap();
        let mut before = 0;
        let mut first = None;
        while let Some(entry) = reader.next() {
            if let LogEntry::Laser(reading) = entry.unwrap() {
                assert_eq!(reading.ranges.len(), expected.beams, "{}", expected.file);
                first.get_or_insert(reading);
            }
            let (consumed, length) = reader.progress().unwrap();
            assert!(before <= consumed && consumed <= length);
            before = consumed;
        }
        let (consumed, length) = reader.progress().unwrap();
        assert_eq!(consumed, length);
        let stats = reader.stats();
        let counts = (stats.laser, stats.odometry, stats.malformed, stats.laser_without_odometry);
        assert_eq!(counts, (expected.laser, expected.odometry, 0, 0), "{}: {stats:?}", expected.file);
        assert_eq!(stats.skipped.get("NEFF").copied().unwrap_or(0), expected.neff, "{}", expected.file);
        if let Some(backward) = expected.backward {
            assert_eq!(stats.backward_stamps, backward, "{}", expected.file);
        }
        let first = first.expect("a laser reading");
        assert_eq!((first.robot_from_laser, first.max_range), (expected.mounting, expected.max_range));
        if expected.file.contains("csail") {
            let Pose { x, y, heading } = first.odom_from_robot;
            assert!((x - 576.54).abs() < 0.01 && (y - 0.11).abs() < 0.01 && (heading + 2.26).abs() < 0.01);
        }
    }
}

fn poses(extent: f64) -> impl Strategy<Value = Pose> {
    (-extent..extent, -extent..extent, -PI..PI).prop_map(|(x, y, heading)| Pose::new(x, y, heading))
}

fn entries() -> impl Strategy<Value = LogEntry> {
    let stamps = || prop_oneof![-1e3..1e3, 1e9..2e9];
    let ranges = prop_oneof![8 => 0.0..90.0, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY), 1 => -1e9..1e9];
    let angles = (-3.0..3.0, prop_oneof![-0.1..-1e-4, 1e-4..0.1], any::<bool>());
    let max_ranges = prop_oneof![Just(f64::INFINITY), 1.0..100.0];
    let laser = (
        (stamps(), poses(1e5), prop_oneof![Just(Pose::IDENTITY), poses(2.0)]),
        (angles, max_ranges, prop::collection::vec(ranges, 1..400)),
    );
    let laser = laser.prop_map(|((stamp, odom_from_robot, robot_from_laser), (angles, max_range, ranges))| {
        let (first_angle, angle_step) = if angles.2 { implied_angles(ranges.len()) } else { (angles.0, angles.1) };
        LogEntry::Laser(LaserReading {
            stamp,
            odom_from_robot,
            robot_from_laser,
            start_from_end: Pose::IDENTITY,
            first_angle,
            angle_step,
            max_range,
            ranges,
        })
    });
    prop_oneof![
        (stamps(), poses(1e9)).prop_map(|(stamp, odom_from_robot)| LogEntry::Odometry { stamp, odom_from_robot }),
        (stamps(), poses(1e9)).prop_map(|(stamp, world_from_robot)| LogEntry::Truth { stamp, world_from_robot }),
        laser,
    ]
}

fn written(entry: &LogEntry) -> String {
    let mut writer = CarmenWriter::new(Vec::new());
    writer.write(entry).unwrap();
    String::from_utf8(writer.finish().unwrap()).unwrap()
}

proptest! {
    fn what_is_written_reads_back(entry in entries()) {
        let line = written(&entry);
        prop_assert_eq!(line.matches('\n').count(), 1);
        let outcome = read(&line);
        prop_assert!(outcome.error.is_none() && outcome.stats.malformed == 0, "{:?}", outcome.stats);
        prop_assert_eq!(outcome.entries.len(), 1);
        prop_assert!(same(&outcome.entries[0], &entry), "{:?} from {}", outcome.entries[0], line);
    }

    fn a_perturbed_entry_is_not_the_same(entry in entries(), field in 0..6) {
        let mut other = entry.clone();
        match &mut other {
            LogEntry::Odometry { stamp, .. } | LogEntry::Truth { stamp, .. } if field == 0 => *stamp += 1e-3,
            LogEntry::Odometry { odom_from_robot: pose, .. } | LogEntry::Truth { world_from_robot: pose, .. } => {
                pose.heading += 3e-9;
            }
            LogEntry::Turn { by_gyro, .. } => *by_gyro += 3e-9,
            LogEntry::Laser(reading) => match field {
                0 => reading.stamp += 1e-3,
                1 => reading.odom_from_robot.x += 3e-9,
                2 => reading.robot_from_laser.heading += 3e-9,
                3 => reading.angle_step += 3e-9,
                4 => reading.max_range = 0.5,
                _ => reading.ranges[0] = 123.0,
            },
        }
        prop_assert!(same(&entry, &entry) && !same(&entry, &other));
    }
}

fn the_shortest_message_that_says_all_is_written() {
    let reading = three_beams(1.5, Pose::new(1.0, 2.0, 0.0), Pose::IDENTITY, [1.0, 2.5, 3.0]);
    let line = written(&LogEntry::Laser(reading.clone()));
    assert_eq!(line, "FLASER 3 1.0 2.5 3.0 1.0 2.0 0.0 1.0 2.0 0.0 1.5 ipslam 1.5\n");
    for other in [LaserReading { max_range: 8.0, ..reading.clone() }, LaserReading { first_angle: 0.0, ..reading }] {
        assert!(written(&LogEntry::Laser(other)).starts_with("ROBOTLASER1 "));
    }
}

fn what_could_not_be_read_back_is_not_written() {
    let good = three_beams(1.0, Pose::IDENTITY, Pose::IDENTITY, [1.0; 3]);
    let bad = [
        LogEntry::Odometry { stamp: f64::NAN, odom_from_robot: Pose::IDENTITY },
        LogEntry::Truth { stamp: 1.0, world_from_robot: Pose::new(f64::INFINITY, 0.0, 0.0) },
        LogEntry::Laser(LaserReading { ranges: Vec::new(), ..good.clone() }),
        LogEntry::Laser(LaserReading { angle_step: 0.0, ..good.clone() }),
        LogEntry::Laser(LaserReading { first_angle: f64::NAN, ..good.clone() }),
    ];
    let mut writer = CarmenWriter::new(Vec::new());
    for entry in bad {
        assert!(writer.write(&entry).is_err(), "{entry:?}");
    }
    assert!(writer.write(&LogEntry::Laser(good)).is_ok());
}

crate::needs::trials! {
    "carmen":
    Nothing { good_lines, malformed_lines_are_left_out_and_counted, bytes_that_are_no_text_do_not_stop_reading, only_the_first_malformed_line_is_kept, a_cut_line_is_no_whole_one, angles_follow_from_the_number_of_beams, parameters_mount_the_lasers, raw_sweeps_take_the_last_odometry_and_give_way_to_sweeps_with_poses, order_of_lines_is_kept_and_backward_stamps_are_counted, other_messages_are_counted_by_name_without_bound, gzip_is_told_by_content_and_may_have_members, a_truncated_gzip_gives_its_whole_lines_then_an_error, a_stream_is_read_as_it_comes, files_of_another_kind_are_refused, endless_lines_are_not_kept, what_cannot_be_opened_is_an_error, what_is_written_reads_back, a_perturbed_entry_is_not_the_same, the_shortest_message_that_says_all_is_written, what_could_not_be_read_back_is_not_written }
    Data { real_logs }
}
