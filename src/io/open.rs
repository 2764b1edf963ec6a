//! The reader for a log, found by what its file holds and not by its name.

use super::carmen::{CarmenLog, CarmenReader};
use super::mcap::{self, McapLog, Topics};
use super::stream::Stream;
use crate::log::{LogError, LogReader, LogSource};
use serde::Deserialize;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The log in a file, or in the folder of a ROS 2 bag: a bag of ROS or a CARMEN log.
///
/// `topics` chooses among those of a bag.
///
/// # Errors
/// The file cannot be opened or is a bag of a kind that has to be converted ([`LogError::NotThisFormat`] says how);
/// a folder holds no bag, or several; or as [`McapLog::new`]. Whether a file is a CARMEN log shows when it
/// is read.
pub fn open_log(path: impl AsRef<Path>, topics: &Topics) -> Result<Box<dyn LogSource>, LogError> {
    let path = path.as_ref();
    let open_error = |source| LogError::Open { path: path.to_owned(), source };
    if path.is_dir() {
        let files = files_of_bag(path)?;
        return Ok(Box::new(match &files[..] {
            [only] => McapLog::new(only, topics)?,
            _ => McapLog::of_files(path.to_owned(), files, topics)?,
        }));
    }
    let mut begin = Vec::new();
    File::open(path).and_then(|file| file.take(16).read_to_end(&mut begin)).map_err(open_error)?;
    if mcap::is_bag(&begin) {
        return Ok(Box::new(McapLog::new(path, topics)?));
    }
    refusal(path, &begin, topics).map_or_else(|| Ok(Box::new(CarmenLog::new(path)) as Box<dyn LogSource>), Err)
}

/// The log in the bytes of a file, as [`open_log`] finds it there; `name` is that of the file. A bag in SQLite has to be in a
/// file.
///
/// # Errors
/// As for [`open_log`].
pub fn open_bytes(
    name: impl Into<PathBuf>,
    bytes: impl Into<Arc<[u8]>>,
    topics: &Topics,
) -> Result<Box<dyn LogSource>, LogError> {
    let (name, bytes) = (name.into(), bytes.into());
    if mcap::is_bag(&bytes) {
        return Ok(Box::new(McapLog::of_bytes(name, bytes, topics)?));
    }
    match refusal(&name, &bytes, topics) {
        Some(error) => Err(error),
        None => Ok(Box::new(CarmenLog::of_bytes(name, bytes))),
    }
}

/// What a stream is called in errors.
const NAME: &str = "standard input";

/// The log that comes through a stream: a CARMEN log, plain or gzip, or a bag in MCAP, whose topics are chosen by what its
/// first seconds hold.
///
/// `field_of_view` is as for [`CarmenLog::with_field_of_view`](super::carmen::CarmenLog::with_field_of_view).
///
/// # Errors
/// It is a log of another kind, which has to be in a file, or as [`McapLog::new`].
pub fn open_stream(
    stream: Stream,
    topics: &Topics,
    field_of_view: Option<f64>,
) -> Result<Box<dyn LogSource>, LogError> {
    let path = PathBuf::from(NAME);
    let mut begin = Vec::new();
    let head = stream.reader().and_then(|reader| reader.take(16).read_to_end(&mut begin));
    head.map_err(|source| LogError::Open { path: path.clone(), source })?;
    if begin.starts_with(&mcap::MAGIC) {
        return Ok(Box::new(McapLog::of_stream(path, stream, topics)?));
    }
    if mcap::is_bag(&begin) {
        let reason = "a bag of this kind cannot be read as it comes".to_owned();
        return Err(LogError::NotThisFormat { path, reason, expected: "save it to a file first" });
    }
    match refusal(&path, &begin, topics) {
        Some(error) => Err(error),
        None => Ok(Box::new(CarmenStream { stream, field_of_view })),
    }
}

struct CarmenStream {
    stream: Stream,
    field_of_view: Option<f64>,
}

impl LogSource for CarmenStream {
    fn name(&self) -> String {
        self.stream.name()
    }

    fn open(&self) -> Result<Box<dyn LogReader>, LogError> {
        let bytes =
            self.stream.reader().map_err(|source| LogError::Open { path: Path::new(NAME).to_owned(), source })?;
        Ok(Box::new(CarmenReader::from_reader(NAME, bytes)?.with_field_of_view(self.field_of_view)))
    }

    fn is_live(&self) -> bool {
        true
    }
}

/// Why what begins so is no CARMEN log, where that shows.
fn refusal(path: &Path, begin: &[u8], topics: &Topics) -> Option<LogError> {
    let (reason, expected) = if begin.starts_with(b"RRF") {
        ("this is a recording", "`ipslam replay FILE` runs what it holds again")
    } else if begin.starts_with(b"\x28\xb5\x2f\xfd") {
        ("the whole file is packed by zstd", "unpack it first: `zstd -d FILE`")
    } else if *topics != Topics::default() {
        ("this is no bag", "only a bag has topics to choose from (--scan-topic, --odom-topic, --imu)")
    } else {
        return None;
    };
    Some(LogError::NotThisFormat { path: path.to_owned(), reason: reason.to_owned(), expected })
}

/// The files in the folder of a bag, MCAP or SQLite, in the order of their time: several where its `metadata.yaml` says so.
fn files_of_bag(folder: &Path) -> Result<Vec<PathBuf>, LogError> {
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
    let [mcap, sqlite] = [".mcap", ".db3"].map(files_with);
    match if mcap.is_empty() { &sqlite[..] } else { &mcap[..] } {
        [only] => Ok(vec![only.clone()]),
        [] if !files_with(".zstd").is_empty() => {
            not_read("the bag in this folder is packed by zstd", "unpack its files first: `zstd -d FILE`")
        }
        [] => Err(open_error(io::Error::new(io::ErrorKind::IsADirectory, "a folder; name a log file inside it"))),
        [first, ..] => {
            let bag_error = |reason| LogError::Bag { path: folder.to_owned(), reason };
            let metadata = folder.join("metadata.yaml");
            if !metadata.exists() {
                let reason = format!(
                    "several files, and no metadata.yaml that tells whether they are one bag; name one of them ({}), \
                     or have it made by `ros2 bag reindex`",
                    first.display()
                );
                return Err(bag_error(reason));
            }
            let metadata = std::fs::read(&metadata).map_err(open_error)?;
            let Metadata { bag: BagInformation { relative_file_paths } } = serde_saphyr::from_slice(&metadata)
                .map_err(|error| bag_error(format!("its metadata.yaml: {error}")))?;
            Ok(relative_file_paths.into_iter().map(|file| folder.join(file)).collect())
        }
    }
}

/// The parts of a bag's `metadata.yaml` that are used.
#[derive(Deserialize)]
struct Metadata {
    #[serde(rename = "rosbag2_bagfile_information")]
    bag: BagInformation,
}

#[derive(Deserialize)]
struct BagInformation {
    relative_file_paths: Vec<PathBuf>,
}
