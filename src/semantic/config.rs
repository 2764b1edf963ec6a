//! How a recording is mapped.

use crate::association::Policy;
use crate::parameters::{ConfigError, parameters, with_toml};

/// Densities of detections that show an object not mapped yet \[1/(m rad)\]: the forward pass is run with each, and the
/// objective chooses. No single one suits all recordings: a high one doubles objects, a low one takes neighbours for one.
pub const NEW_DENSITIES: [f64; 3] = [0.02, 0.006, 0.002];

parameters! {
    /// How a recording is mapped.
    pub struct SemanticConfig {
        /// How detections are assigned to landmarks in the E step.
        association: Policy = Policy::Soft;
        /// Hypotheses that the forward pass keeps.
        beam: usize = 32, in 1.0..=1024.0;
        /// Joint assignments of a frame that a hypothesis branches into.
        branches: usize = 6, in 1.0..=64.0;
        /// Least time between two frames that are used \[s\]: errors of frames that are closer are not independent.
        interval: f64 = 0.4, in 0.0..=60.0;
        /// E and M steps after the forward pass, over all frames.
        sweeps: usize = 8, in 1.0..=100.0;
        /// Keyframes of the sliding window of online mapping; 0 optimises all keyframes together at the end.
        window: usize = 0, in 0.0..=1e6;
        /// What a landmark costs \[nats\]. It may be anywhere in an area A of about 100 m² and is known to s = 1.7 cm in
        /// the end: ln(A / (2π s²)), the Occam factor.
        landmark_cost: f64 = 10.9, in 0.0..=1000.0;
    }
}

impl SemanticConfig {
    /// Whether every number is in its range.
    ///
    /// # Errors
    /// The first value that is not, with what could be.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.check("semantic")
    }

    /// This configuration, with the values that a TOML text sets in place of its own.
    ///
    /// # Errors
    /// The text is no TOML, or one of its keys is unknown or of another type.
    pub fn with_toml(&self, text: &str) -> Result<Self, ConfigError> {
        with_toml(self, text)
    }
}
