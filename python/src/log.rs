//! Logs and their readings.

use crate::arrays::of_pose;
use crate::errors::log as log_error;
use ipslam::io::carmen::CarmenLog;
use ipslam::io::mcap::{ImuTopic, Topics};
use ipslam::io::open_log;
use ipslam::log::{LaserReading, LogEntry, LogReader, LogSource};
use numpy::PyArray1;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// A log that can be read from its start any number of times.
#[pyclass(frozen, module = "ipslam")]
pub struct Log(pub Box<dyn LogSource>);

/// One topic, or one of each laser.
#[derive(FromPyObject)]
pub enum ScanTopics {
    One(String),
    Several(Vec<String>),
}

impl ScanTopics {
    fn into_names(self) -> Vec<String> {
        match self {
            Self::One(name) => vec![name],
            Self::Several(names) => names,
        }
    }
}

/// Open a log: a CARMEN log, plain or gzip, or a ROS bag (its file or folder). `fov` is in radians.
#[pyfunction]
#[pyo3(signature = (path, *, scan_topic=None, odom_topic=None, imu=None, fov=None))]
pub fn read_log(
    py: Python<'_>,
    path: PathBuf,
    scan_topic: Option<ScanTopics>,
    odom_topic: Option<String>,
    imu: Option<String>,
    fov: Option<f64>,
) -> PyResult<Log> {
    let imu = imu.as_deref().map_or(ImuTopic::Any, ImuTopic::named);
    let topics = Topics { scan: scan_topic.map_or_else(Vec::new, ScanTopics::into_names), odometry: odom_topic, imu };
    let open = || -> Result<Box<dyn LogSource>, ipslam::log::LogError> {
        let source: Box<dyn LogSource> = match fov {
            Some(radians) => Box::new(CarmenLog::new(path).with_field_of_view(radians)),
            None => open_log(path, &topics)?,
        };
        // What cannot be read is told here and not at the first reading.
        source.open()?;
        Ok(source)
    };
    py.detach(open).map(Log).map_err(|error| log_error(&error))
}

#[pymethods]
impl Log {
    #[getter]
    fn name(&self) -> String {
        self.0.name()
    }

    fn __iter__(&self, py: Python<'_>) -> PyResult<Readings> {
        let reader = py.detach(|| self.0.open()).map_err(|error| log_error(&error))?;
        Ok(Readings(Mutex::new(reader)))
    }

    fn __repr__(&self) -> String {
        format!("<ipslam.Log {}>", self.0.name())
    }
}

/// What is left of a log.
#[pyclass(frozen, module = "ipslam")]
pub struct Readings(Mutex<Box<dyn LogReader>>);

#[pymethods]
impl Readings {
    fn __iter__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        loop {
            let next = py.detach(|| self.0.lock().unwrap_or_else(PoisonError::into_inner).next());
            return Ok(match next.transpose().map_err(|error| log_error(&error))? {
                None => None,
                Some(LogEntry::Turn { .. } | LogEntry::Truth { .. }) => continue,
                Some(LogEntry::Odometry { stamp, odom_from_robot }) => {
                    Some(Odometry { stamp, odom: odom_from_robot }.into_pyobject(py)?.into_any().unbind())
                }
                Some(LogEntry::Laser(reading)) => Some(Scan(reading).into_pyobject(py)?.into_any().unbind()),
            });
        }
    }
}

/// Where odometry believes the robot to be.
#[pyclass(frozen, module = "ipslam")]
pub struct Odometry {
    #[pyo3(get)]
    stamp: f64,
    odom: ipslam::geometry::Pose,
}

#[pymethods]
impl Odometry {
    #[getter]
    fn odom<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        of_pose(py, self.odom)
    }
}

/// One sweep of the laser.
#[pyclass(frozen, module = "ipslam")]
pub struct Scan(LaserReading);

#[pymethods]
impl Scan {
    #[getter]
    fn stamp(&self) -> f64 {
        self.0.stamp
    }

    #[getter]
    fn ranges<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.ranges)
    }

    #[getter]
    fn angle_min(&self) -> f64 {
        self.0.first_angle
    }

    #[getter]
    fn angle_increment(&self) -> f64 {
        self.0.angle_step
    }

    #[getter]
    fn range_max(&self) -> f64 {
        self.0.max_range
    }

    #[getter]
    fn odom<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        of_pose(py, self.0.odom_from_robot)
    }

    #[getter]
    fn laser<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        of_pose(py, self.0.robot_from_laser)
    }
}
