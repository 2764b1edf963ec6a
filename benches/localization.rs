//! How often, how soon and how well the robot is found in a known map, against the number of particles.
//!
//! ```text
//! cargo bench --no-default-features --features gpu --bench localization -- MAP LOG TRAJECTORY [STARTS] [PARTICLES,..] [kidnap] [gpu]
//! ```
//! The map and the trajectory are those of a run of the log, or of anything in the same frame. Each start takes up the log
//! at another place, spread evenly, without a prior. A fix is right within 0.5 m and 10° of the trajectory. With `kidnap`
//! the robot is set back to another place once it was located for 5 m altogether.

use ipslam::evaluator::Evaluator;
use ipslam::geometry::{Pose, StampedPose};
use ipslam::io::{carmen::CarmenLog, map_json, tum};
use ipslam::localization::{Localization, LocalizationConfig};
use ipslam::log::{LogEntry, readings};
use ipslam::report::{Estimator as _, Event};
use std::path::Path;
use std::time::Instant;

/// A fix is right this close to the trajectory [m, rad].
const RIGHT: [f64; 2] = [0.5, 0.174_532_925_2];
/// A start that has not been found after this is given up [m].
const FARTHEST: f64 = 30.0;
/// The way before and after the robot is carried away [m].
const CARRIED_AFTER: f64 = 5.0;
/// After the first fix the error is watched for this long [m].
const WATCHED: f64 = 15.0;

/// An entry of the log, with the pose that the trajectory has there.
type Entry = (LogEntry, Pose);

/// How one start went; distances since the start, or since the robot was carried away.
#[derive(Default)]
struct Outcome {
    /// Metres and seconds to the first right fix.
    found: Option<(f64, f64)>,
    /// Steps located at a wrong place.
    wrong: usize,
    located: usize,
    /// Errors of right fixes after the first [m].
    errors: Vec<f64>,
    first_step_seconds: f64,
    /// Share of the scan that is explained, at steps located rightly and wrongly.
    explained: [Vec<f64>; 2],
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).filter(|arg| arg != "--bench").collect();
    let [map, log, trajectory, rest @ ..] = &args[..] else {
        eprintln!("not run: it takes MAP.json LOG TRAJECTORY.tum [STARTS] [PARTICLES,..] [kidnap] [gpu]");
        return Ok(());
    };
    let number = |at: usize| rest.get(at).map(String::as_str);
    let starts: usize = number(0).unwrap_or("50").parse()?;
    let particles = number(1).unwrap_or("1000,10000,100000,1000000").split(',');
    let particles = particles.map(str::parse).collect::<Result<Vec<usize>, _>>()?;
    let kidnap = rest.iter().any(|arg| arg == "kidnap");
    let on_gpu = rest.iter().any(|arg| arg == "gpu");

    let map = map_json::read_map(Path::new(map))?;
    println!("{} clusters, {:.0} m² free", map.clusters.len(), map.free.as_ref().map_or(0.0, |free| free.area()));
    let entries = entries(&CarmenLog::new(log), &tum::read(Path::new(trajectory))?)?;
    // With enough of the log left.
    let mut left = 0.0;
    let mut scans = Vec::new();
    for (index, pair) in entries.windows(2).enumerate().rev() {
        left += pair[1].1.seen_from(pair[0].1).position().coords.norm();
        if left > FARTHEST + WATCHED && matches!(pair[0].0, LogEntry::Laser(_)) {
            scans.push(index);
        }
    }
    scans.reverse();
    assert!(!scans.is_empty(), "the log is shorter than {} m", FARTHEST + WATCHED);

    println!(
        "particles  found  within 20 m  wrongly  metres (median, 90 %)  seconds (median)  error (median)  first step  explained: right 5 %, wrong 95 %"
    );
    for max_particles in particles {
        let mut outcomes = Vec::new();
        for start in 0..starts {
            let first = scans[start * scans.len() / starts];
            let mut config = LocalizationConfig { seed: start as u64, max_particles, ..LocalizationConfig::default() };
            if let Ok(text) = std::env::var("IPSLAM_CONFIG") {
                config = config.with_toml(&text)?;
            }
            config.min_particles = config.min_particles.min(max_particles);
            let filter = Localization::new(map.clone(), None, config, evaluator(on_gpu)?)?;
            let elsewhere = scans[(start * scans.len() / starts + scans.len() / 2) % scans.len()];
            outcomes.push(follow(filter, &entries, first, kidnap.then_some(elsewhere)));
        }
        println!("{max_particles:>9}  {}", row(&outcomes));
    }
    Ok(())
}

/// Every reading, with its pose of the trajectory.
fn entries(log: &CarmenLog, trajectory: &[StampedPose]) -> Result<Vec<Entry>, Box<dyn std::error::Error>> {
    let posed = readings(log)?.zip(trajectory);
    posed.map(|(reading, pose)| Ok((reading?.1, pose.pose))).collect()
}

#[cfg(feature = "gpu")]
fn evaluator(on_gpu: bool) -> Result<Option<Box<dyn Evaluator>>, Box<dyn std::error::Error>> {
    use ipslam::evaluator::gpu::GpuEvaluator;
    use ipslam::gpu::device::find;
    let wanted = std::env::var("IPSLAM_ADAPTER").ok();
    Ok(if on_gpu { Some(Box::new(GpuEvaluator::new(&find(wanted.as_deref())?)?)) } else { None })
}

#[cfg(not(feature = "gpu"))]
fn evaluator(_: bool) -> Result<Option<Box<dyn Evaluator>>, Box<dyn std::error::Error>> {
    Ok(None)
}

/// Follows the robot from one place of the log, around its end, and on from another place once it was found.
fn follow(mut filter: Localization, entries: &[Entry], first: usize, elsewhere: Option<usize>) -> Outcome {
    let mut outcome = Outcome::default();
    let mut carried = elsewhere.is_none();
    let (mut way, mut seconds, mut found_for) = (0.0, 0.0, 0.0);
    let mut index = first;
    let mut odom_from_log = Pose::IDENTITY;
    let mut last: Option<Pose> = None;
    let mut last_stamp = None;
    while way < FARTHEST + WATCHED {
        let (entry, truth) = &entries[index];
        let mut entry = entry.clone();
        let (LogEntry::Laser(ipslam::log::LaserReading { odom_from_robot, stamp, .. })
        | LogEntry::Odometry { odom_from_robot, stamp }) = &mut entry
        else {
            break;
        };
        // Odometry goes on as if nothing had happened where the log is taken up elsewhere.
        if let Some(last) = last.filter(|_| index == first || Some(index) == elsewhere) {
            odom_from_log = last * odom_from_robot.inverse();
        }
        *odom_from_robot = odom_from_log * *odom_from_robot;
        let moved = last.map_or(0.0, |last| odom_from_robot.seen_from(last).position().coords.norm());
        seconds += last_stamp.map_or(0.0, |last: f64| (*stamp - last).clamp(0.0, 5.0));
        (last, last_stamp) = (Some(*odom_from_robot), Some(*stamp));
        way += moved;

        let mut stepped = None;
        let began = Instant::now();
        filter.add(&entry, &mut |event| {
            if let Event::Step(report) = event {
                stepped = Some((report.world_from_robot, report.confidence));
            }
        });
        if let Some((pose, Some(confidence))) = stepped {
            if outcome.first_step_seconds == 0.0 {
                outcome.first_step_seconds = began.elapsed().as_secs_f64();
            }
            let off = pose.seen_from(*truth);
            let error = off.x.hypot(off.y);
            let is_right = error < RIGHT[0] && off.heading.abs() < RIGHT[1];
            if carried && confidence.is_located {
                outcome.located += 1;
                outcome.explained[usize::from(!is_right)].push(confidence.explained);
                outcome.wrong += usize::from(!is_right);
                if is_right {
                    outcome.found.get_or_insert((way, seconds));
                    outcome.errors.push(error);
                }
            }
            if confidence.is_located && is_right {
                found_for += moved.max(0.3);
            }
            if let Some(elsewhere) = elsewhere.filter(|_| !carried && found_for > CARRIED_AFTER) {
                carried = true;
                (way, seconds) = (0.0, 0.0);
                last_stamp = None;
                index = elsewhere;
                continue;
            }
        }
        if outcome.found.is_some_and(|(metres, _)| way > metres + WATCHED) {
            break;
        }
        index = (index + 1) % entries.len();
        if index == 0 {
            // The end of the log is another place than its start.
            break;
        }
    }
    outcome
}

fn row(outcomes: &[Outcome]) -> String {
    let count = outcomes.len();
    let found: Vec<(f64, f64)> = outcomes.iter().filter_map(|outcome| outcome.found).collect();
    let soon = found.iter().filter(|(metres, _)| *metres <= 20.0).count();
    let wrongly = outcomes.iter().filter(|outcome| outcome.wrong > 0).count();
    let wrong: usize = outcomes.iter().map(|outcome| outcome.wrong).sum();
    let located: usize = outcomes.iter().map(|outcome| outcome.located).sum();
    let quantile = |mut values: Vec<f64>, share: f64| {
        values.sort_by(f64::total_cmp);
        values.get(((values.len() as f64 - 1.0) * share).round() as usize).copied().unwrap_or(f64::NAN)
    };
    let metres: Vec<f64> = found.iter().map(|found| found.0).collect();
    let errors: Vec<f64> = outcomes.iter().flat_map(|outcome| outcome.errors.iter().copied()).collect();
    let explained = |side: usize, share: f64| {
        quantile(outcomes.iter().flat_map(|outcome| outcome.explained[side].iter().copied()).collect(), share)
    };
    format!(
        "{:>3}/{count}  {soon:>3}/{count}  {wrongly:>3} ({wrong} of {located} steps)  {:>5.1} {:>5.1} m  {:>5.1} s  {:.3} m  {:.0} ms  explained {:.2} {:.2}",
        found.len(),
        quantile(metres.clone(), 0.5),
        quantile(metres, 0.9),
        quantile(found.iter().map(|found| found.1).collect(), 0.5),
        quantile(errors, 0.5),
        1e3 * quantile(outcomes.iter().map(|outcome| outcome.first_step_seconds).collect(), 0.5),
        explained(0, 0.05),
        explained(1, 0.95),
    )
}
