//! 2-D laser SLAM whose map is a few hundred Gaussian line clusters.

pub mod geometry;
pub mod io;
pub mod metrics;
pub mod picture;
pub mod ppca;
pub mod random;
pub mod record;
pub mod scan;
pub mod simulate;
