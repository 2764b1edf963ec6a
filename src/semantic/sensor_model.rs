//! Densities of detections and motions.

use super::linear::{LOSS_SCALE, Linear};
use super::world::World;
use crate::association::class_log_likelihood;
use crate::detections::Motion;
use nalgebra::DMatrix;

/// Lower bound of the probability of a label: no real detector is free of confusions.
const MIN_CONFUSION: f64 = 1e-3;
/// No motion is known better than this \[m, rad\].
const MIN_MOTION_SIGMA: f64 = 1e-4;

/// The sensors of a recording.
#[derive(Clone, Debug)]
pub struct SensorModel<'a, W: World> {
    sensors: &'a W::Sensors,
    /// The least and the largest of each number that a detection can have.
    view: [W::Numbers; 2],
    confusion: DMatrix<f64>,
    clutter_density: f64,
    new_density: f64,
    /// How far a detection typically errs \[m\].
    pub error: f64,
}

impl<'a, W: World> SensorModel<'a, W> {
    /// The model of a recording's sensors.
    pub fn new(recording: &'a W::Recording) -> Self {
        let sensors = W::sensors(recording);
        let (classes, confusion) = W::labels(sensors);
        let entry = |class: usize, label: usize| {
            let row = confusion.get(class);
            row.and_then(|row| row.get(label)).map_or(MIN_CONFUSION, |share| share.max(MIN_CONFUSION))
        };
        let confusion = DMatrix::from_fn(classes.len(), classes.len(), entry);
        Self {
            sensors,
            view: W::view(recording),
            confusion,
            clutter_density: W::clutter_density(recording),
            new_density: W::new_density(recording),
            error: W::error(recording),
        }
    }

    /// Number of classes.
    pub fn classes(&self) -> usize {
        self.confusion.nrows()
    }

    /// p(label | true class).
    pub fn confusion(&self, class: usize, label: usize) -> f64 {
        self.confusion.get((class, label)).copied().unwrap_or(MIN_CONFUSION)
    }

    /// ln Σ_c π(c) p(label | c).
    pub fn class_log_likelihood(&self, posterior: &[f64], label: usize) -> f64 {
        class_log_likelihood(&self.confusion, posterior, label)
    }

    /// That an object in view is detected, by the description.
    pub fn detection_probability(&self) -> f64 {
        W::detection_probability(self.sensors)
    }

    /// The log-density of false detections of any label.
    pub fn log_clutter(&self) -> f64 {
        self.log_density_of_any_label(self.clutter_density)
    }

    /// The log-density of detections of new landmarks, of any label, where it is so many \[1/(m rad)\] in the plane.
    pub fn log_new(&self, density: f64) -> f64 {
        self.log_density_of_any_label(density * self.new_density)
    }

    fn log_density_of_any_label(&self, density: f64) -> f64 {
        density.ln() - (self.classes() as f64).ln()
    }

    /// Variances of a detection's numbers.
    pub fn variances(&self, seen: &W::Detection) -> W::Numbers {
        let mut variances = W::sigmas(self.sensors, W::numbers(seen));
        variances.as_mut().iter_mut().for_each(|sigma| *sigma *= *sigma);
        variances
    }

    /// A landmark as seen from a pose; none where it cannot be.
    pub fn predict(&self, world_from_robot: W::Pose, landmark: W::Point) -> Option<W::Prediction> {
        W::predict(self.sensors, world_from_robot, landmark)
    }

    /// Whether an object that is predicted there would be in view for certain.
    pub fn is_in_view(&self, prediction: &W::Prediction) -> bool {
        W::is_in_view(self.sensors, self.view, prediction.mean())
    }

    /// Where the object of a detection is.
    pub fn position(&self, world_from_robot: W::Pose, seen: &W::Detection) -> W::Point {
        W::position(self.sensors, world_from_robot, seen)
    }

    /// The log-density of a detection where its landmark is predicted.
    ///
    /// It is that of the loss with d² the squared error in its variances: p₀ |R|^-½ (1 + d²/c²)^(-c²/2), Student's
    /// distribution. The noise is `tempering` times as wide.
    pub fn log_density(&self, prediction: &W::Prediction, seen: &W::Detection, tempering: f64) -> f64 {
        let (errors, variances) = (squared_errors::<W>(prediction, seen), self.variances(seen));
        let squared: f64 =
            errors.as_ref().iter().zip(variances.as_ref()).map(|(error, variance)| error / variance).sum();
        let size: f64 = variances.as_ref().iter().map(|variance| tempering * variance.sqrt()).product();
        let c2 = LOSS_SCALE * LOSS_SCALE;
        W::LOG_PEAK - size.ln() - 0.5 * c2 * (squared / (tempering * tempering) / c2).ln_1p()
    }

    /// The noise of a motion as variances of the end's step.
    pub fn motion_variances(&self, motion: &Motion<W::Pose>) -> Vec<f64> {
        let mut variances = W::motion_variances(self.sensors, motion);
        variances.iter_mut().for_each(|variance| *variance = variance.max(MIN_MOTION_SIGMA * MIN_MOTION_SIGMA));
        variances
    }

    /// Standard deviations of the odometry's calibration before anything was seen.
    pub fn calibration_sigmas(&self) -> W::Calibration {
        W::calibration_sigmas(self.sensors)
    }

    /// The sensors as they are described.
    pub fn sensors(&self) -> &'a W::Sensors {
        self.sensors
    }
}

/// Of each number the squared error.
pub fn squared_errors<W: World>(prediction: &W::Prediction, seen: &W::Detection) -> W::Numbers {
    let mut errors = W::innovation(prediction, seen);
    errors.as_mut().iter_mut().for_each(|error| *error *= *error);
    errors
}
