//! The command line.

use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ffi::OsString;
use std::path::PathBuf;

/// The script `ipslam`: runs the words of `sys.argv` and returns the exit code.
#[pyfunction]
#[pyo3(name = "_main")]
pub fn main(py: Python<'_>) -> PyResult<u8> {
    let words: Vec<OsString> = py.import("sys")?.getattr("argv")?.extract()?;
    Ok(py.detach(|| ipslam::cli::main(words)))
}

/// Map a log with all the files of `ipslam run LOG --out OUT`; `maps=64` is its option `--maps 64`,
/// `force=True` its option `--force`. Returns the summary.
#[pyfunction]
#[pyo3(signature = (log, out, **options))]
pub fn run<'py>(
    py: Python<'py>,
    log: PathBuf,
    out: PathBuf,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let mut words: Vec<OsString> = ["ipslam", "run"].map(OsString::from).into();
    words.extend([log.into(), "--out".into(), out.clone().into()]);
    for (name, value) in options.into_iter().flatten() {
        let name: String = name.extract()?;
        let option = format!("--{}", name.replace('_', "-"));
        match value.extract::<bool>() {
            Ok(is_set) => words.extend(is_set.then(|| option.into())),
            Err(_) => words.extend([option.into(), value.str()?.to_string().into()]),
        }
    }
    py.detach(|| ipslam::cli::call(words)).map_err(|error| match &*error {
        "interrupted" => PyKeyboardInterrupt::new_err(()),
        _ => PyRuntimeError::new_err(error),
    })?;
    let text = std::fs::read_to_string(out.join("summary.json"))?;
    py.import("json")?.call_method1("loads", (text,))
}
