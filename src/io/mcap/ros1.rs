//! The messages as ROS 1 writes them, in its bags and in those that were converted to MCAP: little-endian numbers
//! one after the other, without gaps, and a number more in each header.

use super::messages::{Header, Imu, LaserScan, Odometry, StampedTransform, Time, Transform, Transforms};
use super::records::Fields;

/// A message that can be read from its fields; `None` where there are too few.
pub(super) trait Ros1: Sized {
    fn read(fields: &mut Fields<'_>) -> Option<Self>;
}

fn single(fields: &mut Fields<'_>) -> Option<f32> {
    fields.number().map(f32::from_le_bytes)
}

/// Some `float64`.
fn doubles<const COUNT: usize>(fields: &mut Fields<'_>) -> Option<[f64; COUNT]> {
    let mut numbers = [0.0; COUNT];
    for number in &mut numbers {
        *number = f64::from_le_bytes(fields.number()?);
    }
    Some(numbers)
}

impl Ros1 for Header {
    fn read(fields: &mut Fields<'_>) -> Option<Self> {
        let _sequence: [u8; 4] = fields.number()?;
        let sec = i32::try_from(u32::from_le_bytes(fields.number()?)).ok()?;
        let nanosec = u32::from_le_bytes(fields.number()?);
        Some(Self { stamp: Time { sec, nanosec }, frame_id: fields.text()? })
    }
}

impl Ros1 for LaserScan {
    fn read(fields: &mut Fields<'_>) -> Option<Self> {
        Some(Self {
            header: Header::read(fields)?,
            angle_min: single(fields)?,
            _angle_max: single(fields)?,
            angle_increment: single(fields)?,
            time_increment: single(fields)?,
            _scan_time: single(fields)?,
            range_min: single(fields)?,
            range_max: single(fields)?,
            ranges: {
                let count = usize::try_from(u32::from_le_bytes(fields.number()?)).ok()?;
                let (ranges, _) = fields.bytes(count.checked_mul(size_of::<f32>())?)?.as_chunks();
                ranges.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect()
            },
        })
    }
}

impl Ros1 for Odometry {
    fn read(fields: &mut Fields<'_>) -> Option<Self> {
        Some(Self { header: Header::read(fields)?, child_frame_id: fields.text()?, pose: Transform::read(fields)? })
    }
}

impl Ros1 for Imu {
    fn read(fields: &mut Fields<'_>) -> Option<Self> {
        Some(Self {
            header: Header::read(fields)?,
            _orientation: doubles(fields)?,
            _orientation_covariance: doubles(fields)?,
            angular_velocity: doubles(fields)?,
            angular_velocity_covariance: doubles(fields)?,
        })
    }
}

impl Ros1 for Transforms {
    fn read(fields: &mut Fields<'_>) -> Option<Self> {
        let count = u32::from_le_bytes(fields.number()?);
        let transforms = (0..count).map(|_| StampedTransform::read(fields)).collect::<Option<_>>()?;
        Some(Self { transforms })
    }
}

impl Ros1 for StampedTransform {
    fn read(fields: &mut Fields<'_>) -> Option<Self> {
        Some(Self {
            header: Header::read(fields)?,
            child_frame_id: fields.text()?,
            transform: Transform::read(fields)?,
        })
    }
}

impl Ros1 for Transform {
    fn read(fields: &mut Fields<'_>) -> Option<Self> {
        Some(Self { translation: doubles(fields)?, rotation: doubles(fields)? })
    }
}
