//! Path, calibration, map and weights.

use super::world::{Plane, Square, World};
use crate::objects;
use crate::report::Bits;
use nalgebra::{DMatrix, Point2};

/// An object of the map.
#[derive(Clone, Debug, PartialEq)]
pub struct Landmark<W: World = Plane> {
    /// In the world \[m\].
    pub position: W::Point,
    /// Covariance of the position \[m²\], as seen from the first pose.
    pub covariance: W::PointCovariance,
    /// Probability of each class.
    pub classes: Vec<f64>,
    /// Sum of its weights: the expected number of its detections.
    pub weight: f64,
}

impl From<&objects::Landmark> for Landmark {
    fn from(landmark: &objects::Landmark) -> Self {
        let objects::Landmark { position, covariance, ref classes, sightings, .. } = *landmark;
        Self { position, covariance, classes: classes.clone(), weight: sightings }
    }
}

impl<W: World> Landmark<W> {
    /// The likeliest class.
    pub fn class(&self) -> usize {
        let likeliest = self.classes.iter().enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b));
        likeliest.map_or(0, |(class, _)| class)
    }

    /// It as it is seen from above, along the axis z.
    pub fn from_above(&self) -> Landmark {
        let numbers: W::Numbers = self.position.into();
        let covariance = DMatrix::from_column_slice(W::POINT, W::POINT, self.covariance.entries());
        Landmark {
            position: Point2::from_slice(&numbers.as_ref()[..2]),
            covariance: Square::of(&covariance.view((0, 0), (2, 2)).into_owned()),
            classes: self.classes.clone(),
            weight: self.weight,
        }
    }

    /// Adds all its numbers to a checksum.
    pub(super) fn add_to(&self, bits: &mut Bits) {
        let position: W::Numbers = self.position.into();
        bits.add(position.as_ref().iter().chain(self.covariance.entries()).chain(&self.classes).copied());
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
pub struct Estimate<W: World> {
    /// `world_from_robot` of each keyframe.
    pub poses: Vec<W::Pose>,
    /// Of the odometry.
    pub calibration: W::Calibration,
    /// The map.
    pub landmarks: Vec<Landmark<W>>,
    /// That a landmark in view is detected.
    pub detection_probability: f64,
    /// The pairs of each keyframe.
    pub weights: Vec<Vec<Pair>>,
    /// Number of each landmark in the forward pass.
    pub numbers: Vec<usize>,
}

impl<W: World> Estimate<W> {
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
