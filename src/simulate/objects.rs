//! What a detector of objects sees: range and bearing of what is in view, with noise, wrong labels, misses and false detections.
//!
//! In: the objects, the walls that hide them, and the robot's pose. Out: a frame of detections. The laser does not see the objects:
//! doors are flush with the walls, and chairs and plants stand on legs.

use super::World;
use crate::detections::{Detection, Frame, Sensors, View};
use crate::geometry::{Pose, wrap_angle};
use nalgebra::Point2;
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Poisson, StandardNormal};
use std::f64::consts::{FRAC_PI_2, PI};

/// A thing of some class.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Object {
    /// Number of its class.
    pub class: usize,
    /// Where it is, in the world's frame \[m\].
    pub position: Point2<f64>,
}

/// A wall hides what is this far behind it \[m\].
const HIDDEN: f64 = 0.2;

/// A camera that looks ahead over half a circle, 6 m far.
pub fn camera(classes: &[String]) -> Sensors {
    let view = View { min_range: 0.3, max_range: 6.0, min_bearing: -FRAC_PI_2, max_bearing: FRAC_PI_2 };
    Sensors { view, ..Sensors::new(classes.to_vec(), 0.9) }
}

/// One frame from a pose.
pub(super) fn frame(
    stamp: f64,
    world: &World,
    objects: &[Object],
    world_from_robot: Pose,
    sensors: &Sensors,
    rng: &mut ChaCha8Rng,
) -> Frame {
    let world_from_sensor = world_from_robot * sensors.robot_from_sensor;
    let mut detections: Vec<Detection> = Vec::new();
    for object in objects {
        let ahead = object.position - world_from_sensor.position();
        let (range, bearing) = (ahead.norm(), wrap_angle(ahead.y.atan2(ahead.x) - world_from_sensor.heading));
        if !sensors.view.holds(range, bearing) || is_hidden(world, world_from_sensor, object) {
            continue;
        }
        if rng.random_bool(sensors.detector.detection_probability) {
            let [sigma, bearing_sigma] = sensors.noise.at(range);
            let mut error = |sigma: f64| sigma * rng.sample::<f64, _>(StandardNormal);
            let (range, bearing) = (range + error(sigma), wrap_angle(bearing + error(bearing_sigma)));
            detections.push(Detection {
                class: label(&sensors.confusion[object.class], rng),
                score: 1.0,
                range,
                bearing,
            });
        }
    }
    let View { min_range, max_range, min_bearing, max_bearing } = sensors.view;
    let (reach, width) = (max_range - min_range, max_bearing - min_bearing);
    let expected = sensors.detector.clutter_density * reach * width;
    let false_ones = Poisson::new(expected).map_or(0.0, |poisson| rng.sample(poisson));
    for _ in 0..false_ones as usize {
        let (range, bearing) = (min_range + reach * rng.random::<f64>(), min_bearing + width * rng.random::<f64>());
        let class = rng.random_range(0..sensors.classes.len());
        detections.push(Detection { class, score: 1.0, range, bearing: bearing.clamp(-PI, PI) });
    }
    detections.retain(|seen| sensors.view.holds(seen.range, seen.bearing));
    // Their order tells nothing.
    detections.sort_by(|a, b| a.bearing.total_cmp(&b.bearing));
    Frame { stamp, detections }
}

fn is_hidden(world: &World, world_from_sensor: Pose, object: &Object) -> bool {
    let ahead = object.position - world_from_sensor.position();
    let range = ahead.norm();
    world.cast(world_from_sensor.position(), ahead / range, range - HIDDEN).is_some()
}

/// A label of an object, by the probabilities of its class.
fn label(row: &[f64], rng: &mut ChaCha8Rng) -> usize {
    let mut left: f64 = rng.random();
    let is_over = |share: &f64| {
        left -= share;
        left < 0.0
    };
    row.iter().position(is_over).unwrap_or(row.len() - 1)
}
