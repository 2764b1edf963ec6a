//! The summary of a run: `summary.json`, and the same as a short table.

use super::eval::Report;
use ipslam::config::SlamConfig;
use ipslam::geometry::Pose;
use ipslam::pipeline::{Continued, End, Outcome};
use ipslam::report::{RunResult, StageTimes};
use ipslam::tracking::{GyroUse, OdometryErrors};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// A cluster has five numbers: its mean (2), the direction of its long axis (1) and the variances along and across it (2).
const NUMBERS_PER_CLUSTER: u64 = 5;
/// A measured point by its two coordinates.
const NUMBERS_PER_POINT: u64 = 2;

/// The run to summarise.
pub struct Summary<'a> {
    pub name: &'a str,
    pub device: &'a str,
    pub mapped: &'a Outcome,
    /// Scans of a live drive that were dropped.
    pub dropped: u64,
    pub continues: Option<&'a Continued>,
    pub config: &'a SlamConfig,
    pub map_bytes: usize,
    pub drawing_seconds: f64,
    pub report: &'a Report<'a>,
}

impl Summary<'_> {
    fn clusters(&self) -> u64 {
        self.mapped.result.map.clusters.len() as u64
    }

    /// Numbers of the map, as a share of those of the points.
    fn share_of_points(&self) -> f64 {
        let points = NUMBERS_PER_POINT * self.mapped.counts.points;
        (NUMBERS_PER_CLUSTER * self.clusters()) as f64 / points.max(1) as f64
    }

    fn effective_mean(&self) -> f64 {
        self.mapped.counts.effective_sum / self.mapped.counts.steps.max(1) as f64
    }

    fn times_real_time(&self) -> f64 {
        self.mapped.counts.log_seconds() / self.seconds().max(1e-9)
    }

    /// Seconds from the first entry to the finished map.
    fn seconds(&self) -> f64 {
        self.mapped.filter_seconds + self.mapped.smoothing_seconds
    }

    fn is_scored(&self) -> bool {
        self.report.relations.is_some() || self.report.reference.is_some()
    }

    /// Warnings: the run went on.
    fn warnings(&self) -> Vec<String> {
        let mut warnings = self.mapped.warnings();
        warnings.extend(dropped_scans(self.dropped));
        let nothing_matched = "no stamp finds a pose of the trajectory; is it of the same log and clock?";
        if let Some((path, _)) = self.report.relations.as_ref().filter(|(_, errors)| errors.all.is_none()) {
            warnings.push(format!("{}: {nothing_matched}", path.display()));
        }
        if let Some((path, _)) = self.report.reference.as_ref().filter(|(_, errors)| errors.absolute.is_none()) {
            warnings.push(format!("{}: {nothing_matched}", path.display()));
        }
        warnings
    }

    /// Everything, units in the names.
    pub fn json(&self) -> serde_json::Result<Value> {
        let Self { mapped, config, .. } = self;
        let counts = &mapped.counts;
        let of_particles = |count: f64| count / config.particles as f64;
        let doubts = mapped.doubts();
        Ok(json!({
            "program": "ipslam",
            "version": env!("CARGO_PKG_VERSION"),
            "log": {
                "name": self.name,
                "ended_by": match mapped.end {
                    End::Log => "end of log",
                    End::MaxScans => "max scans",
                    End::Interrupted => "interrupt",
                    End::BrokeOff(_) => "broken log",
                },
                "duration_s": counts.log_seconds(),
                "stats": mapped.stats,
            },
            "continues": self.continues.map(|Continued { name, first_scan, world_from_robot, .. }| json!({
                "map": name,
                "first_scan": first_scan,
                "world_from_robot": world_from_robot,
            })),
            "beams": {
                "scans": counts.scans,
                "scans_dropped": self.dropped,
                "scans_without_points": counts.empty_scans,
                "points": counts.points,
                "no_return": counts.no_return,
                "invalid": counts.invalid,
            },
            "map": {
                "clusters": self.clusters(),
                "numbers": NUMBERS_PER_CLUSTER * self.clusters(),
                "numbers_of_points": NUMBERS_PER_POINT * counts.points,
                "share_of_points": self.share_of_points(),
                "looked_through": mapped.result.looked_through,
                "json_bytes": self.map_bytes,
            },
            "objects": mapped.result.objects.as_ref().map(|objects| json!({
                "landmarks": objects.landmarks.len(),
                "frames_used": objects.frames_used,
            })),
            "filter": {
                "steps": counts.steps,
                "resamplings": counts.resamplings,
                "effective_sample_size": {
                    "mean": self.effective_mean(),
                    "worst": counts.effective_worst,
                    "mean_share": of_particles(self.effective_mean()),
                    "worst_share": of_particles(counts.effective_worst),
                },
            },
            "odometry_errors": mapped.result.odometry_errors,
            "gyro": mapped.result.gyro,
            "loops": mapped.result.loops,
            "verdict": if doubts.is_empty() { "consistent" } else { "doubtful" },
            "doubts": doubts,
            "time": {
                "filter_s": mapped.filter_seconds,
                "smoothing_s": mapped.smoothing_seconds,
                "times_real_time": self.times_real_time(),
                "stages_s": counts.times,
                "drawing_s": self.drawing_seconds,
            },
            "peak_memory_bytes": peak_memory(),
            "device": self.device,
            "threads": rayon::current_num_threads(),
            "seed": config.seed,
            "configuration": with_infinities(serde_json::to_value(config)?),
            "warnings": self.warnings(),
            "metrics": self.is_scored().then(|| self.report.json()),
        }))
    }

    /// The same in some twenty lines.
    pub fn table(&self) -> String {
        let Self { mapped, config, .. } = self;
        let counts = &mapped.counts;
        let percent = |count: f64| 100.0 * count / config.particles as f64;
        let StageTimes { cluster, track, propagate, weigh, resample, merge, .. } = counts.times;
        let loops = &mapped.result.loops;
        let rows = [
            ("log", format!("{}: {} scans in {:.1} s", self.name, counts.scans, counts.log_seconds())),
            (
                "beams",
                format!("{} points, {} without return, {} invalid", counts.points, counts.no_return, counts.invalid),
            ),
            (
                "map",
                format!(
                    "{} clusters of {NUMBERS_PER_CLUSTER} numbers, {:.2} % of the numbers of the points; {:.1} kB as JSON",
                    self.clusters(),
                    100.0 * self.share_of_points(),
                    self.map_bytes as f64 / 1e3
                ),
            ),
            ("filter", format!("{} particles in {} maps, seed {}", config.particles, config.maps, config.seed)),
            ("", format!("{} steps, resampled in {}", counts.steps, counts.resamplings)),
            (
                "",
                format!(
                    "effective sample size {:.1} on average ({:.0} %), {:.1} at worst ({:.0} %)",
                    self.effective_mean(),
                    percent(self.effective_mean()),
                    counts.effective_worst,
                    percent(counts.effective_worst)
                ),
            ),
            ("odometry", odometry_errors(&mapped.result)),
            ("loops", format!("{} found, {} closed", loops.len(), loops.iter().filter(|l| l.is_closed).count())),
            (
                "time",
                format!(
                    "{:.1} s with {} threads: {:.1} times real time; {:.1} s for the pictures",
                    self.seconds(),
                    rayon::current_num_threads(),
                    self.times_real_time(),
                    self.drawing_seconds
                ),
            ),
            ("", format!("particles on the {}", self.device)),
            (
                "",
                format!(
                    "cluster {cluster:.1} s, track {track:.1}, propagate {propagate:.1}, weigh {weigh:.1}, \
                     resample {resample:.1}, merge {merge:.1}, smoothing {:.1}",
                    mapped.smoothing_seconds
                ),
            ),
        ];
        let objects = mapped.result.objects.as_ref().map(|objects| {
            ("objects", format!("{} from {} frames of detections", objects.landmarks.len(), objects.frames_used))
        });
        let continues = self.continues.map(|Continued { name, world_from_robot: Pose { x, y, heading }, .. }| {
            let degrees = heading.to_degrees();
            ("", format!("goes on with {name}, from ({x:.2}, {y:.2}) m, {degrees:.0}° in it"))
        });
        let gyro = gyro(mapped).map(|text| ("gyro", text));
        let memory = peak_memory().map(|bytes| ("memory", format!("{:.0} MB at most", bytes as f64 / 1e6)));
        let verdict = mapped.doubts().into_iter().map(|doubt| ("doubtful", doubt));
        let warnings = self.warnings().into_iter().map(|warning| ("warning", warning)).chain(verdict);
        let mut table = String::new();
        let [log, others @ ..] = rows;
        for (label, text) in
            [log].into_iter().chain(continues).chain(others).chain(gyro).chain(objects).chain(memory).chain(warnings)
        {
            let _ = writeln!(table, "{label:<8} {text}");
        }
        if self.is_scored() {
            table += "\n";
            table += &self.report.table();
        }
        table
    }
}

/// The error of odometry in units of the configured noise.
pub fn odometry_errors(result: &RunResult) -> String {
    let OdometryErrors { position, heading } = result.odometry_errors;
    format!(
        "errs {position:.2} times as much as expected in positions, {heading:.2} times in headings, by its motions against the scans"
    )
}

/// What the gyroscope had to say, where a bag has one.
pub fn gyro(outcome: &Outcome) -> Option<String> {
    let (GyroUse { measured, believed, bias, .. }, imu) = outcome.result.gyro.zip(outcome.stats.imu.as_ref())?;
    let (topic, readings) = (&imu.topic, outcome.result.poses.len());
    Some(format!("{topic}: turns of {measured} of {readings} readings, {believed} believed; bias {bias:.4} rad/s"))
}

/// What to say of scans that a live drive dropped.
pub fn dropped_scans(count: u64) -> Option<String> {
    (count > 0).then(|| format!("scans that were dropped, as the filter could not keep up with the robot: {count}"))
}

/// JSON has no infinity and `serde_json` writes null for it; of a configuration that was found valid no number is else.
fn with_infinities(value: Value) -> Value {
    match value {
        Value::Null => "inf".into(),
        Value::Object(members) => members.into_iter().map(|(key, value)| (key, with_infinities(value))).collect(),
        other => other,
    }
}

/// The most memory that this process ever held [bytes], if the system provides it (Linux).
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix(" kB")?.parse::<u64>().ok().map(|kilobytes| 1024 * kilobytes)
}
