//! A folder of pictures: `pictures.toml` says where they are and when they were taken, `sensors.toml` what is known about the
//! camera, the objects and the detector, as in a [recording in space](super::semantic).

use super::lines::Lines;
use super::read_text;
use super::semantic::{SENSORS, sensors};
use crate::detections::Sensors3;
use crate::log::LogError;
use crate::parameters::check;
use image::{ImageReader, RgbImage};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Folders of pictures are recognised by this file.
pub const PICTURES: &str = "pictures.toml";
const EXPECTED: &str = "pictures.toml is a TOML text in UTF-8 with the keys folder, rate or times, way, and least_score \
                        (docs/formats.md)";
/// Longer texts are no description of pictures \[bytes\].
const MAX_LENGTH: u64 = 1 << 20;
/// Endings of the names of pictures.
const ENDINGS: [&str; 5] = ["png", "jpg", "jpeg", "bmp", "pgm"];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PicturesFile {
    #[serde(default)]
    folder: PathBuf,
    rate: Option<f64>,
    times: Option<PathBuf>,
    way: f64,
    #[serde(default = "usual_score")]
    least_score: f64,
}

fn usual_score() -> f64 {
    0.5
}

/// Pictures, which stay in their files until they are asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Pictures {
    /// Camera, objects, detector.
    pub sensors: Sensors3,
    /// Stamps \[s\], which rise, and files.
    pub files: Vec<(f64, PathBuf)>,
    /// How long the camera's way is \[m\].
    pub way: f64,
    /// Objects of a lower score are left out.
    pub least_score: f64,
}

/// Whether a folder is one of pictures.
pub fn is_in(folder: &Path) -> bool {
    folder.join(PICTURES).is_file()
}

/// Reads what is in a folder of pictures, but the pictures.
///
/// # Errors
/// A file is missing or cannot be read, or a value of it cannot be.
pub fn read(folder: &Path) -> Result<Pictures, LogError> {
    let path = folder.join(PICTURES);
    let wrong = |reason: String| LogError::NotThisFormat { path: path.clone(), reason, expected: EXPECTED };
    let text = read_text(&path, MAX_LENGTH).map_err(|error| error.in_recording(&path, EXPECTED))?;
    let file: PicturesFile = toml::from_str(&text).map_err(|error| wrong(error.to_string()))?;
    check("way", file.way, 1e-3..=1e7)
        .and_then(|()| check("least_score", file.least_score, 0.0..=1.0))
        .map_err(|error| wrong(error.to_string()))?;
    let sensors = sensors::read3(&folder.join(SENSORS))?;
    let names = list(&folder.join(&file.folder))?;
    let stamps = match (file.rate, &file.times) {
        (Some(rate), None) => {
            check("rate", rate, 1e-6..=1e6).map_err(|error| wrong(error.to_string()))?;
            (0..names.len()).map(|number| number as f64 / rate).collect()
        }
        (None, Some(times)) => read_times(&folder.join(times), names.len())?,
        _ => return Err(wrong("it needs one of `rate`, pictures a second, and `times`, a file of stamps".to_owned())),
    };
    let files = stamps.into_iter().zip(names).collect();
    Ok(Pictures { sensors, files, way: file.way, least_score: file.least_score })
}

/// The pictures of a folder, in the order of their names.
fn list(folder: &Path) -> Result<Vec<PathBuf>, LogError> {
    let entries = std::fs::read_dir(folder).map_err(|source| LogError::Open { path: folder.to_owned(), source })?;
    let is_picture = |path: &PathBuf| {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
        ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
    };
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_picture).collect();
    paths.sort();
    if paths.is_empty() {
        let reason = format!("there are no pictures ({}) in {}", ENDINGS.join(", "), folder.display());
        return Err(LogError::NotThisFormat { path: folder.to_owned(), reason, expected: EXPECTED });
    }
    Ok(paths)
}

/// The first number of each line.
fn read_times(path: &Path, count: usize) -> Result<Vec<f64>, LogError> {
    let (mut lines, mut line, mut stamps) = (Lines::open(path)?, String::new(), Vec::<f64>::new());
    while lines.next_into(&mut line)? {
        let word = line.split([' ', '\t', ',']).find(|word| !word.is_empty()).unwrap_or_default();
        let stamp = word.parse().ok().filter(|stamp: &f64| stamp.is_finite());
        let stamp = stamp.ok_or_else(|| lines.error(format!("`{word:.30}` is no time in seconds")))?;
        if stamps.last().is_some_and(|last| *last >= stamp) {
            return Err(lines.error(format!("{stamp} s does not come after the time of the picture before it")));
        }
        stamps.push(stamp);
    }
    match stamps.len() {
        found if found == count => Ok(stamps),
        found => {
            let reason = format!("it has {found} times, but there are {count} pictures");
            Err(LogError::NotThisFormat { path: path.to_owned(), reason, expected: EXPECTED })
        }
    }
}

/// Reads a picture; grey ones become coloured ones without colours.
///
/// # Errors
/// The file cannot be read, or holds no picture.
pub fn read_picture(path: &Path) -> Result<RgbImage, LogError> {
    let reader = ImageReader::open(path).and_then(ImageReader::with_guessed_format);
    let reader = reader.map_err(|source| LogError::Open { path: path.to_owned(), source })?;
    let wrong = |error: image::ImageError| {
        let expected = "pictures are PNG, JPEG, BMP or PGM files";
        LogError::NotThisFormat { path: path.to_owned(), reason: error.to_string(), expected }
    };
    Ok(reader.decode().map_err(wrong)?.into_rgb8())
}
