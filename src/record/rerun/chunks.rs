//! The chunks of a recording, one after the other, so that memory does not grow with its length.

use super::frames::Frames;
use crate::config::ConfigError;
use ::rerun::StoreKind;
use ::rerun::external::re_log_encoding::DecoderApp;
use ::rerun::external::re_log_types::{LogMsg, StoreId};
use ::rerun::log::Chunk;
use std::fmt::Display;
use std::fs::File;
use std::io::{self, ErrorKind};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Why a recording could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file cannot be opened.
    #[error("{path}: cannot be opened: {source}")]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is no recording of ipslam.
    #[error("{path}: {reason}; a recording is needed that `ipslam run --record` of this version made")]
    NotARecording {
        /// The file.
        path: PathBuf,
        /// What was found.
        reason: String,
    },
    /// Its configuration is none that this version knows.
    #[error("{path}: recorded by version {version}: {source}")]
    Configuration {
        /// The file.
        path: PathBuf,
        /// Of the program that made it.
        version: String,
        /// What is wrong.
        source: Box<ConfigError>,
    },
}

/// The chunks of the one recording in a file, in the order in which they were written, each with where its frame begins
/// \[bytes\].
pub(super) struct Chunks {
    path: PathBuf,
    frames: Frames<File>,
    /// The frames to read, by where they begin, and how many of them were read; without a list, all are read.
    places: Option<Arc<[u64]>>,
    read: usize,
    decoder: DecoderApp,
    recording: Option<StoreId>,
}

impl Chunks {
    /// Opens a recording, to be read up to where it is whole.
    ///
    /// # Errors
    /// The file cannot be read.
    pub(super) fn open(path: &Path) -> Result<Self, ReadError> {
        let open = |source| ReadError::Open { path: path.to_owned(), source };
        let file = File::open(path).map_err(open)?;
        if file.metadata().map_err(open)?.is_dir() {
            return Err(open(ErrorKind::IsADirectory.into()));
        }
        let (header, frames) = Frames::open(file).map_err(open)?;
        let mut decoder = DecoderApp::new();
        decoder.push_byte_chunk(header);
        Ok(Self { path: path.to_owned(), frames, places: None, read: 0, decoder, recording: None })
    }

    /// Those whose frames begin here, and no others: most of a recording is pictures.
    pub(super) fn at(self, places: Arc<[u64]>) -> Self {
        Self { places: Some(places), ..self }
    }

    fn not(&self, reason: impl Into<String>) -> ReadError {
        ReadError::NotARecording { path: self.path.clone(), reason: reason.into() }
    }

    /// The next frame, and where it begins.
    fn next_frame(&mut self) -> io::Result<Option<(u64, Vec<u8>)>> {
        if let Some(places) = &self.places {
            let Some(&place) = places.get(self.read) else { return Ok(None) };
            self.frames.go_to(place)?;
            self.read += 1;
        }
        let place = self.frames.at();
        Ok(self.frames.next()?.map(|frame| (place, frame)))
    }

    /// The next chunk; `None` at the end.
    fn next_chunk(&mut self) -> Result<Option<(u64, Chunk)>, ReadError> {
        loop {
            let frame = self.next_frame();
            let frame = frame.map_err(|source| ReadError::Open { path: self.path.clone(), source })?;
            let is_last = frame.is_none();
            let (place, frame) = frame.unwrap_or_default();
            self.decoder.push_byte_chunk(frame);
            let decoder = &mut self.decoder;
            let message = unless_damaged(|| decoder.try_read()).map_err(|reason| self.not(reason))?;
            let message = match message {
                Some(message) => message,
                None if is_last && self.recording.is_some() => return Ok(None),
                None if is_last => {
                    let damage = self.frames.damage.clone();
                    return Err(self.not(damage.unwrap_or_else(|| "it holds no recording".to_owned())));
                }
                None => return Err(self.not(format!("the frame at byte {place} is damaged"))),
            };
            // The blueprint is stored in the same file as the recording.
            if message.store_id().kind() != StoreKind::Recording {
                continue;
            }
            if self.recording.get_or_insert_with(|| message.store_id().clone()) != message.store_id() {
                return Err(self.not("it holds several recordings"));
            }
            if let LogMsg::ArrowMsg(_, message) = message {
                let chunk = unless_damaged(|| Chunk::from_arrow_msg(&message)).map_err(|reason| self.not(reason))?;
                return Ok(Some((place, chunk)));
            }
        }
    }
}

/// The decoder trusts the numbers inside a frame, and panics where they cannot be.
fn unless_damaged<T, E: Display>(decode: impl FnOnce() -> Result<T, E>) -> Result<T, String> {
    match catch_unwind(AssertUnwindSafe(decode)) {
        Ok(decoded) => decoded.map_err(|error| error.to_string()),
        Err(_) => Err("a frame of it is damaged".to_owned()),
    }
}

impl Iterator for Chunks {
    type Item = Result<(u64, Chunk), ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_chunk().transpose()
    }
}
