//! What the parts of one step cost, and how far the likelihood of eq. 18 is from what the processor could do.
//!
//! `cargo bench --no-default-features --bench core`

#![allow(clippy::unwrap_used, clippy::expect_used, missing_docs)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use ipslam::clustering::{ClusteringConfig, cluster_points};
use ipslam::config::Config;
use ipslam::evaluator::cpu::LocalMap;
use ipslam::evaluator::layout::{LikelihoodConfig, Tile, tiles};
use ipslam::geometry::Pose;
use ipslam::io::{LogEntry, LogSource};
use ipslam::map::MapCluster;
use ipslam::map::merging::merge_scan;
use ipslam::ppca::Cluster;
use ipslam::scan::Scan;
use ipslam::simulate::Simulation;
use ipslam::slam::Slam;
use nalgebra::Point2;
use std::hint::black_box;
use std::time::{Duration, Instant};

const SEED: u64 = 1;
/// The simulated laser has 361 beams; the scan with the most returns is taken.
const POINTS: usize = 361;
const CLUSTERS: usize = 200;
const POSES: usize = 1000;
const ROUNDS: u32 = 10;
/// Floating-point operations of one point and cluster, a multiply and an add counting as two: offset 2, along 3,
/// across 3, both scaled and squared 3 and more. The few of the fall-off beyond a segment's ends are not counted.
const FLOP: f64 = 11.0;

fn scan() -> Scan {
    let scans = Simulation::building(SEED).open().unwrap().take(600).filter_map(|entry| match entry.unwrap() {
        LogEntry::Laser(reading) => Some(Scan::from_reading(&reading, 0.1, 30.0)),
        _ => None,
    });
    scans.max_by_key(|scan| scan.points.len()).unwrap()
}

/// Walls on a square grid, 3 m apart, in both directions; the robot is in their middle.
fn walls(count: usize) -> Vec<Cluster> {
    let columns = (count as f64).sqrt().ceil() as usize;
    let at = |i: usize| 3.0 * (i as f64 - 0.5 * columns as f64);
    (0..count)
        .map(|i| Cluster {
            mean: Point2::new(at(i % columns), at(i / columns)),
            direction: if i % 2 == 0 { nalgebra::Vector2::x() } else { nalgebra::Vector2::y() },
            along_variance: 4.0 / 12.0,
            across_variance: 1e-4,
            count: 100.0,
        })
        .collect()
}

fn clustering(criterion: &mut Criterion) {
    let (scan, config) = (scan(), ClusteringConfig::default());
    let found = cluster_points(&scan.points, &config).clusters.len();
    println!("cluster: {} points, {found} clusters", scan.points.len());
    criterion.bench_function("cluster a scan", |b| b.iter(|| cluster_points(black_box(&scan.points), &config)));
}

fn merging(criterion: &mut Criterion) {
    let Config { clustering, matching, merging, .. } = Config::default();
    let scan_clusters = cluster_points(&scan().points, &clustering).clusters;
    // The scan's own clusters are among those of the map, so that there is something to match.
    let map = scan_clusters.iter().copied().chain(walls(300)).take(300);
    let near: Vec<_> = (0..).zip(map.map(|cluster| MapCluster { cluster, last_step: 0, sightings: 9 })).collect();
    assert_eq!(near.len(), 300);
    println!("match and merge: {} scan clusters, {} map clusters", scan_clusters.len(), near.len());
    criterion.bench_function("match and merge a scan", |b| {
        b.iter(|| merge_scan(black_box(&near), &scan_clusters, 1, &matching, &merging));
    });
}

/// The whole filter with 8 maps on the first seconds of a drive; what is told is the time of one step.
fn stepping(criterion: &mut Criterion) {
    let entries: Vec<LogEntry> = Simulation::building(SEED).open().unwrap().take(600).map(Result::unwrap).collect();
    let config = Config { particles: 8, maps: 8, ..Config::default() };
    criterion.bench_function("a step of 8 particles, with the scans tracked before it", |b| {
        b.iter_custom(|rounds| {
            let (mut steps, mut spent) = (0u32, Duration::ZERO);
            for _ in 0..rounds {
                let mut slam = Slam::new(config);
                let began = Instant::now();
                entries.iter().for_each(|entry| slam.add(entry, &mut |_| steps += 1));
                spent += began.elapsed();
            }
            spent / (steps / rounds as u32)
        });
    });
}

/// Seconds that one thread takes to weigh all poses.
fn weigh(map: &LocalMap, poses: &[Pose], tiles: &[Tile]) -> f64 {
    let began = processor_seconds();
    black_box(poses.iter().map(|&pose| map.log_likelihood(pose, tiles)).sum::<f64>());
    processor_seconds() - began
}

/// Seconds that this thread has been on a processor: what else the machine does leaves them alone.
fn processor_seconds() -> f64 {
    let spent = std::fs::read_to_string("/proc/thread-self/schedstat").expect("runs on Linux");
    spent.split(' ').next().unwrap().parse::<f64>().unwrap() * 1e-9
}

fn weighing(criterion: &mut Criterion) {
    let points: Vec<Point2<f64>> = scan().points.into_iter().cycle().take(POINTS).collect();
    let tiles = tiles(&points, usize::MAX);
    let poses: Vec<Pose> = (0..POSES)
        .map(|i| Pose::new(0.01 * (i % 10) as f64, 0.01 * (i / 10 % 10) as f64, 0.001 * (i / 100) as f64))
        .collect();
    let walls = walls(CLUSTERS);
    let usual = LikelihoodConfig::default();
    // So unlikely an outlier that every cluster reaches every tile: nothing is left out.
    let all = LikelihoodConfig { outlier_density: 1e-300, sigma_floor: 1.0, end_sigma: 1.0, ..usual };
    let pairs = (POSES * POINTS * CLUSTERS) as f64;
    let mut group = criterion.benchmark_group("weigh");
    group.throughput(Throughput::Elements(pairs as u64));
    for (name, config) in [("as configured", usual), ("every cluster at every point", all)] {
        let map = LocalMap::new(&walls, Pose::IDENTITY, &config);
        group.bench_function(name, |b| {
            b.iter(|| poses.iter().map(|&pose| map.log_likelihood(pose, black_box(&tiles))).sum::<f64>());
        });
        let seconds = (0..ROUNDS).map(|_| weigh(&map, &poses, &tiles)).sum::<f64>() / f64::from(ROUNDS);
        println!(
            "{name}: {:.2e} points x clusters a second of one core's time, mean of {ROUNDS} rounds",
            pairs / seconds
        );
        if config == all {
            report_peak(pairs / seconds);
        }
    }
    group.finish();
}

/// How much of the processor the evaluations take, with the assumptions that the figure rests on.
fn report_peak(pairs_a_second: f64) {
    let information = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let megahertz = information.lines().find_map(|line| line.strip_prefix("cpu MHz")?.split(':').nth(1));
    let Some(megahertz) = megahertz.and_then(|text| text.trim().parse::<f64>().ok()) else {
        return println!("no clock in /proc/cpuinfo: no share of the peak is told");
    };
    let clock = megahertz * 1e6;
    for (peak, assumption) in [
        (clock * 4.0 * 2.0, "SSE2, 4 lanes x 2 operations a cycle, no fused multiply-add"),
        (clock * 8.0 * 2.0 * 2.0, "AVX2, 8 lanes x 2 fused multiply-adds a cycle"),
    ] {
        println!(
            "  at {FLOP} flop each {:.1} Gflop/s, {:.0} % of a peak of {:.0} Gflop/s ({:.2} GHz by /proc/cpuinfo, {assumption})",
            FLOP * pairs_a_second / 1e9,
            100.0 * FLOP * pairs_a_second / peak,
            peak / 1e9,
            clock / 1e9,
        );
    }
    println!("  this build: AVX2 {}, FMA {}", cfg!(target_feature = "avx2"), cfg!(target_feature = "fma"));
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(3));
    targets = clustering, merging, stepping, weighing
}
criterion_main!(benches);
