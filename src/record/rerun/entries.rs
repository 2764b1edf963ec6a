//! The log in a recording.

use super::blueprint;
use super::chunks::Chunks;
use super::rows::{exactly, rows};
use crate::log::{LaserReading, LogEntry, LogError, LogReader, LogStats};
use ::rerun::log::Chunk;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Puts the entries of a log in their order: those of one kind are written together.
#[derive(Default)]
pub(super) struct Entries {
    /// Number of the entry that comes next.
    next: i64,
    waiting: BTreeMap<i64, LogEntry>,
}

impl Entries {
    /// Adds what a chunk holds of the log, if it does; `None` where a row has another length than it can have.
    pub(super) fn add(&mut self, chunk: &Chunk) -> Option<bool> {
        let path = chunk.entity_path();
        let Some((_, entry_of)) = KINDS.iter().find(|(kind, _)| *path == (*kind).into()) else { return Some(false) };
        for (number, row) in rows(chunk, blueprint::ENTRY_TIMELINE) {
            self.waiting.insert(number, entry_of(&row)?);
        }
        Some(true)
    }

    /// The next entry, if it is there. What follows a gap came after something that is lost.
    pub(super) fn pop(&mut self) -> Option<LogEntry> {
        let entry = self.waiting.remove(&self.next)?;
        self.next += 1;
        Some(entry)
    }

    /// Entries that were handed out.
    pub(super) const fn count(&self) -> u64 {
        self.next.unsigned_abs()
    }
}

/// How a row becomes an entry; `None` where it has another length than it can have.
type FromRow = fn(&[f64]) -> Option<LogEntry>;
/// Where entries of each kind are.
const KINDS: [(&str, FromRow); 4] = [
    (blueprint::LASER, laser),
    (blueprint::ODOMETRY_READING, odometry),
    (blueprint::TURN, turn),
    (blueprint::TRUTH, truth),
];

fn laser(row: &[f64]) -> Option<LogEntry> {
    let (
        &[x, y, heading, stamp, ahead, left, turned, first_angle, angle_step, max_range, forward, sideways, turn],
        ranges,
    ) = row.split_first_chunk::<13>()?;
    Some(LogEntry::Laser(LaserReading {
        stamp,
        odom_from_robot: exactly(x, y, heading),
        robot_from_laser: exactly(ahead, left, turned),
        start_from_end: exactly(forward, sideways, turn),
        first_angle,
        angle_step,
        max_range,
        ranges: ranges.to_vec(),
    }))
}

fn odometry(row: &[f64]) -> Option<LogEntry> {
    let &[x, y, heading, stamp] = row.as_array()?;
    Some(LogEntry::Odometry { stamp, odom_from_robot: exactly(x, y, heading) })
}

fn turn(row: &[f64]) -> Option<LogEntry> {
    let &[stamp, by_gyro] = row.as_array()?;
    Some(LogEntry::Turn { stamp, by_gyro })
}

fn truth(row: &[f64]) -> Option<LogEntry> {
    let &[x, y, heading, stamp] = row.as_array()?;
    Some(LogEntry::Truth { stamp, world_from_robot: exactly(x, y, heading) })
}

/// The entries of a recorded log.
pub(super) struct RecordedReader {
    pub(super) path: PathBuf,
    pub(super) chunks: Chunks,
    pub(super) entries: Entries,
    /// Its lines are the entries that were handed out.
    pub(super) stats: LogStats,
    /// Entries in all.
    pub(super) all: u64,
}

impl RecordedReader {
    fn next_entry(&mut self) -> Result<Option<LogEntry>, LogError> {
        loop {
            if let Some(entry) = self.entries.pop() {
                return Ok(Some(entry));
            }
            if self.stats.lines == self.all {
                return Ok(None);
            }
            let error = |source| LogError::Read { path: self.path.clone(), line: self.stats.lines, source };
            let added = match self.chunks.next() {
                None => None,
                Some(chunk) => self.entries.add(&chunk.map_err(|reason| error(std::io::Error::other(reason)))?.1),
            };
            added.ok_or_else(|| error(std::io::Error::other("it is not what it was when it was opened")))?;
        }
    }
}

impl Iterator for RecordedReader {
    type Item = Result<LogEntry, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        let entry = self.next_entry();
        if entry.is_err() {
            // Behind an error there is nothing.
            self.all = self.stats.lines;
        }
        let entry = entry.transpose()?;
        if let Ok(entry) = &entry {
            self.stats.lines += 1;
            match entry {
                LogEntry::Laser(_) => self.stats.laser += 1,
                LogEntry::Odometry { .. } => self.stats.odometry += 1,
                LogEntry::Turn { .. } => self.stats.turns += 1,
                LogEntry::Truth { .. } => {}
            }
        }
        Some(entry)
    }
}

impl LogReader for RecordedReader {
    fn stats(&self) -> &LogStats {
        &self.stats
    }

    fn progress(&self) -> Option<(u64, u64)> {
        Some((self.stats.lines, self.all))
    }
}
