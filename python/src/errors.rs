//! Errors of the library as exceptions that name Python's arguments.

use ipslam::config::ConfigError;
use ipslam::log::LogError;
use pyo3::PyErr;
use pyo3::exceptions::{PyFileNotFoundError, PyOSError, PyValueError};
use std::io::ErrorKind;

/// The text of an error, with the program's options by the names that they have here.
fn in_python(text: &str) -> String {
    let mut text = text.to_owned();
    while let Some((before, after)) = text.split_once(" (option --")
        && let Some((_, after)) = after.split_once(')')
    {
        text = format!("{before}{after}");
    }
    text.replace("--scan-topic", "scan_topic").replace("--odom-topic", "odom_topic").replace("--imu", "imu")
}

/// A value that cannot be.
pub fn value(text: impl AsRef<str>) -> PyErr {
    PyValueError::new_err(in_python(text.as_ref()))
}

pub fn config(error: &ConfigError) -> PyErr {
    value(format!("config: {error}"))
}

pub fn log(error: &LogError) -> PyErr {
    let text = in_python(&error.to_string());
    match error {
        LogError::Open { source, .. } if source.kind() == ErrorKind::NotFound => PyFileNotFoundError::new_err(text),
        LogError::Open { .. } | LogError::Read { .. } => PyOSError::new_err(text),
        _ => PyValueError::new_err(text),
    }
}
