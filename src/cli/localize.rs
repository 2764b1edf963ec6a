//! `ipslam localize`: a map and a log in; where the robot was in the map out.

use super::UsageError;
use super::backend::{BackendArgs, Chosen};
use super::configuration;
use super::interrupt;
use super::known_map::{known_map, pose, spread};
use super::log::LogArgs;
use super::output::{OutArgs, Outputs};
use super::progress::run_with_bar;
use super::recording::RecordingArgs;
use super::say::{print_line, say};
use super::summary::{dropped_scans, gyro, odometry_errors};
use super::threads::ThreadArgs;
use anyhow::{Context as _, anyhow, ensure};
use ipslam::config::{Config, LocalizationConfig};
use ipslam::evaluator::Evaluator;
use ipslam::geometry::{Pose, StampedPose};
use ipslam::grid::FreeArea;
use ipslam::io::tum;
use ipslam::localization::{InitialPose, Localization};
use ipslam::log::{self, LogEntry, LogError, LogSource};
use ipslam::map::LineMap;
use ipslam::metrics::PoseLookup;
use ipslam::picture::Figures;
use ipslam::pipeline::{End, Outcome, Run, RunInfo, refused_odometry};
use ipslam::report::{Estimate, Estimator, Observer, RunResult};
use ipslam::scan::Scan;
use serde::Serialize;
use serde_json::json;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Finds the robot in a finished map.
#[derive(Debug, clap::Args)]
pub struct LocalizeArgs {
    /// Map: map.json of a run, or the YAML file of an occupancy grid (ROS map_server)
    map: PathBuf,
    #[command(flatten)]
    log: LogArgs,
    /// Where the robot is at first, in the map's frame; without it, it may be anywhere
    #[arg(long, value_name = "X,Y,HEADING", allow_hyphen_values = true, value_parser = pose)]
    start: Option<Pose>,
    /// How well that is known: standard deviations in metres and radians
    #[arg(long, value_name = "METRES,RADIANS", value_parser = spread, default_value = "0.5,0.26", requires = "start")]
    start_spread: [f64; 2],
    /// Most particles [default: 100000]
    #[arg(long, value_name = "COUNT")]
    max_particles: Option<usize>,
    /// Start this many seconds after the first entry of the log
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    skip: f64,
    /// True poses in the map's frame (TUM or t x y theta), such as trajectory.tum of the run that made the map
    #[arg(long, value_name = "FILE")]
    reference: Option<PathBuf>,
    #[command(flatten)]
    out: OutArgs,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
    /// TOML file that sets any part of the configuration; config.toml among the outputs is one
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Seed of all random numbers; in place of the configuration's
    #[arg(long, allow_negative_numbers = true)]
    seed: Option<u64>,
    #[command(flatten)]
    threads: ThreadArgs,
    #[command(flatten)]
    backend: BackendArgs,
    #[command(flatten)]
    recording: RecordingArgs,
}

/// Finds the robot. Errors that it could go on after are returned as a list.
pub fn localize(args: &LocalizeArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    let config = configuration::localization(args.config.as_deref(), args.seed, args.max_particles)?;
    args.threads.start()?;
    let map = known_map(&args.map)?;
    let reference = args.reference.as_deref().map(tum::read).transpose()?;
    let source = args.log.source()?.ok_or(UsageError("no log is named: `ipslam localize MAP LOG`".to_owned()))?;
    source.open()?;
    let mut outputs = args.out.open(&format!("{}-localized", source.name()))?;
    interrupt::watch()?;
    let Chosen { evaluator, name: device } = args.backend.choose()?;
    let info = RunInfo { log: source.name(), device, config: Config::Localization(config), continues: None };
    let mut observers = args.recording.observers(&info, args.log.log.as_deref())?;
    let [position_sigma, heading_sigma] = args.start_spread;
    let initial = args.start.map(|world_from_robot| InitialPose { world_from_robot, position_sigma, heading_sigma });
    let job = LocalizationJob {
        map: &args.map,
        source: &*source,
        info: &info,
        config: &config,
        skip: args.skip,
        reference: reference.as_deref(),
        json: args.json,
        dropped: &|| 0,
    };
    let mut filter = job.filter(map, initial, evaluator)?;
    job.run_by(&mut filter, &mut observers, &mut outputs)?;
    drop(observers);
    Ok(std::mem::take(&mut outputs.errors))
}

/// A robot about to be found.
pub struct LocalizationJob<'a> {
    /// Where the map is.
    pub map: &'a Path,
    pub source: &'a dyn LogSource,
    pub info: &'a RunInfo,
    /// That of the information.
    pub config: &'a LocalizationConfig,
    /// Readings less than this after the first one are left out [s].
    pub skip: f64,
    /// True poses in the map's frame.
    pub reference: Option<&'a [StampedPose]>,
    /// Whether the summary is printed as JSON.
    pub json: bool,
    /// Number of scans that a live drive dropped so far.
    pub dropped: &'a dyn Fn() -> u64,
}

impl LocalizationJob<'_> {
    /// The filter before the first reading.
    pub fn filter(
        &self,
        map: LineMap,
        initial: Option<InitialPose>,
        evaluator: Option<Box<dyn Evaluator>>,
    ) -> anyhow::Result<Localization> {
        let (shown, area) = (self.map.display(), map.free.as_ref().map_or(0.0, FreeArea::area));
        let anywhere = || format!("anywhere in {area:.0} m²");
        let from = initial.map_or_else(anywhere, |initial| format!("{:?}", initial.world_from_robot));
        say!("finding {} in {shown}, from {from}, on the {}", self.info.log, self.info.device);
        Localization::new(map, initial, *self.config, evaluator)
            .with_context(|| format!("{shown}: no robot can be found in it"))
    }

    /// Finds the robot by this estimator, the filter or one around it; writes the outputs and prints the summary.
    pub fn run_by(
        &self,
        estimator: &mut dyn Estimator,
        observers: &mut [Box<dyn Observer + '_>],
        outputs: &mut Outputs,
    ) -> anyhow::Result<()> {
        let Self { source, info, config, reference, .. } = *self;
        let run = Run { skip: self.skip, ..Run::of(source) };
        let outcome = run_with_bar(&run, estimator, observers, |counts, _| {
            let place = if counts.is_located { "located" } else { "looking" };
            format!("{} particles, {place}", counts.particles.last().unwrap_or(&0))
        })?;
        for failure in observers.iter().filter_map(|observer| observer.failure()) {
            outputs.note(Err(anyhow!("the recording is not whole: {failure}")));
        }
        ensure!(outcome.counts.steps > 0, "{}: no laser reading to find the robot by", info.log);
        if let End::BrokeOff(error) = &outcome.end {
            outputs.note(Err(anyhow!("{error}")));
        }

        outputs.write_poses(&outcome.result);
        outputs.write("config.toml", toml::to_string(config)?.as_bytes());
        let readings = readings(&outcome.result);
        let errors = reference.map(|reference| errors(&readings, reference));
        let summary = Summary { job: self, outcome: &outcome, readings: &readings, errors };
        outputs.write("summary.json", format!("{:#}\n", summary.json()).as_bytes());
        draw(outputs, source, &outcome, config, reference.unwrap_or_default());
        let text = if self.json { format!("{:#}\n", summary.json()) } else { summary.table() };
        print_line!("{}", text.trim_end());
        outputs.finish();
        Ok(())
    }
}

/// A reading, and how far the robot had come by then.
struct Reading<'a> {
    estimate: &'a Estimate,
    way: Way,
}

/// How far the robot has come since the start, by its odometry.
#[derive(Clone, Copy, Default, Serialize)]
struct Way {
    seconds: f64,
    metres: f64,
}

fn readings(result: &RunResult) -> Vec<Reading<'_>> {
    let mut readings: Vec<Reading<'_>> = Vec::with_capacity(result.poses.len());
    for estimate in &result.poses {
        let way = readings.last().map_or_else(Way::default, |last| Way {
            seconds: last.way.seconds + estimate.stamp - last.estimate.stamp,
            metres: last.way.metres
                + estimate.odom_from_robot.seen_from(last.estimate.odom_from_robot).position().coords.norm(),
        });
        readings.push(Reading { estimate, way });
    }
    readings
}

/// How many particles the steps had.
#[derive(Serialize)]
struct ParticleCounts {
    first: usize,
    most: usize,
    median: usize,
}

/// Located poses against true ones.
#[derive(Serialize)]
struct Errors {
    /// Located readings whose stamp has a true pose.
    compared: usize,
    /// Of these, those within 0.5 m and 10°.
    right: usize,
    first_right_fix: Option<Way>,
    /// Of the right ones.
    median_error_m: f64,
    largest_error_m: f64,
}

fn errors(readings: &[Reading<'_>], reference: &[StampedPose]) -> Errors {
    const RIGHT: (f64, f64) = (0.5, 10.0 * std::f64::consts::PI / 180.0);
    let truth = PoseLookup::new(reference);
    let (mut compared, mut first_right_fix, mut right): (_, _, Vec<f64>) = (0, None, Vec::new());
    for Reading { estimate, way } in readings {
        let (Some(pose), Some(truth)) = (estimate.relied_on(), truth.at(estimate.stamp)) else { continue };
        compared += 1;
        let off = pose.seen_from(truth);
        let error = off.position().coords.norm();
        if error < RIGHT.0 && off.heading.abs() < RIGHT.1 {
            right.push(error);
            first_right_fix.get_or_insert(*way);
        }
    }
    right.sort_by(f64::total_cmp);
    let at = |index: usize| right.get(index).copied().unwrap_or(f64::NAN);
    Errors {
        compared,
        right: right.len(),
        first_right_fix,
        median_error_m: at(right.len() / 2),
        largest_error_m: at(right.len().saturating_sub(1)),
    }
}

/// Map, scans and path of the located readings.
fn draw(
    outputs: &mut Outputs,
    source: &dyn LogSource,
    outcome: &Outcome,
    config: &LocalizationConfig,
    reference: &[StampedPose],
) {
    let mut figures = Figures::new(source.name(), &outcome.result, reference);
    let mut add_scans = || -> Result<(), LogError> {
        for (reading, estimate) in log::readings(source)?.skip(outcome.skipped).zip(&outcome.result.poses) {
            if let ((_, LogEntry::Laser(laser)), Some(pose)) = (reading?, estimate.relied_on()) {
                let scan = Scan::from_reading(&laser, &config.scan);
                figures.add_scan(&scan, estimate.odom_from_robot, pose);
            }
        }
        Ok(())
    };
    if !matches!(outcome.end, End::BrokeOff(_)) {
        outputs.note(add_scans().context("the log cannot be read again for the pictures"));
    }
    match figures.map() {
        Ok(files) => files.iter().for_each(|(name, bytes)| outputs.write(name, bytes)),
        Err(error) => outputs.note(Err(error)),
    }
}

struct Summary<'a> {
    job: &'a LocalizationJob<'a>,
    outcome: &'a Outcome,
    readings: &'a [Reading<'a>],
    errors: Option<Errors>,
}

impl Summary<'_> {
    fn log_seconds(&self) -> f64 {
        self.outcome.counts.log_seconds()
    }

    fn located(&self) -> impl Iterator<Item = &Reading<'_>> {
        self.readings.iter().filter(|reading| reading.estimate.relied_on().is_some())
    }

    fn first_fix(&self) -> Option<Way> {
        self.located().next().map(|reading| reading.way)
    }

    fn located_share(&self) -> f64 {
        self.located().count() as f64 / self.readings.len().max(1) as f64
    }

    fn particles(&self) -> ParticleCounts {
        let particles = &self.outcome.counts.particles;
        let mut sorted = particles.clone();
        sorted.sort_unstable();
        let of = |count: Option<&usize>| count.copied().unwrap_or(0);
        ParticleCounts {
            first: of(particles.first()),
            most: of(sorted.last()),
            median: of(sorted.get(sorted.len() / 2)),
        }
    }

    fn json(&self) -> serde_json::Value {
        json!({
            "program": "ipslam",
            "version": env!("CARGO_PKG_VERSION"),
            "map": self.job.map.display().to_string(),
            "log": self.job.info.log,
            "device": self.job.info.device,
            "seed": self.job.config.seed,
            "scans": self.outcome.counts.scans,
            "scans_dropped": (self.job.dropped)(),
            "steps": self.outcome.counts.steps,
            "particles": self.particles(),
            "first_fix": self.first_fix(),
            "located_share": self.located_share(),
            "against_reference": self.errors,
            "time": {
                "seconds": self.outcome.filter_seconds,
                "first_step_s": self.outcome.counts.first_step_seconds,
                "log_s": self.log_seconds(),
                "times_real_time": self.log_seconds() / self.outcome.filter_seconds.max(1e-9),
            },
            "odometry_errors": self.outcome.result.odometry_errors,
            "gyro": self.outcome.result.gyro,
            "refused_odometry": self.outcome.result.refused_odometry.len(),
            "evaluator_failure": self.outcome.evaluator_failure,
        })
    }

    fn table(&self) -> String {
        let fix = |fix: Option<Way>| {
            fix.map_or("never".to_owned(), |Way { seconds, metres }| format!("after {seconds:.1} s and {metres:.1} m"))
        };
        let (scans, steps) = (self.outcome.counts.scans, self.outcome.counts.steps);
        let ParticleCounts { first, most, median } = self.particles();
        let mut rows = vec![
            ("log", format!("{}: {scans} scans in {:.1} s, {steps} steps", self.job.info.log, self.log_seconds())),
            ("located", format!("{}, in {:.1} % of the readings", fix(self.first_fix()), 100.0 * self.located_share())),
            ("", format!("particles: {first} at first, {most} at most, {median} at the median")),
        ];
        if let Some(Errors { compared, right, first_right_fix, median_error_m, largest_error_m }) = &self.errors {
            rows.push(("truth", format!("{right} of {compared} located poses are right (0.5 m, 10°)")));
            rows.push(("", format!("first right fix {}", fix(*first_right_fix))));
            rows.push(("", format!("error {median_error_m:.3} m at the median, {largest_error_m:.3} m at most")));
        }
        rows.push(("odometry", odometry_errors(&self.outcome.result)));
        rows.extend(gyro(self.outcome).map(|text| ("gyro", text)));
        let speed = self.log_seconds() / self.outcome.filter_seconds.max(1e-9);
        let first = 1e3 * self.outcome.counts.first_step_seconds;
        rows.push((
            "time",
            format!("{:.1} s: {speed:.1} times real time; first step {first:.0} ms", self.outcome.filter_seconds),
        ));
        rows.push(("", format!("particles on the {}", self.job.info.device)));
        rows.extend(dropped_scans((self.job.dropped)()).map(|warning| ("warning", warning)));
        rows.extend(refused_odometry(&self.outcome.result).map(|warning| ("warning", warning)));
        rows.extend(self.outcome.evaluator_failure.iter().map(|failure| ("warning", failure.clone())));
        rows.iter().fold(String::new(), |mut table, (label, text)| {
            let _ = writeln!(table, "{label:<8} {text}");
            table
        })
    }
}
