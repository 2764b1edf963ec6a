//! Geometric term (eq. 8), without its landmark.

use super::{Factor, Jacobian};
use crate::factor_graph::{GraphError, Values, VariableId};
use crate::geometry::{Pinhole, Pose3};
use nalgebra::{DVector, Matrix3, MatrixXx3, Point2, Vector3, Vector4};

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
/// The landmark is held as direction and inverse distance as seen from one of the poses, so that it may be far away, and
/// poses without a baseline still determine their rotation.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    poses: Vec<VariableId>,
    measured: Vec<Point2<f64>>,
    camera: Pinhole,
    robot_from_camera: Pose3,
    /// Of Cauchy's loss \[pixels\].
    loss_scale: f64,
}

impl Track {
    /// The pixels where the feature was seen from these poses.
    pub fn new(
        views: impl IntoIterator<Item = (VariableId, Point2<f64>)>,
        camera: Pinhole,
        robot_from_camera: Pose3,
    ) -> Self {
        let (poses, measured) = views.into_iter().unzip();
        Self { poses, measured, camera, robot_from_camera, loss_scale: f64::INFINITY }
    }

    /// The same with Cauchy's loss for each view, ½ c² log(1 + d²/c²) of its distance d, by this scale c \[pixels\]: a
    /// track may show another point for a while. The loss of the whole term stays a square.
    #[must_use]
    pub fn with_loss(self, scale: f64) -> Self {
        Self { loss_scale: scale, ..self }
    }

    /// The place of the feature in the world: (x, y, z, w), which stands for (x, y, z) / w \[m\]; none where no place is
    /// ahead of all cameras.
    ///
    /// # Errors
    /// A variable is no pose of space.
    pub fn triangulate(&self, values: &Values) -> Result<Option<Vector4<f64>>, GraphError> {
        let cameras = self.cameras(values)?;
        let in_world = |Fit { anchor, landmark: Landmark { direction, inverse_distance }, .. }: Fit| {
            let at = cameras[anchor].rotation * direction + inverse_distance * cameras[anchor].position.coords;
            at.push(inverse_distance)
        };
        Ok(self.fit(&cameras).map(in_world))
    }

    /// `world_from_camera` of all views.
    fn cameras(&self, values: &Values) -> Result<Vec<Pose3>, GraphError> {
        let camera = |pose: &VariableId| Ok(values.pose3(*pose)? * self.robot_from_camera);
        self.poses.iter().map(camera).collect()
    }

    /// The landmark that fits the views best.
    fn fit(&self, cameras: &[Pose3]) -> Option<Fit> {
        // Any view may be wrong: as seen from where they agree most.
        let last = cameras.len().checked_sub(1)?;
        let mut best: Option<Fit> = None;
        let mut anchors = vec![0, last / 2, last];
        anchors.dedup();
        for anchor in anchors {
            let seen: Vec<Pose3> = cameras.iter().map(|camera| camera.seen_from(cameras[anchor])).collect();
            let guess = self.guess(anchor, &seen);
            let far = Landmark { inverse_distance: 0.0, ..guess };
            let Some(views) = self.look(&seen, guess).or_else(|| self.look(&seen, far)) else { continue };
            if best.as_ref().is_none_or(|best| views.cost() < best.views.cost()) {
                best = Some(Fit { anchor, cameras: seen, landmark: views.landmark, views });
            }
        }
        let mut fit = best?;
        self.refine(&mut fit);
        Some(fit)
    }

    /// On one view's ray, where the others' rays come nearest to it.
    fn guess(&self, anchor: usize, cameras: &[Pose3]) -> Landmark {
        let direction = self.camera.ray(self.measured[anchor]).coords;
        // In a camera's picture, turned + w moved = 0 but for noise, in both directions.
        let mut lines = Vec::with_capacity(2 * cameras.len());
        for (camera, measured) in cameras.iter().zip(&self.measured) {
            let ray = self.camera.ray(*measured);
            let back = camera.rotation.inverse();
            let (turned, moved) = (back * direction, -(back * camera.position.coords));
            lines.extend([0, 1].map(|axis| (turned[axis] - ray[axis] * turned.z, moved[axis] - ray[axis] * moved.z)));
        }
        let squared: f64 = lines.iter().map(|(_, moved)| moved * moved).sum();
        let along: f64 = lines.iter().map(|(turned, moved)| turned * moved).sum();
        Landmark { direction, inverse_distance: if squared > 1e-12 { -along / squared } else { 0.0 } }
    }

    /// All views of a landmark; none where it is not ahead of all cameras.
    fn look(&self, cameras: &[Pose3], landmark: Landmark) -> Option<Views> {
        let rows = 2 * cameras.len();
        let mut views = Views { landmark, residual: DVector::zeros(rows), by_landmark: MatrixXx3::zeros(rows) };
        for (view, (camera, measured)) in cameras.iter().zip(&self.measured).enumerate() {
            let (pixel, by_seen) = self.camera.project(landmark.seen_from(camera))?;
            let error = pixel - measured;
            let (scale, slope) = self.robust(error.norm_squared());
            views.residual.fixed_rows_mut::<2>(2 * view).copy_from(&(scale * error));
            let by_landmark = slope * by_seen * landmark.derivative(camera);
            views.by_landmark.fixed_rows_mut::<2>(2 * view).copy_from(&by_landmark);
        }
        Some(views)
    }

    /// What an error of squared norm d² is multiplied by, to have the loss as its square; and its derivative, so that
    /// the product of both has the loss's slope.
    fn robust(&self, squared: f64) -> (f64, f64) {
        let ratio = squared / (self.loss_scale * self.loss_scale);
        let scale = if ratio > 1e-9 { (ratio.ln_1p() / ratio).sqrt() } else { 1.0 };
        (scale, 1.0 / ((1.0 + ratio) * scale))
    }

    /// Steps of Levenberg and Marquardt, until rounding ends them.
    fn refine(&self, fit: &mut Fit) {
        const STEPS: usize = 50;
        let mut lambda = 0.0;
        for _ in 0..STEPS {
            let Views { residual, by_landmark, .. } = &fit.views;
            let mut hessian = by_landmark.tr_mul(by_landmark);
            // Without a baseline the distance has a column of zeros.
            let floor = 1e-16 * hessian.trace();
            (0..3).for_each(|axis| hessian[(axis, axis)] += lambda * hessian[(axis, axis)] + floor);
            let slope = by_landmark.tr_mul(residual);
            let step = hessian.cholesky().map_or(Vector3::zeros(), |cholesky| -cholesky.solve(&slope));
            if -slope.dot(&step) <= 1e-20 * fit.views.cost() {
                break;
            }
            match self.look(&fit.cameras, fit.landmark.moved(step)) {
                Some(views) if views.cost() <= fit.views.cost() => {
                    (fit.landmark, fit.views) = (views.landmark, views);
                    lambda *= 0.1;
                }
                _ => lambda = (10.0 * lambda).max(1e-3),
            }
        }
    }
}

/// A landmark, and how the cameras see it.
struct Fit {
    /// The view that it is seen from.
    anchor: usize,
    /// All cameras as seen from there.
    cameras: Vec<Pose3>,
    landmark: Landmark,
    views: Views,
}

/// The residual of all views, and its derivative by the landmark.
struct Views {
    landmark: Landmark,
    residual: DVector<f64>,
    by_landmark: MatrixXx3<f64>,
}

impl Views {
    fn cost(&self) -> f64 {
        self.residual.norm_squared()
    }
}

/// A point as seen from some pose: its place is `direction` / `inverse_distance`.
#[derive(Clone, Copy)]
struct Landmark {
    direction: Vector3<f64>,
    inverse_distance: f64,
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
        let Some(Fit { cameras, landmark, views, .. }) = self.fit(&self.cameras(values)?) else {
            residual.fill(f64::NAN);
            return Ok(());
        };
        residual.copy_from_slice(views.residual.as_slice());
        let Some(jacobian) = jacobian else { return Ok(()) };

        let back = self.robot_from_camera.rotation.inverse().to_rotation_matrix().into_inner();
        let basis = orthonormal(views.by_landmark);
        for (view, camera) in cameras.iter().enumerate() {
            let seen = landmark.seen_from(camera);
            let Some((pixel, by_seen)) = self.camera.project(seen) else { continue };
            let by_seen = self.robust((pixel - self.measured[view]).norm_squared()).1 * by_seen;
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
