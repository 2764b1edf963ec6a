//! What a filter found.

use crate::arrays::{of_matrices, of_rows, of_trajectory};
use crate::map::Map;
use ipslam::report::RunResult;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;

/// Trajectory, poses with covariance, and map.
#[pyclass(frozen, module = "ipslam")]
pub struct Result {
    result: RunResult,
    #[pyo3(get)]
    map: Py<Map>,
}

impl Result {
    pub fn new(py: Python<'_>, result: RunResult) -> PyResult<Self> {
        let map = Py::new(py, Map(result.map.clone()))?;
        Ok(Self { result, map })
    }
}

#[pymethods]
impl Result {
    /// t, x, y, heading at every reading that can be relied on, shape (N, 4).
    #[getter]
    fn trajectory<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        of_trajectory(py, &self.result.trajectory())
    }

    /// t, x, y, heading at every reading; nan where there is no pose yet.
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let row = |estimate: &ipslam::report::Estimate| {
            let pose = estimate.world_from_robot.map_or([f64::NAN; 3], |pose| [pose.x, pose.y, pose.heading]);
            [estimate.stamp, pose[0], pose[1], pose[2]]
        };
        of_rows(py, &self.result.poses.iter().map(row).collect::<Vec<_>>())
    }

    /// Covariances of (x, y, heading) of `poses`, shape (N, 3, 3).
    #[getter]
    fn covariances<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let matrix = |estimate: &ipslam::report::Estimate| {
            let mut numbers = [f64::NAN; 9];
            if let Some(covariance) = estimate.covariance {
                numbers.copy_from_slice(covariance.as_slice());
            }
            numbers
        };
        of_matrices(py, &self.result.poses.iter().map(matrix).collect::<Vec<_>>())
    }

    /// Whether each of `poses` can be relied on.
    #[getter]
    fn relied_on<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        let relied_on: Vec<bool> = self.result.poses.iter().map(|estimate| estimate.relied_on().is_some()).collect();
        PyArray1::from_vec(py, relied_on)
    }
}
