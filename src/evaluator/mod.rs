//! Particles against maps: the part of the filter that runs over every particle and every point.
//!
//! `log_likelihood` is the log of eq. 18, `linearise` adds its gradient for the proposals, and `explain` tells which
//! cluster each point belongs to. Everything here is f32 in a frame near the robot, so that a map kilometres from the
//! origin keeps its millimetres; the host goes on in f64.

pub mod cpu;
pub mod layout;
