//! The lines of a text file, plain or gzip, each of bounded length.
//!
//! Whether a file is gzip shows in its first two bytes. A byte-order mark and the ends of the lines are taken off;
//! bytes that are not UTF-8 become replacement characters.

use crate::log::LogError;
use flate2::bufread::MultiGzDecoder;
use std::fs::File;
use std::io::{BufRead, BufReader, Read as _};
use std::path::{Path, PathBuf};

const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];
/// A row of a dozen numbers is far shorter \[bytes\].
const MAX_LINE: u64 = 1 << 16;

/// A file that is read line by line.
pub(super) struct Lines {
    path: PathBuf,
    text: Box<dyn BufRead>,
    bytes: Vec<u8>,
    number: u64,
}

impl Lines {
    pub(super) fn open(path: &Path) -> Result<Self, LogError> {
        let open_error = |source| LogError::Open { path: path.to_owned(), source };
        let mut file = BufReader::new(File::open(path).map_err(open_error)?);
        let is_gzip = file.fill_buf().map_err(open_error)?.starts_with(&GZIP_MAGIC);
        let text: Box<dyn BufRead> =
            if is_gzip { Box::new(BufReader::new(MultiGzDecoder::new(file))) } else { Box::new(file) };
        Ok(Self { path: path.to_owned(), text, bytes: Vec::new(), number: 0 })
    }

    /// Replaces `line` by the next one that is neither blank nor a comment (`#`); false at the end of the file.
    pub(super) fn next_into(&mut self, line: &mut String) -> Result<bool, LogError> {
        loop {
            self.bytes.clear();
            let read = self.text.by_ref().take(MAX_LINE + 1).read_until(b'\n', &mut self.bytes);
            match read.map_err(|source| LogError::Read { path: self.path.clone(), line: self.number, source })? {
                0 => return Ok(false),
                _ => self.number += 1,
            }
            if self.bytes.len() as u64 > MAX_LINE {
                return Err(self.error(format!("the line is longer than {MAX_LINE} bytes")));
            }
            let text = String::from_utf8_lossy(&self.bytes);
            let text = text.strip_prefix('\u{feff}').filter(|_| self.number == 1).unwrap_or(&text);
            if !(text.trim().is_empty() || text.trim_start().starts_with('#')) {
                line.clear();
                line.push_str(text.trim_end_matches(['\n', '\r']));
                return Ok(true);
            }
        }
    }

    /// Number of the line read last, from 1.
    pub(super) fn number(&self) -> u64 {
        self.number
    }

    /// What is wrong with the line read last.
    pub(super) fn error(&self, reason: String) -> LogError {
        LogError::Line { path: self.path.clone(), line: self.number, reason }
    }
}
