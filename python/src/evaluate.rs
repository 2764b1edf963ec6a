//! Functions without a state: clusters of points, errors of trajectories.

use crate::arrays::{Rows, of_clusters, rows, toml, trajectory};
use crate::errors::{config as config_error, log as log_error, value};
use ipslam::clustering::cluster_points;
use ipslam::config::SlamConfig;
use ipslam::geometry::StampedPose;
use ipslam::io::{relations as relations_file, tum};
use ipslam::metrics::relations::relation_errors;
use ipslam::metrics::trajectory::reference_errors;
use ipslam::metrics::{ErrorStats, PoseErrors};
use nalgebra::Point2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Cluster the points of a scan, shape (N, 2), into lines; returns a structured array as `Map.clusters`.
#[pyfunction]
#[pyo3(signature = (points, config=None))]
pub fn cluster<'py>(
    py: Python<'py>,
    points: Rows<'py>,
    config: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let points: Vec<Point2<f64>> =
        rows("points", &points, 2)?.into_iter().map(|row| Point2::new(row[0], row[1])).collect();
    let config = SlamConfig::default().with_toml(&toml(config)?).map_err(|error| config_error(&error))?;
    config.validate().map_err(|error| config_error(&error))?;
    let clusters = py.detach(|| cluster_points(&points, &config.clustering).clusters);
    of_clusters(py, &clusters)
}

/// Poses in an array, or in a file.
#[derive(FromPyObject)]
pub enum Trajectory<'py> {
    File(PathBuf),
    Array(Rows<'py>),
}

impl Trajectory<'_> {
    fn read(&self, name: &str) -> PyResult<Vec<StampedPose>> {
        match self {
            Self::File(path) => tum::read(path).map_err(|error| log_error(&error)),
            Self::Array(array) => trajectory(name, array),
        }
    }
}

/// Score a trajectory, rows of t, x, y, heading or a file, against reference poses, relations, or both; in metres and radians.
#[pyfunction]
#[pyo3(signature = (trajectory, *, reference=None, relations=None))]
pub fn evaluate<'py>(
    py: Python<'py>,
    trajectory: Trajectory<'py>,
    reference: Option<Trajectory<'py>>,
    relations: Option<PathBuf>,
) -> PyResult<Bound<'py, PyDict>> {
    if reference.is_none() && relations.is_none() {
        return Err(value("reference or relations has to be given: there is nothing to compare with"));
    }
    let trajectory = trajectory.read("trajectory")?;
    let scores = PyDict::new(py);
    if let Some(reference) = reference {
        let reference = reference.read("reference")?;
        let errors = reference_errors(&reference, &trajectory);
        if errors.absolute.is_none() {
            return Err(value("reference: none of its stamps finds a pose of trajectory; are both of one clock?"));
        }
        scores.set_item("poses", errors.reference_poses)?;
        scores.set_item("unmatched", errors.unmatched)?;
        scores.set_item("ate", stats(py, errors.absolute)?)?;
        scores.set_item("rpe_1_s", pose_errors(py, errors.relative_in_time)?)?;
        scores.set_item("rpe_10_m", pose_errors(py, errors.relative_in_path)?)?;
    }
    if let Some(path) = relations {
        let relations = relations_file::read(&path).map_err(|error| log_error(&error))?;
        let errors = relation_errors(&relations, &trajectory);
        if errors.all.is_none() {
            return Err(value("relations: none of their stamps finds a pose of trajectory; are both of one clock?"));
        }
        scores.set_item("relations", errors.relations)?;
        scores.set_item("unmatched_relations", errors.unmatched)?;
        scores.set_item("all", pose_errors(py, errors.all)?)?;
        scores.set_item("local", pose_errors(py, errors.local)?)?;
        scores.set_item("loop", pose_errors(py, errors.loop_closing)?)?;
    }
    Ok(scores)
}

fn stats(py: Python<'_>, stats: Option<ErrorStats>) -> PyResult<Option<Bound<'_, PyDict>>> {
    let Some(ErrorStats { count, mean, std, rmse, median, max }) = stats else { return Ok(None) };
    let found = PyDict::new(py);
    found.set_item("count", count)?;
    for (name, number) in [("mean", mean), ("std", std), ("rmse", rmse), ("median", median), ("max", max)] {
        found.set_item(name, number)?;
    }
    Ok(Some(found))
}

fn pose_errors(py: Python<'_>, errors: Option<PoseErrors>) -> PyResult<Option<Bound<'_, PyDict>>> {
    let Some(PoseErrors { translation, rotation }) = errors else { return Ok(None) };
    let found = PyDict::new(py);
    found.set_item("translation", stats(py, Some(translation))?)?;
    found.set_item("rotation", stats(py, Some(rotation))?)?;
    Ok(Some(found))
}
