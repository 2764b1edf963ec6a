//! Victoria Park in the form of GTSAM, `victoria_park.txt`: a truck drives four kilometres among trees.
//!
//! `ODOMETRY from to dx dy dheading` and six numbers of its covariance; `LANDMARK pose tree x y`, ahead and to the
//! left of the truck, and three numbers of its covariance. Poses and trees are numbered together, so the number of a
//! pose would reveal where a new tree comes; poses are numbered anew. There are no stamps: a step counts as a second.
//! Only poses that see a tree are frames: whether the sensor was on at the others is not in the file.

use super::{Converted, Labels, Sighting};
use crate::detections::{DetectionNoise, Detector, Odometry, OdometryNoise, Recording, View};
use crate::geometry::{Pose, StampedPose};
use crate::io::lines::Lines;
use crate::log::LogError;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

pub(super) fn read(folder: &Path, labels: &Labels) -> Result<Converted, LogError> {
    let (mut lines, mut line) = (Lines::open(&folder.join("victoria_park.txt"))?, String::new());
    let mut poses: Vec<StampedPose> = Vec::new();
    let mut steps: HashMap<u64, usize> = HashMap::new();
    let mut trees: HashMap<u64, usize> = HashMap::new();
    let mut frames: BTreeMap<usize, Vec<Sighting>> = BTreeMap::new();
    while lines.next_into(&mut line)? {
        let (name, first, second, numbers) = row(&line).map_err(|reason| lines.error(reason))?;
        match (name, &numbers[..]) {
            ("ODOMETRY", &[x, y, heading, ..]) => {
                if poses.is_empty() {
                    steps.insert(first, 0);
                    poses.push(StampedPose { stamp: 0.0, pose: Pose::IDENTITY });
                }
                let last = poses.last().map_or(Pose::IDENTITY, |last| last.pose);
                if steps.get(&first).is_none_or(|&step| step + 1 != poses.len()) || steps.contains_key(&second) {
                    return Err(
                        lines.error(format!("a step from pose {first} to {second} does not go on from the last"))
                    );
                }
                steps.insert(second, poses.len());
                poses.push(StampedPose { stamp: poses.len() as f64, pose: last * Pose::new(x, y, heading) });
            }
            ("LANDMARK", &[x, y, ..]) => {
                let Some(&step) = steps.get(&first) else {
                    return Err(lines.error(format!("there is no pose {first} before this line")));
                };
                let number = trees.len();
                let landmark = *trees.entry(second).or_insert(number);
                let (range, bearing) = (x.hypot(y), y.atan2(x));
                let seen = Sighting { id: Some(second), landmark: Some(landmark), score: 1.0, range, bearing };
                frames.entry(step).or_default().push(seen);
            }
            _ => {
                return Err(
                    lines.error("a line is ODOMETRY or LANDMARK, two numbers of poses, and the motion".to_owned())
                );
            }
        }
    }
    let (frames, ids) = labels.frames(frames.into_iter().map(|(step, seen)| (step as f64, seen)).collect());
    let mut sensors = labels.sensors();
    // The file says that a tree is 0.63 m off, but what it sees from frame to frame agrees to a few centimetres.
    sensors.noise = DetectionNoise { range: 0.05, bearing: 0.005, position: 0.63 };
    sensors.view = View { min_range: 0.0, max_range: 25.0, min_bearing: -1.6, max_bearing: 1.6 };
    sensors.detector = Detector { detection_probability: 0.3, clutter_density: 1e-4 };
    // 1 cm and 2 mrad a step, which is 0.58 m and a second.
    sensors.odometry = OdometryNoise {
        forward_per_metre: 0.0,
        sideways_per_metre: 0.0,
        heading_per_metre: 0.0,
        heading_per_radian: 0.0,
        position_per_second: 0.01,
        heading_per_second: 0.002,
    };
    let recording = Recording { sensors, odometry: Odometry::Poses(poses), frames };
    Ok(Converted { recording, ids, trajectory: Vec::new(), landmarks: Vec::new(), notes: Vec::new() })
}

/// A word, two whole numbers, and all other numbers.
fn row(line: &str) -> Result<(&str, u64, u64, Vec<f64>), String> {
    let mut words = line.split_whitespace();
    let name = words.next().unwrap_or_default();
    let mut whole = || {
        let word = words.next().unwrap_or_default();
        word.parse::<u64>().map_err(|_| format!("`{word:.30}` is not the number of a pose or tree"))
    };
    let (first, second) = (whole()?, whole()?);
    Ok((name, first, second, super::numbers(words)?))
}
