//! `ipslam simulate`: a log of a simulated drive, and where the robot really was.

use super::UsageError;
use super::interrupt;
use super::say::print_line;
use anyhow::{Context as _, ensure};
use clap::ValueEnum;
use ipslam::io::carmen::CarmenWriter;
use ipslam::io::semantic::{DETECTIONS, SENSORS, write_detections};
use ipslam::io::{tum, write_whole};
use ipslam::log::LogSource as _;
use ipslam::objects::Detections;
use ipslam::simulate::{
    Laser, OdometryNoise, Simulation, SimulationConfig, SimulationError, building, camera, look_alike_wings,
    random_offices,
};
use std::path::PathBuf;

/// Longest log that is written [bytes].
const LARGEST_LOG: u64 = 4 << 30;

/// Writes the log of a simulated drive, and where the robot really was.
#[derive(Debug, clap::Args)]
pub struct SimulateArgs {
    /// Folder for NAME.log (CARMEN) and NAME.truth.tum (true poses), made where it is missing
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Replace files of these names in that folder
    #[arg(long)]
    force: bool,
    /// Where to drive
    #[arg(long, value_enum, default_value_t = WorldKind::Building)]
    world: WorldKind,
    /// Size of a random world in metres, 16 to 1000 a side [default: 60x40]
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = parse_size)]
    size: Option<(f64, f64)>,
    /// Seed of the noise, and of a random world's walls
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Beams of the laser, from 2
    #[arg(long, default_value_t = Laser::default().beams, allow_negative_numbers = true)]
    beams: usize,
    /// Field of view of the laser in degrees, up to 360
    #[arg(long, value_name = "DEGREES", default_value_t = 180.0, allow_negative_numbers = true)]
    field_of_view: f64,
    /// Longest range of the laser in metres
    #[arg(long, value_name = "METRES", default_value_t = Laser::default().max_range, allow_negative_numbers = true)]
    max_range: f64,
    /// Errors of the odometry: 0 for none, 1 for those of an ordinary indoor robot, up to 50
    #[arg(long, value_name = "SCALE", default_value_t = 1.0, allow_negative_numbers = true)]
    odometry_noise: f64,
    /// Seconds to drive, repeating the tour as often as it takes [default: one tour]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    duration: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum WorldKind {
    /// The built-in building of 40 m by 30 m
    Building,
    /// Corridors and rooms drawn from the seed
    Random,
    /// Side corridors that a laser cannot tell apart, with objects that a detector sees: detections.csv and sensors.toml
    Wings,
}

/// Writes the log and the truth, and says where.
pub fn simulate(args: &SimulateArgs) -> anyhow::Result<()> {
    let (simulation, classes) = simulation(args)?;
    let size = log_size(&simulation);
    ensure!(
        size <= LARGEST_LOG,
        UsageError(format!(
            "the log would take about {:.0} GiB, more than {}: choose a shorter --duration, fewer --beams or a smaller --size",
            size as f64 / f64::from(1 << 30),
            LARGEST_LOG >> 30
        ))
    );
    let [log, truth] = ["log", "truth.tum"].map(|ending| args.out.join(format!("{}.{ending}", simulation.name())));
    let [detections, sensors] = [DETECTIONS, SENSORS].map(|name| args.out.join(name));
    let of_objects = [&detections, &sensors].into_iter().filter(|_| !classes.is_empty());
    for file in [&log, &truth].into_iter().chain(of_objects) {
        let is_free = args.force || !file.exists();
        let remedy = "it is there already: name another folder, or replace it with --force";
        ensure!(is_free, UsageError(format!("{}: {remedy}", file.display())));
    }
    std::fs::create_dir_all(&args.out).with_context(|| format!("{}: cannot be made", args.out.display()))?;
    let entries = simulation.open()?;
    interrupt::watch()?;
    let written = write_whole(&log, |file| {
        let mut writer = CarmenWriter::new(file);
        for entry in entries {
            if interrupt::happened() {
                return Err(std::io::ErrorKind::Interrupted.into());
            }
            writer.write(&entry.map_err(std::io::Error::other)?)?;
        }
        writer.finish().map(|_| ())
    });
    if interrupt::happened() {
        return Ok(());
    }
    written?;
    tum::write(&truth, &simulation.truth().collect::<Vec<_>>())?;
    if !classes.is_empty() {
        let sensors = camera(&classes);
        let frames = simulation.frames(&sensors);
        write_detections(&args.out, &Detections { sensors, frames })?;
    }

    let (driven, steps) =
        simulation.steps().fold((0.0, 0), |(driven, steps), step| (driven + step.distance, steps + 1));
    let seconds = f64::from(steps - 1) / ipslam::simulate::STEP_RATE;
    print_line!("{}: {} scans, {driven:.0} m in {seconds:.0} s", log.display(), simulation.sweeps());
    print_line!("{}: the true poses", truth.display());
    if !classes.is_empty() {
        print_line!("{}: what a detector of objects saw, for `ipslam run --detections`", detections.display());
    }
    Ok(())
}

/// The simulation, and the classes of objects in it.
fn simulation(args: &SimulateArgs) -> anyhow::Result<(Simulation, Vec<String>)> {
    ensure!(
        (0.0..=50.0).contains(&args.odometry_noise),
        UsageError(format!("--odometry-noise is {}, but has to be 0 to 50", args.odometry_noise))
    );
    ensure!(
        args.field_of_view > 0.0 && args.field_of_view <= 360.0,
        UsageError(format!("--field-of-view is {}, but has to be above 0 and at most 360 degrees", args.field_of_view))
    );
    let config = SimulationConfig {
        seed: args.seed,
        laser: Laser {
            beams: args.beams,
            field_of_view: args.field_of_view.to_radians(),
            max_range: args.max_range,
            ..Laser::default()
        },
        odometry: OdometryNoise::default().scaled(args.odometry_noise),
        duration: args.duration,
    };
    // Whatever is wrong with a simulation was an option.
    let wrong = |error: SimulationError| UsageError(error.to_string());
    let of_random = || UsageError("--size is for --world random; the others have sizes of their own".to_owned());
    ensure!(args.size.is_none() || args.world == WorldKind::Random, of_random());
    let (name, plan) = match args.world {
        WorldKind::Building => (format!("building-seed{}", args.seed), building()),
        WorldKind::Wings => (format!("wings-seed{}", args.seed), look_alike_wings(args.seed)),
        WorldKind::Random => {
            let (width, height) = args.size.unwrap_or((60.0, 40.0));
            (
                format!("random-{width}x{height}-seed{}", args.seed),
                random_offices(args.seed, width, height).map_err(wrong)?,
            )
        }
    };
    let classes = plan.classes.clone();
    Ok((Simulation::new(name, plan, config).map_err(wrong)?, classes))
}

/// About how many bytes the log will take: six a range, and a hundred or two a line for the rest.
fn log_size(simulation: &Simulation) -> u64 {
    simulation.sweeps() * (6 * simulation.config().laser.beams as u64 + 700)
}

fn parse_size(text: &str) -> Result<(f64, f64), String> {
    let side = |side: &str| side.trim().parse::<f64>().ok();
    let sides = text.split_once(['x', 'X']).and_then(|(width, height)| side(width).zip(side(height)));
    sides.ok_or_else(|| "write two numbers with an x between them, such as 60x40".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use ipslam::io::carmen::CarmenLog;
    use ipslam::log::LogEntry;
    use ipslam::simulate::STEP_RATE;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        args: SimulateArgs,
    }

    fn run(out: &std::path::Path, options: &[&str]) -> anyhow::Result<()> {
        let program = ["simulate", "--out", out.to_str().unwrap()];
        simulate(&Command::try_parse_from(program.iter().chain(options))?.args)
    }

    #[test]
    fn what_is_written_is_what_was_simulated() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("new/folder");
        run(&out, &["--world", "random", "--size", "30x20", "--seed", "7", "--beams", "181", "--duration", "40"])
            .unwrap();
        let log = CarmenLog::new(out.join("random-30x20-seed7.log"));
        let (mut laser, mut odometry, mut truth) = (Vec::new(), 0, Vec::new());
        for entry in log.open().unwrap() {
            match entry.unwrap() {
                LogEntry::Laser(reading) => laser.push(reading),
                LogEntry::Odometry { .. } => odometry += 1,
                LogEntry::Truth { world_from_robot, .. } => truth.push(world_from_robot),
                LogEntry::Turn { .. } => {}
            }
        }
        assert_eq!((laser.len(), odometry, truth.len()), (201, 401, 201));
        assert!(laser.iter().all(|reading| reading.ranges.len() == 181 && reading.max_range == 81.91));

        let written = tum::read(&out.join("random-30x20-seed7.truth.tum")).unwrap();
        let laser = Laser { beams: 181, ..Laser::default() };
        let config = SimulationConfig { seed: 7, laser, duration: Some(40.0), ..SimulationConfig::default() };
        let plan = random_offices(7, 30.0, 20.0).unwrap();
        let expected: Vec<_> = Simulation::new(String::new(), plan, config).unwrap().truth().collect();
        assert_eq!((written.len(), expected.len(), truth.len()), (201, 201, 201));
        for ((written, expected), in_log) in written.iter().zip(&expected).zip(&truth) {
            assert_eq!(written.stamp, expected.stamp);
            for pose in [&written.pose, in_log] {
                assert!((pose.position() - expected.pose.position()).norm() < 1e-8, "{pose:?} is not {expected:?}");
            }
        }
        assert!((expected[200].stamp - 400.0 / STEP_RATE).abs() < 1e-12);
        let moved = (expected[0].pose.position() - expected[200].pose.position()).norm();
        assert!(moved > 1.0, "the robot stood still: {moved} m");
    }

    #[test]
    fn the_seed_decides_the_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let log = |out: &str, seed: &str| {
            let out = folder.path().join(out);
            run(&out, &["--duration", "5", "--seed", seed]).unwrap();
            std::fs::read(out.join(format!("building-seed{seed}.log"))).unwrap()
        };
        let first = log("a", "1");
        assert!(first.len() > 10_000 && first == log("b", "1"));
        assert_ne!(first, log("a", "2"));
    }

    #[test]
    fn absurd_options_are_refused_before_anything_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let bad: [(&[&str], &str); 11] = [
            (&["--beams", "0"], "number of beams is 0, but has to be 2 to 100000"),
            (&["--beams", "-4"], "--beams"),
            (&["--odometry-noise", "-1"], "--odometry-noise is -1, but has to be 0 to 50"),
            (&["--odometry-noise", "nan"], "--odometry-noise is NaN"),
            (&["--field-of-view", "-90"], "--field-of-view is -90, but has to be above 0"),
            (&["--max-range", "inf"], "maximum range"),
            (&["--duration", "-1"], "duration is -1"),
            (&["--size", "60x40"], "--size is for --world random"),
            (&["--world", "random", "--size", "60"], "such as 60x40"),
            (&["--world", "random", "--size", "1e9x40"], "16 to 1000 m"),
            (&["--duration", "1e6", "--beams", "100000"], "GiB"),
        ];
        for (options, expected) in bad {
            let message = format!("{:#}", run(&folder.path().join("out"), options).unwrap_err());
            assert!(message.contains(expected), "{options:?}: {message:?} does not say {expected:?}");
        }
        assert!(!folder.path().join("out").exists());
    }

    #[test]
    fn the_size_is_not_underestimated() {
        let folder = tempfile::tempdir().unwrap();
        run(folder.path(), &["--duration", "100"]).unwrap();
        let config = SimulationConfig { duration: Some(100.0), ..SimulationConfig::default() };
        let expected = log_size(&Simulation::new(String::new(), building(), config).unwrap()) as f64;
        let size = std::fs::metadata(folder.path().join("building-seed1.log")).unwrap().len() as f64;
        assert!((0.7..1.05).contains(&(size / expected)), "{size} bytes, {expected} foreseen");
    }
}
