//! A robot of the plane.

use super::{INSIDE, Moved, Seen, World};
use crate::detections::{Detection, Frame, Motion, Recording, Sensors, View};
use crate::factor_graph::{Factor, Odometry, Prediction, RangeBearing, VariableId};
use crate::geometry::Pose;
use nalgebra::{Point2, SMatrix, Vector3};
use std::f64::consts::{PI, TAU};

/// A sensor looks ahead, and not all round, if it saw nothing in so wide a sector to each side of straight behind \[rad\].
const OPEN: f64 = 0.5;
/// Standard deviations of forward scale, turn scale and curvature \[rad/m\]. Wheels and tracks that were never measured are off by
/// about a tenth, and pull to one side by a few degrees a metre.
const CALIBRATION_SIGMAS: [f64; 3] = [0.1, 0.1, 0.05];

/// A robot of the plane, whose detector tells range and bearing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane;

impl World for Plane {
    type Recording = Recording;
    type Sensors = Sensors;
    type Detection = Detection;
    type Numbers = [f64; 2];
    type Calibration = [f64; 3];
    type Pose = Pose;
    type Point = Point2<f64>;
    type PoseCovariance = SMatrix<f64, 3, 3>;
    type PointCovariance = SMatrix<f64, 2, 2>;
    type Prediction = Prediction<3, 2>;

    const POSE: usize = 3;
    const POINT: usize = 2;
    /// Forward scale, turn scale, curvature \[rad/m\].
    const CALIBRATED: [f64; 3] = Odometry::CALIBRATED;
    /// (1 - 2/c²) / (2π): Student's distribution of the plane.
    const LOG_PEAK: f64 = -2.089_191_494_690_252;

    fn labels(sensors: &Sensors) -> (&[String], &[Vec<f64>]) {
        (&sensors.classes, &sensors.confusion)
    }

    fn movable(sensors: &Sensors) -> &[usize] {
        &sensors.movable
    }

    fn detection_probability(sensors: &Sensors) -> f64 {
        sensors.detector.detection_probability
    }

    fn sensors(recording: &Recording) -> &Sensors {
        &recording.sensors
    }

    fn frames(recording: &Recording) -> Vec<Seen<Detection>> {
        let in_view =
            |frame: &Frame| frame.in_view(recording.sensors.view).map(|(number, seen)| (number, *seen)).collect();
        recording.frames.iter().map(|frame| (frame.stamp, in_view(frame))).collect()
    }

    fn motion(recording: &Recording, from: f64, to: f64) -> Motion {
        recording.odometry.motion(from, to)
    }

    fn view(recording: &Recording) -> [[f64; 2]; 2] {
        let mut view = recording.sensors.view;
        let seen = || recording.frames.iter().flat_map(|frame| frame.in_view(recording.sensors.view));
        if view.max_range == f64::INFINITY {
            view.max_range = seen().map(|(_, seen)| seen.range).fold(0.0, f64::max);
        }
        if view.min_bearing <= -PI && view.max_bearing >= PI {
            let most = seen().map(|(_, seen)| seen.bearing.abs()).fold(0.0, f64::max);
            if most < PI - OPEN {
                (view.min_bearing, view.max_bearing) = (-most, most);
            }
        }
        let View { min_range, max_range, min_bearing, max_bearing } = view;
        [[min_range, min_bearing], [max_range, max_bearing]]
    }

    fn error(recording: &Recording) -> f64 {
        let noise = recording.sensors.noise;
        noise.range.hypot(noise.position)
    }

    fn clutter_density(recording: &Recording) -> f64 {
        recording.sensors.detector.clutter_density
    }

    fn new_density(_: &Recording) -> f64 {
        1.0
    }

    fn calibration_sigmas(_: &Sensors) -> [f64; 3] {
        CALIBRATION_SIGMAS
    }

    fn label(seen: &Detection) -> usize {
        seen.class
    }

    fn sigmas(sensors: &Sensors, [range, _]: [f64; 2]) -> [f64; 2] {
        sensors.noise.at(range)
    }

    fn numbers(seen: &Detection) -> [f64; 2] {
        [seen.range, seen.bearing]
    }

    fn predict(sensors: &Sensors, pose: Pose, point: Point2<f64>) -> Option<Prediction<3, 2>> {
        let prediction = RangeBearing::predict(pose, point, sensors.robot_from_sensor);
        (prediction.mean.x >= 1e-6).then_some(prediction)
    }

    fn innovation(prediction: &Prediction<3, 2>, seen: &Detection) -> [f64; 2] {
        prediction.innovation(seen.range, seen.bearing).into()
    }

    fn position(sensors: &Sensors, pose: Pose, seen: &Detection) -> Point2<f64> {
        pose * (sensors.robot_from_sensor * seen.position())
    }

    fn is_in_view(sensors: &Sensors, view: [[f64; 2]; 2], [range, bearing]: [f64; 2]) -> bool {
        let [[min_range, min_bearing], [max_range, max_bearing]] = view;
        let [range_sigma, bearing_sigma] = sensors.noise.at(range).map(|sigma| INSIDE * sigma);
        let sees_all_round = max_bearing - min_bearing >= TAU - 1e-9;
        let bearings = min_bearing + bearing_sigma..=max_bearing - bearing_sigma;
        (min_range..=max_range - range_sigma).contains(&range) && (sees_all_round || bearings.contains(&bearing))
    }

    fn origin() -> Pose {
        Pose::IDENTITY
    }

    fn step(pose: Pose, step: &[f64]) -> Pose {
        pose * Pose::exp(Vector3::from_column_slice(step))
    }

    fn difference(from: Pose, to: Pose) -> Vec<f64> {
        to.seen_from(from).log().as_slice().to_vec()
    }

    fn apart(one: Pose, other: Pose) -> (f64, f64) {
        let off = one.seen_from(other);
        (off.position().coords.norm(), off.heading.abs())
    }

    fn coordinates(Pose { x, y, heading }: Pose) -> Vec<f64> {
        vec![x, y, heading]
    }

    fn moved(motion: &Motion, calibration: [f64; 3]) -> Moved<Pose> {
        let (twist, by_calibration) = Odometry::calibrated(motion.start_from_end.log(), calibration.into());
        let pose = Pose::exp(twist);
        let by_calibration = Pose::exp_jacobian(twist) * by_calibration;
        Moved::new(pose, pose.inverse().adjoint(), by_calibration)
    }

    fn motion_variances(sensors: &Sensors, motion: &Motion) -> Vec<f64> {
        sensors.odometry.variances(motion).to_vec()
    }

    fn motion_factor(ends: [VariableId; 2], calibration: VariableId, motion: &Motion) -> impl Factor + 'static {
        Odometry::new(ends[0], ends[1], calibration, motion.start_from_end)
    }

    fn detection_factor(
        sensors: &Sensors,
        pose: VariableId,
        landmark: VariableId,
        seen: &Detection,
    ) -> impl Factor + 'static {
        RangeBearing::new(pose, landmark, seen.range, seen.bearing).from_sensor(sensors.robot_from_sensor)
    }
}
