//! The first pass over a log: every entry to the filter, every step to the observers, and counts of it all.

use super::interrupt;
use super::progress::Progress;
use ipslam::config::Config;
use ipslam::geometry::StampedPose;
use ipslam::log::{LogEntry, LogError, LogSource, LogStats};
use ipslam::record::{Observer, RunResult, StageTimes, StepReport};
use ipslam::scan::Scan;
use ipslam::slam::Slam;
use ipslam::smoothing::smooth;
use std::time::Instant;

/// What the filter made of a log.
pub struct Mapped {
    pub result: RunResult,
    /// The true poses that the log itself tells, in the frame of the log.
    pub truth: Vec<StampedPose>,
    pub stats: LogStats,
    pub tally: Tally,
    pub end: End,
    /// Seconds that the filter took.
    pub filter_seconds: f64,
    /// Seconds that the smoothing took.
    pub smoothing_seconds: f64,
    /// What kept the smoothing from being finished.
    pub smoothing: Result<(), LogError>,
    /// Why the CPU took over from the device.
    pub evaluator_failure: Option<String>,
}

impl Mapped {
    /// Seconds from the first entry to the finished map.
    pub fn seconds(&self) -> f64 {
        self.filter_seconds + self.smoothing_seconds
    }
}

/// Why the pass ended.
pub enum End {
    Log,
    MaxScans,
    Interrupted,
    BrokeOff(LogError),
}

/// Counts of a pass.
#[derive(Default)]
pub struct Tally {
    pub scans: u64,
    pub empty_scans: u64,
    pub points: u64,
    pub no_return: u64,
    pub invalid: u64,
    pub steps: u64,
    pub resamplings: u64,
    pub clusters: usize,
    pub effective_sum: f64,
    pub effective_worst: f64,
    pub effective_last: f64,
    pub times: StageTimes,
    /// The first stamp and the greatest since: stamps that go backwards take no time away.
    first_and_latest_stamp: Option<(f64, f64)>,
}

/// Maps a log up to `max_scans` of it, and smooths the result if told so.
pub fn map_log(
    source: &dyn LogSource,
    mut slam: Slam,
    config: &Config,
    max_scans: Option<u64>,
    smoothes: bool,
    observers: &mut [Box<dyn Observer + '_>],
) -> Result<Mapped, LogError> {
    let began = Instant::now();
    let mut reader = source.open()?;
    let mut progress = Progress::new(reader.progress().map(|(_, all)| all));
    let mut tally = Tally::default();
    let mut truth = Vec::new();
    let end = loop {
        if interrupt::happened() {
            break End::Interrupted;
        }
        if max_scans == Some(tally.scans) {
            break End::MaxScans;
        }
        let entry = match reader.next() {
            None => break End::Log,
            Some(Err(error)) => break End::BrokeOff(error),
            Some(Ok(entry)) => entry,
        };
        if let LogEntry::Truth { stamp, world_from_robot } = entry {
            truth.push(StampedPose { stamp, pose: world_from_robot });
        }
        tally.entry(&entry, config);
        observers.iter_mut().for_each(|observer| observer.on_entry(&entry));
        slam.add(&entry, &mut |report| {
            tally.step(report);
            observers.iter_mut().for_each(|observer| observer.on_step(report));
        });
        progress.update(reader.progress().map_or(tally.scans, |(done, _)| done), |seconds| tally.progress(seconds));
    };
    progress.finish();
    let filter_seconds = began.elapsed().as_secs_f64();
    let evaluator_failure = slam.evaluator_failure().map(ToString::to_string);
    let mut result = slam.finish();
    let began = Instant::now();
    let smoothes = smoothes && !matches!(end, End::Interrupted);
    let smoothing = if smoothes { smooth(source, &mut result, config) } else { Ok(()) };
    let smoothing_seconds = began.elapsed().as_secs_f64();
    let is_smoothed = smoothes && smoothing.is_ok();
    observers.iter_mut().for_each(|observer| observer.on_finish(&result, is_smoothed));
    let stats = reader.stats().clone();
    Ok(Mapped { result, truth, stats, tally, end, filter_seconds, smoothing_seconds, smoothing, evaluator_failure })
}

impl Tally {
    fn entry(&mut self, entry: &LogEntry, config: &Config) {
        let reading = match entry {
            LogEntry::Odometry { stamp, .. } | LogEntry::Truth { stamp, .. } => return self.time(*stamp),
            LogEntry::Laser(reading) => reading,
        };
        self.time(reading.stamp);
        let scan = Scan::from_reading(reading, config.scan.min_range, config.scan.max_range);
        self.scans += 1;
        self.empty_scans += u64::from(scan.points.is_empty());
        self.points += scan.points.len() as u64;
        self.no_return += scan.no_return as u64;
        self.invalid += scan.invalid as u64;
    }

    fn time(&mut self, stamp: f64) {
        let (first, latest) = self.first_and_latest_stamp.unwrap_or((stamp, stamp));
        self.first_and_latest_stamp = Some((first, latest.max(stamp)));
    }

    fn step(&mut self, report: &StepReport<'_>) {
        let effective = report.effective_sample_size;
        self.effective_worst = if self.steps == 0 { effective } else { self.effective_worst.min(effective) };
        self.effective_sum += effective;
        self.effective_last = effective;
        self.steps += 1;
        self.resamplings += u64::from(report.resampled);
        self.clusters = report.map.len();
        let StageTimes { cluster, track, propagate, weigh, resample, merge } = report.times;
        self.times.cluster += cluster;
        self.times.track += track;
        self.times.propagate += propagate;
        self.times.weigh += weigh;
        self.times.resample += resample;
        self.times.merge += merge;
    }

    /// What the progress bar says.
    fn progress(&self, seconds: f64) -> String {
        format!(
            "{:.0} scans/s, {:.0}x real time, ESS {:.0}, {} clusters",
            self.scans as f64 / seconds,
            self.log_seconds() / seconds,
            self.effective_last,
            self.clusters,
        )
    }

    /// Time from the first entry to the latest [s].
    pub fn log_seconds(&self) -> f64 {
        self.first_and_latest_stamp.map_or(0.0, |(first, latest)| latest - first)
    }
}
