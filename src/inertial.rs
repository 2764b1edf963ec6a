//! Inertial sensors, and what their readings between two moments say about the motion: C. Forster, L. Carlone,
//! F. Dellaert, D. Scaramuzza, "On-Manifold Preintegration for Real-Time Visual-Inertial Odometry", IEEE T-RO 33(1), 2017.
//! Equation numbers here are those of that paper.
//!
//! The body's frame is that of the sensor. A gyroscope reads the body's rate of rotation, an accelerometer its specific
//! force: at rest, one g upwards. Both have a bias and white noise, and the biases wander.

use crate::geometry::{Pose3, rotation_jacobian};
use crate::parameters::parameters;
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3, Vector6};

/// Gravity in a frame whose z axis points up \[m/s²\].
pub const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);

/// One reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuReading {
    /// Seconds.
    pub stamp: f64,
    /// Rate of rotation \[rad/s\].
    pub rate: Vector3<f64>,
    /// Specific force \[m/s²\].
    pub force: Vector3<f64>,
}

/// What a sensor reads too much.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImuBias {
    /// Of the gyroscope \[rad/s\].
    pub rate: Vector3<f64>,
    /// Of the accelerometer \[m/s²\].
    pub force: Vector3<f64>,
}

impl ImuBias {
    /// From its six numbers: rate, then force.
    pub fn from_vector(numbers: Vector6<f64>) -> Self {
        Self { rate: numbers.fixed_rows::<3>(0).into_owned(), force: numbers.fixed_rows::<3>(3).into_owned() }
    }

    /// Its six numbers: rate, then force.
    pub fn to_vector(self) -> Vector6<f64> {
        Vector6::new(self.rate.x, self.rate.y, self.rate.z, self.force.x, self.force.y, self.force.z)
    }
}

parameters! {
    /// Noise of a sensor, as in data sheets. A body that vibrates, and readings that are held until the next one, add to
    /// that: the defaults are for a small sensor on such a body.
    pub struct ImuNoise {
        /// Density of the gyroscope's noise \[rad/s/√Hz\].
        rate: f64 = 2e-4, in 1e-7..=1.0;
        /// Density of the accelerometer's noise \[m/s²/√Hz\].
        force: f64 = 1e-2, in 1e-6..=10.0;
        /// How the gyroscope's bias wanders \[rad/s²/√Hz\].
        rate_walk: f64 = 2e-5, in 1e-9..=1.0;
        /// How the accelerometer's bias wanders \[m/s³/√Hz\].
        force_walk: f64 = 3e-3, in 1e-8..=10.0;
        /// Error of a position for that readings are held until the next one \[m/√s\].
        integration: f64 = 1e-4, in 1e-9..=1.0;
    }
}

/// The motion between two moments, as seen from the first one, without gravity and without the speed that the body had:
/// ΔR, Δp and Δv of eq. 33.
///
/// Vectors of nine are position \[m\], rotation vector \[rad\] and velocity \[m/s\]; those of six are a bias, rate and then
/// force.
#[derive(Clone, Debug, PartialEq)]
pub struct Preintegration {
    /// Seconds from the first moment to the second.
    pub duration: f64,
    /// The bias that was taken off the readings.
    pub bias: ImuBias,
    /// ΔR.
    pub rotation: UnitQuaternion<f64>,
    /// Δp \[m\].
    pub position: Vector3<f64>,
    /// Δv \[m/s\].
    pub velocity: Vector3<f64>,
    /// Covariance of the errors: of Δp and Δv in the first frame, of ΔR by steps ΔR · exp(d).
    pub covariance: SMatrix<f64, 9, 9>,
    /// Derivatives by the bias.
    pub by_bias: SMatrix<f64, 9, 6>,
}

impl Preintegration {
    /// Of no time at all.
    pub fn new(bias: ImuBias) -> Self {
        Self {
            duration: 0.0,
            bias,
            rotation: UnitQuaternion::identity(),
            position: Vector3::zeros(),
            velocity: Vector3::zeros(),
            covariance: SMatrix::zeros(),
            by_bias: SMatrix::zeros(),
        }
    }

    /// Adds a reading that holds for a time \[s\]: eq. 35 and, for the covariance and the derivatives by the bias, eq. 63
    /// and appendix B.
    pub fn add(&mut self, rate: Vector3<f64>, force: Vector3<f64>, duration: f64, noise: &ImuNoise) {
        let (rate, force) = (rate - self.bias.rate, force - self.bias.force);
        let turn = rate * duration;
        let step = UnitQuaternion::from_scaled_axis(turn);
        let rotation = self.rotation.to_rotation_matrix().into_inner();
        let half_square = 0.5 * duration * duration;

        // How errors before, and those of the reading, show after it.
        let by_turn = -rotation * force.cross_matrix();
        let mut by_before = SMatrix::<f64, 9, 9>::identity();
        by_before.fixed_view_mut::<3, 3>(0, 3).copy_from(&(by_turn * half_square));
        by_before.fixed_view_mut::<3, 3>(0, 6).copy_from(&(Matrix3::identity() * duration));
        by_before.fixed_view_mut::<3, 3>(3, 3).copy_from(&step.inverse().to_rotation_matrix().into_inner());
        by_before.fixed_view_mut::<3, 3>(6, 3).copy_from(&(by_turn * duration));
        let mut by_reading = SMatrix::<f64, 9, 6>::zeros();
        by_reading.fixed_view_mut::<3, 3>(0, 3).copy_from(&(rotation * half_square));
        by_reading.fixed_view_mut::<3, 3>(3, 0).copy_from(&(rotation_jacobian(turn) * duration));
        by_reading.fixed_view_mut::<3, 3>(6, 3).copy_from(&(rotation * duration));
        // White noise, averaged over the reading's time.
        let [rate_variance, force_variance] = [noise.rate, noise.force].map(|density| density * density / duration);
        let variances = Vector6::from_fn(|row, _| if row < 3 { rate_variance } else { force_variance });
        let of_reading = by_reading * SMatrix::from_diagonal(&variances) * by_reading.transpose();
        self.covariance = by_before * self.covariance * by_before.transpose() + of_reading;
        for axis in 0..3 {
            self.covariance[(axis, axis)] += noise.integration * noise.integration * duration;
        }
        self.by_bias = by_before * self.by_bias - by_reading;

        self.position += self.velocity * duration + rotation * force * half_square;
        self.velocity += rotation * force * duration;
        self.rotation = UnitQuaternion::new_normalize((self.rotation * step).into_inner());
        self.duration += duration;
    }

    /// All readings between two moments \[s\]; each holds until the next one, and the last of them before `from` from there
    /// on. None where no reading reaches into that time.
    pub fn between(readings: &[ImuReading], from: f64, to: f64, bias: ImuBias, noise: &ImuNoise) -> Option<Self> {
        let first = readings.partition_point(|reading| reading.stamp <= from).checked_sub(1)?;
        let mut sum = Self::new(bias);
        for (place, reading) in readings.iter().enumerate().skip(first).take_while(|(_, reading)| reading.stamp < to) {
            let end = readings.get(place + 1).map_or(to, |next| next.stamp.min(to));
            let duration = end - reading.stamp.max(from);
            if duration > 0.0 {
                sum.add(reading.rate, reading.force, duration, noise);
            }
        }
        (sum.duration > 0.0).then_some(sum)
    }

    /// Pose and velocity at the second moment, by those at the first, in a world whose z axis points up.
    pub fn predict(&self, pose: Pose3, velocity: Vector3<f64>) -> (Pose3, Vector3<f64>) {
        let (rotation, t) = (pose.rotation, self.duration);
        let position = pose.position + velocity * t + 0.5 * GRAVITY * t * t + rotation * self.position;
        (Pose3::new(position, rotation * self.rotation), velocity + GRAVITY * t + rotation * self.velocity)
    }

    /// ΔR, Δp and Δv for another bias, to first order (eq. 44).
    pub fn corrected(&self, bias: ImuBias) -> (UnitQuaternion<f64>, Vector3<f64>, Vector3<f64>) {
        let change = self.change(bias);
        let rotation = self.rotation * UnitQuaternion::from_scaled_axis(change.fixed_rows::<3>(3).into_owned());
        (rotation, self.position + change.fixed_rows::<3>(0), self.velocity + change.fixed_rows::<3>(6))
    }

    /// What another bias changes, in the tangent space.
    pub(crate) fn change(&self, bias: ImuBias) -> SVector<f64, 9> {
        self.by_bias * (bias.to_vector() - self.bias.to_vector())
    }
}
