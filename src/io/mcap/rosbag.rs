//! The messages of a bag of ROS 1 (`.bag`, [format 2.0](http://wiki.ros.org/Bags/Format/2.0)), in the order of the file.
//!
//! Read are connections, messages and chunks (packed by bz2, lz4 or not at all), up to the end of the file; the index, which
//! repeats what was read, is left out, so that a bag whose recorder died needs none.

use super::messages::ros2_name;
use super::records::{Channel, Chunk, Fields, MAX_RECORD, Next, cut_off, limit, named_cut_off};
use super::storage::Bytes;
use std::collections::BTreeMap;
use std::io::{self, BufReader, ErrorKind, Read};
use std::sync::Arc;

/// Every bag of this format begins with this line.
const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

const MESSAGE: u8 = 0x02;
const CHUNK: u8 = 0x05;
const CONNECTION: u8 = 0x07;

/// A bag that is being read.
#[derive(Debug)]
pub(super) struct Records {
    file: BufReader<Bytes>,
    consumed: u64,
    pub(super) all: u64,
    channels: BTreeMap<u32, Arc<Channel>>,
    chunk: Chunk,
}

impl Records {
    /// The bag in these bytes, of which there are `all`.
    pub(super) fn new(bytes: Bytes, all: u64) -> io::Result<Self> {
        let mut file = BufReader::with_capacity(1 << 16, bytes);
        let mut magic = [0; MAGIC.len()];
        if file.read_exact(&mut magic).is_err() || magic != MAGIC {
            let reason = "it is a bag of ROS 1 of an older format; `rosbag fix` makes one of 2.0";
            return Err(io::Error::new(ErrorKind::InvalidData, reason));
        }
        let consumed = MAGIC.len() as u64;
        Ok(Self { file, consumed, all, channels: BTreeMap::new(), chunk: Chunk::default() })
    }

    /// Bytes that were read.
    pub(super) fn consumed(&self) -> u64 {
        self.consumed.min(self.all)
    }

    /// The next message, or what is there in its place.
    ///
    /// # Errors
    /// The file cannot be read or ends within a record: it was cut off.
    pub(super) fn next(&mut self) -> io::Result<Next> {
        loop {
            let next = match self.next_in_chunk() {
                Some(next) => next,
                None if self.consumed >= self.all => return Ok(Next::End),
                None => self.next_in_file()?,
            };
            if let Some(next) = next {
                return Ok(next);
            }
        }
    }

    /// The next record of the chunk; `None` where none is left, `Some(None)` where it is nothing to hand out.
    fn next_in_chunk(&mut self) -> Option<Option<Next>> {
        let record = self.chunk.next(|fields| Some((fields.sized()?.to_vec(), fields.sized()?.to_vec())))?;
        Some(match record {
            Ok((header, data)) => self.understand(&header, &data),
            Err(damage) => Some(damage),
        })
    }

    /// The next record outside of chunks; `None` where it is nothing to hand out.
    fn next_in_file(&mut self) -> io::Result<Option<Next>> {
        let start = self.consumed;
        let Some(header) = self.sized()? else {
            return Ok(Some(Next::Damage(format!("the record at byte {start} has too long a header"))));
        };
        let Some(data) = self.sized()? else {
            return Ok(Some(Next::Damage(format!("the record at byte {start} is longer than {MAX_RECORD} bytes"))));
        };
        if Header(&header).number("op") != Some([CHUNK]) {
            return Ok(self.understand(&header, &data));
        }
        Ok(self.chunk.fill(start, unpack(Header(&header), &data)))
    }

    /// Bytes of the file with their number before them; `None` where they are too many to keep.
    fn sized(&mut self) -> io::Result<Option<Vec<u8>>> {
        let mut length = [0; 4];
        self.file.read_exact(&mut length).map_err(named_cut_off)?;
        let length = u64::from(u32::from_le_bytes(length));
        self.consumed += 4 + length;
        if self.consumed > self.all {
            return Err(cut_off());
        }
        if length > MAX_RECORD {
            Bytes::skip(&mut self.file, length)?;
            return Ok(None);
        }
        let mut bytes = Vec::new();
        let read = self.file.by_ref().take(length).read_to_end(&mut bytes)?;
        if read as u64 == length { Ok(Some(bytes)) } else { Err(cut_off()) }
    }

    /// Keeps connections, and hands out messages.
    fn understand(&mut self, header: &[u8], data: &[u8]) -> Option<Next> {
        let header = Header(header);
        let read = match header.number("op") {
            Some([CONNECTION]) => self.keep_connection(header, data).map(|()| None),
            Some([MESSAGE]) => self.message(header, data).map(Some),
            Some(_) => Some(None),
            None => None,
        };
        read.unwrap_or_else(|| Some(Next::Damage("a record does not tell what it is".to_owned())))
    }

    fn keep_connection(&mut self, header: Header<'_>, data: &[u8]) -> Option<()> {
        let connection = u32::from_le_bytes(header.number("conn")?);
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let (topic, schema) = (text(header.field("topic")?), ros2_name(&text(Header(data).field("type")?)));
        self.channels.insert(connection, Arc::new(Channel { topic, schema, encoding: "ros1".to_owned() }));
        Some(())
    }

    fn message(&self, header: Header<'_>, data: &[u8]) -> Option<Next> {
        let connection = u32::from_le_bytes(header.number("conn")?);
        let mut time = Fields(header.field("time")?);
        let [seconds, nanoseconds] = [time.number()?, time.number()?].map(u32::from_le_bytes);
        let received = i64::from(seconds) * 1_000_000_000 + i64::from(nanoseconds);
        let Some(channel) = self.channels.get(&connection) else {
            return Some(Next::Damage(format!(
                "a message of connection {connection}, which the file does not declare"
            )));
        };
        Some(Next::Message { channel: Arc::clone(channel), received, data: data.to_vec() })
    }
}

/// The fields `name=value` of a record's header, each with its length before it.
#[derive(Clone, Copy)]
struct Header<'a>(&'a [u8]);

impl<'a> Header<'a> {
    fn field(self, name: &str) -> Option<&'a [u8]> {
        let mut fields = Fields(self.0);
        while let Some(field) = fields.sized() {
            if let Some(value) = field.strip_prefix(name.as_bytes()).and_then(|rest| rest.strip_prefix(b"=")) {
                return Some(value);
            }
        }
        None
    }

    fn number<const BYTES: usize>(self, name: &str) -> Option<[u8; BYTES]> {
        self.field(name)?.try_into().ok()
    }
}

/// The records of a chunk.
fn unpack(header: Header<'_>, packed: &[u8]) -> Result<Vec<u8>, String> {
    let size = header.number("size").map(u32::from_le_bytes);
    let (Some(size), Some(compression)) = (size, header.field("compression")) else {
        return Err("it does not tell how it is packed".to_owned());
    };
    let size = u64::from(size);
    limit(size, packed)?;
    let mut records = Vec::new();
    let unpacked = match compression {
        b"none" => packed.take(size).read_to_end(&mut records),
        b"lz4" => lz4_flex::frame::FrameDecoder::new(packed).take(size).read_to_end(&mut records),
        b"bz2" => bzip2::read::MultiBzDecoder::new(packed).take(size).read_to_end(&mut records),
        other => {
            return Err(format!(
                "packed by `{:.20}`; none, lz4 and bz2 are understood",
                String::from_utf8_lossy(other)
            ));
        }
    };
    match unpacked {
        Err(error) => Err(error.to_string()),
        Ok(length) if length as u64 != size => Err(format!("it has {length} of {size} bytes")),
        Ok(_) => Ok(records),
    }
}
