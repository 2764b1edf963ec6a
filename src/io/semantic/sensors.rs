//! `sensors.toml`: the sensors of a recording. What it leaves out has its default; only the classes have to be named.

use super::invalid;
use crate::detections::{
    DetectionKind, DetectionNoise, Detector, Detector3, OdometryNoise, OdometryNoise3, PixelNoise, Sensors, Sensors3,
    View,
};
use crate::geometry::{Pinhole, Pose, Pose3};
use crate::io::read_text;
use crate::log::LogError;
use crate::parameters::{ConfigError, check};
use nalgebra::{Point3, Quaternion, Unit};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;
use toml::de::{DeTable, DeValue};

/// Longer texts are no description of sensors \[bytes\].
const MAX_LENGTH: u64 = 1 << 20;
const EXPECTED: &str = "sensors.toml is a TOML text in UTF-8; the least is a line `classes = [\"NAME\", \"NAME\"]`";
/// Of the labels, if the file does not name it.
const LABEL_ACCURACY: f64 = 0.9;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorsFile {
    #[serde(default)]
    kind: DetectionKind,
    #[serde(default)]
    classes: Vec<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    label_accuracy: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    confusion: Option<Vec<Vec<f64>>>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    movable: Vec<String>,
    #[serde(default)]
    mounting: Mounting,
    #[serde(default)]
    noise: DetectionNoise,
    #[serde(default)]
    view: View,
    #[serde(default)]
    detector: Detector,
    #[serde(default)]
    odometry: OdometryNoise,
}

/// Pose of the detector in the robot's frame.
#[derive(Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Mounting {
    x: f64,
    y: f64,
    heading: f64,
}

/// The sensors of a robot of space.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Sensors3File {
    kind: DetectionKind,
    #[serde(default)]
    classes: Vec<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    label_accuracy: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    confusion: Option<Vec<Vec<f64>>>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    movable: Vec<String>,
    camera: CameraTable,
    #[serde(default)]
    noise: PixelNoise,
    #[serde(default)]
    detector: Detector3,
    #[serde(default)]
    odometry: OdometryNoise3,
}

/// The camera, and its pose in the robot's frame.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraTable {
    focal: [f64; 2],
    centre: [f64; 2],
    baseline: f64,
    #[serde(default)]
    reach: f64,
    #[serde(default)]
    position: [f64; 3],
    #[serde(default = "unturned")]
    quaternion: [f64; 4],
}

fn unturned() -> [f64; 4] {
    [0.0, 0.0, 0.0, 1.0]
}

/// What the detections of a recording are.
pub(super) fn read_kind(path: &Path) -> Result<DetectionKind, LogError> {
    read_as(path, kind)
}

/// What the detections are of sensors with such a text.
///
/// # Errors
/// The number of a line, from 1, and what is wrong with it.
pub fn kind(text: &str) -> Result<DetectionKind, (u64, String)> {
    #[derive(Deserialize)]
    struct Kind {
        #[serde(default)]
        kind: DetectionKind,
    }
    parse(text, |Kind { kind }| Ok(kind))
}

pub(super) fn read(path: &Path) -> Result<Sensors, LogError> {
    read_as(path, from_toml)
}

/// The same for a robot of space.
pub(in crate::io) fn read3(path: &Path) -> Result<Sensors3, LogError> {
    read_as(path, from_toml3)
}

fn read_as<T>(path: &Path, parse: impl FnOnce(&str) -> Result<T, (u64, String)>) -> Result<T, LogError> {
    let text = read_text(path, MAX_LENGTH).map_err(|error| error.in_recording(path, EXPECTED))?;
    parse(&text).map_err(|(line, reason)| LogError::Line { path: path.to_owned(), line, reason })
}

/// Reads the sensors from the text of such a file.
///
/// # Errors
/// The number of a line, from 1, and what is wrong with it.
pub fn from_toml(text: &str) -> Result<Sensors, (u64, String)> {
    parse(text, resolve)
}

/// The same for a robot of space.
///
/// # Errors
/// As for [`from_toml`].
pub fn from_toml3(text: &str) -> Result<Sensors3, (u64, String)> {
    parse(text, resolve3)
}

/// What a text says, or the line where it goes wrong, and why.
fn parse<F: DeserializeOwned, T>(
    text: &str,
    resolve: impl FnOnce(F) -> Result<T, ConfigError>,
) -> Result<T, (u64, String)> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let file: F = toml::from_str(text).map_err(|error| {
        let start = error.span().map_or(0, |span| span.start);
        (line_at(text, start), error.message().to_owned())
    })?;
    resolve(file).map_err(|error| (line_of(text, &error), error.to_string()))
}

fn resolve(file: SensorsFile) -> Result<Sensors, ConfigError> {
    let SensorsFile { kind, classes, label_accuracy, confusion, movable, mounting, noise, view, detector, odometry } =
        file;
    let movable = numbers_of(&movable, &classes)?;
    let mut sensors = Sensors::new(classes, accuracy(label_accuracy, confusion.as_ref())?);
    sensors.kind = kind;
    sensors.confusion = confusion.unwrap_or(sensors.confusion);
    sensors.movable = movable;
    sensors.robot_from_sensor = Pose::new(mounting.x, mounting.y, mounting.heading);
    sensors.noise = noise;
    sensors.view = view;
    sensors.detector = detector;
    sensors.odometry = odometry;
    sensors.validate()?;
    Ok(sensors)
}

fn resolve3(file: Sensors3File) -> Result<Sensors3, ConfigError> {
    let Sensors3File { kind: _, classes, label_accuracy, confusion, movable, camera, noise, detector, odometry } = file;
    let movable = numbers_of(&movable, &classes)?;
    let CameraTable { focal, centre, baseline, reach, position, quaternion: [x, y, z, w] } = camera;
    let rotation = Quaternion::new(w, x, y, z);
    check("camera.quaternion", rotation.norm(), 0.99..=1.01)?;
    let accuracy = accuracy(label_accuracy, confusion.as_ref())?;
    let mut sensors = Sensors3::new(classes, accuracy, Pinhole { focal, centre }, baseline);
    sensors.confusion = confusion.unwrap_or(sensors.confusion);
    sensors.movable = movable;
    sensors.reach = reach;
    // A unit quaternion stays what it is to the last bit, so that sensors that were written are read as they were.
    let is_unit = (rotation.norm() - 1.0).abs() < 1e-12;
    let rotation = if is_unit { Unit::new_unchecked(rotation) } else { Unit::new_normalize(rotation) };
    sensors.robot_from_camera = Pose3::new(Point3::from(position), rotation);
    sensors.noise = noise;
    sensors.detector = detector;
    sensors.odometry = odometry;
    sensors.validate()?;
    Ok(sensors)
}

/// The numbers of classes.
fn numbers_of(names: &[String], classes: &[String]) -> Result<Vec<usize>, ConfigError> {
    let number = |name: &String| {
        let found = classes.iter().position(|class| class == name);
        found.ok_or_else(|| ConfigError::value("movable", format!("{name:.60}"), "names of `classes`"))
    };
    names.iter().map(number).collect()
}

/// The probability that a label is right, where no matrix tells it.
fn accuracy(label_accuracy: Option<f64>, confusion: Option<&Vec<Vec<f64>>>) -> Result<f64, ConfigError> {
    if let (Some(accuracy), Some(_)) = (label_accuracy, confusion) {
        return Err(ConfigError::value("label_accuracy", accuracy, "left out, as there is a confusion matrix"));
    }
    let accuracy = label_accuracy.unwrap_or(LABEL_ACCURACY);
    check("label_accuracy", accuracy, 0.0..=1.0)?;
    Ok(accuracy)
}

/// Number of the line, from 1, that holds a byte.
fn line_at(text: &str, byte: usize) -> u64 {
    let before = text.as_bytes().get(..byte).unwrap_or_default();
    before.iter().filter(|&&byte| byte == b'\n').count() as u64 + 1
}

/// The line of the value that cannot be; the first one where the file does not set it.
fn line_of(text: &str, error: &ConfigError) -> u64 {
    let (ConfigError::Value { name, .. }, Ok(root)) = (error, DeTable::parse(text)) else { return 1 };
    let (mut table, mut start) = (root.get_ref(), 0);
    for key in name.split('.') {
        let Some(value) = table.get(key) else { break };
        start = value.span().start;
        let DeValue::Table(inner) = value.get_ref() else { break };
        table = inner;
    }
    line_at(text, start)
}

pub(super) fn write(sensors: &Sensors, mut out: impl Write) -> std::io::Result<()> {
    out.write_all(to_toml(sensors)?.as_bytes())
}

/// The text of such a file.
///
/// # Errors
/// Such sensors cannot be.
pub fn to_toml(sensors: &Sensors) -> std::io::Result<String> {
    sensors.validate().map_err(|error| invalid(error.to_string()))?;
    let Pose { x, y, heading } = sensors.robot_from_sensor;
    let label_accuracy = even_accuracy(&sensors.classes, &sensors.confusion);
    let file = SensorsFile {
        kind: sensors.kind,
        classes: sensors.classes.clone(),
        label_accuracy,
        confusion: label_accuracy.is_none().then(|| sensors.confusion.clone()),
        movable: sensors.movable.iter().filter_map(|class| sensors.classes.get(*class).cloned()).collect(),
        mounting: Mounting { x, y, heading },
        noise: sensors.noise,
        view: sensors.view,
        detector: sensors.detector,
        odometry: sensors.odometry,
    };
    explained(&file)
}

/// The same for a robot of space.
pub(super) fn write3(sensors: &Sensors3, mut out: impl Write) -> std::io::Result<()> {
    out.write_all(to_toml3(sensors)?.as_bytes())
}

/// The text of such a file, for a robot of space.
///
/// # Errors
/// Such sensors cannot be.
pub fn to_toml3(sensors: &Sensors3) -> std::io::Result<String> {
    sensors.validate().map_err(|error| invalid(error.to_string()))?;
    let Sensors3 {
        camera: Pinhole { focal, centre }, baseline, robot_from_camera: Pose3 { position, rotation }, ..
    } = *sensors;
    let label_accuracy = even_accuracy(&sensors.classes, &sensors.confusion);
    let quaternion = rotation.coords.into();
    let file = Sensors3File {
        kind: DetectionKind::Stereo,
        classes: sensors.classes.clone(),
        label_accuracy,
        confusion: label_accuracy.is_none().then(|| sensors.confusion.clone()),
        movable: sensors.movable.iter().filter_map(|class| sensors.classes.get(*class).cloned()).collect(),
        camera: CameraTable { focal, centre, baseline, reach: sensors.reach, position: position.into(), quaternion },
        noise: sensors.noise,
        detector: sensors.detector,
        odometry: sensors.odometry,
    };
    explained(&file)
}

fn explained(file: &impl Serialize) -> std::io::Result<String> {
    let text = toml::to_string(file).map_err(|error| invalid(error.to_string()))?;
    Ok(format!("# Metres, radians, seconds: docs/formats.md of ipslam tells what each number is.\n{text}\n"))
}

/// One number that says the same as a matrix, where wrong labels are equally likely.
fn even_accuracy(classes: &[String], confusion: &[Vec<f64>]) -> Option<f64> {
    let accuracy = confusion.first().and_then(|row| row.first()).copied();
    accuracy.filter(|&accuracy| Sensors::new(classes.to_vec(), accuracy).confusion == confusion)
}
