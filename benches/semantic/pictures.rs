//! Maps made of pictures.

use super::{Failure, on_one_thread};
use ipslam::detections::{Detector3, OdometryNoise3, PixelNoise, Sensors3};
use ipslam::geometry::{Pinhole, Pose3, StampedPose3};
use ipslam::images::{Detector, FrontEnd};
use ipslam::io::pictures::read_picture;
use ipslam::semantic::{SemanticConfig, Space, map};
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion};
use std::path::Path;

const PICTURES: usize = 51;

pub fn page(folder: &Path) -> Result<String, Failure> {
    let truth = read_truth(&folder.join("kitti_odometry_poses/06.txt"))?;
    let way: f64 = truth.windows(2).map(|ends| (ends[1].position - ends[0].position).norm()).sum();
    let images = folder.join("images");
    let model = images.join("detector/ssd_mobilenet_v2_oidv4_300.onnx");
    let detector = Detector::load(&model, &images.join("detector/labels.txt"))?;
    let mut front_end = FrontEnd::new(sensors(), &detector, 0.5)?;
    let (read, seconds) = on_one_thread(|| {
        for number in 0..PICTURES {
            let picture = read_picture(&images.join(format!("kitti06_51/image_l/{number:06}.png")))?;
            front_end.add(number as f64, &picture)?;
        }
        Ok::<_, Failure>(front_end.finish(way)?)
    })?;
    let (recording, _) = read?;
    let config = SemanticConfig { interval: 0.0, ..SemanticConfig::default() };
    let found = map::<Space>(&recording, &config, &|_| ())?;
    let path = found.trajectory3();
    let (first, last) = path.first().zip(path.last()).ok_or("the map has no path")?;
    let true_pose = |at: &StampedPose3| truth[at.stamp as usize];
    let end = true_pose(last).seen_from(true_pose(first)).position;
    let off = (last.pose.seen_from(first.pose).position - end).norm();
    Ok(format!(
        "## KITTI 06, the first 51 pictures
From the pictures of one camera and a detector; the length of the way is given. Of {way:.1} m the end is off by {off:.2} m,
{:.1} %. {} landmarks from {} boxes of cars; the map is called {}; {seconds:.0} s for the pictures.\n\n",
        100.0 * off / way,
        found.landmarks.len(),
        recording.detections(),
        if found.verdict.is_consistent() { "consistent" } else { "doubtful" },
    ))
}

/// Cars and their boxes as in KITTI tracking.
fn sensors() -> Sensors3 {
    let camera = Pinhole { focal: [707.0912; 2], centre: [601.8873, 183.1104] };
    let mut sensors = Sensors3::new(vec!["Car".to_owned()], 1.0, camera, 1.52);
    sensors.reach = 2.1;
    sensors.noise = PixelNoise { u: 3.0, v: 2.0, disparity: 1.0, share: 0.07 };
    sensors.detector = Detector3 { detection_probability: 0.6, clutter: 0.1 };
    sensors.odometry = OdometryNoise3 {
        position_per_metre: 0.02,
        rotation_per_metre: 0.001,
        rotation_per_radian: 0.01,
        scale: 0.005,
        turn_scale: 0.003,
        ..OdometryNoise3::default()
    };
    sensors
}

fn read_truth(path: &Path) -> Result<Vec<Pose3>, Failure> {
    let pose = |line: &str| {
        let n = line.split_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>()?;
        let rotation = Rotation3::from_matrix(&Matrix3::new(n[0], n[1], n[2], n[4], n[5], n[6], n[8], n[9], n[10]));
        Ok::<_, Failure>(Pose3::new(Point3::new(n[3], n[7], n[11]), UnitQuaternion::from_rotation_matrix(&rotation)))
    };
    std::fs::read_to_string(path)?.lines().take(PICTURES).map(pose).collect()
}
