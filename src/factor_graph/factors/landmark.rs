//! A landmark of the plane, seen from a robot.

use super::{Factor, Jacobian};
use crate::factor_graph::{GraphError, Values, VariableId};
use crate::geometry::{Pose, wrap_angle};
use nalgebra::{Matrix2, Matrix2x3, Point2, SMatrix, SVector, Vector2};

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

/// A point as it would be seen, and the derivatives by a step of the pose, of P numbers, and by the point's position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction<const P: usize, const D: usize> {
    /// What would be measured: as many numbers as the point has.
    pub mean: SVector<f64, D>,
    /// By the pose's step.
    pub by_pose: SMatrix<f64, D, P>,
    /// By the point's position.
    pub by_point: SMatrix<f64, D, D>,
}

impl Prediction<3, 2> {
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

    /// What a sensor that is mounted there would measure of a point. Where it stands in the sensor, it is not finite.
    pub fn predict(world_from_robot: Pose, point: Point2<f64>, robot_from_sensor: Pose) -> Prediction<3, 2> {
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
