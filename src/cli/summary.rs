//! The summary of a run: `summary.json`, and the same as a short table.

use super::eval::Report;
use ipslam::config::SlamConfig;
use ipslam::geometry::Pose;
use ipslam::pipeline::{Continued, End, Outcome};
use ipslam::report::{Loop, RunResult, StageTimes};
use ipslam::tracking::OdometryErrors;
use serde_json::{Value, json};
use std::fmt::Write as _;

/// A cluster has five numbers: its mean (2), the direction of its long axis (1) and the variances along and across it (2).
const NUMBERS_PER_CLUSTER: u64 = 5;
/// A measured point by its two coordinates.
const NUMBERS_PER_POINT: u64 = 2;

/// Share of what scans saw that may be gone when they look again: in drives that came out right it is below 0.06, and where
/// three or six people walk along and mislead the robot above 0.3.
const MOVING: f64 = 0.2;

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
        let (stats, counts) = (&self.mapped.stats, &self.mapped.counts);
        let mut warnings = Vec::new();
        match &self.mapped.end {
            End::Log => {}
            End::MaxScans => warnings.push(format!("ended after {} scans, as asked for", counts.scans)),
            End::Interrupted => warnings.push(format!("interrupted after {} scans", counts.scans)),
            End::BrokeOff(error) => warnings.push(format!("the log breaks off: {error}")),
        }
        warnings.extend(dropped_scans(self.dropped));
        if let Some(failure) = &self.mapped.evaluator_failure {
            warnings.push(format!("{failure}; the CPU did the step again and went on"));
        }
        if let Some(first) = &stats.first_malformed {
            warnings.push(format!("malformed lines left out: {}; the first one: {first}", stats.malformed));
        }
        match stats.laser_without_odometry {
            0 => {}
            _ if self.has_no_odometry() => {
                warnings.push("no odometry at all: the map is made by scan matching alone and may be wrong where scans have few features; check map.png".to_owned());
            }
            some => warnings.push(format!(
                "scans before any odometry, or in a bag more than 1 s from it: {some}; they were taken to be where it starts \
                 or is nearest"
            )),
        }
        warnings.extend(refused_odometry(&self.mapped.result));
        if self.mapped.result.objects.as_ref().is_some_and(|objects| objects.frames_used == 0) {
            warnings.push("no frame of detections lies within the log: is its clock the same?".to_owned());
        }
        if stats.laser_without_mounting > 0 {
            warnings.push(
                "the bag has no mounting of the laser (no chain of fixed transforms on /tf_static or /tf): the laser was assumed to be at the robot's \
                 origin, facing forward"
                    .to_owned(),
            );
        }
        if let Some(seconds) = stats.clocks_differ {
            warnings.push(format!(
                "scans and odometry are stamped by clocks that differ by {seconds:.1} s, or one does not run: the times at \
                 which the bag received them counted in place of the stamps"
            ));
        }
        if stats.guessed_angles > 0 {
            warnings.push(format!(
                "sweeps without the angles of their beams: {}; 180 degrees were assumed (option --fov)",
                stats.guessed_angles
            ));
        }
        if stats.backward_stamps > 0 {
            let count = stats.backward_stamps;
            warnings.push(format!("stamps that go backwards: {count}; the order of the log counted, not the stamps"));
        }
        if counts.empty_scans > 0 {
            warnings.push(format!("scans without a point: {} of {}", counts.empty_scans, counts.scans));
        }
        if counts.scans == 1 {
            warnings.push("one scan only: the map is what it saw".to_owned());
        }
        let nothing_matched = "no stamp finds a pose of the trajectory; is it of the same log and clock?";
        if let Some((path, _)) = self.report.relations.as_ref().filter(|(_, errors)| errors.all.is_none()) {
            warnings.push(format!("{}: {nothing_matched}", path.display()));
        }
        if let Some((path, _)) = self.report.reference.as_ref().filter(|(_, errors)| errors.absolute.is_none()) {
            warnings.push(format!("{}: {nothing_matched}", path.display()));
        }
        warnings
    }

    /// None in the log, or one that never changes while scan matching has the robot drive.
    fn has_no_odometry(&self) -> bool {
        let Outcome { stats, counts, result, .. } = self.mapped;
        let is_constant = || result.poses.windows(2).all(|pair| pair[0].odom_from_robot == pair[1].odom_from_robot);
        stats.laser > 0 && (stats.laser_without_odometry == stats.laser || counts.steps > 1 && is_constant())
    }

    /// Why the result may not be relied on.
    fn doubts(&self) -> Vec<String> {
        let mut doubts = Vec::new();
        let open: Vec<&Loop> = self.mapped.result.loops.iter().filter(|found| !found.is_closed).collect();
        if let Some(first) = open.first() {
            doubts.push(format!(
                "loops that were found and that the path does not close: {}, first at stamp {} ({:.1} m off a place {})",
                open.len(),
                first.stamp,
                first.correction,
                first.older_stamp.map_or("of the earlier map".to_owned(), |stamp| format!("of stamp {stamp}"))
            ));
        }
        let looked_through = self.mapped.result.looked_through;
        if looked_through > MOVING {
            doubts.push(format!(
                "{:.0} % of what the scans saw was not there when they looked again: people who walk along, or a path that is wrong",
                100.0 * looked_through
            ));
        }
        if self.has_no_odometry() {
            doubts.push("no odometry: where scans have few features, the distance driven is unknown".to_owned());
        }
        doubts
    }

    /// Everything, units in the names.
    pub fn json(&self) -> serde_json::Result<Value> {
        let Self { mapped, config, .. } = self;
        let counts = &mapped.counts;
        let of_particles = |count: f64| count / config.particles as f64;
        let doubts = self.doubts();
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
        let memory = peak_memory().map(|bytes| ("memory", format!("{:.0} MB at most", bytes as f64 / 1e6)));
        let verdict = self.doubts().into_iter().map(|doubt| ("doubtful", doubt));
        let warnings = self.warnings().into_iter().map(|warning| ("warning", warning)).chain(verdict);
        let mut table = String::new();
        let [log, others @ ..] = rows;
        for (label, text) in
            [log].into_iter().chain(continues).chain(others).chain(objects).chain(memory).chain(warnings)
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

/// What to say of scans that a live drive dropped.
pub fn dropped_scans(count: u64) -> Option<String> {
    (count > 0).then(|| format!("scans that were dropped, as the filter could not keep up with the robot: {count}"))
}

/// What to say of odometry that was not believed, if there is any.
pub fn refused_odometry(result: &RunResult) -> Option<String> {
    let first = result.refused_odometry.first()?;
    Some(format!(
        "odometry that no robot can have driven (a jump, a restart, no number): {}, first at stamp {first}; scan matching \
         bridged it (options tracking.max_speed, max_turn_rate, max_acceleration)",
        result.refused_odometry.len()
    ))
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
