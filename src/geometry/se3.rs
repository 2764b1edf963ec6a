//! Poses of space, SE(3).

use super::{Pose, StampedPose};
use nalgebra::{Matrix3, Matrix6, Point3, UnitQuaternion, Vector3, Vector6};
use std::ops::Mul;

/// A position and an orientation, or the rigid motion that they stand for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose3 {
    /// Metres.
    pub position: Point3<f64>,
    /// Takes directions of the inner frame to the outer one.
    pub rotation: UnitQuaternion<f64>,
}

impl Pose3 {
    /// A position \[m\] and an orientation.
    pub fn new(position: Point3<f64>, rotation: UnitQuaternion<f64>) -> Self {
        Self { position, rotation }
    }

    /// The motion that moves nothing.
    pub fn identity() -> Self {
        Self::new(Point3::origin(), UnitQuaternion::identity())
    }

    /// The motion backwards: `a_from_b.inverse()` is `b_from_a`.
    pub fn inverse(self) -> Self {
        let rotation = self.rotation.inverse();
        Self::new(-(rotation * self.position), rotation)
    }

    /// This pose seen from another one of the same frame: `from.inverse() * self`.
    pub fn seen_from(self, from: Self) -> Self {
        let back = from.rotation.inverse();
        Self::new((back * (self.position - from.position)).into(), back * self.rotation)
    }

    /// The adjoint of SE(3) for (translation, rotation): `a_from_b.adjoint()` takes a small motion in the frame b to the
    /// frame a.
    pub fn adjoint(self) -> Matrix6<f64> {
        let rotation = self.rotation.to_rotation_matrix().into_inner();
        blocks(rotation, self.position.coords.cross_matrix() * rotation)
    }

    /// Where a constant motion leads in one unit of time: the exponential of SE(3). The twist is translation \[m\] and
    /// rotation vector \[rad\]; the path is a screw.
    pub fn exp(twist: Vector6<f64>) -> Self {
        let (translation, rotation) = parts(twist);
        // The left Jacobian of a rotation is the right one of the rotation backwards.
        let position = rotation_jacobian(-rotation) * translation;
        Self::new(position.into(), UnitQuaternion::from_scaled_axis(rotation))
    }

    /// The constant motion that leads here, of the least rotation: `Pose3::exp(pose.log())` is `pose`.
    pub fn log(self) -> Vector6<f64> {
        let rotation = self.rotation.scaled_axis();
        let translation = rotation_log_jacobian(-rotation) * self.position.coords;
        let (t, r) = (translation, rotation);
        Vector6::new(t.x, t.y, t.z, r.x, r.y, r.z)
    }

    /// The right Jacobian J of the exponential: exp(twist + d) = exp(twist) · exp(J d) to first order in d.
    pub fn exp_jacobian(twist: Vector6<f64>) -> Matrix6<f64> {
        let (translation, rotation) = parts(twist);
        blocks(rotation_jacobian(rotation), coupling(-translation, -rotation))
    }

    /// J⁻¹ of [`Self::exp_jacobian`]: log(exp(twist) · exp(d)) = twist + J⁻¹ d to first order in d. The rotation is less
    /// than a full turn.
    pub fn log_jacobian(twist: Vector6<f64>) -> Matrix6<f64> {
        let (translation, rotation) = parts(twist);
        let inverse = rotation_log_jacobian(rotation);
        blocks(inverse, -inverse * coupling(-translation, -rotation) * inverse)
    }
}

impl Mul for Pose3 {
    type Output = Pose3;

    fn mul(self, other: Pose3) -> Pose3 {
        Pose3::new(self * other.position, self.rotation * other.rotation)
    }
}

impl Mul<Point3<f64>> for Pose3 {
    type Output = Point3<f64>;

    fn mul(self, point: Point3<f64>) -> Point3<f64> {
        self.rotation * point + self.position.coords
    }
}

/// The right Jacobian J of the exponential of SO(3): R(v + d) = R(v) · R(J d) to first order in d, for rotation vectors
/// \[rad\].
pub fn rotation_jacobian(rotation: Vector3<f64>) -> Matrix3<f64> {
    let [_, c2, c3, ..] = series(rotation.norm_squared());
    let cross = rotation.cross_matrix();
    Matrix3::identity() - c2 * cross + c3 * cross * cross
}

/// J⁻¹ of [`rotation_jacobian`], for rotations of less than a full turn.
pub fn rotation_log_jacobian(rotation: Vector3<f64>) -> Matrix3<f64> {
    let [_, c2, c3, c4, _] = series(rotation.norm_squared());
    let cross = rotation.cross_matrix();
    Matrix3::identity() + 0.5 * cross + (c3 - 2.0 * c4) / (2.0 * c2) * cross * cross
}

/// The upper right block of the left Jacobian of SE(3) (T. Barfoot, "State Estimation for Robotics", 2017, eq. 7.86).
fn coupling(translation: Vector3<f64>, rotation: Vector3<f64>) -> Matrix3<f64> {
    let [_, _, c3, c4, c5] = series(rotation.norm_squared());
    let (t, r) = (translation.cross_matrix(), rotation.cross_matrix());
    let (rt, tr) = (r * t, t * r);
    let rtr = rt * r;
    0.5 * t + c3 * (rt + tr + rtr) + c4 * (r * rt + tr * r - 3.0 * rtr) + 0.5 * (c4 - 3.0 * c5) * (rtr * r + r * rtr)
}

/// Of an angle θ, by its square: sin θ / θ, and in turn the same series without its first terms,
/// cₙ = Σₖ (-θ²)ᵏ / (2k + n)! for n = 1 to 5, so that cₙ₊₂ = (1/n! - cₙ) / θ².
fn series(squared: f64) -> [f64; 5] {
    if squared < 1.0 {
        // Each term of a series is the one before, divided by -(2k + n)(2k + n - 1) and times θ².
        let sum = |ratios: [f64; 6]| ratios.into_iter().rev().fold(1.0, |rest, ratio| 1.0 - squared / ratio * rest);
        let c4 = sum([30.0, 56.0, 90.0, 132.0, 182.0, 240.0]) / 24.0;
        let c5 = sum([42.0, 72.0, 110.0, 156.0, 210.0, 272.0]) / 120.0;
        let (c2, c3) = (0.5 - squared * c4, 1.0 / 6.0 - squared * c5);
        return [1.0 - squared * c3, c2, c3, c4, c5];
    }
    let angle = squared.sqrt();
    let c1 = angle.sin() / angle;
    let (c2, c3) = ((1.0 - angle.cos()) / squared, (1.0 - c1) / squared);
    [c1, c2, c3, (0.5 - c2) / squared, (1.0 / 6.0 - c3) / squared]
}

fn parts(twist: Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (Vector3::new(twist[0], twist[1], twist[2]), Vector3::new(twist[3], twist[4], twist[5]))
}

/// [diagonal corner; 0 diagonal]
fn blocks(diagonal: Matrix3<f64>, corner: Matrix3<f64>) -> Matrix6<f64> {
    let mut matrix = Matrix6::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&diagonal);
    matrix.fixed_view_mut::<3, 3>(0, 3).copy_from(&corner);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&diagonal);
    matrix
}

/// A pose at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StampedPose3 {
    /// Seconds; the clock is that of the log.
    pub stamp: f64,
    /// The pose, in the frame that the owner of the list names.
    pub pose: Pose3,
}

impl StampedPose3 {
    /// The pose as it is seen from above, along the axis z.
    pub fn from_above(&self) -> StampedPose {
        let Pose3 { position, rotation } = self.pose;
        StampedPose { stamp: self.stamp, pose: Pose::new(position.x, position.y, rotation.euler_angles().2) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix4;
    use proptest::prelude::*;

    /// The oracle: homogeneous matrices.
    fn matrix(pose: Pose3) -> Matrix4<f64> {
        let mut matrix = pose.rotation.to_homogeneous();
        matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&pose.position.coords);
        matrix
    }

    fn twists() -> impl Strategy<Value = Vector6<f64>> {
        // Rotations of any size from none to nearly half a turn.
        let direction =
            prop::array::uniform3(-1.0..1.0f64).prop_map(|axis| Vector3::from(axis) + Vector3::repeat(1e-3));
        (prop::array::uniform3(-5.0..5.0f64), direction, 0.0..3.1f64, -8.0..0.0f64).prop_map(
            |(t, axis, angle, size)| {
                let rotation = axis.normalize() * angle * 10f64.powf(size.min(-4.0) + 4.0);
                Vector6::new(t[0], t[1], t[2], rotation.x, rotation.y, rotation.z)
            },
        )
    }

    proptest! {
        #[test]
        fn product_and_inverse_are_those_of_matrices(a in twists(), b in twists()) {
            let (a, b) = (Pose3::exp(a), Pose3::exp(b));
            prop_assert!((matrix(a * b) - matrix(a) * matrix(b)).norm() < 1e-12);
            prop_assert!((matrix(a * b) - matrix(b) * matrix(a)).norm() > 1e-12);
            prop_assert!((matrix(a.inverse()) * matrix(a) - Matrix4::identity()).norm() < 1e-12);
            prop_assert!((matrix(a * b.seen_from(a)) - matrix(b)).norm() < 1e-12);
        }

        /// The oracle: the exponential of a matrix.
        #[test]
        fn the_exponential_is_that_of_a_matrix(twist in twists()) {
            let (translation, rotation) = parts(twist);
            let mut generator = rotation.cross_matrix().to_homogeneous();
            generator[(3, 3)] = 0.0;
            generator.fixed_view_mut::<3, 1>(0, 3).copy_from(&translation);
            prop_assert!((generator.exp() - matrix(Pose3::exp(twist))).norm() < 1e-11);
            prop_assert!((Pose3::exp(twist).log() - twist).norm() < 1e-11);
        }

        /// The oracle: central differences.
        #[test]
        fn the_jacobians_are_derivatives(twist in twists()) {
            let jacobian = Pose3::exp_jacobian(twist);
            for axis in 0..6 {
                let step = Vector6::ith(axis, 1e-5);
                let from = Pose3::exp(twist);
                let change =
                    Pose3::exp(twist + step).seen_from(from).log() - Pose3::exp(twist - step).seen_from(from).log();
                let error = (jacobian.column(axis) - change / 2e-5).norm();
                prop_assert!(error < 1e-8, "axis {}: {}", axis, error);
            }
            let product = Pose3::log_jacobian(twist) * jacobian - Matrix6::identity();
            prop_assert!(product.amax() < 1e-11, "{}", product);
        }

        /// The oracle: a motion of one frame is one of the other, A exp(d) = exp(Ad(A) d) A.
        #[test]
        fn the_adjoint_carries_motions(a in twists(), d in twists()) {
            let a = Pose3::exp(a);
            prop_assert!((matrix(a * Pose3::exp(d)) - matrix(Pose3::exp(a.adjoint() * d) * a)).norm() < 1e-9);
        }
    }
}
