//! `ipslam bench`: how fast this machine and each of its devices weigh particles.

use ipslam::evaluator::Evaluator;
use ipslam::evaluator::cpu::CpuEvaluator;
use ipslam::evaluator::workload::{FLOP, Workload, instructions, peak_flops};
use std::time::Duration;

/// Measures how fast the CPU and every device weigh particles, from the same poses in the same map.
#[derive(Debug, clap::Args)]
pub struct BenchArgs {
    /// Numbers of particles
    #[arg(long, value_delimiter = ',', default_values_t = [1_000, 10_000, 100_000, 1_000_000],
          value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    particles: Vec<u32>,
    /// Points a scan
    #[arg(long, value_delimiter = ',', default_values_t = [180, 361, 1080],
          value_parser = clap::value_parser!(u32).range(1..=100_000))]
    points: Vec<u32>,
    /// Clusters of the map
    #[arg(long, value_delimiter = ',', default_values_t = [50, 200, 2000],
          value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    clusters: Vec<u32>,
    /// Leave out what the CPU would take longer for than this [s], by its time for the number of particles before
    #[arg(long, default_value_t = 5.0)]
    patience: f64,
    /// Threads; 0 for one for each core
    #[arg(long, default_value_t = 0)]
    threads: u16,
}

/// Measurements last at least this long.
const LEAST: Duration = Duration::from_millis(200);

/// Prints the table. What went wrong with a device is returned, the others are measured.
pub fn bench(args: &BenchArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    rayon::ThreadPoolBuilder::new().num_threads(usize::from(args.threads)).build_global()?;
    let threads = rayon::current_num_threads();
    let peak = peak_flops();
    println!(
        "CPU: {threads} threads, {}; multiply-adds of one thread: {:.0} Gflop/s at most",
        instructions(),
        peak / 1e9
    );
    let brute = Workload::new(200, 361, 200);
    let rate = brute.pairs() * brute.clusters_near() as f64 / 200.0 / brute.weigh_by_brute_force(LEAST);
    println!(
        "CPU, one thread, nothing left out: {:.2e} points x clusters a second, {:.0} % of that at {FLOP} flop each",
        rate,
        100.0 * rate * FLOP / peak
    );
    let (mut devices, mut errors) = devices();
    println!(
        "\nTimes to weigh all particles once. Pairs: points x clusters a second, of the candidates alone and as if none"
    );
    println!("were left out. Peak: share of the threads' multiply-adds.\n");
    println!("particles points clusters  device                           ms  candidates/s  as if all/s  x CPU  peak");
    for &clusters in &args.clusters {
        for &points in &args.points {
            let mut cpu_rate = 0.0;
            for &particles in &args.particles {
                let size = format!("{particles:>9} {points:>6} {clusters:>8}");
                let expected = f64::from(particles) * f64::from(points) / cpu_rate;
                if cpu_rate > 0.0 && expected > args.patience {
                    println!("{size}  left out: the CPU would take {expected:.0} s");
                    continue;
                }
                let workload = Workload::new(particles as usize, points as usize, clusters as usize);
                let candidates = workload.candidate_pairs(64);
                let cpu = workload.weigh(&mut CpuEvaluator, LEAST)?;
                cpu_rate = f64::from(particles) * f64::from(points) / cpu;
                let row = |name: &str, seconds: f64, share: String| {
                    let name: String = name.chars().take(26).collect();
                    println!(
                        "{size}  {name:<26} {:>8.2}  {:>12.2e} {:>12.2e} {:>6.2}  {share}",
                        1e3 * seconds,
                        candidates / seconds,
                        workload.pairs() / seconds,
                        cpu / seconds,
                    );
                };
                let share = candidates * FLOP / cpu / (peak * threads as f64);
                row("CPU", cpu, format!("{:.0} %", 100.0 * share));
                devices.retain_mut(|(name, device)| match workload.weigh(device.as_mut(), LEAST) {
                    Ok(seconds) => {
                        row(name, seconds, String::new());
                        true
                    }
                    Err(error) => {
                        errors.push(error.into());
                        false
                    }
                });
            }
        }
    }
    Ok(errors)
}

type Named = (String, Box<dyn Evaluator>);

#[cfg(not(feature = "gpu"))]
fn devices() -> (Vec<Named>, Vec<anyhow::Error>) {
    println!("no GPU: this program was built without the feature gpu");
    (Vec::new(), Vec::new())
}

#[cfg(feature = "gpu")]
fn devices() -> (Vec<Named>, Vec<anyhow::Error>) {
    let (mut devices, mut errors) = (Vec::<Named>::new(), Vec::new());
    for adapter in ipslam::evaluator::gpu::device::adapters() {
        match ipslam::evaluator::gpu::GpuEvaluator::new(&adapter) {
            Ok(device) => {
                println!("device: {} ({}, {})", adapter.name, adapter.interface, adapter.driver);
                devices.push((adapter.name, Box::new(device)));
            }
            Err(error) => errors.push(error.into()),
        }
    }
    (devices, errors)
}
