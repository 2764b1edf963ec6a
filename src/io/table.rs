//! Text files of columns with names: comma-separated values (RFC 4180), plain or gzip, one row a line, the names in
//! the first one.
//!
//! The order of the columns is free. Blank lines and lines that start with `#` are left out.

use super::lines::Lines;
use crate::log::LogError;
use csv_core::{ReadRecordResult, Reader};
use std::path::Path;

/// The columns that a table has.
pub(super) struct Layout {
    /// Without these it is another table.
    pub(super) required: &'static [&'static str],
    /// These may be missing.
    pub(super) optional: &'static [&'static str],
}

/// One row, by the columns of its [`Layout`]: those required, then the others.
pub(super) struct Row<'a> {
    layout: &'a Layout,
    places: &'a [Option<usize>],
    fields: &'a Fields,
}

impl Row<'_> {
    /// The text of a column without white space around it; empty where the column is missing.
    pub(super) fn text(&self, column: usize) -> &str {
        self.places.get(column).copied().flatten().map_or("", |place| self.fields.get(place)).trim()
    }

    /// The number of a column, which is finite.
    pub(super) fn number(&self, column: usize) -> Result<f64, String> {
        let (name, text) = (self.name(column), self.text(column));
        match text.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            Ok(_) => Err(format!("{name} is `{text:.30}`, which is not finite; leave the row out")),
            Err(_) if text.is_empty() => Err(format!("{name} is empty; a number belongs there")),
            Err(_) => Err(format!("{name} is `{text:.30}`, which is not a number")),
        }
    }

    /// As [`number`](Self::number); `None` where the column is empty.
    pub(super) fn number_or_empty(&self, column: usize) -> Result<Option<f64>, String> {
        if self.text(column).is_empty() { Ok(None) } else { self.number(column).map(Some) }
    }

    /// The whole number of a column.
    pub(super) fn count<T: std::str::FromStr>(&self, column: usize) -> Result<T, String> {
        let text = self.text(column);
        text.parse().map_err(|_| format!("{} is `{text:.30}`, which is not a whole number", self.name(column)))
    }

    fn name(&self, column: usize) -> &'static str {
        let Layout { required, optional } = self.layout;
        required.iter().chain(*optional).nth(column).copied().unwrap_or_default()
    }
}

/// Hands every row of a table to `take_row`, in the order of the file, with the number of its layout: the first one
/// whose required columns are all there. Returns the names of columns that the layout does not know.
///
/// `expected` says what the file should be, for the error where its header fits no layout.
///
/// # Errors
/// The file cannot be read, its header fits no layout, or a row is none that `take_row` accepts: it returns what is
/// wrong with it. A table without rows is no error.
pub(super) fn read_table(
    path: &Path,
    layouts: &[Layout],
    expected: &'static str,
    mut take_row: impl FnMut(usize, &Row) -> Result<(), String>,
) -> Result<Vec<String>, LogError> {
    let not_this_format = |reason| LogError::NotThisFormat { path: path.to_owned(), reason, expected };
    let mut lines = Lines::open(path)?;
    let (mut line, mut fields) = (String::new(), Fields::new());
    if !lines.next_into(&mut line)? {
        return Err(not_this_format("it is empty".to_owned()));
    }
    fields.split(&mut line).map_err(|reason| lines.error(reason))?;
    let header: Vec<String> = (0..fields.len()).map(|place| fields.get(place).trim().to_owned()).collect();
    let place_of = |name: &&str| header.iter().position(|other| other == name);
    let fits = |layout: &Layout| layout.required.iter().all(|name| place_of(name).is_some());
    let Some((kind, layout)) = layouts.iter().enumerate().find(|(_, layout)| fits(layout)) else {
        let reason = format!("line {}: `{line:.60}` is no header of such a table", lines.number());
        return Err(not_this_format(reason));
    };
    let names = || layout.required.iter().chain(layout.optional);
    if let Some(name) = names().find(|name| header.iter().filter(|other| other == *name).count() > 1) {
        return Err(lines.error(format!("two columns are called {name}; leave one out")));
    }
    let places: Vec<_> = names().map(place_of).collect();
    while lines.next_into(&mut line)? {
        let taken = fields.split(&mut line).and_then(|()| match fields.len() {
            count if count == header.len() => take_row(kind, &Row { layout, places: &places, fields: &fields }),
            count => Err(format!("{count} columns, but the header has {}", header.len())),
        });
        taken.map_err(|reason| lines.error(reason))?;
    }
    Ok(header.iter().filter(|name| !names().any(|known| known == name)).cloned().collect())
}

/// The fields of one row, unquoted.
struct Fields {
    reader: Reader,
    text: Vec<u8>,
    ends: Vec<usize>,
}

impl Fields {
    fn new() -> Self {
        Self { reader: Reader::new(), text: Vec::new(), ends: Vec::new() }
    }

    /// Takes a row apart; `line` gets an end of line, which closes its last field.
    fn split(&mut self, line: &mut String) -> Result<(), String> {
        line.push('\n');
        self.reader.reset();
        // No field is longer than the row, and each but the last ends at a comma.
        self.text.resize(line.len(), 0);
        self.ends.resize(line.matches(',').count() + 2, 0);
        let (result, _, _, ends) = self.reader.read_record(line.as_bytes(), &mut self.text, &mut self.ends);
        line.pop();
        self.ends.truncate(ends);
        match result {
            ReadRecordResult::Record => Ok(()),
            _ => Err("a quotation mark is opened and not closed in this line".to_owned()),
        }
    }

    fn len(&self) -> usize {
        self.ends.len()
    }

    fn get(&self, place: usize) -> &str {
        let start = place.checked_sub(1).and_then(|before| self.ends.get(before)).copied().unwrap_or(0);
        let bytes = self.ends.get(place).and_then(|&end| self.text.get(start..end)).unwrap_or_default();
        std::str::from_utf8(bytes).unwrap_or_default()
    }
}

/// A field as it stands in a table: in quotation marks where it has to be.
pub(super) fn quoted(field: &str) -> String {
    let is_plain = !field.contains([',', '"', '\n', '\r']) && !field.starts_with('#') && field.trim() == field;
    if is_plain { field.to_owned() } else { format!("\"{}\"", field.replace('"', "\"\"")) }
}
