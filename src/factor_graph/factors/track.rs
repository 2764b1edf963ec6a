//! Geometric term (eq. 8), without its landmark.

use super::{Factor, Jacobian};
use crate::factor_graph::{GraphError, Values, VariableId};
use crate::geometry::{Pinhole, Pose3};
use nalgebra::{DVector, Matrix2x3, Matrix3, MatrixXx3, Point2, Vector3, Vector4};

/// A feature that a camera followed over several poses, whose place in the world nobody asks for.
///
/// The residual is that of all views, e = π(qᵢ(l)) - measured \[pixels\], at the place l where ½ ‖e‖² is least for the
/// poses at hand. The slope of that least value by the poses is eᵀ Jₓ, the landmark's share being zero there; and to
/// first order the residual moves by
///
/// (I - J (JᵀJ)⁻¹ Jᵀ) Jₓ
///
/// with J and Jₓ its derivatives by the landmark and the poses: what no step of the landmark can undo. So the normal equations
/// are those of a graph with the landmark in it, after its elimination (Schur complement).
///
/// The landmark is held as direction and inverse distance as seen from the first pose, so that it may be far away, and poses
/// without a baseline still tell their rotation.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    poses: Vec<VariableId>,
    measured: Vec<Point2<f64>>,
    camera: Pinhole,
    robot_from_camera: Pose3,
}

/// A point as seen from some pose: its place is `direction` / `inverse_distance`.
#[derive(Clone, Copy)]
struct Landmark {
    direction: Vector3<f64>,
    inverse_distance: f64,
}

impl Track {
    /// The pixels where the feature was seen from these poses.
    pub fn new(
        views: impl IntoIterator<Item = (VariableId, Point2<f64>)>,
        camera: Pinhole,
        robot_from_camera: Pose3,
    ) -> Self {
        let (poses, measured) = views.into_iter().unzip();
        Self { poses, measured, camera, robot_from_camera }
    }

    /// The place of the feature as seen from its first camera: (x, y, z, w), which stands for (x, y, z) / w \[m\]; none
    /// where no place is ahead of all cameras.
    ///
    /// # Errors
    /// A variable is no pose of space.
    pub fn triangulate(&self, values: &Values) -> Result<Option<Vector4<f64>>, GraphError> {
        let found = self.fit(&self.cameras(values)?);
        Ok(found.map(|(Landmark { direction: d, inverse_distance }, ..)| Vector4::new(d.x, d.y, d.z, inverse_distance)))
    }

    /// All cameras, seen from the first one.
    fn cameras(&self, values: &Values) -> Result<Vec<Pose3>, GraphError> {
        let mut cameras = Vec::with_capacity(self.poses.len());
        for pose in &self.poses {
            cameras.push(values.pose3(*pose)? * self.robot_from_camera);
        }
        let first = cameras.first().copied().unwrap_or(Pose3::identity());
        Ok(cameras.into_iter().map(|camera| camera.seen_from(first)).collect())
    }

    /// The residual of all views, and its derivative by the landmark.
    fn look(&self, cameras: &[Pose3], landmark: Landmark) -> Option<(DVector<f64>, MatrixXx3<f64>)> {
        let mut residual = DVector::zeros(2 * cameras.len());
        let mut by_landmark = MatrixXx3::zeros(2 * cameras.len());
        for (view, (camera, measured)) in cameras.iter().zip(&self.measured).enumerate() {
            let (pixel, by_seen) = self.camera.project(landmark.seen_from(camera))?;
            residual.fixed_rows_mut::<2>(2 * view).copy_from(&(pixel - measured));
            by_landmark.fixed_rows_mut::<2>(2 * view).copy_from(&(by_seen * landmark.derivative(camera)));
        }
        Some((residual, by_landmark))
    }

    /// The landmark that fits the views best, its residual, and the derivative by it.
    fn fit(&self, cameras: &[Pose3]) -> Option<(Landmark, DVector<f64>, MatrixXx3<f64>)> {
        const STEPS: usize = 30;
        let mut landmark = self.guess(cameras);
        let (mut residual, mut by_landmark) = match self.look(cameras, landmark) {
            Some(looked) => looked,
            None => {
                landmark.inverse_distance = 0.0;
                self.look(cameras, landmark)?
            }
        };
        let mut lambda = 0.0;
        for _ in 0..STEPS {
            let mut hessian = by_landmark.tr_mul(&by_landmark);
            // A landmark without a baseline has no distance: none of its columns may be zero.
            let floor = 1e-16 * hessian.trace();
            (0..3).for_each(|axis| hessian[(axis, axis)] += lambda * hessian[(axis, axis)] + floor);
            let slope = by_landmark.tr_mul(&residual);
            let step = hessian.cholesky().map_or(Vector3::zeros(), |cholesky| -cholesky.solve(&slope));
            let next = landmark.moved(step);
            let promise = -slope.dot(&step);
            if promise <= 1e-20 * residual.norm_squared() || promise < 1e-24 {
                break;
            }
            match self.look(cameras, next) {
                Some((error, derivative)) if error.norm_squared() <= residual.norm_squared() => {
                    (landmark, residual, by_landmark) = (next, error, derivative);
                    lambda *= 0.1;
                }
                _ => lambda = (10.0 * lambda).max(1e-3),
            }
        }
        Some((landmark, residual, by_landmark))
    }

    /// On the first view's ray, where the others' rays come nearest to it.
    fn guess(&self, cameras: &[Pose3]) -> Landmark {
        let direction = self.measured.first().map_or(Vector3::z(), |pixel| self.camera.ray(*pixel).coords);
        let (mut along, mut squared) = (0.0, 0.0);
        for (camera, measured) in cameras.iter().zip(&self.measured).skip(1) {
            // In the camera's picture, (a + w b) = 0 but for noise.
            let ray = self.camera.ray(*measured);
            let back = camera.rotation.inverse();
            let (turned, moved) = (back * direction, -(back * camera.position.coords));
            for axis in 0..2 {
                let a = turned[axis] - ray[axis] * turned.z;
                let b = moved[axis] - ray[axis] * moved.z;
                along -= a * b;
                squared += b * b;
            }
        }
        Landmark { direction, inverse_distance: if squared > 1e-12 { along / squared } else { 0.0 } }
    }
}

impl Landmark {
    /// Its place in another camera's frame, times the inverse distance.
    fn seen_from(&self, camera: &Pose3) -> Vector3<f64> {
        camera.rotation.inverse() * (self.direction - self.inverse_distance * camera.position.coords)
    }

    /// The derivative of that by x, y and inverse distance.
    fn derivative(&self, camera: &Pose3) -> Matrix3<f64> {
        let back = camera.rotation.inverse().to_rotation_matrix().into_inner();
        Matrix3::from_columns(&[back.column(0).into(), back.column(1).into(), -back * camera.position.coords])
    }

    fn moved(self, step: Vector3<f64>) -> Self {
        let direction = self.direction + Vector3::new(step.x, step.y, 0.0);
        Self { direction, inverse_distance: self.inverse_distance + step.z }
    }
}

/// An orthonormal basis of the columns; a column that depends on the others is left out, as zero.
fn orthonormal(mut columns: MatrixXx3<f64>) -> MatrixXx3<f64> {
    for place in 0..3 {
        let before = columns.column(place).norm();
        // Twice is enough: W. Kahan's rule.
        for _ in 0..2 {
            for other in 0..place {
                let share = columns.column(other).dot(&columns.column(place));
                let other = columns.column(other).into_owned();
                columns.column_mut(place).axpy(-share, &other, 1.0);
            }
        }
        let norm = columns.column(place).norm();
        let scale = if norm > 1e-8 * before { norm.recip() } else { 0.0 };
        columns.column_mut(place).scale_mut(scale);
    }
    columns
}

impl Factor for Track {
    fn variables(&self) -> &[VariableId] {
        &self.poses
    }

    fn dimension(&self) -> usize {
        2 * self.poses.len()
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        let cameras = self.cameras(values)?;
        let Some((landmark, error, by_landmark)) = self.fit(&cameras) else {
            residual.fill(f64::NAN);
            return Ok(());
        };
        residual.copy_from_slice(error.as_slice());
        let Some(jacobian) = jacobian else { return Ok(()) };

        let back = self.robot_from_camera.rotation.inverse().to_rotation_matrix().into_inner();
        let basis = orthonormal(by_landmark);
        for (view, camera) in cameras.iter().enumerate() {
            let seen = landmark.seen_from(camera);
            let by_seen = self.camera.project(seen).map_or(Matrix2x3::zeros(), |(_, by_seen)| by_seen);
            // A step of the robot moves the landmark in its frame, and so in the camera's.
            let in_robot = self.robot_from_camera.rotation * seen
                + landmark.inverse_distance * self.robot_from_camera.position.coords;
            let by_translation = by_seen * back * -landmark.inverse_distance;
            let by_rotation = by_seen * back * in_robot.cross_matrix();
            let at = basis.fixed_rows::<2>(2 * view);
            for (first, block) in [(0, by_translation), (3, by_rotation)] {
                let mut columns = jacobian.fixed_columns_mut::<3>(6 * view + first);
                columns.copy_from(&(&basis * (at.transpose() * -block)));
                let mut own = columns.fixed_rows_mut::<2>(2 * view);
                own += block;
            }
        }
        Ok(())
    }
}
