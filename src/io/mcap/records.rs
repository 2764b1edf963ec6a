//! The records of a bag's MCAP files: which topics there are, and their messages in the order of the files.
//!
//! Of the [format](https://mcap.dev/spec) this reads schemas, channels, messages and chunks of messages, up to the end
//! of the data section; the summary behind it repeats what was read. No size in a file is trusted:
//! memory grows with the bytes that are really there, up to a limit. That is why the crate `mcap` does not read it: files that were cut
//! or damaged are read as far as they go here, in the order of the file and from a pipe too, and what a size claims is allocated only as
//! its bytes come.

use super::super::stream::Stream;
use super::messages::ros2_name;
use super::storage::Bytes;
use crc32fast::hash as crc32;
use std::collections::BTreeMap;
use std::io::{self, BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Every MCAP file begins with these bytes.
pub(in crate::io) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Longer records are not kept, and larger chunks not unpacked \[bytes\]; ROS 2 writes chunks of less than 1 MB.
pub(super) const MAX_RECORD: u64 = 256 << 20;

/// Sensor data shrink by less than this, and what claims more is damage.
const MAX_RATIO: u64 = 1000;
/// A chunk of a few messages that are all alike may shrink by more \[bytes\].
const ROOM: u64 = 1 << 20;

const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const DATA_END: u8 = 0x0f;

/// A topic, as a file declares it.
#[derive(Debug)]
pub(super) struct Channel {
    pub(super) topic: String,
    /// Type of the messages, as ROS 2 calls it: `sensor_msgs/msg/LaserScan`.
    pub(super) schema: String,
    /// How the messages are written: `cdr`, or `ros1`.
    pub(super) encoding: String,
}

/// What comes next in a file.
#[derive(Debug)]
pub(super) enum Next {
    Message {
        channel: Arc<Channel>,
        /// When whoever wrote the bag received it, by that computer's clock \[ns\].
        received: i64,
        data: Vec<u8>,
    },
    /// Something that was left out, and why.
    Damage(String),
    /// The end of the data.
    End,
}

/// A bag that is being read: one MCAP file after the other.
#[derive(Debug)]
pub(super) struct Records {
    file: BufReader<Bytes>,
    /// The files that come after it.
    rest: std::vec::IntoIter<PathBuf>,
    /// Bytes of the file before the record that comes next, and of the whole file; of a stream nobody knows.
    consumed: u64,
    length: u64,
    /// Bytes of the files before it, and of all files.
    before: u64,
    pub(super) all: Option<u64>,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Arc<Channel>>,
    chunk: Chunk,
}

impl Records {
    /// Opens the files of a bag; one that does not begin with [`MAGIC`] is [`ErrorKind::InvalidData`].
    pub(super) fn open(files: Vec<PathBuf>) -> io::Result<Self> {
        let are_several = files.len() > 1;
        let tell = |path: &Path, error| if are_several { named(path, &error) } else { error };
        let mut all = 0;
        for path in &files {
            all += std::fs::metadata(path).map_err(|error| tell(path, error))?.len();
        }
        let mut rest = files.into_iter();
        let first = rest.next().ok_or_else(|| io::Error::new(ErrorKind::NotFound, "the bag has no file"))?;
        let (file, length) = open(&first).map_err(|error| tell(&first, error))?;
        Ok(Self { rest, all: Some(all), ..Self::behind_magic(file, length) })
    }

    /// Opens the bytes of a file, of which there are `length`.
    pub(super) fn of_memory(bytes: Bytes, length: u64) -> io::Result<Self> {
        Ok(Self { all: Some(length), ..Self::behind_magic(behind_magic(bytes)?, length) })
    }

    /// Opens a stream that begins with [`MAGIC`].
    pub(super) fn of_stream(stream: &Stream) -> io::Result<Self> {
        let file = behind_magic(Bytes::Stream(stream.reader()?))?;
        Ok(Self::behind_magic(file, u64::MAX))
    }

    fn behind_magic(file: BufReader<Bytes>, length: u64) -> Self {
        Self {
            file,
            rest: Vec::new().into_iter(),
            consumed: MAGIC.len() as u64,
            length,
            before: 0,
            all: None,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            chunk: Chunk::default(),
        }
    }

    /// Whether this is a stream that ended because its reader wanted no more.
    pub(super) fn was_stopped(&self) -> bool {
        matches!(self.file.get_ref(), Bytes::Stream(stream) if stream.was_stopped())
    }

    /// Bytes of the bag that were read.
    pub(super) fn consumed(&self) -> u64 {
        let consumed = self.before + self.consumed.min(self.length);
        self.all.map_or(consumed, |all| consumed.min(all))
    }

    /// Goes on to the next file, which declares its topics anew; false where there is none.
    fn open_next(&mut self) -> io::Result<bool> {
        let Some(path) = self.rest.next() else { return Ok(false) };
        let (file, length) = open(&path).map_err(|error| named(&path, &error))?;
        self.before += self.length;
        (self.file, self.length, self.consumed) = (file, length, MAGIC.len() as u64);
        self.schemas.clear();
        self.channels.clear();
        Ok(true)
    }

    /// The next message, or what is there in its place.
    ///
    /// # Errors
    /// The file cannot be read or ends before its data does: it was cut off.
    pub(super) fn next(&mut self) -> io::Result<Next> {
        loop {
            let next = match self.next_in_chunk() {
                Some(next) => next,
                None => self.next_in_file()?,
            };
            if let Some(next) = next {
                return Ok(next);
            }
        }
    }

    /// The next record of the chunk; `None` where none is left, `Some(None)` where it is nothing to hand out.
    fn next_in_chunk(&mut self) -> Option<Option<Next>> {
        let record = self.chunk.next(|fields| {
            let opcode: [u8; 1] = fields.number()?;
            let length = u64::from_le_bytes(fields.number()?);
            Some((opcode[0], fields.bytes(usize::try_from(length).ok()?)?.to_vec()))
        })?;
        Some(match record {
            Ok((opcode, body)) => self.understand(opcode, &body),
            Err(damage) => Some(damage),
        })
    }

    /// The next record outside of chunks; `None` where it is nothing to hand out.
    fn next_in_file(&mut self) -> io::Result<Option<Next>> {
        let (mut opcode, mut length) = ([0; 1], [0; 8]);
        self.file.read_exact(&mut opcode).map_err(named_cut_off)?;
        self.file.read_exact(&mut length).map_err(named_cut_off)?;
        let (opcode, length) = (opcode[0], u64::from_le_bytes(length));
        let start = self.consumed;
        self.consumed = start.saturating_add(9).saturating_add(length);
        if opcode == DATA_END {
            return Ok(if self.open_next()? { None } else { Some(Next::End) });
        }
        if opcode == 0 || self.consumed > self.length {
            return Err(cut_off());
        }
        let wanted = matches!(opcode, SCHEMA | CHANNEL | MESSAGE | CHUNK);
        if !wanted || length > MAX_RECORD {
            Bytes::skip(&mut self.file, length)?;
            let too_long = || Next::Damage(format!("the record at byte {start} is longer than {MAX_RECORD} bytes"));
            return Ok(wanted.then(too_long));
        }
        let mut body = Vec::new();
        if self.file.by_ref().take(length).read_to_end(&mut body)? as u64 != length {
            return Err(cut_off());
        }
        if opcode != CHUNK {
            return Ok(self.understand(opcode, &body));
        }
        Ok(self.chunk.fill(start, unpack(&body)))
    }

    /// Keeps schemas and channels, and hands out messages.
    fn understand(&mut self, opcode: u8, body: &[u8]) -> Option<Next> {
        let fields = Fields(body);
        let read = match opcode {
            SCHEMA => self.keep_schema(fields).map(|()| None),
            CHANNEL => self.keep_channel(fields).map(|()| None),
            MESSAGE => self.message(fields).map(Some),
            _ => Some(None),
        };
        read.unwrap_or_else(|| Some(Next::Damage(format!("a record of kind {opcode} is shorter than its fields"))))
    }

    /// `id name encoding data`
    fn keep_schema(&mut self, mut fields: Fields<'_>) -> Option<()> {
        let id = u16::from_le_bytes(fields.number()?);
        self.schemas.insert(id, fields.text()?);
        Some(())
    }

    /// `id schema_id topic message_encoding metadata`
    fn keep_channel(&mut self, mut fields: Fields<'_>) -> Option<()> {
        let id = u16::from_le_bytes(fields.number()?);
        let schema = self.schemas.get(&u16::from_le_bytes(fields.number()?)).cloned().unwrap_or_default();
        let (topic, encoding) = (fields.text()?, fields.text()?);
        let schema = if encoding == "ros1" { ros2_name(&schema) } else { schema };
        self.channels.insert(id, Arc::new(Channel { topic, schema, encoding }));
        Some(())
    }

    /// `channel_id sequence log_time publish_time data`
    fn message(&self, mut fields: Fields<'_>) -> Option<Next> {
        let id = u16::from_le_bytes(fields.number()?);
        fields.bytes(4)?;
        let received = i64::try_from(u64::from_le_bytes(fields.number()?)).unwrap_or(i64::MAX);
        fields.bytes(8)?;
        Some(match self.channels.get(&id) {
            Some(channel) => Next::Message { channel: Arc::clone(channel), received, data: fields.0.to_vec() },
            None => Next::Damage(format!("a message of channel {id}, which the file does not declare")),
        })
    }
}

/// A file, behind its magic bytes, and its length.
fn open(path: &Path) -> io::Result<(BufReader<Bytes>, u64)> {
    let (bytes, length) = Bytes::of_file(path)?;
    Ok((behind_magic(bytes)?, length))
}

fn behind_magic(bytes: Bytes) -> io::Result<BufReader<Bytes>> {
    let mut bytes = BufReader::with_capacity(1 << 16, bytes);
    let mut magic = [0; MAGIC.len()];
    if bytes.read_exact(&mut magic).is_err() || magic != MAGIC {
        return Err(io::Error::new(ErrorKind::InvalidData, "it does not begin as MCAP files do"));
    }
    Ok(bytes)
}

/// An error of one file of several.
fn named(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", path.display()))
}

pub(super) fn cut_off() -> io::Error {
    io::Error::new(ErrorKind::UnexpectedEof, "the bag was cut off before its end")
}

/// The same error, but for the end of the file.
pub(super) fn named_cut_off(error: io::Error) -> io::Error {
    if error.kind() == ErrorKind::UnexpectedEof { cut_off() } else { error }
}

/// The records of a chunk: `start_time end_time uncompressed_size uncompressed_crc compression size records`.
fn unpack(body: &[u8]) -> Result<Vec<u8>, String> {
    let mut fields = Fields(body);
    let header = fields.bytes(8 + 8).and_then(|_times| {
        let size = u64::from_le_bytes(fields.number()?);
        let crc = u32::from_le_bytes(fields.number()?);
        let compression = fields.text()?;
        let packed_size = usize::try_from(u64::from_le_bytes(fields.number()?)).ok()?;
        Some((size, crc, compression, fields.bytes(packed_size)?))
    });
    let Some((size, crc, compression, packed)) = header else { return Err("it is shorter than its fields".to_owned()) };
    limit(size, packed)?;
    let mut records = Vec::new();
    let unpacked = match &*compression {
        "" => packed.take(size).read_to_end(&mut records),
        "lz4" => lz4_flex::frame::FrameDecoder::new(packed).take(size).read_to_end(&mut records),
        "zstd" => ruzstd::decoding::StreamingDecoder::new(packed)
            .map_err(io::Error::other)
            .and_then(|decoder| decoder.take(size).read_to_end(&mut records)),
        other => return Err(format!("packed by `{other:.20}`; none, lz4 and zstd are understood")),
    };
    match unpacked {
        Err(error) => Err(format!("{compression}: {error}")),
        Ok(length) if length as u64 != size => Err(format!("it has {length} of {size} bytes")),
        Ok(_) if crc != 0 && crc32(&records) != crc => Err("its checksum is wrong".to_owned()),
        Ok(_) => Ok(records),
    }
}

/// The chunk that is being read, unpacked, and how much of it was read.
#[derive(Debug, Default)]
pub(super) struct Chunk {
    records: Vec<u8>,
    consumed: usize,
}

impl Chunk {
    /// Begins with the chunk at this byte of the file; returns what is wrong with it if it cannot be unpacked.
    pub(super) fn fill(&mut self, start: u64, unpacked: Result<Vec<u8>, String>) -> Option<Next> {
        let (records, damage) = match unpacked {
            Ok(records) => (records, None),
            Err(reason) => (Vec::new(), Some(Next::Damage(format!("the chunk at byte {start}: {reason}")))),
        };
        *self = Self { records, consumed: 0 };
        damage
    }

    /// Reads the next record, or returns that it is cut, which ends the chunk; `None` at the end.
    pub(super) fn next<T>(&mut self, read: impl FnOnce(&mut Fields<'_>) -> Option<T>) -> Option<Result<T, Next>> {
        let left = self.records.get(self.consumed..).filter(|left| !left.is_empty())?;
        let mut fields = Fields(left);
        let record = read(&mut fields);
        self.consumed = self.records.len() - fields.0.len();
        Some(record.ok_or_else(|| {
            self.records.clear();
            Next::Damage("the last record of a chunk is cut".to_owned())
        }))
    }
}

/// Whether this number of packed bytes can unpack to `size` bytes.
pub(super) fn limit(size: u64, packed: &[u8]) -> Result<(), String> {
    let most = MAX_RECORD.min(ROOM + MAX_RATIO * packed.len() as u64);
    if size > most {
        return Err(format!("unpacked it would have {size} bytes, more than {most} of {} packed ones", packed.len()));
    }
    Ok(())
}

/// The fields of a record that were not read yet; numbers are little-endian.
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl<'a> Fields<'a> {
    pub(super) fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (bytes, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(bytes)
    }

    pub(super) fn number<const BYTES: usize>(&mut self) -> Option<[u8; BYTES]> {
        let (bytes, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*bytes)
    }

    /// Bytes with their number before them.
    pub(super) fn sized(&mut self) -> Option<&'a [u8]> {
        let length = u32::from_le_bytes(self.number()?);
        self.bytes(usize::try_from(length).ok()?)
    }

    /// A text with its length before it.
    pub(super) fn text(&mut self) -> Option<String> {
        self.sized().map(|bytes| String::from_utf8_lossy(bytes).into_owned())
    }
}
