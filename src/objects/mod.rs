//! Objects on the maps of the filter: landmarks with a position and a class, from the detections of a drive.
//!
//! Given the pose of a particle, its landmarks are independent of each other, and each is a small estimator of its own: a
//! Gaussian of its position, a distribution over its classes, and the probability that it is there at all. A frame weighs the
//! particle by the set likelihood of its detections, summed over all assignments ([`association`](crate::association); the
//! evaluator does it for all particles), and then updates the landmarks by the weights w_kj of the pairs ([`Landmark`]).
//!
//! A detection that shows nothing of the map is a new landmark or a false one: each as likely as the other, as the density of
//! false detections is known and that of new objects is not.
//!
//! | File | Task |
//! |---|---|
//! | `observation` | a frame, as the robot at a step sees it, and what is in view |
//! | `landmark` | one landmark, and what detections make of it |
//! | `fit` | the pose of a particle, fitted to what a frame shows |
//! | `table` | a frame against the landmarks: terms of all pairs, the update, new landmarks, and those that go |

mod fit;
mod landmark;
mod observation;
mod table;

pub use landmark::Landmark;
pub use observation::Observation;

use crate::detections::{Frame, Sensors};
use crate::geometry::Pose;
use crate::scan::Scan;
use nalgebra::DMatrix;

/// What a detector of objects saw in a drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Detections {
    /// The detector: its classes, its errors and its view.
    pub sensors: Sensors,
    /// What it saw, in the order of time; the clock is that of the log.
    pub frames: Vec<Frame>,
}

/// The frames of a drive, as the filter comes by them.
#[derive(Debug)]
pub struct Objects {
    detections: Detections,
    confusion: DMatrix<f64>,
    /// The frame that comes next.
    next: usize,
    /// Stamp of the last scan, and where the robot was then, seen from the last step.
    last: Option<(f64, Pose)>,
    /// The last frame since the last step, and where the robot was then, seen from that step.
    waiting: Option<(usize, Pose)>,
    observations: Vec<Observation>,
}

/// The landmarks of one path, and how likely the path made the detections.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mapped {
    /// In the order in which they were first seen.
    pub landmarks: Vec<Landmark>,
    /// Σ ln p(S) over all frames, each given those before it.
    pub log_likelihood: f64,
}

/// The objects of a finished run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectMap {
    /// Names of the classes.
    pub classes: Vec<String>,
    /// The objects that are surely there, in the world's frame.
    pub landmarks: Vec<Landmark>,
    /// Frames of detections that steps of the filter used.
    pub frames_used: usize,
}

impl ObjectMap {
    /// Seen in a world whose origin is `there_from_here`.
    pub fn moved(&self, there_from_here: Pose) -> Self {
        let landmarks = self.landmarks.iter().map(|landmark| landmark.moved(there_from_here)).collect();
        Self { landmarks, ..self.clone() }
    }
}

/// A probability of a label is at least this: no real detector is free of confusions.
const MIN_CONFUSION: f64 = 1e-3;

impl Objects {
    /// The frames before the drive begins.
    pub fn new(detections: Detections) -> Self {
        let confusion = &detections.sensors.confusion;
        let entry = |class: usize, label: usize| confusion[class][label].max(MIN_CONFUSION);
        let confusion = DMatrix::from_fn(confusion.len(), confusion.len(), entry);
        Self { detections, confusion, next: 0, last: None, waiting: None, observations: Vec::new() }
    }

    /// The detector.
    pub fn sensors(&self) -> &Sensors {
        &self.detections.sensors
    }

    /// The frames that steps of the filter have used so far.
    pub fn observations(&self) -> &[Observation] {
        &self.observations
    }

    /// Takes in a scan: frames up to its stamp are placed on the way from the last scan to here. Of several, the last one counts:
    /// they show much the same.
    pub fn follow(&mut self, stamp: f64, step_from_robot: Pose) {
        let frames = self.detections.frames.get(self.next..).unwrap_or_default();
        let passed = frames.partition_point(|frame| frame.stamp <= stamp);
        if passed > 0 {
            self.next += passed;
            let frame = self.next - 1;
            let seen = self.detections.frames[frame].stamp;
            self.waiting = match self.last {
                Some((before, step_from_before)) if stamp > before => {
                    let share = ((seen - before) / (stamp - before)).clamp(0.0, 1.0);
                    Some((frame, step_from_before.interpolated(step_from_robot, share)))
                }
                // Where the robot was before its first scan, no map tells.
                None if seen < stamp => None,
                _ => Some((frame, step_from_robot)),
            };
        }
        self.last = Some((stamp, step_from_robot));
    }

    /// The frame of a new step, which is taken here, with this scan; `None` where none came since the step before.
    pub fn observe(&mut self, step: u32, reading: usize, step_from_robot: Pose, scan: &Scan) -> Option<Observation> {
        self.last = self.last.map(|(stamp, _)| (stamp, Pose::IDENTITY));
        let (frame, step_from_seen) = self.waiting.take()?;
        let robot_from_seen = step_from_seen.seen_from(step_from_robot);
        let frame = &self.detections.frames[frame];
        let observation = Observation::new(step, reading, frame, robot_from_seen, &self.detections.sensors, scan);
        self.observations.push(observation.clone());
        Some(observation)
    }

    /// What all frames so far make of a path: `world_from_robot` at the step of each.
    pub fn mapped(&self, world_from_robot: impl Fn(&Observation) -> Pose) -> Mapped {
        let mut mapped = Mapped::default();
        for observation in &self.observations {
            mapped.log_likelihood += self.update(&mut mapped.landmarks, observation, world_from_robot(observation));
        }
        mapped
    }
}
