//! One landmark.

use super::observation::Detected;
use crate::geometry::Pose;
use nalgebra::{DMatrix, Matrix2, Point2, Rotation2, Vector2};

/// An object on the map.
#[derive(Clone, Debug, PartialEq)]
pub struct Landmark {
    /// Mean of its position in the world \[m\].
    pub position: Point2<f64>,
    /// Covariance of its position \[m²\].
    pub covariance: Matrix2<f64>,
    /// Probability of each class.
    pub classes: Vec<f64>,
    /// Probability that it is there, up to 0.999: things are carried away.
    pub existence: f64,
    /// How often it was detected: the sum of the weights of its detections.
    pub sightings: f64,
}

/// No landmark is more certain than this: a handful of frames that miss it suffice to take it off the map.
const MOST_CERTAIN: f64 = 0.999;
/// Less likely landmarks are taken off the map: two frames that miss what one has shown.
pub(super) const LEAST_CERTAIN: f64 = 0.01;
/// More likely ones are told of in the end.
const SURE: f64 = 0.9;
/// Weights below this change nothing.
const LEAST_WEIGHT: f64 = 1e-3;

impl Landmark {
    /// A landmark that one detection of this weight has shown, if it is there at all.
    pub(super) fn new(detected: &Detected, weight: f64, existence: f64, confusion: &DMatrix<f64>) -> Self {
        let classes = vec![1.0; confusion.nrows()];
        let mut landmark = Self {
            position: detected.position.into(),
            covariance: detected.covariance,
            classes,
            existence,
            sightings: weight,
        };
        landmark.label(detected.label, 1.0, confusion);
        landmark
    }

    /// Whether it is surely there.
    pub fn is_sure(&self) -> bool {
        self.existence >= SURE
    }

    /// Seen in a world whose origin is `there_from_here`.
    pub fn moved(&self, there_from_here: Pose) -> Self {
        let turn = Rotation2::new(there_from_here.heading).into_inner();
        Self {
            position: there_from_here * self.position,
            covariance: turn * self.covariance * turn.transpose(),
            ..self.clone()
        }
    }

    /// The most likely class.
    pub fn class(&self) -> usize {
        let classes = 0..self.classes.len();
        classes.max_by(|&a, &b| self.classes[a].total_cmp(&self.classes[b]).then(b.cmp(&a))).unwrap_or(0)
    }

    /// Takes in a frame: the detections, placed in the world, that it has given rise to, with their weights w_kj.
    ///
    /// A detection of weight w counts as one whose covariance is 1/w times as large, and as w labels:
    /// Σ⁻¹ ← Σ⁻¹ + Σ_k w_kj R_k⁻¹, Σ⁻¹ l ← Σ⁻¹ l + Σ_k w_kj R_k⁻¹ z_k, π(c) ← π(c) Π_k p(class_k | c)^w_kj.
    pub(super) fn update<'a>(&mut self, detected: impl Iterator<Item = (f64, &'a Detected)>, confusion: &DMatrix<f64>) {
        let (mut information, mut moved) = (Matrix2::zeros(), Vector2::zeros());
        for (weight, detected) in detected.filter(|(weight, _)| *weight > LEAST_WEIGHT) {
            let Some(precision) = detected.covariance.try_inverse() else { continue };
            information += weight * precision;
            moved += weight * precision * (detected.position - self.position.coords);
            self.sightings += weight;
            self.label(detected.label, weight, confusion);
        }
        let updated = self.covariance.try_inverse().and_then(|before| (before + information).try_inverse());
        if let Some(covariance) = updated {
            self.covariance = 0.5 * (covariance + covariance.transpose());
            self.position += covariance * moved;
        }
    }

    /// Takes in whether it was detected, with this probability. `missed` is the probability that it is there where it was not.
    pub(super) fn confirm(&mut self, detected: f64, missed: f64) {
        self.existence = (detected + (1.0 - detected) * missed).min(MOST_CERTAIN);
    }

    fn label(&mut self, label: usize, weight: f64, confusion: &DMatrix<f64>) {
        for (class, probability) in self.classes.iter_mut().enumerate() {
            *probability *= confusion.get((class, label)).map_or(1.0, |share| share.powf(weight));
        }
        let sum: f64 = self.classes.iter().sum();
        self.classes.iter_mut().for_each(|probability| *probability /= sum);
    }
}
