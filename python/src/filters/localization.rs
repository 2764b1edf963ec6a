//! Finding the robot in a map.

use super::{Shared, Sweep, odometry, result, step};
use crate::arrays::{Vector, pose, toml};
use crate::errors::{config as config_error, value};
use crate::log::Log;
use crate::map::Map;
use ipslam::localization::{InitialPose, LocalizationConfig};
use ipslam::report::Estimator as _;
use pyo3::prelude::*;

/// The filter that finds the robot.
#[pyclass(frozen, module = "ipslam")]
pub struct Localization(Shared<ipslam::localization::Localization>);

#[pymethods]
impl Localization {
    #[new]
    #[pyo3(signature = (map, *, start=None, start_spread=[0.5, 0.26], config=None))]
    fn new(
        py: Python<'_>,
        map: &Map,
        start: Option<[f64; 3]>,
        start_spread: [f64; 2],
        config: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let config = LocalizationConfig::default().with_toml(&toml(config)?).map_err(|error| config_error(&error))?;
        config.validate().map_err(|error| config_error(&error))?;
        let [position_sigma, heading_sigma] = start_spread;
        if !(position_sigma >= 0.0 && heading_sigma >= 0.0) {
            return Err(value(format!("start_spread is {start_spread:?}, but neither can be below 0")));
        }
        let start = start.map(|start| pose("start", start)).transpose()?;
        let initial = start.map(|world_from_robot| InitialPose { world_from_robot, position_sigma, heading_sigma });
        let line_map = map.0.clone();
        let filter = py
            .detach(|| ipslam::localization::Localization::new(line_map, initial, config, None))
            .map_err(|error| value(format!("map: {error}")))?;
        Ok(Self(Shared::new(filter)))
    }

    /// Take in a sweep: ranges of shape (N,), angles in radians, poses as (x, y, heading). Returns what followed from it.
    #[expect(clippy::too_many_arguments, reason = "those of Python")]
    #[pyo3(signature = (stamp, ranges, angle_min, angle_increment, odom, *, range_max=f64::INFINITY, laser=[0.0; 3]))]
    fn add(
        &self,
        py: Python<'_>,
        stamp: f64,
        ranges: Vector<'_>,
        angle_min: f64,
        angle_increment: f64,
        odom: [f64; 3],
        range_max: f64,
        laser: [f64; 3],
    ) -> PyResult<step::Step> {
        let entry = Sweep { stamp, ranges, angle_min, angle_increment, odom, range_max, laser }.entry()?;
        Ok(self.0.work(py, |filter| filter.add(entry)))
    }

    /// Take in odometry between sweeps; it can be left out.
    fn add_odometry(&self, py: Python<'_>, stamp: f64, odom: [f64; 3]) -> PyResult<step::Step> {
        let entry = odometry(stamp, odom)?;
        Ok(self.0.work(py, |filter| filter.add(entry)))
    }

    /// Take in a whole log.
    fn add_log(&self, py: Python<'_>, log: &Log) -> PyResult<()> {
        self.0.work(py, |filter| filter.add_log(log))
    }

    /// What was found so far, with the map that is known. More readings may follow.
    fn finish(&self, py: Python<'_>) -> PyResult<result::Result> {
        let found = self.0.work(py, |filter| filter.estimator.result());
        result::Result::new(py, found)
    }
}
