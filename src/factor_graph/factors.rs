//! What is known: residuals of a few variables each, with their derivatives.
//!
//! A residual is e = predicted - measured, on SE(2) as e = log(measured⁻¹ · predicted). The derivative by a variable is
//! that by its step, at step zero.

use super::{GraphError, Values, VariableId};
use crate::geometry::{Pose, wrap_angle};
use nalgebra::{DMatrixViewMut, Matrix2, Matrix2x3, Matrix3, Point2, Vector2, Vector3};
use std::fmt::Debug;

/// The derivative of a residual: a row for each of its numbers, and a column for each degree of freedom of the
/// factor's variables, one variable after the other.
pub type Jacobian<'a> = DMatrixViewMut<'a, f64>;

/// A residual that depends on a few variables.
pub trait Factor: Debug + Send + Sync {
    /// The variables, each once. Any number of them.
    fn variables(&self) -> &[VariableId];

    /// The length of the residual.
    fn dimension(&self) -> usize;

    /// Writes the residual, and where it is asked for the Jacobian, which is zero at the call. Neither is divided by the
    /// noise.
    ///
    /// # Errors
    /// A variable does not exist or is not what the factor needs.
    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError>;
}

/// e = log(measured⁻¹ · pose), and its derivative by a step of the pose: the inverse right Jacobian of SE(2) at e.
fn pose_error(measured: Pose, pose: Pose) -> (Vector3<f64>, Matrix3<f64>) {
    let error = pose.seen_from(measured).log();
    let jacobian = Pose::exp_jacobian(error);
    // [A v; 0 1] with A = [a b; -b a].
    let (a, b) = (jacobian[(0, 0)], jacobian[(0, 1)]);
    let inverse = Matrix2::new(a, -b, b, a) / (a * a + b * b);
    let last = -inverse * Vector2::new(jacobian[(0, 2)], jacobian[(1, 2)]);
    let derivative =
        Matrix3::new(inverse[(0, 0)], inverse[(0, 1)], last.x, inverse[(1, 0)], inverse[(1, 1)], last.y, 0.0, 0.0, 1.0);
    (error, derivative)
}

/// A variable is known beforehand.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    variable: [VariableId; 1],
    mean: Mean,
}

#[derive(Clone, Debug, PartialEq)]
enum Mean {
    Pose(Pose),
    Point(Point2<f64>),
    Vector(Vec<f64>),
}

impl Prior {
    /// e = log(mean⁻¹ · pose): (forward, sideways \[m\], turn \[rad\]) in the frame of the mean.
    pub fn pose(pose: VariableId, mean: Pose) -> Self {
        Self { variable: [pose], mean: Mean::Pose(mean) }
    }

    /// e = point - mean \[m\].
    pub fn point(point: VariableId, mean: Point2<f64>) -> Self {
        Self { variable: [point], mean: Mean::Point(mean) }
    }

    /// e = vector - mean.
    pub fn vector(vector: VariableId, mean: &[f64]) -> Self {
        Self { variable: [vector], mean: Mean::Vector(mean.to_vec()) }
    }
}

impl Factor for Prior {
    fn variables(&self) -> &[VariableId] {
        &self.variable
    }

    fn dimension(&self) -> usize {
        match &self.mean {
            Mean::Pose(_) => 3,
            Mean::Point(_) => 2,
            Mean::Vector(mean) => mean.len(),
        }
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        let [variable] = self.variable;
        match &self.mean {
            Mean::Pose(mean) => {
                let (error, derivative) = pose_error(*mean, values.pose(variable)?);
                residual.copy_from_slice(error.as_slice());
                if let Some(jacobian) = jacobian {
                    jacobian.copy_from(&derivative);
                }
                return Ok(());
            }
            Mean::Point(mean) => residual.copy_from_slice((values.point(variable)? - mean).as_slice()),
            Mean::Vector(mean) => {
                let vector = values.vector(variable)?;
                if vector.len() != mean.len() {
                    return Err(GraphError::Length { wanted: mean.len(), found: vector.len() });
                }
                residual.iter_mut().zip(vector).zip(mean).for_each(|((error, value), mean)| *error = value - mean);
            }
        }
        if let Some(jacobian) = jacobian {
            jacobian.fill_with_identity();
        }
        Ok(())
    }
}

/// A pose seen from another one: e = log(measured⁻¹ · from⁻¹ · to), (forward, sideways \[m\], turn \[rad\]).
#[derive(Clone, Debug, PartialEq)]
pub struct Between {
    variables: [VariableId; 2],
    from_to: Pose,
}

impl Between {
    /// `from_to` is the measured pose of `to` in the frame of `from`.
    pub fn new(from: VariableId, to: VariableId, from_to: Pose) -> Self {
        Self { variables: [from, to], from_to }
    }
}

impl Factor for Between {
    fn variables(&self) -> &[VariableId] {
        &self.variables
    }

    fn dimension(&self) -> usize {
        3
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        let [from, to] = self.variables;
        let from_to = values.pose(to)?.seen_from(values.pose(from)?);
        let (error, derivative) = pose_error(self.from_to, from_to);
        residual.copy_from_slice(error.as_slice());
        if let Some(jacobian) = jacobian {
            // A step of `from` is a step of `to` backwards, carried to where `to` is.
            jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&(-derivative * from_to.inverse().adjoint()));
            jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&derivative);
        }
        Ok(())
    }
}

/// Odometry whose calibration is estimated with the path.
///
/// The measured motion is taken for an arc, driven at constant speed and turn: (u, v, w) = log(measured), forward and
/// sideways \[m\] and turn \[rad\]. The calibration is a vector of three numbers: forward scale s, turn scale t and
/// curvature k \[rad/m\]. The calibrated motion is
///
/// m = exp(s u, s v, t w + k u)
///
/// and the residual e = log(m⁻¹ · from⁻¹ · to), (forward, sideways \[m\], turn \[rad\]). With (1, 1, 0) it is that of
/// [`Between`].
#[derive(Clone, Debug, PartialEq)]
pub struct Odometry {
    variables: [VariableId; 3],
    twist: Vector3<f64>,
}

impl Odometry {
    /// The calibration of odometry that tells the truth.
    pub const CALIBRATED: [f64; 3] = [1.0, 1.0, 0.0];

    /// `from_to` is the pose of `to` in the frame of `from`, as odometry measured it.
    pub fn new(from: VariableId, to: VariableId, calibration: VariableId, from_to: Pose) -> Self {
        Self { variables: [from, to, calibration], twist: from_to.log() }
    }

    /// The calibrated twist (s u, s v, t w + k u) of a measured one, and its derivative by (s, t, k).
    pub fn calibrated(measured: Vector3<f64>, calibration: Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        let (scale, turn_scale, curvature) = (calibration.x, calibration.y, calibration.z);
        let twist =
            Vector3::new(scale * measured.x, scale * measured.y, turn_scale * measured.z + curvature * measured.x);
        (twist, Matrix3::new(measured.x, 0.0, 0.0, measured.y, 0.0, 0.0, 0.0, measured.z, measured.x))
    }
}

impl Factor for Odometry {
    fn variables(&self) -> &[VariableId] {
        &self.variables
    }

    fn dimension(&self) -> usize {
        3
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        let [from, to, calibration] = self.variables;
        let &[forward_scale, turn_scale, curvature] = values.vector(calibration)? else {
            return Err(GraphError::Length { wanted: 3, found: values.vector(calibration)?.len() });
        };
        let (twist, twist_by_calibration) =
            Self::calibrated(self.twist, Vector3::new(forward_scale, turn_scale, curvature));
        let from_to = values.pose(to)?.seen_from(values.pose(from)?);
        let calibrated = Pose::exp(twist);
        let (error, derivative) = pose_error(calibrated, from_to);
        residual.copy_from_slice(error.as_slice());
        if let Some(jacobian) = jacobian {
            jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&(-derivative * from_to.inverse().adjoint()));
            jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&derivative);
            // A step of the calibrated motion, carried to the end of the error.
            let by_twist = -derivative * calibrated.seen_from(from_to).adjoint() * Pose::exp_jacobian(twist);
            jacobian.fixed_view_mut::<3, 3>(0, 6).copy_from(&(by_twist * twist_by_calibration));
        }
        Ok(())
    }
}

/// A point in the frame of a sensor on a robot.
struct Seen {
    point: Vector2<f64>,
    /// Its derivative by the robot's step.
    by_pose: Matrix2x3<f64>,
    /// Its derivative by the point's step.
    by_point: Matrix2<f64>,
}

impl Seen {
    fn new(world_from_robot: Pose, point: Point2<f64>, robot_from_sensor: Pose) -> Self {
        let sensor_from_robot = robot_from_sensor.inverse();
        let in_robot = world_from_robot.inverse() * point;
        let rotation = |heading: f64| {
            let (sin, cos) = heading.sin_cos();
            Matrix2::new(cos, -sin, sin, cos)
        };
        let robot_moves = Matrix2x3::new(-1.0, 0.0, in_robot.y, 0.0, -1.0, -in_robot.x);
        Self {
            point: (sensor_from_robot * in_robot).coords,
            by_pose: rotation(sensor_from_robot.heading) * robot_moves,
            by_point: rotation(sensor_from_robot.heading - world_from_robot.heading),
        }
    }
}

/// A point as it would be seen: range \[m\] and bearing \[rad\], and the derivatives by a step of the pose (forward,
/// sideways, turn) and by the point's position. Where it stands in the sensor, they are not finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Range and bearing.
    pub mean: Vector2<f64>,
    /// By the pose's step.
    pub by_pose: Matrix2x3<f64>,
    /// By the point's position.
    pub by_point: Matrix2<f64>,
}

impl Prediction {
    /// Measured less predicted, the bearing wrapped.
    pub fn innovation(&self, range: f64, bearing: f64) -> Vector2<f64> {
        Vector2::new(range - self.mean.x, wrap_angle(bearing - self.mean.y))
    }
}

/// Range and bearing of a point: e = (|q| - range \[m\], arg q - bearing \[rad\], wrapped), with q the point in the
/// sensor's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct RangeBearing {
    variables: [VariableId; 2],
    range: f64,
    bearing: f64,
    robot_from_sensor: Pose,
}

impl RangeBearing {
    /// `range` \[m\] and `bearing` \[rad\], counter-clockwise from ahead, of `point` as seen from `pose`.
    pub fn new(pose: VariableId, point: VariableId, range: f64, bearing: f64) -> Self {
        Self { variables: [pose, point], range, bearing, robot_from_sensor: Pose::IDENTITY }
    }

    /// The same measurement, by a sensor that is mounted there.
    #[must_use]
    pub fn from_sensor(self, robot_from_sensor: Pose) -> Self {
        Self { robot_from_sensor, ..self }
    }

    /// What a sensor that is mounted there would measure of a point.
    pub fn predict(world_from_robot: Pose, point: Point2<f64>, robot_from_sensor: Pose) -> Prediction {
        let Seen { point, by_pose, by_point } = Seen::new(world_from_robot, point, robot_from_sensor);
        let range = point.norm();
        let (along, across) = (point / range, Vector2::new(-point.y, point.x) / (range * range));
        let polar = Matrix2::new(along.x, along.y, across.x, across.y);
        let mean = Vector2::new(range, point.y.atan2(point.x));
        Prediction { mean, by_pose: polar * by_pose, by_point: polar * by_point }
    }
}

impl Factor for RangeBearing {
    fn variables(&self) -> &[VariableId] {
        &self.variables
    }

    fn dimension(&self) -> usize {
        2
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        let [pose, point] = self.variables;
        let Prediction { mean, by_pose, by_point } =
            Self::predict(values.pose(pose)?, values.point(point)?, self.robot_from_sensor);
        residual.copy_from_slice(&[mean.x - self.range, wrap_angle(mean.y - self.bearing)]);
        if let Some(jacobian) = jacobian {
            jacobian.fixed_view_mut::<2, 3>(0, 0).copy_from(&by_pose);
            jacobian.fixed_view_mut::<2, 2>(0, 3).copy_from(&by_point);
        }
        Ok(())
    }
}

/// The place of a point: e = q - measured \[m\], with q the point in the sensor's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    variables: [VariableId; 2],
    measured: Point2<f64>,
    robot_from_sensor: Pose,
}

impl Sighting {
    /// `measured` is the place of `point` in the frame of `pose` \[m\].
    pub fn new(pose: VariableId, point: VariableId, measured: Point2<f64>) -> Self {
        Self { variables: [pose, point], measured, robot_from_sensor: Pose::IDENTITY }
    }

    /// The same measurement, by a sensor that is mounted there.
    #[must_use]
    pub fn from_sensor(self, robot_from_sensor: Pose) -> Self {
        Self { robot_from_sensor, ..self }
    }
}

impl Factor for Sighting {
    fn variables(&self) -> &[VariableId] {
        &self.variables
    }

    fn dimension(&self) -> usize {
        2
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        let [pose, point] = self.variables;
        let Seen { point, by_pose, by_point } =
            Seen::new(values.pose(pose)?, values.point(point)?, self.robot_from_sensor);
        residual.copy_from_slice((point - self.measured.coords).as_slice());
        if let Some(jacobian) = jacobian {
            jacobian.fixed_view_mut::<2, 3>(0, 0).copy_from(&by_pose);
            jacobian.fixed_view_mut::<2, 2>(0, 3).copy_from(&by_point);
        }
        Ok(())
    }
}
