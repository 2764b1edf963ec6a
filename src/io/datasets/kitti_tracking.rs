//! KITTI tracking: a car drives among parked and moving cars, ten pictures a second (Geiger, Lenz, Urtasun, CVPR 2012).
//!
//! `det2d_rrc_car.csv` has the boxes that a detector drew around cars, `vo_orbslam3.txt` the way of the camera by visual odometry,
//! `calib.txt` the cameras; `label.txt` and `oxts.txt` the true boxes with the names of their tracks, and the true way. A box has
//! a centre and a height: a car is as far as its height in the picture tells.

use super::{Converted3, numbers};
use crate::detections::{Detection3, Detector3, Frame, Odometry3, OdometryNoise3, PixelNoise, Recording3, Sensors3};
use crate::geometry::{Pinhole, Pose3, StampedPose3};
use crate::io::lines::Lines;
use crate::io::semantic::truth::{Ids, TrueLandmark};
use crate::io::table::{Layout, read_table};
use crate::log::LogError;
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::path::Path;

const EXPECTED: &str = "a file of KITTI tracking has other columns";
/// From one picture to the next \[s\].
const INTERVAL: f64 = 0.1;
/// Height of a car \[m\]: the mean of the labels.
pub(super) const CAR_HEIGHT: f64 = 1.52;
/// From the middle of a car to its end \[m\]. Boxes in all four drives are as high as cars would be that stand 2.0 to 2.4 m nearer
/// than their middle.
pub(super) const CAR_REACH: f64 = 2.1;
/// Pictures are at least so large \[pixels\]: a box that reaches its edge shows a part of a car.
const PICTURE: [f64; 2] = [1224.0, 370.0];
/// Boxes of a lower score are left out.
const LEAST_SCORE: f64 = 0.5;
/// Two boxes show the same car whose intersection is this share of their union.
const SAME_BOX: f64 = 0.5;
/// A car has moved whose places in the first and the last third of its track are farther apart \[m\].
const MOVED: f64 = 2.0;
/// Radius of the Earth \[m\].
const EARTH: f64 = 6_378_137.0;

/// What the boxes of a detector and visual odometry err by, measured in these drives.
pub(super) fn set_noise(sensors: &mut Sensors3) {
    sensors.reach = CAR_REACH;
    sensors.noise = PixelNoise { u: 3.0, v: 2.0, disparity: 1.0, share: 0.07 };
    // Cars that drive are as good as false.
    sensors.detector = Detector3 { detection_probability: 0.85, clutter: 1.0 };
    sensors.odometry = odometry_noise();
}

/// Of visual odometry, measured in these drives.
pub(super) fn odometry_noise() -> OdometryNoise3 {
    OdometryNoise3 {
        position_per_metre: 0.02,
        rotation_per_metre: 0.001,
        rotation_per_radian: 0.01,
        scale: 0.03,
        turn_scale: 0.003,
        ..OdometryNoise3::default()
    }
}

pub(super) fn read(folder: &Path) -> Result<Converted3, LogError> {
    let calibration = read_calibration(&folder.join("calib.txt"))?;
    let path = folder.join("vo_orbslam3.txt");
    let mut poses = Vec::new();
    read_lines(&path, |line| {
        let pose = pose_of(line).ok_or("a pose has 12 numbers")?;
        poses.push(StampedPose3 { stamp: INTERVAL * poses.len() as f64, pose });
        Ok(())
    })?;
    let trajectory = read_way(&folder.join("oxts.txt"), calibration.imu_from_camera)?;
    let labels = read_labels(&folder.join("label.txt"))?;
    let (frames, ids, cut) = read_boxes(&folder.join("det2d_rrc_car.csv"), poses.len(), &labels)?;
    let mut sensors = Sensors3::new(vec!["car".to_owned()], 1.0, calibration.camera, CAR_HEIGHT);
    sensors.robot_from_camera = calibration.robot_from_camera;
    sensors.movable = vec![0];
    set_noise(&mut sensors);
    Ok(Converted3 {
        landmarks: standing(&labels, &trajectory),
        recording: Recording3 { sensors, odometry: Odometry3::Poses(poses), frames },
        ids,
        trajectory,
        notes: vec![format!("{cut} boxes at the edge of the picture are not in it")],
    })
}

fn read_lines(path: &Path, mut take: impl FnMut(&[f64]) -> Result<(), &'static str>) -> Result<(), LogError> {
    let (mut lines, mut line) = (Lines::open(path)?, String::new());
    while lines.next_into(&mut line)? {
        let numbers = numbers(line.split_whitespace()).map_err(|reason| lines.error(reason))?;
        take(&numbers).map_err(|reason| lines.error(reason.to_owned()))?;
    }
    Ok(())
}

/// A pose as the upper three rows of its matrix, row by row.
pub(super) fn pose_of(numbers: &[f64]) -> Option<Pose3> {
    let &[a, b, c, x, d, e, f, y, g, h, i, z] = numbers else { return None };
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::new(a, b, c, d, e, f, g, h, i));
    Some(Pose3::new(Point3::new(x, y, z), UnitQuaternion::from_rotation_matrix(&rotation)))
}

struct Calibration {
    camera: Pinhole,
    /// The robot is the camera of visual odometry, and the boxes' one stands beside it.
    robot_from_camera: Pose3,
    imu_from_camera: Pose3,
}

fn read_calibration(path: &Path) -> Result<Calibration, LogError> {
    let (mut found, mut lines, mut line) = (BTreeMap::new(), Lines::open(path)?, String::new());
    while lines.next_into(&mut line)? {
        let mut words = line.split_whitespace();
        let name = words.next().unwrap_or_default().trim_end_matches(':').to_owned();
        found.insert(name, numbers(words).map_err(|reason| lines.error(reason))?);
    }
    let missing = |name: &str| {
        let reason = format!("it has no line {name}");
        LogError::NotThisFormat { path: path.to_owned(), reason, expected: EXPECTED }
    };
    let pose = |name: &str| found.get(name).and_then(|numbers| pose_of(numbers)).ok_or_else(|| missing(name));
    let Some(&[fu, _, cu, along, _, fv, cv, ..]) = found.get("P2").map(Vec::as_slice) else {
        return Err(missing("P2"));
    };
    let rectified = found.get("R_rect").filter(|numbers| numbers.len() == 9).ok_or_else(|| missing("R_rect"))?;
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_row_slice(rectified));
    let rectified = Pose3::new(Point3::origin(), UnitQuaternion::from_rotation_matrix(&rotation));
    Ok(Calibration {
        camera: Pinhole { focal: [fu, fv], centre: [cu, cv] },
        robot_from_camera: Pose3::new(Point3::new(-along / fu, 0.0, 0.0), UnitQuaternion::identity()),
        imu_from_camera: (rectified * pose("Tr_velo_cam")? * pose("Tr_imu_velo")?).inverse(),
    })
}

/// The true way of the camera, from latitude, longitude \[degrees\], height \[m\], roll, pitch, yaw \[rad\] of the car.
fn read_way(path: &Path, imu_from_camera: Pose3) -> Result<Vec<StampedPose3>, LogError> {
    let (mut trajectory, mut scale) = (Vec::new(), None);
    read_lines(path, |line| {
        let &[latitude, longitude, height, roll, pitch, yaw, ..] = line else {
            return Err("a row has 6 numbers or more");
        };
        // Mercator's map, true to scale where the drive begins.
        let scale = *scale.get_or_insert(latitude.to_radians().cos());
        let north = (std::f64::consts::FRAC_PI_4 + latitude.to_radians() / 2.0).tan().ln();
        let position = Point3::new(scale * EARTH * longitude.to_radians(), scale * EARTH * north, height);
        let pose = Pose3::new(position, UnitQuaternion::from_euler_angles(roll, pitch, yaw)) * imu_from_camera;
        trajectory.push(StampedPose3 { stamp: INTERVAL * trajectory.len() as f64, pose });
        Ok(())
    })?;
    Ok(trajectory)
}

/// A box: left, top, right, bottom \[pixels\].
type Box = [f64; 4];

/// A car as it is labelled in a picture.
struct Label {
    frame: usize,
    track: u64,
    outline: Box,
    /// Its middle in the camera's frame \[m\].
    position: Point3<f64>,
}

fn read_labels(path: &Path) -> Result<Vec<Label>, LogError> {
    let (mut labels, mut lines, mut line) = (Vec::new(), Lines::open(path)?, String::new());
    while lines.next_into(&mut line)? {
        let words: Vec<&str> = line.split_whitespace().collect();
        if !matches!(words.get(2), Some(&"Car" | &"Van")) {
            continue;
        }
        let rest = numbers(words.iter().enumerate().filter(|(place, _)| *place != 2).map(|(_, word)| *word));
        let rest = rest.map_err(|reason| lines.error(reason))?;
        let &[frame, track, _, _, _, left, top, right, bottom, height, _, _, x, y, z, ..] = rest.as_slice() else {
            return Err(lines.error("a label has 17 columns".to_owned()));
        };
        let (outline, position) = ([left, top, right, bottom], Point3::new(x, y - height / 2.0, z));
        labels.push(Label { frame: frame as usize, track: track as u64, outline, position });
    }
    Ok(labels)
}

fn read_boxes(path: &Path, count: usize, labels: &[Label]) -> Result<(Vec<Frame<Detection3>>, Ids, usize), LogError> {
    let mut boxes: Vec<Vec<(Box, f64)>> = vec![Vec::new(); count];
    let mut cut = 0;
    const BOXES: Layout = Layout { required: &["frame", "x1", "y1", "x2", "y2", "score"], optional: &[] };
    read_table(path, &[BOXES], EXPECTED, |_, row| {
        let (frame, score): (usize, f64) = (row.count(0)?, row.number(5)?);
        let outline @ [left, top, right, bottom] = [row.number(1)?, row.number(2)?, row.number(3)?, row.number(4)?];
        let Some(frame) = boxes.get_mut(frame) else { return Ok(()) };
        if score <= LEAST_SCORE || right <= left || bottom <= top {
            return Ok(());
        }
        let is_whole = left > 1.0 && top > 1.0 && right < PICTURE[0] - 1.0 && bottom < PICTURE[1] - 1.0;
        if is_whole {
            frame.push((outline, score.min(1.0)))
        } else {
            cut += 1
        }
        Ok(())
    })?;
    let (mut frames, mut ids) = (Vec::new(), Vec::new());
    for (number, mut boxes) in boxes.into_iter().enumerate() {
        boxes.sort_by(|(a, _), (b, _)| (a[0] + a[2]).total_cmp(&(b[0] + b[2])));
        let detect = |&([left, top, right, bottom], score): &(Box, f64)| Detection3 {
            class: 0,
            score,
            pixel: [(left + right) / 2.0, (top + bottom) / 2.0],
            disparity: bottom - top,
        };
        let of_frame = || labels.iter().filter(|label| label.frame == number);
        let track = |(outline, _): &(Box, f64)| {
            let best = of_frame().max_by(|a, b| shared(a.outline, *outline).total_cmp(&shared(b.outline, *outline)));
            best.filter(|label| shared(label.outline, *outline) >= SAME_BOX).map(|label| label.track)
        };
        frames.push(Frame { stamp: INTERVAL * number as f64, detections: boxes.iter().map(detect).collect() });
        ids.push(boxes.iter().map(track).collect());
    }
    Ok((frames, ids, cut))
}

/// The intersection of two boxes, as a share of their union.
fn shared(a: Box, b: Box) -> f64 {
    let area = |[left, top, right, bottom]: Box| (right - left).max(0.0) * (bottom - top).max(0.0);
    let both = area([a[0].max(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].min(b[3])]);
    both / (area(a) + area(b) - both)
}

/// Cars that stand still, in the mean of their places.
fn standing(labels: &[Label], trajectory: &[StampedPose3]) -> Vec<TrueLandmark<3>> {
    let mut tracks: BTreeMap<u64, Vec<Vector3<f64>>> = BTreeMap::new();
    for label in labels {
        if let Some(StampedPose3 { pose, .. }) = trajectory.get(label.frame) {
            tracks.entry(label.track).or_default().push((*pose * label.position).coords);
        }
    }
    let mean = |places: &[Vector3<f64>]| places.iter().sum::<Vector3<f64>>() / places.len().max(1) as f64;
    let landmark = |(id, places): (u64, Vec<Vector3<f64>>)| {
        let third = places.len().div_ceil(3);
        let moved = (mean(&places[..third]) - mean(&places[places.len() - third..])).norm();
        (moved < MOVED).then(|| TrueLandmark { id, class: 0, position: mean(&places).into() })
    };
    tracks.into_iter().filter_map(landmark).collect()
}
