//! `ipslam benchmark`: every log of a folder whose true path is known, over seeds, numbers of maps and harder drives.

use super::configuration;
use super::degrade::{DamageArgs, entries};
use super::interrupt;
use super::progress::{Bar, PERMILLE};
use super::say::say;
use super::summary::Summary;
use super::truth::TruthArgs;
use super::{UsageError, convert};
use anyhow::{Context as _, anyhow, ensure};
use find::Log;
use ipslam::config::SlamConfig;
use ipslam::geometry::StampedPose;
use ipslam::io::carmen::CarmenLog;
use ipslam::io::mcap::Topics;
use ipslam::io::{open_log, write_whole};
use ipslam::log::LogSource;
use ipslam::picture::Sheet;
use ipslam::pipeline::{End, Outcome, Progress, Run};
use ipslam::ppca::Cluster;
use ipslam::slam::Slam;
use report::{Row, Scores};
use std::io::BufWriter;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use tempfile::NamedTempFile;

mod find;
mod report;

const OUTPUTS: [&str; 3] = ["benchmark.md", "benchmark.json", "benchmark.png"];
const AS_RECORDED: &str = "as recorded";

const REMEDY: &str = "name a folder where beside NAME.clf (.log, .mcap, .db3, .bag) there is NAME.relations, or a reference trajectory \
                      NAME.xyt or NAME.tum";

/// Maps every log of a folder, and of those below it, whose true path is known. Writes benchmark.md and benchmark.json, a row for
/// each run, and benchmark.png, its maps. Each run has one thread, on the CPU. The truth of NAME.clf lies beside it: relations
/// NAME.relations, or a reference trajectory NAME.xyt or NAME.tum; NAME may be cut at a hyphen (docs/formats.md has all).
#[derive(Debug, clap::Args)]
pub struct BenchmarkArgs {
    /// Folder of logs with relations or a reference beside them
    dir: PathBuf,
    /// Seeds of the runs, and of what is drawn for harder drives
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_value = "1")]
    seeds: Vec<u64>,
    /// Numbers of maps, and of particles where there are more: 8,32,32x512 [default: the configuration's]
    #[arg(long, value_name = "N[xPARTICLES],..", value_delimiter = ',', value_parser = maps)]
    maps: Vec<(usize, Option<usize>)>,
    /// Harder drives besides the log as recorded, by the options of `ipslam degrade` without hyphens: "noise 8; noise 4 skip 4"
    #[arg(long, value_name = "KINDS", value_delimiter = ';', value_parser = hard)]
    hard: Vec<Hard>,
    /// TOML file that sets any part of the configuration
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Runs at a time; 0 for one for each core
    #[arg(long, default_value_t = 0)]
    jobs: usize,
    /// Folder for the outputs
    #[arg(long, value_name = "DIR", default_value = "ipslam-benchmark")]
    out: PathBuf,
    /// Replace an earlier benchmark in that folder
    #[arg(long)]
    force: bool,
}

/// A kind of harder drive.
#[derive(Clone, Debug)]
struct Hard {
    name: String,
    damage: DamageArgs,
}

fn maps(text: &str) -> Result<(usize, Option<usize>), String> {
    let (maps, particles) = text.split_once('x').map_or((text, None), |(maps, particles)| (maps, Some(particles)));
    let number = |text: &str| text.trim().parse::<usize>().map_err(|error| format!("{text}: {error}"));
    Ok((number(maps)?, particles.map(number).transpose()?))
}

fn hard(text: &str) -> Result<Hard, String> {
    let name = text.split_whitespace().collect::<Vec<_>>().join(" ");
    Ok(Hard { damage: DamageArgs::parse(&name)?, name })
}

/// Maps all logs, and writes what came out. What went wrong in single runs is returned as a list.
pub fn benchmark(args: &BenchmarkArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    let configs = args.configs()?;
    for Hard { damage, .. } in &args.hard {
        damage.damage().apply(Vec::new(), 1)?;
    }
    let (logs, without) = find::logs(&args.dir)?;
    let nothing = || UsageError(format!("{}: no log here has a truth beside it; {REMEDY}", args.dir.display()));
    ensure!(!logs.is_empty(), nothing());
    let is_free = args.force || OUTPUTS.iter().all(|name| !args.out.join(name).exists());
    let remedy = "an earlier benchmark is there: name another folder with --out, or replace it with --force";
    ensure!(is_free, UsageError(format!("{}: {remedy}", args.out.display())));
    std::fs::create_dir_all(&args.out).with_context(|| format!("{}: cannot be made", args.out.display()))?;
    interrupt::watch()?;

    let jobs: Vec<Job<'_>> = logs
        .iter()
        .flat_map(|log| std::iter::once(None).chain(args.hard.iter().map(Some)).map(move |hard| (log, hard)))
        .flat_map(|(log, hard)| configs.iter().map(move |&config| Job { log, hard, config }))
        .collect();
    say!("{} runs over {} logs; logs without a truth beside them: {without}", jobs.len(), logs.len());
    let done = run_all(&jobs, args.jobs);
    if done.is_empty() {
        return Ok(Vec::new());
    }
    let mut sheet = Sheet::default();
    done.iter().for_each(|(row, drawn)| row.draw(drawn, &mut sheet));
    let rows: Vec<Row> = done.into_iter().map(|(row, _)| row).collect();
    let texts = [
        report::markdown(&args.command(), &rows).into_bytes(),
        format!("{:#}\n", report::json(&args.command(), &rows)?).into_bytes(),
        sheet.to_png()?,
    ];
    for (name, bytes) in OUTPUTS.iter().zip(texts) {
        write_whole(&args.out.join(name), |file| file.write_all(&bytes))?;
    }
    say!("outputs are in {}", args.out.display());
    Ok(rows.iter().filter_map(|row| Some(anyhow!("{}: {}", row.title(), row.result.as_ref().err()?))).collect())
}

impl BenchmarkArgs {
    /// Every configuration with every seed.
    fn configs(&self) -> anyhow::Result<Vec<SlamConfig>> {
        let mut base = SlamConfig::default();
        if let Some(path) = &self.config {
            base = base.with_toml(&configuration::read(path)?).with_context(|| path.display().to_string())?;
        }
        let own = [(base.maps, Some(base.particles))];
        let mut configs = Vec::new();
        for &(maps, particles) in if self.maps.is_empty() { &own[..] } else { &self.maps } {
            for &seed in &self.seeds {
                let config = SlamConfig { maps, particles: particles.unwrap_or(maps), seed, ..base };
                config.validate()?;
                configs.push(config);
            }
        }
        Ok(configs)
    }

    /// What repeats it.
    fn command(&self) -> String {
        let list = |numbers: Vec<String>| numbers.join(",");
        let mut command = format!("ipslam benchmark {}", self.dir.display());
        command += &format!(" --seeds {}", list(self.seeds.iter().map(u64::to_string).collect()));
        if !self.maps.is_empty() {
            let named = |&(maps, particles): &(usize, Option<usize>)| report::maps(maps, particles.unwrap_or(maps));
            command += &format!(" --maps {}", list(self.maps.iter().map(named).collect()));
        }
        if !self.hard.is_empty() {
            let kinds: Vec<&str> = self.hard.iter().map(|hard| &*hard.name).collect();
            command += &format!(" --hard '{}'", kinds.join("; "));
        }
        if let Some(path) = &self.config {
            command += &format!(" --config {}", path.display());
        }
        command
    }
}

/// A run to be done.
struct Job<'a> {
    log: &'a Log,
    hard: Option<&'a Hard>,
    config: SlamConfig,
}

/// Walls and path, to be drawn.
type Drawn = (Vec<Cluster>, Vec<StampedPose>);

/// Does the runs, several at a time, each in one thread of its own; those that were interrupted are left out.
fn run_all(jobs: &[Job<'_>], at_a_time: usize) -> Vec<(Row, Drawn)> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let workers = if at_a_time == 0 { cores } else { at_a_time }.min(jobs.len());
    let (next, ended, progress) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicU64::new(0));
    let done = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                while let Some((number, job)) = next_of(jobs, &next) {
                    let ended = job.row(&progress);
                    if !interrupt::happened() {
                        done.lock().unwrap_or_else(PoisonError::into_inner).push((number, ended));
                    }
                }
                ended.fetch_add(1, Ordering::Release);
            });
        }
        let mut bar = Bar::new(Some(PERMILLE * jobs.len() as u64));
        while ended.load(Ordering::Acquire) < workers {
            std::thread::sleep(Duration::from_millis(50));
            let finished = done.lock().unwrap_or_else(PoisonError::into_inner).len();
            bar.update(progress.load(Ordering::Relaxed), |_| format!("{finished} of {} runs", jobs.len()));
        }
        bar.finish();
    });
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.sort_by_key(|(number, _)| *number);
    done.into_iter().map(|(_, row)| row).collect()
}

fn next_of<'a, 'b>(jobs: &'a [Job<'b>], next: &AtomicUsize) -> Option<(usize, &'a Job<'b>)> {
    let number = next.fetch_add(1, Ordering::Relaxed);
    jobs.get(number).filter(|_| !interrupt::happened()).map(|job| (number, job))
}

impl Job<'_> {
    fn row(&self, progress: &AtomicU64) -> (Row, Drawn) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(anyhow::Error::from);
        let (result, drawn) = match pool.and_then(|pool| pool.install(|| self.map(progress))) {
            Ok((scores, drawn)) => (Ok(scores), drawn),
            Err(error) => (Err(super::with_causes(&error)), Drawn::default()),
        };
        let SlamConfig { seed, maps, particles, .. } = self.config;
        let kind = self.hard.map_or(AS_RECORDED, |hard| &hard.name).to_owned();
        (Row { log: self.log.name.clone(), kind, seed, maps, particles, result }, drawn)
    }

    /// Maps the log and scores the path. Called in the one thread that it takes.
    fn map(&self, progress: &AtomicU64) -> anyhow::Result<(Scores, Drawn)> {
        let Self { log, hard, config } = self;
        let truth = TruthArgs { relations: log.relations.clone(), reference: log.reference.clone() };
        let truth = truth.read()?;
        let harder = hard.map(|hard| self.harder(hard)).transpose()?;
        let source = match &harder {
            Some(harder) => Box::new(CarmenLog::new(harder.path())),
            None => open_log(&log.path, &Topics::default())?,
        };
        let began = cpu_seconds();
        let (mapped, seconds) = self.run(&*source, progress, began)?;
        let trajectory = mapped.result.trajectory();
        let (report, _) = truth.score(&log.path, &trajectory, &mapped.truth);
        let summary = Summary {
            name: &log.name,
            device: "CPU",
            mapped: &mapped,
            dropped: 0,
            continues: None,
            config,
            map_bytes: 0,
            drawing_seconds: 0.0,
            report: &report,
        };
        let summary = summary.json()?;
        Ok((Scores::new(&report, &summary, &trajectory, seconds)?, (mapped.result.map.clusters, trajectory)))
    }

    /// The log made harder, in a file that goes when it is dropped.
    fn harder(&self, Hard { damage, .. }: &Hard) -> anyhow::Result<NamedTempFile> {
        let source = open_log(&self.log.path, &Topics::default())?;
        let entries = damage.damage().apply(entries(&*source)?, self.config.seed)?;
        let file = tempfile::Builder::new().suffix(".clf").tempfile().context("no file for the harder drive")?;
        convert::write_log(&mut entries.into_iter().map(Ok), BufWriter::new(file.as_file()), interrupt::happened)?;
        Ok(file)
    }

    fn run(
        &self,
        source: &dyn LogSource,
        progress: &AtomicU64,
        began: Option<f64>,
    ) -> anyhow::Result<(Outcome, Option<f64>)> {
        let run = Run { smoothing: Some(self.config.smoother()), ..Run::of(source) };
        let mut told = 0;
        let mut mapped = run.run(&mut Slam::new(self.config), &mut [], &mut |step| {
            if let Progress::Entry { bytes: Some((read, all)), .. } = step {
                let now = PERMILLE * read / all.max(1);
                progress.fetch_add(now.saturating_sub(told), Ordering::Relaxed);
                told = now;
            }
            !interrupt::happened()
        })?;
        progress.fetch_add(PERMILLE.saturating_sub(told), Ordering::Relaxed);
        std::mem::replace(&mut mapped.smoothing, Ok(()))?;
        if let End::BrokeOff(error) = mapped.end {
            return Err(error.into());
        }
        ensure!(mapped.counts.scans > 0, "no laser reading in this log");
        let seconds = began.and_then(|began| Some(cpu_seconds()? - began));
        Ok((mapped, seconds))
    }
}

/// What this thread has used of a core [s], if the system provides it (Linux).
fn cpu_seconds() -> Option<f64> {
    let used = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    used.split_whitespace().next()?.parse::<u64>().ok().map(|nanoseconds| 1e-9 * nanoseconds as f64)
}
