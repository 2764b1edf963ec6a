//! ROS 2 bags, written by Python packages that know nothing of this library: a CARMEN log told as a bag in several
//! ways has to be the log that it was, and small bags show each rule and each kind of damage.

use crate::logs::{Outcome, drain, same_pose};
use crate::needs::{data, python};
use ipslam::config::SlamConfig;
use ipslam::geometry::Pose;
use ipslam::io::carmen::CarmenLog;
use ipslam::io::mcap::{ImuTopic, McapLog, Topics};
use ipslam::io::{Stream, open_bytes, open_log, open_stream};
use ipslam::log::{ImuStats, LaserReading, LogEntry, LogError, LogSource, LogStats};
use ipslam::ppca::Cluster;
use ipslam::report::Estimator as _;
use ipslam::slam::Slam;
use proptest::prelude::*;
use serde_json::{Value, json};
use std::io::Write as _;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use tempfile::TempDir;

const TOPICS: Topics = Topics { scan: Vec::new(), odometry: None, imu: ImuTopic::Any };

/// Runs the writer of bags.
fn write_bags(arguments: &[&str]) {
    let output = Command::new(python())
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tools/write_bags.py"))
        .args(arguments)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

fn read(log: &dyn LogSource) -> Outcome {
    let mut reader = log.open().unwrap();
    let outcome = drain(&mut *reader);
    let (read, length) = reader.progress().unwrap();
    assert!(read <= length && length > 0);
    outcome
}

impl Outcome {
    fn scans(&self) -> Vec<&LaserReading> {
        let mut scans = Vec::new();
        for entry in &self.entries {
            if let LogEntry::Laser(reading) = entry {
                scans.push(reading);
            }
        }
        scans
    }

    fn stamps(&self) -> Vec<f64> {
        self.entries.iter().map(LogEntry::stamp).collect()
    }
}

// ---- A CARMEN log, told as bags

/// Scans of the CARMEN log that the bags hold.
const SCANS: usize = 300;
/// Poses go through quaternions and back, and the mounting through a chain of transforms [m, rad].
const TOLERANCE: f64 = 1e-12;

/// The bags, and the CARMEN log as its entries.
fn carmen_as_bags() -> (TempDir, Vec<LaserReading>) {
    let log = data("csail/mit-csail.clf.gz");
    let folder = tempfile::tempdir().unwrap();
    write_bags(&["carmen", log.to_str().unwrap(), &SCANS.to_string(), folder.path().to_str().unwrap()]);
    let scans = CarmenLog::new(log).open().unwrap().filter_map(|entry| match entry.unwrap() {
        LogEntry::Laser(reading) => Some(reading),
        _ => None,
    });
    let single = |value: f64| f64::from(value as f32);
    // As `LaserScan` tells it: in 32 bits, and with where the writer says that the laser is.
    let as_message = |reading: LaserReading| LaserReading {
        robot_from_laser: Pose::new(0.1, 0.0, 0.0) * Pose::new(0.2, -0.05, 0.1),
        first_angle: single(reading.first_angle),
        angle_step: single(reading.angle_step),
        max_range: 81.0,
        ranges: reading.ranges.iter().map(|&range| single(range)).collect(),
        ..reading
    };
    let scans: Vec<_> = scans.take(SCANS).map(as_message).collect();
    assert_eq!(scans.len(), SCANS);
    (folder, scans)
}

/// Odometry and laser of every scan, which are told at the same stamp.
fn as_entries(scans: &[LaserReading]) -> Vec<LogEntry> {
    let both = |scan: &LaserReading| {
        let odometry = LogEntry::Odometry { stamp: scan.stamp, odom_from_robot: scan.odom_from_robot };
        [odometry, LogEntry::Laser(scan.clone())]
    };
    scans.iter().flat_map(both).collect()
}

/// Angles are passed on as they are.
fn same(a: &LogEntry, b: &LogEntry) -> bool {
    crate::logs::same(a, b, TOLERANCE, 0.0)
}

fn a_bag_tells_what_the_carmen_log_told() {
    let (folder, scans) = carmen_as_bags();
    let expected = as_entries(&scans);
    let ros2 = ["none.mcap", "lz4.mcap", "zstd.mcap", "unchunked.mcap", "transforms.mcap", "folder", "split", "sqlite"];
    let ros1 = ["ros1_none.bag", "ros1_lz4.bag", "ros1_bz2.bag", "ros1_tf.bag"];
    for bag in ros2.into_iter().chain(ros1).chain(["sqlite/sqlite.db3"]) {
        let path = folder.path().join(bag);
        let mut logs = vec![open_log(&path, &TOPICS).unwrap()];
        if path.is_file() {
            match open_bytes(bag, std::fs::read(&path).unwrap(), &TOPICS) {
                Ok(log) => logs.push(log),
                Err(error) => {
                    assert!(bag.ends_with(".db3") && error.to_string().contains("from a file only"), "{error}")
                }
            }
        }
        for log in logs {
            let outcome = read(&*log);
            assert!(outcome.error.is_none(), "{bag}: {:?}", outcome.error);
            assert_eq!(outcome.entries.len(), expected.len(), "{bag}: {:?}", outcome.stats);
            let differs = outcome.entries.iter().zip(&expected).position(|(a, b)| !same(a, b));
            assert_eq!(differs, None, "{bag}: {:?}", differs.map(|index| &outcome.entries[index]));
            let count = SCANS as u64;
            let expected_stats =
                LogStats { lines: 2 * count + 1, laser: count, odometry: count, ..LogStats::default() };
            assert_eq!(outcome.stats, expected_stats, "{bag}");
        }
    }
    // The comparison rejects each field of an entry that is a little off.
    let changes: [fn(&mut LaserReading); 6] = [
        |scan| scan.stamp += 1e-6,
        |scan| scan.odom_from_robot.x += 1e-9,
        |scan| scan.robot_from_laser.heading += 1e-9,
        |scan| scan.first_angle += 1e-7,
        |scan| scan.ranges[7] += 1e-6,
        |scan| scan.max_range += 1e-3,
    ];
    for (index, change) in changes.into_iter().enumerate() {
        let mut perturbed = scans[0].clone();
        change(&mut perturbed);
        assert!(!same(&LogEntry::Laser(perturbed), &expected[1]), "change {index}");
    }
}

fn a_bag_gives_the_map_of_the_carmen_log() {
    let (folder, scans) = carmen_as_bags();
    let config = SlamConfig { particles: 8, maps: 8, seed: 1, ..SlamConfig::default() };
    let map = |entries: &[LogEntry]| {
        let mut slam = Slam::new(config);
        entries.iter().for_each(|entry| slam.add(entry, &mut |_| {}));
        slam.result().map.clusters
    };
    let bag = McapLog::new(folder.path().join("zstd.mcap"), &TOPICS).unwrap();
    let found = map(&read(&bag).entries);
    // Headings and mountings went through quaternions, which changes their last digits; with these as the bag has them
    // nothing else may differ.
    let mut rounded = scans;
    for (scan, read) in rounded.iter_mut().zip(read(&bag).scans()) {
        scan.odom_from_robot.heading = read.odom_from_robot.heading;
        scan.robot_from_laser = read.robot_from_laser;
    }
    let expected = map(&as_entries(&rounded));
    assert!(expected.len() > 20, "{} clusters", expected.len());
    assert!(found == expected, "{} clusters, or others, than {}", found.len(), expected.len());
    // A millimetre in the ranges of the first scan makes another map.
    rounded[0].ranges.iter_mut().for_each(|range| *range += 1e-3);
    let other: Vec<Cluster> = map(&as_entries(&rounded));
    assert!(found != other);
}

/// The files of a bag are one log only if its metadata says so, and all of them.
fn a_bag_in_several_files_is_read_as_its_metadata_tells() {
    let (folder, _) = carmen_as_bags();
    let split = folder.path().join("split");
    let error = || {
        let opened = open_log(&split, &TOPICS).map(|log| read(&*log).error.expect("read without an error").to_string());
        opened.unwrap_or_else(|error| error.to_string())
    };
    std::fs::rename(split.join("part_10.mcap"), split.join("gone")).unwrap();
    assert!(error().contains("part_10.mcap"), "{}", error());
    // Cut off within the second file: what comes before is read.
    let bytes = std::fs::read(split.join("gone")).unwrap();
    std::fs::write(split.join("part_10.mcap"), &bytes[..bytes.len() / 2]).unwrap();
    let outcome = read(&*open_log(&split, &TOPICS).unwrap());
    assert!(outcome.error.unwrap().to_string().contains("cut off"));
    let scans = outcome.entries.iter().filter(|entry| matches!(entry, LogEntry::Laser(_))).count();
    assert!((SCANS / 3..SCANS).contains(&scans), "{scans} scans");
    let metadata = std::fs::read_to_string(split.join("metadata.yaml")).unwrap();
    std::fs::write(split.join("metadata.yaml"), metadata.replace("relative_file_paths", "paths")).unwrap();
    assert!(error().contains("relative_file_paths"), "{}", error());
    std::fs::remove_file(split.join("metadata.yaml")).unwrap();
    assert!(error().contains("several files") && error().contains("ros2 bag reindex"), "{}", error());
}

// ---- Small bags

/// Writes these bags, each `{name, messages, ...}` as the writer understands it, into a new folder.
fn bags(bags: Value) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let Value::Array(mut bags) = bags else { panic!("a list of bags") };
    for bag in &mut bags {
        bag["path"] = json!(folder.path().join(bag["name"].as_str().unwrap()));
    }
    let spec = folder.path().join("spec.json");
    std::fs::write(&spec, Value::Array(bags).to_string()).unwrap();
    write_bags(&["spec", spec.to_str().unwrap()]);
    folder
}

/// Stamps are tenths of a second.
fn stamp(tenths: u32) -> Value {
    json!([1_700_000_000 + tenths / 10, tenths % 10 * 100_000_000])
}

fn seconds(tenths: u32) -> f64 {
    1_700_000_000.0 + f64::from(tenths) / 10.0
}

fn scan(topic: &str, tenths: u32, frame: &str) -> Value {
    json!({"kind": "scan", "topic": topic, "stamp": stamp(tenths), "frame": frame, "angle_min": -1.0,
           "angle_step": 0.5, "range_min": 0.5, "range_max": 8.0, "ranges": [1.0, 2.0, 3.0]})
}

fn odometry(topic: &str, tenths: u32, x: f64, heading: f64) -> Value {
    json!({"kind": "odometry", "topic": topic, "stamp": stamp(tenths), "frame": "odom", "child": "base",
           "pose": [x, 0.0, heading]})
}

fn transform(topic: &str, tenths: u32, [parent, child]: [&str; 2], xyz: [f64; 3], rpy: [f64; 3]) -> Value {
    let transform = json!({"stamp": stamp(tenths), "frame": parent, "child": child, "xyz": xyz, "rpy": rpy});
    json!({"kind": "tf", "topic": topic, "transforms": [transform]})
}

fn fixed(frames: [&str; 2], xyz: [f64; 3], rpy: [f64; 3]) -> Value {
    transform("/tf_static", 0, frames, xyz, rpy)
}

fn changed(mut message: Value, field: &str, value: Value) -> Value {
    assert!(message.get(field).is_some() || field == "quaternion", "there is no {field} in {message}");
    message[field] = value;
    message
}

fn raw(topic: &str, schema: &str, encoding: &str, data: &str) -> Value {
    json!({"kind": "raw", "topic": topic, "schema": schema, "encoding": encoding, "data": data})
}

const LASER_SCAN: &str = "sensor_msgs/msg/LaserScan";

fn odometry_at_a_scan_lies_between_its_neighbours() {
    let folder = bags(json!([{"name": "bag.mcap", "messages": [
        // The first scan is before all odometry, the last after it; scans come late and out of turn with odometry.
        scan("/scan", 0, "base"),
        odometry("/odom", 1, 1.0, 3.0),
        odometry("/odom", 5, 2.0, -3.0),
        scan("/scan", 2, "base"),
        odometry("/odom", 9, 4.0, -3.0),
        scan("/scan", 8, "base"),
        scan("/scan", 9, "base"),
        scan("/scan", 15, "base"),
        scan("/scan", 40, "base"),
        {"kind": "raw", "topic": "/battery", "schema": "sensor_msgs/msg/BatteryState", "encoding": "cdr", "data": "00010000"},
    ]}]));
    let outcome = read(&McapLog::new(folder.path().join("bag.mcap"), &TOPICS).unwrap());
    assert_eq!(outcome.stamps(), [0, 1, 2, 5, 8, 9, 9, 15, 40].map(seconds));
    let turn = 2.0 * std::f64::consts::PI - 6.0;
    let expected = [(1.0, 3.0), (1.25, 3.0 + turn / 4.0), (3.5, -3.0), (4.0, -3.0), (4.0, -3.0), (4.0, -3.0)];
    let scans = outcome.scans();
    assert_eq!(scans.len(), expected.len());
    for (scan, (x, heading)) in scans.into_iter().zip(expected) {
        assert!(same_pose(scan.odom_from_robot, Pose::new(x, 0.0, heading), TOLERANCE), "{scan:?}, not {x} {heading}");
    }
    let LogStats { lines, laser, odometry, laser_without_odometry, laser_without_mounting, .. } = outcome.stats;
    assert_eq!((lines, laser, odometry), (10, 6, 3));
    // The first scan and the last, which is 3.1 s behind; the frames are one, so the mounting is known.
    assert_eq!((laser_without_odometry, laser_without_mounting), (2, 0));
    assert_eq!(outcome.stats.skipped, [("/battery".to_owned(), 1)].into());
    assert_eq!((outcome.stats.backward_stamps, outcome.stats.malformed), (0, 0));
}

fn where_the_laser_is_mounted() {
    use std::f64::consts::PI;
    let with = |name: &str, more: Vec<Value>| {
        let messages = [vec![odometry("/odom", 0, 0.0, 0.0), scan("/scan", 1, "laser")], more].concat();
        json!({"name": name, "messages": messages})
    };
    let none = [0.0; 3];
    let folder = bags(json!([
        with(
            "chain.mcap",
            vec![
                fixed(["/mast", "/laser"], [0.2, 0.0, 0.0], none),
                fixed(["plate", "mast"], [0.0, 0.0, 1.0], [0.0, 0.0, PI / 2.0]),
                fixed(["base", "plate"], [0.1, 0.0, 0.0], none),
            ]
        ),
        with("upside_down.mcap", vec![fixed(["base", "laser"], [0.3, 0.0, 0.0], [PI, 0.0, 0.25])]),
        with("unknown.mcap", vec![fixed(["base", "camera"], [0.3, 0.0, 0.0], none)]),
        with(
            "twice.mcap",
            vec![fixed(["base", "laser"], [0.3, 0.0, 0.0], none), fixed(["base", "laser"], [0.4, 0.0, 0.0], none),]
        ),
        with("upright.mcap", vec![fixed(["base", "laser"], [0.3, 0.0, 0.0], [PI / 2.0, 0.0, 0.0])]),
        with("circle.mcap", vec![fixed(["a", "laser"], none, none), fixed(["laser", "a"], none, none)]),
    ]));
    let opened = |name: &str| McapLog::new(folder.path().join(name), &TOPICS);
    // Pose, angles of the first beam and from beam to beam, readings without mounting.
    for (name, pose, angles, unknown) in [
        ("chain.mcap", Pose::new(0.1, 0.2, PI / 2.0), (-1.0, 0.5), 0),
        ("upside_down.mcap", Pose::new(0.3, 0.0, 0.25), (1.0, -0.5), 0),
        ("unknown.mcap", Pose::IDENTITY, (-1.0, 0.5), 1),
        ("twice.mcap", Pose::new(0.4, 0.0, 0.0), (-1.0, 0.5), 0),
    ] {
        let outcome = read(&opened(name).unwrap());
        let [scan] = outcome.scans()[..] else { panic!("{name}: one scan") };
        assert!(same_pose(scan.robot_from_laser, pose, TOLERANCE), "{name}: {scan:?}");
        assert_eq!((scan.first_angle, scan.angle_step), angles, "{name}");
        assert_eq!(outcome.stats.laser_without_mounting, unknown, "{name}");
    }
    for (name, expected) in [("upright.mcap", "`laser` is tilted by 90°"), ("circle.mcap", "lead in a circle")] {
        let error = opened(name).unwrap_err();
        assert!(matches!(error, LogError::Bag { .. }), "{error:?}");
        let error = error.to_string();
        assert!(error.contains(name) && error.contains(expected), "{error}");
    }
}

fn the_user_chooses_among_topics() {
    let still = [[0.0; 3], [0.0; 3]];
    let tf = |robot: &str, x: f64| {
        let (topic, odom, base) = (format!("/{robot}/tf"), format!("{robot}/odom"), format!("{robot}/base"));
        transform(&topic, 0, [&odom, &base], [x, 0.0, 0.0], [0.0; 3])
    };
    let folder = bags(json!([
        {"name": "many.mcap", "messages": [
            odometry("/odom", 0, 1.0, 0.0), odometry("/filtered", 0, 2.0, 0.0), tf("a", 3.0),
            scan("/front", 0, "base"), scan("/rear", 0, "base"), scan("/rear", 1, "base"),
        ]},
        {"name": "robots.mcap", "messages": [
            tf("a", 3.0), tf("b", 4.0), scan("/scan", 0, "b/laser"),
            fixed(["b/base", "b/laser"], [0.1, 0.0, 0.0], still[0]),
        ]},
        {"name": "strangers.mcap", "messages": [tf("a", 3.0), tf("b", 4.0), scan("/scan", 0, "laser")]},
        {"name": "no_odometry.mcap", "messages": [
            scan("/scan", 0, "laser"), scan("/scan", 1, "laser"),
            fixed(["base", "laser"], [0.1, 0.0, 0.0], still[0]),
        ]},
        {"name": "no_scan.mcap", "messages": [odometry("/odom", 0, 1.0, 0.0)]},
        {"name": "json.mcap", "messages": [raw("/scan", LASER_SCAN, "json", "7b7d")]},
        {"name": "empty.mcap", "messages": []},
    ]));
    let opened = |name: &str, scan: &str, odometry: &str| {
        let named = |topic: &str| (!topic.is_empty()).then(|| topic.to_owned());
        McapLog::new(
            folder.path().join(name),
            &Topics { scan: named(scan).into_iter().collect(), odometry: named(odometry), ..TOPICS },
        )
    };
    // Scans, and where odometry has the robot.
    for (name, scan, odometry, scans, x) in [
        ("many.mcap", "/front", "/odom", 1, 1.0),
        ("many.mcap", "/rear", "/filtered", 2, 2.0),
        ("many.mcap", "/rear", "/a/tf", 2, 3.0),
        ("robots.mcap", "", "", 1, 4.0),
        ("strangers.mcap", "/scan", "/a/tf", 1, 3.0),
        ("no_odometry.mcap", "", "", 2, 0.0),
    ] {
        let outcome = read(&opened(name, scan, odometry).unwrap());
        let found: Vec<_> = outcome.scans().iter().map(|scan| scan.odom_from_robot.x).collect();
        assert_eq!(found, vec![x; scans], "{name} {scan} {odometry}");
        let without = if name == "no_odometry.mcap" { 2 } else { 0 };
        assert_eq!(outcome.stats.laser_without_odometry, without, "{name}");
    }
    // The robot of a bag without odometry is where its laser hangs from.
    let outcome = read(&opened("no_odometry.mcap", "", "").unwrap());
    assert_eq!(outcome.scans()[0].robot_from_laser, Pose::new(0.1, 0.0, 0.0));

    for (name, scan, odometry, expected) in [
        (
            "many.mcap",
            "",
            "/odom",
            &["several lasers", "--scan-topic", "/front (sensor_msgs", "/rear (", "2 messages"][..],
        ),
        ("many.mcap", "/front", "", &["several sources", "--odom-topic", "/odom (nav_msgs", "/filtered ("]),
        ("many.mcap", "/odom", "", &["no message of type sensor_msgs/msg/LaserScan on /odom (--scan-topic)", "/rear"]),
        ("many.mcap", "/front", "/none", &["nav_msgs/msg/Odometry or tf2_msgs/msg/TFMessage on /none", "/filtered"]),
        ("strangers.mcap", "", "", &["no single transform", "a/odom -> a/base on /a/tf", "b/odom"]),
        ("no_scan.mcap", "", "", &["no message of type sensor_msgs/msg/LaserScan", "/odom (nav_msgs"]),
        ("json.mcap", "", "", &["no message of type", "/scan (", "encoded as json, not cdr"]),
        ("empty.mcap", "", "", &["no message of type", "it holds no messages"]),
    ] {
        let error = opened(name, scan, odometry).unwrap_err();
        assert!(matches!(error, LogError::Bag { .. }), "{error:?}");
        let error = error.to_string();
        for part in [name].iter().chain(expected) {
            assert!(error.contains(part), "{error:?} does not say {part:?}");
        }
    }
}

/// Each has its mounting, and their scans come in the order of their stamps, in whatever order the bag has them.
fn several_lasers_take_turns() {
    let front = fixed(["base", "front"], [0.3, 0.0, 0.0], [0.0; 3]);
    let rear = fixed(["base", "rear"], [-0.3, 0.1, 0.0], [0.0, 0.0, std::f64::consts::PI]);
    let mut messages = vec![front, rear];
    for tenths in (0..20).step_by(2) {
        // The rear laser's message overtakes the one before it.
        messages.extend([scan("/rear", tenths + 1, "rear"), scan("/front", tenths, "front")]);
        messages.push(odometry("/odom", tenths + 1, f64::from(tenths + 1), 0.0));
    }
    let folder = bags(json!([{"name": "two.mcap", "messages": messages}]));
    let path = folder.path().join("two.mcap");
    let topics = Topics { scan: ["/front", "/rear"].map(str::to_owned).to_vec(), ..TOPICS };
    let outcome = read(&McapLog::new(&path, &topics).unwrap());
    assert!(outcome.stats.backward_stamps == 0 && outcome.stats.laser_without_mounting == 0, "{:?}", outcome.stats);
    let scans = outcome.scans();
    assert_eq!(scans.len(), 20);
    for (tenths, scan) in (0..).zip(scans) {
        let mounting =
            if tenths % 2 == 0 { Pose::new(0.3, 0.0, 0.0) } else { Pose::new(-0.3, 0.1, std::f64::consts::PI) };
        assert!(
            scan.stamp == seconds(tenths) && same_pose(scan.robot_from_laser, mounting, 1e-12),
            "{tenths}: {scan:?}"
        );
    }
    let one = Topics { scan: vec!["/rear".to_owned()], ..TOPICS };
    assert_eq!(read(&McapLog::new(&path, &one).unwrap()).scans().len(), 10);
    let none = Topics { scan: ["/front", "/side"].map(str::to_owned).to_vec(), ..TOPICS };
    let error = McapLog::new(&path, &none).unwrap_err().to_string();
    assert!(error.contains("no message of type sensor_msgs/msg/LaserScan on /side"), "{error}");
}

fn malformed_messages_are_left_out_and_counted() {
    let good = || vec![odometry("/odom", 0, 1.0, 0.0), scan("/scan", 0, "base")];
    let table = [
        (changed(scan("/scan", 1, "base"), "ranges", json!([])), "/scan: it has 0 ranges"),
        (changed(scan("/scan", 1, "base"), "angle_min", json!("nan")), "angle_min NaN"),
        (changed(scan("/scan", 1, "base"), "angle_step", json!("inf")), "angle_increment inf"),
        (changed(scan("/scan", 1, "base"), "angle_step", json!(0.0)), "angle_increment 0"),
        (changed(scan("/scan", 1, "base"), "stamp", json!([1, 1_000_000_000])), "1000000000 nanoseconds"),
        (changed(odometry("/odom", 1, 1.0, 0.0), "pose", json!(["nan", 0, 0])), "/odom: no pose: position [NaN"),
        (changed(odometry("/odom", 1, 1.0, 0.0), "quaternion", json!([0.0, 0.0, 0.0, 0.0])), "quaternion [0.0, 0.0"),
        (raw("/scan", LASER_SCAN, "cdr", ""), "it is not plain CDR"),
        (raw("/scan", LASER_SCAN, "cdr", "28b52ffd"), "was each message compressed?"),
        (raw("/scan", LASER_SCAN, "cdr", "000100000000000000000000ffffff7f"), "/scan: "),
        // A scan whose ranges end too early.
        (raw("/scan", LASER_SCAN, "cdr", &format!("00010000{}ffff0000", "00".repeat(40))), "/scan: "),
    ];
    let bag = |(index, (message, _)): (usize, &(Value, &str))| {
        let messages = [good(), vec![message.clone()], vec![scan("/scan", 2, "base")]].concat();
        json!({"name": format!("{index}.mcap"), "messages": messages})
    };
    let folder = bags(table.iter().enumerate().map(bag).collect());
    for (index, (message, reason)) in table.iter().enumerate() {
        let path = folder.path().join(format!("{index}.mcap"));
        let outcome = read(&McapLog::new(&path, &TOPICS).unwrap());
        assert!(outcome.error.is_none(), "{message}");
        let counts = (outcome.stats.laser, outcome.stats.odometry, outcome.stats.malformed, outcome.stats.lines);
        assert_eq!(counts, (2, 1, 1, 4), "{message}: {:?}", outcome.stats);
        let first = outcome.stats.first_malformed.unwrap();
        assert!(first.starts_with(&format!("{}:3: ", path.display())), "{first}");
        assert!(first.contains(reason), "{first:?} does not say {reason:?}");
    }
}

fn a_bag_of_ros_1_tells_the_same() {
    let scan = |tenths: u32| changed(scan("/scan", tenths, "laser"), "ranges", json!([1.5, "nan", 3.25, 0.125]));
    let messages = json!([
        fixed(["base", "laser"], [0.2, -0.1, 0.3], [0.0, 0.0, 0.5]),
        odometry("/odom", 0, 1.0, 0.25),
        scan(1),
        odometry("/odom", 2, 2.0, 0.75),
        scan(3),
    ]);
    let moving = json!([
        transform("/tf", 0, ["odom", "base"], [1.0, 2.0, 0.0], [0.0, 0.0, 0.5]),
        scan(1),
        transform("/tf", 2, ["odom", "base"], [1.5, 2.5, 0.0], [0.0, 0.0, 0.6]),
    ]);
    let short = raw("/scan", "sensor_msgs/LaserScan", "ros1", &"00".repeat(40));
    let folder = bags(json!([
        {"name": "0.mcap", "messages": messages}, {"name": "0_ros1.mcap", "ros1": true, "messages": messages},
        {"name": "1.mcap", "messages": moving}, {"name": "1_ros1.mcap", "ros1": true, "messages": moving},
        {"name": "short.mcap", "ros1": true, "messages": [scan(1), short, scan(2)]},
    ]));
    let told = |name: &str| read(&*open_log(folder.path().join(name), &TOPICS).unwrap());
    for (name, scans, odometry) in [("0", 2, 2), ("1", 1, 2)] {
        let (ros2, ros1) = (told(&format!("{name}.mcap")), told(&format!("{name}_ros1.mcap")));
        assert_eq!((ros1.stats.laser, ros1.stats.odometry, ros1.stats.malformed), (scans, odometry, 0));
        assert_eq!(ros1.stats, ros2.stats);
        assert_eq!(ros1.entries.len(), ros2.entries.len());
        for (index, (is, expected)) in ros1.entries.iter().zip(&ros2.entries).enumerate() {
            assert!(same(is, expected), "{index}: {is:?} is not {expected:?}");
        }
        let shifted = ros1.entries.iter().zip(ros2.entries.iter().skip(1)).filter(|(a, b)| same(a, b)).count();
        assert_eq!(shifted, 0, "the comparison rejects nothing");
    }
    let outcome = told("short.mcap");
    assert_eq!((outcome.stats.laser, outcome.stats.malformed), (2, 1));
    let first = outcome.stats.first_malformed.unwrap();
    assert!(
        first.contains("/scan: it is shorter than its fields, of which ROS 1 has one more in a header (seq)"),
        "{first}"
    );
}

fn ranges_that_are_none_are_marked() {
    let ranges = json!([0.25, 0.5, 7.5, 8.0, 9.0, "nan", "inf", "-inf", -1.0]);
    let folder = bags(json!([
        {"name": "bag.mcap", "messages": [changed(scan("/scan", 1, "base"), "ranges", ranges)]},
        {"name": "open.mcap", "messages": [changed(scan("/scan", 1, "base"), "range_max", json!("nan"))]},
    ]));
    let outcome = read(&McapLog::new(folder.path().join("bag.mcap"), &TOPICS).unwrap());
    let [scan] = outcome.scans()[..] else { panic!("one scan") };
    let nan = f64::NAN;
    let expected = [nan, 0.5, 7.5, 8.0, 9.0, nan, f64::INFINITY, nan, nan];
    assert_eq!(scan.ranges.len(), expected.len());
    for (found, expected) in scan.ranges.iter().zip(expected) {
        assert!(*found == expected || found.is_nan() && expected.is_nan(), "{found} is not {expected}");
    }
    assert_eq!(scan.max_range, 8.0);
    let outcome = read(&McapLog::new(folder.path().join("open.mcap"), &TOPICS).unwrap());
    assert_eq!(outcome.scans()[0].max_range, f64::INFINITY);
}

// ---- Damage

/// Odometry and scans of ten seconds, in small chunks.
fn drive(name: &str, compression: &str, chunked: bool) -> Value {
    let both = |tenths| [odometry("/odom", tenths, f64::from(tenths), 0.0), scan("/scan", tenths, "base")];
    let messages: Vec<Value> = (0..100).flat_map(both).collect();
    json!({"name": name, "messages": messages, "compression": compression, "chunked": chunked, "chunk_size": 2048})
}

fn a_bag_that_was_cut_off_is_read_as_far_as_it_goes() {
    let folder = bags(json!([
        drive("lz4.mcap", "lz4", true),
        drive("zstd.mcap", "zstd", true),
        drive("unchunked.mcap", "none", false),
    ]));
    for name in ["lz4.mcap", "zstd.mcap", "unchunked.mcap"] {
        let path = folder.path().join(name);
        let whole = std::fs::read(&path).unwrap();
        let all = read(&McapLog::new(&path, &TOPICS).unwrap());
        assert!(all.error.is_none() && all.entries.len() == 200, "{name}");
        let cut = folder.path().join("cut.mcap");
        let (mut most, mut refused, mut told) = (0, 0, 0);
        for kept in (0..whole.len()).step_by(97) {
            std::fs::write(&cut, &whole[..kept]).unwrap();
            let log = match McapLog::new(&cut, &TOPICS) {
                Ok(log) => log,
                Err(error) => {
                    assert!(most == 0, "{kept} bytes: {error}");
                    refused += 1;
                    continue;
                }
            };
            let outcome = read(&log);
            let read = outcome.entries.len();
            assert!(read >= most && outcome.stats.malformed == 0, "{kept} bytes: {:?}", outcome.stats);
            assert!(outcome.entries.iter().zip(&all.entries).all(|(a, b)| a == b || read < 3), "{kept} bytes");
            most = read;
            match outcome.error {
                Some(LogError::Read { line, .. }) => {
                    assert_eq!(line, outcome.stats.lines);
                    told += 1;
                }
                // All messages are there; only the summary is cut.
                None => assert_eq!(read, 200),
                Some(other) => panic!("{other:?}"),
            }
        }
        assert_eq!(most, 200, "{name}");
        assert!(refused > 0 && told > 20, "{name}: {refused} refused, {told} told");
    }
}

/// What is there is handed out while the pipe is open, and all of it is there once more.
fn a_stream_is_read_as_it_comes() {
    static STOPPED: AtomicBool = AtomicBool::new(false);
    let folder = bags(json!([drive("zstd.mcap", "zstd", true), drive("unchunked.mcap", "none", false)]));
    for name in ["zstd.mcap", "unchunked.mcap"] {
        let path = folder.path().join(name);
        let (bytes, all) = (std::fs::read(&path).unwrap(), read(&McapLog::new(&path, &TOPICS).unwrap()));
        let begin = 7 * bytes.len() / 10;
        for is_stopped in [false, true] {
            STOPPED.store(false, Ordering::Relaxed);
            let (pipe, mut writer) = std::io::pipe().unwrap();
            let stream = Stream::new("pipe", pipe, || STOPPED.load(Ordering::Relaxed)).unwrap();
            writer.write_all(&bytes[..begin]).unwrap();
            let log = open_stream(stream, &TOPICS, None).unwrap();
            assert!(log.is_live() && log.name() == "pipe");
            let mut reader = log.open().unwrap();
            let mut entries: Vec<LogEntry> = reader.by_ref().take(110).map(|entry| entry.unwrap()).collect();
            if is_stopped {
                STOPPED.store(true, Ordering::Relaxed);
            } else {
                writer.write_all(&bytes[begin..]).unwrap();
                drop(writer);
            }
            let rest = drain(&mut *reader);
            assert!(rest.error.is_none(), "{name}: {:?}", rest.error);
            entries.extend(rest.entries);
            let expected = if is_stopped { entries.len() } else { 200 };
            assert!((110..200).contains(&expected) == is_stopped, "{name}: {expected}");
            // The end of what was read stands still.
            assert!(entries[..expected - 2] == all.entries[..expected - 2], "{name}");
            assert!(drain(&mut *log.open().unwrap()).entries == entries, "{name}");
        }
    }
    // What has to be in a file is told.
    for (bytes, expected) in [
        (&b"#ROSBAG V2.0\n...."[..], "save it to a file first"),
        (b"RRF2............", "replay"),
        (b"", "the file is empty"),
        (b"nothing that anyone knows", "no CARMEN message"),
    ] {
        let stream = Stream::new("bytes", bytes, || false).unwrap();
        let log = open_stream(stream, &TOPICS, None);
        let error = log.map_or_else(Some, |log| drain(&mut *log.open().unwrap()).error).unwrap().to_string();
        assert!(error.contains("standard input") && error.contains(expected), "{error}");
    }
}

fn a_damaged_chunk_is_left_out() {
    let folder = bags(json!([
        drive("none.mcap", "none", true),
        drive("lz4.mcap", "lz4", true),
        drive("zstd.mcap", "zstd", true),
    ]));
    for name in ["none.mcap", "lz4.mcap", "zstd.mcap"] {
        let path = folder.path().join(name);
        let mut bytes = std::fs::read(&path).unwrap();
        let middle = bytes.len() / 3;
        bytes[middle..middle + 4].iter_mut().for_each(|byte| *byte = !*byte);
        std::fs::write(&path, bytes).unwrap();
        let outcome = read(&McapLog::new(&path, &TOPICS).unwrap());
        assert!(outcome.error.is_none() && outcome.stats.malformed == 1, "{name}: {:?}", outcome.stats);
        let kept = outcome.entries.len();
        assert!((140..200).contains(&kept), "{name}: {kept} of 200");
        let first = outcome.stats.first_malformed.unwrap();
        assert!(first.contains("the chunk at byte "), "{name}: {first}");
    }
}

/// A record that tells of more bytes than a machine has is refused by the bytes that are there.
fn sizes_are_not_taken_at_their_word() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    for (opcode, length) in [(3, u64::MAX), (6, u64::MAX / 2), (6, 1 << 40), (9, u64::MAX - 20), (0, 0)] {
        let mut bytes = b"\x89MCAP0\r\n".to_vec();
        bytes.push(opcode);
        bytes.extend(u64::to_le_bytes(length));
        bytes.extend([0; 100]);
        std::fs::write(&path, bytes).unwrap();
        let error = McapLog::new(&path, &TOPICS).unwrap_err();
        assert!(matches!(error, LogError::Read { line: 0, .. }), "{error:?}");
    }
    // A chunk that would unpack to a petabyte, of a compression that there is not, and one of no compression that lies.
    for (size, compression, reason) in
        [(1_u64 << 50, "zstd", "more than"), (8, "brotli", "`brotli`"), (8, "", "it has 4 of 8 bytes")]
    {
        let mut chunk = [[0; 16].to_vec(), size.to_le_bytes().to_vec(), vec![0; 4]].concat();
        chunk.extend(u32::to_le_bytes(compression.len() as u32));
        chunk.extend(compression.bytes());
        chunk.extend(u64::to_le_bytes(4));
        chunk.extend([0; 4]);
        let mut bytes = b"\x89MCAP0\r\n\x06".to_vec();
        bytes.extend(u64::to_le_bytes(chunk.len() as u64));
        bytes.extend(chunk);
        std::fs::write(&path, &bytes).unwrap();
        let error = McapLog::new(&path, &TOPICS).unwrap_err().to_string();
        assert!(error.contains("no message can be read") && error.contains(reason), "{error}");
    }
}

/// Bags without checksums, so that damage inside of a chunk gets further; written by the writer of this test.
const SEEDS: [&[u8]; 5] = [
    include_bytes!("../../fuzz/seeds/mcap/none.mcap"),
    include_bytes!("../../fuzz/seeds/mcap/lz4.mcap"),
    include_bytes!("../../fuzz/seeds/mcap/zstd.mcap"),
    include_bytes!("../../fuzz/seeds/mcap/unchunked.mcap"),
    include_bytes!("../../fuzz/seeds/mcap/imu.mcap"),
];

fn assert_sound(outcome: &Outcome) {
    let is_sound = |pose: Pose| pose.is_finite() && pose.heading.abs() <= std::f64::consts::PI;
    for entry in &outcome.entries {
        match entry {
            LogEntry::Odometry { odom_from_robot, .. } => assert!(is_sound(*odom_from_robot)),
            LogEntry::Turn { stamp, by_gyro } => assert!(stamp.is_finite() && by_gyro.is_finite()),
            LogEntry::Truth { .. } => panic!("a bag has no truth"),
            LogEntry::Laser(reading) => {
                assert!(is_sound(reading.odom_from_robot) && is_sound(reading.robot_from_laser), "{reading:?}");
                assert!(reading.first_angle.is_finite() && reading.angle_step.is_finite());
                assert!(reading.max_range > 0.0 && !reading.ranges.is_empty());
            }
        }
    }
    assert!(outcome.stamps().iter().all(|stamp| stamp.is_finite()));
    let LogStats { laser, odometry, turns, malformed, first_malformed, .. } = &outcome.stats;
    assert_eq!(laser + odometry + turns, outcome.entries.len() as u64);
    assert_eq!(first_malformed.is_some(), *malformed > 0);
}

fn the_seeds_are_bags() {
    let folder = tempfile::tempdir().unwrap();
    let (path, mut turns) = (folder.path().join("bag.mcap"), 0);
    for seed in SEEDS {
        std::fs::write(&path, seed).unwrap();
        let outcome = read(&McapLog::new(&path, &TOPICS).unwrap());
        assert_sound(&outcome);
        assert!(outcome.entries.len() >= 6 && outcome.stats.malformed == 0 && outcome.error.is_none());
        turns += outcome.stats.turns;
    }
    assert_eq!(turns, 7, "of the one with an inertial sensor");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]
    fn any_damage_is_survived(
        seed in 0..SEEDS.len(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in prop::option::weighted(0.2, any::<prop::sample::Index>()),
    ) {
        let mut bytes = SEEDS[seed].to_vec();
        for (place, byte) in changes {
            let place = place.index(bytes.len());
            bytes[place] = byte;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(&bytes).unwrap();
        match McapLog::new(file.path(), &TOPICS) {
            Ok(log) => assert_sound(&read(&log)),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }
}

// ---- A gyroscope

/// The rate of rotation of the robot about its vertical \[rad/s\], and how far it has turned \[rad\]; `t` in seconds.
fn rate(t: f64) -> f64 {
    0.8 * (2.0 * t).cos() - 0.3
}

fn turned(t: f64) -> f64 {
    0.4 * (2.0 * t).sin() - 0.3 * t
}

/// Hundred rates a second over ten seconds, and a scan and odometry each 0.3 s. The sensor hangs upside down and is turned: the vertical
/// of the robot is its (0, sin 0.2, -cos 0.2).
fn with_gyro(name: &str, change: impl Fn(u32, Value) -> Value) -> Value {
    let mut messages = vec![fixed(["base", "imu"], [0.1, 0.0, 0.2], [std::f64::consts::PI - 0.2, 0.0, 0.0])];
    for hundredths in 0..=1000_u32 {
        let t = f64::from(hundredths) / 100.0;
        let stamp = json!([1_700_000_000 + hundredths / 100, hundredths % 100 * 10_000_000]);
        // It rocks about the robot's x axis, too.
        let rates = [t.sin(), rate(t) * 0.2_f64.sin(), -rate(t) * 0.2_f64.cos()];
        let imu = json!({"kind": "imu", "topic": "/imu", "stamp": stamp, "frame": "imu", "rates": rates});
        messages.push(change(hundredths, imu));
        if hundredths % 30 == 0 {
            messages.push(odometry("/odom", hundredths / 10, t, 0.1 * t));
            messages.push(scan("/scan", hundredths / 10, "base"));
        }
    }
    json!({"name": name, "messages": messages})
}

/// Turns and their errors.
fn turns(outcome: &Outcome) -> Vec<(f64, f64)> {
    let (mut last, mut turns) = (f64::NAN, Vec::new());
    for pair in outcome.entries.windows(2) {
        if pair[0].is_reading() {
            last = pair[0].stamp() - seconds(0);
        }
        if let LogEntry::Turn { stamp, by_gyro } = pair[0] {
            assert!(pair[1].is_reading() && pair[1].stamp() == stamp, "{pair:?}");
            turns.push((by_gyro, by_gyro - (turned(stamp - seconds(0)) - turned(last))));
        }
    }
    turns
}

fn turns_by_a_gyroscope() {
    let with = |name: &str, storage: &str| {
        let mut bag = with_gyro(name, |_, imu| imu);
        (bag["storage"], bag["compression"]) = (json!(storage), json!("none"));
        bag
    };
    let folder = bags(json!([with("ros2.mcap", "file"), with("sqlite", "sqlite"), with("ros1.bag", "ros1")]));
    for name in ["ros2.mcap", "sqlite", "ros1.bag"] {
        let outcome = read(&*open_log(folder.path().join(name), &TOPICS).unwrap());
        let turns = turns(&outcome);
        // Before each of 68 readings but the first; those of odometry and scan of the same stamp are 0.
        assert_eq!((turns.len(), outcome.stats.turns, outcome.stats.laser), (67, 67, 34), "{name}");
        assert_eq!(outcome.stats.imu, Some(ImuStats { topic: "/imu".to_owned(), messages: 1001, is_mounted: true }));
        assert!(turns.iter().any(|(turn, _)| *turn > 0.1) && turns.iter().any(|(turn, _)| *turn < -0.2), "{turns:?}");
        // Trapezoids of 10 ms are off by 0.8 · 4 · 10⁻⁴ / 12 · 0.3 s at most.
        assert!(turns.iter().all(|(_, error)| error.abs() < 1e-5), "{name}: {turns:?}");
    }
    let none = Topics { imu: ImuTopic::None, ..TOPICS };
    let outcome = read(&*open_log(folder.path().join("ros2.mcap"), &none).unwrap());
    assert_eq!((outcome.stats.turns, outcome.stats.imu.clone()), (0, None));
    assert_eq!(outcome.stats.skipped, [("/imu".to_owned(), 1001)].into());
    let named = Topics { imu: ImuTopic::named("/camera/imu"), ..TOPICS };
    let error = open_log(folder.path().join("ros2.mcap"), &named).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("on /camera/imu (--imu)") && error.contains("/imu (sensor_msgs/msg/Imu"), "{error}");
}

fn a_gyroscope_that_fails() {
    let nan = |hundredths: u32, imu: Value| {
        if (300..330).contains(&hundredths) { changed(imu, "rates", json!([0.0, "nan", 1.0])) } else { imu }
    };
    let off = |hundredths: u32, mut imu: Value| {
        if hundredths >= 500 {
            imu["covariance"] = json!(-1);
        }
        imu
    };
    let elsewhere = |_, imu: Value| changed(imu, "frame", json!("lost"));
    let folder =
        bags(json!([with_gyro("nan.mcap", nan), with_gyro("off.mcap", off), with_gyro("lost.mcap", elsewhere)]));
    for (name, expected, malformed, is_mounted) in
        [("nan.mcap", 64, 30, true), ("off.mcap", 33, 501, true), ("lost.mcap", 67, 0, false)]
    {
        let outcome = read(&*open_log(folder.path().join(name), &TOPICS).unwrap());
        let turns = turns(&outcome);
        assert_eq!((turns.len(), outcome.stats.malformed), (expected, malformed), "{name}");
        assert_eq!((outcome.stats.laser, outcome.stats.odometry), (34, 34), "{name}");
        assert_eq!(outcome.stats.imu.as_ref().map(|imu| imu.is_mounted), Some(is_mounted), "{name}");
        let is_right = turns.iter().all(|(_, error)| error.abs() < 1e-5);
        assert_eq!(is_right, is_mounted, "{name}: {turns:?}");
        if malformed > 0 {
            let first = outcome.stats.first_malformed.unwrap();
            assert!(first.contains("/imu: ") && first.contains("rate of rotation"), "{first}");
        }
    }
}

// ---- Which reader

fn a_log_is_known_by_its_content() {
    let folder = tempfile::tempdir().unwrap();
    let chosen = Topics { scan: vec!["/scan".to_owned()], ..TOPICS };
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, bytes).unwrap();
    };
    write("carmen.mcap", b"ODOM 0 0 0 0 0 0 1 host 0\n");
    write("one.bag", b"#ROSBAG V2.0\n");
    write("old.bag", b"#ROSBAG V1.2\n");
    write("bag.db3", b"SQLite format 3\0");
    write("bag.mcap.zstd", b"\x28\xb5\x2f\xfd\0\0\0\0");
    write("run.rrd", b"RRF2");
    write("empty_file", b"");
    write("sqlite/bag_0.db3", b"SQLite format 3\0");
    write("packed/bag_0.mcap.zstd", b"");
    write("split/bag_0.mcap", b"");
    write("split/bag_1.mcap", b"");
    write("other/readme.txt", b"");
    assert_eq!(read(&*open_log(folder.path().join("carmen.mcap"), &TOPICS).unwrap()).entries.len(), 1);
    let in_memory =
        |name: &str, topics: &Topics| open_bytes(name, std::fs::read(folder.path().join(name)).unwrap(), topics);
    let carmen = in_memory("carmen.mcap", &TOPICS).unwrap();
    assert_eq!((carmen.name().as_str(), read(&*carmen).entries.len()), ("carmen", 1));
    for (name, topics, expected) in [
        ("carmen.mcap", &chosen, "only a bag has topics"),
        ("old.bag", &TOPICS, "rosbag fix"),
        ("bag.db3", &TOPICS, "from a file only"),
        ("bag.mcap.zstd", &TOPICS, "zstd -d"),
    ] {
        let error = in_memory(name, topics).err().expect(name).to_string();
        assert!(error.contains(name) && error.contains(expected), "{error:?} does not say {expected:?}");
    }
    for (name, topics, expected) in [
        ("carmen.mcap", &chosen, "only a bag has topics"),
        ("one.bag", &TOPICS, "no message of type"),
        ("old.bag", &TOPICS, "rosbag fix"),
        ("bag.db3", &TOPICS, "no bag that can be read"),
        ("bag.mcap.zstd", &TOPICS, "zstd -d"),
        ("run.rrd", &TOPICS, "ipslam replay"),
        ("sqlite", &TOPICS, "no bag that can be read"),
        ("packed", &TOPICS, "zstd -d"),
        ("split", &TOPICS, "several files"),
        ("other", &TOPICS, "a folder"),
        ("missing", &TOPICS, "cannot be opened"),
    ] {
        let error = open_log(folder.path().join(name), topics).err().expect(name).to_string();
        assert!(error.contains(name) && error.contains(expected), "{error:?} does not say {expected:?}");
    }
    // What it is shows when it is read.
    let error = open_log(folder.path().join("empty_file"), &TOPICS).unwrap().open().unwrap().next().unwrap();
    assert!(error.unwrap_err().to_string().contains("the file is empty"));
    let error = McapLog::new(folder.path().join("carmen.mcap"), &TOPICS).unwrap_err().to_string();
    assert!(error.contains("carmen.mcap: cannot be opened: it does not begin as MCAP files do"), "{error}");
}

fn folders_of_bags() {
    let messages = json!([odometry("/odom", 0, 1.0, 0.0), scan("/scan", 1, "base")]);
    let folder = bags(json!([
        {"name": "mine", "storage": "folder", "messages": messages},
    ]));
    let log = open_log(folder.path().join("mine"), &TOPICS).unwrap();
    assert_eq!((log.name().as_str(), read(&*log).entries.len()), ("mine", 2));
}

/// Cut off and with bytes turned over, bags of other kinds than MCAP are read as far as they go, or refused.
fn damaged_bags_of_all_kinds_are_survived() {
    let messages = drive("any", "none", true)["messages"].clone();
    let folder = bags(json!([
        {"name": "new", "storage": "sqlite", "messages": messages},
        {"name": "none.bag", "storage": "ros1", "compression": "none", "messages": messages},
        {"name": "lz4.bag", "storage": "ros1", "compression": "lz4", "messages": messages},
        {"name": "bz2.bag", "storage": "ros1", "compression": "bz2", "messages": messages},
    ]));
    let damaged = folder.path().join("damaged");
    for name in ["new/new.db3", "none.bag", "lz4.bag", "bz2.bag"] {
        let bytes = std::fs::read(folder.path().join(name)).unwrap();
        let whole = read(&*open_log(folder.path().join(name), &TOPICS).unwrap());
        assert!(whole.error.is_none() && whole.entries.len() > 10, "{name}: {:?}", whole.error);
        let (mut refused, mut less) = (0, 0);
        for trial in 0..60 {
            let mut bytes = bytes.clone();
            let place = bytes.len() * (trial / 2 + 1) / 32;
            if trial % 2 == 0 {
                bytes.truncate(place)
            } else {
                bytes[place] ^= 0xff
            }
            std::fs::write(&damaged, bytes).unwrap();
            let Ok(log) = open_log(&damaged, &TOPICS) else {
                refused += 1;
                continue;
            };
            let outcome = read(&*log);
            assert_sound(&outcome);
            less += usize::from(outcome.entries.len() < whole.entries.len());
        }
        println!("{name}: {refused} refused, {less} with less");
        assert!(refused + less > 10, "{name}: no damage was noticed");
    }
}

fn the_program_maps_a_bag() {
    let (folder, _) = carmen_as_bags();
    let run = |arguments: &[&str]| {
        let mut command = assert_cmd::Command::cargo_bin("ipslam").unwrap();
        command.current_dir(folder.path()).args(["run", "--particles", "4", "--maps", "4", "--max-scans", "20"]);
        command.args(arguments).assert()
    };
    let output = run(&["folder", "--odom-topic", "/tf"]).success();
    let text = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
    assert!(text.contains("folder: 20 scans") && !text.contains("is mounted"), "{text}");
    let output = run(&["zstd.mcap", "--scan-topic", "/none"]).failure().code(1);
    let text = String::from_utf8_lossy(&output.get_output().stderr).into_owned();
    assert!(
        text.contains("on /none (--scan-topic)") && text.contains("/scan (sensor_msgs/msg/LaserScan, 300"),
        "{text}"
    );
}

crate::needs::trials! {
    "mcap":
    DataAndPython { a_bag_tells_what_the_carmen_log_told, a_bag_gives_the_map_of_the_carmen_log, a_bag_in_several_files_is_read_as_its_metadata_tells, the_program_maps_a_bag }
    Python { odometry_at_a_scan_lies_between_its_neighbours, where_the_laser_is_mounted, the_user_chooses_among_topics, several_lasers_take_turns, malformed_messages_are_left_out_and_counted, a_bag_of_ros_1_tells_the_same, ranges_that_are_none_are_marked, a_bag_that_was_cut_off_is_read_as_far_as_it_goes, a_stream_is_read_as_it_comes, a_damaged_chunk_is_left_out, folders_of_bags, turns_by_a_gyroscope, a_gyroscope_that_fails, damaged_bags_of_all_kinds_are_survived }
    Nothing { sizes_are_not_taken_at_their_word, the_seeds_are_bags, any_damage_is_survived, a_log_is_known_by_its_content }
}
