//! `ipslam run`: a log in; trajectory, map, pictures and a summary out.

use super::backend::{BackendArgs, Chosen};
use super::configuration::ConfigArgs;
use super::continued::{ContinueArgs, Earlier, ScansFrom};
use super::detections::DetectionArgs;
use super::interrupt;
use super::log::LogArgs;
use super::output::{OutArgs, Outputs};
use super::progress::run_with_bar;
use super::recording::RecordingArgs;
use super::say::{print_line, say};
use super::summary::Summary;
use super::threads::ThreadArgs;
use super::truth::{Truth, TruthArgs};
use anyhow::anyhow;
use ipslam::config::{Config, SlamConfig};
use ipslam::evaluator::Evaluator;
use ipslam::grid::{OccupancyGrid, RESOLUTION};
use ipslam::log::LogSource;
use ipslam::objects::Detections;
use ipslam::pipeline::{Continued, Counts, End, Outcome, Run, RunInfo};
use ipslam::report::{Confidence, Estimator, Observer};
use ipslam::simulate::Simulation;
use ipslam::slam::Slam;
use std::iter;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Maps a log, or without one a simulated drive through the built-in building: writes trajectory, map, pictures and a
/// summary. Of several logs each goes on with the map of those before it, in its own folder.
#[derive(Debug, clap::Args)]
pub struct RunArgs {
    #[command(flatten)]
    log: LogArgs,
    /// More logs of the same place, in the order in which they are mapped
    #[arg(value_name = "MORE LOGS", conflicts_with_all = ["align", "relations", "reference"])]
    more: Vec<PathBuf>,
    #[command(flatten)]
    out: OutArgs,
    #[command(flatten)]
    earlier: ContinueArgs,
    #[command(flatten)]
    detections: DetectionArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    threads: ThreadArgs,
    /// Maximum number of laser readings
    #[arg(long, value_name = "COUNT", allow_negative_numbers = true, value_parser = clap::value_parser!(u64).range(1..))]
    max_scans: Option<u64>,
    #[command(flatten)]
    truth: TruthArgs,
    #[command(flatten)]
    grid: GridArgs,
    #[command(flatten)]
    backend: BackendArgs,
    #[command(flatten)]
    recording: RecordingArgs,
    /// Turn the world so that most walls are along its axes; its origin stays
    #[arg(long, conflicts_with = "earlier")]
    align: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

/// The grid that is written.
#[derive(Debug, clap::Args)]
pub struct GridArgs {
    /// Side of a cell of the occupancy grid [m]
    #[arg(long, value_name = "METRES", default_value_t = RESOLUTION, value_parser = cell_size)]
    pub cell_size: f64,
}

fn cell_size(text: &str) -> Result<f64, String> {
    let size = text.parse().ok().filter(|size| (1e-3..=10.0).contains(size));
    size.ok_or_else(|| "a number of metres from 0.001 to 10 is needed".to_owned())
}

/// Maps the logs. What went wrong while the run could go on is returned as a list, and what ended it as the error.
pub fn run(args: &RunArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    let config = args.config.over(SlamConfig::default())?;
    let truth = args.truth.read()?;
    args.threads.start()?;
    let (mut earlier, mut errors) = (args.earlier.clone(), Vec::new());
    let logs = iter::once(args.log.log.as_deref()).chain(args.more.iter().map(|log| Some(log.as_path())));
    for (log, number) in logs.zip(1..) {
        let recording = args.recording.of_log(number);
        let (folder, mut found) = args.map(log, &recording, &config, &truth, &earlier)?;
        errors.append(&mut found);
        if interrupt::happened() {
            break;
        }
        // The next log watches for itself.
        interrupt::forget();
        earlier = ContinueArgs::from(folder);
    }
    Ok(errors)
}

impl RunArgs {
    /// Maps one log. Returns where its map is, and what went wrong.
    fn map(
        &self,
        log: Option<&Path>,
        recording: &RecordingArgs,
        config: &SlamConfig,
        truth: &Truth<'_>,
        earlier: &ContinueArgs,
    ) -> anyhow::Result<(PathBuf, Vec<anyhow::Error>)> {
        let source = self.source(log)?;
        source.open()?;
        let detections = self.detections.read(&self.recording)?;
        let mut outputs =
            if self.more.is_empty() { self.out.open(&source.name())? } else { self.out.open_below(&source.name())? };
        // Before signals are watched for: it ends at the first.
        let earlier = earlier.find(&*source, config, self.grid.cell_size)?;
        interrupt::watch()?;
        let Chosen { evaluator, name: device } = self.backend.choose()?;
        let (continues, earlier_grid) = earlier.map(|Earlier { continued, grid }| (continued, grid)).unzip();
        let reading = continues.as_ref().map_or(0, |continued| continued.first_scan);
        let info = RunInfo { log: source.name(), device, config: Config::Slam(*config), continues };
        let inputs = self.log.log.iter().chain(&self.more).map(PathBuf::as_path);
        let mut observers = recording.observers(&info, inputs)?;
        let job = Job {
            source: &ScansFrom { source: &*source, reading },
            detections: detections.as_ref(),
            info: &info,
            config,
            max_scans: self.max_scans,
            truth,
            cell_size: self.grid.cell_size,
            earlier_grid,
            align: self.align,
            smooth: true,
            printed: Some(if self.json { Printed::Json } else { Printed::Table }),
            dropped: &|| 0,
        };
        let mapped = job.run(evaluator, &mut observers, &mut outputs)?;
        if mapped.counts.scans > 0 {
            outputs.finish();
        }
        self.nothing_mapped(log, &mapped)?;
        Ok((outputs.path(""), std::mem::take(&mut outputs.errors)))
    }
}

/// What the progress bar says.
fn progress_message(counts: &Counts, seconds: f64) -> String {
    format!(
        "{:.0}x real time, ESS {:.0}, {} clusters",
        counts.log_seconds() / seconds,
        counts.effective_last,
        counts.clusters,
    )
}

/// What is printed of a run's summary.
#[derive(Clone, Copy)]
pub enum Printed {
    Table,
    Json,
}

/// A run about to start.
pub struct Job<'a> {
    pub source: &'a dyn LogSource,
    /// What a detector of objects saw.
    pub detections: Option<&'a Detections>,
    pub info: &'a RunInfo,
    /// That of the information.
    pub config: &'a SlamConfig,
    /// Maximum number of laser readings.
    pub max_scans: Option<u64>,
    pub truth: &'a Truth<'a>,
    /// Side of a cell of the grid [m].
    pub cell_size: f64,
    /// The grid of the earlier drive that is continued.
    pub earlier_grid: Option<OccupancyGrid>,
    /// Whether the world is turned so that most walls are along its axes.
    pub align: bool,
    /// Whether the result is smoothed.
    pub smooth: bool,
    /// How the summary is printed, if it is.
    pub printed: Option<Printed>,
    /// Number of scans that a live drive dropped so far.
    pub dropped: &'a dyn Fn() -> u64,
}

impl Job<'_> {
    /// Maps the log, writes the outputs and prints the summary; nothing is written for a log without laser readings.
    pub fn run(
        &self,
        evaluator: Option<Box<dyn Evaluator>>,
        observers: &mut [Box<dyn Observer + '_>],
        outputs: &mut Outputs,
    ) -> anyhow::Result<Outcome> {
        self.run_by(&mut self.slam(evaluator), observers, outputs)
    }

    /// The filter before the first reading.
    pub fn slam(&self, evaluator: Option<Box<dyn Evaluator>>) -> Slam {
        let config = self.config;
        let mut slam = match evaluator {
            Some(evaluator) => Slam::with_evaluator(*config, evaluator),
            None => Slam::new(*config),
        };
        if let Some(Continued { map, world_from_robot, .. }) = &self.info.continues {
            slam = slam.continuing(map, *world_from_robot);
        }
        if let Some(detections) = self.detections {
            slam = slam.detecting(detections.clone());
        }
        slam
    }

    /// The same by this estimator, which may be the filter and more.
    pub fn run_by(
        &self,
        estimator: &mut dyn Estimator,
        observers: &mut [Box<dyn Observer + '_>],
        outputs: &mut Outputs,
    ) -> anyhow::Result<Outcome> {
        let (RunInfo { log: name, device, .. }, config) = (self.info, self.config);
        say!("mapping {name}: {} particles in {} maps on the {device}", config.particles, config.maps);
        let smoothing = self.smooth.then(|| config.smoother());
        let run = Run { max_scans: self.max_scans, smoothing, ..Run::of(self.source) };
        let mut mapped = run_with_bar(&run, estimator, observers, progress_message)?;
        for failure in observers.iter().filter_map(|observer| observer.failure()) {
            outputs.note(Err(anyhow!("the recording is not whole: {failure}")));
        }
        if mapped.counts.scans > 0 {
            self.write(&mut mapped, outputs)?;
        }
        Ok(mapped)
    }

    fn write(&self, mapped: &mut Outcome, outputs: &mut Outputs) -> anyhow::Result<()> {
        let (RunInfo { log: name, device, .. }, config) = (self.info, self.config);
        let smoothed = std::mem::replace(&mut mapped.smoothing, Ok(()));
        outputs
            .note(smoothed.map_err(|error| anyhow!(error).context("the log cannot be read again to smooth the map")));
        if let Some(Continued { first_scan, .. }) = self.info.continues {
            // Up to the first located scan there is odometry only.
            let unknown = Confidence { weight: 0.0, explained: 0.0, is_located: false };
            let before = mapped.result.poses.iter_mut().take(first_scan);
            before.for_each(|estimate| estimate.confidence = Some(unknown));
        }
        if self.align {
            mapped.result = mapped.result.turned(-mapped.result.map.main_direction());
        }
        let trajectory_path = outputs.path("trajectory.tum");
        let trajectory = mapped.result.trajectory();
        outputs.write_poses(&mapped.result);
        outputs.write("config.toml", toml::to_string(config)?.as_bytes());
        let (report, truth) = self.truth.score(&trajectory_path, &trajectory, &mapped.truth);
        let began = Instant::now();
        let grid = self.earlier_grid.as_ref();
        let map_bytes = outputs.look_again(self.source, &config.scan, mapped, &truth, self.cell_size, grid);
        let drawing_seconds = began.elapsed().as_secs_f64();
        let continues = self.info.continues.as_ref();
        let (dropped, report) = ((self.dropped)(), &report);
        let summary = Summary { name, device, mapped, dropped, continues, config, map_bytes, drawing_seconds, report };
        let json = format!("{:#}", summary.json()?);
        outputs.write("summary.json", format!("{json}\n").as_bytes());
        // Whoever closed this pipe has read enough; the summary is in its file.
        match self.printed {
            Some(Printed::Table) => print_line!("{}", summary.table().trim_end()),
            Some(Printed::Json) => print_line!("{json}"),
            None => {}
        }
        if let End::BrokeOff(error) = &mapped.end {
            outputs.note(Err(anyhow!("{error}")));
        }
        Ok(())
    }
}

impl RunArgs {
    /// Without a log, a simulated drive through the built-in building.
    fn source(&self, log: Option<&Path>) -> anyhow::Result<Box<dyn LogSource>> {
        let named = log.map(|log| self.log.source_of(log)).transpose()?;
        Ok(named.unwrap_or_else(|| Box::new(Simulation::building(1))))
    }

    /// The error of a log without laser readings.
    fn nothing_mapped(&self, log: Option<&Path>, mapped: &Outcome) -> anyhow::Result<()> {
        match &mapped.end {
            _ if mapped.counts.scans > 0 => Ok(()),
            End::Interrupted => Ok(()),
            End::BrokeOff(error) => Err(anyhow!("{error}")),
            End::Log | End::MaxScans => {
                let log = log.unwrap_or(Path::new("the simulation")).display();
                let malformed = mapped.stats.first_malformed.as_ref().map_or_else(String::new, |first| {
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
