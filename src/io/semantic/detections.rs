//! `detections.csv`: one detection a row; rows of one stamp are a frame.

use super::invalid;
use crate::detections::{Detection, Frame};
use crate::geometry::wrap_angle;
use crate::io::table::{Layout, Row, quoted, read_table};
use crate::log::LogError;
use std::f64::consts::TAU;
use std::io::Write;
use std::path::Path;

const LAYOUT: Layout = Layout { required: &["t", "class", "range", "bearing"], optional: &["score"] };
const STAMP: usize = 0;
const CLASS: usize = 1;
const RANGE: usize = 2;
const BEARING: usize = 3;
const SCORE: usize = 4;
const EXPECTED: &str = "detections have the columns t,class,score,range,bearing (s, name, 0 to 1, m, rad)";

/// Frames, and the names of columns that were left out.
pub(super) fn read(path: &Path, classes: &[String]) -> Result<(Vec<Frame>, Vec<String>), LogError> {
    let mut frames: Vec<Frame> = Vec::new();
    let unknown = read_table(path, &[LAYOUT], EXPECTED, |_, row| {
        let stamp = row.number(STAMP)?;
        let detection = detection(row, classes)?;
        match frames.last_mut() {
            Some(Frame { stamp: last, .. }) if stamp < *last => {
                Err(format!("its stamp, {stamp}, lies before that of the row above, {last}; sort the rows by t"))
            }
            Some(frame) if stamp == frame.stamp => match detection {
                Some(detection) if !frame.detections.is_empty() => {
                    frame.detections.push(detection);
                    Ok(())
                }
                _ => Err(format!(
                    "a row without a class tells of a frame that saw nothing, but {stamp} has more rows; leave it out"
                )),
            },
            _ => {
                frames.push(Frame { stamp, detections: Vec::from_iter(detection) });
                Ok(())
            }
        }
    })?;
    if frames.is_empty() {
        let reason = "it holds no row besides the header".to_owned();
        return Err(LogError::NotThisFormat { path: path.to_owned(), reason, expected: EXPECTED });
    }
    Ok((frames, unknown))
}

/// `None` where the frame saw nothing.
fn detection(row: &Row, classes: &[String]) -> Result<Option<Detection>, String> {
    let label = row.text(CLASS);
    if label.is_empty() {
        return match [RANGE, BEARING, SCORE].into_iter().all(|column| row.text(column).is_empty()) {
            true => Ok(None),
            false => {
                Err("class is empty; name it, or leave score, range and bearing empty too, which tells of a frame \
                          that saw nothing"
                    .to_owned())
            }
        };
    }
    let class = classes.iter().position(|name| name == label).ok_or_else(|| {
        let known: String = classes.join(", ").chars().take(200).collect();
        format!("class is `{label:.60}`, which sensors.toml does not name; add it to `classes` there ({known})")
    })?;
    let score = row.number_or_empty(SCORE)?.unwrap_or(1.0);
    if !(0.0..=1.0).contains(&score) {
        return Err(format!("score is {score}; scale scores to 0 ... 1, or leave them empty"));
    }
    let range = row.number(RANGE)?;
    if range <= 0.0 {
        return Err(format!("range is {range}; a detection has a range above 0 m, and a row without one is left out"));
    }
    let bearing = row.number(BEARING)?;
    if bearing.abs() > TAU {
        return Err(format!("bearing is {bearing}, more than a full turn; bearings are in radians, not degrees"));
    }
    Ok(Some(Detection { class, score, range, bearing: wrap_angle(bearing) }))
}

pub(super) fn write(frames: &[Frame], classes: &[String], mut out: impl Write) -> std::io::Result<()> {
    writeln!(out, "t,class,score,range,bearing")?;
    for Frame { stamp, detections } in frames {
        if detections.is_empty() {
            writeln!(out, "{stamp},,,,")?;
        }
        for Detection { class, score, range, bearing } in detections {
            let name = classes.get(*class).ok_or_else(|| invalid(format!("there is no class number {class}")))?;
            writeln!(out, "{stamp},{},{score},{range},{bearing}", quoted(name))?;
        }
    }
    Ok(())
}
