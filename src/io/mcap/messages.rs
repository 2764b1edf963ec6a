//! The four messages that a log is made of, from their bytes: those of ROS 2 (CDR, of either byte order) and of ROS 1.
//!
//! Fields that nothing here depends on and that nothing needed comes after are left out.

use super::records::{Channel, Fields};
use super::ros1::Ros1;
use crate::geometry::Pose;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use re_cdr::{BigEndian, LittleEndian, from_bytes};
use serde::Deserialize;
use serde::de::DeserializeOwned;

pub(super) const LASER_SCAN: &str = "sensor_msgs/msg/LaserScan";
pub(super) const ODOMETRY: &str = "nav_msgs/msg/Odometry";
pub(super) const TRANSFORMS: &str = "tf2_msgs/msg/TFMessage";

const NANOSECONDS: i64 = 1_000_000_000;
/// A quaternion whose length is this far from 1 was not meant as a rotation.
const QUATERNION_TOLERANCE: f64 = 0.1;

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

impl Channel {
    /// Whether its messages are encoded in a way that is understood: as by ROS 2, or as by ROS 1.
    pub(super) fn is_understood(&self) -> bool {
        ["cdr", "ros1"].contains(&&*self.encoding)
    }
}

/// Reads a message; `Err` tells what is wrong with it.
pub(super) fn decode<T: DeserializeOwned + Ros1>(channel: &Channel, data: &[u8]) -> Result<T, String> {
    match &*channel.encoding {
        "ros1" => T::read(&mut Fields(data)).ok_or_else(|| "it is shorter than its fields".to_owned()),
        _ => from_cdr(data),
    }
}

fn from_cdr<T: DeserializeOwned>(data: &[u8]) -> Result<T, String> {
    let decoded = match data {
        [0, 0, _, _, fields @ ..] => from_bytes::<T, BigEndian>(fields),
        [0, 1, _, _, fields @ ..] => from_bytes::<T, LittleEndian>(fields),
        _ => {
            let begin = &data[..data.len().min(4)];
            return Err(format!(
                "it is not plain CDR, as it begins with {begin:02x?} (was each message compressed? `ros2 bag convert` \
                 undoes that)"
            ));
        }
    };
    decoded.map(|(message, _)| message).map_err(|error| error.to_string())
}

/// A frame's name as messages of all ages tell it: the oldest begin with a slash.
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
