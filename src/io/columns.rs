//! Text files of numbers in columns, plain or gzip: one row a line, columns parted by white space.
//!
//! Blank lines and lines that start with `#` are left out.

use super::lines::Lines;
use crate::log::LogError;
use std::path::Path;

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
    let not_this_format = |reason| LogError::NotThisFormat { path: path.to_owned(), reason, expected };
    let mut lines = Lines::open(path)?;
    let (mut line, mut row) = (String::new(), Vec::new());
    let mut rows = 0;
    while lines.next_into(&mut line)? {
        parse_row(&line, &mut row).and_then(|()| take_row(&row)).map_err(|reason| match rows {
            0 => not_this_format(format!("line {}: {reason}", lines.number())),
            _ => lines.error(reason),
        })?;
        rows += 1;
    }
    if rows == 0 { Err(not_this_format("it holds no row of numbers".to_owned())) } else { Ok(()) }
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
