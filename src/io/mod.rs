//! Files in and out: one file a format behind one small reader. [`open_log`] finds the reader for a log by its content,
//! [`open_bytes`] for one that is in memory, and [`open_stream`] for one that comes through a pipe.

use std::io::Write;
use std::path::{Path, PathBuf};

pub mod carmen;
mod columns;
pub mod datasets;
pub mod geojson;
mod lines;
pub mod map_json;
pub mod map_server;
pub mod mcap;
mod open;
#[cfg(feature = "images")]
pub mod pictures;
pub mod poses;
pub mod relations;
pub mod semantic;
mod stream;
mod table;
mod text;
pub mod trajectory;
pub mod tum;
pub mod visual_inertial;

pub use open::{open_bytes, open_log, open_stream};
pub use stream::Stream;
pub use text::{TextError, read_text};

/// Why a file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: cannot be written: {source}{}", remedy(source))]
pub struct WriteError {
    /// The file.
    pub path: PathBuf,
    /// What the system said.
    pub source: std::io::Error,
}

fn remedy(error: &std::io::Error) -> &'static str {
    use std::io::ErrorKind;
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => "; free some space there or write to another disk",
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => "; choose a folder that you may write to",
        ErrorKind::NotFound | ErrorKind::NotADirectory => "; its folder does not exist: create it first",
        ErrorKind::IsADirectory => "; this is a folder: name a file in it",
        _ => "",
    }
}

/// Writes a file so that it is there whole or not at all.
///
/// `write` fills a temporary file beside `path`, which takes the name `path` once everything is on the disk. What is
/// no regular file (a pipe, `/dev/stdout`) is written to directly.
///
/// # Errors
/// `write` fails, or the file cannot be made, filled or renamed. What stood at `path` before is then untouched.
pub fn write_whole(path: &Path, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<(), WriteError> {
    replace_file(path, write).map_err(|source| WriteError { path: path.to_owned(), source })
}

fn replace_file(path: &Path, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> std::io::Result<()> {
    if std::fs::metadata(path).is_ok_and(|metadata| !metadata.is_file()) {
        let mut file = std::io::BufWriter::new(std::fs::OpenOptions::new().write(true).open(path)?);
        write(&mut file)?;
        return file.flush();
    }
    // A link stays a link: the file that it leads to is replaced.
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let Some(name) = path.file_name() else { return Err(std::io::ErrorKind::IsADirectory.into()) };
    let partial = path.with_file_name(format!(".{}.{}.partial", name.to_string_lossy(), std::process::id()));
    let written = std::fs::File::create(&partial).and_then(|file| {
        let mut file = std::io::BufWriter::new(file);
        write(&mut file)?;
        file.flush()?;
        file.get_ref().sync_all()?;
        std::fs::rename(&partial, &path)
    });
    if written.is_err() {
        // The first error is reported; there may be nothing to remove.
        let _ = std::fs::remove_file(&partial);
    }
    written
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_file_is_replaced_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.txt");
        write_whole(&path, |file| file.write_all(b"first")).unwrap();
        let error = write_whole(&path, |file| {
            file.write_all(b"half of the sec")?;
            Err(std::io::ErrorKind::StorageFull.into())
        })
        .unwrap_err();
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        assert_eq!(names(folder.path()), ["out.txt"]);
        let message = error.to_string();
        assert!(message.contains("out.txt: cannot be written") && message.contains("free some space"), "{message}");
        write_whole(&path, |file| file.write_all(b"second")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"second");
        assert_eq!(names(folder.path()), ["out.txt"]);
    }

    #[test]
    fn says_where_and_why_a_file_cannot_be_written() {
        let folder = tempfile::tempdir().unwrap();
        for (path, expected) in [
            (folder.path().join("missing/out.txt"), "its folder does not exist"),
            (folder.path().to_owned(), "this is a folder"),
        ] {
            let message = write_whole(&path, |file| file.write_all(b"text")).unwrap_err().to_string();
            assert!(message.contains(expected), "{message:?} does not say {expected:?}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_stay_and_devices_stay() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        std::fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_whole(&link, |out| out.write_all(b"new")).unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), b"new");
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        write_whole(Path::new("/dev/null"), |out| out.write_all(b"nothing")).unwrap();
        assert!(!std::fs::metadata("/dev/null").unwrap().is_file());
    }
}
