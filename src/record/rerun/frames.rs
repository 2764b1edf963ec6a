//! The frames of a recording, one at a time and checked before the decoder sees them: it takes the lengths in their headers
//! at their word, and would make room for whatever a damaged file claims.
//!
//! A recording is a header of 12 bytes that begins with `RRF2`, and frames: a kind and a length, 64 bits each, then as many
//! bytes. A frame of the kind 0 is the last.

use std::io::{self, BufReader, Read, Seek, SeekFrom};

const HEADER: usize = 12;
const FRAME_HEADER: usize = 16;

/// The frames of a recording.
pub struct Frames<F> {
    file: BufReader<F>,
    /// Where the next frame begins, and the end of the file \[bytes\].
    at: u64,
    length: u64,
    /// What is wrong behind the last whole frame: a run that was killed leaves half a frame.
    pub damage: Option<String>,
}

impl<F: Read + Seek> Frames<F> {
    /// The header of the file, cut short where the file is, and the frames behind it.
    ///
    /// # Errors
    /// The reading fails. Bytes that are none of a recording are no error: the decoder says what they are.
    pub fn open(mut file: F) -> io::Result<(Vec<u8>, Self)> {
        let length = file.seek(SeekFrom::End(0))?;
        file.rewind()?;
        let mut file = BufReader::new(file);
        let mut header = Vec::with_capacity(HEADER);
        file.by_ref().take(HEADER as u64).read_to_end(&mut header)?;
        Ok((header, Self { file, at: HEADER as u64, length, damage: None }))
    }

    /// Where the next frame begins \[bytes\].
    pub const fn at(&self) -> u64 {
        self.at
    }

    /// Goes on with the frame that begins here.
    ///
    /// # Errors
    /// The reading fails.
    pub fn go_to(&mut self, at: u64) -> io::Result<()> {
        self.file.seek_relative(at.wrapping_sub(self.at).cast_signed())?;
        self.at = at;
        Ok(())
    }

    /// The next whole frame with its header; `None` where none is left.
    ///
    /// # Errors
    /// The reading fails.
    pub fn next(&mut self) -> io::Result<Option<Vec<u8>>> {
        let at = self.at;
        let left = self.length.saturating_sub(at);
        if left < FRAME_HEADER as u64 {
            if left > 0 {
                self.damage = Some(format!("it breaks off at byte {at}"));
            }
            return Ok(None);
        }
        let mut frame = vec![0; FRAME_HEADER];
        self.file.read_exact(&mut frame)?;
        let number = |bytes: &[u8]| bytes.iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte));
        let (kind, claimed, left) = (number(&frame[..8]), number(&frame[8..]), left - FRAME_HEADER as u64);
        self.at += FRAME_HEADER as u64;
        if kind == 0 || claimed > left {
            if kind != 0 {
                let damage = format!("at byte {at} a frame is said to have {claimed} bytes, and {left} are left");
                self.damage = Some(damage);
            }
            // Nothing comes after it.
            self.length = self.at;
            return Ok(None);
        }
        self.file.by_ref().take(claimed).read_to_end(&mut frame)?;
        self.at += claimed;
        Ok(Some(frame))
    }
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

    /// Lengths of the whole frames, where they end, and what is wrong there.
    fn whole(recording: io::Cursor<Vec<u8>>) -> (Vec<usize>, u64, Option<String>) {
        let (_, mut frames) = Frames::open(recording).unwrap();
        let (mut lengths, mut end) = (Vec::new(), frames.at());
        while let Some(frame) = frames.next().unwrap() {
            lengths.push(frame.len());
            end = frames.at();
        }
        (lengths, end, frames.damage)
    }

    #[test]
    fn lengths_are_not_believed() {
        assert_eq!(whole(recording(&[(1, 5, 5), (2, 100, 100)])), (vec![21, 116], 12 + 21 + 116, None));
        assert_eq!(whole(recording(&[(1, 5, 5), (0, 1 << 40, 100)])), (vec![21], 33, None));
        for claimed in [101, 8 << 30, 1 << 62, u64::MAX] {
            let (lengths, end, damage) = whole(recording(&[(1, 5, 5), (2, claimed, 100)]));
            assert_eq!((lengths, end), (vec![21], 33));
            assert!(damage.unwrap().contains(&format!("at byte 33 a frame is said to have {claimed} bytes, and 100")));
        }
        let mut cut = recording(&[(1, 5, 5)]);
        cut.get_mut().extend([2; 15]);
        assert_eq!(whole(cut), (vec![21], 33, Some("it breaks off at byte 33".to_owned())));
        let (header, mut frames) = Frames::open(io::Cursor::new(b"something".to_vec())).unwrap();
        assert_eq!((&header[..], frames.next().unwrap()), (&b"something"[..], None));
    }

    #[test]
    fn a_frame_is_found_again() {
        let (_, mut frames) = Frames::open(recording(&[(1, 5, 5), (2, 9, 9), (3, 2, 2)])).unwrap();
        let mut all = Vec::new();
        let mut at = frames.at();
        while let Some(frame) = frames.next().unwrap() {
            all.push((at, frame));
            at = frames.at();
        }
        assert_eq!(all.len(), 3);
        for index in [1, 0, 2, 1] {
            frames.go_to(all[index].0).unwrap();
            assert_eq!(frames.next().unwrap().as_ref(), Some(&all[index].1));
        }
    }
}
