//! Rows of numbers by their times, sent and read back; and the texts and lines that a chunk holds.

use super::blueprint;
use crate::geometry::Pose;
use ::rerun::components::{LineStrip2D, Scalar, Text};
use ::rerun::log::Chunk;
use ::rerun::{LineStrips2D, RecordingStream, RecordingStreamResult, Scalars, TextDocument, TimeColumn, TimelineName};
use nalgebra::Point2;
use std::collections::BTreeMap;

/// Rows of numbers to send, of any length each.
#[derive(Default)]
pub(super) struct Rows {
    numbers: Vec<f64>,
    lengths: Vec<usize>,
    entries: Vec<i64>,
}

impl Rows {
    pub(super) fn push(&mut self, entry: i64, numbers: impl IntoIterator<Item = f64>) {
        let before = self.numbers.len();
        self.numbers.extend(numbers);
        self.lengths.push(self.numbers.len() - before);
        self.entries.push(entry);
    }

    pub(super) fn send(&mut self, stream: &RecordingStream, path: &str) -> RecordingStreamResult<()> {
        let Self { numbers, lengths, entries } = std::mem::take(self);
        if entries.is_empty() {
            return Ok(());
        }
        let columns = Scalars::new(numbers).columns(lengths)?;
        stream.send_columns(path, [TimeColumn::new_sequence(blueprint::ENTRY_TIMELINE, entries)], columns)
    }
}

/// The text that a chunk holds, if it is of this path.
pub(super) fn text(chunk: &Chunk, path: &str) -> Option<String> {
    if *chunk.entity_path() != path.into() {
        return None;
    }
    let texts = chunk.iter_component::<Text>(TextDocument::descriptor_text().component).next()?;
    texts.as_slice().first().map(|text| text.as_str().to_owned())
}

/// The corners of the first line that a chunk holds, if it is of this path.
pub(super) fn positions(chunk: &Chunk, path: &str) -> Option<Vec<Point2<f64>>> {
    if chunk.is_static() || *chunk.entity_path() != path.into() {
        return None;
    }
    let strips = chunk.iter_component::<LineStrip2D>(LineStrips2D::descriptor_strips().component).next()?;
    let corners = strips.as_slice().first()?.0.iter();
    Some(corners.map(|corner| Point2::new(f64::from(corner.x()), f64::from(corner.y()))).collect())
}

/// The rows of numbers that a chunk holds, each with its time on a timeline.
pub(super) fn rows(chunk: &Chunk, timeline: &'static str) -> Vec<(i64, Vec<f64>)> {
    let component = Scalars::descriptor_scalars().component;
    let times = chunk.iter_component_indices(TimelineName::from(timeline), component);
    let numbers = chunk.iter_component::<Scalar>(component);
    let row = |numbers: &[Scalar]| numbers.iter().map(|number| number.0.0).collect();
    times.zip(numbers).map(|((time, _), numbers)| (time.as_i64(), row(numbers.as_slice()))).collect()
}

/// Rows of numbers that were read, by path and then by time.
pub(super) struct Numbers {
    /// Paths to keep, each with the timeline of its rows.
    paths: &'static [(&'static str, &'static str)],
    rows: BTreeMap<&'static str, BTreeMap<i64, Vec<f64>>>,
}

impl Numbers {
    pub(super) const fn new(paths: &'static [(&'static str, &'static str)]) -> Self {
        Self { paths, rows: BTreeMap::new() }
    }

    /// Keeps what a chunk holds of these paths.
    pub(super) fn add(&mut self, chunk: &Chunk) {
        let is_of = |(path, _): &&(&str, &str)| *chunk.entity_path() == (*path).into();
        if let Some((path, timeline)) = self.paths.iter().find(is_of)
            && !chunk.is_static()
        {
            self.rows.entry(path).or_default().extend(rows(chunk, timeline));
        }
    }

    /// The rows of a path, in the order of their times.
    pub(super) fn rows<'a>(&'a self, path: &str) -> impl DoubleEndedIterator<Item = (i64, &'a [f64])> + use<'a> {
        self.rows.get(path).into_iter().flatten().map(|(&time, row)| (time, row.as_slice()))
    }

    pub(super) fn at(&self, path: &str, time: i64) -> Option<&[f64]> {
        self.rows.get(path)?.get(&time).map(Vec::as_slice)
    }
}

/// A pose as it was: its heading is not wrapped again.
pub(super) fn exactly(x: f64, y: f64, heading: f64) -> Pose {
    Pose { x, y, heading }
}
