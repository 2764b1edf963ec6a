//! Options that set the configuration of a run.

#[cfg(feature = "live")]
use super::UsageError;
use anyhow::{Context as _, anyhow};
use clap::ValueEnum;
#[cfg(feature = "record")]
use ipslam::config::SemanticConfig;
use ipslam::config::{LocalizationConfig, SlamConfig};
use ipslam::io::{TextError, read_text};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// What is set, and by what.
#[derive(Debug, clap::Args)]
pub struct ConfigArgs {
    /// Values to start from
    #[arg(long, value_enum)]
    preset: Option<Preset>,
    /// TOML file that sets any part of the configuration, in place of the preset's; config.toml among the outputs is one
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Pose particles, made a multiple of the maps; in place of the configuration's; named alone, --maps changes them in proportion
    #[arg(long, allow_negative_numbers = true)]
    particles: Option<usize>,
    /// Maps; in place of the configuration's
    #[arg(long, allow_negative_numbers = true)]
    maps: Option<usize>,
    /// Seed of all random numbers; in place of the configuration's
    #[arg(long, allow_negative_numbers = true)]
    seed: Option<u64>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Preset {
    /// What works best
    Default,
    /// The filter of the paper, to the letter
    Paper,
}

impl ConfigArgs {
    /// Options win over the file, the file over the preset, the preset over `base`.
    pub fn over(&self, base: SlamConfig) -> anyhow::Result<SlamConfig> {
        let mut config = match self.preset {
            None => base,
            Some(Preset::Default) => SlamConfig::default(),
            Some(Preset::Paper) => SlamConfig::paper(),
        };
        if let Some(path) = &self.config {
            config = config.with_toml(&read(path)?).with_context(|| path.display().to_string())?;
        }
        // Where only the maps are named, each keeps as many poses as it had.
        let poses_per_map = config.particles / config.maps.max(1);
        let as_many = self.maps.filter(|&maps| maps > 0).map(|maps| maps.saturating_mul(poses_per_map));
        config.particles = self.particles.or(as_many).unwrap_or(config.particles);
        config.maps = self.maps.unwrap_or(config.maps);
        config.seed = self.seed.unwrap_or(config.seed);
        // A round number of particles is what people name: maps that were not named have to divide it.
        if let (Some(particles), None) = (self.particles, self.maps)
            && particles > config.maps
            && config.maps > 0
        {
            config.particles = particles.checked_next_multiple_of(config.maps).unwrap_or(particles);
        }
        config.validate()?;
        Ok(config)
    }
}

#[cfg(feature = "live")]
impl ConfigArgs {
    /// The same for finding a robot in a map, which has neither presets nor maps.
    pub fn of_localization(&self) -> anyhow::Result<LocalizationConfig> {
        let Self { preset, config, particles, maps, seed } = self;
        anyhow::ensure!(
            preset.is_none() && maps.is_none(),
            UsageError("--preset and --maps are for mapping; with a map, there is one".to_owned())
        );
        localization(config.as_deref(), *seed, *particles)
    }
}

/// The configuration of a file, or of none, with this seed and at most so many particles where they are named.
pub fn localization(
    file: Option<&Path>,
    seed: Option<u64>,
    max_particles: Option<usize>,
) -> anyhow::Result<LocalizationConfig> {
    let mut config = LocalizationConfig::default();
    if let Some(path) = file {
        config = config.with_toml(&read(path)?).with_context(|| path.display().to_string())?;
    }
    config.seed = seed.unwrap_or(config.seed);
    config.max_particles = max_particles.unwrap_or(config.max_particles);
    config.min_particles = max_particles.map_or(config.min_particles, |most| most.min(config.min_particles));
    config.validate()?;
    Ok(config)
}

#[cfg(feature = "record")]
impl ConfigArgs {
    /// The same for mapping objects, which has neither presets nor particles nor random numbers.
    pub fn over_semantic(&self, base: SemanticConfig) -> anyhow::Result<SemanticConfig> {
        let Self { preset, config: file, particles, maps, seed } = self;
        anyhow::ensure!(
            preset.is_none() && particles.is_none() && maps.is_none() && seed.is_none(),
            "--preset, --particles, --maps and --seed are for what `ipslam run` recorded; --config changes how objects are mapped"
        );
        let mut config = base;
        if let Some(path) = file {
            config = config.with_toml(&read(path)?).with_context(|| path.display().to_string())?;
        }
        config.validate()?;
        Ok(config)
    }
}

/// Prints the configuration of `run`: every parameter with its default, and above it meaning, unit and range.
#[derive(Debug, clap::Args)]
#[command(after_help = "To change some of it: ipslam config > my.toml; ipslam run LOG --config my.toml")]
pub struct ExplainArgs {}

/// Prints it.
pub fn explain(_: &ExplainArgs) -> anyhow::Result<()> {
    Ok(std::io::stdout().write_all(SlamConfig::explained().as_bytes())?)
}

/// Longer texts are no configuration [bytes].
const MAX_LENGTH: u64 = 1 << 20;

/// The text of a configuration.
pub fn read(path: &Path) -> anyhow::Result<String> {
    let shown = path.display();
    read_text(path, MAX_LENGTH).map_err(|error| match error {
        TextError::Read(source) => anyhow::Error::new(source).context(format!("{shown}: cannot be read")),
        other => anyhow!("{shown}: this is no configuration, a TOML text: {other}"),
    })
}
