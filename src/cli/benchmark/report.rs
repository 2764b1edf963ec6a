//! A row for each run, and what they come to.

use super::Drawn;
use crate::cli::eval::Report;
use anyhow::{Context as _, bail};
use ipslam::geometry::StampedPose;
use ipslam::metrics::published::{PUBLISHED, Published};
use ipslam::picture::Sheet;
use serde::Serialize;
use serde_json::{Value, json};
use std::fmt::Write as _;

/// Mean error over loop relations up to which a map counts as closed [m].
const CLOSED: f64 = 0.4;
/// The same for the distance from a reference, root of the mean square: this, or more on long ways [m/m].
const CLOSED_PER_WAY: f64 = 5e-4;
const CONSISTENT: &str = "consistent";

/// A run, and its scores or why it failed.
#[derive(Debug)]
pub struct Row {
    pub log: String,
    pub kind: String,
    pub seed: u64,
    pub maps: usize,
    pub particles: usize,
    pub result: Result<Scores, String>,
}

#[derive(Debug, Serialize)]
pub struct Scores {
    /// Mean translational error over all relations, and over those that close a loop [m].
    error_m: Option<f64>,
    loops_m: Option<f64>,
    unmatched: Option<usize>,
    /// Root of the mean square distance from the reference, aligned [m].
    rms_m: Option<f64>,
    way_m: f64,
    closed: bool,
    verdict: String,
    doubts: Value,
    right_verdict: bool,
    cpu_s: Option<f64>,
    clusters: u64,
}

impl Scores {
    pub fn new(report: &Report<'_>, summary: &Value, path: &[StampedPose], cpu_s: Option<f64>) -> anyhow::Result<Self> {
        let relations = report.relations.as_ref().map(|(_, errors)| errors);
        let mean = |errors: Option<ipslam::metrics::PoseErrors>| errors.map(|errors| errors.translation.mean);
        let error_m = mean(relations.and_then(|errors| errors.all));
        let loops_m = mean(relations.and_then(|errors| errors.loop_closing));
        let reference = report.reference.as_ref().and_then(|(_, errors)| errors.absolute);
        let rms_m = reference.map(|errors| errors.rmse);
        let way_m = path.windows(2).map(|pair| (pair[1].pose.position() - pair[0].pose.position()).norm()).sum();
        let closed = match (loops_m, rms_m) {
            (Some(loops), _) => loops <= CLOSED,
            (None, Some(rms)) => rms <= CLOSED.max(CLOSED_PER_WAY * way_m),
            (None, None) => bail!("no stamp of the truth finds a pose; is it of the same log and clock?"),
        };
        let verdict = summary["verdict"].as_str().context("no verdict")?.to_owned();
        Ok(Self {
            error_m,
            loops_m,
            unmatched: relations.map(|errors| errors.unmatched),
            rms_m,
            way_m,
            closed,
            right_verdict: (verdict == CONSISTENT) == closed,
            verdict,
            doubts: summary["doubts"].clone(),
            cpu_s,
            clusters: summary["map"]["clusters"].as_u64().unwrap_or(0),
        })
    }

    /// The error that says whether it is closed.
    fn deciding(&self) -> String {
        match (self.loops_m, self.rms_m) {
            (Some(loops), _) => format!("loops {loops:.3} m"),
            (None, rms) => format!("rms {} m", metres(rms)),
        }
    }
}

impl Row {
    /// What was run.
    pub fn title(&self) -> String {
        format!("{}, {}, seed {}, {} maps", self.log, self.kind, self.seed, maps(self.maps, self.particles))
    }

    fn json(&self) -> serde_json::Result<Value> {
        let mut value = match &self.result {
            Ok(scores) => serde_json::to_value(scores)?,
            Err(error) => json!({ "error": error }),
        };
        value["log"] = self.log.as_str().into();
        value["kind"] = self.kind.as_str().into();
        value["seed"] = self.seed.into();
        value["maps"] = self.maps.into();
        value["particles"] = self.particles.into();
        Ok(value)
    }

    /// Draws the map: green where it is closed, else red.
    pub fn draw(&self, (walls, path): &Drawn, sheet: &mut Sheet) {
        let setting = format!("{}, seed {}, {} maps", self.kind, self.seed, maps(self.maps, self.particles));
        let (colour, last) = match &self.result {
            Ok(scores) => (
                if scores.closed { [40, 140, 70] } else { [200, 40, 40] },
                format!("{}, {}", scores.deciding(), scores.verdict),
            ),
            Err(_) => ([130, 130, 130], "failed".to_owned()),
        };
        sheet.add([&self.log, &setting, &last], colour, walls, path);
    }
}

/// Numbers of maps and particles, the latter where they differ.
pub fn maps(maps: usize, particles: usize) -> String {
    if particles == maps { maps.to_string() } else { format!("{maps}x{particles}") }
}

fn metres(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| format!("{value:.3}"))
}

fn machine() -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpu.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    format!("{} with {cores} cores", model.map_or("a machine", |(_, model)| model.trim()))
}

/// The figures of other systems on the logs of these runs.
fn published(rows: &[Row]) -> impl Iterator<Item = &'static Published> {
    PUBLISHED.iter().filter(|figure| rows.iter().any(|row| row.log.contains(figure.log)))
}

/// Everything, units in the names.
pub fn json(command: &str, rows: &[Row]) -> serde_json::Result<Value> {
    let version = env!("CARGO_PKG_VERSION");
    Ok(json!({
        "program": "ipslam",
        "version": version,
        "command": command,
        "machine": machine(),
        "runs": rows.iter().map(Row::json).collect::<serde_json::Result<Vec<_>>>()?,
        "published": serde_json::to_value(published(rows).collect::<Vec<_>>())?,
    }))
}

/// The same to be read.
pub fn markdown(command: &str, rows: &[Row]) -> String {
    let version = env!("CARGO_PKG_VERSION");
    let mut text = format!(
        "`{command}`, version {version}, on {}, one thread a run, CPU.\n\n\
         Error: mean over all relations, and over those that close a loop (more than 10 s apart). rms: distance from the reference, \
         aligned. Closed: loops at most {CLOSED} m; without relations, rms at most {CLOSED} m, or {} m for each kilometre of \
         way where that is more. Right: \
         \"consistent\" and closed, or \"doubtful\" and not. CPU: filter and smoothing, without pictures.\n\n\
         | log | kind | seed | maps | error [m] | loops [m] | rms [m] | closed | verdict | right | CPU [s] | clusters |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n",
        machine(),
        1e3 * CLOSED_PER_WAY
    );
    let yes = |is: bool| if is { "yes" } else { "**no**" };
    for row in rows {
        let _ = write!(text, "| {} | {} | {} | {} | ", row.log, row.kind, row.seed, maps(row.maps, row.particles));
        let _ = match &row.result {
            Ok(s) => writeln!(
                text,
                "{} | {} | {} | {} | {} | {} | {} | {} |",
                metres(s.error_m),
                metres(s.loops_m),
                metres(s.rms_m),
                yes(s.closed),
                s.verdict,
                yes(s.right_verdict),
                s.cpu_s.map_or_else(String::new, |seconds| format!("{seconds:.1}")),
                s.clusters
            ),
            Err(error) => writeln!(text, "failed: {} | | | | | | | |", error.replace(['\n', '|'], " ")),
        };
    }
    text += &summary(rows);
    text
}

fn summary(rows: &[Row]) -> String {
    let scores: Vec<&Scores> = rows.iter().filter_map(|row| row.result.as_ref().ok()).collect();
    let count = |closed: bool, consistent: bool| {
        scores.iter().filter(|s| s.closed == closed && (s.verdict == CONSISTENT) == consistent).count()
    };
    let mut text = format!(
        "\n{} runs, {} failed.\n\n| | consistent | doubtful |\n|---|---|---|\n| closed | {} | {} |\n| not closed | {} | {} |\n",
        rows.len(),
        rows.len() - scores.len(),
        count(true, true),
        count(true, false),
        count(false, true),
        count(false, false)
    );
    let mut settings: Vec<(usize, usize)> = rows.iter().map(|row| (row.maps, row.particles)).collect();
    settings.sort_unstable();
    settings.dedup();
    text += "\nRuns that closed, of all; their mean CPU seconds:\n\n| log | kind |";
    settings.iter().for_each(|&(m, p)| text += &format!(" {} maps |", maps(m, p)));
    text += "\n|---|---|";
    text += &"---|".repeat(settings.len());
    let mut drives: Vec<(&str, &str)> = rows.iter().map(|row| (&*row.log, &*row.kind)).collect();
    drives.dedup();
    for (log, kind) in drives {
        text += &format!("\n| {log} | {kind} |");
        for &(maps, particles) in &settings {
            let is = |row: &&Row| (&*row.log, &*row.kind, row.maps, row.particles) == (log, kind, maps, particles);
            let runs = rows.iter().filter(is);
            let scores = runs.clone().filter_map(|row| row.result.as_ref().ok());
            let closed = scores.clone().filter(|scores| scores.closed).count();
            let seconds = scores.clone().filter_map(|s| s.cpu_s).sum::<f64>() / scores.count().max(1) as f64;
            text += &format!(" {closed} of {}; {seconds:.1} s |", runs.count());
        }
    }
    text += "\n";
    let mut figures = published(rows).peekable();
    if figures.peek().is_some() {
        text += "\nOther systems on the logs as recorded:\n\n| log | system | error [m] | loops [m] | source |\n|---|---|---|---|---|\n";
    }
    for Published { log, system, all, loops, source } in figures {
        let _ = writeln!(text, "| {log} | {system} | {} | {} | {source} |", metres(Some(*all)), metres(*loops));
    }
    text
}
