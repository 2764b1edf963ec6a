//! A log that comes through a pipe. Its bytes are kept in a temporary file as they come, so that it can be read from its first
//! byte any number of times, also while it still comes.

use std::fs::File;
use std::io::{self, ErrorKind, Read, Write as _};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tempfile::NamedTempFile;

/// How often a reader that waits asks whether it should \[s\].
const PATIENCE: Duration = Duration::from_millis(50);
/// What is kept at a time, at most \[bytes\].
const PIECE: usize = 1 << 16;

/// Bytes that come once and can be read again.
#[derive(Clone, Debug)]
pub struct Stream {
    /// What to call it.
    name: &'static str,
    kept: Arc<Kept>,
    is_over: fn() -> bool,
}

#[derive(Debug)]
struct Kept {
    file: NamedTempFile,
    progress: Mutex<Progress>,
    grown: Condvar,
}

#[derive(Debug, Default)]
struct Progress {
    length: u64,
    end: Option<End>,
}

/// Why nothing more comes.
#[derive(Clone, Debug)]
enum End {
    /// Whoever wrote it has closed it.
    Closed,
    /// The reader wanted no more.
    Stopped,
    /// It cannot be read, or kept.
    Failed(ErrorKind, String),
}

impl Stream {
    /// Begins to keep the bytes, on a thread of its own, in a file that goes when the last of this stream does. Where `is_over`
    /// says so, the stream ends behind what was read of it.
    ///
    /// # Errors
    /// No temporary file can be made, or no thread started.
    pub fn new(name: &'static str, bytes: impl Read + Send + 'static, is_over: fn() -> bool) -> io::Result<Self> {
        let file = NamedTempFile::new()?;
        let mut copy = file.reopen()?;
        let kept = Arc::new(Kept { file, progress: Mutex::default(), grown: Condvar::new() });
        let (stream, weak) = (Self { name, kept: Arc::clone(&kept), is_over }, Arc::downgrade(&kept));
        // The file opened above is not the one that readers read: each has a place of its own.
        let keep = move || {
            let (mut bytes, mut piece) = (bytes, vec![0; PIECE]);
            loop {
                let read = bytes.read(&mut piece).and_then(|read| copy.write_all(&piece[..read]).map(|()| read));
                // Nobody reads it any more.
                let Some(kept) = weak.upgrade() else { return };
                let mut progress = kept.progress();
                match read {
                    Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                    _ if progress.end.is_some() => return,
                    Ok(0) => progress.end = Some(End::Closed),
                    Ok(read) => progress.length += read as u64,
                    Err(error) => progress.end = Some(End::Failed(error.kind(), error.to_string())),
                }
                kept.grown.notify_all();
            }
        };
        std::thread::Builder::new().name("stream".to_owned()).spawn(keep)?;
        Ok(stream)
    }

    /// What to call the log that comes through it.
    pub(super) fn name(&self) -> String {
        self.name.to_owned()
    }

    /// Reads from the first byte.
    pub(super) fn reader(&self) -> io::Result<StreamReader> {
        Ok(StreamReader { file: self.kept.file.reopen()?, position: 0, stream: self.clone() })
    }

    /// How many bytes there are behind this place; waits until there is one, and is 0 at the end.
    fn beyond(&self, position: u64) -> io::Result<u64> {
        let mut progress = self.kept.progress();
        loop {
            if progress.end.is_none() && (self.is_over)() {
                *progress = Progress { length: position, end: Some(End::Stopped) };
            }
            match &progress.end {
                _ if progress.length > position => return Ok(progress.length - position),
                Some(End::Failed(kind, reason)) => return Err(io::Error::new(*kind, reason.clone())),
                Some(End::Closed | End::Stopped) => return Ok(0),
                None => {}
            }
            let waited = self.kept.grown.wait_timeout(progress, PATIENCE);
            progress = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl Kept {
    fn progress(&self) -> MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Reads a stream, and waits for what has not come yet.
#[derive(Debug)]
pub(super) struct StreamReader {
    file: File,
    position: u64,
    stream: Stream,
}

impl StreamReader {
    /// Whether the stream ended because its reader wanted no more.
    pub(super) fn was_stopped(&self) -> bool {
        matches!(self.stream.kept.progress().end, Some(End::Stopped))
    }
}

impl Read for StreamReader {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let most = self.stream.beyond(self.position)?.min(buffer.len() as u64) as usize;
        let read = self.file.read(&mut buffer[..most])?;
        self.position += read as u64;
        Ok(read)
    }
}
