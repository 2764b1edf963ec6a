//! `detections.csv`: one detection a row; rows of one stamp are a frame.

use super::invalid;
use crate::detections::{Detection, Detection3, Frame};
use crate::geometry::wrap_angle;
use crate::io::table::{Layout, Row, quoted, read_table};
use crate::log::LogError;
use std::f64::consts::TAU;
use std::io::Write;
use std::ops::Range;
use std::path::Path;

const STAMP: usize = 0;
const CLASS: usize = 1;
const RANGE: usize = 2;
const BEARING: usize = 3;
const SCORE: usize = 4;
const LAYOUT: Layout = Layout { required: &["t", "class", "range", "bearing"], optional: &["score"] };
const EXPECTED: &str = "detections have the columns t,class,score,range,bearing (s, name, 0 to 1, m, rad)";
const U: usize = 2;
const SCORE3: usize = 5;
const LAYOUT3: Layout = Layout { required: &["t", "class", "u", "v", "disparity"], optional: &["score"] };
const EXPECTED3: &str =
    "detections have the columns t,class,score,u,v,disparity (s, name, 0 to 1, pixels, pixels, pixels)";

/// Frames, and the names of columns that were left out.
pub(super) fn read(path: &Path, classes: &[String]) -> Result<(Vec<Frame>, Vec<String>), LogError> {
    read_frames(path, LAYOUT, EXPECTED, |row| detection(row, classes))
}

/// The same of a robot of space.
pub(super) fn read3(path: &Path, classes: &[String]) -> Result<(Vec<Frame<Detection3>>, Vec<String>), LogError> {
    read_frames(path, LAYOUT3, EXPECTED3, |row| detection3(row, classes))
}

fn read_frames<D>(
    path: &Path,
    layout: Layout,
    expected: &'static str,
    detection: impl Fn(&Row) -> Result<Option<D>, String>,
) -> Result<(Vec<Frame<D>>, Vec<String>), LogError> {
    let mut frames: Vec<Frame<D>> = Vec::new();
    let unknown = read_table(path, &[layout], expected, |_, row| {
        let stamp = row.number(STAMP)?;
        let detection = detection(row)?;
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
        return Err(LogError::NotThisFormat { path: path.to_owned(), reason, expected });
    }
    Ok((frames, unknown))
}

/// Class and score; `None` where the frame saw nothing. `numbers` are the columns of what was measured, and `score` that of
/// the score.
fn label(row: &Row, classes: &[String], numbers: Range<usize>, score: usize) -> Result<Option<(usize, f64)>, String> {
    let label = row.text(CLASS);
    if label.is_empty() {
        return match numbers.chain([score]).all(|column| row.text(column).is_empty()) {
            true => Ok(None),
            false => Err(
                "class is empty; name it, or leave score and what was measured empty too, which tells of a frame that \
                     saw nothing"
                    .to_owned(),
            ),
        };
    }
    let class = classes.iter().position(|name| name == label).ok_or_else(|| {
        let known: String = classes.join(", ").chars().take(200).collect();
        format!("class is `{label:.60}`, which sensors.toml does not name; add it to `classes` there ({known})")
    })?;
    let score = row.number_or_empty(score)?.unwrap_or(1.0);
    if !(0.0..=1.0).contains(&score) {
        return Err(format!("score is {score}; scale scores to 0 ... 1, or leave them empty"));
    }
    Ok(Some((class, score)))
}

fn detection(row: &Row, classes: &[String]) -> Result<Option<Detection>, String> {
    let Some((class, score)) = label(row, classes, RANGE..SCORE, SCORE)? else { return Ok(None) };
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

fn detection3(row: &Row, classes: &[String]) -> Result<Option<Detection3>, String> {
    let Some((class, score)) = label(row, classes, U..SCORE3, SCORE3)? else { return Ok(None) };
    let (pixel, disparity) = ([row.number(U)?, row.number(U + 1)?], row.number(U + 2)?);
    if disparity <= 0.0 {
        return Err(format!(
            "disparity is {disparity}; what is ahead of a camera has one above 0, and other rows are left out"
        ));
    }
    Ok(Some(Detection3 { class, score, pixel, disparity }))
}

pub(super) fn write(frames: &[Frame], classes: &[String], out: impl Write) -> std::io::Result<()> {
    write_frames(frames, classes, "range,bearing", out, |seen| (seen.class, seen.score, vec![seen.range, seen.bearing]))
}

/// The same of a robot of space.
pub(super) fn write3(frames: &[Frame<Detection3>], classes: &[String], out: impl Write) -> std::io::Result<()> {
    let row =
        |&Detection3 { class, score, pixel: [u, v], disparity }: &Detection3| (class, score, vec![u, v, disparity]);
    write_frames(frames, classes, "u,v,disparity", out, row)
}

fn write_frames<D>(
    frames: &[Frame<D>],
    classes: &[String],
    numbers: &str,
    mut out: impl Write,
    row: impl Fn(&D) -> (usize, f64, Vec<f64>),
) -> std::io::Result<()> {
    writeln!(out, "t,class,score,{numbers}")?;
    for Frame { stamp, detections } in frames {
        if detections.is_empty() {
            writeln!(out, "{stamp},,{}", ",".repeat(numbers.split(',').count()))?;
        }
        for (class, score, numbers) in detections.iter().map(&row) {
            let name = classes.get(class).ok_or_else(|| invalid(format!("there is no class number {class}")))?;
            let numbers: Vec<String> = numbers.iter().map(f64::to_string).collect();
            writeln!(out, "{stamp},{},{score},{}", quoted(name), numbers.join(","))?;
        }
    }
    Ok(())
}
