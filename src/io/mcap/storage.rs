//! The file formats in which ROS keeps its messages, behind one door: what follows is the same for all.

use super::super::stream::{Stream, StreamReader};
use super::records::{Next, Records, cut_off};
use super::rosbag;
#[cfg(not(target_family = "wasm"))]
use super::sqlite;
use std::fs::File;
use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Where a bag comes from.
#[derive(Clone, Debug)]
pub(super) enum Origin {
    /// Its files, in the order of their time.
    Files(Vec<PathBuf>),
    /// The bytes of one.
    Memory(Arc<[u8]>),
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

/// Bytes that are read.
#[derive(Debug)]
pub(super) enum Bytes {
    File(File),
    Memory(Cursor<Arc<[u8]>>),
    Stream(StreamReader),
}

impl Read for Bytes {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.read(buffer),
            Self::Memory(bytes) => bytes.read(buffer),
            Self::Stream(stream) => stream.read(buffer),
        }
    }
}

impl Bytes {
    /// A file, and its length.
    pub(super) fn of_file(path: &Path) -> io::Result<(Self, u64)> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        Ok((Self::File(file), length))
    }

    /// Goes over the next bytes.
    ///
    /// # Errors
    /// They cannot be read, or are not as many.
    pub(super) fn skip(bytes: &mut impl Read, count: u64) -> io::Result<()> {
        // A stream cannot be sought in.
        if io::copy(&mut bytes.take(count), &mut io::sink())? == count { Ok(()) } else { Err(cut_off()) }
    }
}

/// Every SQLite file begins with these bytes.
const SQLITE: &[u8] = b"SQLite format 3\0";
/// And every bag of ROS 1 with these.
const ROS1: &[u8] = b"#ROSBAG";

/// The first bytes of a file, by which bags are recognised.
pub(in crate::io) fn is_bag(begin: &[u8]) -> bool {
    begin.starts_with(&super::MAGIC) || begin.starts_with(SQLITE) || begin.starts_with(ROS1)
}

impl Storage {
    /// Opens a bag, its files all of the format that the first one has.
    pub(super) fn open(origin: &Origin) -> io::Result<Self> {
        let files = match origin {
            Origin::Files(files) => files.clone(),
            Origin::Memory(bytes) => return Self::of_memory(bytes),
            Origin::Stream(stream) => return Records::of_stream(stream).map(Self::Mcap),
        };
        let begin = files.first().map(|path| begin(path)).transpose()?.unwrap_or_default();
        match &files[..] {
            #[cfg(not(target_family = "wasm"))]
            _ if begin.starts_with(SQLITE) => sqlite::Tables::open(files).map(Self::Sqlite),
            [path] if begin.starts_with(ROS1) => {
                let (bytes, length) = Bytes::of_file(path)?;
                rosbag::Records::new(bytes, length).map(Self::Ros1)
            }
            _ => Records::open(files).map(Self::Mcap),
        }
    }

    fn of_memory(bytes: &Arc<[u8]>) -> io::Result<Self> {
        let (begin, length) = (&bytes[..], bytes.len() as u64);
        if begin.starts_with(SQLITE) {
            return Err(io::Error::new(io::ErrorKind::Unsupported, "a bag in SQLite can be read from a file only"));
        }
        let is_ros1 = begin.starts_with(ROS1);
        let bytes = Bytes::Memory(Cursor::new(Arc::clone(bytes)));
        if is_ros1 {
            rosbag::Records::new(bytes, length).map(Self::Ros1)
        } else {
            Records::of_memory(bytes, length).map(Self::Mcap)
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
