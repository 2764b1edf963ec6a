//! What a run was set to do: mapping walls, localisation, or mapping objects, each with its own configuration.

pub use crate::localization::LocalizationConfig;
pub use crate::parameters::ConfigError;
pub use crate::semantic::SemanticConfig;
pub use crate::slam::SlamConfig;
use serde::{Deserialize, Serialize};

/// The configuration of a run, and with it what the run is for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Config {
    /// Finding path and map.
    Slam(SlamConfig),
    /// Finding the robot in a map that is known.
    Localization(LocalizationConfig),
    /// Finding path and objects.
    Semantic(SemanticConfig),
}

impl Config {
    /// Whether a run is possible with it.
    ///
    /// # Errors
    /// The first value that is not possible, with what would be.
    pub fn validate(&self) -> Result<(), ConfigError> {
        match self {
            Self::Slam(config) => config.validate(),
            Self::Localization(config) => config.validate(),
            Self::Semantic(config) => config.validate(),
        }
    }
}
