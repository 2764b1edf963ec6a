//! Occupancy grids as ROS keeps them (map_server, Nav2, AMCL): a picture, and a YAML file that says what it means.
//!
//! In the YAML file: `image` (the picture, beside the file), `resolution` \[m\] a pixel, `origin` `[x, y, yaw]` (the lower
//! left corner in the world's frame, \[m\] and \[rad\]), `negate`, `occupied_thresh` and `free_thresh`, and `mode`. The
//! picture's upper row is the grid's last.
//!
//! Read: PGM (`P5` and `P2`), PNG and BMP, grey or colour, with or without transparency, in the modes `trinary` (also where
//! none is given), `scale` and `raw`, by the rules of Nav2's map_server. What the modes `scale` and `raw` tell of a cell
//! that is neither free nor occupied is not kept: the cell is unknown. A pixel of 205 is unknown in the mode `trinary` whatever
//! the thresholds are: Nav2's map saver writes unknown cells so, and a `free_thresh` that would call them free. Written:
//! `trinary`, `P5`, occupied 0, free 254, unknown 205, which map_server reads as what they were.

use super::{WriteError, write_whole};
use crate::geometry::Pose;
use crate::grid::{Cell, GridError, MOST_CELLS, OccupancyGrid};
use image::codecs::png::PngEncoder;
use image::{
    DynamicImage, ExtendedColorType, GenericImageView as _, ImageDecoder, ImageEncoder as _, ImageFormat, ImageReader,
};
use serde::de::{Error as _, IgnoredAny};
use serde::{Deserialize, Deserializer};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::{Path, PathBuf};

/// Where a cell is occupied from, and up to where it is free: what a pixel of 205 is lies between.
const THRESHOLDS: [f64; 2] = [0.65, 0.196];
/// Longer YAML files are none of these \[bytes\].
const MOST_YAML: u64 = 1 << 20;
/// No coordinate is larger \[m\]: the Earth's circumference.
const FARTHEST: f64 = 4.1e7;
const OCCUPIED: u8 = 0;
const FREE: u8 = 254;
const UNKNOWN: u8 = 205;

/// Why a grid could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MapServerError {
    /// One of the two files cannot be opened or read.
    #[error("{path}: cannot be read: {source}")]
    Read {
        /// The YAML file, or the picture that it names.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is no YAML, or a field is missing, of another type, or cannot be.
    #[error(
        "{path}: no map as ROS's map_server reads it: {reason}; needed are image, resolution and origin, and where they \
         are given negate, occupied_thresh, free_thresh and mode"
    )]
    Yaml {
        /// The YAML file.
        path: PathBuf,
        /// What is wrong, with the line or the field's name.
        reason: String,
    },
    /// The picture cannot be understood.
    #[error("{path}: this picture cannot be read: {reason}; give a PGM (P5, P2), PNG or BMP")]
    Image {
        /// The picture.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The two make no grid.
    #[error("{path}: {source}")]
    Grid {
        /// The YAML file.
        path: PathBuf,
        /// What is wrong.
        source: GridError,
    },
}

/// The keys of a description: any other may be one that is misspelt.
const KEYS: [&str; 7] = ["image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode"];

#[derive(Deserialize)]
struct Description {
    image: PathBuf,
    resolution: f64,
    #[serde(deserialize_with = "origin")]
    origin: [f64; 3],
    #[serde(default)]
    negate: Flag,
    #[serde(default = "occupied_thresh")]
    occupied_thresh: f64,
    #[serde(default = "free_thresh")]
    free_thresh: f64,
    #[serde(default)]
    mode: Mode,
}

/// Numbers as words: old map savers wrote `nan`, which is none of YAML.
fn origin<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f64; 3], D::Error> {
    let number = |word: &String| {
        let word = word.trim();
        let plain = word.strip_prefix('.').filter(|rest| rest.starts_with(char::is_alphabetic)).unwrap_or(word);
        let negative = word.strip_prefix("-.").filter(|rest| rest.starts_with(char::is_alphabetic)).is_some();
        if negative { Ok(f64::NEG_INFINITY) } else { plain.parse() }
    };
    let words = <[String; 3]>::deserialize(deserializer)?;
    let mut origin = [0.0; 3];
    for (place, word) in origin.iter_mut().zip(&words) {
        let wrong = |_| D::Error::custom(format!("origin holds `{word:.20}`, which is no number"));
        *place = number(word).map_err(wrong)?;
    }
    Ok(origin)
}

fn occupied_thresh() -> f64 {
    THRESHOLDS[0]
}

fn free_thresh() -> f64 {
    THRESHOLDS[1]
}

/// Written as 0 and 1 by most programs, and as false and true by some.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
enum Flag {
    Number(u8),
    Bool(bool),
}

impl Default for Flag {
    fn default() -> Self {
        Self::Bool(false)
    }
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Mode {
    #[default]
    Trinary,
    Scale,
    Raw,
}

/// Reads a grid: its YAML file, and the picture that this names.
///
/// # Errors
/// A file cannot be opened or understood, or a value of it cannot be; the message names file and key.
pub fn read(path: &Path) -> Result<ReadGrid, MapServerError> {
    let (description, warnings) = Description::read(path)?;
    read_described(path, &description, warnings)
}

/// Reads a grid by its picture; the YAML file of the same name beside it tells what it means, whatever picture that names.
///
/// # Errors
/// As for [`read`].
pub fn read_picture(picture: &Path) -> Result<ReadGrid, MapServerError> {
    let yaml = picture.with_extension("yaml");
    let (description, warnings) = Description::read(&yaml)?;
    let image = PathBuf::from(picture.file_name().unwrap_or_default());
    read_described(&yaml, &Description { image, ..description }, warnings)
}

fn read_described(
    path: &Path,
    description: &Description,
    mut warnings: Vec<String>,
) -> Result<ReadGrid, MapServerError> {
    // A path that is absolute stays what it is.
    let mut picture = path.with_file_name(&description.image);
    if let (true, false, Some(name)) =
        (description.image.is_absolute(), picture.exists(), description.image.file_name())
    {
        picture = path.with_file_name(name);
        warnings.push(format!("{} is not there; {} was read", description.image.display(), picture.display()));
    }
    let pixels = Pixels::read(&picture)?;
    if matches!(description.mode, Mode::Trinary) && pixels.hold_occupancies() {
        warnings.push(format!(
            "{}: its grey values are 0, 100 and 255, as of occupancies in percent; are they, then `mode: raw` is missing in {}",
            picture.display(),
            path.display()
        ));
    }
    let (width, height) = pixels.image.dimensions();
    let cell = |(x, y)| description.cell(pixels.at(x, y), pixels.has_alpha);
    let cells = (0..height).rev().flat_map(|y| (0..width).map(move |x| (x, y))).map(cell).collect();
    let [x, y, yaw] = description.origin;
    let grid = OccupancyGrid::new(description.resolution, Pose::new(x, y, yaw), width, height, cells)
        .map_err(|source| MapServerError::Grid { path: path.to_owned(), source })?;
    Ok(ReadGrid { grid, warnings })
}

/// A grid, and what was odd about its files.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadGrid {
    /// The grid.
    pub grid: OccupancyGrid,
    /// What was taken to be otherwise than it is written, and what may be meant otherwise.
    pub warnings: Vec<String>,
}

/// Writes a grid: the YAML file `path`, and beside it the picture, of the same name but for `.pgm`.
///
/// # Errors
/// One of the files cannot be written; what stood there before is then untouched.
pub fn write(path: &Path, grid: &OccupancyGrid) -> Result<(), WriteError> {
    let picture = path.with_extension("pgm");
    let (width, height) = (grid.width(), grid.height());
    write_whole(&picture, |file| {
        write!(file, "P5\n{width} {height}\n255\n")?;
        file.write_all(&shades(grid))
    })?;
    write_description(path, &picture, grid)
}

/// Writes a grid: the picture `path` as PNG, and beside it the YAML file of the same name.
///
/// # Errors
/// As for [`write()`].
pub fn write_png(path: &Path, grid: &OccupancyGrid) -> Result<(), WriteError> {
    write_whole(path, |file| {
        let encoder = PngEncoder::new(file);
        encoder
            .write_image(&shades(grid), grid.width(), grid.height(), ExtendedColorType::L8)
            .map_err(std::io::Error::other)
    })?;
    write_description(&path.with_extension("yaml"), path, grid)
}

fn write_description(path: &Path, picture: &Path, grid: &OccupancyGrid) -> Result<(), WriteError> {
    let name = picture.file_name().unwrap_or_default().to_string_lossy();
    let Pose { x, y, heading } = grid.world_from_grid();
    let [occupied, free] = THRESHOLDS;
    write_whole(path, |file| {
        // A string of JSON is one of YAML.
        writeln!(file, "image: {}", serde_json::to_string(&name)?)?;
        writeln!(file, "mode: trinary\nresolution: {:?}\norigin: [{x:?}, {y:?}, {heading:?}]", grid.resolution())?;
        writeln!(file, "negate: 0\noccupied_thresh: {occupied}\nfree_thresh: {free}")
    })
}

/// Pixels, from the upper row down.
fn shades(grid: &OccupancyGrid) -> Vec<u8> {
    grid.cells().chunks(grid.width() as usize).rev().flatten().map(|&cell| shade(cell)).collect()
}

fn shade(cell: Cell) -> u8 {
    match cell {
        Cell::Occupied => OCCUPIED,
        Cell::Free => FREE,
        Cell::Unknown => UNKNOWN,
    }
}

impl Description {
    /// The description, and warnings.
    fn read(path: &Path) -> Result<(Self, Vec<String>), MapServerError> {
        let unreadable = |source| MapServerError::Read { path: path.to_owned(), source };
        let mut text = Vec::new();
        File::open(path).and_then(|file| file.take(MOST_YAML + 1).read_to_end(&mut text)).map_err(unreadable)?;
        let wrong = |reason| MapServerError::Yaml { path: path.to_owned(), reason };
        if text.len() as u64 > MOST_YAML {
            return Err(wrong(format!("it has more than {MOST_YAML} bytes")));
        }
        let options = || serde_saphyr::options! { with_snippet: false };
        let mut description: Self =
            serde_saphyr::from_slice_with_options(&text, options()).map_err(|error| wrong(error.to_string()))?;
        let mut warnings = Vec::new();
        // Where the yaw is `.nan` they cannot be asked for.
        let keys: BTreeMap<String, IgnoredAny> =
            serde_saphyr::from_slice_with_options(&text, options()).unwrap_or_default();
        for key in keys.keys().filter(|key| !KEYS.contains(&key.as_str())) {
            let (key, known) = (key.chars().take(40).collect::<String>(), KEYS.join(", "));
            warnings.push(format!("{}: the key {key:?} was left out; there are: {known}", path.display()));
        }
        if description.origin[2].is_nan() {
            warnings.push(format!(
                "{}: the yaw of its origin is no number, as old map savers wrote it: 0 is meant",
                path.display()
            ));
            description.origin[2] = 0.0;
        }
        description.check().map_err(wrong)?;
        Ok((description, warnings))
    }

    fn check(&self) -> Result<(), String> {
        let Self { occupied_thresh, free_thresh, .. } = *self;
        if !(0.0..=1.0).contains(&occupied_thresh) || !(0.0..=occupied_thresh).contains(&free_thresh) {
            return Err(format!(
                "occupied_thresh is {occupied_thresh} and free_thresh {free_thresh}, but have to be from 0 to 1, the \
                 latter no higher"
            ));
        }
        if let Some(number) = self.origin.iter().find(|number| !number.is_finite()) {
            return Err(format!("origin holds {number}, which is no finite number"));
        }
        if let Some(number) = self.origin.iter().find(|number| number.abs() > FARTHEST) {
            return Err(format!("origin holds {number:e}, and nothing on Earth is further than {FARTHEST:e} m"));
        }
        Ok(())
    }

    /// What a pixel says of its cell: red, green, blue and opacity from 0 to 1.
    fn cell(&self, [red, green, blue, alpha]: [f64; 4], has_alpha: bool) -> Cell {
        let colours = red + green + blue;
        // Nav2 takes transparency for a colour in this mode alone.
        let averaged = has_alpha && matches!(self.mode, Mode::Trinary);
        let shade = if averaged { (colours + alpha) / 4.0 } else { colours / 3.0 };
        let negate = match self.negate {
            Flag::Number(number) => number != 0,
            Flag::Bool(negate) => negate,
        };
        let occupancy = match self.mode {
            Mode::Scale if has_alpha && alpha < 1.0 => return Cell::Unknown,
            Mode::Trinary | Mode::Scale if negate => shade,
            Mode::Trinary | Mode::Scale => 1.0 - shade,
            // Percent as a grey value; what is above a hundred is unknown.
            Mode::Raw => match (shade * 255.0).round() {
                percent if percent <= 100.0 => percent / 100.0,
                _ => return Cell::Unknown,
            },
        };
        // Nav2's saver writes unknown cells as 205 and a threshold that calls them free.
        if matches!(self.mode, Mode::Trinary) && !negate && (shade * 255.0).round() == f64::from(UNKNOWN) {
            return Cell::Unknown;
        }
        // A raw map is made with these thresholds included, others are read with them excluded.
        let raw = matches!(self.mode, Mode::Raw);
        if occupancy > self.occupied_thresh || raw && occupancy == self.occupied_thresh {
            Cell::Occupied
        } else if occupancy < self.free_thresh || raw && occupancy == self.free_thresh {
            Cell::Free
        } else {
            Cell::Unknown
        }
    }
}

/// A picture in memory.
struct Pixels {
    image: DynamicImage,
    has_alpha: bool,
}

impl Pixels {
    fn read(path: &Path) -> Result<Self, MapServerError> {
        let unreadable = |source| MapServerError::Read { path: path.to_owned(), source };
        let file = BufReader::new(File::open(path).map_err(unreadable)?);
        let reader = ImageReader::new(file).with_guessed_format().map_err(unreadable)?;
        Self::decode(reader).map_err(|reason| MapServerError::Image { path: path.to_owned(), reason })
    }

    fn decode(reader: ImageReader<BufReader<File>>) -> Result<Self, String> {
        if !matches!(reader.format(), Some(ImageFormat::Pnm | ImageFormat::Png | ImageFormat::Bmp)) {
            return Err("it is something else".to_owned());
        }
        let decoder = reader.into_decoder().map_err(|error| error.to_string())?;
        let (width, height) = decoder.dimensions();
        if u64::from(width) * u64::from(height) > MOST_CELLS {
            return Err(format!("it has {width} x {height} pixels, more than {MOST_CELLS}"));
        }
        let has_alpha = decoder.color_type().has_alpha();
        let image = match DynamicImage::from_decoder(decoder).map_err(|error| error.to_string())? {
            image @ DynamicImage::ImageLuma8(_) => image,
            other => DynamicImage::ImageRgba8(other.into_rgba8()),
        };
        Ok(Self { image, has_alpha })
    }

    /// Whether its values are those of free, occupied and unknown cells where occupancies are written as grey values.
    fn hold_occupancies(&self) -> bool {
        let grey = self.image.to_luma8();
        let mut seen = [false; 256];
        grey.pixels().for_each(|pixel| seen[usize::from(pixel.0[0])] = true);
        let others = (0..256).any(|value| seen[value] && ![0, 100, 255].contains(&value));
        seen[100] && !others
    }

    /// Red, green, blue and opacity, from 0 to 1.
    fn at(&self, x: u32, y: u32) -> [f64; 4] {
        self.image.get_pixel(x, y).0.map(|sample| f64::from(sample) / 255.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayAlphaImage, GrayImage, ImageBuffer, Luma, RgbImage, RgbaImage};
    use proptest::prelude::*;

    const YAML: &str = "image: map.pgm\nresolution: 0.1\norigin: [1.0, -2.0, 0.5]\n\
                        negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n";

    /// Reads a YAML text beside a picture of the name that it gives.
    fn read_files(yaml: &str, name: &str, picture: &[u8]) -> Result<OccupancyGrid, MapServerError> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("map.yaml"), yaml).unwrap();
        std::fs::write(folder.path().join(name), picture).unwrap();
        read(&folder.path().join("map.yaml")).map(|read| read.grid)
    }

    fn png(image: impl Into<DynamicImage>) -> Vec<u8> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.into().write_to(&mut bytes, ImageFormat::Png).unwrap();
        bytes.into_inner()
    }

    /// Cells as letters: `#` occupied, `.` free, `?` unknown; the upper row first.
    fn letters(grid: &OccupancyGrid) -> String {
        let letter = |cell: &Cell| match cell {
            Cell::Occupied => '#',
            Cell::Free => '.',
            Cell::Unknown => '?',
        };
        let rows = grid.cells().chunks(grid.width() as usize).rev();
        rows.map(|row| row.iter().map(letter).collect::<String>()).collect::<Vec<_>>().join("/")
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(
            cells in prop::collection::vec(0..3_u8, 1..60), x in -1e5..1e5, yaw in -3.1..3.1, resolution in 1e-3..10.0
        ) {
            let kinds = [Cell::Unknown, Cell::Free, Cell::Occupied];
            let cells: Vec<Cell> = cells.iter().map(|&kind| kinds[usize::from(kind)]).collect();
            let (width, height) = if cells.len().is_multiple_of(3) { (3, cells.len() / 3) } else { (cells.len(), 1) };
            let corner = Pose::new(x, -0.1 * x, yaw);
            let grid = OccupancyGrid::new(resolution, corner, width as u32, height as u32, cells).unwrap();
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a \"map\" of: ours.yaml");
            write(&path, &grid).unwrap();
            prop_assert_eq!(read(&path).unwrap().grid, grid);
        }
    }

    /// The oracle: bytes laid out by hand, and what map_server's documentation says of them.
    #[test]
    fn pictures_of_every_kind_are_read() {
        let plain = |text: &str| letters(&read_files(YAML, "map.pgm", text.as_bytes()).unwrap());
        assert_eq!(plain("P2\n# a comment\n3 2\n255\n0 254 205\n100 90 89\n"), "#.?/??#");
        assert_eq!(plain("P2 3 1 10 0 5 10\n"), "#?.");
        let binary = read_files(YAML, "map.pgm", b"P5\n3 1\n255\n\x00\xfe\xcd").unwrap();
        assert_eq!(letters(&binary), "#.?");
        assert_eq!(binary.world_from_grid(), Pose::new(1.0, -2.0, 0.5));
        assert_eq!(letters(&read_files(YAML, "map.pgm", b"P5 2 1 100 \x00\x64").unwrap()), "#.");

        let yaml = YAML.replace("map.pgm", "map.png");
        let read = |yaml: &str, png: Vec<u8>| letters(&read_files(yaml, "map.png", &png).unwrap());
        let grey = || png(GrayImage::from_vec(3, 1, vec![0, 254, 205]).unwrap());
        assert_eq!(read(&yaml, grey()), "#.?");
        assert_eq!(read(&yaml.replace("negate: 0", "negate: 1"), grey()), ".##");
        assert_eq!(read(&yaml.replace("negate: 0", "negate: true"), grey()), ".##");
        assert_eq!(read(&yaml.replace("negate: 0\n", ""), grey()), "#.?");
        let deep = ImageBuffer::<Luma<u16>, _>::from_vec(3, 1, vec![0, 65000, 52685]).unwrap();
        assert_eq!(read(&yaml, png(deep)), "#.?");
        assert_eq!(read(&yaml, png(RgbImage::from_vec(2, 1, vec![0, 0, 0, 255, 255, 250]).unwrap())), "#.");
        // The mean of all three is 85 of 255, so two thirds occupied.
        assert_eq!(read(&yaml, png(RgbImage::from_vec(1, 1, vec![255, 0, 0]).unwrap())), "#");

        // Transparent: white counts as a quarter black in trinary, as unknown in scale.
        let rgba = || png(RgbaImage::from_vec(3, 1, vec![0, 0, 0, 255, 255, 255, 255, 0, 0, 0, 0, 0]).unwrap());
        assert_eq!(read(&yaml, rgba()), "#?#");
        let scale = format!("{yaml}mode: scale\n");
        assert_eq!(read(&scale, rgba()), "#??");
        let grey_alpha = GrayAlphaImage::from_vec(3, 1, vec![0, 255, 255, 255, 128, 255]).unwrap();
        assert_eq!(read(&scale, png(grey_alpha)), "#.?");
        // Percent: 65 and up is occupied, 19.6 and less is free, above 100 unknown.
        let raw = format!("{yaml}mode: raw\n");
        assert_eq!(read(&raw, png(GrayImage::from_vec(6, 1, vec![0, 19, 20, 65, 100, 101]).unwrap())), "..?##?");
    }

    #[test]
    fn a_wrong_description_is_refused_with_its_reason() {
        let picture = b"P5 1 1 255 \x00";
        assert!(read_files(YAML, "map.pgm", picture).is_ok());
        for (from, to, reason) in [
            ("resolution: 0.1\n", "", "missing field `resolution`"),
            ("resolution: 0.1", "resolution: 0", "its cells are 0 m wide"),
            ("resolution: 0.1", "resolution: .nan", "its cells are NaN m wide"),
            ("resolution: 0.1", "resolution: fine", "resolution"),
            ("[1.0, -2.0, 0.5]", "[1.0, -2.0]", "3"),
            ("[1.0, -2.0, 0.5]", "[1.0, -.inf, 0.5]", "origin holds -inf"),
            ("free_thresh: 0.196", "free_thresh: 0.7", "free_thresh 0.7"),
            ("occupied_thresh: 0.65", "occupied_thresh: 65", "occupied_thresh is 65"),
            ("negate: 0", "mode: quaternary", "quaternary"),
            ("image: map.pgm", "image: [", "map.yaml"),
            ("image: map.pgm", "image: none.pgm", "none.pgm: cannot be read"),
        ] {
            assert!(YAML.contains(from), "{from}");
            let error = read_files(&YAML.replace(from, to), "map.pgm", picture).unwrap_err().to_string();
            assert!(
                error.contains(reason) && error.contains(".yaml") | error.contains(".pgm"),
                "{error:?}: {reason:?}"
            );
        }
        for text in ["", "no map", "\u{0}\u{1}\u{2}", &"[".repeat(100_000), &"#".repeat(2_000_000)] {
            let error = read_files(text, "map.pgm", picture).unwrap_err().to_string();
            assert!(error.contains("no map as ROS's map_server reads it"), "{error}");
        }
    }

    #[test]
    fn a_wrong_picture_is_refused_with_its_reason() {
        let cut = &png(GrayImage::from_vec(9, 9, (0..81).collect()).unwrap())[..70];
        let cases: [(&[u8], &str); 7] = [
            (b"", "it is something else"),
            (b"GIF89a", "it is something else"),
            (b"P5\n", "picture cannot be read"),
            (b"P5 4 4 255 \x00\x00", "picture cannot be read"),
            (b"P5 100000 100000 255 \x00", "100000 x 100000 pixels, more than"),
            (b"P2 2 1 255 0 x", "picture cannot be read"),
            (cut, "picture cannot be read"),
        ];
        for (picture, reason) in cases {
            let error = read_files(YAML, "map.pgm", picture).unwrap_err().to_string();
            assert!(error.contains(reason) && error.contains("map.pgm"), "{error:?} says {reason:?}");
        }
    }

    /// Nav2's saver: unknown cells as 205, and `free_thresh: 0.25`.
    #[test]
    fn what_nav2_saved_as_unknown_is_unknown() {
        let picture = b"P5\n4 1\n255\n\x00\xcd\xfe\xc0";
        let yaml = YAML.replace("free_thresh: 0.196", "free_thresh: 0.25");
        assert_eq!(letters(&read_files(&yaml, "map.pgm", picture).unwrap()), "#?..");
    }

    #[test]
    fn what_is_odd_is_read_with_a_warning() {
        let folder = tempfile::tempdir().unwrap();
        let yaml = folder.path().join("map.yaml");
        let read_with = |text: &str, name: &str, picture: &[u8]| {
            std::fs::write(&yaml, text).unwrap();
            std::fs::write(folder.path().join(name), picture).unwrap();
            read(&yaml).unwrap()
        };
        let picture = b"P5\n2 1\n255\n\x00\xfe";
        let plain = read_with(YAML, "map.pgm", picture);
        assert_eq!((letters(&plain.grid).as_str(), plain.warnings.len()), ("#.", 0));
        let elsewhere = read_with(&YAML.replace("map.pgm", "/no/such/folder/map.pgm"), "map.pgm", picture);
        assert_eq!(elsewhere.grid, plain.grid);
        assert!(elsewhere.warnings[0].contains("/no/such/folder/map.pgm is not there"), "{:?}", elsewhere.warnings);
        for nan in ["nan", ".nan"] {
            let found = read_with(&YAML.replace("0.5]", &format!("{nan}]")), "map.pgm", picture);
            assert_eq!(found.grid.world_from_grid(), Pose::new(1.0, -2.0, 0.0));
            assert!(found.warnings[0].contains("yaw"), "{:?}", found.warnings);
        }
        let misspelt = read_with(&YAML.replace("free_thresh", "free_tresh"), "map.pgm", picture);
        assert!(misspelt.warnings[0].contains("the key \"free_tresh\" was left out"), "{:?}", misspelt.warnings);
        let percent = read_with(YAML, "map.pgm", b"P5\n3 1\n255\n\x00\x64\xff");
        assert!(percent.warnings[0].contains("mode: raw"), "{:?}", percent.warnings);
        let mut bmp = std::io::Cursor::new(Vec::new());
        GrayImage::from_raw(2, 1, vec![0, 254]).unwrap().write_to(&mut bmp, ImageFormat::Bmp).unwrap();
        assert_eq!(read_with(&YAML.replace("map.pgm", "map.bmp"), "map.bmp", &bmp.into_inner()).grid, plain.grid);
        let far = read_files(&YAML.replace("1.0,", "1e308,"), "map.pgm", picture).unwrap_err().to_string();
        assert!(far.contains("origin holds 1e308"), "{far}");
    }
}
