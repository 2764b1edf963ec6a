//! The frames of a recording, checked before the decoder sees them: it takes the lengths in their headers at their word, and
//! would make room for whatever a damaged file claims.
//!
//! A recording is a header of 12 bytes that begins with `RRF2`, and frames: a kind and a length, 64 bits each, then as many
//! bytes. A frame of the kind 0 is the last.

use std::io::{self, Read, Seek, SeekFrom};

const MAGIC: &[u8; 4] = b"RRF2";
const HEADER: u64 = 12;
const FRAME_HEADER: u64 = 16;

/// How far a recording is whole.
#[derive(Debug, PartialEq)]
pub struct WholeFrames {
    /// Bytes up to the end of the last whole frame.
    pub bytes: u64,
    /// What is wrong behind them, if they are not all: a run that was killed leaves half a frame.
    pub damage: Option<String>,
}

/// Finds the whole frames of a recording; the reader is at its start before and after.
///
/// # Errors
/// The reading fails. Bytes that are none of a recording are no error: the decoder says what they are.
pub fn whole_frames(file: &mut (impl Read + Seek)) -> io::Result<WholeFrames> {
    let length = file.seek(SeekFrom::End(0))?;
    file.rewind()?;
    let mut magic = [0; 4];
    let mut at = HEADER;
    let mut damage = None;
    if length < HEADER || file.read_exact(&mut magic).is_err() || magic != *MAGIC {
        at = length;
    }
    while at < length {
        let mut header = [0; FRAME_HEADER as usize];
        file.seek(SeekFrom::Start(at))?;
        if length - at < FRAME_HEADER {
            damage = Some(format!("it breaks off at byte {at}"));
            break;
        }
        file.read_exact(&mut header)?;
        let (kind, claimed) = header.split_at(8);
        let number = |bytes: &[u8]| bytes.iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte));
        let (kind, claimed, left) = (number(kind), number(claimed), length - at - FRAME_HEADER);
        if claimed > left {
            damage = Some(format!("at byte {at} a frame is said to have {claimed} bytes, and {left} are left"));
            break;
        }
        at += FRAME_HEADER + claimed;
        if kind == 0 {
            at = length;
        }
    }
    file.rewind()?;
    Ok(WholeFrames { bytes: at, damage })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recording(frames: &[(u64, u64, usize)]) -> io::Cursor<Vec<u8>> {
        let mut bytes = b"RRF2\x00\x24\x03\x00\x01\x02\x00\x00".to_vec();
        for &(kind, claimed, length) in frames {
            bytes.extend(kind.to_le_bytes());
            bytes.extend(claimed.to_le_bytes());
            bytes.extend(vec![7; length]);
        }
        io::Cursor::new(bytes)
    }

    #[test]
    fn lengths_are_not_believed() {
        let whole = |frames: &[(u64, u64, usize)]| whole_frames(&mut recording(frames)).unwrap();
        assert_eq!(whole(&[(1, 5, 5), (2, 100, 100)]), WholeFrames { bytes: 12 + 21 + 116, damage: None });
        for claimed in [101, 8 << 30, 1 << 62, u64::MAX] {
            let WholeFrames { bytes, damage } = whole(&[(1, 5, 5), (2, claimed, 100)]);
            assert_eq!(bytes, 33);
            assert!(damage.unwrap().contains(&format!("at byte 33 a frame is said to have {claimed} bytes, and 100")));
        }
        let mut cut = recording(&[(1, 5, 5)]);
        cut.get_mut().extend([2; 15]);
        let found = whole_frames(&mut cut).unwrap();
        assert_eq!(found, WholeFrames { bytes: 33, damage: Some("it breaks off at byte 33".to_owned()) });
        assert_eq!(whole_frames(&mut io::Cursor::new(b"something else".to_vec())).unwrap().bytes, 14);
        assert_eq!(whole_frames(&mut io::Cursor::new(Vec::new())).unwrap().bytes, 0);
    }
}
