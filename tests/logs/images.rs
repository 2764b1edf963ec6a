//! Pictures of a real drive, scored by its true poses.

use crate::needs::{data, data_folder};
use assert_cmd::cargo::cargo_bin;
use image::RgbImage;
use ipslam::geometry::{Pinhole, Pose3, StampedPose3};
use ipslam::images::{Detector, Keyframe, Tracker, VisualOdometry};
use ipslam::io::pictures::read_picture;
use ipslam::io::tum;
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

const CAMERA: Pinhole = Pinhole { focal: [707.0912; 2], centre: [601.8873, 183.1104] };

/// `world_from_camera` of the 51 pictures.
fn truth() -> Vec<StampedPose3> {
    let text = std::fs::read_to_string(data("semantic/kitti_odometry_poses/06.txt")).unwrap();
    let pose = |(number, line): (usize, &str)| {
        let n: Vec<f64> = line.split_whitespace().map(|word| word.parse().unwrap()).collect();
        let rotation = Rotation3::from_matrix(&Matrix3::new(n[0], n[1], n[2], n[4], n[5], n[6], n[8], n[9], n[10]));
        let pose = Pose3::new(Point3::new(n[3], n[7], n[11]), UnitQuaternion::from_rotation_matrix(&rotation));
        StampedPose3 { stamp: 0.1 * number as f64, pose }
    };
    let poses: Vec<StampedPose3> = text.lines().take(51).enumerate().map(pose).collect();
    assert_eq!(poses.len(), 51);
    poses
}

fn picture(number: usize) -> RgbImage {
    read_picture(&data(&format!("semantic/images/kitti06_51/image_l/{number:06}.png"))).unwrap()
}

/// The share of tracks that lie within two pixels of their level from the epipolar line of a motion.
fn share_on_lines(before: &Keyframe, now: &Keyframe, motion: Pose3) -> (u32, f64) {
    let places: BTreeMap<u64, _> = before.features.iter().map(|feature| (feature.track, feature.pixel)).collect();
    let (mut count, mut right) = (0_u32, 0_u32);
    for (feature, scale) in now.features.iter().zip(&now.scales) {
        let Some(place) = places.get(&feature.track) else { continue };
        let along = motion.rotation * CAMERA.ray(feature.pixel).coords;
        let line = motion.position.coords.cross(&along);
        let off = CAMERA.ray(*place).coords.dot(&line) / line.xy().norm() * CAMERA.focal[0];
        count += 1;
        right += u32::from(off.abs() < 2.0 * scale);
    }
    (count, f64::from(right) / f64::from(count.max(1)))
}

/// The first 1.3 s of KITTI 06: tracks lie on the epipolar lines of the true poses, and the way that they tell is right.
fn tracks_and_way_of_kitti() {
    let truth = truth();
    let (mut tracker, mut odometry) = (Tracker::new(CAMERA), VisualOdometry::new(CAMERA));
    let mut last: Option<(usize, Keyframe)> = None;
    let (mut tracks, mut right, mut way) = (0, 0.0, 0.0);
    for number in 0..14 {
        let grey = image::DynamicImage::ImageRgb8(picture(number)).into_luma8();
        let Some(keyframe) = tracker.add(&grey) else { continue };
        odometry.add(truth[number].stamp, &keyframe).unwrap();
        if let Some((before, seen)) = &last {
            let motion = truth[number].pose.seen_from(truth[*before].pose);
            let (count, share) = share_on_lines(seen, &keyframe, motion);
            assert!(count > 50, "{count} tracks of picture {number}");
            (tracks, right) = (tracks + count, right + share * f64::from(count));
            let turned = motion * Pose3::new(Point3::origin(), UnitQuaternion::from_euler_angles(0.02, 0.02, 0.0));
            assert!(share_on_lines(seen, &keyframe, turned).1 < 0.5);
            way += motion.position.coords.norm();
        }
        last = Some((number, keyframe));
    }
    let share = right / f64::from(tracks);
    assert!(share > 0.9, "{share} of {tracks} tracks lie on their lines");
    odometry.finish().unwrap();
    let path = odometry.path();
    assert!(path.len() >= 6, "{} keyframes", path.len());
    let steps = path.windows(2).map(|ends| (ends[1].pose.position - ends[0].pose.position).norm());
    let scale = way / steps.sum::<f64>();
    let end = path.last().unwrap();
    let true_end = truth.iter().find(|pose| pose.stamp == end.stamp).unwrap().pose.seen_from(truth[0].pose);
    let off = (end.pose.position.coords * scale - true_end.position.coords).norm();
    println!("end off by {off:.3} m of {way:.2}; share on lines {share:.3}");
    assert!(off < 0.03 * way, "off by {off} m of {way}");
}

fn detector() -> Detector {
    let model = data("semantic/images/detector/ssd_mobilenet_v2_oidv4_300.onnx");
    Detector::load(&model, &data("semantic/images/detector/labels.txt")).unwrap()
}

/// The set's own measurements: cars at 0.8, the cabinet as "Box" at 0.6 to 0.7, by another program.
fn a_detector_sees_cars_and_a_cabinet() {
    let detector = detector();
    let class = |name: &str| detector.labels().iter().position(|label| label == name).unwrap();
    let (car, cabinet) = (class("Car"), class("Box"));
    let cars = detector.detect(&picture(0), &[car], 0.5).unwrap();
    assert!(cars[0].score > 0.75 && cars[0].class == car, "{cars:?}");
    let [u, v] = cars[0].centre();
    assert!((u - 780.0).abs() < 15.0 && (v - 209.0).abs() < 15.0, "{cars:?}");
    let picture = read_picture(&data("semantic/images/cabinet_rgbd/raw_imgs/0008_rgb_raw.jpg")).unwrap();
    let boxes = detector.detect(&picture, &[car, cabinet], 0.5).unwrap();
    assert!(boxes.len() == 1 && boxes[0].class == cabinet && boxes[0].score > 0.6, "{boxes:?}");
    assert!(detector.detect(&RgbImage::new(300, 300), &[car], 0.5).unwrap().is_empty());
}

/// From pictures alone, the length of the way given: the path ends within 3 % of it, and parked cars are on the map.
fn kitti_from_pictures_alone() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let truth = truth();
    let way: f64 = truth.windows(2).map(|ends| (ends[1].pose.position - ends[0].pose.position).norm()).sum();
    let pictures = data_folder().join("semantic/images/kitti06_51/image_l");
    let text = format!("folder = {:?}\nrate = 10.0\nway = {way}\n", pictures.to_str().unwrap());
    std::fs::write(folder.join("pictures.toml"), text).unwrap();
    std::fs::write(folder.join("sensors.toml"), SENSORS).unwrap();
    tum::write3(&folder.join("truth.tum"), &truth).unwrap();
    let (out, figures) = (folder.join("out"), folder.join("figures"));
    let of_detector = |name: &str| data(&format!("semantic/images/detector/{name}"));
    let done = Command::new(cargo_bin("ipslam"))
        .args([Path::new("semantic"), folder, Path::new("--out"), &out, Path::new("--figures"), &figures])
        .args([Path::new("--detector"), &of_detector("ssd_mobilenet_v2_oidv4_300.onnx")])
        .args([Path::new("--labels"), &of_detector("labels.txt")])
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let path = tum::read3(&out.join("trajectory.tum")).unwrap();
    let end = path.last().unwrap();
    let true_end = truth.iter().find(|pose| (pose.stamp - end.stamp).abs() < 1e-6).unwrap();
    let first = truth.iter().find(|pose| (pose.stamp - path[0].stamp).abs() < 1e-6).unwrap();
    let off = (end.pose.position - true_end.pose.seen_from(first.pose).position).norm();
    let landmarks = std::fs::read_to_string(out.join("landmarks.csv")).unwrap().lines().count() - 1;
    println!("end off by {off:.3} m of {way:.2}, {landmarks} cars");
    assert!(off < 0.03 * way, "off by {off} m of {way}");
    assert!((4..=7).contains(&landmarks), "{landmarks} cars");
    assert!(out.join("recording/tracks.csv").is_file() && figures.join("000000.png").is_file());
}

/// Cars and their boxes as in KITTI tracking.
const SENSORS: &str = r#"kind = "stereo"
classes = ["Car"]
label_accuracy = 0.99

[camera]
focal = [707.0912, 707.0912]
centre = [601.8873, 183.1104]
baseline = 1.52
reach = 2.1

[noise]
u = 3.0
v = 2.0
disparity = 1.0
share = 0.07

[detector]
detection_probability = 0.6
clutter = 0.1

[odometry]
position_per_metre = 0.02
rotation_per_metre = 0.001
rotation_per_radian = 0.01
scale = 0.005
turn_scale = 0.003
"#;

crate::needs::trials! {
    "images":
    Data { tracks_and_way_of_kitti, a_detector_sees_cars_and_a_cabinet }
    WholeLogs { kitti_from_pictures_alone }
}
