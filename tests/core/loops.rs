//! Loops in a simulated drive whose path was torn in one place, against the true path.

use crate::SEED;
use ipslam::clustering::cluster_scan;
use ipslam::config::SlamConfig;
use ipslam::evaluator::failover::Failover;
use ipslam::evaluator::tiles::tiles;
use ipslam::geometry::Pose;
use ipslam::log::{LogEntry, LogSource};
use ipslam::loops::{Closed, Keyframe, LoopConfig, Loops};
use ipslam::motion::Travel;
use ipslam::report::Loop;
use ipslam::scan::Scan;
use ipslam::simulate::Simulation;
use std::collections::HashMap;

/// The true pose, and the scan, each 0.3 m or 0.2 rad of the drive through the building.
fn steps(config: &SlamConfig) -> Vec<(Pose, Scan)> {
    let simulation = Simulation::building(SEED);
    let truth: HashMap<u64, Pose> = simulation.truth().map(|truth| (truth.stamp.to_bits(), truth.pose)).collect();
    let mut steps: Vec<(Pose, Scan)> = Vec::new();
    for entry in simulation.open().unwrap() {
        let LogEntry::Laser(reading) = entry.unwrap() else { continue };
        let pose = truth[&reading.stamp.to_bits()];
        if !steps.last().is_some_and(|last| config.tracking.is_too_near(pose.seen_from(last.0))) {
            steps.push((pose, Scan::from_reading(&reading, &config.scan)));
        }
    }
    steps
}

/// Follows the steps with motions that are true but for one, which is turned by `torn` \[rad\] where odometry is not. The path in the
/// end, seen from its first pose, and the loops.
fn follow(steps: &[(Pose, Scan)], torn: f64, config: &SlamConfig) -> (Vec<Pose>, Vec<Loop>) {
    let mut loops = Loops::new(config.closer());
    let mut path: Vec<Pose> = Vec::new();
    for (number, (truth, scan)) in steps.iter().enumerate() {
        let moved = truth.seen_from(steps[number.saturating_sub(1)].0);
        let by_odometry = Travel::measured(moved).motion(&config.motion, Pose::IDENTITY);
        let turn = if number == steps.len() / 4 { torn } else { 0.0 };
        let mut tracked = by_odometry;
        tracked.mean = Pose { heading: moved.heading + turn, ..moved };
        tracked.covariance *= 1e-4;
        path.push(path.last().map_or(Pose::IDENTITY, |&last| last * tracked.mean));
        loops.add(Keyframe {
            stamp: scan.stamp,
            tiles: tiles(&scan.points, config.likelihood.max_points),
            clusters: cluster_scan(scan, &config.clustering).clusters,
            by_odometry,
            tracked,
        });
        if loops.is_due()
            && let Some(Closed { path: bent, map }) = loops.close(&path, &mut Failover::new(None), &|_| 0.0)
        {
            assert!(bent.len() == path.len() && !map.is_empty());
            path = bent;
        }
    }
    let found = loops.found(&path);
    (path, found)
}

/// The greatest distance from the truth, seen from the first pose \[m\].
fn off(path: &[Pose], steps: &[(Pose, Scan)]) -> f64 {
    let distance =
        |(pose, (truth, _)): (&Pose, &(Pose, Scan))| (truth.seen_from(steps[0].0).position() - pose.position()).norm();
    path.iter().zip(steps).map(distance).fold(0.0, f64::max)
}

#[test]
fn a_torn_path_is_bent_where_the_robot_comes_back() {
    let config = SlamConfig::default();
    let steps = steps(&config);
    let never = SlamConfig { loops: LoopConfig { search_distance: 0.0, ..config.loops }, ..config };
    let (torn, none) = follow(&steps, 0.3, &never);
    assert!(none.is_empty() && off(&torn, &steps) > 3.0, "the path is not torn: {} m", off(&torn, &steps));

    let (path, found) = follow(&steps, 0.3, &config);
    println!("seed {SEED}: {} steps, {} m off, then {} m", steps.len(), off(&torn, &steps), off(&path, &steps));
    assert!(off(&path, &steps) < 0.5, "seed {SEED}: {} m off; {found:?}", off(&path, &steps));
    // Where it was torn it is whole again, and visits to one place are as far apart as they were.
    let step = steps.len() / 4;
    let turn = |path: &[Pose]| path[step].seen_from(path[step - 1]).heading;
    let truth: Vec<Pose> = steps.iter().map(|(truth, _)| *truth).collect();
    let turned = [&torn, &path].map(|path| (turn(path) - turn(&truth)).abs());
    let mut apart: Vec<f64> = (0..truth.len())
        .flat_map(|newer| (0..newer.saturating_sub(100)).map(move |older| (older, newer)))
        .filter(|&(older, newer)| truth[newer].seen_from(truth[older]).position().coords.norm() < 1.0)
        .map(|(older, newer)| {
            let off = path[newer].seen_from(path[older]).seen_from(truth[newer].seen_from(truth[older]));
            off.x.hypot(off.y)
        })
        .collect();
    apart.sort_by(f64::total_cmp);
    let [half, most] = [apart.len() / 2, apart.len() * 9 / 10].map(|rank| apart[rank]);
    println!("the step is turned by {turned:?} rad; {} visits, {half} m off in the median, 90 % {most} m", apart.len());
    assert!(turned[0] > 0.29 && turned[1] < 0.03, "seed {SEED}: {turned:?}");
    assert!(apart.len() > 100 && half < 0.05 && most < 0.15, "seed {SEED}: {half} m in the median, 90 % {most} m");
    let closed: Vec<&Loop> = found.iter().filter(|found| found.is_closed).collect();
    assert!(!closed.is_empty(), "{found:?}");
    for Loop { step, older, older_from_robot, .. } in closed {
        let truth = steps[*step as usize].0.seen_from(steps[*older as usize].0);
        let apart = older_from_robot.seen_from(truth);
        assert!(apart.x.hypot(apart.y) < 0.3 && apart.heading.abs() < 0.1, "step {step}, older {older}: {apart:?}");
    }
}

/// Where nothing is wrong, nothing is bent.
#[test]
fn a_true_path_stays() {
    let config = SlamConfig::default();
    let steps = steps(&config);
    let (path, found) = follow(&steps, 0.0, &config);
    assert!(off(&path, &steps) < 1e-6, "{found:?}");
}
