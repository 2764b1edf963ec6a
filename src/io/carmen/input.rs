//! Bytes of a log, plain or gzip, as lines of bounded length.

use flate2::bufread::MultiGzDecoder;
use std::fmt;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Longer lines are not kept \[bytes\]; a sweep of a thousand beams has about ten thousand.
pub(super) const MAX_LINE: u64 = 1 << 20;

const BUFFER: usize = 1 << 16;
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// What [`Input::read_line`] found.
pub(super) enum Line {
    /// A line, ended by a line feed or the end of the input.
    Whole,
    /// The start of a line of more than [`MAX_LINE`] bytes; the next call goes on after it.
    TooLong,
    /// Nothing more.
    End,
}

/// The lines of a log.
pub(super) struct Input {
    text: Box<dyn BufRead + Send>,
    consumed: Arc<AtomicU64>,
    inside_long_line: bool,
}

impl Input {
    /// Recognises gzip (of any number of members) by the first two bytes.
    pub(super) fn new(bytes: impl Read + Send + 'static) -> io::Result<Self> {
        let consumed = Arc::new(AtomicU64::new(0));
        let mut bytes = Counted { bytes, count: Arc::clone(&consumed) };
        let mut head = Vec::with_capacity(GZIP_MAGIC.len());
        bytes.by_ref().take(GZIP_MAGIC.len() as u64).read_to_end(&mut head)?;
        let gzip = head == GZIP_MAGIC;
        let bytes = BufReader::with_capacity(BUFFER, Cursor::new(head).chain(bytes));
        let text: Box<dyn BufRead + Send> =
            if gzip { Box::new(BufReader::with_capacity(BUFFER, MultiGzDecoder::new(bytes))) } else { Box::new(bytes) };
        Ok(Self { text, consumed, inside_long_line: false })
    }

    /// Replaces `line` by the next line.
    pub(super) fn read_line(&mut self, line: &mut Vec<u8>) -> io::Result<Line> {
        if std::mem::take(&mut self.inside_long_line) {
            self.text.skip_until(b'\n')?;
        }
        line.clear();
        let read = self.text.by_ref().take(MAX_LINE + 1).read_until(b'\n', line)? as u64;
        self.inside_long_line = read > MAX_LINE && !line.ends_with(b"\n");
        Ok(match read {
            0 => Line::End,
            _ if self.inside_long_line => Line::TooLong,
            _ => Line::Whole,
        })
    }

    /// Bytes taken from the source, before decompression.
    pub(super) fn consumed(&self) -> u64 {
        self.consumed.load(Ordering::Relaxed)
    }
}

impl fmt::Debug for Input {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Input").field("consumed", &self.consumed()).finish_non_exhaustive()
    }
}

/// Counts the bytes that are read through it.
struct Counted<R> {
    bytes: R,
    count: Arc<AtomicU64>,
}

impl<R: Read> Read for Counted<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.bytes.read(buffer)?;
        self.count.fetch_add(read as u64, Ordering::Relaxed);
        Ok(read)
    }
}
