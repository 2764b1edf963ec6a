//! The configuration of mapping, with the defaults and the paper's own values.

use crate::ablation::{AblationConfig, Latent, MatchingRule, MergingMethod};
use crate::clustering::ClusteringConfig;
use crate::evaluator::ProposalConfig;
use crate::likelihood::LikelihoodConfig;
use crate::loops::{Closer, LoopConfig};
use crate::map::matching::MatchingConfig;
use crate::map::merging::MergingConfig;
use crate::motion::MotionConfig;
use crate::parameters::{ConfigError, Parameter, check_seed, explained, parameters, with_toml};
use crate::scan::ScanConfig;
use crate::smoothing::{Smoother, SmoothingConfig};
use crate::tracking::TrackingConfig;
use serde::{Deserialize, Serialize};

/// The configuration of mapping. A file may set any part of it; what it leaves out keeps its default.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SlamConfig {
    /// Seed of all random numbers, up to 2⁶³ - 1.
    pub seed: u64,
    /// Pose particles: a multiple of the maps, up to ten million.
    pub particles: usize,
    /// Map hypotheses, 1 to 100 000. `particles == maps` is the paper's filter.
    pub maps: usize,
    /// From ranges to points.
    pub scan: ScanConfig,
    /// From points to clusters.
    pub clustering: ClusteringConfig,
    /// From odometry to motion.
    pub motion: MotionConfig,
    /// Between steps.
    pub tracking: TrackingConfig,
    /// From motion and scan to a proposal.
    pub proposal: ProposalConfig,
    /// From points and map to a weight.
    pub likelihood: LikelihoodConfig,
    /// Which map cluster a scan cluster is.
    pub matching: MatchingConfig,
    /// How it becomes part of the map.
    pub merging: MergingConfig,
    /// Tempering and resampling.
    pub filter: FilterConfig,
    /// Searching for loops.
    pub loops: LoopConfig,
    /// What comes after the filter.
    pub smoothing: SmoothingConfig,
    /// The paper's own rules in place of ours.
    pub ablation: AblationConfig,
}

parameters! {
    /// Tempering of weights, and resampling.
    pub struct FilterConfig {
        /// Log-likelihoods are multiplied by this: neighbouring beams do not err independently. 1 in the paper.
        temper: f64 = 0.025, in 1e-6..=1e3;
        /// Resample where the effective sample size falls below this share of the maps; 1 resamples every step.
        resample_below: f64 = 0.5, in 0.0..=1.0;
    }
}

impl Default for SlamConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            particles: 32,
            maps: 32,
            scan: ScanConfig::default(),
            clustering: ClusteringConfig::default(),
            motion: MotionConfig::default(),
            tracking: TrackingConfig::default(),
            proposal: ProposalConfig::default(),
            likelihood: LikelihoodConfig::default(),
            matching: MatchingConfig::default(),
            merging: MergingConfig::default(),
            filter: FilterConfig::default(),
            loops: LoopConfig::default(),
            smoothing: SmoothingConfig::default(),
            ablation: AblationConfig::default(),
        }
    }
}

/// Largest number of pose particles that is accepted; ten million take about a gigabyte.
const MAX_PARTICLES: usize = 10_000_000;

/// Largest number of maps that is accepted; each takes about ten kilobytes, so that these take a gigabyte.
const MAX_MAPS: usize = 100_000;

impl SlamConfig {
    /// Table I to the letter, with the paper's numbers where it gives any. Which readings of its text give its results:
    /// docs/paper.md.
    pub fn paper() -> Self {
        Self {
            particles: 201,
            maps: 201,
            clustering: ClusteringConfig {
                min_points: 5,
                max_across: f64::INFINITY,
                max_gap: f64::INFINITY,
                ..ClusteringConfig::default()
            },
            motion: MotionConfig {
                heading_per_distance: 0.07,
                heading_per_turn: 0.1,
                heading_floor: 0.02,
                ..MotionConfig::default()
            },
            tracking: TrackingConfig {
                step_distance: 1.0,
                step_turn: f64::INFINITY,
                starts: 0,
                ..TrackingConfig::default()
            },
            proposal: ProposalConfig { iterations: 0, capture_sigma: 0.05, spread: 1.0 },
            likelihood: LikelihoodConfig {
                sigma_floor: 0.05,
                end_sigma: 0.05,
                outlier_density: 0.01,
                max_points: u32::MAX as usize,
            },
            matching: MatchingConfig { max_angle: 60f64.to_radians(), max_distance: 0.2, max_gap: 0.0 },
            merging: MergingConfig {
                min_points: 10.0,
                max_across: 0.05,
                new_density: 0.01,
                cluster_cost: 0.0,
                min_sightings: 0,
                clutter_age: 0,
            },
            filter: FilterConfig { temper: 1.0, resample_below: 1.0 },
            loops: LoopConfig { search_distance: 0.0, ..LoopConfig::default() },
            smoothing: SmoothingConfig { passes: 0, ..SmoothingConfig::default() },
            ablation: AblationConfig {
                latent: Latent::Normal,
                matching: MatchingRule::Paper,
                merging: MergingMethod::Incremental,
                consolidate: false,
                weigh_merged_map: false,
            },
            ..Self::default()
        }
    }

    /// The part of it that closing loops takes.
    pub fn closer(&self) -> Closer {
        let Self { likelihood, matching, merging, ablation, loops, .. } = *self;
        Closer { loops, likelihood, matching, merging, ablation }
    }

    /// The part of it that smoothing takes.
    pub fn smoother(&self) -> Smoother {
        let Self { scan, likelihood, matching, merging, ablation, smoothing, .. } = *self;
        Smoother { scan, likelihood, matching, merging, ablation, smoothing }
    }

    /// This configuration, with the parts that a TOML text sets in place of its own.
    ///
    /// # Errors
    /// The text is no TOML, or a key is unknown or of another type; the message names the line and the key. Values are
    /// the business of [`SlamConfig::validate`].
    pub fn with_toml(&self, text: &str) -> Result<Self, ConfigError> {
        with_toml(self, text)
    }

    /// The defaults as TOML, each with meaning, unit and range.
    pub fn explained() -> String {
        let Self { seed, particles, maps, .. } = Self::default();
        let of_all = [
            Parameter::new("seed", &["Seed of all random numbers, up to 2^63 - 1."], seed as i64),
            Parameter::new("particles", &["Pose particles: a multiple of the maps, up to ten million."], particles),
            Parameter::new("maps", &["Map hypotheses, 1 to 100000."], maps),
        ];
        let sections = [
            explained::<ScanConfig>("scan"),
            explained::<ClusteringConfig>("clustering"),
            explained::<MotionConfig>("motion"),
            explained::<TrackingConfig>("tracking"),
            explained::<ProposalConfig>("proposal"),
            explained::<LikelihoodConfig>("likelihood"),
            explained::<MatchingConfig>("matching"),
            explained::<MergingConfig>("merging"),
            explained::<FilterConfig>("filter"),
            explained::<LoopConfig>("loops"),
            explained::<SmoothingConfig>("smoothing"),
            explained::<AblationConfig>("ablation"),
        ];
        of_all.iter().map(Parameter::explained).chain(sections).collect()
    }

    /// Whether a run is possible with it.
    ///
    /// # Errors
    /// The first value that is not possible, with what would be.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let Self { particles, maps, .. } = *self;
        if !(1..=MAX_PARTICLES).contains(&particles) {
            let expected = format!("1 to {MAX_PARTICLES}");
            return Err(ConfigError::value("particles (option --particles)", particles, expected));
        }
        if maps > MAX_MAPS {
            return Err(ConfigError::value("maps (option --maps)", maps, format!("1 to {MAX_MAPS}")));
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
        if self.ablation.weigh_merged_map && particles != maps {
            let expected = format!("the number of maps, which is {maps}, where ablation.weigh_merged_map is set");
            return Err(ConfigError::value("particles (option --particles)", particles, expected));
        }
        check_seed(self.seed)?;
        self.scan.validate()?;
        self.clustering.check("clustering")?;
        self.motion.check("motion")?;
        self.tracking.check("tracking")?;
        self.proposal.check("proposal")?;
        self.likelihood.check("likelihood")?;
        self.matching.check("matching")?;
        self.merging.check("merging")?;
        self.filter.check("filter")?;
        self.loops.check("loops")?;
        self.smoothing.check("smoothing")?;
        self.ablation.check("ablation")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_can_be_used_and_written() {
        for config in [SlamConfig::default(), SlamConfig::paper()] {
            config.validate().unwrap();
            let text = toml::to_string(&config).unwrap();
            // Read over the other preset, so that every key has to be in the text.
            assert_eq!(SlamConfig::paper().with_toml(&text).unwrap(), config);
            assert_eq!(SlamConfig::default().with_toml(&text).unwrap(), config);
        }
    }

    /// Every number of every section is refused where it is not a number.
    #[test]
    fn every_section_is_checked() {
        let table = toml::Table::try_from(SlamConfig::default()).unwrap();
        let mut checked = 0;
        for (section, values) in table.iter().filter_map(|(name, value)| Some((name, value.as_table()?))) {
            for (key, value) in values {
                let wrong = match value {
                    toml::Value::Float(_) => "nan",
                    toml::Value::Integer(_) if key == "passes" || key == "starts" => continue,
                    toml::Value::Integer(_) if value.as_integer() > Some(1) && key != "min_points" => continue,
                    toml::Value::Integer(_) => "0",
                    _ => continue,
                };
                let text = format!("[{section}]\n{key} = {wrong}");
                let error = SlamConfig::default().with_toml(&text).unwrap().validate().unwrap_err().to_string();
                assert!(error.starts_with(&format!("{section}.{key} is")), "{error}");
                checked += 1;
            }
        }
        assert!(checked > 15, "{checked} numbers checked");
    }

    #[test]
    fn a_file_sets_what_it_names() {
        let config = SlamConfig::paper().with_toml("particles = 402\n[filter]\ntemper = 0.5\n").unwrap();
        let mut expected = SlamConfig::paper();
        expected.particles = 402;
        expected.filter.temper = 0.5;
        assert_eq!(config, expected);
        assert_eq!(SlamConfig::paper().with_toml("").unwrap(), SlamConfig::paper());
    }

    #[test]
    fn a_map_weighed_after_merging_has_one_pose() {
        let mut config = SlamConfig { particles: 402, ..SlamConfig::paper() };
        assert!(config.validate().is_ok());
        config.ablation.weigh_merged_map = true;
        let message = config.validate().unwrap_err().to_string();
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
            let message = SlamConfig::default().with_toml(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message:?} does not say {expected:?}");
        }
        for (text, expected) in [
            ("particles = 0", "particles (option --particles) is 0, but has to be 1 to 10000000"),
            ("particles = 20000000\nmaps = 1", "is 20000000, but has to be 1 to"),
            ("maps = 0", "maps (option --maps) is 0, but has to be 1 to the number of particles, which is 32"),
            ("maps = 257", "maps (option --maps) is 257"),
            ("particles = 10000000\nmaps = 10000000", "maps (option --maps) is 10000000, but has to be 1 to 100000"),
            ("particles = 10\nmaps = 4", "multiple of the number of maps, which is 4: 8 or 12"),
            ("[filter]\ntemper = nan", "filter.temper is NaN, but has to be 0.000001 to 1000"),
            ("[likelihood]\nmax_points = 0", "likelihood.max_points is 0, but has to be 1 or more"),
            ("[matching]\nmax_angle = -0.5", "matching.max_angle is -0.5, but has to be 0 or more"),
            ("[motion]\nheading_floor = inf", "motion.heading_floor is inf"),
            ("[filter]\nresample_below = 1.5", "filter.resample_below is 1.5, but has to be 0 to 1"),
            ("[scan]\nmin_range = 5\nmax_range = 5", "scan.max_range is 5, but has to be above scan.min_range, 5"),
        ] {
            let message = SlamConfig::default().with_toml(text).unwrap().validate().unwrap_err().to_string();
            assert!(message.contains(expected), "{message:?} does not say {expected:?}");
        }
        let huge = SlamConfig { seed: u64::MAX, ..SlamConfig::default() };
        assert!(huge.validate().unwrap_err().to_string().contains("--seed) is 18446744073709551615"));
    }
}
