//! What the parts of one step cost, and how far the likelihood of eq. 18 is from what the processor could do.
//!
//! `cargo bench --no-default-features --features gpu --bench core`

#![allow(clippy::unwrap_used, clippy::expect_used, missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use ipslam::clustering::{ClusteringConfig, cluster_scan};
use ipslam::config::SlamConfig;
use ipslam::evaluator::cpu::CpuEvaluator;
use ipslam::log::{LogEntry, LogSource};
use ipslam::map::MapCluster;
use ipslam::map::merging::{counts, merge_scan};
use ipslam::ppca::Cluster;
use ipslam::report::{Estimator as _, Event};
use ipslam::scan::{Scan, ScanConfig};
use ipslam::simulate::Simulation;
use ipslam::slam::Slam;
use nalgebra::{Point2, Vector2};
use std::hint::black_box;
use std::time::{Duration, Instant};
use workload::{FLOP, Workload, instructions, peak_flops};

#[allow(dead_code, reason = "the program uses all of it")]
#[path = "../src/cli/workload.rs"]
mod workload;

const SEED: u64 = 1;
const PARTICLES: usize = 10_000;
const POINTS: usize = 361;
const CLUSTERS: usize = 200;

/// The scan with the most returns.
fn scan() -> Scan {
    let scans = Simulation::building(SEED).open().unwrap().take(600).filter_map(|entry| match entry.unwrap() {
        LogEntry::Laser(reading) => Some(Scan::from_reading(&reading, &ScanConfig::default())),
        _ => None,
    });
    scans.max_by_key(|scan| scan.points.len()).unwrap()
}

/// Walls on a square grid, 3 m apart, in both directions; the robot is in their middle.
fn walls(count: usize) -> Vec<Cluster> {
    let columns = (count as f64).sqrt().ceil() as usize;
    let at = |i: usize| 3.0 * (i as f64 - 0.5 * columns as f64);
    (0..count)
        .map(|i| {
            let (middle, half) = (Point2::new(at(i % columns), at(i / columns)), [Vector2::x(), Vector2::y()][i % 2]);
            Cluster::wall(middle - half, middle + half, 0.01, 100.0)
        })
        .collect()
}

fn clustering(criterion: &mut Criterion) {
    let (scan, config) = (scan(), ClusteringConfig::default());
    let found = cluster_scan(&scan, &config).clusters.len();
    println!("cluster: {} points, {found} clusters", scan.points.len());
    criterion.bench_function("cluster a scan", |b| b.iter(|| cluster_scan(black_box(&scan), &config)));
}

fn merging(criterion: &mut Criterion) {
    let SlamConfig { clustering, matching, merging, ablation, .. } = SlamConfig::default();
    let scan_clusters = cluster_scan(&scan(), &clustering).clusters;
    let points = counts(&scan_clusters);
    // The scan's own clusters are among those of the map, so that there is something to match.
    let map = scan_clusters.iter().copied().chain(walls(300)).take(300);
    let near: Vec<_> = (0..).zip(map.map(|cluster| MapCluster { cluster, last_step: 0, sightings: 9 })).collect();
    assert_eq!(near.len(), 300);
    println!("match and merge: {} scan clusters, {} map clusters", scan_clusters.len(), near.len());
    criterion.bench_function("match and merge a scan", |b| {
        b.iter(|| merge_scan(black_box(&near), &scan_clusters, &points, 1, &matching, &merging, &ablation));
    });
}

/// The whole filter on the first seconds of a drive; what is told is the time of one step, with the scans before it.
fn stepping(criterion: &mut Criterion) {
    let entries: Vec<LogEntry> = Simulation::building(SEED).open().unwrap().take(600).map(Result::unwrap).collect();
    for (maps, particles) in [(8, 8), (128, 128), (256, 256 * 40)] {
        let config = SlamConfig { particles, maps, ..SlamConfig::default() };
        criterion.bench_function(&format!("a step of {particles} particles in {maps} maps"), |b| {
            b.iter_custom(|rounds| {
                let (mut steps, mut spent) = (0u32, Duration::ZERO);
                for _ in 0..rounds {
                    let mut slam = Slam::new(config);
                    let began = Instant::now();
                    entries.iter().for_each(|entry| {
                        slam.add(entry, &mut |event| steps += u32::from(matches!(event, Event::Step(_))));
                    });
                    spent += began.elapsed();
                }
                // Of all steps, as many as there were rounds.
                spent / (steps / rounds as u32)
            });
        });
    }
}

/// Weighing, with every ratio against a baseline of the same run.
fn weighing(_: &mut Criterion) {
    const LEAST: Duration = Duration::from_secs(1);
    let weigh = |workload: &Workload| workload.weigh(&mut CpuEvaluator, LEAST).unwrap();
    let (threads, peak) = (rayon::current_num_threads(), peak_flops());
    println!("\nweigh: {threads} threads, {}, {:.0} Gflop/s of multiply-adds a thread", instructions(), peak / 1e9);
    let small = Workload::new(1000, POINTS, CLUSTERS);
    let near = small.clusters_near() as f64 / CLUSTERS as f64;
    let rate = near * small.pairs() / small.weigh_by_brute_force(LEAST);
    println!("  brute force, one thread: {rate:.2e} points x clusters a second");
    println!("    {:.0} % of the peak at {FLOP} flop each; wanted: 60 %", 100.0 * rate * FLOP / peak);

    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let workload = Workload::new(PARTICLES, POINTS, CLUSTERS);
    let culled = one.install(|| weigh(&workload));
    let brute = near * workload.pairs() / rate;
    println!("  {PARTICLES} particles, one thread: {:.1} ms; brute force {:.0} ms", 1e3 * culled, 1e3 * brute);
    println!("    {:.1} times faster; wanted: 8", brute / culled);

    let large = one.install(|| weigh(&Workload::new(PARTICLES, POINTS, 100 * CLUSTERS)));
    println!("  the same in a building of {} clusters: {:.1} ms", 100 * CLUSTERS, 1e3 * large);
    println!("    {:.2} times slower; wanted: at most 1.5", large / culled);
    let all = weigh(&workload);
    println!("  on {threads} threads: {:.1} ms, {:.2} times faster", 1e3 * all, culled / all);
    device(&workload, all, LEAST);
}

/// The likely fastest device, or the one that `IPSLAM_ADAPTER` names.
#[cfg(feature = "gpu")]
fn device(workload: &Workload, cpu: f64, least: Duration) {
    use ipslam::evaluator::gpu::GpuEvaluator;
    use ipslam::gpu::device::find;
    let wanted = std::env::var("IPSLAM_ADAPTER").ok();
    match find(wanted.as_deref()).and_then(|adapter| GpuEvaluator::new(&adapter)) {
        Ok(mut gpu) => {
            let seconds = workload.weigh(&mut gpu, least).unwrap();
            println!("  {}: {:.1} ms, {:.1} times the CPU's time", gpu.name(), 1e3 * seconds, seconds / cpu);
        }
        Err(error) => println!("  not measured: {error}"),
    }
}

#[cfg(not(feature = "gpu"))]
fn device(_: &Workload, _: f64, _: Duration) {
    println!("  no device measured: built without the feature gpu");
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
