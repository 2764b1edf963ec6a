//! Driving the tour: the true pose of the robot, step by step.
//!
//! In: way-points in the world's frame \[m\]. Out: `world_from_robot` ten times a second. The robot steers towards a
//! carrot that runs ahead of it along the tour, and obeys limits on speed, turn rate and both accelerations; so it
//! rounds corners smoothly and turns on the spot where the tour turns back.

use crate::geometry::{Pose, wrap_angle};
use nalgebra::Point2;
use std::sync::Arc;

/// Steps a second.
pub const STEP_RATE: f64 = 10.0;
/// Speed on a straight \[m/s\], that of an indoor robot.
const CRUISE: f64 = 0.9;
/// Speed gained or lost in a second \[m/s²\].
const ACCELERATION: f64 = 0.8;
/// Fastest turn \[rad/s\].
const TURN_RATE: f64 = 1.0;
/// Turn rate gained or lost in a second \[rad/s²\].
const TURN_ACCELERATION: f64 = 3.0;
/// Turn rate asked for per heading error \[1/s\].
const TURN_GAIN: f64 = 1.5;
/// How far the carrot runs ahead \[m\].
const LOOKAHEAD: f64 = 0.6;
/// How finely the carrot moves \[m\].
const CARROT_STEP: f64 = 0.02;

/// One step of the robot: where it got to and what it did to get there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Pose after the step.
    pub world_from_robot: Pose,
    /// Length of the arc driven in the step \[m\].
    pub distance: f64,
    /// Change of heading along that arc \[rad\].
    pub turn: f64,
}

/// The steps of a drive; the first stands at the tour's start. Holds a few numbers, however long the drive.
#[derive(Clone, Debug)]
pub struct Drive {
    tour: Arc<[Point2<f64>]>,
    again: bool,
    next: Option<Step>,
    speed: f64,
    turn_rate: f64,
    /// The carrot is this far \[m\] along the leg that begins at this way-point.
    leg: usize,
    along: f64,
}

impl Drive {
    /// A drive along a tour of at least two way-points, once or for ever.
    pub fn new(tour: Arc<[Point2<f64>]>, again: bool) -> Self {
        let start = tour.first().zip(tour.iter().find(|&point| Some(point) != tour.first())).map(|(first, second)| {
            let ahead = second - first;
            Step { world_from_robot: Pose::new(first.x, first.y, ahead.y.atan2(ahead.x)), distance: 0.0, turn: 0.0 }
        });
        Self { tour, again, next: start, speed: 0.0, turn_rate: 0.0, leg: 0, along: 0.0 }
    }

    /// Moves the carrot on until it is far enough from the robot, or says that the tour is over.
    fn carrot(&mut self, robot: Point2<f64>) -> Option<Point2<f64>> {
        loop {
            if self.leg + 1 >= self.tour.len() {
                if !self.again {
                    return None;
                }
                self.leg = 0;
            }
            let (from, to) = (self.tour[self.leg], self.tour[self.leg + 1]);
            let length = (to - from).norm();
            if self.along >= length {
                self.along -= length;
                self.leg += 1;
                continue;
            }
            let carrot = from + (to - from) * (self.along / length);
            if (carrot - robot).norm() >= LOOKAHEAD {
                return Some(carrot);
            }
            self.along += CARROT_STEP;
        }
    }

    /// One step of steering towards the carrot.
    fn step(&mut self, pose: Pose) -> Option<Step> {
        let ahead = self.carrot(pose.position())? - pose.position();
        let error = wrap_angle(ahead.y.atan2(ahead.x) - pose.heading);
        let wanted_rate = (TURN_GAIN * error).clamp(-TURN_RATE, TURN_RATE);
        let wanted_speed = CRUISE * error.cos().max(0.0).powi(3);
        self.turn_rate = approach(self.turn_rate, wanted_rate, TURN_ACCELERATION / STEP_RATE);
        self.speed = approach(self.speed, wanted_speed, ACCELERATION / STEP_RATE);
        let (distance, turn) = (self.speed / STEP_RATE, self.turn_rate / STEP_RATE);
        Some(Step { world_from_robot: pose * arc(distance, turn), distance, turn })
    }
}

impl Iterator for Drive {
    type Item = Step;

    fn next(&mut self) -> Option<Step> {
        let current = self.next?;
        self.next = self.step(current.world_from_robot);
        Some(current)
    }
}

/// The motion along an arc: `distance` \[m\] driven while the heading turns by `turn` \[rad\] at a constant rate.
pub fn arc(distance: f64, turn: f64) -> Pose {
    let half = 0.5 * turn;
    let chord = if half.abs() < 1e-9 { distance } else { distance * half.sin() / half };
    Pose::new(chord * half.cos(), chord * half.sin(), turn)
}

fn approach(value: f64, wanted: f64, change: f64) -> f64 {
    value + (wanted - value).clamp(-change, change)
}
