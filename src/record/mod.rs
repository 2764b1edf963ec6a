//! Recordings of runs, to be looked at and run again.

#[cfg(feature = "record")]
pub mod rerun;
