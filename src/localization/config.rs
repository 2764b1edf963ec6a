//! Everything that can be set about localisation.

use crate::likelihood::LikelihoodConfig;
use crate::motion::MotionConfig;
use crate::parameters::{ConfigError, check, check_seed, with_toml};
use crate::scan::ScanConfig;
use crate::tracking::TrackingConfig;
use serde::{Deserialize, Serialize};

/// The configuration of localisation. A file may set any part of it; what it leaves out keeps its default.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LocalizationConfig {
    /// Seed of all random numbers, up to 2⁶³ - 1.
    pub seed: u64,
    /// Maximum number of particles, 1 to ten million; default 100 000.
    pub max_particles: usize,
    /// Minimum number of particles, 1 to `max_particles`; default 1000.
    pub min_particles: usize,
    /// Log-likelihoods are multiplied by this, 1e-6 to 1000; default 0.01, less than in mapping: of ambiguous places all have to be
    /// kept until later scans distinguish them.
    pub temper: f64,
    /// The share of a scan, 0 to 1, that the map has to explain, less the share of the points behind its walls, for the robot to be
    /// located; over the last steps it has to be more. Default 0.6. Scans that explain this much never count against a place. In an
    /// outdated map it may have to be less.
    pub located_explained: f64,
    /// From ranges to points.
    pub scan: ScanConfig,
    /// From odometry to motion.
    pub motion: MotionConfig,
    /// Between steps.
    pub tracking: TrackingConfig,
    /// From points and map to a weight.
    pub likelihood: LikelihoodConfig,
}

impl Default for LocalizationConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            max_particles: 100_000,
            min_particles: 1000,
            temper: 0.01,
            located_explained: 0.6,
            scan: ScanConfig::default(),
            motion: MotionConfig::default(),
            tracking: TrackingConfig::default(),
            likelihood: LikelihoodConfig::default(),
        }
    }
}

impl LocalizationConfig {
    /// This configuration, with the parts that a TOML text sets in place of its own.
    ///
    /// # Errors
    /// The text is no TOML, or a key is unknown or of another type; the message names the line and the key. Values are
    /// the business of [`LocalizationConfig::validate`].
    pub fn with_toml(&self, text: &str) -> Result<Self, ConfigError> {
        with_toml(self, text)
    }

    /// Whether a run is possible with it.
    ///
    /// # Errors
    /// The first value that is not possible, with what would be.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check_seed(self.seed)?;
        check("max_particles", self.max_particles, 1.0..=1e7)?;
        check("min_particles", self.min_particles, 1.0..=1e7)?;
        check("temper", self.temper, 1e-6..=1e3)?;
        check("located_explained", self.located_explained, 0.0..=1.0)?;
        if self.min_particles > self.max_particles {
            let expected = format!("at most max_particles, {}", self.max_particles);
            return Err(ConfigError::value("min_particles", self.min_particles, expected));
        }
        self.scan.validate()?;
        self.motion.check("motion")?;
        self.tracking.check("tracking")?;
        self.likelihood.check("likelihood")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_and_says_what_would_do() {
        for (text, expected) in [
            ("max_particles = 9", "min_particles is 1000, but has to be at most max_particles, 9"),
            ("max_particles = 0", "max_particles is 0, but has to be 1 to 10000000"),
            ("located_explained = 1.5", "located_explained is 1.5, but has to be 0 to 1"),
            ("[motion]\nheading_floor = 0", "motion.heading_floor is 0, but has to be"),
            ("[scan]\nmin_range = nan", "scan.min_range is NaN"),
            ("[tracking]\nstep_turn = -1", "tracking.step_turn is -1"),
            ("[likelihood]\nend_sigma = 0", "likelihood.end_sigma is 0"),
        ] {
            let message = LocalizationConfig::default().with_toml(text).unwrap().validate().unwrap_err().to_string();
            assert!(message.contains(expected), "{message:?} does not say {expected:?}");
        }
        assert!(LocalizationConfig::default().with_toml("maps = 3").is_err(), "of mapping");
    }
}
