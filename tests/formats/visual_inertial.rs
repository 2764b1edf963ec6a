//! Recordings of a camera and an inertial sensor.

use crate::needs::data_folder;
use assert_cmd::cargo::cargo_bin;
use ipslam::geometry::{Pinhole, Pose3, StampedPose3};
use ipslam::inertial::{ImuNoise, ImuReading};
use ipslam::io::datasets::imu_tracks;
use ipslam::io::{tum, visual_inertial};
use ipslam::visual_inertial::{Camera, Feature, FeatureFrame, Recording};
use nalgebra::{Point2, Point3, UnitQuaternion, Vector3};
use std::path::Path;
use std::process::Command;

const SENSORS: &str = "classes = [\"chair\"]\n[camera]\nfocal = [450, 455.5]\ncentre = [320, 240]\nposition = [0.1, 0, -0.2]\n\
                       quaternion = [0, 0, 0, 1]\n[imu]\nrate = 1e-3\n";
const IMU: &str = "t,wx,wy,wz,ax,ay,az\n0,0.1,0.2,0.3,0,0,9.8\n0.005,0.1,0.2,0.3,0.5,0,9.7\n";
const TRACKS: &str = "t,track,u,v\n0,7,100.5,200\n0,9,50,60\n0.05,,,\n0.1,7,101,201\n";

fn read(changes: &[(&str, &str)]) -> Result<Recording, String> {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [("sensors.toml", SENSORS), ("imu.csv", IMU), ("tracks.csv", TRACKS)].iter().chain(changes) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    visual_inertial::read(folder.path()).map_err(|error| error.to_string())
}

fn good() -> Recording {
    let reading = |stamp, force| ImuReading { stamp, rate: Vector3::new(0.1, 0.2, 0.3), force };
    let feature = |track, u, v| Feature { track, pixel: Point2::new(u, v) };
    Recording {
        camera: Camera {
            pinhole: Pinhole { focal: [450.0, 455.5], centre: [320.0, 240.0] },
            body_from_camera: Pose3::new(Point3::new(0.1, 0.0, -0.2), UnitQuaternion::identity()),
            noise: 1.5,
        },
        imu_noise: ImuNoise { rate: 1e-3, ..ImuNoise::default() },
        imu: vec![reading(0.0, Vector3::new(0.0, 0.0, 9.8)), reading(0.005, Vector3::new(0.5, 0.0, 9.7))],
        frames: vec![
            FeatureFrame { stamp: 0.0, features: vec![feature(7, 100.5, 200.0), feature(9, 50.0, 60.0)] },
            FeatureFrame { stamp: 0.05, features: Vec::new() },
            FeatureFrame { stamp: 0.1, features: vec![feature(7, 101.0, 201.0)] },
        ],
    }
}

fn a_folder_is_read() {
    assert_eq!(read(&[]).unwrap(), good());
}

fn what_is_written_is_read_back() {
    let mut recording = good();
    recording.frames[0].stamp = -1.0 / 3.0;
    recording.imu[0].rate.x = 1e-17;
    recording.camera.noise = 0.3;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new/folder");
    for _ in 0..2 {
        visual_inertial::write(&path, &recording).unwrap();
        assert_eq!(visual_inertial::read(&path).unwrap(), recording);
    }
}

fn bad_input_is_an_error_that_says_where() {
    let quaternion = SENSORS.replace("quaternion = [0, 0, 0, 1]", "quaternion = [0, 0, 0, 2]");
    let focal = SENSORS.replace("450,", "-450,");
    let typo = SENSORS.replace("centre", "center");
    let twice = format!("{IMU}0.005,0,0,0,0,0,9.8\n");
    let backwards = format!("{TRACKS}0.05,8,1,2\n");
    for (name, text, expected) in [
        ("sensors.toml", "classes = [\"chair\"]\n", "camera"),
        ("sensors.toml", &quaternion, "length of camera.quaternion is 2"),
        ("sensors.toml", &focal, "camera.focal is -450"),
        ("sensors.toml", &typo, "line 4"),
        ("sensors.toml", &format!("{SENSORS}rate_walk = 5.0\n"), "imu.rate_walk is 5"),
        ("imu.csv", "t,wx,wy,wz,ax,ay\n0,0,0,0,0,0\n", "t,wx,wy,wz,ax,ay,az"),
        ("imu.csv", "t,wx,wy,wz,ax,ay,az\n", "no row"),
        ("imu.csv", &twice, "imu.csv:4: its stamp, 0.005, does not come after"),
        ("imu.csv", &format!("{IMU}0.01,0,0,nan,0,0,9.8\n"), "imu.csv:4: wz is `nan`"),
        ("tracks.csv", &backwards, "tracks.csv:6: its stamp, 0.05, lies before"),
        ("tracks.csv", &format!("{TRACKS}0.1,7,3,4\n"), "tracks.csv:6: track 7 comes twice at 0.1"),
        ("tracks.csv", &format!("{TRACKS}0.1,,,\n"), "tracks.csv:6: a row without a track"),
        ("tracks.csv", &format!("{TRACKS}0.2,-3,3,4\n"), "tracks.csv:6: track is `-3`"),
        ("tracks.csv", &format!("{TRACKS}0.2,3,,4\n"), "tracks.csv:6: u is empty"),
    ] {
        let message = read(&[(name, text)]).unwrap_err();
        assert!(message.contains(name) && message.contains(expected), "{message:?} does not say {expected:?}");
    }
    let folder = tempfile::tempdir().unwrap();
    let message = visual_inertial::read(folder.path()).unwrap_err().to_string();
    assert!(message.contains("sensors.toml"), "{message}");
}

fn poses_of_space_are_read_back() {
    let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -2.0, 0.4));
    let pose = StampedPose3 { stamp: 1_134_864_645.903_21, pose: Pose3::new(Point3::new(1.0, -2.0, 1e4), rotation) };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("poses.tum");
    tum::write3(&path, &[pose]).unwrap();
    let back = tum::read3(&path).unwrap();
    assert_eq!((back.len(), back[0].stamp), (1, pose.stamp));
    assert!((back[0].pose.position - pose.pose.position).norm() < 1e-9);
    assert!(back[0].pose.rotation.angle_to(&rotation) < 1e-7);
    for (text, expected) in [("1 2 3 0.5\n", "4 columns"), ("1 2 3 4 0 0 0 0\n", "no length")] {
        std::fs::write(&path, text).unwrap();
        let message = tum::read3(&path).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
}

fn euroc_is_read() {
    let (recording, truth) = imu_tracks::read(&data_folder().join("semantic/vio_v101_30s")).unwrap();
    assert_eq!((recording.imu.len(), recording.frames.len()), (6001, 601));
    let features: usize = recording.frames.iter().map(|frame| frame.features.len()).sum();
    assert_eq!(features, 13316);
    // 1.93 pixels at a focal length of 458 pixels.
    assert!((recording.camera.noise * 458.0 - 1.93).abs() < 0.01, "{}", recording.camera.noise);
    assert!(truth.first().unwrap().stamp <= recording.frames[0].stamp + 1e-3 && truth.len() > 600);

    let new = tempfile::tempdir().unwrap();
    let output = new.path().join("v101");
    let convert = |output: &Path| {
        let folder = data_folder().join("semantic/vio_v101_30s");
        Command::new(cargo_bin("ipslam")).arg("convert").args([&folder, output]).output().unwrap()
    };
    let converted = convert(&output);
    assert!(converted.status.success(), "{}", String::from_utf8_lossy(&converted.stderr));
    assert_eq!(visual_inertial::read(&output).unwrap(), recording);
    assert_eq!(tum::read3(&output.join("truth.tum")).unwrap().len(), truth.len());
    let again = String::from_utf8(convert(&output).stderr).unwrap();
    assert!(again.contains("needs a new folder"), "{again}");
    let message = imu_tracks::read(&data_folder()).unwrap_err().to_string();
    assert!(message.contains("imu_tracks.csv"), "{message}");
}

crate::needs::trials! {
    "visual_inertial":
    Nothing {
        a_folder_is_read, what_is_written_is_read_back, bad_input_is_an_error_that_says_where,
        poses_of_space_are_read_back,
    }
    Data { euroc_is_read }
}
