//! KITTI odometry, half of it made up: the true way of a car through streets, and cars parked along it that a detector would see.
//!
//! `05.txt` holds the poses of the camera, `05_times.txt` their stamps; both are real. The rest is simulated with a seed, by the
//! figures measured in KITTI tracking. Cars stand 8 to 20 m after each other on each side of the way, 3.5 to 5.5 m from it, but
//! not where the way comes by again. A car is detected with 85 % if its box is whole, 5 to 45 m ahead, and no nearer car stands
//! before its middle; its box errs by 3 and 2 pixels and by 2 pixels and 5 % in height. Every twentieth picture has a false box.
//! Odometry is 3 % wrong in scale, and drifts.

use super::kitti_tracking::{CAR_HEIGHT, CAR_REACH, pose_of, set_noise};
use super::{Converted3, Options, numbers};
use crate::detections::{Detection3, Frame, Odometry3, Recording3, Sensors3};
use crate::geometry::{Pinhole, Pose3, StampedPose3};
use crate::io::lines::Lines;
use crate::io::semantic::truth::TrueLandmark;
use crate::log::LogError;
use crate::random::{self, Draw};
use nalgebra::{Point3, Vector6};
use std::path::Path;

const EXPECTED: &str = "a way of KITTI odometry has a file of poses and one of stamps";
/// The camera of these drives, and the size of its pictures \[pixels\].
const CAMERA: Pinhole = Pinhole { focal: [718.856, 718.856], centre: [607.19, 185.22] };
const PICTURE: [f64; 2] = [1241.0, 376.0];
/// From the camera down to the middle of a car \[m\].
const DOWN: f64 = 0.9;
/// How wide a car is seen, in the mean over directions \[m\].
const WIDTH: f64 = 3.0;
/// No car is parked nearer to the way, or to another car \[m\].
const LEAST_GAP: f64 = 2.5;
const SEEN_DEPTHS: std::ops::Range<f64> = 5.0..45.0;
const DETECTION_PROBABILITY: f64 = 0.85;
const FALSE_BOXES: f64 = 0.05;
/// Standard deviation of the scale, the same for the whole way.
const SCALE: f64 = 0.03;

/// The drive of a number, whose files have to be there.
pub(super) fn read(folder: &Path, drive: u32, options: &Options) -> Result<Converted3, LogError> {
    let seed = options.seed.unwrap_or(1);
    let rows = |name: String| {
        let (mut rows, mut lines, mut line) = (Vec::new(), Lines::open(&folder.join(name))?, String::new());
        while lines.next_into(&mut line)? {
            rows.push(numbers(line.split_whitespace()).map_err(|reason| lines.error(reason))?);
        }
        Ok::<_, LogError>(rows)
    };
    let (poses, stamps) = (rows(format!("{drive:02}.txt"))?, rows(format!("{drive:02}_times.txt"))?);
    let stamped =
        |(pose, stamp): (&Vec<f64>, &Vec<f64>)| Some(StampedPose3 { stamp: *stamp.first()?, pose: pose_of(pose)? });
    let trajectory: Vec<StampedPose3> = poses.iter().zip(&stamps).filter_map(stamped).collect();
    if trajectory.len() != poses.len() || poses.len() != stamps.len() {
        let reason = format!("{} poses, {} stamps, {} of them whole", poses.len(), stamps.len(), trajectory.len());
        return Err(LogError::NotThisFormat {
            path: folder.join(format!("{drive:02}.txt")),
            reason,
            expected: EXPECTED,
        });
    }
    let cars = parked(&trajectory, seed);
    let (frames, ids) = (0..).zip(&trajectory).map(|(number, pose)| detect(number, pose, &cars, seed)).unzip();
    let mut sensors = Sensors3::new(vec!["car".to_owned()], 1.0, CAMERA, CAR_HEIGHT);
    set_noise(&mut sensors);
    let landmark = |(id, position): (u64, &Point3<f64>)| TrueLandmark { id, class: 0, position: *position };
    Ok(Converted3 {
        recording: Recording3 { sensors, odometry: odometry(&trajectory, seed), frames },
        ids,
        landmarks: (0..).zip(&cars).map(landmark).collect(),
        trajectory,
        notes: vec!["semi-synthetic: the way is true, and cars, boxes and odometry are simulated".to_owned()],
    })
}

fn uniforms(seed: u64, step: u32, number: u32, draw: Draw) -> [f64; 4] {
    random::bits(seed, step, number, draw).map(|word| f64::from(random::uniform(word)))
}

/// Cars along the way.
fn parked(trajectory: &[StampedPose3], seed: u64) -> Vec<Point3<f64>> {
    let mut cars: Vec<Point3<f64>> = Vec::new();
    for (side, sign) in [(0, -1.0), (1, 1.0)] {
        let (mut driven, mut next, mut number) = (0.0, 0.0, 0);
        for pair in trajectory.windows(2) {
            driven += (pair[1].pose.position - pair[0].pose.position).norm();
            if driven < next {
                continue;
            }
            let [gap, aside, ..] = uniforms(seed, side, number, Draw::Object);
            next = driven + 8.0 + 12.0 * gap;
            number += 1;
            let car = pair[1].pose * Point3::new(sign * (3.5 + 2.0 * aside), DOWN, 0.0);
            let is_near = |other: Point3<f64>, gap: f64| (car.x - other.x).hypot(car.z - other.z) < gap;
            let is_free = trajectory.iter().all(|pose| !is_near(pose.pose.position, LEAST_GAP))
                && cars.iter().all(|other| !is_near(*other, 2.0 * LEAST_GAP));
            cars.extend(is_free.then_some(car));
        }
    }
    cars
}

/// The boxes of a picture, and the cars that they show.
fn detect(
    number: u32,
    StampedPose3 { stamp, pose }: &StampedPose3,
    cars: &[Point3<f64>],
    seed: u64,
) -> (Frame<Detection3>, Vec<Option<u64>>) {
    let from_pose = pose.inverse();
    let ahead = |(id, car): (usize, &Point3<f64>)| {
        let seen = from_pose * *car;
        SEEN_DEPTHS.contains(&seen.z).then_some((id, seen))
    };
    let mut ahead: Vec<(usize, Point3<f64>)> = cars.iter().enumerate().filter_map(ahead).collect();
    ahead.sort_by(|(_, a), (_, b)| a.z.total_cmp(&b.z));
    let mut shown: Vec<(f64, f64)> = Vec::new();
    let mut boxes = Vec::new();
    for (id, seen) in ahead {
        let near = seen.z - CAR_REACH;
        let u = CAMERA.focal[0] * seen.x / seen.z + CAMERA.centre[0];
        let v = CAMERA.focal[1] * seen.y / near + CAMERA.centre[1];
        let [width, height] = [WIDTH, CAR_HEIGHT].map(|size| CAMERA.focal[0] * size / near);
        let is_whole = (width / 2.0..PICTURE[0] - width / 2.0).contains(&u)
            && (height / 2.0..PICTURE[1] - height / 2.0).contains(&v);
        let is_hidden = shown.iter().any(|(middle, width)| (u - middle).abs() < width / 2.0);
        shown.push((u, width));
        let [chance, ..] = uniforms(seed, number, id as u32, Draw::Label);
        if is_whole && !is_hidden && chance < DETECTION_PROBABILITY {
            let [a, b, c, d] = random::normals(seed, number, id as u32, Draw::Detection).map(f64::from);
            let disparity = (height * (1.0 + 0.05 * d) + 2.0 * c).max(5.0);
            boxes.push((
                Detection3 { class: 0, score: 1.0, pixel: [u + 3.0 * a, v + 2.0 * b], disparity },
                Some(id as u64),
            ));
        }
    }
    let [chance, u, v, size] = uniforms(seed, number, u32::MAX, Draw::Label);
    if chance < FALSE_BOXES {
        let pixel = [PICTURE[0] * u, PICTURE[1] * v];
        boxes.push((Detection3 { class: 0, score: 1.0, pixel, disparity: 25.0 + 150.0 * size * size }, None));
    }
    boxes.sort_by(|(a, _), (b, _)| a.pixel[0].total_cmp(&b.pixel[0]));
    let (detections, ids) = boxes.into_iter().unzip();
    (Frame { stamp: *stamp, detections }, ids)
}

/// Visual odometry of the way.
pub(super) fn odometry(trajectory: &[StampedPose3], seed: u64) -> Odometry3 {
    let scale = 1.0 + SCALE * f64::from(random::normals(seed, 0, u32::MAX, Draw::Motion)[0]);
    let mut pose = Pose3::identity();
    let mut poses: Vec<StampedPose3> =
        trajectory.first().map(|first| StampedPose3 { pose, ..*first }).into_iter().collect();
    for (step, pair) in (0..).zip(trajectory.windows(2)) {
        let motion = pair[1].pose.seen_from(pair[0].pose);
        let (metres, radians) = (motion.position.coords.norm(), motion.rotation.angle());
        let (moved, turned) = (0.02 * metres.sqrt(), 0.001 * metres.sqrt() + 0.01 * radians.sqrt());
        let noise = [0, 1].map(|part| random::normals(seed, step, part, Draw::Motion).map(f64::from));
        let twist = motion.log();
        let errs = |axis: usize| {
            let (number, sigma) = (noise[axis / 4][axis % 4], if axis < 3 { moved } else { turned });
            twist[axis] * if axis < 3 { scale } else { 1.0 } + sigma * number
        };
        pose = pose * Pose3::exp(Vector6::from_fn(|axis, _| errs(axis)));
        poses.push(StampedPose3 { stamp: pair[1].stamp, pose });
    }
    Odometry3::Poses(poses)
}
