//! Frames of detections among landmarks, and their log-likelihood by enumeration of all assignments, in f64.

use ipslam::evaluator::pose::LocalPose;
use ipslam::evaluator::sighting::{Horizon, LandmarkRow, MOST_SEEN, SECTORS, Seen, Sighting};
use ipslam::random::{Draw, bits, normals, uniform};
use nalgebra::{Matrix2, Rotation2, Vector2};
use std::f64::consts::TAU;

/// In nats, of a whole frame. Coordinates of up to 20 m are rounded by 1 µm a few times; a landmark that decides lies three
/// standard deviations of 0.2 m off at most: 3 · 1 µm / 0.2 m = 1.5e-5 a detection, and signs differ.
pub const TOLERANCE: f64 = 1e-4;

/// Maps with landmarks, a frame, and poses.
#[derive(Clone)]
pub struct Frame {
    pub seen: Vec<Seen>,
    pub horizon: Horizon,
    pub landmarks: Vec<Vec<LandmarkRow>>,
    pub poses: Vec<LocalPose>,
}

impl Frame {
    /// Detections of some of the landmarks, some of them twice, and of nothing; landmarks close together and far off. Some
    /// are in view, some hidden.
    pub fn random(seed: u64, detections: usize, landmarks: usize, maps: usize, poses_per_map: usize) -> Self {
        let mut number = 0;
        let mut between = |low: f32, high: f32| {
            number += 1;
            low + (high - low) * uniform(bits(seed, 0, number, Draw::Detection)[0])
        };
        let robot = LocalPose { x: between(-9.0, 9.0), y: between(-9.0, 9.0), heading: between(-3.1, 3.1) };
        let mut covariance = |least: f32, largest: f32| {
            let (a, b, turn) = (between(least, largest).powi(2), between(least, largest).powi(2), between(0.0, 3.0));
            let (sin, cos) = turn.sin_cos();
            [a * cos * cos + b * sin * sin, (a - b) * sin * cos, a * sin * sin + b * cos * cos]
        };
        let covariances: Vec<_> = (0..landmarks + detections).map(|_| covariance(0.05, 0.3)).collect();
        let mut horizon = Horizon { sensor: [0.1, -0.05], min_range: 0.3, max_ranges: [0.0; SECTORS] };
        horizon.max_ranges.iter_mut().for_each(|range| *range = between(-2.0, 8.0).max(0.0));
        let rows: Vec<LandmarkRow> = (0..landmarks)
            .map(|j| {
                let (distance, bearing) = (between(0.2, 6.0), between(-1.5, 1.5) + robot.heading);
                let [xx, xy, yy] = covariances[j];
                let there = between(0.3, 0.99);
                LandmarkRow {
                    x: robot.x + distance * bearing.cos(),
                    y: robot.y + distance * bearing.sin(),
                    xx,
                    xy,
                    yy,
                    log_detected: (0.9 * there).ln(),
                    log_missed: (1.0 - 0.9 * there).ln(),
                    padding: 0.0,
                    log_label: std::array::from_fn(|_| between(0.01, 1.0).ln()),
                }
            })
            .collect();
        let seen = (0..detections)
            .map(|k| {
                let [xx, xy, yy] = covariances[landmarks + k];
                let (x, y) = match rows.get(k * 2 / 3) {
                    Some(row) if k != 3 => {
                        let (sin, cos) = robot.heading.sin_cos();
                        let (dx, dy) = (row.x - robot.x + between(-0.2, 0.2), row.y - robot.y + between(-0.2, 0.2));
                        (cos * dx + sin * dy, cos * dy - sin * dx)
                    }
                    _ => (between(0.5, 6.0), between(-4.0, 4.0)),
                };
                Seen { x, y, xx, xy, yy, log_null: between(-9.0, -4.0), padding: [0.0; 2] }
            })
            .collect();
        // Each map has its landmarks a bit elsewhere, and the last one fewer.
        let of_map = |map: usize| {
            let count = if map + 1 == maps { landmarks.div_ceil(2) } else { landmarks };
            let moved = |row: &LandmarkRow| LandmarkRow { x: row.x + 0.05 * map as f32, ..*row };
            rows.iter().take(if maps == 1 { landmarks } else { count }).map(moved).collect()
        };
        let pose = |number: usize| {
            let [x, y, heading, _] = normals(seed, 1, number as u32, Draw::Motion);
            LocalPose { x: robot.x + 0.1 * x, y: robot.y + 0.1 * y, heading: robot.heading + 0.02 * heading }
        };
        let landmarks = (0..maps).map(of_map).collect();
        Self { seen, horizon, landmarks, poses: (0..maps * poses_per_map).map(pose).collect() }
    }

    /// Frames of every size, up to the largest.
    pub fn all() -> Vec<Self> {
        let sizes = [(0, 0), (0, 5), (3, 0), (1, 1), (2, 9), (3, 30), (5, 9), (6, 6), (7, 4), (MOST_SEEN, 4)];
        let frame = |(seed, (detections, landmarks))| Self::random(seed, detections, landmarks, 1, 5);
        let mut all: Vec<Self> = (1..).zip(sizes).map(frame).collect();
        all.push(Self::random(20, 4, 6, 7, 3));
        all
    }

    pub fn sighting(&self) -> Sighting<'_> {
        Sighting { seen: &self.seen, horizon: &self.horizon, landmarks: &self.landmarks }
    }

    /// ln p(S) from each pose.
    pub fn slow(&self) -> Vec<f64> {
        let poses_per_map = self.poses.len() / self.landmarks.len();
        let of_pose = |(number, &pose): (usize, &LocalPose)| slow(self, &self.landmarks[number / poses_per_map], pose);
        self.poses.iter().enumerate().map(of_pose).collect()
    }
}

/// ln p(S) of one pose: the sum over all assignments, each the product of its terms.
fn slow(frame: &Frame, landmarks: &[LandmarkRow], pose: LocalPose) -> f64 {
    let turn = Rotation2::new(f64::from(pose.heading));
    let robot = Vector2::new(pose.x, pose.y).map(f64::from);
    let views: Vec<bool> = landmarks.iter().map(|row| is_in_view(&frame.horizon, row, robot, turn)).collect();
    let pair = |k: usize, j: usize| {
        let (seen, row) = (&frame.seen[k], &landmarks[j]);
        let offset =
            robot + turn * Vector2::new(seen.x, seen.y).map(f64::from) - Vector2::new(row.x, row.y).map(f64::from);
        let noise = Matrix2::new(seen.xx, seen.xy, seen.xy, seen.yy).map(f64::from);
        let covariance =
            turn * noise * turn.matrix().transpose() + Matrix2::new(row.xx, row.xy, row.xy, row.yy).map(f64::from);
        let square = offset.dot(&(covariance.try_inverse().unwrap() * offset));
        let density = -0.5 * (square + covariance.determinant().ln()) - TAU.ln();
        density + f64::from(row.log_label[k]) + f64::from(row.log_detected)
    };
    let table: Vec<Vec<f64>> =
        (0..frame.seen.len()).map(|k| (0..landmarks.len()).map(|j| pair(k, j)).collect()).collect();
    let mut logs = Vec::new();
    let mut taken = vec![false; landmarks.len()];
    enumerate(frame, &table, 0, 0.0, &mut taken, &mut |log, taken| {
        let missed = (0..landmarks.len()).filter(|&j| views[j] && !taken[j]);
        logs.push(log + missed.map(|j| f64::from(landmarks[j].log_missed)).sum::<f64>());
    });
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    largest + logs.iter().map(|log| (log - largest).exp()).sum::<f64>().ln()
}

fn enumerate(
    frame: &Frame,
    table: &[Vec<f64>],
    detection: usize,
    log: f64,
    taken: &mut Vec<bool>,
    found: &mut dyn FnMut(f64, &[bool]),
) {
    let Some(row) = table.get(detection) else { return found(log, taken) };
    enumerate(frame, table, detection + 1, log + f64::from(frame.seen[detection].log_null), taken, found);
    for (landmark, pair) in row.iter().enumerate() {
        if !taken[landmark] {
            taken[landmark] = true;
            enumerate(frame, table, detection + 1, log + pair, taken, found);
            taken[landmark] = false;
        }
    }
}

/// By the sum of the steps around the square |x| + |y| = 1.
fn is_in_view(horizon: &Horizon, row: &LandmarkRow, robot: Vector2<f64>, turn: Rotation2<f64>) -> bool {
    let place = turn.inverse() * (Vector2::new(row.x, row.y).map(f64::from) - robot);
    let off = place - Vector2::from(horizon.sensor).map(f64::from);
    let along = off.y / (off.x.abs() + off.y.abs());
    let around = if off.x < 0.0 { 2.0 - along } else { along.rem_euclid(4.0) };
    let farthest = f64::from(horizon.max_ranges[(around / 4.0 * SECTORS as f64) as usize]);
    off.norm() <= farthest && off.norm() >= f64::from(horizon.min_range)
}
