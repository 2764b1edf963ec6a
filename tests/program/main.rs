//! The program from outside.

#![allow(clippy::expect_used, clippy::unwrap_used, clippy::panic, reason = "a test's helpers may fail as a test does")]

mod benchmark;
mod cli;
mod faults;
#[cfg(feature = "record")]
mod replay;
#[cfg(feature = "record")]
mod semantic;
