//! A map that is known, and where the robot is in it at first.

use super::convert::read_grid;
use anyhow::{bail, ensure};
use ipslam::clustering::ClusteringConfig;
use ipslam::geometry::Pose;
use ipslam::grid::FreeArea;
use ipslam::io::map_json;
use ipslam::map::{LineMap, clusters_of_grid};
use std::path::Path;

/// Reads a map of either kind.
pub fn known_map(path: &Path) -> anyhow::Result<LineMap> {
    let shown = path.display();
    let map = match path.extension().and_then(|ending| ending.to_str()) {
        Some("json") => {
            let map = map_json::read_map(path)?;
            ensure!(map.free.is_some(), "{shown}: it has no free area; run the log again, or name map.yaml of the run");
            map
        }
        Some("yaml" | "yml") => {
            let grid = read_grid(path)?;
            let free = FreeArea::from_grid(&grid, []);
            ensure!(free.is_some(), "{shown}: no cell of it is free");
            LineMap { clusters: clusters_of_grid(&grid, &ClusteringConfig::default()), free }
        }
        _ => bail!("{shown}: a map is a .json file as `ipslam run` writes it, or a .yaml file of ROS map_server"),
    };
    ensure!(!map.clusters.is_empty(), "{shown}: it has no wall");
    Ok(map)
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse::<f64>()).collect();
    let numbers = numbers.map_err(|error| format!("{error}; {N} numbers with commas between them are needed"))?;
    let found = numbers.len();
    let all: [f64; N] = numbers.try_into().map_err(|_| format!("{found} numbers, {N} are needed"))?;
    if all.iter().all(|number| number.is_finite()) { Ok(all) } else { Err("a number is not finite".to_owned()) }
}

/// X,Y,HEADING of an option.
pub fn pose(text: &str) -> Result<Pose, String> {
    numbers(text).map(|[x, y, heading]| Pose::new(x, y, heading))
}

/// Standard deviations of an option.
pub fn spread(text: &str) -> Result<[f64; 2], String> {
    let spread: [f64; 2] = numbers(text)?;
    if spread.iter().all(|&number| number >= 0.0) { Ok(spread) } else { Err("neither can be below 0".to_owned()) }
}
