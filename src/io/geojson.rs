//! The walls of a map as GeoJSON (RFC 7946), for maps and drawings made by other programs: a line a wall.
//!
//! **Coordinates are metres in the world's frame** (the robot's first pose is the origin, x ahead of it, y to its left),
//! not the longitudes and latitudes that the RFC asks for: where on Earth a building stands is not known. The file
//! says so in its member `frame`; set the coordinate system of the program that reads it to a local plane.
//!
//! Properties of a line: `count`, the points that the wall stands for, and `std_across`, its thickness as a standard
//! deviation \[m\].

use crate::ppca::Cluster;
use serde_json::{Value, json};
use std::io::Write;

const FRAME: &str = "metres in the local frame of the map, x then y; not longitude and latitude";

/// Writes walls of the world's frame \[m\]. One that is not finite is left out.
///
/// # Errors
/// The writing fails.
pub fn write_walls(clusters: &[Cluster], mut out: impl Write) -> std::io::Result<()> {
    let collection = json!({
        "type": "FeatureCollection",
        "frame": FRAME,
        "features": clusters.iter().filter(|cluster| is_finite(cluster)).map(feature).collect::<Vec<Value>>(),
    });
    serde_json::to_writer(&mut out, &collection)?;
    writeln!(out)
}

fn is_finite(cluster: &Cluster) -> bool {
    let ends = cluster.endpoints();
    ends.iter().flat_map(|end| end.iter()).chain([&cluster.across_variance, &cluster.count]).all(|v| v.is_finite())
}

fn feature(cluster: &Cluster) -> Value {
    let ends = cluster.endpoints().map(|end| [end.x, end.y]);
    json!({
        "type": "Feature",
        "geometry": { "type": "LineString", "coordinates": ends },
        "properties": { "count": cluster.count, "std_across": cluster.across_variance.sqrt() },
    })
}
