//! Particles against maps: the part of the filter that runs over every particle and every point.
//!
//! `weigh` is the log of eq. 18; `refine` climbs it from a pose by Gauss-Newton steps. Everything here is f32 in a
//! frame near the robot, so that a map kilometres from the origin keeps its millimetres; the host goes on in f64.

pub mod cpu;
pub mod layout;
