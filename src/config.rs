//! Everything that can be set about a run, with the defaults and the paper's own values.

use crate::clustering::ClusteringConfig;
use crate::evaluator::ProposalConfig;
use crate::geometry::Pose;
use crate::likelihood::{Latent, LikelihoodConfig};
use crate::localization::LocalizationConfig;
use crate::map::matching::{MatchingConfig, MatchingRule};
use crate::map::merging::{MergingConfig, MergingMethod};
use crate::motion::MotionConfig;
use crate::smoothing::SmoothingConfig;
use serde::{Deserialize, Serialize};

/// The configuration of a run. A file may set any part of it; what it leaves out keeps its default.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Pose particles, at least as many as maps.
    pub particles: usize,
    /// Map hypotheses. `particles == maps` is the paper's filter.
    pub maps: usize,
    /// From ranges to points.
    pub scan: ScanConfig,
    /// From points to clusters.
    pub clustering: ClusteringConfig,
    /// From odometry to motion.
    pub motion: MotionConfig,
    /// From motion and scan to a proposal.
    pub proposal: ProposalConfig,
    /// From points and map to a weight.
    pub likelihood: LikelihoodConfig,
    /// Which map cluster a scan cluster is.
    pub matching: MatchingConfig,
    /// How it becomes part of the map.
    pub merging: MergingConfig,
    /// When the filter takes a step, and when it resamples.
    pub filter: FilterConfig,
    /// What comes after it.
    pub smoothing: SmoothingConfig,
    /// Finding the robot in a map that is known.
    pub localization: LocalizationConfig,
}

/// Which ranges count.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScanConfig {
    /// Shorter ranges are no measurement \[m\].
    pub min_range: f64,
    /// Ranges from here on are not used, or no return \[m\].
    pub max_range: f64,
}

/// When the filter acts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FilterConfig {
    /// A step is taken once the robot has moved this far \[m\] ...
    pub step_distance: f64,
    /// ... or turned this far \[rad\]. Both zero: a step every scan, as in the paper.
    pub step_turn: f64,
    /// Resample where the effective sample size falls below this share of the maps; 1 resamples every step.
    pub resample_below: f64,
    /// Weigh a particle by its map after the scan was merged into it (Table I, 6c), not before.
    pub weigh_merged_map: bool,
}

impl Default for ScanConfig {
    fn default() -> Self {
        Self { min_range: 0.1, max_range: 30.0 }
    }
}

impl FilterConfig {
    /// Whether a robot that has moved so since the last step is still too near for another one.
    pub fn is_too_near(&self, moved: Pose) -> bool {
        moved.x.hypot(moved.y) < self.step_distance && moved.heading.abs() < self.step_turn
    }
}

impl Default for FilterConfig {
    fn default() -> Self {
        Self { step_distance: 0.3, step_turn: 0.2, resample_below: 0.5, weigh_merged_map: false }
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            seed: 1,
            particles: 256,
            maps: 256,
            scan: ScanConfig::default(),
            clustering: ClusteringConfig::default(),
            motion: MotionConfig::default(),
            proposal: ProposalConfig::default(),
            likelihood: LikelihoodConfig::default(),
            matching: MatchingConfig::default(),
            merging: MergingConfig::default(),
            filter: FilterConfig::default(),
            smoothing: SmoothingConfig::default(),
            localization: LocalizationConfig::default(),
        }
    }
}

impl Config {
    /// Table I to the letter, with the paper's numbers where it gives any.
    pub fn paper() -> Self {
        Self {
            particles: 201,
            maps: 201,
            clustering: ClusteringConfig {
                min_points: 10,
                max_across: f64::INFINITY,
                max_gap: f64::INFINITY,
                ..ClusteringConfig::default()
            },
            motion: MotionConfig::default(),
            proposal: ProposalConfig { iterations: 0, spread: 1.0, tracking_starts: 0 },
            likelihood: LikelihoodConfig {
                latent: Latent::Normal,
                sigma_floor: 0.05,
                capture_sigma: 0.05,
                end_sigma: 0.05,
                outlier_density: 1e-8,
                temper: 1.0,
                max_points: u32::MAX as usize,
            },
            matching: MatchingConfig {
                rule: MatchingRule::Paper,
                max_angle: 60f64.to_radians(),
                max_distance: 0.5,
                max_gap: 0.0,
            },
            merging: MergingConfig {
                method: MergingMethod::Incremental,
                min_points: 20.0,
                max_across: 0.15,
                consolidate: false,
                cluster_cost: 0.0,
                min_sightings: 0,
                clutter_age: 0,
            },
            filter: FilterConfig { step_distance: 0.0, step_turn: 0.0, resample_below: 1.0, weigh_merged_map: true },
            smoothing: SmoothingConfig { passes: 0, ..SmoothingConfig::default() },
            ..Self::default()
        }
    }
}

/// Largest number of pose particles that is accepted; ten million take about a gigabyte.
const MOST_PARTICLES: usize = 10_000_000;

/// Numbers with limits of their own, least and greatest; all others may be anything from 0 on, infinity included.
const LIMITS: [(&str, f64, f64); 30] = [
    ("scan.min_range", 0.0, 1e6),
    ("clustering.min_points", 2.0, 1e6),
    ("clustering.noise", 1e-6, 1e3),
    ("clustering.outlier_probability", 1e-12, 1.0),
    ("motion.position_per_distance", 0.0, 1e3),
    ("motion.position_per_turn", 0.0, 1e3),
    ("motion.heading_per_distance", 0.0, 1e3),
    ("motion.heading_per_turn", 0.0, 1e3),
    ("motion.position_floor", 1e-6, 1e3),
    ("motion.heading_floor", 1e-6, 1e3),
    ("likelihood.sigma_floor", 1e-6, 1e3),
    ("likelihood.capture_sigma", 1e-6, 1e3),
    ("likelihood.end_sigma", 1e-6, 1e3),
    ("likelihood.outlier_density", 1e-30, 1e6),
    ("likelihood.temper", 1e-6, 1e3),
    ("likelihood.max_points", 1.0, f64::INFINITY),
    ("proposal.iterations", 0.0, 1e4),
    ("proposal.spread", 0.0, 1e3),
    ("proposal.tracking_starts", 0.0, 1e6),
    ("filter.resample_below", 0.0, 1.0),
    ("smoothing.position", 1e-6, 1e3),
    ("smoothing.heading", 1e-6, 1e3),
    ("smoothing.keep_explained", 0.0, 1.0),
    ("localization.max_particles", 1.0, 1e7),
    ("localization.min_particles", 1.0, 1e7),
    ("localization.temper", 1e-6, 1e3),
    ("localization.min_sigma", 1e-6, 1e3),
    ("localization.max_sigma", 1e-6, 1e3),
    ("localization.located_weight", 0.0, 1.0),
    ("localization.located_explained", 0.0, 1.0),
];

/// Why a configuration cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The text is no TOML, or a key of it is unknown or of another type.
    #[error("the configuration cannot be understood: {0}")]
    Toml(#[from] toml::de::Error),
    /// A value that cannot be.
    #[error("{name} is {value}, but has to be {expected}")]
    Value {
        /// The key in a file, and the option where there is one.
        name: String,
        /// What was asked for.
        value: String,
        /// What is possible.
        expected: String,
    },
}

impl ConfigError {
    fn value(name: &str, value: impl ToString, expected: impl Into<String>) -> Self {
        Self::Value { name: name.to_owned(), value: value.to_string(), expected: expected.into() }
    }
}

impl Config {
    /// This configuration, with the parts that a TOML text sets in place of its own.
    ///
    /// # Errors
    /// The text is no TOML, or a key is unknown or of another type; the message names the line and the key. Values are
    /// the business of [`Config::validate`].
    pub fn with_toml(&self, text: &str) -> Result<Self, ConfigError> {
        // Read as a whole configuration first: only so do errors know their line.
        toml::from_str::<Self>(text)?;
        let mut table = self.to_table()?;
        overlay(&mut table, toml::from_str(text)?);
        Ok(table.try_into()?)
    }

    /// Whether a run is possible with it.
    ///
    /// # Errors
    /// The first value that is not possible, with what would be.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let Self { particles, maps, .. } = *self;
        if !(1..=MOST_PARTICLES).contains(&particles) {
            let expected = format!("1 to {MOST_PARTICLES}");
            return Err(ConfigError::value("particles (option --particles)", particles, expected));
        }
        if !(1..=particles).contains(&maps) {
            let expected = format!("1 to the number of particles, which is {particles}");
            return Err(ConfigError::value("maps (option --maps)", maps, expected));
        }
        if particles % maps != 0 {
            let (fewer, more) = (particles / maps * maps, particles.next_multiple_of(maps));
            let expected = format!("a multiple of the number of maps, which is {maps}: {fewer} or {more}");
            return Err(ConfigError::value("particles (option --particles)", particles, expected));
        }
        if self.filter.weigh_merged_map && particles != maps {
            let expected = format!("the number of maps, which is {maps}, where filter.weigh_merged_map is set");
            return Err(ConfigError::value("particles (option --particles)", particles, expected));
        }
        check_numbers("", &self.to_table()?)?;
        let LocalizationConfig { min_particles, max_particles, .. } = self.localization;
        if min_particles > max_particles {
            let expected = format!("at most localization.max_particles, {max_particles}");
            return Err(ConfigError::value("localization.min_particles", min_particles, expected));
        }
        let LocalizationConfig { min_sigma, max_sigma, .. } = self.localization;
        if min_sigma > max_sigma {
            let expected = format!("at most localization.max_sigma, {max_sigma}");
            return Err(ConfigError::value("localization.min_sigma", min_sigma, expected));
        }
        let ScanConfig { min_range, max_range } = self.scan;
        if min_range >= max_range {
            return Err(ConfigError::value("scan.max_range", max_range, format!("above scan.min_range, {min_range}")));
        }
        Ok(())
    }

    fn to_table(self) -> Result<toml::Table, ConfigError> {
        // TOML's integers end at 2⁶³ - 1; only a seed comes near.
        toml::Table::try_from(self)
            .map_err(|_| ConfigError::value("seed (option --seed)", self.seed, format!("at most {}", i64::MAX)))
    }
}

fn overlay(base: &mut toml::Table, over: toml::Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(toml::Value::Table(base)), toml::Value::Table(over)) => overlay(base, over),
            (_, value) => drop(base.insert(key, value)),
        }
    }
}

/// Checks every number of a table; `prefix` is the way to it, with a dot at the end.
fn check_numbers(prefix: &str, table: &toml::Table) -> Result<(), ConfigError> {
    for (key, value) in table {
        let name = format!("{prefix}{key}");
        let number = match value {
            toml::Value::Table(inner) => {
                check_numbers(&format!("{name}."), inner)?;
                continue;
            }
            toml::Value::Float(number) => *number,
            toml::Value::Integer(number) => *number as f64,
            _ => continue,
        };
        let limits = LIMITS.iter().find(|limits| limits.0 == name);
        let (least, greatest) = limits.map_or((0.0, f64::INFINITY), |limits| (limits.1, limits.2));
        if !(least..=greatest).contains(&number) {
            let most = if greatest.is_finite() { format!(" to {greatest}") } else { " or more".to_owned() };
            return Err(ConfigError::value(&name, value, format!("{least}{most}")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_can_be_used_and_written() {
        for config in [Config::default(), Config::paper()] {
            config.validate().unwrap();
            let text = toml::to_string(&config).unwrap();
            // Read over the other preset, so that every key has to be in the text.
            assert_eq!(Config::paper().with_toml(&text).unwrap(), config);
            assert_eq!(Config::default().with_toml(&text).unwrap(), config);
        }
    }

    #[test]
    fn every_limit_is_of_a_number_that_exists() {
        let table = Config::default().to_table().unwrap();
        for (name, ..) in LIMITS {
            let (section, key) = name.split_once('.').unwrap();
            assert!(table[section].get(key).is_some(), "{name}");
        }
    }

    #[test]
    fn a_file_sets_what_it_names() {
        let config = Config::paper().with_toml("particles = 402\n[likelihood]\ntemper = 0.5\n").unwrap();
        let mut expected = Config::paper();
        expected.particles = 402;
        expected.likelihood.temper = 0.5;
        assert_eq!(config, expected);
        assert_eq!(Config::paper().with_toml("").unwrap(), Config::paper());
    }

    #[test]
    fn a_map_weighed_after_merging_has_one_pose() {
        let message = Config { particles: 402, ..Config::paper() }.validate().unwrap_err().to_string();
        assert!(message.contains("is 402, but has to be the number of maps, which is 201"), "{message}");
    }

    #[test]
    fn refuses_and_says_what_would_do() {
        for (text, expected) in [
            ("partickles = 3", "line 1, column 1"),
            ("partickles = 3", "unknown field `partickles`"),
            ("[filter]\nresample = 0.5", "unknown field `resample`"),
            ("maps = -1", "invalid value"),
            ("maps = \"two\"", "invalid type"),
            ("maps =", "line 1"),
        ] {
            let message = Config::default().with_toml(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message:?} does not say {expected:?}");
        }
        for (text, expected) in [
            ("particles = 0", "particles (option --particles) is 0, but has to be 1 to 10000000"),
            ("particles = 20000000\nmaps = 1", "is 20000000, but has to be 1 to"),
            ("maps = 0", "maps (option --maps) is 0, but has to be 1 to the number of particles, which is 256"),
            ("maps = 257", "maps (option --maps) is 257"),
            ("particles = 10\nmaps = 4", "multiple of the number of maps, which is 4: 8 or 12"),
            ("[likelihood]\ntemper = nan", "likelihood.temper is nan, but has to be 0.000001 to 1000"),
            ("[likelihood]\nmax_points = 0", "likelihood.max_points is 0, but has to be 1 or more"),
            ("[matching]\nmax_angle = -0.5", "matching.max_angle is -0.5, but has to be 0 or more"),
            ("[motion]\nheading_floor = inf", "motion.heading_floor is inf"),
            ("[filter]\nresample_below = 1.5", "filter.resample_below is 1.5, but has to be 0 to 1"),
            (
                "[localization]\nmin_sigma = 0.6",
                "localization.min_sigma is 0.6, but has to be at most localization.max",
            ),
            ("[localization]\nmax_particles = 9", "localization.min_particles is 1000, but has to be at most"),
            ("[scan]\nmin_range = 5\nmax_range = 5", "scan.max_range is 5, but has to be above scan.min_range, 5"),
        ] {
            let message = Config::default().with_toml(text).unwrap().validate().unwrap_err().to_string();
            assert!(message.contains(expected), "{message:?} does not say {expected:?}");
        }
        let huge = Config { seed: u64::MAX, ..Config::default() };
        assert!(huge.validate().unwrap_err().to_string().contains("--seed) is 18446744073709551615"));
    }
}
