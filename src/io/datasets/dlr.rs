//! DLR Spatial Cognition, `map.circles`: a robot with a camera drives half a kilometre through offices, discs on the
//! floor.
//!
//! `STEP image dx dy dheading` and six numbers of its covariance, the motion before an image; then, for each disc in
//! the image, `LANDMARK_C x y quality`, three numbers of its covariance, and which disc it is, or -1 where nobody
//! knows. There are no stamps: a step counts as a second. An image without a disc is a frame that saw nothing.
//!
//! The robot's frame has -y ahead and x to the right, so that angles count clockwise; it is turned into ours.

use super::{Converted, Labels, Sighting};
use crate::detections::{DetectionNoise, Detector, Odometry, OdometryNoise, Recording, View};
use crate::geometry::{Pose, StampedPose};
use crate::io::lines::Lines;
use crate::log::LogError;
use std::path::Path;

pub(super) fn read(folder: &Path, labels: &Labels) -> Result<Converted, LogError> {
    let (mut lines, mut line) = (Lines::open(&folder.join("map.circles"))?, String::new());
    let mut poses = vec![StampedPose { stamp: 0.0, pose: Pose::IDENTITY }];
    let mut frames: Vec<(f64, Vec<Sighting>)> = Vec::new();
    while lines.next_into(&mut line)? {
        let mut words = line.split_whitespace();
        let name = words.next().unwrap_or_default();
        let image = if name == "STEP" { words.next() } else { None };
        let numbers = super::numbers(words).map_err(|reason| lines.error(reason))?;
        match (name, image, &numbers[..]) {
            ("STEP", Some(_), &[x, y, heading, ..]) => {
                let last = poses.last().map_or(Pose::IDENTITY, |last| last.pose);
                let stamp = poses.len() as f64;
                poses.push(StampedPose { stamp, pose: last * Pose::new(-y, -x, -heading) });
                frames.push((stamp, Vec::new()));
            }
            ("LANDMARK_C", _, &[x, y, quality, _, _, _, id, ..]) => {
                let Some((_, frame)) = frames.last_mut() else {
                    return Err(lines.error("a LANDMARK_C comes before the first STEP".to_owned()));
                };
                if !(0.0..=1.0).contains(&quality) {
                    return Err(lines.error(format!("quality is {quality} and not between 0 and 1")));
                }
                let id = (id >= 0.0).then_some(id as u64);
                let (range, bearing) = (x.hypot(y), (-x).atan2(-y));
                frame.push(Sighting { id, landmark: id.map(|id| id as usize), score: quality, range, bearing });
            }
            _ => return Err(lines.error("a line is a STEP or a LANDMARK_C with its numbers".to_owned())),
        }
    }
    let (frames, ids) = labels.frames(frames);
    let mut sensors = labels.sensors();
    // As the covariances in the file: 4 cm in every direction, up to 7 cm in range at 3 m; 1 cm and 0.04 rad after a
    // metre.
    sensors.noise = DetectionNoise { range: 0.03, bearing: 0.003, position: 0.04 };
    sensors.view = View { min_range: 0.9, max_range: 4.5, min_bearing: -1.05, max_bearing: 1.05 };
    sensors.detector = Detector { detection_probability: 0.7, clutter_density: 0.01 };
    sensors.odometry = OdometryNoise {
        forward_per_metre: 0.01,
        sideways_per_metre: 0.01,
        heading_per_metre: 0.04,
        heading_per_radian: 0.02,
        position_per_second: 0.001,
        heading_per_second: 0.001,
    };
    let recording = Recording { sensors, odometry: Odometry::Poses(poses), frames };
    Ok(Converted { recording, ids, trajectory: Vec::new(), landmarks: Vec::new(), notes: Vec::new() })
}
