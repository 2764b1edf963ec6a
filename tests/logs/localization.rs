//! The robot found in a real building. The map is made of every other scan of CSAIL at the poses that graph mapping gave
//! them, and the filter is handed the scans between.

use crate::needs::data;
use ipslam::clustering::ClusteringConfig;
use ipslam::geometry::Pose;
use ipslam::grid::{FreeArea, GridBuilder};
use ipslam::io::carmen::CarmenLog;
use ipslam::io::tum;
use ipslam::localization::{Localization, LocalizationConfig};
use ipslam::log::{LaserReading, LogEntry, LogSource as _};
use ipslam::map::{LineMap, clusters_of_grid};
use ipslam::report::{Estimator as _, Event};
use ipslam::scan::{Scan, ScanConfig};
use std::collections::HashMap;

/// A pose is right this close to the reference [m, rad]: the map has cells of 5 cm, and the reference itself is 0.02 m off in the
/// mean and 0.06 rad at worst.
const RIGHT: [f64; 2] = [0.2, 0.1];
/// Scans that the filter is handed.
const SCANS: u32 = 60;

/// The scans that have a reference pose, with it.
fn scans() -> Vec<(LaserReading, Pose)> {
    let reference = tum::read(&data("csail/csail.graph.xyt.gz")).unwrap();
    let poses: HashMap<u64, Pose> = reference.iter().map(|stamped| (stamped.stamp.to_bits(), stamped.pose)).collect();
    let entries = CarmenLog::new(data("csail/mit-csail.clf.gz")).open().unwrap();
    let with_pose = entries.filter_map(|entry| match entry.unwrap() {
        LogEntry::Laser(reading) => poses.get(&reading.stamp.to_bits()).map(|&pose| (reading, pose)),
        _ => None,
    });
    let scans: Vec<_> = with_pose.collect();
    assert!(scans.len() > 1000, "{} scans have a reference pose", scans.len());
    scans
}

fn map<'a>(scans: impl Iterator<Item = &'a (LaserReading, Pose)> + Clone) -> LineMap {
    let mut builder = GridBuilder::new(0.05);
    for (reading, pose) in scans.clone() {
        builder.add_scan(&Scan::from_reading(reading, &ScanConfig::default()), reading.robot_from_laser, *pose);
    }
    let grid = builder.finish().unwrap();
    let free = FreeArea::from_grid(&grid, scans.map(|(_, pose)| pose.position()));
    LineMap { clusters: clusters_of_grid(&grid, &ClusteringConfig::default()), free }
}

fn the_robot_is_found_in_csail() {
    let scans = scans();
    let map = map(scans.iter().step_by(2));
    let between: Vec<_> = scans.iter().skip(1).step_by(2).collect();
    for (seed, start) in [(1, 0.1), (2, 0.6)] {
        let config = LocalizationConfig { seed, max_particles: 30_000, ..LocalizationConfig::default() };
        let mut filter = Localization::new(map.clone(), None, config, None).unwrap();
        let start = (start * between.len() as f64) as usize;
        let (mut located, mut wrong, mut wrong_if_moved) = (0_u32, 0, 0);
        for (reading, truth) in &between[start..start + SCANS as usize] {
            filter.add(&LogEntry::Laser(reading.clone()), &mut |event| {
                let Event::Step(report) = event else { return };
                if !report.confidence.unwrap().is_located {
                    return;
                }
                let is_right = |truth: Pose| {
                    let off = report.world_from_robot.seen_from(truth);
                    off.x.hypot(off.y) < RIGHT[0] && off.heading.abs() < RIGHT[1]
                };
                located += 1;
                wrong += u32::from(!is_right(*truth));
                wrong_if_moved += u32::from(!is_right(*truth * Pose::new(0.5, 0.0, 0.0)));
            });
        }
        println!("seed {seed}: located in {located} of {SCANS} scans, wrongly in {wrong}");
        assert!(located > SCANS / 3 && wrong == 0, "seed {seed}: located in {located} scans, wrongly in {wrong}");
        assert_eq!(wrong_if_moved, located, "the comparison rejects half a metre");
    }
}

crate::needs::trials! {
    "localization":
    Data { the_robot_is_found_in_csail }
}
