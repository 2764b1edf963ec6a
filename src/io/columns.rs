//! Text files of numbers in columns, plain or gzip: one row a line, columns parted by white space.
//!
//! Blank lines and lines that start with `#` are left out. Whether a file is gzip shows in its first two bytes.

use crate::log::LogError;
use flate2::bufread::MultiGzDecoder;
use std::fs::File;
use std::io::{BufRead, BufReader, Read as _};
use std::path::Path;

const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];
/// A row of a dozen numbers is far shorter \[bytes\].
const MAX_LINE: u64 = 1 << 16;

/// Hands every row of a file to `take_row`, in the order of the file; all numbers are finite.
///
/// `expected` says what the file should be, for the error where its first row already is none.
///
/// # Errors
/// The file cannot be read, holds no row, or a row is none that `take_row` accepts: it returns what is wrong with it.
pub(super) fn read_rows(
    path: &Path,
    expected: &'static str,
    mut take_row: impl FnMut(&[f64]) -> Result<(), String>,
) -> Result<(), LogError> {
    let open_error = |source| LogError::Open { path: path.to_owned(), source };
    let mut file = BufReader::new(File::open(path).map_err(open_error)?);
    let is_gzip = file.fill_buf().map_err(open_error)?.starts_with(&GZIP_MAGIC);
    let mut text: Box<dyn BufRead> =
        if is_gzip { Box::new(BufReader::new(MultiGzDecoder::new(file))) } else { Box::new(file) };

    let not_this_format = |reason| LogError::NotThisFormat { path: path.to_owned(), reason, expected };
    let (mut line, mut rows) = (0, 0);
    let (mut bytes, mut row) = (Vec::new(), Vec::new());
    loop {
        bytes.clear();
        let read = text.by_ref().take(MAX_LINE + 1).read_until(b'\n', &mut bytes);
        match read.map_err(|source| LogError::Read { path: path.to_owned(), line, source })? {
            0 if rows == 0 => return Err(not_this_format("it holds no row of numbers".to_owned())),
            0 => return Ok(()),
            _ => line += 1,
        }
        if bytes.len() as u64 > MAX_LINE {
            let reason = format!("the line is longer than {MAX_LINE} bytes");
            return Err(LogError::Line { path: path.to_owned(), line, reason });
        }
        let words = String::from_utf8_lossy(&bytes);
        let words = words.strip_prefix('\u{feff}').filter(|_| line == 1).unwrap_or(&words);
        if words.trim().is_empty() || words.trim_start().starts_with('#') {
            continue;
        }
        parse_row(words, &mut row).and_then(|()| take_row(&row)).map_err(|reason| match rows {
            0 => not_this_format(format!("line {line}: {reason}")),
            _ => LogError::Line { path: path.to_owned(), line, reason },
        })?;
        rows += 1;
    }
}

fn parse_row(words: &str, row: &mut Vec<f64>) -> Result<(), String> {
    row.clear();
    for (column, word) in words.split_whitespace().enumerate() {
        match word.parse::<f64>() {
            Ok(number) if number.is_finite() => row.push(number),
            Ok(_) => return Err(format!("column {}, `{word:.30}`, is not finite", column + 1)),
            Err(_) => return Err(format!("column {}, `{word:.30}`, is not a number", column + 1)),
        }
    }
    Ok(())
}
