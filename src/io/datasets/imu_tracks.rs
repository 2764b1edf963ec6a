//! A camera and an inertial sensor in one table of GTSAM's examples, made of EuRoC (Burri et al., "The EuRoC micro aerial
//! vehicle datasets", IJRR 35(10), 2016): `imu_tracks.csv` and, in `truth_openvins.txt`, the true poses as TUM.
//!
//! A row is of one type: `meta` holds key and value, `imu` a reading, `vision_feature` where a track is in the plane z = 1 of
//! the camera, without its distortion.

use crate::geometry::{Pinhole, Pose3, StampedPose3};
use crate::inertial::{ImuNoise, ImuReading};
use crate::io::table::{Layout, Row, read_table};
use crate::io::tum;
use crate::log::LogError;
use crate::visual_inertial::{Camera, Feature, FeatureFrame, Recording};
use nalgebra::{Point2, Point3, Quaternion, Unit, Vector3};
use std::collections::BTreeMap;
use std::path::Path;

const TABLE: &str = "imu_tracks.csv";
const TRUTH: &str = "truth_openvins.txt";
const EXPECTED: &str = "imu_tracks.csv has the columns row_type,t_abs,landmark_id,gx,...,az,u_norm,v_norm,key,value";
const LAYOUT: Layout = Layout {
    required: &[
        "row_type",
        "t_abs",
        "landmark_id",
        "gx",
        "gy",
        "gz",
        "ax",
        "ay",
        "az",
        "u_norm",
        "v_norm",
        "key",
        "value",
    ],
    optional: &[],
};

/// Whether the set is in a folder.
pub fn is_in(folder: &Path) -> bool {
    folder.join(TABLE).is_file()
}

/// Reads the set in a folder: the recording, and where the body truly was.
///
/// # Errors
/// A file is missing or cannot be read, or a line of it is wrong.
pub fn read(folder: &Path) -> Result<(Recording, Vec<StampedPose3>), LogError> {
    let path = folder.join(TABLE);
    let (mut settings, mut imu, mut frames) = (BTreeMap::new(), Vec::new(), Vec::<FeatureFrame>::new());
    read_table(&path, &[LAYOUT], EXPECTED, |_, row| {
        match row.text(0) {
            "meta" => {
                // Some values are words.
                if let Ok(value) = row.number(12) {
                    settings.insert(row.text(11).to_owned(), value);
                }
            }
            "imu" => imu.push(ImuReading { stamp: row.number(1)?, rate: vector(row, 3)?, force: vector(row, 6)? }),
            "vision_feature" => {
                let (stamp, track) = (row.number(1)?, row.count(2)?);
                let feature = Feature { track, pixel: Point2::new(row.number(9)?, row.number(10)?) };
                match frames.last_mut() {
                    Some(frame) if frame.stamp == stamp => frame.features.push(feature),
                    _ => frames.push(FeatureFrame { stamp, features: vec![feature] }),
                }
            }
            other => return Err(format!("row_type is `{other:.30}`, but has to be meta, imu or vision_feature")),
        }
        Ok(())
    })?;
    let number = |key: &str| {
        let reason = || format!("it has no row `meta` with the key {key} and a number");
        let missing = || LogError::NotThisFormat { path: path.clone(), reason: reason(), expected: EXPECTED };
        settings.get(key).copied().ok_or_else(missing)
    };
    let rotation = Quaternion::new(number("T_ci_qw")?, number("T_ci_qx")?, number("T_ci_qy")?, number("T_ci_qz")?);
    let position = Point3::new(number("T_ci_tx")?, number("T_ci_ty")?, number("T_ci_tz")?);
    // Variances, which the makers of the table use themselves.
    let density = |key: &str| number(key).map(f64::sqrt);
    let camera = Camera {
        pinhole: Pinhole::NORMALISED,
        body_from_camera: Pose3::new(position, Unit::new_normalize(rotation)),
        noise: density("eqf.measurement_noise_variance_norm")?,
    };
    // How the biases wander is as in EuRoC's own description of the sensor; the table's numbers are those of a filter that
    // has to follow them from nothing.
    let imu_noise = ImuNoise {
        rate: density("eqf.input_var_gyr")?,
        force: density("eqf.input_var_acc")?,
        rate_walk: 1.9393e-5,
        force_walk: 3e-3,
        ..ImuNoise::default()
    };
    Ok((Recording { camera, imu_noise, imu, frames }, tum::read3(&folder.join(TRUTH))?))
}

fn vector(row: &Row, first: usize) -> Result<Vector3<f64>, String> {
    Ok(Vector3::new(row.number(first)?, row.number(first + 1)?, row.number(first + 2)?))
}
