//! Messages of ROS 2 to MCAP as they come, without chunks, so that whoever reads behind sees each at once.

use std::io::{self, Write};

const HEADER: u8 = 0x01;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;

/// Writes a bag.
#[derive(Debug)]
pub struct McapWriter<W> {
    file: W,
    topics: u16,
}

impl<W: Write> McapWriter<W> {
    /// Begins a bag.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn new(mut file: W) -> io::Result<Self> {
        file.write_all(&super::MAGIC)?;
        let mut this = Self { file, topics: 0 };
        this.record(HEADER, &[text("ros2"), text("ipslam")].concat())?;
        Ok(this)
    }

    /// Declares a topic with messages of this type (`sensor_msgs/msg/LaserScan`); returns its number.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn add_topic(&mut self, name: &str, message_type: &str) -> io::Result<u16> {
        let number = self.topics;
        self.topics += 1;
        // Schema 0 is none.
        let schema = (number + 1).to_le_bytes();
        let (no_text, no_metadata) = (text(""), text(""));
        self.record(SCHEMA, &[&schema[..], &text(message_type), &text("ros2msg"), &no_text].concat())?;
        let channel = [&number.to_le_bytes()[..], &schema, &text(name), &text("cdr"), &no_metadata];
        self.record(CHANNEL, &channel.concat())?;
        Ok(number)
    }

    /// Writes a message in CDR with its encapsulation header, received at this time \[ns since 1970\].
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&mut self, topic: u16, received: u64, message: &[u8]) -> io::Result<()> {
        let (sequence, time) = (0_u32.to_le_bytes(), received.to_le_bytes());
        self.record(MESSAGE, &[&topic.to_le_bytes()[..], &sequence, &time, &time, message].concat())
    }

    fn record(&mut self, kind: u8, body: &[u8]) -> io::Result<()> {
        let length = (body.len() as u64).to_le_bytes();
        self.file.write_all(&[&[kind], &length[..], body].concat())
    }
}

/// A text with its length before it.
fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}
