//! A frame of detections, as the robot at a step of the filter sees it.

use crate::detections::{Detection, Frame, Sensors};
use crate::evaluator::sighting::{Horizon, MOST_SEEN, SECTORS, Seen};
use crate::geometry::{Pose, wrap_angle};
use crate::scan::Scan;
use nalgebra::{Matrix2, Rotation2, Vector2};

/// A frame, in the frame of the robot at a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// The step.
    pub step: u32,
    /// Number of the reading of that step.
    pub reading: usize,
    /// The nearest detections of the frame, at most [`MOST_SEEN`].
    pub(super) detected: Vec<Detected>,
    /// What is in view.
    pub horizon: Horizon,
}

/// One detection.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Detected {
    /// The class that the detector names.
    pub label: usize,
    /// Where the object is \[m\].
    pub position: Vector2<f64>,
    /// Covariance of that \[m²\].
    pub covariance: Matrix2<f64>,
    /// ln u_k, per square metre: clutter or a new landmark, of any class.
    pub log_null: f64,
}

/// The middle of an object is known no better \[m\].
const LEAST_SIGMA: f64 = 0.01;
/// An object is hit by the laser itself: its middle lies no farther than this behind what the laser hit \[m\].
const DEPTH: f64 = 0.3;

impl Observation {
    /// The robot has moved on since the frame: `robot_from_seen` is where it was. The scan is that of the step.
    pub(super) fn new(
        step: u32,
        reading: usize,
        frame: &Frame,
        robot_from_seen: Pose,
        sensors: &Sensors,
        scan: &Scan,
    ) -> Self {
        let mut seen: Vec<&Detection> = frame.in_view(sensors.view).map(|(_, detection)| detection).collect();
        seen.sort_by(|a, b| a.range.total_cmp(&b.range));
        seen.truncate(MOST_SEEN);
        let robot_from_sensor = robot_from_seen * sensors.robot_from_sensor;
        let detected = seen.into_iter().map(|seen| Detected::new(seen, sensors).moved(robot_from_sensor)).collect();
        Self { step, reading, detected, horizon: horizon(robot_from_sensor, sensors, scan) }
    }

    /// The detections, as the evaluator takes them.
    pub fn seen(&self) -> Vec<Seen> {
        let seen = |detected: &Detected| {
            let Detected { position, covariance, log_null, .. } = detected;
            Seen {
                x: position.x as f32,
                y: position.y as f32,
                xx: covariance.m11 as f32,
                xy: covariance.m12 as f32,
                yy: covariance.m22 as f32,
                log_null: *log_null as f32,
                padding: [0.0; 2],
            }
        };
        self.detected.iter().map(seen).collect()
    }

    /// How far from the robot landmarks matter \[m\].
    pub(super) fn reach(&self) -> f64 {
        let seen = self.detected.iter().map(|detected| detected.position.norm()).fold(0.0, f64::max);
        let [x, y] = self.horizon.sensor.map(f64::from);
        self.horizon.max_ranges.iter().fold(seen, |reach, &range| reach.max(f64::from(range))) + x.hypot(y)
    }
}

impl Detected {
    /// In the sensor's frame.
    fn new(seen: &Detection, sensors: &Sensors) -> Self {
        let [range, bearing] = sensors.noise.at(seen.range);
        let across = (seen.range * bearing).max(LEAST_SIGMA);
        let turn = Rotation2::new(seen.bearing).into_inner();
        let variances = Matrix2::from_diagonal(&Vector2::new(range.max(LEAST_SIGMA).powi(2), across.powi(2)));
        // A metre of range times a radian of bearing is as many square metres as the range has metres.
        let nulls = 2.0 * sensors.detector.clutter_density / seen.range;
        Self {
            label: seen.class,
            position: seen.position().coords,
            covariance: turn * variances * turn.transpose(),
            log_null: (nulls / sensors.classes.len() as f64).ln(),
        }
    }

    /// As it is seen from where `here_from_there` comes from.
    pub fn moved(&self, here_from_there: Pose) -> Self {
        let turn = Rotation2::new(here_from_there.heading).into_inner();
        Self {
            position: turn * self.position + here_from_there.position().coords,
            covariance: turn * self.covariance * turn.transpose(),
            ..*self
        }
    }
}

/// In each direction as far as the nearest point of the scan there; 0 where the laser has not measured.
fn horizon(robot_from_sensor: Pose, sensors: &Sensors, scan: &Scan) -> Horizon {
    let mut nearest = [f64::INFINITY; SECTORS];
    for point in &scan.points {
        let off = point - robot_from_sensor.position();
        let sector = &mut nearest[Horizon::sector(off.x as f32, off.y as f32)];
        *sector = sector.min(off.norm());
    }
    let view = sensors.view;
    let max_ranges = std::array::from_fn(|sector| {
        let bearing = wrap_angle(Horizon::middle(sector) - robot_from_sensor.heading);
        let is_seen = nearest[sector].is_finite() && (view.min_bearing..=view.max_bearing).contains(&bearing);
        if is_seen { (nearest[sector] + DEPTH).min(view.max_range) as f32 } else { 0.0 }
    });
    let sensor = [robot_from_sensor.x as f32, robot_from_sensor.y as f32];
    Horizon { sensor, min_range: view.min_range as f32, max_ranges }
}
