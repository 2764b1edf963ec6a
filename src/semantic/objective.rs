//! How good path, calibration and map are together.

use super::e_step::table;
use super::estimate::Estimate;
use super::keyframes::Keyframe;
use super::sensor_model::SensorModel;
use super::world::{Plane, World};
use crate::association::{Policy, associate};

impl<W: World> Estimate<W> {
    /// The objective \[nats\], by which runs are compared: the log-likelihood of all sets of detections, each under its best
    /// assignment, less the cost of the path by odometry, of the calibration by its prior, and of each landmark.
    ///
    /// A sum over the assignments would favour landmarks that are mapped twice.
    pub fn objective(&self, model: &SensorModel<'_, W>, keyframes: &[Keyframe<W>], landmark_cost: f64) -> f64 {
        let sets: f64 = keyframes
            .iter()
            .zip(&self.poses)
            .filter(|(keyframe, _)| !keyframe.seen.is_empty())
            .map(|(keyframe, pose)| {
                let table = table(model, *pose, &self.landmarks, &keyframe.seen, self.detection_probability, 1.0);
                associate(&table, Policy::Hungarian).log_likelihood
            })
            .sum();
        let prior = 0.5 * self.calibrated_by(model).map(|off| off * off).sum::<f64>();
        let odometry = self.odometry_cost(model, keyframes);
        // A landmark costs the same for each of its coordinates.
        let landmark_cost = landmark_cost / Plane::POINT as f64 * W::POINT as f64;
        sets - odometry - prior - landmark_cost * self.landmarks.len() as f64
    }

    /// The change that calibration makes of each number \[standard deviations of its prior\].
    pub fn calibrated_by(&self, model: &SensorModel<'_, W>) -> impl Iterator<Item = f64> {
        let (calibrated, sigmas) = (W::CALIBRATED, model.calibration_sigmas());
        let off = move |axis| (self.calibration.as_ref()[axis] - calibrated.as_ref()[axis]) / sigmas.as_ref()[axis];
        (0..sigmas.as_ref().len()).map(off)
    }

    /// Cost of the path by odometry \[nats\]: half the squared errors, divided by their variances.
    pub fn odometry_cost(&self, model: &SensorModel<'_, W>, keyframes: &[Keyframe<W>]) -> f64 {
        self.poses
            .windows(2)
            .zip(keyframes.iter().skip(1))
            .map(|(pair, keyframe)| {
                let predicted = pair[0] * W::moved(&keyframe.motion, self.calibration).pose;
                let variances = model.motion_variances(&keyframe.motion);
                let errors = W::difference(predicted, pair[1]).into_iter().zip(variances);
                0.5 * errors.map(|(error, variance)| error * error / variance).sum::<f64>()
            })
            .sum()
    }
}
