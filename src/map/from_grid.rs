//! The walls of a grid as line clusters.

use super::MapCluster;
use super::matching::MatchingConfig;
use super::merging::{MergingConfig, consolidated};
use crate::clustering::{ClusteringConfig, cluster_points};
use crate::grid::{Cell, OccupancyGrid};
use crate::ppca::Cluster;
use nalgebra::Point2;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Side of the squares that are clustered one by one \[m\]: each holds about as many points as a scan.
const SQUARE: f64 = 4.0;

/// Standard deviation of a wall's place, in cells: its face is somewhere in one, and whoever made the grid may have been
/// off by another.
const KNOWN_TO: f64 = 2.0;

/// A wall's face may be this far from free cells, with unknown ones between \[m\]: those of a [`FreeArea`](crate::grid::FreeArea)
/// keep away from walls by up to their diagonal.
const FACE_GAP: f64 = 0.4;

/// The walls of a grid, in the world's frame: the occupied cells that face free ones, clustered like the points of a
/// scan, square by square, and joined across the squares' borders.
///
/// `config` is that of a scan. Where a cell is wider than the thickness and gaps that it allows, a cell's width counts.
/// A cluster's `count` is its number of cells, and its standard deviation across at least two cells.
pub fn clusters_of_grid(grid: &OccupancyGrid, config: &ClusteringConfig) -> Vec<Cluster> {
    let mut squares: BTreeMap<[i64; 2], Vec<Point2<f64>>> = BTreeMap::new();
    let cells_across = (SQUARE / grid.resolution()).ceil().max(1.0) as i64;
    for [column, row] in grid.places(Cell::Occupied) {
        if faces_free(grid, [column, row]) {
            let square = squares.entry([column / cells_across, row / cells_across]).or_default();
            square.push(grid.centre(column, row));
        }
    }
    let max_across = config.max_across.max(0.6 * grid.resolution());
    let config = ClusteringConfig {
        max_across,
        noise: config.noise.max(grid.resolution() / 12_f64.sqrt()),
        max_gap: config.max_gap.max(3.0 * grid.resolution()),
        ..*config
    };
    let squares: Vec<Vec<Point2<f64>>> = squares.into_values().collect();
    let pieces = squares.par_iter().flat_map(|points| cluster_points(points, &config).clusters);
    let pieces: Vec<MapCluster> = pieces.map(|cluster| MapCluster { cluster, last_step: 0, sightings: 1 }).collect();
    let default = MergingConfig::default();
    let merging = MergingConfig { max_across: default.max_across.max(max_across), ..default };
    let least_across = (KNOWN_TO * grid.resolution()).powi(2);
    let thick = |MapCluster { cluster, .. }| Cluster {
        across_variance: f64::max(cluster.across_variance, least_across),
        ..cluster
    };
    consolidated(&pieces, &MatchingConfig::default(), &merging).into_iter().map(thick).collect()
}

/// Whether the first cell that is known, left, right, below or above, is free.
fn faces_free(grid: &OccupancyGrid, [column, row]: [i64; 2]) -> bool {
    let farthest = (FACE_GAP / grid.resolution()).max(1.0) as i64;
    [[-1, 0], [1, 0], [0, -1], [0, 1]].iter().any(|[x, y]| {
        let mut seen = (1..=farthest).map(|step| grid.cell(column + step * x, row + step * y));
        seen.find(|&cell| cell != Cell::Unknown) == Some(Cell::Free)
    })
}
