//! `ipslam localize`: a map and a log in; where the robot was in the map out.

use super::backend::{BackendArgs, Chosen};
use super::configuration::ConfigArgs;
use super::interrupt;
use super::log::LogArgs;
use super::output::Outputs;
use super::progress::Progress;
use super::recording::RecordingArgs;
use super::run::ThreadArgs;
use anyhow::{Context as _, anyhow, bail, ensure};
use ipslam::config::Config;
use ipslam::geometry::{Pose, StampedPose};
use ipslam::grid::{self, FreeArea};
use ipslam::io::{map_json, map_server, tum};
use ipslam::localization::{KnownMap, Localization, Prior};
use ipslam::log::{LogEntry, LogError, LogSource};
use ipslam::metrics::PoseLookup;
use ipslam::picture::Figures;
use ipslam::record::{Observer, RunInfo, RunResult, StepReport, Task};
use ipslam::scan::Scan;
use serde::Serialize;
use serde_json::json;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

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
    /// Take up the log so many seconds after its first entry
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    skip: f64,
    /// True poses in the map's frame (TUM or t x y theta), such as trajectory.tum of the run that made the map
    #[arg(long, value_name = "FILE")]
    reference: Option<PathBuf>,
    /// Folder for the outputs, made where it is missing [default: ipslam-out/NAME OF THE LOG-localized]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    threads: ThreadArgs,
    #[command(flatten)]
    backend: BackendArgs,
    #[command(flatten)]
    recording: RecordingArgs,
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse::<f64>()).collect();
    let numbers = numbers.map_err(|error| format!("{error}; {N} numbers with commas between them are needed"))?;
    let found = numbers.len();
    let all: [f64; N] = numbers.try_into().map_err(|_| format!("{found} numbers, {N} are needed"))?;
    if all.iter().all(|number| number.is_finite()) { Ok(all) } else { Err("a number is not finite".to_owned()) }
}

fn pose(text: &str) -> Result<Pose, String> {
    numbers(text).map(|[x, y, heading]| Pose::new(x, y, heading))
}

fn spread(text: &str) -> Result<[f64; 2], String> {
    let spread: [f64; 2] = numbers(text)?;
    if spread.iter().all(|&number| number >= 0.0) { Ok(spread) } else { Err("neither can be below 0".to_owned()) }
}

/// Finds the robot. Errors that it could go on after are returned as a list.
pub fn localize(args: &LocalizeArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    let mut config = args.config.over(Config::default())?;
    config.localization.max_particles = args.max_particles.unwrap_or(config.localization.max_particles);
    let fewest = &mut config.localization.min_particles;
    *fewest = args.max_particles.map_or(*fewest, |most| most.min(*fewest));
    config.validate()?;
    args.threads.start()?;
    let map = known_map(&args.map, &config)?;
    let reference = args.reference.as_deref().map(tum::read).transpose()?;
    let source = args.log.source()?.context("no log is named: `ipslam localize MAP LOG`")?;
    source.open()?;
    let mut outputs = Outputs::for_log(args.out.as_deref(), &format!("{}-localized", source.name()))?;
    interrupt::watch()?;
    let Chosen { evaluator, name: device } = args.backend.choose()?;
    let info = RunInfo { task: Task::Localization, log: source.name(), device, config };
    let mut observers = args.recording.observers(&info)?;

    let [position, heading] = args.start_spread;
    let prior = args.start.map(|world_from_robot| Prior { world_from_robot, position, heading });
    let from = args.start.map_or_else(|| format!("anywhere in {:.0} m²", map.free.area()), |pose| format!("{pose:?}"));
    eprintln!("finding {} in {}, from {from}, on the {}", info.log, args.map.display(), info.device);
    let began = Instant::now();
    let filter = Localization::new(map.clone(), prior, config, evaluator);
    let mut followed = follow(&*source, filter, &map, args.skip, &mut observers)?;
    let seconds = began.elapsed().as_secs_f64();
    for failure in observers.iter().filter_map(|observer| observer.failure()) {
        outputs.note(Err(anyhow!("the recording is not whole: {failure}")));
    }
    drop(observers);
    ensure!(!followed.particles.is_empty(), "{}: no laser reading to find the robot by", info.log);
    if let Some(error) = followed.broke_off.take() {
        outputs.note(Err(error));
    }

    outputs.write_trajectory("trajectory.tum", &followed.located());
    outputs.write("config.toml", toml::to_string(&config)?.as_bytes());
    let summary = Summary {
        args,
        info: &info,
        seconds,
        errors: reference.as_deref().map(|reference| errors(&followed, reference)),
        followed: &followed,
    };
    outputs.write("summary.json", format!("{:#}\n", summary.json()).as_bytes());
    draw(&mut outputs, &*source, &map, &followed, &config, reference.as_deref().unwrap_or_default());
    let text = if args.json { format!("{:#}\n", summary.json()) } else { summary.table() };
    let _ = std::io::stdout().write_all(text.as_bytes());
    eprintln!("outputs are in {}", outputs.folder().display());
    Ok(outputs.errors)
}

/// Reads a map of either kind.
fn known_map(path: &Path, config: &Config) -> anyhow::Result<KnownMap> {
    let shown = path.display();
    let map = match path.extension().and_then(|ending| ending.to_str()) {
        Some("json") => {
            let saved = map_json::read_map(path)?;
            let free = saved.free.with_context(|| {
                format!(
                    "{shown}: it does not tell where a robot can be; run the log again, or name map.yaml of the run"
                )
            })?;
            KnownMap { clusters: saved.clusters, free }
        }
        Some("yaml" | "yml") => {
            let grid = map_server::read(path)?;
            let free = FreeArea::from_grid(&grid, []).with_context(|| format!("{shown}: no cell of it is free"))?;
            KnownMap { clusters: grid::clusters(&grid, &config.clustering), free }
        }
        _ => bail!("{shown}: a map is a .json file as `ipslam run` writes it, or a .yaml file of ROS map_server"),
    };
    ensure!(!map.clusters.is_empty(), "{shown}: it has no wall");
    Ok(map)
}

/// What was found out about one reading.
struct Reading {
    stamp: f64,
    way: Way,
    odom_from_robot: Pose,
    /// The likeliest pose; none before the first scan.
    world_from_robot: Option<Pose>,
    is_located: bool,
}

/// A log, followed through the map.
#[derive(Default)]
struct Followed {
    readings: Vec<Reading>,
    /// Entries of the log before the first reading.
    skipped: usize,
    scans: u64,
    /// Of each step.
    particles: Vec<usize>,
    first_step_seconds: f64,
    evaluator_failure: Option<String>,
    broke_off: Option<LogError>,
}

/// How many particles the steps had.
#[derive(Serialize)]
struct ParticleCounts {
    first: usize,
    most: usize,
    median: usize,
}

/// How far the robot has come since the start, by its odometry.
#[derive(Clone, Copy, Default, Serialize)]
struct Way {
    seconds: f64,
    metres: f64,
}

fn follow(
    source: &dyn LogSource,
    mut filter: Localization,
    map: &KnownMap,
    skip: f64,
    observers: &mut [Box<dyn Observer>],
) -> anyhow::Result<Followed> {
    let mut reader = source.open()?;
    let mut progress = Progress::new(reader.progress().map(|(_, all)| all));
    let mut followed = Followed::default();
    let mut first_stamp: Option<f64> = None;
    while let Some(entry) = reader.next().filter(|_| !interrupt::happened()) {
        let entry = match entry {
            Ok(entry) => entry,
            Err(error) => {
                followed.broke_off = Some(error);
                break;
            }
        };
        let (stamp, odom_from_robot) = match &entry {
            LogEntry::Truth { .. } => continue,
            LogEntry::Odometry { stamp, odom_from_robot } => (*stamp, *odom_from_robot),
            LogEntry::Laser(reading) => (reading.stamp, reading.odom_from_robot),
        };
        let since = stamp - *first_stamp.get_or_insert(stamp);
        if since < skip && followed.readings.is_empty() {
            followed.skipped += 1;
            continue;
        }
        let way = followed.readings.last().map_or_else(Way::default, |last| last.way_to(stamp, odom_from_robot));
        followed.scans += u64::from(matches!(entry, LogEntry::Laser(_)));
        observers.iter_mut().for_each(|observer| observer.on_entry(&entry));
        let began = Instant::now();
        filter.add(&entry, &mut |report| {
            followed.step(report, began.elapsed().as_secs_f64());
            observers.iter_mut().for_each(|observer| observer.on_step(report));
        });
        let estimate = filter.estimate();
        let is_located = estimate.is_some_and(|estimate| estimate.confidence.is_located);
        let world_from_robot = estimate.map(|estimate| estimate.world_from_robot);
        followed.readings.push(Reading { stamp, way, odom_from_robot, world_from_robot, is_located });
        let place = if is_located { "located" } else { "looking" };
        progress.update(reader.progress().map_or(followed.scans, |(done, _)| done), |_| {
            format!("{} particles, {place}", followed.particles.last().unwrap_or(&0))
        });
    }
    progress.finish();
    followed.evaluator_failure = filter.evaluator_failure().map(ToString::to_string);
    let result = RunResult { map: map.clusters.clone(), trajectory: followed.located(), odometry: Vec::new() };
    observers.iter_mut().for_each(|observer| observer.on_finish(&result, false));
    Ok(followed)
}

impl Reading {
    /// The way from the start to a later reading, by this one.
    fn way_to(&self, stamp: f64, odom_from_robot: Pose) -> Way {
        Way {
            seconds: self.way.seconds + stamp - self.stamp,
            metres: self.way.metres + odom_from_robot.seen_from(self.odom_from_robot).position().coords.norm(),
        }
    }
}

impl Followed {
    fn step(&mut self, report: &StepReport<'_>, seconds: f64) {
        if self.particles.is_empty() {
            self.first_step_seconds = seconds;
        }
        self.particles.push(report.particles.len());
    }

    fn particle_counts(&self) -> ParticleCounts {
        let mut sorted = self.particles.clone();
        sorted.sort_unstable();
        let of = |count: Option<&usize>| count.copied().unwrap_or(0);
        ParticleCounts {
            first: of(self.particles.first()),
            most: of(sorted.last()),
            median: of(sorted.get(sorted.len() / 2)),
        }
    }

    fn located_readings(&self) -> impl Iterator<Item = (&Reading, Pose)> {
        let located = self.readings.iter().filter(|reading| reading.is_located);
        located.filter_map(|reading| Some((reading, reading.world_from_robot?)))
    }

    fn first_fix(&self) -> Option<Way> {
        self.located_readings().next().map(|(reading, _)| reading.way)
    }

    /// Poses that can be relied on.
    fn located(&self) -> Vec<StampedPose> {
        self.located_readings().map(|(reading, pose)| StampedPose { stamp: reading.stamp, pose }).collect()
    }

    /// Odometry at the same readings.
    fn odometry(&self) -> Vec<StampedPose> {
        let stamped =
            |(reading, _): (&Reading, Pose)| StampedPose { stamp: reading.stamp, pose: reading.odom_from_robot };
        self.located_readings().map(stamped).collect()
    }
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

fn errors(followed: &Followed, reference: &[StampedPose]) -> Errors {
    const RIGHT: (f64, f64) = (0.5, 10.0 * std::f64::consts::PI / 180.0);
    let truth = PoseLookup::new(reference);
    let (mut compared, mut first_right_fix, mut right): (_, _, Vec<f64>) = (0, None, Vec::new());
    for (reading, pose) in followed.located_readings() {
        let Some(truth) = truth.at(reading.stamp) else { continue };
        compared += 1;
        let off = pose.seen_from(truth);
        let error = off.position().coords.norm();
        if error < RIGHT.0 && off.heading.abs() < RIGHT.1 {
            right.push(error);
            first_right_fix.get_or_insert(reading.way);
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
    map: &KnownMap,
    followed: &Followed,
    config: &Config,
    reference: &[StampedPose],
) {
    let result = RunResult { map: map.clusters.clone(), trajectory: followed.located(), odometry: followed.odometry() };
    let mut figures = Figures::new(source.name(), &result, reference);
    let mut add_scans = || -> Result<(), LogError> {
        let mut readings = followed.readings.iter();
        let is_reading = |entry: &Result<LogEntry, LogError>| !matches!(entry, Ok(LogEntry::Truth { .. }));
        for entry in source.open()?.filter(is_reading).skip(followed.skipped) {
            let entry = entry?;
            let Some(reading) = readings.next() else { break };
            if let (LogEntry::Laser(laser), Some(pose), true) = (entry, reading.world_from_robot, reading.is_located) {
                let scan = Scan::from_reading(&laser, config.scan.min_range, config.scan.max_range);
                figures.add_scan(&scan, reading.odom_from_robot, pose);
            }
        }
        Ok(())
    };
    if followed.broke_off.is_none() {
        outputs.note(add_scans().context("the log cannot be read again for the pictures"));
    }
    match figures.map() {
        Ok(files) => files.iter().for_each(|(name, bytes)| outputs.write(name, bytes)),
        Err(error) => outputs.note(Err(error)),
    }
}

struct Summary<'a> {
    args: &'a LocalizeArgs,
    info: &'a RunInfo,
    followed: &'a Followed,
    seconds: f64,
    errors: Option<Errors>,
}

impl Summary<'_> {
    fn log_seconds(&self) -> f64 {
        let stamps = || self.followed.readings.iter().map(|reading| reading.stamp);
        stamps().fold(f64::NEG_INFINITY, f64::max) - stamps().next().unwrap_or(0.0)
    }

    fn located_share(&self) -> f64 {
        self.followed.located_readings().count() as f64 / self.followed.readings.len().max(1) as f64
    }

    fn json(&self) -> serde_json::Value {
        json!({
            "program": "ipslam",
            "version": env!("CARGO_PKG_VERSION"),
            "map": self.args.map.display().to_string(),
            "log": self.info.log,
            "device": self.info.device,
            "seed": self.info.config.seed,
            "scans": self.followed.scans,
            "steps": self.followed.particles.len(),
            "particles": self.followed.particle_counts(),
            "first_fix": self.followed.first_fix(),
            "located_share": self.located_share(),
            "against_reference": self.errors,
            "time": {
                "seconds": self.seconds,
                "first_step_s": self.followed.first_step_seconds,
                "log_s": self.log_seconds(),
                "times_real_time": self.log_seconds() / self.seconds.max(1e-9),
            },
            "evaluator_failure": self.followed.evaluator_failure,
        })
    }

    fn table(&self) -> String {
        let fix = |fix: Option<Way>| {
            fix.map_or("never".to_owned(), |Way { seconds, metres }| format!("after {seconds:.1} s and {metres:.1} m"))
        };
        let (scans, steps) = (self.followed.scans, self.followed.particles.len());
        let ParticleCounts { first, most, median } = self.followed.particle_counts();
        let mut rows = vec![
            ("log", format!("{}: {scans} scans in {:.1} s, {steps} steps", self.info.log, self.log_seconds())),
            (
                "located",
                format!("{}, in {:.1} % of the readings", fix(self.followed.first_fix()), 100.0 * self.located_share()),
            ),
            ("", format!("particles: {first} at first, {most} at most, {median} at the median")),
        ];
        if let Some(Errors { compared, right, first_right_fix, median_error_m, largest_error_m }) = &self.errors {
            rows.push(("truth", format!("{right} of {compared} located poses are right (0.5 m, 10°)")));
            rows.push(("", format!("first right fix {}", fix(*first_right_fix))));
            rows.push(("", format!("error {median_error_m:.3} m at the median, {largest_error_m:.3} m at most")));
        }
        let speed = self.log_seconds() / self.seconds.max(1e-9);
        let first = 1e3 * self.followed.first_step_seconds;
        rows.push(("time", format!("{:.1} s: {speed:.1} times real time; first step {first:.0} ms", self.seconds)));
        rows.push(("", format!("particles on the {}", self.info.device)));
        rows.extend(self.followed.evaluator_failure.iter().map(|failure| ("warning", failure.clone())));
        rows.iter().fold(String::new(), |mut table, (label, text)| {
            let _ = writeln!(table, "{label:<8} {text}");
            table
        })
    }
}
