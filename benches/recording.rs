//! What recording costs a run, in turns with the same run that is not recorded.
//!
//! ```text
//! cargo bench --bench recording -- [LOG]
//! ```
//! Without a log, the simulated building is driven through. The filter is the default one, on the CPU.

use ipslam::config::{Config, SlamConfig};
use ipslam::io::mcap::Topics;
use ipslam::io::open_log;
use ipslam::log::LogSource;
use ipslam::pipeline::{Run, RunInfo};
use ipslam::record::rerun::{Level, RerunObserver};
use ipslam::report::Observer;
use ipslam::simulate::Simulation;
use ipslam::slam::Slam;
use std::path::Path;
use std::time::Instant;

/// How often each kind of run is done.
const ROUNDS: usize = 3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let log = std::env::args().skip(1).find(|arg| arg != "--bench");
    let source: Box<dyn LogSource> = match &log {
        Some(path) => open_log(path, &Topics::default())?,
        None => Box::new(Simulation::building(1)),
    };
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("run.rrd");
    let levels = [("without", None), ("light", Some(Level::Light)), ("full", Some(Level::Full))];
    let mut best = [f64::INFINITY; 3];
    let mut bytes = [0; 3];
    println!("{}: {ROUNDS} rounds", source.name());
    for round in 0..ROUNDS {
        for (number, (name, level)) in levels.iter().enumerate() {
            let seconds = run(&*source, *level, &file)?;
            println!("  round {round}, {name}: {seconds:.2} s");
            best[number] = best[number].min(seconds);
            bytes[number] = level.map_or(Ok(0), |_| std::fs::metadata(&file).map(|found| found.len()))?;
        }
    }
    for (number, (name, _)) in levels.iter().enumerate().skip(1) {
        println!(
            "{name}: {:.2} s where {:.2} s are taken without, {:+.1} %; {:.1} MB",
            best[number],
            best[0],
            100.0 * (best[number] / best[0] - 1.0),
            bytes[number] as f64 / 1e6
        );
    }
    println!("wanted: light at most 10 %");
    Ok(())
}

/// Seconds of a whole run, with the recording written out.
fn run(source: &dyn LogSource, level: Option<Level>, file: &Path) -> Result<f64, Box<dyn std::error::Error>> {
    let config = SlamConfig::default();
    let info = RunInfo { log: source.name(), device: "CPU".to_owned(), config: Config::Slam(config), continues: None };
    let began = Instant::now();
    let observer = level.map(|level| RerunObserver::to_file(file, &info, level)).transpose()?;
    let mut observers: Vec<Box<dyn Observer>> =
        observer.into_iter().map(|observer| Box::new(observer) as Box<dyn Observer>).collect();
    Run::of(source).run(&mut Slam::new(config), &mut observers, &mut |_| true)?;
    if let Some(failure) = observers.iter().find_map(|observer| observer.failure()) {
        return Err(failure.into());
    }
    Ok(began.elapsed().as_secs_f64())
}
