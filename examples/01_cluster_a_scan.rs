//! One scan as points, and the same scan as a handful of line clusters: `cargo run --example 01_cluster_a_scan`.

use ipslam::clustering::{ClusteringConfig, cluster_scan};
use ipslam::log::{LogEntry, LogError, LogSource};
use ipslam::scan::{Scan, ScanConfig};
use ipslam::simulate::Simulation;

fn main() -> Result<(), LogError> {
    for entry in Simulation::building(1).open()? {
        let LogEntry::Laser(reading) = entry? else { continue };
        let scan = Scan::from_reading(&reading, &ScanConfig::default());
        let clustering = cluster_scan(&scan, &ClusteringConfig::default());

        println!("{} points in {} clusters:", scan.points.len(), clustering.clusters.len());
        println!("points  from [m]          to [m]            length [m]  across [mm]");
        for cluster in &clustering.clusters {
            let [from, to] = cluster.endpoints();
            println!(
                "{:6}  ({:6.2}, {:6.2})  ({:6.2}, {:6.2})  {:10.2}  {:11.1}",
                cluster.count,
                from.x,
                from.y,
                to.x,
                to.y,
                cluster.length(),
                cluster.across_variance.sqrt() * 1000.0
            );
        }
        let outliers = clustering.assignment.iter().filter(|cluster| cluster.is_none()).count();
        println!("outliers: {outliers}");
        break;
    }
    Ok(())
}
