//! Semantic term (eq. 7): an object, seen by a sensor in space.

use super::{Factor, Jacobian, Prediction};
use crate::factor_graph::{GraphError, Values, VariableId};
use crate::geometry::{Pinhole, Pose3};
use nalgebra::{Matrix3, Matrix3x6, Point3, RowVector3, Vector3};

/// A point in the frame of a sensor on a robot.
struct Seen {
    point: Vector3<f64>,
    /// Its derivative by the robot's step.
    by_pose: Matrix3x6<f64>,
    /// Its derivative by the point's step.
    by_point: Matrix3<f64>,
}

impl Seen {
    fn new(world_from_robot: Pose3, point: Point3<f64>, robot_from_sensor: Pose3) -> Self {
        let in_robot = world_from_robot.inverse() * point;
        let back = robot_from_sensor.rotation.inverse().to_rotation_matrix().into_inner();
        let mut by_pose = Matrix3x6::zeros();
        by_pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&-back);
        by_pose.fixed_view_mut::<3, 3>(0, 3).copy_from(&(back * in_robot.coords.cross_matrix()));
        let by_point = back * world_from_robot.rotation.inverse().to_rotation_matrix().into_inner();
        Self { point: back * (in_robot - robot_from_sensor.position), by_pose, by_point }
    }
}

/// A camera that also measures the depth of a point: with two cameras, or because the size of the object is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StereoCamera {
    /// The camera; of two the left one.
    pub pinhole: Pinhole,
    /// The distance b of two cameras \[m\], or the height of what is seen.
    pub baseline: f64,
    /// How far what is seen reaches from its middle towards the camera, r \[m\]; 0 of a point. The upper and the lower edge of a
    /// box are those of the side that is near.
    pub reach: f64,
    /// Where it is mounted.
    pub robot_from_camera: Pose3,
}

impl StereoCamera {
    /// Of a point q = (x, y, z) of the camera's frame (fᵤ x/z + cᵤ, fᵥ y/(z - r) + cᵥ, fᵤ b/(z - r)), pixel and disparity; none
    /// where it is not ahead.
    pub fn predict(&self, world_from_robot: Pose3, point: Point3<f64>) -> Option<Prediction<6, 3>> {
        let Seen { point, by_pose, by_point } = Seen::new(world_from_robot, point, self.robot_from_camera);
        let (middle, middle_by_seen) = self.pinhole.project(point)?;
        let near = point - Vector3::new(0.0, 0.0, self.reach);
        let (side, side_by_seen) = self.pinhole.project(near)?;
        let disparity = self.pinhole.focal[0] * self.baseline / near.z;
        let by_depth = RowVector3::new(0.0, 0.0, -disparity / near.z);
        let by_seen = Matrix3::from_rows(&[middle_by_seen.row(0).into(), side_by_seen.row(1).into(), by_depth]);
        let mean = Vector3::new(middle.x, side.y, disparity);
        Some(Prediction { mean, by_pose: by_seen * by_pose, by_point: by_seen * by_point })
    }
}

/// What a point is off that is not ahead of the camera \[pixels\]: far outside of every picture.
const BEHIND: f64 = 1e4;

/// A point seen by a [`StereoCamera`]: e = predicted - measured, pixel and disparity. Where it is not ahead of the camera, it is an
/// outlier that nothing pulls.
#[derive(Clone, Debug, PartialEq)]
pub struct Stereo {
    variables: [VariableId; 2],
    measured: Vector3<f64>,
    camera: StereoCamera,
}

impl Stereo {
    /// `measured` is u, v and disparity \[pixels\] of `point` as seen from `pose`.
    pub fn new(pose: VariableId, point: VariableId, measured: Vector3<f64>, camera: StereoCamera) -> Self {
        Self { variables: [pose, point], measured, camera }
    }
}

impl Factor for Stereo {
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
        let [pose, point] = self.variables;
        let Some(Prediction { mean, by_pose, by_point }) =
            self.camera.predict(values.pose3(pose)?, values.point3(point)?)
        else {
            residual.fill(BEHIND);
            return Ok(());
        };
        residual.copy_from_slice((mean - self.measured).as_slice());
        if let Some(jacobian) = jacobian {
            jacobian.fixed_view_mut::<3, 6>(0, 0).copy_from(&by_pose);
            jacobian.fixed_view_mut::<3, 3>(0, 6).copy_from(&by_point);
        }
        Ok(())
    }
}
