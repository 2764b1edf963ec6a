//! Path, calibration, map and weights.

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
    /// Sum of its weights: the expected number of its detections.
    pub weight: f64,
}

impl Landmark {
    /// The most likely class.
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
    /// Index of the detection in the keyframe.
    pub detection: usize,
    /// Index of the landmark in the map.
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
    /// Probability that a landmark in view is detected.
    pub detection_probability: f64,
    /// The pairs of each keyframe.
    pub weights: Vec<Vec<Pair>>,
    /// Number of each landmark in the forward pass.
    pub numbers: Vec<usize>,
}

impl Estimate {
    /// Keeps the landmarks at these indices, and their pairs.
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
