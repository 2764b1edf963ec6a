//! A recording of a camera and an inertial sensor: a folder with `sensors.toml`, `imu.csv` and `tracks.csv`, as
//! `docs/formats.md` says.

use super::table::{Layout, read_table};
use super::{WriteError, read_text, write_whole};
use crate::geometry::{Pinhole, Pose3};
use crate::inertial::{ImuNoise, ImuReading};
use crate::log::LogError;
use crate::parameters::check;
use crate::visual_inertial::{Camera, Feature, FeatureFrame, Recording};
use nalgebra::{Point2, Point3, Quaternion, Unit, Vector3};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;

const SENSORS: &str = "sensors.toml";
/// Inertial readings; folders of this kind are recognised by this file.
pub const IMU: &str = "imu.csv";
const TRACKS: &str = "tracks.csv";

/// Longer texts are no description of sensors \[bytes\].
const MAX_LENGTH: u64 = 1 << 20;
const SENSORS_EXPECTED: &str = "sensors.toml of a camera and an inertial sensor has a table [camera] (docs/formats.md)";
const IMU_EXPECTED: &str = "inertial readings have the columns t,wx,wy,wz,ax,ay,az (s, rad/s, m/s²)";
const TRACKS_EXPECTED: &str = "features have the columns t,track,u,v (s, a whole number, pixels)";

/// The part of `sensors.toml` that is read here; the rest is for other sensors.
#[derive(Serialize, Deserialize)]
struct SensorsFile {
    camera: CameraTable,
    #[serde(default)]
    imu: ImuNoise,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraTable {
    focal: [f64; 2],
    centre: [f64; 2],
    #[serde(default = "default_noise")]
    noise: f64,
    position: [f64; 3],
    quaternion: [f64; 4],
}

/// Of a corner that is followed from picture to picture \[pixels\].
fn default_noise() -> f64 {
    1.5
}

/// Reads the folder of a recording.
///
/// # Errors
/// A file is missing or cannot be read, or a line of it is wrong; the message names file, line and remedy.
pub fn read(folder: &Path) -> Result<Recording, LogError> {
    let (camera, imu_noise) = read_sensors(&folder.join(SENSORS))?;
    let (imu, frames) = (read_imu(&folder.join(IMU))?, read_tracks(&folder.join(TRACKS))?);
    Ok(Recording { camera, imu_noise, imu, frames })
}

fn read_sensors(path: &Path) -> Result<(Camera, ImuNoise), LogError> {
    let not_this_format =
        |reason| LogError::NotThisFormat { path: path.to_owned(), reason, expected: SENSORS_EXPECTED };
    let text = read_text(path, MAX_LENGTH).map_err(|error| error.in_recording(path, SENSORS_EXPECTED))?;
    let SensorsFile { camera, imu } = toml::from_str(&text).map_err(|error| not_this_format(error.to_string()))?;
    let CameraTable { focal, centre, noise, position, quaternion: [x, y, z, w] } = camera;
    let rotation = Quaternion::new(w, x, y, z);
    let pixels = [("camera.focal", focal, 1e-3..=1e6), ("camera.centre", centre, -1e6..=1e6)];
    let numbers = pixels.into_iter().flat_map(|(name, pair, range)| pair.map(|number| (name, number, range.clone())));
    let metres = position.map(|number| ("camera.position", number, -1e3..=1e3));
    let rest = [("camera.noise", noise, 1e-6..=1e3), ("length of camera.quaternion", rotation.norm(), 0.99..=1.01)];
    numbers
        .chain(metres)
        .chain(rest)
        .try_for_each(|(name, number, range)| check(name, number, range))
        .and_then(|()| imu.check("imu"))
        .map_err(|error| not_this_format(error.to_string()))?;
    let body_from_camera = Pose3::new(Point3::from(position), Unit::new_normalize(rotation));
    Ok((Camera { pinhole: Pinhole { focal, centre }, body_from_camera, noise }, imu))
}

fn read_imu(path: &Path) -> Result<Vec<ImuReading>, LogError> {
    const LAYOUT: Layout = Layout { required: &["t", "wx", "wy", "wz", "ax", "ay", "az"], optional: &[] };
    let mut readings: Vec<ImuReading> = Vec::new();
    read_table(path, &[LAYOUT], IMU_EXPECTED, |_, row| {
        let vector =
            |first| Ok::<_, String>(Vector3::new(row.number(first)?, row.number(first + 1)?, row.number(first + 2)?));
        let reading = ImuReading { stamp: row.number(0)?, rate: vector(1)?, force: vector(4)? };
        if let Some(last) = readings.last().filter(|last| last.stamp >= reading.stamp) {
            return Err(format!(
                "its stamp, {}, does not come after that of the row above, {}; sort the rows by t and leave out what comes \
                 again",
                reading.stamp, last.stamp
            ));
        }
        readings.push(reading);
        Ok(())
    })?;
    if readings.is_empty() {
        let reason = "it holds no row besides the header".to_owned();
        return Err(LogError::NotThisFormat { path: path.to_owned(), reason, expected: IMU_EXPECTED });
    }
    Ok(readings)
}

fn read_tracks(path: &Path) -> Result<Vec<FeatureFrame>, LogError> {
    const LAYOUT: Layout = Layout { required: &["t", "track", "u", "v"], optional: &[] };
    let mut frames: Vec<FeatureFrame> = Vec::new();
    read_table(path, &[LAYOUT], TRACKS_EXPECTED, |_, row| {
        let stamp = row.number(0)?;
        let feature = match [1, 2, 3].iter().all(|&column| row.text(column).is_empty()) {
            true => None,
            false => Some(Feature { track: row.count(1)?, pixel: Point2::new(row.number(2)?, row.number(3)?) }),
        };
        match (frames.last_mut(), feature) {
            (Some(last), _) if stamp < last.stamp => {
                let last = last.stamp;
                Err(format!("its stamp, {stamp}, lies before that of the row above, {last}; sort the rows by t"))
            }
            (Some(frame), Some(feature)) if stamp == frame.stamp && !frame.features.is_empty() => {
                if frame.features.iter().any(|other| other.track == feature.track) {
                    return Err(format!("track {} comes twice at {stamp}; leave one out", feature.track));
                }
                frame.features.push(feature);
                Ok(())
            }
            (Some(frame), _) if stamp == frame.stamp => {
                Err(format!("a row without a track tells of a picture without features, but {stamp} has more rows"))
            }
            (_, feature) => {
                frames.push(FeatureFrame { stamp, features: Vec::from_iter(feature) });
                Ok(())
            }
        }
    })?;
    Ok(frames)
}

/// Writes the folder of a recording; it is made where there is none, and files of these names in it are replaced.
///
/// # Errors
/// A file cannot be written.
pub fn write(folder: &Path, recording: &Recording) -> Result<(), WriteError> {
    std::fs::create_dir_all(folder).map_err(|source| WriteError { path: folder.to_owned(), source })?;
    write_whole(&folder.join(IMU), |file| {
        writeln!(file, "t,wx,wy,wz,ax,ay,az")?;
        recording.imu.iter().try_for_each(|ImuReading { stamp, rate, force }| {
            writeln!(file, "{stamp},{},{},{},{},{},{}", rate.x, rate.y, rate.z, force.x, force.y, force.z)
        })
    })?;
    write_tracks(folder, &recording.frames)?;
    let Camera { pinhole: Pinhole { focal, centre }, body_from_camera: Pose3 { position, rotation }, noise } =
        recording.camera;
    let quaternion = rotation.coords.into();
    let camera = CameraTable { focal, centre, noise, position: position.coords.into(), quaternion };
    let sensors = SensorsFile { camera, imu: recording.imu_noise };
    // Last, so that what was cut short is no recording.
    write_whole(&folder.join(SENSORS), |file| {
        let text = toml::to_string(&sensors).map_err(std::io::Error::other)?;
        writeln!(file, "# Metres, radians, seconds: docs/formats.md of ipslam tells what each number is.\n{text}")
    })
}

/// Writes `tracks.csv` into a folder.
///
/// # Errors
/// The file cannot be written.
pub fn write_tracks(folder: &Path, frames: &[FeatureFrame]) -> Result<(), WriteError> {
    write_whole(&folder.join(TRACKS), |file| write_frames(frames, file))
}

fn write_frames(frames: &[FeatureFrame], mut out: impl Write) -> std::io::Result<()> {
    writeln!(out, "t,track,u,v")?;
    for FeatureFrame { stamp, features } in frames {
        if features.is_empty() {
            writeln!(out, "{stamp},,,")?;
        }
        for Feature { track, pixel } in features {
            writeln!(out, "{stamp},{track},{},{}", pixel.x, pixel.y)?;
        }
    }
    Ok(())
}
