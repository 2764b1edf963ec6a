//! What followed from one reading.

use crate::arrays::{of_pose, of_rows};
use ipslam::report::{Estimate, StepReport};
use numpy::{PyArray1, PyArray2, PyArrayMethods as _};
use pyo3::prelude::*;

/// What a filter made of one reading.
#[pyclass(frozen, module = "ipslam")]
#[derive(Default)]
pub struct Step {
    pub estimate: Option<Estimate>,
    /// Effective sample size and particles, where the reading made a step of the filter.
    filter: Option<(f64, Vec<[f64; 4]>)>,
}

impl Step {
    pub fn take(&mut self, report: &StepReport<'_>) {
        let row = |particle: &ipslam::report::ReportedParticle| {
            let pose = particle.world_from_robot;
            [pose.x, pose.y, pose.heading, particle.weight]
        };
        self.filter = Some((report.effective_sample_size, report.particles.iter().map(row).collect()));
    }
}

#[pymethods]
impl Step {
    #[getter]
    fn stamp(&self) -> Option<f64> {
        self.estimate.map(|estimate| estimate.stamp)
    }

    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.estimate?.world_from_robot.map(|pose| of_pose(py, pose))
    }

    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let covariance = self.estimate.and_then(|estimate| estimate.covariance);
        covariance.map(|matrix| PyArray1::from_slice(py, matrix.as_slice()).reshape([3, 3])).transpose()
    }

    #[getter]
    fn relied_on(&self) -> bool {
        self.estimate.is_some_and(|estimate| estimate.relied_on().is_some())
    }

    #[getter]
    fn effective_sample_size(&self) -> Option<f64> {
        self.filter.as_ref().map(|filter| filter.0)
    }

    #[getter]
    fn particles<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.filter.as_ref().map(|filter| of_rows(py, &filter.1)).transpose()
    }
}
