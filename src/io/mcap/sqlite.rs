//! The messages of a bag in SQLite files (`.db3`, the storage `sqlite3` of rosbag2), in the order in which they were received.
//!
//! Read are the tables `topics` (id, name, type, serialization_format) and `messages` (id, topic_id, timestamp \[ns\], data).

use super::records::{Channel, MAX_RECORD, Next};
use rusqlite::{Connection, OpenFlags, params};
use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Messages that are fetched at a time.
const BATCH: usize = 64;

/// A bag that is being read: one file after the other.
#[derive(Debug)]
pub(super) struct Tables {
    file: Connection,
    rest: std::vec::IntoIter<PathBuf>,
    channels: BTreeMap<i64, Arc<Channel>>,
    fetched: VecDeque<Next>,
    /// Time and number of the last message that was fetched.
    last: (i64, i64),
    consumed: u64,
    pub(super) all: u64,
}

impl Tables {
    pub(super) fn open(files: Vec<PathBuf>) -> io::Result<Self> {
        let mut all = 0;
        for path in &files {
            all += count(&open(path)?)?;
        }
        let mut rest = files.into_iter();
        let first = rest.next().ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "the bag has no file"))?;
        let file = open(&first)?;
        let channels = channels(&file)?;
        Ok(Self { file, rest, channels, fetched: VecDeque::new(), last: (i64::MIN, i64::MIN), consumed: 0, all })
    }

    /// Messages that were read, of [`Self::all`].
    pub(super) fn consumed(&self) -> u64 {
        self.consumed.min(self.all)
    }

    /// The next message, or what is there in its place.
    ///
    /// # Errors
    /// The file cannot be read any further.
    pub(super) fn next(&mut self) -> io::Result<Next> {
        loop {
            if let Some(next) = self.fetched.pop_front() {
                self.consumed += 1;
                return Ok(next);
            }
            if !self.fetch().map_err(io::Error::other)? {
                let Some(path) = self.rest.next() else { return Ok(Next::End) };
                self.file = open(&path)?;
                self.channels = channels(&self.file)?;
                self.last = (i64::MIN, i64::MIN);
            }
        }
    }

    /// Fetches the messages that come next; false where there are none.
    fn fetch(&mut self) -> rusqlite::Result<bool> {
        // Longer ones than a message can be are not loaded.
        let mut query = self.file.prepare_cached(
            "SELECT timestamp, id, topic_id, length(data), CASE WHEN length(data) <= ?3 THEN data END FROM messages \
             WHERE (timestamp, id) > (?1, ?2) ORDER BY timestamp, id LIMIT ?4",
        )?;
        let mut rows = query.query(params![self.last.0, self.last.1, MAX_RECORD as i64, BATCH as i64])?;
        while let Some(row) = rows.next()? {
            let received: i64 = row.get(0)?;
            self.last = (received, row.get(1)?);
            let (topic, length): (i64, i64) = (row.get(2)?, row.get::<_, Option<i64>>(3)?.unwrap_or(0));
            let next = match (self.channels.get(&topic), row.get::<_, Option<Vec<u8>>>(4)?) {
                (Some(channel), Some(data)) => Next::Message { channel: Arc::clone(channel), received, data },
                (None, _) => Next::Damage(format!("a message of topic {topic}, which the file does not declare")),
                (_, None) => {
                    Next::Damage(format!("message {} has {length} bytes, more than {MAX_RECORD}", self.last.1))
                }
            };
            self.fetched.push_back(next);
        }
        Ok(!self.fetched.is_empty())
    }
}

/// Opens a file that nobody writes to. One whose recorder has left its journal beside it is read with that.
fn open(path: &Path) -> io::Result<Connection> {
    let with = |ending: &str| {
        let mut name = path.as_os_str().to_owned();
        name.push(ending);
        PathBuf::from(name).exists()
    };
    let tell = |error: rusqlite::Error| io::Error::other(format!("{}: {error}", path.display()));
    // So that the error is that of the system.
    std::fs::File::open(path)?;
    let mut flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    if with("-wal") || with("-journal") {
        return Connection::open_with_flags(path, flags).map_err(tell);
    }
    flags |= OpenFlags::SQLITE_OPEN_URI;
    let escaped = path.to_string_lossy().replace('%', "%25").replace('?', "%3f").replace('#', "%23");
    Connection::open_with_flags(format!("file:{escaped}?immutable=1"), flags).map_err(tell)
}

fn count(file: &Connection) -> io::Result<u64> {
    let count: i64 = file.query_row("SELECT count(*) FROM messages", [], |row| row.get(0)).map_err(no_bag)?;
    Ok(count.unsigned_abs())
}

fn channels(file: &Connection) -> io::Result<BTreeMap<i64, Arc<Channel>>> {
    let read = || -> rusqlite::Result<BTreeMap<i64, Arc<Channel>>> {
        let mut query = file.prepare("SELECT id, name, type, serialization_format FROM topics")?;
        let rows = query.query_map([], |row| {
            let channel = Channel { topic: row.get(1)?, schema: row.get(2)?, encoding: row.get(3)? };
            Ok((row.get(0)?, Arc::new(channel)))
        })?;
        rows.collect()
    };
    read().map_err(no_bag)
}

fn no_bag(error: rusqlite::Error) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, format!("this SQLite file is no bag that can be read: {error}"))
}
