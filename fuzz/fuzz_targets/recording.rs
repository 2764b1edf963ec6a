//! Any bytes as the frames of a recording: reading ends, every frame is as long as it says, and none is longer than the file.
//! What Rerun's decoder does with whole frames is not asked here: building it would take longer than all of the fuzzing.
//!
//! `cargo +nightly fuzz run recording fuzz/corpus/recording fuzz/seeds/recording -- -max_total_time=60`

#![no_main]

#[path = "../../src/record/rerun/frames.rs"]
mod frames;

use frames::Frames;
use libfuzzer_sys::fuzz_target;
use std::io::Cursor;

fuzz_target!(|data: &[u8]| {
    let (header, mut frames) = Frames::open(Cursor::new(data)).expect("memory can be read");
    assert_eq!(header, &data[..header.len()]);
    let (mut read, mut places) = (header.len(), Vec::new());
    loop {
        let at = frames.at();
        let Some(frame) = frames.next().expect("memory can be read") else { break };
        assert_eq!((at as usize, frames.at() as usize), (read, read + frame.len()));
        assert_eq!(frame, &data[read..read + frame.len()], "a frame is what lies there");
        let claimed = u64::from_le_bytes(frame[8..16].try_into().expect("eight bytes"));
        assert_eq!(claimed, frame.len() as u64 - 16);
        read += frame.len();
        places.push((at, frame.len()));
    }
    assert!(frames.next().expect("memory can be read").is_none(), "a frame after the end");
    // What is left is told, unless a frame says that it is the last.
    let is_end = data.len() >= read + 16 && data[read..read + 8] == [0; 8];
    assert_eq!(frames.damage.is_some(), read < data.len() && !is_end && header.len() == 12, "{:?}", frames.damage);
    let (_, mut frames) = Frames::open(Cursor::new(data)).expect("memory can be read");
    for (at, length) in places.into_iter().rev() {
        frames.go_to(at).expect("a place in the file");
        assert_eq!(frames.next().expect("memory can be read").map(|frame| frame.len()), Some(length));
    }
});
