//! The messages that a log is made of: laser scans, odometry, rates of rotation and transforms.
//!
//! Fields that nothing here depends on and that nothing needed comes after are left out.

use crate::geometry::Pose;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;

pub(super) const LASER_SCAN: &str = "sensor_msgs/msg/LaserScan";
pub(super) const ODOMETRY: &str = "nav_msgs/msg/Odometry";
pub(super) const IMU: &str = "sensor_msgs/msg/Imu";
pub(super) const TRANSFORMS: &str = "tf2_msgs/msg/TFMessage";

/// The ROS 2 name of a type of ROS 1: `sensor_msgs/LaserScan` is `sensor_msgs/msg/LaserScan`.
pub(super) fn ros2_name(name: &str) -> String {
    match name.split_once('/') {
        // Of before tf2, with the same fields.
        Some(("tf", "tfMessage")) => TRANSFORMS.to_owned(),
        Some((package, name)) if !name.contains('/') => format!("{package}/msg/{name}"),
        _ => name.to_owned(),
    }
}

const NANOSECONDS: i64 = 1_000_000_000;
/// A quaternion whose length is this far from 1 was not meant as a rotation.
const QUATERNION_TOLERANCE: f64 = 0.1;

/// Rates of rotation from here on are none \[rad/s\]: gyroscopes measure up to 35.
const MAX_RATE: f64 = 100.0;

/// `std_msgs/msg/Header`
#[derive(Debug, Deserialize)]
pub(super) struct Header {
    pub(super) stamp: Time,
    pub(super) frame_id: String,
}

/// `builtin_interfaces/msg/Time`
#[derive(Debug, Deserialize)]
pub(super) struct Time {
    pub(super) sec: i32,
    pub(super) nanosec: u32,
}

/// `sensor_msgs/msg/LaserScan`, without its intensities.
#[derive(Debug, Deserialize)]
pub(super) struct LaserScan {
    pub(super) header: Header,
    pub(super) angle_min: f32,
    pub(super) _angle_max: f32,
    pub(super) angle_increment: f32,
    pub(super) time_increment: f32,
    pub(super) _scan_time: f32,
    pub(super) range_min: f32,
    pub(super) range_max: f32,
    pub(super) ranges: Vec<f32>,
}

/// `nav_msgs/msg/Odometry`, without covariances and twist.
#[derive(Debug, Deserialize)]
pub(super) struct Odometry {
    pub(super) header: Header,
    pub(super) child_frame_id: String,
    pub(super) pose: Transform,
}

/// `sensor_msgs/msg/Imu`, without accelerations.
#[derive(Debug, Deserialize)]
pub(super) struct Imu {
    pub(super) header: Header,
    pub(super) _orientation: [f64; 4],
    pub(super) _orientation_covariance: [f64; 9],
    /// rad/s
    pub(super) angular_velocity: [f64; 3],
    pub(super) angular_velocity_covariance: [f64; 9],
}

/// `tf2_msgs/msg/TFMessage`
#[derive(Debug, Deserialize)]
pub(super) struct Transforms {
    pub(super) transforms: Vec<StampedTransform>,
}

/// `geometry_msgs/msg/TransformStamped`
#[derive(Debug, Deserialize)]
pub(super) struct StampedTransform {
    pub(super) header: Header,
    pub(super) child_frame_id: String,
    pub(super) transform: Transform,
}

/// `geometry_msgs/msg/Transform`, and `geometry_msgs/msg/Pose`, which has the same numbers.
#[derive(Debug, Deserialize)]
pub(super) struct Transform {
    pub(super) translation: [f64; 3],
    /// x, y, z, w
    pub(super) rotation: [f64; 4],
}

/// A frame's name without the leading slash of old messages.
fn frame(name: &str) -> &str {
    name.trim_start_matches('/')
}

impl Header {
    pub(super) fn frame(&self) -> &str {
        frame(&self.frame_id)
    }

    /// Nanoseconds.
    pub(super) fn stamp(&self) -> Result<i64, String> {
        let Time { sec, nanosec } = self.stamp;
        if i64::from(nanosec) >= NANOSECONDS {
            return Err(format!("its stamp has {nanosec} nanoseconds, which is more than a second"));
        }
        Ok(i64::from(sec) * NANOSECONDS + i64::from(nanosec))
    }
}

/// Seconds.
pub(super) fn seconds(nanoseconds: i64) -> f64 {
    // Whole seconds apart, so that it is rounded once.
    nanoseconds.div_euclid(NANOSECONDS) as f64 + nanoseconds.rem_euclid(NANOSECONDS) as f64 / NANOSECONDS as f64
}

impl Imu {
    /// The rate of rotation about an axis of the sensor \[rad/s\].
    pub(super) fn rate_about(&self, axis: &Vector3<f64>) -> Result<f64, String> {
        // By convention, what is not measured has this covariance.
        if self.angular_velocity_covariance[0] == -1.0 {
            return Err("it has no rate of rotation (angular_velocity_covariance is -1)".to_owned());
        }
        let rate = axis.dot(&Vector3::from(self.angular_velocity));
        // No gyroscope measures as much.
        if rate.abs() < MAX_RATE { Ok(rate) } else { Err(format!("no rate of rotation: {:?}", self.angular_velocity)) }
    }
}

impl Odometry {
    pub(super) fn child_frame(&self) -> &str {
        frame(&self.child_frame_id)
    }
}

impl StampedTransform {
    pub(super) fn child_frame(&self) -> &str {
        frame(&self.child_frame_id)
    }
}

impl Transform {
    pub(super) fn isometry(&self) -> Result<Isometry3<f64>, String> {
        let [x, y, z, w] = self.rotation;
        let quaternion = Quaternion::new(w, x, y, z);
        // Not so where it is not finite, too.
        if (quaternion.norm() - 1.0).abs() <= QUATERNION_TOLERANCE && self.translation.iter().all(|x| x.is_finite()) {
            let translation = Translation3::from(self.translation);
            Ok(Isometry3::from_parts(translation, UnitQuaternion::from_quaternion(quaternion)))
        } else {
            Err(format!("no pose: position {:?}, quaternion {:?}", self.translation, self.rotation))
        }
    }

    /// Seen from above.
    pub(super) fn pose(&self) -> Result<Pose, String> {
        self.isometry().map(|isometry| flat(&isometry))
    }
}

/// A motion of space seen from above: where the origin goes, and where the x axis points.
pub(super) fn flat(isometry: &Isometry3<f64>) -> Pose {
    let ahead = isometry.rotation * Vector3::x();
    Pose::new(isometry.translation.x, isometry.translation.y, ahead.y.atan2(ahead.x))
}
