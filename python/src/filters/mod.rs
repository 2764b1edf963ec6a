//! Filters that take readings as they come.

use crate::arrays::{Vector, pose};
use crate::errors::{log as log_error, value};
use crate::log::Log;
use ipslam::geometry::Pose;
use ipslam::grid::{FreeArea, GridBuilder, RESOLUTION};
use ipslam::log::{LaserReading, LogEntry, LogError, LogReader, LogSource, LogStats};
use ipslam::report::{Estimator, Event, RunResult};
use ipslam::scan::{Scan, ScanConfig};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};
use step::Step;

pub mod localization;
pub mod result;
pub mod slam;
pub mod step;

/// A filter, and all that it was given: smoothing and the free area need it again.
pub struct Filter<E> {
    pub estimator: E,
    pub entries: Arc<Vec<LogEntry>>,
}

impl<E: Estimator> Filter<E> {
    pub fn new(estimator: E) -> Self {
        Self { estimator, entries: Arc::default() }
    }

    /// Takes in a reading, and tells what followed from it.
    pub fn add(&mut self, entry: LogEntry) -> Step {
        let mut step = Step::default();
        self.estimator.add(&entry, &mut |event| match event {
            Event::Step(report) => step.take(report),
            Event::Pose(estimate) => step.estimate = Some(**estimate),
            _ => {}
        });
        Arc::make_mut(&mut self.entries).push(entry);
        step
    }

    /// Takes in a whole log; Ctrl-C ends it.
    pub fn add_log(&mut self, log: &Log) -> PyResult<()> {
        for (number, entry) in log.0.open().map_err(|error| log_error(&error))?.enumerate() {
            self.add(entry.map_err(|error| log_error(&error))?);
            if number % 64 == 0 {
                Python::attach(|py| py.check_signals())?;
            }
        }
        Ok(())
    }
}

/// A filter that threads of Python share.
pub struct Shared<E>(Mutex<Filter<E>>);

impl<E: Estimator> Shared<E> {
    pub fn new(estimator: E) -> Self {
        Self(Mutex::new(Filter::new(estimator)))
    }

    /// Works on the filter while other threads of Python go on.
    pub fn work<T: Send>(&self, py: Python<'_>, work: impl Send + FnOnce(&mut Filter<E>) -> T) -> T
    where
        E: Send,
    {
        py.detach(|| work(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner)))
    }
}

/// What Python tells of a sweep.
pub struct Sweep<'py> {
    pub stamp: f64,
    pub ranges: Vector<'py>,
    pub angle_min: f64,
    pub angle_increment: f64,
    pub odom: [f64; 3],
    pub range_max: f64,
    pub laser: [f64; 3],
}

impl Sweep<'_> {
    pub fn entry(&self) -> PyResult<LogEntry> {
        let ranges = self.ranges.as_array().to_vec();
        let Self { stamp, angle_min, angle_increment, range_max, .. } = *self;
        if ranges.is_empty() {
            return Err(value("ranges is empty, but a sweep has a range for each beam"));
        }
        for (name, number) in [("stamp", stamp), ("angle_min", angle_min), ("angle_increment", angle_increment)] {
            if !number.is_finite() {
                return Err(value(format!("{name} is {number}, but has to be finite")));
            }
        }
        if angle_increment == 0.0 && ranges.len() > 1 {
            return Err(value("angle_increment is 0: every beam would look the same way"));
        }
        if range_max.is_nan() || range_max <= 0.0 {
            return Err(value(format!("range_max is {range_max}, but has to be above 0")));
        }
        Ok(LogEntry::Laser(LaserReading {
            stamp,
            // Odometry that is no number is the filter's to bridge.
            odom_from_robot: Pose::new(self.odom[0], self.odom[1], self.odom[2]),
            robot_from_laser: pose("laser", self.laser)?,
            start_from_end: Pose::IDENTITY,
            first_angle: angle_min,
            angle_step: angle_increment,
            max_range: range_max,
            ranges,
        }))
    }
}

pub fn odometry(stamp: f64, odom: [f64; 3]) -> PyResult<LogEntry> {
    if !stamp.is_finite() {
        return Err(value(format!("stamp is {stamp}, but has to be finite")));
    }
    Ok(LogEntry::Odometry { stamp, odom_from_robot: Pose::new(odom[0], odom[1], odom[2]) })
}

/// The area that the scans saw to be free.
pub fn free_area(entries: &[LogEntry], result: &RunResult, config: &ScanConfig) -> Option<FreeArea> {
    let mut builder = GridBuilder::new(RESOLUTION);
    let readings = entries.iter().filter(|entry| entry.is_reading());
    for (entry, estimate) in readings.zip(&result.poses) {
        if let (LogEntry::Laser(reading), Some(pose)) = (entry, estimate.relied_on()) {
            builder.add_scan(&Scan::from_reading(reading, config), reading.robot_from_laser, pose);
        }
    }
    let grid = builder.finish().ok()?;
    FreeArea::from_grid(&grid, result.relied_on().map(|(_, pose)| pose.position()))
}

/// Readings in memory, as a log.
pub struct Readings(pub Arc<Vec<LogEntry>>);

impl LogSource for Readings {
    fn name(&self) -> String {
        "readings".to_owned()
    }

    fn open(&self) -> Result<Box<dyn LogReader>, LogError> {
        Ok(Box::new(Reader { entries: Arc::clone(&self.0), next: 0, stats: LogStats::default() }))
    }
}

struct Reader {
    entries: Arc<Vec<LogEntry>>,
    next: usize,
    stats: LogStats,
}

impl Iterator for Reader {
    type Item = Result<LogEntry, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        let entry = self.entries.get(self.next)?;
        self.next += 1;
        Some(Ok(entry.clone()))
    }
}

impl LogReader for Reader {
    fn stats(&self) -> &LogStats {
        &self.stats
    }

    fn progress(&self) -> Option<(u64, u64)> {
        None
    }
}
