//! A source, an estimator and observers make a run: every entry of the log goes to the estimator, every event to the
//! observers, and the result is smoothed.

use crate::config::Config;
use crate::geometry::{Pose, StampedPose};
use crate::log::{LogEntry, LogError, LogSource, LogStats};
use crate::map::LineMap;
use crate::report::{Estimator, Event, Observer, RunResult, StageTimes, StepReport};
use crate::slam::{Slam, SlamConfig};
use crate::smoothing::Smoother;
use web_time::Instant;

pub use verdict::{NO_ODOMETRY, refused_odometry};

mod verdict;

/// What a run starts with: together with the entries of its log, everything needed to repeat it.
#[derive(Clone, Debug, PartialEq)]
pub struct RunInfo {
    /// Name of the log.
    pub log: String,
    /// What evaluates the particles, in the words of its driver.
    pub device: String,
    /// The configuration, which also names the task.
    pub config: Config,
    /// The earlier drive whose map is continued, if one is.
    pub continues: Option<Continued>,
}

/// The map of an earlier drive, and where a drive begins in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Continued {
    /// Name of the map.
    pub name: String,
    /// The map, in the world's frame.
    pub map: LineMap,
    /// The first scan that is mapped: its number among the readings, as [`readings`](crate::log::readings) counts them. The scans
    /// before it are used as odometry only.
    pub first_scan: usize,
    /// Pose of the robot there.
    pub world_from_robot: Pose,
}

/// A run: the part of a log that the estimator gets, and the smoothing after it.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    /// The log.
    pub source: &'a dyn LogSource,
    /// Readings less than this after the first one are left out \[s\].
    pub skip: f64,
    /// Maximum number of laser readings.
    pub max_scans: Option<u64>,
    /// How the result is smoothed; `None` leaves it as the filter found it.
    pub smoothing: Option<Smoother>,
}

/// The result of a run, with its statistics.
#[non_exhaustive]
pub struct Outcome {
    /// Smoothed if [`Run::smoothing`] is set and the run was not interrupted.
    pub result: RunResult,
    /// The true poses in the log, in its frame.
    pub truth: Vec<StampedPose>,
    /// Statistics of the reader.
    pub stats: LogStats,
    /// Counts of readings, points and steps.
    pub counts: Counts,
    /// Readings of the log before the first pose of the result.
    pub skipped: usize,
    /// Why the run ended.
    pub end: End,
    /// Run time of the filter \[s\].
    pub filter_seconds: f64,
    /// Run time of smoothing \[s\].
    pub smoothing_seconds: f64,
    /// Why smoothing failed, if it did.
    pub smoothing: Result<(), LogError>,
    /// Why the CPU took over from the device.
    pub evaluator_failure: Option<String>,
}

/// Why a run ended.
#[derive(Debug)]
#[non_exhaustive]
pub enum End {
    /// The log is over.
    Log,
    /// The maximum number of scans was reached.
    MaxScans,
    /// The caller interrupted it.
    Interrupted,
    /// The log cannot be read any further.
    BrokeOff(LogError),
}

/// Progress of a run.
#[non_exhaustive]
pub enum Progress<'a> {
    /// The estimator has taken in another entry.
    Entry {
        /// Bytes of the log that were read, and its size in bytes; `None` if the source is no file.
        bytes: Option<(u64, u64)>,
        /// The counts so far.
        counts: &'a Counts,
    },
    /// The result is smoothed; the share that is done, 0 to 1.
    Smoothing(f64),
}

impl<'a> Run<'a> {
    /// A run of a whole log, without smoothing.
    pub fn of(source: &'a dyn LogSource) -> Self {
        Self { source, skip: 0.0, max_scans: None, smoothing: None }
    }

    /// Runs the estimator over the log. `goes_on` is called after each entry; if it returns false, the run ends with the result so
    /// far, unsmoothed. During smoothing it is called with the progress only, and what it returns is ignored.
    ///
    /// # Errors
    /// The log cannot be opened. Where reading breaks off later, [`Outcome::end`] holds the error, and the result so far is kept.
    pub fn run(
        &self,
        estimator: &mut dyn Estimator,
        observers: &mut [Box<dyn Observer + '_>],
        goes_on: &mut dyn FnMut(Progress<'_>) -> bool,
    ) -> Result<Outcome, LogError> {
        let began = Instant::now();
        let mut reader = self.source.open()?;
        let (mut counts, mut truth, mut skipped) = (Counts::default(), Vec::new(), 0);
        let mut first_stamp = None;
        let end = loop {
            if self.max_scans == Some(counts.scans) {
                break End::MaxScans;
            }
            let entry = match reader.next() {
                None => break End::Log,
                Some(Err(error)) => break End::BrokeOff(error),
                Some(Ok(entry)) => entry,
            };
            let stamp = entry.stamp();
            if let LogEntry::Truth { world_from_robot, .. } = entry {
                truth.push(StampedPose { stamp, pose: world_from_robot });
            } else if counts.readings == 0 && stamp - *first_stamp.get_or_insert(stamp) < self.skip {
                skipped += 1;
                continue;
            }
            let mut observe = |event: &Event<'_>| {
                counts.add(event);
                observers.iter_mut().for_each(|observer| observer.on_event(event));
            };
            observe(&Event::Entry(&entry));
            estimator.add(&entry, &mut observe);
            if !goes_on(Progress::Entry { bytes: reader.progress(), counts: &counts }) {
                break End::Interrupted;
            }
        };
        let filter_seconds = began.elapsed().as_secs_f64();
        let mut result = estimator.result();
        let began = Instant::now();
        let smoothing = self.smoothing.filter(|_| !matches!(end, End::Interrupted));
        let smoothed = smoothing.map_or(Ok(()), |smoother| {
            smoother.smooth(self.source, &mut result, &mut |share| _ = goes_on(Progress::Smoothing(share)))
        });
        if let Some(objects) = result.objects.as_mut().filter(|_| smoothing.is_some()) {
            objects.landmarks = estimator.landmarks(&result.poses);
        }
        let smoothing_seconds = began.elapsed().as_secs_f64();
        let finished = Event::Finished { result: &result, is_smoothed: smoothing.is_some() && smoothed.is_ok() };
        observers.iter_mut().for_each(|observer| observer.on_event(&finished));
        Ok(Outcome {
            result,
            truth,
            stats: reader.stats().clone(),
            counts,
            skipped,
            end,
            filter_seconds,
            smoothing_seconds,
            smoothing: smoothed,
            evaluator_failure: estimator.evaluator_failure().map(ToString::to_string),
        })
    }
}

/// Maps a whole log on the CPU, as `ipslam run` does it.
///
/// # Errors
/// The log cannot be read to its end.
pub fn map(source: &dyn LogSource, config: &SlamConfig) -> Result<RunResult, LogError> {
    let run = Run { smoothing: Some(config.smoother()), ..Run::of(source) };
    let Outcome { result, end, smoothing, .. } = run.run(&mut Slam::new(*config), &mut [], &mut |_| true)?;
    match end {
        End::BrokeOff(error) => Err(error),
        _ => smoothing.map(|()| result),
    }
}

/// Counts of a run.
#[derive(Clone, Debug, Default)]
pub struct Counts {
    /// Odometry and laser readings.
    pub readings: u64,
    /// Laser readings.
    pub scans: u64,
    /// Of these, those without a point.
    pub empty_scans: u64,
    /// Points of all scans.
    pub points: u64,
    /// Beams without return.
    pub no_return: u64,
    /// Beams whose range is no measurement.
    pub invalid: u64,
    /// Steps of the filter.
    pub steps: u64,
    /// Steps that resampled.
    pub resamplings: u64,
    /// Clusters of the map at the last step.
    pub clusters: usize,
    /// Effective sample size: sum over the steps, smallest, and that of the last step.
    pub effective_sum: f64,
    /// Smallest effective sample size.
    pub effective_worst: f64,
    /// Effective sample size of the last step.
    pub effective_last: f64,
    /// Particles of each step.
    pub particles: Vec<usize>,
    /// Seconds of all steps by stage.
    pub times: StageTimes,
    /// Seconds of the first step, all stages.
    pub first_step_seconds: f64,
    /// Whether the robot is located at the last reading, in a known map.
    pub is_located: bool,
    /// The first stamp and the largest one.
    first_and_latest_stamp: Option<(f64, f64)>,
}

impl Counts {
    fn add(&mut self, event: &Event<'_>) {
        match event {
            Event::Entry(entry) => {
                self.readings += u64::from(entry.is_reading());
                self.add_stamp(entry.stamp());
            }
            Event::Scan(scan) => {
                self.scans += 1;
                self.empty_scans += u64::from(scan.points.is_empty());
                self.points += scan.points.len() as u64;
                self.no_return += scan.no_return as u64;
                self.invalid += scan.invalid as u64;
            }
            Event::Step(report) => self.add_step(report),
            Event::Pose(estimate) => self.is_located = estimate.relied_on().is_some(),
            Event::Finished { .. } => {}
        }
    }

    fn add_stamp(&mut self, stamp: f64) {
        let (first, latest) = self.first_and_latest_stamp.unwrap_or((stamp, stamp));
        self.first_and_latest_stamp = Some((first, latest.max(stamp)));
    }

    fn add_step(&mut self, report: &StepReport<'_>) {
        let effective = report.effective_sample_size;
        self.effective_worst = if self.steps == 0 { effective } else { self.effective_worst.min(effective) };
        self.effective_sum += effective;
        self.effective_last = effective;
        if self.steps == 0 {
            self.first_step_seconds = report.times.seconds().iter().sum();
        }
        self.steps += 1;
        self.resamplings += u64::from(report.resampled);
        self.clusters = report.map.len();
        self.particles.push(report.particles.len());
        self.times += report.times;
    }

    /// Time from the first entry to the latest \[s\].
    pub fn log_seconds(&self) -> f64 {
        self.first_and_latest_stamp.map_or(0.0, |(first, latest)| latest - first)
    }
}
