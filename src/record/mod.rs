//! Recordings of runs, for the viewer and for replay.

#[cfg(feature = "record")]
pub mod rerun;
