//! The particle filter on the host, in f64 (IV of the paper): weights, resampling, ancestry; and for localisation how many
//! particles there are, and whether some come from anywhere.

pub mod ancestry;
pub mod kld;
pub mod recovery;
pub mod resampling;
pub mod weights;
