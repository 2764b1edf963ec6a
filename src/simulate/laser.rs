//! What the laser says: the distance to the nearest wall in every beam, with noise, gaps and people in the way.
//!
//! In: the world and the robot's pose in it. Out: one range a beam \[m\], in whole millimetres, `max_range` for no
//! return. The sweep is taken at one instant: the robot's motion during it is not simulated.

use super::world::World;
use crate::geometry::Pose;
use nalgebra::{Point2, Vector2};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Radius of a person \[m\].
const PERSON_RADIUS: f64 = 0.2;
/// How near and how far people stand \[m\].
const PERSON_DISTANCE: std::ops::Range<f64> = 0.8..4.0;

/// The laser and its errors. The defaults are those of a SICK LMS that looks ahead over half a circle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Laser {
    /// Beams of a sweep, from 2 to 100 000; the first and the last lie on the edges of the field of view.
    pub beams: usize,
    /// Field of view \[rad\], above 0, at most 2π, centred on the laser's x axis.
    pub field_of_view: f64,
    /// Longest range \[m\], also what a beam without return reports.
    pub max_range: f64,
    /// Standard deviation of a range \[m\].
    pub range_noise: f64,
    /// Share of the beams that get no return.
    pub dropouts: f64,
    /// Share of the sweeps that a person stands in.
    pub people: f64,
    /// Where the laser is mounted.
    pub robot_from_laser: Pose,
}

impl Default for Laser {
    fn default() -> Self {
        Self {
            beams: 361,
            field_of_view: std::f64::consts::PI,
            max_range: 81.91,
            range_noise: 0.015,
            dropouts: 0.01,
            people: 0.1,
            robot_from_laser: Pose { x: 0.1, y: 0.0, heading: 0.0 },
        }
    }
}

impl Laser {
    /// Angle of the first beam in the laser's frame \[rad\].
    pub fn first_angle(&self) -> f64 {
        -0.5 * self.field_of_view
    }

    /// Angle from one beam to the next \[rad\].
    pub fn angle_step(&self) -> f64 {
        self.field_of_view / (self.beams - 1) as f64
    }

    /// One sweep from a pose.
    pub(super) fn sweep(&self, world: &World, world_from_robot: Pose, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let world_from_laser = world_from_robot * self.robot_from_laser;
        let person = rng.random_bool(self.people).then(|| {
            let angle = rng.random_range(-0.5..0.5) * self.field_of_view;
            Point2::from(direction(angle) * rng.random_range(PERSON_DISTANCE))
        });
        let mut beam = |index: usize| {
            let ahead = direction(self.first_angle() + index as f64 * self.angle_step());
            let wall = world.cast(world_from_laser.position(), world_from_laser * ahead, self.max_range);
            let person = person.and_then(|centre| distance_to_disc(centre, PERSON_RADIUS, ahead));
            let noise = self.range_noise * rng.sample::<f64, _>(StandardNormal);
            let lost = rng.random_bool(self.dropouts);
            let nearest = wall.into_iter().chain(person).reduce(f64::min);
            nearest
                .filter(|_| !lost)
                .map_or(self.max_range, |range| in_millimetres(range + noise).clamp(0.0, self.max_range))
        };
        (0..self.beams).map(&mut beam).collect()
    }
}

fn in_millimetres(range: f64) -> f64 {
    (range * 1000.0).round() / 1000.0
}

fn direction(angle: f64) -> Vector2<f64> {
    Vector2::new(angle.cos(), angle.sin())
}

/// Distance from the origin along a direction to a disc that does not cover the origin.
fn distance_to_disc(centre: Point2<f64>, radius: f64, ahead: Vector2<f64>) -> Option<f64> {
    let along = ahead.dot(&centre.coords);
    let half_chord_squared = radius * radius - (centre.coords.norm_squared() - along * along);
    (along > 0.0 && half_chord_squared >= 0.0).then(|| along - half_chord_squared.sqrt())
}
