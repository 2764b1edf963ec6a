//! The reader for a log, found by what its file holds and not by its name.

use super::carmen::CarmenLog;
use super::mcap::{self, McapLog, Topics};
use super::{LogError, LogSource};
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// The log in a file, or in the folder of a ROS 2 bag: MCAP or CARMEN.
///
/// `topics` chooses among those of a bag.
///
/// # Errors
/// The file cannot be opened or is a bag of a kind that has to be converted ([`LogError::NotThisFormat`] says how);
/// a folder holds no bag, or one of several files; or as [`McapLog::new`]. Whether a file is a CARMEN log shows when it
/// is read.
pub fn open_log(path: impl AsRef<Path>, topics: &Topics) -> Result<Box<dyn LogSource>, LogError> {
    let path = path.as_ref();
    let open_error = |source| LogError::Open { path: path.to_owned(), source };
    if path.is_dir() {
        return Ok(Box::new(McapLog::new(file_of_bag(path)?, topics)?));
    }
    let mut begin = Vec::new();
    File::open(path).and_then(|file| file.take(16).read_to_end(&mut begin)).map_err(open_error)?;
    if begin.starts_with(&mcap::MAGIC) {
        return Ok(Box::new(McapLog::new(path, topics)?));
    }
    let other = |reason: &str, expected| {
        Err(LogError::NotThisFormat { path: path.to_owned(), reason: reason.to_owned(), expected })
    };
    if begin.starts_with(b"SQLite format 3") {
        return other("this is an SQLite file", TO_MCAP);
    }
    if begin.starts_with(b"#ROSBAG") {
        return other("this is a bag of ROS 1", FROM_ROS_1);
    }
    if begin.starts_with(b"RRF") {
        return other("this is a recording", "`ipslam replay FILE` runs what it holds again");
    }
    if begin.starts_with(b"\x28\xb5\x2f\xfd") {
        return other("the whole file is packed by zstd", "unpack it first: `zstd -d FILE`");
    }
    if *topics != Topics::default() {
        return other("this is no MCAP file", "only a bag has topics to choose from (--scan-topic, --odom-topic)");
    }
    Ok(Box::new(CarmenLog::new(path)))
}

const TO_MCAP: &str = "a bag of ROS 2 is read from MCAP: convert its folder by `ros2 bag convert` with \
                       `storage_id: mcap`, or by `rosbags-convert --src FOLDER --dst OTHER --dst-storage mcap`";
const FROM_ROS_1: &str =
    "a bag of ROS 2 in MCAP is needed: `rosbags-convert --src FILE --dst FOLDER --dst-storage mcap`";

/// The one MCAP file in the folder of a bag.
fn file_of_bag(folder: &Path) -> Result<PathBuf, LogError> {
    let open_error = |source| LogError::Open { path: folder.to_owned(), source };
    let entries = std::fs::read_dir(folder).and_then(Iterator::collect::<io::Result<Vec<_>>>).map_err(open_error)?;
    let files_with = |ending: &str| {
        let mut files: Vec<PathBuf> = entries.iter().map(std::fs::DirEntry::path).collect();
        files.retain(|path| path.file_name().is_some_and(|name| name.to_string_lossy().ends_with(ending)));
        files
    };
    let not_read = |reason: &str, expected| {
        Err(LogError::NotThisFormat { path: folder.to_owned(), reason: reason.to_owned(), expected })
    };
    match &files_with(".mcap")[..] {
        [only] => Ok(only.clone()),
        [] if !files_with(".db3").is_empty() => not_read("the bag in this folder is in SQLite", TO_MCAP),
        [] if !files_with(".mcap.zstd").is_empty() => {
            not_read("the bag in this folder is packed by zstd", "unpack its files first: `zstd -d FILE`")
        }
        [] => Err(open_error(io::Error::new(io::ErrorKind::IsADirectory, "a folder; name a log file inside it"))),
        [first, ..] => {
            let reason = format!(
                "the bag in this folder has several files; name one of them ({}), or join them by `mcap merge` or \
                 `ros2 bag convert`",
                first.display()
            );
            Err(LogError::Bag { path: folder.to_owned(), reason })
        }
    }
}
