//! Densities of detections and motions.

use crate::association::class_log_likelihood;
use crate::detections::{Detection, Recording, Sensors, View};
use crate::factor_graph::{Prediction, RangeBearing};
use crate::geometry::Pose;
use nalgebra::{DMatrix, Point2, Vector2, Vector3};
use std::f64::consts::{PI, TAU};

/// Scale c of Cauchy's loss ½ c² ln(1 + d²/c²), in standard deviations: real detections have gross outliers, and of a few hundred
/// normal errors none is expected beyond three standard deviations.
pub const LOSS_SCALE: f64 = 3.0;
/// Lower bound of the probability of a label: no real detector is free of confusions.
const MIN_CONFUSION: f64 = 1e-3;
/// Prior standard deviations of the calibration: forward scale, turn scale, curvature \[rad/m\]. Uncalibrated wheels and tracks
/// are off by about a tenth and pull to one side by a few degrees per metre.
pub const CALIBRATION_SIGMAS: [f64; 3] = [0.1, 0.1, 0.05];
/// An object is in view for certain this far from the edges of the view \[standard deviations\].
const INSIDE: f64 = 3.0;
/// A sensor that saw nothing within this angle of straight behind \[rad\] is taken to have a limited field of view.
const OPEN: f64 = 0.5;
/// No motion is known better than this \[m, rad\].
const MIN_MOTION_SIGMA: f64 = 1e-4;

/// The sensors of a recording.
#[derive(Clone, Debug)]
pub struct SensorModel<'a> {
    /// Their description.
    pub sensors: &'a Sensors,
    view: View,
    confusion: DMatrix<f64>,
}

impl<'a> SensorModel<'a> {
    /// The model of a recording's sensors.
    pub fn new(recording: &'a Recording) -> Self {
        let sensors = &recording.sensors;
        let count = sensors.classes.len();
        let entry = |class: usize, label: usize| {
            let row = sensors.confusion.get(class);
            row.and_then(|row| row.get(label)).map_or(MIN_CONFUSION, |share| share.max(MIN_CONFUSION))
        };
        Self { sensors, view: closed_view(recording), confusion: DMatrix::from_fn(count, count, entry) }
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

    /// ln of the density of a detection of any label, where detections have this density \[1/(m rad)\].
    pub fn log_density_of_any_label(&self, density: f64) -> f64 {
        density.ln() - (self.classes() as f64).ln()
    }

    /// Variances of range \[m²\] and bearing \[rad²\].
    pub fn variances(&self, seen: &Detection) -> Vector2<f64> {
        let [range, bearing] = self.sensors.noise.at(seen.range);
        Vector2::new(range * range, bearing * bearing)
    }

    /// A landmark as seen from a pose; `None` if it coincides with the sensor.
    pub fn predict(&self, world_from_robot: Pose, landmark: Point2<f64>) -> Option<Prediction> {
        let prediction = RangeBearing::predict(world_from_robot, landmark, self.sensors.robot_from_sensor);
        (prediction.mean.x >= 1e-6).then_some(prediction)
    }

    /// Whether an object that is predicted there would be in view for certain.
    pub fn is_in_view(&self, prediction: &Prediction) -> bool {
        let View { min_range, max_range, min_bearing, max_bearing } = self.view;
        let (range, bearing) = (prediction.mean.x, prediction.mean.y);
        let [range_sigma, bearing_sigma] = self.sensors.noise.at(range).map(|sigma| INSIDE * sigma);
        let sees_all_round = max_bearing - min_bearing >= TAU - 1e-9;
        let bearings = min_bearing + bearing_sigma..=max_bearing - bearing_sigma;
        (min_range..=max_range - range_sigma).contains(&range) && (sees_all_round || bearings.contains(&bearing))
    }

    /// Where the object of a detection is.
    pub fn position(&self, world_from_robot: Pose, seen: &Detection) -> Point2<f64> {
        world_from_robot * (self.sensors.robot_from_sensor * seen.position())
    }

    /// The log-density of a detection at a squared distance d² \[standard deviations\] from where its landmark is seen.
    ///
    /// It is that of the loss: (1 - 2/c²) / (2π |R|^½) (1 + d²/c²)^(-c²/2), Student's distribution of the plane. The noise
    /// is `tempering` times as wide.
    pub fn log_density(&self, innovation: Vector2<f64>, variances: Vector2<f64>, tempering: f64) -> f64 {
        let squared = innovation.component_mul(&innovation).component_div(&variances).sum() / (tempering * tempering);
        let c2 = LOSS_SCALE * LOSS_SCALE;
        let area = TAU * (variances.x * variances.y).sqrt() * tempering * tempering;
        (1.0 - 2.0 / c2).ln() - area.ln() - 0.5 * c2 * (squared / c2).ln_1p()
    }
}

/// The field of view by the sensor's description. If the description leaves the range or the bearings unlimited, as it does by
/// default, the outermost detections limit them.
fn closed_view(recording: &Recording) -> View {
    let mut view = recording.sensors.view;
    let seen = || recording.frames.iter().flat_map(|frame| frame.in_view(recording.sensors.view)).map(|(_, seen)| seen);
    if view.max_range == f64::INFINITY {
        view.max_range = seen().map(|seen| seen.range).fold(0.0, f64::max);
    }
    if view.min_bearing <= -PI && view.max_bearing >= PI {
        let most = seen().map(|seen| seen.bearing.abs()).fold(0.0, f64::max);
        if most < PI - OPEN {
            (view.min_bearing, view.max_bearing) = (-most, most);
        }
    }
    view
}

/// The noise of a motion (forward \[m\], sideways \[m\], turn \[rad\]), as variances.
pub fn motion_variances(variances: [f64; 3]) -> Vector3<f64> {
    Vector3::from(variances).map(|variance| variance.max(MIN_MOTION_SIGMA * MIN_MOTION_SIGMA))
}
