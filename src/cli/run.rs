//! `ipslam run`: a log in; trajectory, map, pictures and a summary out.

use super::backend::{BackendArgs, Chosen};
use super::eval::Report;
use super::interrupt;
use super::log::LogArgs;
use super::mapping::{End, Mapped, map_log};
use super::output::Outputs;
use super::recording::RecordingArgs;
use super::summary::Summary;
use anyhow::{Context as _, anyhow};
use clap::ValueEnum;
use ipslam::config::Config;
use ipslam::geometry::StampedPose;
use ipslam::io::{LogSource, relations, tum};
use ipslam::metrics::relations::relation_errors;
use ipslam::metrics::trajectory::reference_errors;
use ipslam::simulate::Simulation;
use ipslam::slam::Slam;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Maps a log, or without one a simulated drive through the built-in building: writes trajectory, map, pictures and a
/// summary.
#[derive(Debug, clap::Args)]
pub struct RunArgs {
    #[command(flatten)]
    log: LogArgs,
    /// Folder for the outputs, made where it is missing [default: ipslam-out/NAME OF THE LOG]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Values to start from
    #[arg(long, value_enum, default_value_t = Preset::Default)]
    preset: Preset,
    /// TOML file that sets any part of the configuration, in place of the preset's; config.toml among the outputs is one
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Pose particles, a multiple of the maps; in place of the configuration's; named alone, --maps changes them in proportion
    #[arg(long, allow_negative_numbers = true)]
    particles: Option<usize>,
    /// Maps; in place of the configuration's
    #[arg(long, allow_negative_numbers = true)]
    maps: Option<usize>,
    /// Seed of all random numbers; in place of the configuration's
    #[arg(long, allow_negative_numbers = true)]
    seed: Option<u64>,
    /// Threads, up to 1024; 0 for one for each core. The result does not depend on it
    #[arg(long, default_value_t = 0, allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,
    /// End after so many laser readings
    #[arg(long, value_name = "COUNT", allow_negative_numbers = true, value_parser = clap::value_parser!(u64).range(1..))]
    max_scans: Option<u64>,
    /// Relations of the SLAM benchmark (t1 t2 x y z roll pitch yaw) to score the trajectory by
    #[arg(long, value_name = "FILE")]
    relations: Option<PathBuf>,
    /// Reference trajectory (TUM or t x y theta) to score by and to draw; without one, true poses in the log are used
    #[arg(long, value_name = "FILE")]
    reference: Option<PathBuf>,
    #[command(flatten)]
    backend: BackendArgs,
    #[command(flatten)]
    recording: RecordingArgs,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Preset {
    /// What works best
    Default,
    /// The filter of the paper, to the letter
    Paper,
}

/// Maps the log. What went wrong while the run could go on is returned as a list, and what ended it as the error.
pub fn run(args: &RunArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    let config = args.config()?;
    let config_text = toml::to_string(&config)?;
    let relations = args.relations.as_deref().map(relations::read).transpose()?;
    let reference = args.reference.as_deref().map(tum::read).transpose()?;
    let source = args.source()?;
    source.open()?;
    let name = source.name();
    let folder = args.out.clone().unwrap_or_else(|| Path::new("ipslam-out").join(&name));
    let mut outputs = Outputs::new(folder)?;
    let mut observers = args.recording.observers(&name)?;
    let threads = usize::from(args.threads);
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("no threads (option --threads)")?;
    interrupt::watch()?;

    let Chosen { evaluator, name: device } = args.backend.choose()?;
    eprintln!("mapping {name}: {} particles in {} maps on the {device}", config.particles, config.maps);
    let slam = match evaluator {
        Some(evaluator) => Slam::with_evaluator(config, evaluator),
        None => Slam::new(config),
    };
    let mut mapped = map_log(&*source, slam, &config, args.max_scans, &mut observers)?;
    let failures: Vec<String> = observers.iter().filter_map(|observer| observer.failure()).map(str::to_owned).collect();
    drop(observers);
    failures.into_iter().for_each(|failure| outputs.note(Err(anyhow!("the recording is not whole: {failure}"))));
    if mapped.tally.scans == 0 {
        return args.nothing_mapped(mapped);
    }

    let smoothed = std::mem::replace(&mut mapped.smoothing, Ok(()));
    outputs.note(smoothed.map_err(|error| anyhow!(error).context("the log cannot be read again to smooth the map")));
    let trajectory_path = outputs.path("trajectory.tum");
    outputs.write_trajectory("trajectory.tum", &mapped.result.trajectory);
    let map_bytes = outputs.write_map(&mapped);
    outputs.write("config.toml", config_text.as_bytes());

    let trajectory = &mapped.result.trajectory;
    let mut report =
        Report { trajectory_path: &trajectory_path, poses: trajectory.len(), relations: None, reference: None };
    if let (Some(path), Some(relations)) = (&args.relations, &relations) {
        report.relations = Some((path, relation_errors(relations, trajectory)));
    }
    let truth_path = args.reference.as_deref().unwrap_or(Path::new("(true poses of the log)"));
    let mut truth = reference.unwrap_or_else(|| mapped.truth.clone());
    if !truth.is_empty() {
        let errors = reference_errors(&truth, trajectory);
        let world_from_reference = errors.reference_from_world.inverse();
        truth.iter_mut().for_each(|StampedPose { pose, .. }| *pose = world_from_reference * *pose);
        report.reference = Some((truth_path, errors));
    }

    let began = Instant::now();
    outputs.draw(&*source, &config, &mapped, &truth);
    let drawing_seconds = began.elapsed().as_secs_f64();
    let summary = Summary {
        name: &name,
        device: &device,
        mapped: &mapped,
        config: &config,
        map_bytes,
        drawing_seconds,
        report: &report,
    };
    outputs.write("summary.json", format!("{:#}\n", summary.json()?).as_bytes());
    // Whoever closed this pipe has read enough; the summary is in its file.
    let _ = std::io::stdout().write_all(summary.table().as_bytes());
    eprintln!("outputs are in {}", outputs.folder().display());
    if let End::BrokeOff(error) = mapped.end {
        outputs.note(Err(error));
    }
    Ok(outputs.errors)
}

impl RunArgs {
    /// Options win over the file, the file over the preset.
    fn config(&self) -> anyhow::Result<Config> {
        let mut config = match self.preset {
            Preset::Default => Config::default(),
            Preset::Paper => Config::paper(),
        };
        if let Some(path) = &self.config {
            let shown = path.display();
            let text = std::fs::read_to_string(path).with_context(|| format!("{shown}: cannot be read"))?;
            config = config.with_toml(&text).with_context(|| shown.to_string())?;
        }
        // Where only the maps are named, each keeps as many poses as it had.
        let poses_a_map = config.particles / config.maps.max(1);
        let as_many = self.maps.filter(|&maps| maps > 0).map(|maps| maps.saturating_mul(poses_a_map));
        config.particles = self.particles.or(as_many).unwrap_or(config.particles);
        config.maps = self.maps.unwrap_or(config.maps);
        config.seed = self.seed.unwrap_or(config.seed);
        config.validate()?;
        Ok(config)
    }

    /// Without a log, a simulated drive through the built-in building.
    fn source(&self) -> anyhow::Result<Box<dyn LogSource>> {
        Ok(self.log.source()?.unwrap_or_else(|| Box::new(Simulation::building(1))))
    }

    /// What to tell where there was no laser reading.
    fn nothing_mapped(&self, mapped: Mapped) -> anyhow::Result<Vec<anyhow::Error>> {
        match mapped.end {
            End::Interrupted => Ok(Vec::new()),
            End::BrokeOff(error) => Err(error.into()),
            End::Log | End::MaxScans => {
                let log = self.log.log.as_deref().unwrap_or(Path::new("the simulation")).display();
                let malformed = mapped.stats.first_malformed.map_or_else(String::new, |first| {
                    format!("; malformed lines: {}; the first one: {first}", mapped.stats.malformed)
                });
                Err(anyhow!(
                    "{log}: no laser reading in this log (FLASER, RLASER, ROBOTLASER1, RAWLASER1, LaserScan, ...), so there is \
                     nothing to map{malformed}"
                ))
            }
        }
    }
}
