//! A log in, a map out: `cargo run --release --example 02_map_a_log [LOG]`.
//!
//! Maps a CARMEN log or a ROS 2 bag, or a simulated drive where none is given; prints the longest walls and writes `map.svg`.

use ipslam::config::SlamConfig;
use ipslam::io::mcap::Topics;
use ipslam::io::{open_log, write_whole};
use ipslam::log::LogSource;
use ipslam::picture::{Line, Picture};
use ipslam::pipeline;
use ipslam::simulate::Simulation;
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let log: Box<dyn LogSource> = match std::env::args_os().nth(1) {
        Some(path) => open_log(path, &Topics::default())?,
        None => Box::new(Simulation::building(1)),
    };
    let config = SlamConfig { particles: 32, maps: 32, ..SlamConfig::default() };

    let result = pipeline::map(&*log, &config)?;

    let mut clusters = result.map.clusters.clone();
    clusters.sort_by(|a, b| b.length().total_cmp(&a.length()));
    println!("{} clusters; the longest:", clusters.len());
    for cluster in clusters.iter().take(10) {
        let [from, to] = cluster.endpoints();
        println!("{:5.1} m from ({:.2}, {:.2}) to ({:.2}, {:.2})", cluster.length(), from.x, from.y, to.x, to.y);
    }
    let (trajectory, odometry) = (result.trajectory(), result.odometry());
    let picture = Picture::new(log.name())
        .trajectory("odometry", Line::ODOMETRY, &odometry)
        .trajectory("robot", Line::ESTIMATE, &trajectory)
        .clusters(&clusters);
    write_whole(Path::new("map.svg"), |file| file.write_all(picture.to_svg().as_bytes()))?;
    println!("map.svg is written");
    Ok(())
}
