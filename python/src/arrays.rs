//! Between numpy arrays and the library's types.

use crate::errors::value;
use ipslam::geometry::{Pose, StampedPose};
use ipslam::ppca::Cluster;
use numpy::{AllowTypeChange, PyArray1, PyArray2, PyArray3, PyArrayLike1, PyArrayLike2, PyArrayMethods as _};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// One dimension, anything that numpy can make numbers of.
pub type Vector<'py> = PyArrayLike1<'py, f64, AllowTypeChange>;
/// Two dimensions.
pub type Rows<'py> = PyArrayLike2<'py, f64, AllowTypeChange>;

/// `(x, y, heading)`, all finite.
pub fn pose(name: &str, [x, y, heading]: [f64; 3]) -> PyResult<Pose> {
    let pose = Pose::new(x, y, heading);
    if pose.is_finite() {
        Ok(pose)
    } else {
        Err(value(format!("{name} is {:?}, but has to be finite", [x, y, heading])))
    }
}

pub fn of_pose(py: Python<'_>, Pose { x, y, heading }: Pose) -> Bound<'_, PyArray1<f64>> {
    PyArray1::from_slice(py, &[x, y, heading])
}

/// Rows of as many numbers each.
pub fn of_rows<'py, const N: usize>(py: Python<'py>, rows: &[[f64; N]]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), N])
}

/// Square matrices, one after the other.
pub fn of_matrices<'py>(py: Python<'py>, matrices: &[[f64; 9]]) -> PyResult<Bound<'py, PyArray3<f64>>> {
    PyArray1::from_slice(py, matrices.as_flattened()).reshape([matrices.len(), 3, 3])
}

/// Rows of `columns` numbers each, all finite.
pub fn rows(name: &str, array: &Rows<'_>, columns: usize) -> PyResult<Vec<Vec<f64>>> {
    let view = array.as_array();
    if view.ncols() != columns {
        return Err(value(format!("{name} has {} columns, but {columns} are needed", view.ncols())));
    }
    if let Some(place) = view.rows().into_iter().position(|row| row.iter().any(|number| !number.is_finite())) {
        return Err(value(format!("{name}[{place}] is not finite")));
    }
    Ok(view.rows().into_iter().map(|row| row.to_vec()).collect())
}

/// `t, x, y, heading` a row.
pub fn trajectory(name: &str, array: &Rows<'_>) -> PyResult<Vec<StampedPose>> {
    let stamped = |row: Vec<f64>| StampedPose { stamp: row[0], pose: Pose::new(row[1], row[2], row[3]) };
    Ok(rows(name, array, 4)?.into_iter().map(stamped).collect())
}

pub fn of_trajectory<'py>(py: Python<'py>, poses: &[StampedPose]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows: Vec<[f64; 4]> =
        poses.iter().map(|StampedPose { stamp, pose }| [*stamp, pose.x, pose.y, pose.heading]).collect();
    of_rows(py, &rows)
}

/// Clusters as a structured array.
pub fn of_clusters<'py>(py: Python<'py>, clusters: &[Cluster]) -> PyResult<Bound<'py, PyAny>> {
    let row = |c: &Cluster| {
        let (along, across) = (c.along_variance.sqrt(), c.across_variance.sqrt());
        [c.mean.x, c.mean.y, c.direction.x, c.direction.y, along, across, c.count]
    };
    let rows: Vec<[f64; 7]> = clusters.iter().map(row).collect();
    let fields =
        PyList::new(
            py,
            [("mean", 2), ("direction", 2), ("std_along", 1), ("std_across", 1), ("count", 1)]
                .map(|(name, numbers)| {
                    if numbers == 1 { (name, "f8").into_pyobject(py) } else { (name, "f8", numbers).into_pyobject(py) }
                })
                .into_iter()
                .collect::<PyResult<Vec<_>>>()?,
        )?;
    let dtype = py.import("numpy")?.call_method1("dtype", (fields,))?;
    PyArray1::from_slice(py, rows.as_flattened()).call_method1("view", (dtype,))
}

/// A configuration as TOML: of a text, or of nested dicts.
pub fn toml(config: Option<&Bound<'_, PyAny>>) -> PyResult<String> {
    let Some(config) = config else { return Ok(String::new()) };
    if let Ok(text) = config.extract::<String>() {
        return Ok(text);
    }
    let table = table("config", config)?;
    toml::to_string(&table).map_err(|error| value(format!("config: {error}")))
}

fn table(name: &str, value_of: &Bound<'_, PyAny>) -> PyResult<toml::Value> {
    use pyo3::types::{PyBool, PyFloat, PyInt, PyString};
    if let Ok(dict) = value_of.cast::<PyDict>() {
        let mut table = toml::Table::new();
        for (key, member) in dict {
            let key: String = key.extract()?;
            let below = format!("{name}.{key}");
            table.insert(key, self::table(&below, &member)?);
        }
        return Ok(table.into());
    }
    Ok(if value_of.is_instance_of::<PyBool>() {
        value_of.extract::<bool>()?.into()
    } else if value_of.is_instance_of::<PyInt>() {
        value_of.extract::<i64>()?.into()
    } else if value_of.is_instance_of::<PyFloat>() {
        value_of.extract::<f64>()?.into()
    } else if value_of.is_instance_of::<PyString>() {
        value_of.extract::<String>()?.into()
    } else {
        let kind = value_of.get_type().name()?;
        return Err(value(format!("{name} is a {kind}; a configuration holds bool, int, float, str and dict")));
    })
}
