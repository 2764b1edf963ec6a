//! `ipslam bench`: how fast this machine and each of its devices weigh particles.

use super::say::print_line;
use super::workload::{FLOP, Workload, instructions, peak_flops};
use ipslam::evaluator::Evaluator;
use ipslam::evaluator::cpu::CpuEvaluator;
use serde::Serialize;
use serde_json::json;
use std::time::Duration;

/// Measures how fast the CPU and every device weigh particles, from the same poses in the same map.
#[derive(Debug, clap::Args)]
pub struct BenchArgs {
    /// Numbers of particles
    #[arg(long, value_delimiter = ',', default_value = "1000,10000,100000,1000000",
          value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    particles: Vec<u32>,
    /// Points a scan
    #[arg(long, value_delimiter = ',', default_value = "180,361,1080",
          value_parser = clap::value_parser!(u32).range(1..=100_000))]
    points: Vec<u32>,
    /// Clusters of the map
    #[arg(long, value_delimiter = ',', default_value = "50,200,2000",
          value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    clusters: Vec<u32>,
    /// Leave out what the CPU would take longer for than this [s], by its time for the number of particles before
    #[arg(long, default_value_t = 5.0)]
    patience: f64,
    /// Threads; 0 for one for each core
    #[arg(long, default_value_t = 0)]
    threads: u16,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Measurements last at least this long.
const LEAST: Duration = Duration::from_millis(200);

/// What the CPU does at best.
#[derive(Serialize)]
struct Cpu {
    threads: usize,
    instructions: String,
    /// Multiply-adds of one thread.
    peak_flop_a_second: f64,
    /// Points times clusters of one thread, where nothing is left out.
    brute_force_pairs_a_second: f64,
    brute_force_share_of_peak: f64,
}

/// One device weighing one number of particles.
#[derive(Serialize)]
struct Row {
    particles: u32,
    points: u32,
    clusters: u32,
    device: String,
    seconds: f64,
    /// Points times clusters, of the candidates alone.
    candidate_pairs_a_second: f64,
    /// The same as if none were left out.
    pairs_a_second: f64,
    /// How many times faster than the CPU.
    times_cpu: f64,
    /// Of the multiply-adds of all threads; `None` for devices, whose peak is not known.
    share_of_peak: Option<f64>,
}

/// Prints the table. What went wrong with a device is returned, the others are measured.
pub fn bench(args: &BenchArgs) -> anyhow::Result<Vec<anyhow::Error>> {
    let say = |line: &str| {
        if !args.json {
            print_line!("{line}")
        }
    };
    rayon::ThreadPoolBuilder::new().num_threads(usize::from(args.threads)).build_global()?;
    let cpu = cpu();
    say(&cpu.line());
    let (mut devices, mut errors) = devices();
    devices.iter().for_each(|(name, _)| say(&format!("device: {name}")));
    say(HEADER);
    let mut rows: Vec<Row> = Vec::new();
    for &clusters in &args.clusters {
        for &points in &args.points {
            let mut cpu_rate = 0.0;
            for &particles in &args.particles {
                let expected = f64::from(particles) * f64::from(points) / cpu_rate;
                if cpu_rate > 0.0 && expected > args.patience {
                    let size = size(particles, points, clusters);
                    say(&format!("{size}  left out: the CPU would take {expected:.0} s"));
                    continue;
                }
                let workload = Workload::new(particles as usize, points as usize, clusters as usize);
                let candidates = workload.candidate_pairs(64);
                let cpu_seconds = workload.weigh(&mut CpuEvaluator, LEAST)?;
                cpu_rate = f64::from(particles) * f64::from(points) / cpu_seconds;
                let peak = cpu.peak_flop_a_second * cpu.threads as f64;
                let mut add = |device: &str, seconds: f64, share_of_peak: Option<f64>| {
                    let row = Row {
                        particles,
                        points,
                        clusters,
                        device: device.to_owned(),
                        seconds,
                        candidate_pairs_a_second: candidates / seconds,
                        pairs_a_second: workload.pairs() / seconds,
                        times_cpu: cpu_seconds / seconds,
                        share_of_peak,
                    };
                    say(&row.line());
                    rows.push(row);
                };
                add("CPU", cpu_seconds, Some(candidates * FLOP / cpu_seconds / peak));
                devices.retain_mut(|(name, device)| match workload.weigh(device.as_mut(), LEAST) {
                    Ok(seconds) => {
                        add(name, seconds, None);
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
    if args.json {
        print_line!("{:#}", json!({ "cpu": cpu, "rows": rows }));
    }
    Ok(errors)
}

/// Measures what one thread does.
fn cpu() -> Cpu {
    let peak = peak_flops();
    let brute = Workload::new(200, 361, 200);
    let rate = brute.pairs() * brute.clusters_near() as f64 / 200.0 / brute.weigh_by_brute_force(LEAST);
    Cpu {
        threads: rayon::current_num_threads(),
        instructions: instructions(),
        peak_flop_a_second: peak,
        brute_force_pairs_a_second: rate,
        brute_force_share_of_peak: rate * FLOP / peak,
    }
}

impl Cpu {
    fn line(&self) -> String {
        format!(
            "CPU: {} threads, {}; multiply-adds of one thread: {:.0} Gflop/s at most\nCPU, one thread, nothing left out: \
             {:.2e} points x clusters a second, {:.0} % of that at {FLOP} flop each",
            self.threads,
            self.instructions,
            self.peak_flop_a_second / 1e9,
            self.brute_force_pairs_a_second,
            100.0 * self.brute_force_share_of_peak
        )
    }
}

const HEADER: &str = "
Times to weigh all particles once. Pairs: points x clusters a second, of the candidates alone and as if none
were left out. Peak: share of the threads' multiply-adds.

particles points clusters  device                           ms  candidates/s  as if all/s  x CPU  peak";

fn size(particles: u32, points: u32, clusters: u32) -> String {
    format!("{particles:>9} {points:>6} {clusters:>8}")
}

impl Row {
    fn line(&self) -> String {
        let name: String = self.device.chars().take(26).collect();
        format!(
            "{}  {name:<26} {:>8.2}  {:>12.2e} {:>12.2e} {:>6.2}  {}",
            size(self.particles, self.points, self.clusters),
            1e3 * self.seconds,
            self.candidate_pairs_a_second,
            self.pairs_a_second,
            self.times_cpu,
            self.share_of_peak.map_or_else(String::new, |share| format!("{:.0} %", 100.0 * share)),
        )
    }
}

type Named = (String, Box<dyn Evaluator>);

#[cfg(not(feature = "gpu"))]
fn devices() -> (Vec<Named>, Vec<anyhow::Error>) {
    super::say::say!("no GPU: this program was built without the feature gpu");
    (Vec::new(), Vec::new())
}

#[cfg(feature = "gpu")]
fn devices() -> (Vec<Named>, Vec<anyhow::Error>) {
    let (mut devices, mut errors) = (Vec::<Named>::new(), Vec::new());
    for adapter in ipslam::gpu::device::adapters() {
        match ipslam::evaluator::gpu::GpuEvaluator::new(&adapter) {
            Ok(device) => {
                let name = format!("{} ({}, {})", adapter.name, adapter.interface, adapter.driver);
                devices.push((name, Box::new(device)));
            }
            Err(error) => errors.push(error.into()),
        }
    }
    (devices, errors)
}
