//! 2-D laser SLAM whose map is a few hundred Gaussian line clusters.

pub mod clustering;
pub mod config;
pub mod evaluator;
pub mod filter;
pub mod geometry;
pub mod io;
pub mod map;
pub mod metrics;
pub mod motion;
pub mod picture;
pub mod ppca;
pub mod proposal;
pub mod random;
pub mod record;
pub mod scan;
pub mod simulate;
pub mod slam;
pub mod smoothing;
