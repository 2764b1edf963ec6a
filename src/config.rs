//! The configuration of a run: of mapping walls, of localisation, or of mapping objects.

pub use crate::localization::LocalizationConfig;
pub use crate::parameters::ConfigError;
pub use crate::semantic::SemanticConfig;
pub use crate::slam::SlamConfig;
use serde::{Deserialize, Serialize};

/// The task of a run with its configuration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Config {
    /// Mapping walls.
    Slam(SlamConfig),
    /// Localisation in a known map.
    Localization(LocalizationConfig),
    /// Mapping objects.
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
