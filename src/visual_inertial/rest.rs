//! Calibration of an inertial sensor at rest.

use crate::inertial::{GRAVITY, ImuBias, ImuReading};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Readings are averaged over so long, so that what vibrates counts as rest \[s\].
const AVERAGED: f64 = 0.5;
/// A body at rest turns by less: 0.6° a second, far more than an average of the readings errs by \[rad/s\].
const STILL_RATE: f64 = 0.01;
/// A body at rest accelerates by less: a tilt by 0.6° shows as much \[m/s²\].
const STILL_FORCE: f64 = 0.1;
/// No gyroscope in use has more bias: 6° a second \[rad/s\].
const MAX_RATE_BIAS: f64 = 0.1;
/// No accelerometer in use has more \[m/s²\].
const MAX_FORCE_BIAS: f64 = 0.5;

/// A phase at the start of a recording in which the body does not move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// The first reading \[s\].
    pub start: f64,
    /// Until here \[s\].
    pub end: f64,
    /// The gyroscope's is what it reads; of the accelerometer's nothing is known, and it is zero.
    pub bias: ImuBias,
    /// The orientation: the world's z axis is up, and its x axis lies under the body's x axis, or under its z axis where that
    /// is the flatter one.
    pub world_from_body: UnitQuaternion<f64>,
}

impl Rest {
    /// The longest phase from the first reading on of which all averages agree; none where there is less than two of
    /// them.
    pub fn at_start(readings: &[ImuReading]) -> Option<Self> {
        let start = readings.first()?.stamp;
        let (mut rest, mut averages) = (readings, 0.0);
        let (mut rate, mut force) = (Vector3::zeros(), Vector3::zeros());
        loop {
            let end = start + AVERAGED * (averages + 1.0);
            let (now, later) = rest.split_at(rest.partition_point(|reading| reading.stamp < end));
            // The last average may not be a whole one.
            if now.is_empty() || later.is_empty() {
                break;
            }
            let mean =
                |of: fn(&ImuReading) -> Vector3<f64>| now.iter().map(of).sum::<Vector3<f64>>() / now.len() as f64;
            let (rate_now, force_now) = (mean(|reading| reading.rate), mean(|reading| reading.force));
            let is_possible =
                rate_now.norm() < MAX_RATE_BIAS && (force_now.norm() - GRAVITY.norm()).abs() < MAX_FORCE_BIAS;
            let agrees = averages == 0.0
                || (rate_now - rate / averages).norm() < STILL_RATE
                    && (force_now - force / averages).norm() < STILL_FORCE;
            if !(is_possible && agrees) {
                break;
            }
            (rest, averages, rate, force) = (later, averages + 1.0, rate + rate_now, force + force_now);
        }
        let bias = ImuBias { rate: rate / averages, force: Vector3::zeros() };
        (averages >= 2.0).then(|| Self {
            start,
            end: start + AVERAGED * averages,
            bias,
            world_from_body: upright(force),
        })
    }
}

/// The orientation in which a specific force points up.
fn upright(force: Vector3<f64>) -> UnitQuaternion<f64> {
    let up = force.normalize();
    let ahead = if up.x.abs() < 0.7 { Vector3::x() } else { Vector3::z() };
    let y = up.cross(&ahead).normalize();
    let body_from_world = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[y.cross(&up), y, up]));
    UnitQuaternion::from_rotation_matrix(&body_from_world).inverse()
}
