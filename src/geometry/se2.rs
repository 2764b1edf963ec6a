//! Poses of the plane, SE(2).

use nalgebra::{Matrix3, Point2, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use std::ops::Mul;

/// A position and a heading, or the rigid motion that they stand for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Metres.
    pub x: f64,
    /// Metres.
    pub y: f64,
    /// Radians, counter-clockwise from the x axis, in (-π, π].
    pub heading: f64,
}

impl Pose {
    /// The motion that moves nothing.
    pub const IDENTITY: Self = Self { x: 0.0, y: 0.0, heading: 0.0 };

    /// A pose; the heading may be any angle and is wrapped.
    pub fn new(x: f64, y: f64, heading: f64) -> Self {
        Self { x, y, heading: wrap_angle(heading) }
    }

    /// The motion backwards: `a_from_b.inverse()` is `b_from_a`.
    pub fn inverse(self) -> Self {
        let (sin, cos) = self.heading.sin_cos();
        Self::new(-cos * self.x - sin * self.y, sin * self.x - cos * self.y, -self.heading)
    }

    /// This pose seen from another one of the same frame: `from.inverse() * self`.
    pub fn seen_from(self, from: Self) -> Self {
        from.inverse() * self
    }

    /// The adjoint of SE(2) for (forward, sideways, heading): `a_from_b.adjoint()` takes a small motion in the frame b to the
    /// frame a.
    pub fn adjoint(self) -> Matrix3<f64> {
        let (sin, cos) = self.heading.sin_cos();
        Matrix3::new(cos, -sin, self.y, sin, cos, -self.x, 0.0, 0.0, 1.0)
    }

    /// Where a constant motion leads in one unit of time: the exponential of SE(2). The twist is (forward, sideways \[m\],
    /// turn \[rad\]); with a turn the path is an arc of a circle.
    pub fn exp(twist: Vector3<f64>) -> Self {
        let [sine, cosine, _] = arc_terms(twist.z);
        Self::new(sine * twist.x - cosine * twist.y, cosine * twist.x + sine * twist.y, twist.z)
    }

    /// The constant motion that leads here, of the least turn: `Pose::exp(pose.log()) == pose`.
    pub fn log(self) -> Vector3<f64> {
        let [sine, cosine, _] = arc_terms(self.heading);
        let squared = sine * sine + cosine * cosine;
        Vector3::new(
            (sine * self.x + cosine * self.y) / squared,
            (sine * self.y - cosine * self.x) / squared,
            self.heading,
        )
    }

    /// The right Jacobian J of the exponential: exp(twist + d) = exp(twist) · exp(J d) to first order in d.
    pub fn exp_jacobian(twist: Vector3<f64>) -> Matrix3<f64> {
        let [sine, cosine, rest] = arc_terms(twist.z);
        // (1 - cos t) / t², the quotient of two terms whose limits are zero.
        let bend = 0.5 * (sine_quotient(0.5 * twist.z)).powi(2);
        Matrix3::new(
            sine,
            cosine,
            rest * twist.x - bend * twist.y,
            -cosine,
            sine,
            bend * twist.x + rest * twist.y,
            0.0,
            0.0,
            1.0,
        )
    }

    /// The pose on an even way to another one, after a share of it, 0 to 1; the heading takes the short way round.
    pub fn interpolated(self, to: Self, share: f64) -> Self {
        let position = self.position() + share * (to.position() - self.position());
        Self::new(position.x, position.y, self.heading + share * wrap_angle(to.heading - self.heading))
    }

    /// The position, without the heading.
    pub fn position(self) -> Point2<f64> {
        Point2::new(self.x, self.y)
    }

    /// The unit vector along the heading.
    pub fn direction(self) -> Vector2<f64> {
        Vector2::new(self.heading.cos(), self.heading.sin())
    }

    /// Whether all three numbers are finite.
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.heading.is_finite()
    }
}

impl Mul for Pose {
    type Output = Pose;

    fn mul(self, other: Pose) -> Pose {
        let moved = self * other.position();
        Pose::new(moved.x, moved.y, self.heading + other.heading)
    }
}

impl Mul<Point2<f64>> for Pose {
    type Output = Point2<f64>;

    fn mul(self, point: Point2<f64>) -> Point2<f64> {
        let (sin, cos) = self.heading.sin_cos();
        Point2::new(self.x + cos * point.x - sin * point.y, self.y + sin * point.x + cos * point.y)
    }
}

impl Mul<Vector2<f64>> for Pose {
    type Output = Vector2<f64>;

    fn mul(self, vector: Vector2<f64>) -> Vector2<f64> {
        let (sin, cos) = self.heading.sin_cos();
        Vector2::new(cos * vector.x - sin * vector.y, sin * vector.x + cos * vector.y)
    }
}

/// The same angle in (-π, π]. Angles that are not finite come back as they are.
pub fn wrap_angle(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    if angle > -PI && angle <= PI {
        return angle;
    }
    let wrapped = angle - TAU * (angle / TAU).round();
    if wrapped <= -PI { wrapped + TAU } else { wrapped }
}

/// sin t / t.
fn sine_quotient(t: f64) -> f64 {
    if t.abs() < 1e-3 { 1.0 - t * t / 6.0 } else { t.sin() / t }
}

/// sin t / t, (1 - cos t) / t and (t - sin t) / t², accurate around zero as well.
fn arc_terms(t: f64) -> [f64; 3] {
    let half = sine_quotient(0.5 * t);
    let rest = if t.abs() < 1e-3 { t / 6.0 } else { (t - t.sin()) / (t * t) };
    [sine_quotient(t), 0.5 * t * half * half, rest]
}

/// A pose at a time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StampedPose {
    /// Seconds; the clock is that of the log.
    pub stamp: f64,
    /// The pose, in the frame that the owner of the list names.
    pub pose: Pose,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The oracle: homogeneous matrices.
    fn matrix(pose: Pose) -> Matrix3<f64> {
        let (s, c) = pose.heading.sin_cos();
        Matrix3::new(c, -s, pose.x, s, c, pose.y, 0.0, 0.0, 1.0)
    }

    fn poses() -> impl Strategy<Value = Pose> {
        (-1e4..1e4, -1e4..1e4, -10.0..10.0).prop_map(|(x, y, heading)| Pose::new(x, y, heading))
    }

    proptest! {
        #[test]
        fn product_is_the_product_of_matrices(a in poses(), b in poses()) {
            prop_assert!((matrix(a * b) - matrix(a) * matrix(b)).norm() < 1e-9);
            prop_assert!((matrix(a * b) - matrix(b) * matrix(a)).norm() > 1e-9 || matrix(a) == matrix(b));
        }

        #[test]
        fn inverse_undoes(a in poses(), b in poses()) {
            prop_assert!((matrix(a.inverse()) * matrix(a) - Matrix3::identity()).norm() < 1e-8);
            prop_assert!((matrix(a * b.seen_from(a)) - matrix(b)).norm() < 1e-8);
        }

        #[test]
        fn the_logarithm_undoes_the_exponential(pose in poses()) {
            prop_assert!((matrix(Pose::exp(pose.log())) - matrix(pose)).norm() < 1e-7);
        }

        /// The oracle: many short steps of the same motion.
        #[test]
        fn the_exponential_follows_an_arc(forward in -2.0..2.0f64, sideways in -2.0..2.0f64, turn in -3.0..3.0f64) {
            let steps = 1 << 20;
            let step = f64::from(steps).recip();
            let mut arc = Pose::new(forward * step, sideways * step, turn * step);
            for _ in 0..20 {
                arc = arc * arc;
            }
            let exp = Pose::exp(Vector3::new(forward, sideways, turn));
            prop_assert!((matrix(exp) - matrix(arc)).norm() < 1e-5, "{exp:?} {arc:?}");
        }

        #[test]
        fn wrapping_keeps_the_angle(angle in -1e3..1e3f64) {
            let wrapped = wrap_angle(angle);
            prop_assert!(wrapped > -std::f64::consts::PI && wrapped <= std::f64::consts::PI);
            prop_assert!((wrapped.sin() - angle.sin()).abs() < 1e-9 && (wrapped.cos() - angle.cos()).abs() < 1e-9);
        }
    }

    #[test]
    fn half_a_turn_is_positive() {
        assert_eq!(wrap_angle(-std::f64::consts::PI), std::f64::consts::PI);
        assert!(wrap_angle(f64::NAN).is_nan());
    }

    /// The oracle: central differences.
    #[test]
    fn the_jacobian_of_the_exponential_is_its_derivative() {
        for turn in [0.0, 1e-5, -0.0009, 0.0011, 0.7, -2.9] {
            let twist = Vector3::new(1.2, -0.4, turn);
            let jacobian = Pose::exp_jacobian(twist);
            for axis in 0..3 {
                let step = Vector3::ith(axis, 1e-5);
                let change = Pose::exp(twist + step).seen_from(Pose::exp(twist)).log()
                    - Pose::exp(twist - step).seen_from(Pose::exp(twist)).log();
                let error = (jacobian.column(axis) - change / 2e-5).norm();
                assert!(error < 1e-8, "turn {turn}, axis {axis}: {error}");
            }
        }
    }

    /// The oracle: a small motion before `next` moves its end by the finite difference of the composed poses.
    #[test]
    fn the_adjoint_is_the_derivative_of_composition() {
        let next = Pose::new(1.5, -0.7, 2.0);
        let carry = next.inverse().adjoint();
        let step = 1e-6;
        for axis in 0..3 {
            let mut small = [0.0; 3];
            small[axis] = step;
            let moved = (Pose::new(small[0], small[1], small[2]) * next).seen_from(next);
            for (row, value) in [moved.x, moved.y, moved.heading].into_iter().enumerate() {
                assert!((carry[(row, axis)] - value / step).abs() < 1e-5, "row {row} axis {axis}");
            }
        }
    }
}
