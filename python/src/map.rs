//! Maps: clusters, and where a robot can be.

use crate::arrays::of_clusters;
use crate::errors::value;
use ipslam::clustering::ClusteringConfig;
use ipslam::grid::FreeArea;
use ipslam::io::{map_json, map_server, write_whole};
use ipslam::map::{LineMap, clusters_of_grid};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use std::path::PathBuf;

/// A map of line clusters.
#[pyclass(frozen, module = "ipslam")]
pub struct Map(pub LineMap);

#[pymethods]
impl Map {
    /// Read map.json, or the YAML file of an occupancy grid (ROS map_server).
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| match path.extension().and_then(|ending| ending.to_str()) {
            Some("json") => map_json::read_map(&path).map_err(|error| error.to_string()),
            Some("yaml" | "yml") => {
                let read = map_server::read(&path).map_err(|error| error.to_string())?;
                let clusters = clusters_of_grid(&read.grid, &ClusteringConfig::default());
                Ok(LineMap { clusters, free: FreeArea::from_grid(&read.grid, []) })
            }
            _ => Err(format!("{}: a map is a .json file, or a .yaml file of ROS map_server", path.display())),
        })
        .map(Self)
        .map_err(value)
    }

    /// Write map.json.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| write_whole(&path, |file| map_json::write_map(&self.0, file)))
            .map_err(|error| PyOSError::new_err(error.to_string()))
    }

    /// Structured array of mean (2), direction (2), std_along, std_across and count.
    #[getter]
    fn clusters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        of_clusters(py, &self.0.clusters)
    }

    /// Square metres where a robot can be; 0 where the map does not tell.
    #[getter]
    fn free_area(&self) -> f64 {
        self.0.free.as_ref().map_or(0.0, FreeArea::area)
    }

    fn __len__(&self) -> usize {
        self.0.clusters.len()
    }

    fn __repr__(&self) -> String {
        format!("<ipslam.Map of {} clusters, {:.0} m² free>", self.0.clusters.len(), self.free_area())
    }
}
