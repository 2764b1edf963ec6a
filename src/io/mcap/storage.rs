//! The file formats in which ROS keeps its messages, behind one door: what follows is the same for all.

use super::records::{Next, Records};
use super::rosbag;
#[cfg(not(target_family = "wasm"))]
use super::sqlite;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

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
    /// Opens the files of a bag, all of the format that the first one has.
    pub(super) fn open(files: Vec<PathBuf>) -> io::Result<Self> {
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

    /// How much was read, and how much there is.
    pub(super) fn progress(&self) -> (u64, u64) {
        match self {
            Self::Mcap(records) => (records.consumed(), records.all),
            #[cfg(not(target_family = "wasm"))]
            Self::Sqlite(tables) => (tables.consumed(), tables.all),
            Self::Ros1(records) => (records.consumed(), records.all),
        }
    }
}

fn begin(path: &Path) -> io::Result<Vec<u8>> {
    let mut begin = Vec::new();
    File::open(path)?.take(16).read_to_end(&mut begin)?;
    Ok(begin)
}
