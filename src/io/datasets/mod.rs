//! Published recordings of landmarks, made recordings of detections ([`semantic`]).
//!
//! These sets hold which landmark a detection is; it goes to a file of its own, and only the class is left. Where
//! the set has no classes, they are made up: landmarks take turns in the order of their numbers, and labels are wrong
//! at random.

use super::WriteError;
use super::semantic::{self, truth};
use super::tum;
use crate::detections::{Detection, Frame, Recording, Recording3, Sensors};
use crate::geometry::{StampedPose, StampedPose3, wrap_angle};
use crate::log::LogError;
use crate::parameters::{ConfigError, check};
use crate::random::{self, Draw};
use std::path::Path;
use truth::{Ids, TrueLandmark};

mod dlr;
pub mod imu_tracks;
mod kitti_odometry;
mod kitti_tracking;
mod lost_in_woods;
mod mrclam;
mod starry_night;
mod stata_objects;
mod tum_office;
mod victoria_park;

/// A set that is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Dataset {
    /// UTIAS MR.CLAM: five robots among barcoded tubes (Leung, Halpern, Barfoot, Liu, IJRR 30(8), 2011).
    MrClam,
    /// UTIAS "Lost in the Woods": a robot with a laser among tubes (Barfoot, State Estimation for Robotics).
    LostInWoods,
    /// A truck among trees (Guivant, Nebot, 2001), in the form of GTSAM.
    VictoriaPark,
    /// DLR Spatial Cognition: a robot with a camera among discs on the floor (Kurlbaum, Frese, 2007).
    Dlr,
}

/// A set of a robot of space that is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Dataset3 {
    /// "Starry Night": a rig of two cameras over points of light (Barfoot, State Estimation for Robotics).
    StarryNight,
    /// KITTI tracking: a car among cars, with boxes of a detector (Geiger, Lenz, Urtasun, CVPR 2012).
    KittiTracking,
    /// The way of KITTI odometry with parked cars, boxes and odometry that are simulated: semi-synthetic.
    KittiOdometry,
    /// "SLAM with objects": a camera with depth among furniture (Mu, Liu, Paull, Leonard, How, IROS 2016).
    StataObjects,
    /// An office of TUM RGB-D: a camera by hand among things on desks, with simulated odometry (Sturm et al., IROS 2012).
    TumOffice,
}

/// What is chosen of a set; what is not is as the set is known best.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// Which robot or drive, where there are several.
    pub robot: Option<u32>,
    /// How many classes the landmarks have.
    pub classes: Option<usize>,
    /// Share of wrong labels.
    pub wrong_labels: Option<f64>,
    /// Seed of what is drawn, wrong labels for one; 1 by default.
    pub seed: Option<u64>,
    /// The first and the last row that is used, where rows can be chosen; all by default.
    pub rows: Option<(usize, usize)>,
}

/// A set as a recording, and the truth about it.
#[derive(Clone, Debug, PartialEq)]
pub struct Converted<R = Recording, P = StampedPose, const D: usize = 2> {
    /// What the robot knew.
    pub recording: R,
    /// Which landmark each detection is.
    pub ids: Ids,
    /// Where the robot was; empty where nobody knows.
    pub trajectory: Vec<P>,
    /// Where the landmarks are; empty where nobody knows.
    pub landmarks: Vec<TrueLandmark<D>>,
    /// What was left out, one sentence each.
    pub notes: Vec<String>,
}

/// The same of a robot of space.
pub type Converted3 = Converted<Recording3, StampedPose3, 3>;

/// Why a set cannot be converted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConvertError {
    /// A file of it cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// An option cannot be.
    #[error(transparent)]
    Option(#[from] ConfigError),
}

/// Which set is in a folder, by its files.
pub fn recognise(folder: &Path) -> Option<Dataset> {
    let has = |name: &str| folder.join(name).is_file();
    if has("landmarks.csv") && has("range_bearing.csv") && has("odometry_truth.csv") && has("parameters.txt") {
        return Some(Dataset::LostInWoods);
    }
    if has("map.circles") {
        return Some(Dataset::Dlr);
    }
    if has("victoria_park.txt") {
        return Some(Dataset::VictoriaPark);
    }
    (!mrclam::robots(folder).is_empty()).then_some(Dataset::MrClam)
}

/// Which set of a robot of space is in a folder, by its files.
pub fn recognise3(folder: &Path) -> Option<Dataset3> {
    let has = |name: &str| folder.join(name).is_file();
    if has("stereo.csv") && has("calibration.txt") && has("odometry.csv") {
        return Some(Dataset3::StarryNight);
    }
    if has("det2d_rrc_car.csv") && has("calib.txt") {
        return Some(Dataset3::KittiTracking);
    }
    if has("detections_3d.csv") && has("frames.csv") {
        return Some(Dataset3::StataObjects);
    }
    if has("detections.csv") && has("groundtruth.txt") && has("frames.csv") {
        return Some(Dataset3::TumOffice);
    }
    (has("05.txt") && has("05_times.txt")).then_some(Dataset3::KittiOdometry)
}

impl Dataset3 {
    /// Reads the set in a folder.
    ///
    /// # Errors
    /// As for [`Dataset::read`].
    pub fn read(self, folder: &Path, options: &Options) -> Result<Converted3, ConvertError> {
        if options.rows.is_some() && self != Self::StarryNight {
            return Err(ConfigError::value("--rows", "given", "left out, as all of this set is used").into());
        }
        let classes = options.classes.filter(|classes| *classes != 1 && self != Self::StarryNight);
        if let Some(classes) = classes {
            return Err(
                ConfigError::value("--classes", classes, "left out, as the classes of this set are known").into()
            );
        }
        if self != Self::KittiOdometry {
            refuse_robot(options)?;
        }
        Ok(match self {
            Self::StarryNight => starry_night::read(folder, &Labels::new("point", 1, options)?, options.rows)?,
            Self::KittiTracking => kitti_tracking::read(folder)?,
            Self::KittiOdometry => kitti_odometry::read(folder, options.robot.unwrap_or(6), options)?,
            Self::StataObjects => stata_objects::read(folder, options)?,
            Self::TumOffice => tum_office::read(folder, options)?,
        })
    }
}

fn refuse_robot(options: &Options) -> Result<(), ConfigError> {
    let expected = "left out, as this set has one robot";
    options.robot.map_or(Ok(()), |robot| Err(ConfigError::value("--robot", robot, expected)))
}

impl Dataset {
    /// Reads the set in a folder.
    ///
    /// # Errors
    /// A file is missing or cannot be read, a line of it is wrong, or an option does not fit the set.
    pub fn read(self, folder: &Path, options: &Options) -> Result<Converted, ConvertError> {
        if self != Self::MrClam {
            refuse_robot(options)?;
        }
        if options.rows.is_some() {
            return Err(ConfigError::value("--rows", "given", "left out, as all of this set is used").into());
        }
        let labels = self.labels(options)?;
        match self {
            Self::MrClam => mrclam::read(folder, options.robot, &labels),
            Self::LostInWoods => Ok(lost_in_woods::read(folder, &labels)?),
            Self::VictoriaPark => Ok(victoria_park::read(folder, &labels)?),
            Self::Dlr => Ok(dlr::read(folder, &labels)?),
        }
    }

    fn labels(self, options: &Options) -> Result<Labels, ConfigError> {
        let (object, usual) = match self {
            Self::MrClam => ("tube", 3),
            Self::LostInWoods => ("tube", 1),
            Self::VictoriaPark => ("tree", 1),
            Self::Dlr => ("disc", 1),
        };
        let labels = Labels::new(object, usual, options)?;
        if self == Self::Dlr && labels.classes > 1 {
            let expected = "1, as the set does not tell for every detection which disc it is";
            return Err(ConfigError::value("--classes", labels.classes, expected));
        }
        Ok(labels)
    }
}

const MAX_CLASSES: f64 = 1000.0;
/// Share of wrong labels, where nothing else is asked for.
const WRONG_LABELS: f64 = 0.1;
/// Lowest error rate of labels in `sensors.toml`: at zero, a single wrong label would have no probability at all.
const MOST_ACCURATE: f64 = 0.99;

/// Classes that are made up.
struct Labels {
    object: &'static str,
    classes: usize,
    wrong: f64,
    seed: u64,
}

impl Labels {
    /// The labels of objects that usually have so many classes.
    fn new(object: &'static str, usual: usize, options: &Options) -> Result<Self, ConfigError> {
        let classes = options.classes.unwrap_or(usual);
        check("--classes", classes, 1.0..=MAX_CLASSES)?;
        let wrong = options.wrong_labels.unwrap_or(if classes > 1 { WRONG_LABELS } else { 0.0 });
        check("--wrong-labels", wrong, 0.0..=1.0)?;
        if wrong > 0.0 && classes == 1 {
            return Err(ConfigError::value("--wrong-labels", wrong, "0 where there is one class (see --classes)"));
        }
        Ok(Self { object, classes, wrong, seed: options.seed.unwrap_or(1) })
    }

    /// The names of the classes, and how often a label is right.
    fn named(&self) -> (Vec<String>, f64) {
        let names = match self.classes {
            1 => vec![self.object.to_owned()],
            classes => (1..=classes).map(|number| format!("{}-{number}", self.object)).collect(),
        };
        (names, (1.0 - self.wrong).min(MOST_ACCURATE))
    }

    fn sensors(&self) -> Sensors {
        let (names, accuracy) = self.named();
        Sensors::new(names, accuracy)
    }

    /// The class of a landmark; its number counts from 0.
    fn class_of(&self, landmark: usize) -> usize {
        landmark % self.classes
    }

    /// The class that a detector names: another than the true one with the probability of wrong labels.
    fn label(&self, class: usize, frame: usize, number: usize) -> usize {
        let [error, other, ..] = random::bits(self.seed, frame as u32, number as u32, Draw::Label).map(random::uniform);
        if f64::from(error) >= self.wrong || self.classes < 2 {
            return class;
        }
        let other = (f64::from(other) * (self.classes - 1) as f64) as usize;
        (class + 1 + other) % self.classes
    }

    /// Frames in the order of their stamps, and the ids of their detections. Detections of a frame are sorted by
    /// bearing, so that their order does not reveal the landmarks.
    fn frames(&self, sightings: Vec<(f64, Vec<Sighting>)>) -> (Vec<Frame>, Ids) {
        let label_frame = |(frame, (stamp, mut seen)): (usize, (f64, Vec<Sighting>))| {
            seen.sort_by(|a, b| a.bearing.total_cmp(&b.bearing));
            let detect = |(number, sighting): (usize, &Sighting)| Detection {
                class: self.label(sighting.landmark.map_or(0, |landmark| self.class_of(landmark)), frame, number),
                score: sighting.score,
                range: sighting.range,
                bearing: wrap_angle(sighting.bearing),
            };
            let detections = seen.iter().enumerate().map(detect).collect();
            (Frame { stamp, detections }, seen.iter().map(|sighting| sighting.id).collect::<Vec<_>>())
        };
        sightings.into_iter().enumerate().map(label_frame).unzip()
    }
}

/// A landmark, seen.
#[derive(Clone)]
struct Sighting {
    /// Its name in the set.
    id: Option<u64>,
    /// Its number from 0, which gives its class.
    landmark: Option<usize>,
    score: f64,
    range: f64,
    bearing: f64,
}

/// Writes a recording and what is true about it into a folder.
///
/// # Errors
/// A file cannot be written.
pub fn write(folder: &Path, converted: &Converted) -> Result<(), WriteError> {
    let Converted { recording, ids, trajectory, landmarks, .. } = converted;
    std::fs::create_dir_all(folder).map_err(|source| WriteError { path: folder.to_owned(), source })?;
    truth::write_ids(&folder.join(truth::IDS), &recording.frames, ids)?;
    if !trajectory.is_empty() {
        tum::write(&folder.join(truth::TRAJECTORY), trajectory)?;
    }
    if !landmarks.is_empty() {
        truth::write_landmarks(&folder.join(truth::LANDMARKS), landmarks, &recording.sensors.classes)?;
    }
    semantic::write(folder, recording)
}

/// The same of a robot of space.
///
/// # Errors
/// As for [`write()`].
pub fn write3(folder: &Path, converted: &Converted3) -> Result<(), WriteError> {
    let Converted { recording, ids, trajectory, landmarks, .. } = converted;
    std::fs::create_dir_all(folder).map_err(|source| WriteError { path: folder.to_owned(), source })?;
    truth::write_ids(&folder.join(truth::IDS), &recording.frames, ids)?;
    if !trajectory.is_empty() {
        tum::write3(&folder.join(truth::TRAJECTORY), trajectory)?;
    }
    if !landmarks.is_empty() {
        truth::write_landmarks(&folder.join(truth::LANDMARKS), landmarks, &recording.sensors.classes)?;
    }
    semantic::write3(folder, recording)
}

/// Words that are finite numbers.
fn numbers<'a>(words: impl Iterator<Item = &'a str>) -> Result<Vec<f64>, String> {
    let number = |word: &str| word.parse().ok().filter(|number: &f64| number.is_finite());
    words.map(|word| number(word).ok_or_else(|| format!("`{word:.30}` is not a number"))).collect()
}
