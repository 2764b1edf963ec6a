//! A short text, read whole.

use crate::log::LogError;
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

/// Why a file is no short text.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TextError {
    /// It cannot be read.
    #[error("it cannot be read")]
    Read(#[source] std::io::Error),
    /// It is longer than texts of its kind are \[bytes\].
    #[error("it has more than {0} bytes")]
    Long(u64),
    /// It is not in UTF-8 from a byte on.
    #[error("byte {0} is no UTF-8")]
    Utf8(usize),
}

impl TextError {
    /// The same error of a part of a recording, where a text like `expected` should be.
    pub(crate) fn in_recording(self, path: &Path, expected: &'static str) -> LogError {
        let path = path.to_owned();
        match self {
            Self::Read(source) => LogError::Open { path, source },
            other => LogError::NotThisFormat { path, reason: other.to_string(), expected },
        }
    }
}

/// Reads a text in UTF-8 of at most `most` bytes.
///
/// # Errors
/// The file cannot be read, or is no such text.
pub fn read_text(path: &Path, most: u64) -> Result<String, TextError> {
    let mut bytes = Vec::new();
    File::open(path).and_then(|file| file.take(most + 1).read_to_end(&mut bytes)).map_err(TextError::Read)?;
    if bytes.len() as u64 > most {
        return Err(TextError::Long(most));
    }
    String::from_utf8(bytes).map_err(|error| TextError::Utf8(error.utf8_error().valid_up_to()))
}
