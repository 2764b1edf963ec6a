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

    /// Pose of the robot in the world, shape (3,); None before the first scan.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.estimate?.world_from_robot.map(|pose| of_pose(py, pose))
    }

    /// Covariance of (x, y, heading), shape (3, 3): how well the pose is known in the map around the robot.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let covariance = self.estimate.and_then(|estimate| estimate.covariance);
        covariance.map(|matrix| PyArray1::from_slice(py, matrix.as_slice()).reshape([3, 3])).transpose()
    }

    /// Whether the pose can be relied on: in a known map, whether the robot is located.
    #[getter]
    fn relied_on(&self) -> bool {
        self.estimate.is_some_and(|estimate| estimate.relied_on().is_some())
    }

    /// 1 to the number of particles; None where the reading made no step of the filter.
    #[getter]
    fn effective_sample_size(&self) -> Option<f64> {
        self.filter.as_ref().map(|filter| filter.0)
    }

    /// x, y, heading and weight of each particle, shape (M, 4); None where the reading made no step of the filter.
    #[getter]
    fn particles<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.filter.as_ref().map(|filter| of_rows(py, &filter.1)).transpose()
    }
}
