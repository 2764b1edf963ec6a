//! Path, calibration and map, and how good they are together.

use super::e_step::table;
use super::keyframes::Keyframe;
use super::sensor_model::{CALIBRATION_SIGMAS, SensorModel, motion_variances};
use crate::association::{Policy, associate};
use crate::factor_graph::Odometry;
use crate::geometry::Pose;
use crate::report::Bits;
use nalgebra::{Matrix2, Point2, Vector3};

/// An object of the map.
#[derive(Clone, Debug, PartialEq)]
pub struct Landmark {
    /// In the world \[m\].
    pub position: Point2<f64>,
    /// Covariance of the position \[m²\], as seen from the first pose.
    pub covariance: Matrix2<f64>,
    /// Probability of each class.
    pub classes: Vec<f64>,
    /// Sum of its weights: how many detections show it.
    pub weight: f64,
}

impl Landmark {
    /// The likeliest class.
    pub fn class(&self) -> usize {
        let likeliest = self.classes.iter().enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b));
        likeliest.map_or(0, |(class, _)| class)
    }

    /// Adds all its numbers to a checksum.
    pub(super) fn add_to(&self, bits: &mut Bits) {
        bits.add(self.position.iter().chain(self.covariance.iter()).chain(&self.classes).copied());
        bits.add([self.weight]);
    }
}

/// A pair of a keyframe: detection, landmark, and the probability that the one shows the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Its place in the keyframe.
    pub detection: usize,
    /// Its place in the map.
    pub landmark: usize,
    /// w, in 0..=1.
    pub weight: f64,
}

/// A MAP estimate under weights.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// `world_from_robot` of each keyframe.
    pub poses: Vec<Pose>,
    /// Forward scale, turn scale, curvature \[rad/m\].
    pub calibration: Vector3<f64>,
    /// The map.
    pub landmarks: Vec<Landmark>,
    /// That a landmark in view is detected.
    pub detection_probability: f64,
    /// The pairs of each keyframe.
    pub weights: Vec<Vec<Pair>>,
    /// Of each landmark its number in the forward pass.
    pub numbers: Vec<usize>,
}

impl Estimate {
    /// What runs are compared by \[nats\]: the log-likelihood of all sets of detections, each under its best assignment,
    /// less what the path costs by odometry, the calibration by its prior, and the landmarks by their number.
    ///
    /// Summed over the assignments instead, it would pay for landmarks that are mapped twice.
    pub fn objective(&self, model: &SensorModel<'_>, keyframes: &[Keyframe], landmark_cost: f64) -> f64 {
        let sets: f64 = keyframes
            .iter()
            .zip(&self.poses)
            .filter(|(keyframe, _)| !keyframe.seen.is_empty())
            .map(|(keyframe, pose)| {
                let table = table(model, *pose, &self.landmarks, &keyframe.seen, self.detection_probability, 1.0);
                associate(&table, Policy::Hungarian).log_likelihood
            })
            .sum();
        let off = self.calibration - Vector3::from(Odometry::CALIBRATED);
        let prior = 0.5 * off.component_div(&Vector3::from(CALIBRATION_SIGMAS)).norm_squared();
        let odometry = self.odometry_cost(model, keyframes);
        sets - odometry - prior - landmark_cost * self.landmarks.len() as f64
    }

    /// What the path costs by odometry \[nats\]: half the squared errors, in their variances.
    pub fn odometry_cost(&self, model: &SensorModel<'_>, keyframes: &[Keyframe]) -> f64 {
        self.poses
            .windows(2)
            .zip(keyframes.iter().skip(1))
            .map(|(pair, keyframe)| {
                let predicted = Pose::exp(Odometry::calibrated(keyframe.twist, self.calibration).0);
                let error = pair[1].seen_from(pair[0]).seen_from(predicted).log();
                let variances = motion_variances(model.sensors.odometry.variances(&keyframe.motion));
                0.5 * error.component_mul(&error).component_div(&variances).sum()
            })
            .sum()
    }

    /// Keeps the landmarks at these places, and their pairs.
    pub fn retain_landmarks(&mut self, mut keep: impl FnMut(usize) -> bool) {
        let mut places = Vec::with_capacity(self.landmarks.len());
        let mut kept = 0;
        for place in 0..self.landmarks.len() {
            places.push(keep(place).then_some(kept));
            kept += usize::from(places[place].is_some());
        }
        let mut stays = places.iter().map(Option::is_some);
        self.landmarks.retain(|_| stays.next().unwrap_or(false));
        let mut stays = places.iter().map(Option::is_some);
        self.numbers.retain(|_| stays.next().unwrap_or(false));
        for pairs in &mut self.weights {
            pairs.retain_mut(|pair| {
                let place = places.get(pair.landmark).copied().flatten();
                pair.landmark = place.unwrap_or(pair.landmark);
                place.is_some()
            });
        }
    }
}
