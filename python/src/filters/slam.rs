//! Mapping.

use super::{Readings, Shared, Sweep, free_area, odometry, result, step};
use crate::arrays::{Vector, toml};
use crate::errors::{config as config_error, log as log_error};
use crate::log::Log;
use ipslam::config::SlamConfig;
use ipslam::report::Estimator as _;
use pyo3::prelude::*;
use std::sync::Arc;

/// The filter that makes a map.
#[pyclass(frozen, module = "ipslam")]
pub struct Slam {
    config: SlamConfig,
    filter: Shared<ipslam::slam::Slam>,
}

#[pymethods]
impl Slam {
    #[new]
    #[pyo3(signature = (config=None, *, maps=None, particles=None, seed=None))]
    fn new(
        config: Option<&Bound<'_, PyAny>>,
        maps: Option<usize>,
        particles: Option<usize>,
        seed: Option<u64>,
    ) -> PyResult<Self> {
        let mut config = SlamConfig::default().with_toml(&toml(config)?).map_err(|error| config_error(&error))?;
        config.particles = particles.or(maps.map(|maps| maps.max(1))).unwrap_or(config.particles);
        config.maps = maps.unwrap_or(config.maps);
        config.seed = seed.unwrap_or(config.seed);
        config.validate().map_err(|error| config_error(&error))?;
        Ok(Self { config, filter: Shared::new(ipslam::slam::Slam::new(config)) })
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
        Ok(self.filter.work(py, |filter| filter.add(entry)))
    }

    /// Take in odometry between sweeps; it can be left out.
    fn add_odometry(&self, py: Python<'_>, stamp: f64, odom: [f64; 3]) -> PyResult<step::Step> {
        let entry = odometry(stamp, odom)?;
        Ok(self.filter.work(py, |filter| filter.add(entry)))
    }

    /// Take in a whole log.
    fn add_log(&self, py: Python<'_>, log: &Log) -> PyResult<()> {
        self.filter.work(py, |filter| filter.add_log(log))
    }

    /// Smooth what was found so far: every scan and the map are fitted to each other. More readings may follow.
    fn finish(&self, py: Python<'_>) -> PyResult<result::Result> {
        let smoothed = self.filter.work(py, |filter| {
            let mut result = filter.estimator.result();
            let readings = Readings(Arc::clone(&filter.entries));
            self.config.smoother().smooth(&readings, &mut result, &mut |_| {})?;
            result.map.free = free_area(&filter.entries, &result, &self.config.scan);
            Ok(result)
        });
        result::Result::new(py, smoothed.map_err(|error| log_error(&error))?)
    }
}
