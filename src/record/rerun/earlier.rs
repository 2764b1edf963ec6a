//! The map of an earlier drive in the recording of a run that continues it, to the last bit.

use super::blueprint;
use super::rows::{Numbers, Rows, exactly};
use crate::geometry::Pose;
use crate::grid::FreeArea;
use crate::map::LineMap;
use crate::ppca::Cluster;
use ::rerun::{RecordingStream, RecordingStreamResult};
use nalgebra::{Point2, Vector2};

/// Sends a map.
pub(super) fn send(map: &LineMap, stream: &RecordingStream, root: &str) -> RecordingStreamResult<()> {
    let mut walls = Rows::default();
    for (number, Cluster { mean, direction, along_variance, across_variance, count }) in (0..).zip(&map.clusters) {
        walls.push(number, [mean.x, mean.y, direction.x, direction.y, *along_variance, *across_variance, *count]);
    }
    walls.send(stream, &blueprint::under(root, blueprint::EARLIER_WALLS))?;
    let Some(free) = &map.free else { return Ok(()) };
    let mut rows = Rows::default();
    let Pose { x, y, heading } = free.world_from_grid();
    rows.push(0, [free.cell_size(), x, y, heading]);
    for (row, runs) in (0..).zip(free.rows()).filter(|(_, runs)| !runs.is_empty()) {
        let ends = runs.into_iter().flatten().map(f64::from);
        rows.push(row + 1, std::iter::once(row as f64).chain(ends));
    }
    rows.send(stream, &blueprint::under(root, blueprint::EARLIER_FREE))
}

/// The map that was sent; `None` if it is not whole.
pub(super) fn map(numbers: &Numbers) -> Option<LineMap> {
    let wall = |(_, row): (i64, &[f64])| {
        let &[x, y, direction_x, direction_y, along_variance, across_variance, count] = row.as_array()?;
        row.iter().all(|number| number.is_finite()).then_some(())?;
        let (mean, direction) = (Point2::new(x, y), Vector2::new(direction_x, direction_y));
        Some(Cluster { mean, direction, along_variance, across_variance, count })
    };
    let clusters: Vec<Cluster> = numbers.rows(blueprint::EARLIER_WALLS).map(wall).collect::<Option<_>>()?;
    let mut rows = numbers.rows(blueprint::EARLIER_FREE).map(|(_, row)| row);
    let free = match rows.next() {
        Some(head) => Some(free(head, rows)?),
        None => None,
    };
    (!clusters.is_empty()).then_some(LineMap { clusters, free })
}

fn free<'a>(head: &[f64], rows: impl Iterator<Item = &'a [f64]>) -> Option<FreeArea> {
    let &[cell, x, y, heading] = head.as_array()?;
    let mut all: Vec<Vec<[u32; 2]>> = Vec::new();
    for row in rows {
        let (&number, ends) = row.split_first()?;
        let (runs, rest) = ends.as_chunks::<2>();
        // Rows without a run are not sent.
        let is_next = rest.is_empty() && (all.len() as f64..=MOST_ROWS).contains(&number);
        is_next.then(|| all.resize(number as usize, Vec::new()))?;
        all.push(runs.iter().map(|run| run.map(|end| end as u32)).collect());
    }
    FreeArea::from_rows(cell, exactly(x, y, heading), &all).ok()
}

/// More rows than any map has, fewer than memory has room for.
const MOST_ROWS: f64 = 1e6;
