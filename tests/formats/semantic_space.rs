//! Recordings of detections in space, and published sets made into them.

use crate::needs::data_folder;
use assert_cmd::cargo::cargo_bin;
use ipslam::detections::{Detection3, DetectionKind, Frame, Odometry3, Recording3, Sensors3, Velocity3};
use ipslam::geometry::{Pinhole, Pose3, StampedPose3};
use ipslam::io::datasets::{self, Dataset3, Options};
use ipslam::io::semantic::{self, ReadRecording, truth};
use nalgebra::{Point3, Quaternion, UnitQuaternion};
use std::process::Command;
use tempfile::TempDir;

const SENSORS: &str = "kind = 'stereo'\nclasses = ['tree', 'car']\n[camera]\nfocal = [500, 400]\ncentre = [320, 240]\n\
                        baseline = 0.2\n";
const ODOMETRY: &str = "t,vx,vy,vz,wx,wy,wz\n0,1,2,3,0.1,0.2,0.3\n2,0,0,0,0,0,0\n";
const DETECTIONS: &str = "t,class,score,u,v,disparity\n0,tree,0.5,300,200,10\n0,car,,10,20,5\n1,,,,,\n";

fn folder(changes: &[(&str, &[u8])]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let good = [("sensors.toml", SENSORS), ("odometry.csv", ODOMETRY), ("detections.csv", DETECTIONS)];
    for (name, text) in good.map(|(name, text)| (name, text.as_bytes())).iter().chain(changes) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

fn a_folder_of_space_is_read() {
    let made = folder(&[]);
    assert_eq!(semantic::read_kind(made.path()).unwrap(), DetectionKind::Stereo);
    let ReadRecording { recording, warnings } = semantic::read3(made.path()).unwrap();
    let camera = Pinhole { focal: [500.0, 400.0], centre: [320.0, 240.0] };
    let speed = |stamp, v: [f64; 3], w: [f64; 3]| Velocity3 { stamp, linear: v.into(), angular: w.into() };
    let seen = |class, score, u, v, disparity| Detection3 { class, score, pixel: [u, v], disparity };
    let mut expected = Recording3 {
        sensors: Sensors3::new(vec!["tree".to_owned(), "car".to_owned()], 0.9, camera, 0.2),
        odometry: Odometry3::Velocities(vec![
            speed(0.0, [1.0, 2.0, 3.0], [0.1, 0.2, 0.3]),
            speed(2.0, [0.0; 3], [0.0; 3]),
        ]),
        frames: vec![
            Frame { stamp: 0.0, detections: vec![seen(0, 0.5, 300.0, 200.0, 10.0), seen(1, 1.0, 10.0, 20.0, 5.0)] },
            Frame { stamp: 1.0, detections: Vec::new() },
        ],
    };
    assert!(recording == expected && warnings.is_empty(), "{recording:?} {warnings:?}");

    // What is written is read back.
    expected.sensors.confusion = vec![vec![0.7, 0.3], vec![0.1, 0.9]];
    expected.sensors.robot_from_camera.position = Point3::new(0.1, -0.2, 0.3);
    expected.sensors.noise.share = 0.1;
    let quarter =
        Pose3::new(Point3::new(0.1, -0.2, 0.3), UnitQuaternion::from_quaternion(Quaternion::new(0.5, 0.5, -0.5, 0.5)));
    let poses = [(0.1, Pose3::identity()), (0.4, quarter)].map(|(stamp, pose)| StampedPose3 { stamp, pose });
    for odometry in [expected.odometry.clone(), Odometry3::Poses(poses.to_vec())] {
        expected.odometry = odometry;
        let again = tempfile::tempdir().unwrap();
        semantic::write3(again.path(), &expected).unwrap();
        assert_eq!(semantic::read3(again.path()).unwrap().recording, expected);
    }
}

fn what_is_wrong_with_a_folder_of_space_is_told() {
    let detections = |row: &str| format!("t,class,score,u,v,disparity\n{row}\n").into_bytes();
    let sensors = |with: &str| SENSORS.replace("baseline = 0.2", with).into_bytes();
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        ("detections.csv", detections("0,tree,,1,2,0"), ":2: disparity is 0"),
        ("detections.csv", detections("0,,,1,2,3"), ":2: class is empty"),
        ("detections.csv", detections("0,tree,,1,inf,3"), ":2: v is `inf`"),
        ("detections.csv", b"t,class,score,range,bearing\n".into(), "have the columns t,class,score,u,v,disparity"),
        ("odometry.csv", b"t,v,omega\n0,1,0\n".into(), "odometry of space has the columns"),
        ("odometry.csv", b"t,x,y,z,qx,qy,qz,qw\n0,1,2,3,0,0,0,0\n".into(), ":2: the quaternion has no length"),
        ("odometry.csv", b"t,vx,vy,vz,wx,wy,wz\n".into(), "no row besides the header"),
        ("sensors.toml", sensors("baseline = -1"), "camera.baseline is -1"),
        ("sensors.toml", sensors("baseline = 1\nquaternion = [0, 0, 0, 2]"), "camera.quaternion is 2"),
        ("sensors.toml", sensors(""), "baseline"),
    ];
    for (name, text, expected) in cases {
        let message = semantic::read3(folder(&[(name, &text)]).path()).unwrap_err().to_string();
        assert!(message.contains(expected) && message.contains(name), "{message:?} does not say {expected:?}");
    }
}

fn starry_night_is_converted() {
    let folder = data_folder().join("semantic/starry_night");
    assert_eq!(datasets::recognise3(&folder), Some(Dataset3::StarryNight));
    let options = Options { classes: Some(4), rows: Some((1214, 1714)), ..Options::default() };
    let converted = Dataset3::StarryNight.read(&folder, &options).unwrap();
    let made = tempfile::tempdir().unwrap();
    datasets::write3(made.path(), &converted).unwrap();
    let ReadRecording { recording, warnings } = semantic::read3(made.path()).unwrap();
    assert!(recording.frames == converted.recording.frames && warnings.is_empty(), "{warnings:?}");
    assert_eq!(truth::read_ids(&made.path().join(truth::IDS), &recording.frames).unwrap(), converted.ids);
    assert_eq!((recording.frames.len(), converted.trajectory.len(), converted.landmarks.len()), (501, 501, 20));
    // Detections are where the true poses put the points.
    let mut off = Vec::new();
    for ((frame, ids), pose) in recording.frames.iter().zip(&converted.ids).zip(&converted.trajectory) {
        for (seen, id) in frame.detections.iter().zip(ids) {
            let landmark = converted.landmarks.iter().find(|landmark| Some(landmark.id) == *id).unwrap();
            off.push((pose.pose * recording.sensors.position(seen) - landmark.position).norm());
        }
    }
    off.sort_by(f64::total_cmp);
    assert!(off.len() > 1500 && off[off.len() / 2] < 0.03, "{} m", off[off.len() / 2]);
    // The rates turn the way the rig does.
    let (first, last) = (&converted.trajectory[0], &converted.trajectory[60]);
    let motion = recording.odometry.motion(first.stamp, last.stamp).start_from_end;
    let (true_motion, none) = (last.pose.seen_from(first.pose), Pose3::identity());
    let error = motion.rotation.angle_to(&true_motion.rotation);
    assert!(error < 0.5 * none.rotation.angle_to(&true_motion.rotation), "{error}");
}

/// A robot stands still, and sees a tree and a car in each of twelve frames. The oracle: similar triangles.
fn a_recording_of_space_is_mapped_to_files() {
    let rows = (0..12).map(|frame| format!("{frame},tree,,420,280,20\n{frame},car,,220,240,50\n"));
    let detections = format!("t,class,score,u,v,disparity\n{}", rows.collect::<String>());
    let odometry = b"t,vx,vy,vz,wx,wy,wz\n0,0,0,0,0,0,0\n";
    let made = folder(&[("detections.csv", detections.as_bytes()), ("odometry.csv", odometry)]);
    let out = made.path().join("out");
    let done =
        Command::new(cargo_bin("ipslam")).arg("semantic").arg(made.path()).arg("--out").arg(&out).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let lines = |name: &str| -> Vec<String> {
        std::fs::read_to_string(out.join(name)).unwrap().lines().map(str::to_owned).collect()
    };
    let landmarks = lines("landmarks.csv");
    assert_eq!(landmarks[0], "landmark,class,x,y,z,xx,xy,xz,yy,yz,zz,weight");
    for (class, expected) in [("tree", [1.0, 0.5, 5.0]), ("car", [-0.4, 0.0, 2.0])] {
        let row = landmarks.iter().find(|row| row.split(',').nth(1) == Some(class)).unwrap();
        let position = row.split(',').skip(2).take(3).map(|number| number.parse::<f64>().unwrap());
        assert!(position.zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-3), "{row}");
    }
    assert_eq!(landmarks.len(), 3, "{landmarks:?}");
    let covariances = lines("covariances.csv");
    assert!(covariances[0].starts_with("t,xx,xy,xz,xrx,xry,xrz,yy,"), "{}", covariances[0]);
    assert_eq!((covariances.len(), covariances[1].split(',').count()), (13, 22));
    assert!(lines("trajectory.tum")[1].starts_with("0.000000 0.0") && out.join("map.png").is_file());
    assert!(lines("summary.json").iter().any(|line| line.contains("turn_scale")));
}

/// The middle of a box is where the true pose puts the car, to a fifth of its size.
fn kitti_is_converted() {
    let tracking = data_folder().join("semantic/kitti_tracking/0005");
    let odometry = data_folder().join("semantic/kitti_odometry_poses");
    assert_eq!(datasets::recognise3(&tracking), Some(Dataset3::KittiTracking));
    assert_eq!(datasets::recognise3(&odometry), Some(Dataset3::KittiOdometry));
    let drive = |robot, seed| Options { robot, seed, ..Options::default() };
    let real = Dataset3::KittiTracking.read(&tracking, &drive(None, None)).unwrap();
    let made = Dataset3::KittiOdometry.read(&odometry, &drive(Some(6), Some(3))).unwrap();
    assert_eq!((real.recording.frames.len(), real.landmarks.len()), (297, 22));
    for converted in [&real, &made] {
        let sensors = &converted.recording.sensors;
        let (mut off, mut depths) = (Vec::new(), Vec::new());
        for ((frame, ids), pose) in converted.recording.frames.iter().zip(&converted.ids).zip(&converted.trajectory) {
            assert!((frame.stamp - pose.stamp).abs() < 1e-9);
            for (seen, id) in frame.detections.iter().zip(ids) {
                let Some(car) = converted.landmarks.iter().find(|car| Some(car.id) == *id) else { continue };
                let place = (pose.pose * sensors.robot_from_camera).inverse() * car.position;
                let u = sensors.camera.focal[0] * place.x / place.z + sensors.camera.centre[0];
                off.push((u - seen.pixel[0]).abs() / seen.disparity);
                depths.push((sensors.depth(seen) / place.z - 1.0).abs());
            }
        }
        off.sort_by(f64::total_cmp);
        depths.sort_by(f64::total_cmp);
        let (off, depth) = (off[off.len() / 2], depths[depths.len() / 2]);
        assert!(depths.len() > 400 && off < 0.2 && depth < 0.1, "{off} of the height, {depth} of the depth");
    }
    assert!(Dataset3::KittiOdometry.read(&odometry, &drive(Some(6), Some(3))).unwrap() == made);
    assert!(Dataset3::KittiOdometry.read(&odometry, &drive(Some(6), Some(4))).unwrap() != made);
}

/// By the true poses, the boxes of the one teddy bear agree on where it is; if it were twice as high, they would not.
fn an_office_is_converted() {
    let folder = data_folder().join("semantic/tum_fr3_office");
    assert_eq!(datasets::recognise3(&folder), Some(Dataset3::TumOffice));
    let read = Dataset3::TumOffice.read(&folder, &Options::default()).unwrap();
    let Recording3 { sensors, frames, .. } = &read.recording;
    assert!(frames.len() == 2585 && read.trajectory.len() == 2585 && read.recording.detections() == 6370);
    let bear = sensors.classes.iter().position(|class| class == "teddy bear").unwrap();
    let spread = |nearer: f64| {
        let seen = frames.iter().zip(&read.trajectory).flat_map(|(frame, at)| {
            let bears = frame.detections.iter().filter(|seen| seen.class == bear);
            bears.map(|seen| {
                let seen = Detection3 { disparity: nearer * seen.disparity, ..*seen };
                at.pose * sensors.position(&seen)
            })
        });
        let places: Vec<Point3<f64>> = seen.collect();
        let median = |mut numbers: Vec<f64>| {
            numbers.sort_by(f64::total_cmp);
            numbers[numbers.len() / 2]
        };
        let middle = Point3::from([0, 1, 2].map(|axis| median(places.iter().map(|place| place[axis]).collect())));
        median(places.iter().map(|place| (place - middle).norm()).collect())
    };
    assert!(spread(1.0) < 0.2, "{}", spread(1.0));
    assert!(spread(2.0) > 0.5, "{}", spread(2.0));
}

crate::needs::trials! {
    "semantic_space":
    Nothing {
        a_folder_of_space_is_read, what_is_wrong_with_a_folder_of_space_is_told,
        a_recording_of_space_is_mapped_to_files,
    }
    Data { starry_night_is_converted, kitti_is_converted, an_office_is_converted }
}
