//! What is known about a recording besides what the robot knew: for scores, never for mapping.
//!
//! - `ids.csv`: `t,number,id`, which object a detection is; `number` counts the detections of a frame from 0, and
//!   `id` is empty where nobody knows.
//! - `truth_landmarks.csv`: `id,class,x,y`, in space also `z`, where the objects stand.
//! - `truth.tum`: where the robot was ([`tum`](crate::io::tum)), in the frame of the objects.

use super::invalid;
use crate::detections::Frame;
use crate::io::table::{Layout, quoted, read_table};
use crate::io::{WriteError, write_whole};
use crate::log::LogError;
use nalgebra::Point;
use std::collections::HashMap;
use std::path::Path;

/// The file of [`read_ids`].
pub const IDS: &str = "ids.csv";
/// The file of [`read_landmarks`].
pub const LANDMARKS: &str = "truth_landmarks.csv";
/// True poses.
pub const TRAJECTORY: &str = "truth.tum";

/// For each frame, which object each detection is; `None` where nobody knows.
pub type Ids = Vec<Vec<Option<u64>>>;

/// An object as it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueLandmark<const D: usize = 2> {
    /// The name that [`Ids`] use.
    pub id: u64,
    /// Number of its class, in the list of the recording.
    pub class: usize,
    /// In the frame of the true poses \[m\].
    pub position: Point<f64, D>,
}

/// Reads which object each detection is.
///
/// # Errors
/// The file cannot be read, one of its lines is wrong, or it names a detection that the recording does not have.
pub fn read_ids<D>(path: &Path, frames: &[Frame<D>]) -> Result<Ids, LogError> {
    const LAYOUT: Layout = Layout { required: &["t", "number", "id"], optional: &[] };
    let mut ids: Ids = frames.iter().map(|frame| vec![None; frame.detections.len()]).collect();
    let frames: HashMap<u64, usize> =
        frames.iter().enumerate().map(|(number, frame)| (frame.stamp.to_bits(), number)).collect();
    read_table(path, &[LAYOUT], "true ids have the columns t,number,id", |_, row| {
        let (stamp, number) = (row.number(0)?, row.count::<usize>(1)?);
        let id = if row.text(2).is_empty() { None } else { Some(row.count(2)?) };
        let frame = frames.get(&stamp.to_bits()).and_then(|&frame| ids.get_mut(frame));
        let detection = frame.and_then(|frame| frame.get_mut(number));
        let missing =
            || format!("detection {number} of the frame at {stamp} is not in the recording; is this file of it?");
        *detection.ok_or_else(missing)? = id;
        Ok(())
    })?;
    Ok(ids)
}

/// Writes which object each detection is.
///
/// # Errors
/// The file cannot be written.
pub fn write_ids<D>(path: &Path, frames: &[Frame<D>], ids: &Ids) -> Result<(), WriteError> {
    write_whole(path, |file| {
        writeln!(file, "t,number,id")?;
        for (Frame { stamp, .. }, ids) in frames.iter().zip(ids) {
            for (number, id) in ids.iter().enumerate() {
                writeln!(file, "{stamp},{number},{}", id.map_or_else(String::new, |id| id.to_string()))?;
            }
        }
        Ok(())
    })
}

/// Reads where the objects stand; `classes` are those of the recording.
///
/// # Errors
/// The file cannot be read, or one of its lines is wrong.
pub fn read_landmarks(path: &Path, classes: &[String]) -> Result<Vec<TrueLandmark>, LogError> {
    const LAYOUT: Layout = Layout { required: &["id", "class", "x", "y"], optional: &[] };
    let mut landmarks = Vec::new();
    read_table(path, &[LAYOUT], "true landmarks have the columns id,class,x,y (m)", |_, row| {
        let label = row.text(1);
        let class = classes.iter().position(|name| name == label);
        let class = class.ok_or_else(|| format!("class is `{label:.60}`, which sensors.toml does not name"))?;
        let position = Point::<f64, 2>::new(row.number(2)?, row.number(3)?);
        landmarks.push(TrueLandmark { id: row.count(0)?, class, position });
        Ok(())
    })?;
    Ok(landmarks)
}

/// Writes where the objects stand.
///
/// # Errors
/// The file cannot be written, or an object is of no class.
pub fn write_landmarks<const D: usize>(
    path: &Path,
    landmarks: &[TrueLandmark<D>],
    classes: &[String],
) -> Result<(), WriteError> {
    write_whole(path, |file| {
        writeln!(file, "id,class,{}", ["x", "y", "z"][..D].join(","))?;
        for TrueLandmark { id, class, position } in landmarks {
            let name = classes.get(*class).ok_or_else(|| invalid(format!("there is no class number {class}")))?;
            let position: Vec<String> = position.iter().map(f64::to_string).collect();
            writeln!(file, "{id},{},{}", quoted(name), position.join(","))?;
        }
        Ok(())
    })
}
