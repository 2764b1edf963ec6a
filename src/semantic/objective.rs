//! How good path, calibration and map are together.

use super::e_step::table;
use super::estimate::Estimate;
use super::keyframes::Keyframe;
use super::sensor_model::{CALIBRATION_SIGMAS, SensorModel, motion_variances};
use crate::association::{Policy, associate};
use crate::factor_graph::Odometry;
use crate::geometry::Pose;
use nalgebra::Vector3;

impl Estimate {
    /// The objective \[nats\], by which runs are compared: the log-likelihood of all sets of detections, each under its best
    /// assignment, less the cost of the path by odometry, of the calibration by its prior, and of each landmark.
    ///
    /// A sum over the assignments would favour landmarks that are mapped twice.
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

    /// Cost of the path by odometry \[nats\]: half the squared errors, divided by their variances.
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
}
