//! The file formats in which ROS keeps its messages, behind one door: what follows is the same for all.

use super::super::stream::Stream;
use super::records::{Next, Records};
use super::rosbag;
#[cfg(not(target_family = "wasm"))]
use super::sqlite;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Where a bag comes from.
#[derive(Clone, Debug)]
pub(super) enum Origin {
    /// Its files, in the order of their time.
    Files(Vec<PathBuf>),
    /// MCAP that may still be coming.
    Stream(Stream),
}

/// A bag that is being read.
#[derive(Debug)]
pub(super) enum Storage {
    Mcap(Records),
    #[cfg(not(target_family = "wasm"))]
    Sqlite(sqlite::Tables),
    Ros1(rosbag::Records),
}

/// Every SQLite file begins with these bytes.
const SQLITE: &[u8] = b"SQLite format 3\0";

/// The first bytes of a file, by which bags are recognised.
pub(in crate::io) fn is_bag(begin: &[u8]) -> bool {
    begin.starts_with(&super::MAGIC) || begin.starts_with(SQLITE) || begin.starts_with(b"#ROSBAG")
}

impl Storage {
    /// Opens a bag, its files all of the format that the first one has.
    pub(super) fn open(origin: &Origin) -> io::Result<Self> {
        let files = match origin {
            Origin::Files(files) => files.clone(),
            Origin::Stream(stream) => return Records::of_stream(stream).map(Self::Mcap),
        };
        let begin = files.first().map(|path| begin(path)).transpose()?.unwrap_or_default();
        match &files[..] {
            #[cfg(not(target_family = "wasm"))]
            _ if begin.starts_with(SQLITE) => sqlite::Tables::open(files).map(Self::Sqlite),
            [path] if begin.starts_with(b"#ROSBAG") => rosbag::Records::open(path).map(Self::Ros1),
            _ => Records::open(files).map(Self::Mcap),
        }
    }

    /// The next message, or what is there in its place.
    ///
    /// # Errors
    /// The file cannot be read or ends before its data does.
    pub(super) fn next(&mut self) -> io::Result<Next> {
        match self {
            Self::Mcap(records) => records.next(),
            #[cfg(not(target_family = "wasm"))]
            Self::Sqlite(tables) => tables.next(),
            Self::Ros1(records) => records.next(),
        }
    }

    /// How much was read, and how much there is, if that is known.
    pub(super) fn progress(&self) -> Option<(u64, u64)> {
        match self {
            Self::Mcap(records) => records.all.map(|all| (records.consumed(), all)),
            #[cfg(not(target_family = "wasm"))]
            Self::Sqlite(tables) => Some((tables.consumed(), tables.all)),
            Self::Ros1(records) => Some((records.consumed(), records.all)),
        }
    }

    /// Whether a stream ended because its reader wanted no more.
    pub(super) fn was_stopped(&self) -> bool {
        matches!(self, Self::Mcap(records) if records.was_stopped())
    }
}

fn begin(path: &Path) -> io::Result<Vec<u8>> {
    let mut begin = Vec::new();
    File::open(path)?.take(16).read_to_end(&mut begin)?;
    Ok(begin)
}
