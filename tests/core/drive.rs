//! The whole filter on the first minute of a simulated drive, against the true path.

use ipslam::config::SlamConfig;
use ipslam::geometry::{Pose, StampedPose, wrap_angle};
use ipslam::log::{LaserReading, LogEntry, LogError, LogReader, LogSource, LogStats, readings};
use ipslam::metrics::trajectory::reference_errors;
use ipslam::pipeline::Run;
use ipslam::ppca::Cluster;
use ipslam::report::{Estimator as _, Event, RunResult};
use ipslam::simulate::{Laser, Simulation, SimulationConfig, Wall, building};
use ipslam::slam::Slam;
use nalgebra::Point2;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

const SEED: u64 = 1;

fn simulation(seconds: f64) -> Simulation {
    let config = SimulationConfig { seed: SEED, duration: Some(seconds), ..SimulationConfig::default() };
    Simulation::new("building".to_owned(), building(), config).unwrap()
}

fn few_maps() -> SlamConfig {
    SlamConfig { maps: 8, particles: 8, ..SlamConfig::default() }
}

fn run(simulation: &Simulation, config: SlamConfig) -> RunResult {
    Run::of(simulation).run(&mut Slam::new(config), &mut [], &mut |_| true).unwrap().result
}

/// The true poses, seen from the first: the frame of the filter.
fn truth(simulation: &Simulation) -> Vec<StampedPose> {
    let truth: Vec<_> = simulation.truth().collect();
    let first = truth[0].pose;
    truth.into_iter().map(|StampedPose { stamp, pose }| StampedPose { stamp, pose: pose.seen_from(first) }).collect()
}

/// Root mean square distance of a trajectory from the truth, once both are laid over each other [m]: without that, the
/// heading of the first scan alone would decide, by the length of the drive.
fn absolute_error(trajectory: &[StampedPose], truth: &[StampedPose]) -> f64 {
    reference_errors(truth, trajectory).absolute.unwrap().rmse
}

#[test]
fn a_minute_in_the_building_stays_close_to_the_truth() {
    const ALLOWED: f64 = 0.1;
    let simulation = simulation(60.0);
    let truth = truth(&simulation);
    let mut result = run(&simulation, few_maps());
    let count = readings(&simulation).unwrap().count();
    assert_eq!((result.trajectory().len(), result.odometry().len()), (count, count));

    let before = absolute_error(&result.trajectory(), &truth);
    let by_odometry = absolute_error(&result.odometry(), &truth);
    println!("seed {SEED}: filter {before:.3} m, odometry {by_odometry:.3} m");
    assert!(before < ALLOWED, "seed {SEED}: {before} m");
    assert!(by_odometry > ALLOWED, "odometry alone would pass");
    let mut wrong = result.trajectory();
    let middle = wrong.len() / 2;
    wrong[middle..].iter_mut().for_each(|found| found.pose = found.pose * Pose::new(0.5, 0.0, 0.0));
    assert!(absolute_error(&wrong, &truth) > ALLOWED, "a torn trajectory goes unnoticed");

    let clusters = result.map.clusters.len();
    let mut shares = Vec::new();
    few_maps().smoother().smooth(&simulation, &mut result, &mut |share| shares.push(share)).unwrap();
    assert!(shares.len() >= 3 && shares.is_sorted() && (0.0..=1.0).contains(&shares[0]), "{shares:?}");
    assert!(shares.last().is_some_and(|last| (0.7..=1.0).contains(last)), "{shares:?}");
    let after = absolute_error(&result.trajectory(), &truth);
    println!(
        "seed {SEED}: ATE {before:.4} m, smoothed {after:.4} m; {clusters} clusters, then {}",
        result.map.clusters.len()
    );
    assert!(after < 1.05 * before, "seed {SEED}: smoothing made {after} m of {before} m");
    assert!((1..=clusters).contains(&result.map.clusters.len()));
    assert_eq!(result.trajectory().len(), count);
}

/// A laser that looks all around, as two that look ahead and back.
struct FrontAndRear(Simulation);

impl LogSource for FrontAndRear {
    fn name(&self) -> String {
        self.0.name()
    }

    fn open(&self) -> Result<Box<dyn LogReader>, LogError> {
        Ok(Box::new(Halves { reader: self.0.open()?, rear: None }))
    }
}

struct Halves {
    reader: Box<dyn LogReader>,
    rear: Option<LogEntry>,
}

impl Iterator for Halves {
    type Item = Result<LogEntry, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(rear) = self.rear.take() {
            return Some(Ok(rear));
        }
        let all = match self.reader.next()? {
            Ok(LogEntry::Laser(all)) => all,
            other => return Some(other),
        };
        let half = |ahead: bool| {
            let robot_from_laser = Pose::new(0.0, 0.0, if ahead { 0.0 } else { PI });
            let angle =
                |beam: usize| wrap_angle(all.first_angle + beam as f64 * all.angle_step - robot_from_laser.heading);
            let mut beams: Vec<(f64, f64)> = (0..).map(angle).zip(all.ranges.iter().copied()).collect();
            beams.retain(|(angle, _)| angle.abs() < FRAC_PI_2);
            beams.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (first_angle, ranges) = (beams[0].0, beams.iter().map(|beam| beam.1).collect());
            LogEntry::Laser(LaserReading { robot_from_laser, first_angle, ranges, ..all.clone() })
        };
        self.rear = Some(half(false));
        Some(Ok(half(true)))
    }
}

impl LogReader for Halves {
    fn stats(&self) -> &LogStats {
        self.reader.stats()
    }

    fn progress(&self) -> Option<(u64, u64)> {
        None
    }
}

/// Front and rear take turns, and their map is one.
#[test]
fn two_lasers_make_one_map() {
    let laser = Laser { field_of_view: TAU, ..Laser::default() };
    let config = SimulationConfig { seed: SEED, laser, duration: Some(40.0), ..SimulationConfig::default() };
    let simulation = Simulation::new("building".to_owned(), building(), config).unwrap();
    let truth = truth(&simulation);
    let both = FrontAndRear(simulation);
    let readings = both.open().unwrap().filter(|entry| matches!(entry, Ok(LogEntry::Laser(_)))).count();
    assert_eq!(readings, 2 * truth.len());
    let result = Run::of(&both).run(&mut Slam::new(few_maps()), &mut [], &mut |_| true).unwrap().result;
    let error = absolute_error(&result.trajectory(), &truth);
    let by_odometry = absolute_error(&result.odometry(), &truth);
    assert!(error < 0.1 && by_odometry > 0.1, "{error} m, {by_odometry} m by odometry");
}

/// Ten seconds of odometry, at rest and then driving and turning, come before the first scan.
#[test]
fn the_origin_is_the_robot_at_the_first_scan() {
    let simulation = simulation(5.0);
    let mut slam = Slam::new(few_maps());
    let before = |step: u32| Pose::new(0.1 * f64::from(step.saturating_sub(50)), 0.0, 0.02 * f64::from(step));
    for step in 0..100 {
        let (stamp, odom_from_robot) = (0.1 * f64::from(step) - 10.0, before(step));
        slam.add(&LogEntry::Odometry { stamp, odom_from_robot }, &mut |_| {});
    }
    let mut first = None;
    for entry in simulation.open().unwrap() {
        slam.add(&entry.unwrap(), &mut |event| {
            let Event::Step(report) = event else { return };
            first.get_or_insert((report.stamp, report.world_from_robot));
        });
    }
    let (stamp, pose) = first.unwrap();
    // The noise of a motion of nothing.
    assert!(pose.x.hypot(pose.y) < 0.05 && pose.heading.abs() < 0.05, "{pose:?}");
    let placed = slam.result().poses.into_iter().find(|estimate| estimate.stamp == stamp).unwrap();
    let apart = placed.world_from_robot.unwrap().seen_from(pose);
    assert!(apart.x.hypot(apart.y) < 0.1, "{apart:?}");
}

#[test]
fn the_papers_filter_runs_to_the_end() {
    let simulation = simulation(10.0);
    let config = SlamConfig { particles: 20, maps: 20, ..SlamConfig::paper() };
    let mut steps = 0;
    let mut slam = Slam::new(config);
    for entry in simulation.open().unwrap() {
        slam.add(&entry.unwrap(), &mut |event| {
            let Event::Step(report) = event else { return };
            steps += 1;
            let weights: f64 = report.particles.iter().map(|particle| particle.weight).sum();
            assert!((weights - 1.0).abs() < 1e-9 && report.particles.len() == 20 && report.resampled);
            assert!((1.0 - 1e-9..20.0 + 1e-9).contains(&report.effective_sample_size));
        });
    }
    let result = slam.result();
    assert!((3..15).contains(&steps), "a step each metre: {steps}");
    assert!(result.trajectory().iter().all(|stamped| stamped.pose.is_finite()) && !result.map.clusters.is_empty());
}

/// Random numbers depend on what they are for, not on who draws them.
#[test]
fn threads_change_nothing() {
    let simulation = simulation(15.0);
    let with_threads = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let config = SlamConfig { seed, ..few_maps() };
            let mut result = run(&simulation, config);
            config.smoother().smooth(&simulation, &mut result, &mut |_| {}).unwrap();
            result
        })
    };
    let same = |a: &RunResult, b: &RunResult| a.poses == b.poses && a.map == b.map;
    let one = with_threads(1, 1);
    assert!(same(&one, &with_threads(2, 1)), "two threads change the result");
    assert!(!same(&one, &with_threads(2, 2)), "the seed has no effect");
}

/// Odometry that cannot be true: the map comes out as well as with the odometry that was driven, and what was not believed
/// is counted.
#[test]
fn odometry_that_cannot_be_true_is_bridged() {
    let simulation = simulation(40.0);
    let truth = truth(&simulation);
    let entries: Vec<LogEntry> = simulation.open().unwrap().map(Result::unwrap).collect();
    let half = entries.len() / 2;
    let spoilt = |spoil: &dyn Fn(usize, Pose) -> Pose| {
        let mut slam = Slam::new(few_maps());
        for (number, entry) in entries.iter().enumerate() {
            let mut entry = entry.clone();
            match &mut entry {
                LogEntry::Odometry { odom_from_robot, .. } => *odom_from_robot = spoil(number, *odom_from_robot),
                LogEntry::Laser(reading) => reading.odom_from_robot = spoil(number, reading.odom_from_robot),
                LogEntry::Turn { .. } | LogEntry::Truth { .. } => {}
            }
            slam.add(&entry, &mut |_| {});
        }
        let result = slam.result();
        assert!(result.trajectory().iter().all(|stamped| stamped.pose.is_finite()));
        (absolute_error(&result.trajectory(), &truth), result.refused_odometry.len())
    };
    let (as_driven, refused) = spoilt(&|_, pose| pose);
    assert_eq!(refused, 0);
    let far = Pose::new(30.0, -20.0, 2.0);
    for (name, spoil, least) in [
        ("spike", &(|number, pose| if number == half { far * pose } else { pose }) as &dyn Fn(usize, Pose) -> Pose, 1),
        ("1e200", &|number, pose| if number == half { Pose { x: 1e200, ..pose } } else { pose }, 1),
        ("no number", &|number, pose| if number == half { Pose { y: f64::NAN, ..pose } } else { pose }, 1),
        ("restart", &|number, pose| if number < half { far * pose } else { pose }, 1),
    ] {
        let (error, refused) = spoilt(spoil);
        println!("seed {SEED}, {name}: {error:.4} m, as driven {as_driven:.4} m; {refused} refused");
        assert!(error < as_driven + 0.03, "seed {SEED}, {name}: {error} m, as driven {as_driven} m");
        assert!((least..least + 2).contains(&refused), "seed {SEED}, {name}: {refused} refused");
    }
}

/// The turn at each reading by a gyroscope whose bias is 0.03 rad/s, from the true poses; `spoil` changes what it says.
fn with_turns(simulation: &Simulation, spoil: impl Fn(f64, f64) -> Option<f64>) -> Vec<LogEntry> {
    let truth: Vec<_> = simulation.truth().collect();
    let heading = |stamp: f64| {
        let after = truth.partition_point(|true_pose| true_pose.stamp < stamp).clamp(1, truth.len() - 1);
        let (from, to) = (truth[after - 1], truth[after]);
        from.pose.interpolated(to.pose, (stamp - from.stamp) / (to.stamp - from.stamp)).heading
    };
    let (mut last, mut entries) = (None, Vec::new());
    for entry in simulation.open().unwrap().map(Result::unwrap) {
        let stamp = entry.stamp();
        if let Some(last) = last.filter(|_| entry.is_reading()) {
            let turn = wrap_angle(heading(stamp) - heading(last)) + 0.03 * (stamp - last);
            entries.extend(spoil(stamp, turn).map(|by_gyro| LogEntry::Turn { stamp, by_gyro }));
        }
        last = if entry.is_reading() { Some(stamp) } else { last };
        entries.push(entry);
    }
    entries
}

/// Odometry that turns half as far as the robot does: with a gyroscope the way by odometry is right again, and a gyroscope that is
/// wrong does no harm.
#[test]
fn a_gyroscope_measures_turns() {
    let simulation = simulation(60.0);
    let truth = truth(&simulation);
    let drive = |spoil: &dyn Fn(f64, f64) -> Option<f64>| {
        let (mut slam, mut odometry) = (Slam::new(few_maps()), None);
        let mut by_odometry = Pose::IDENTITY;
        for mut entry in with_turns(&simulation, spoil) {
            let pose = match &mut entry {
                LogEntry::Odometry { odom_from_robot, .. } => odom_from_robot,
                LogEntry::Laser(LaserReading { odom_from_robot, .. }) => odom_from_robot,
                LogEntry::Turn { .. } | LogEntry::Truth { .. } => {
                    slam.add(&entry, &mut |_| {});
                    continue;
                }
            };
            let moved = pose.seen_from(odometry.replace(*pose).unwrap_or(*pose));
            by_odometry = by_odometry * Pose { heading: 0.5 * moved.heading, ..moved };
            *pose = by_odometry;
            slam.add(&entry, &mut |_| {});
        }
        let result = slam.result();
        (absolute_error(&result.trajectory(), &truth), result.odometry_errors.heading, result.gyro)
    };
    let (without, heading, gyro) = drive(&|_, _| None);
    assert_eq!(gyro, None);
    let (error, better, gyro) = drive(&|_, turn| Some(turn));
    let gyro = gyro.unwrap();
    println!(
        "seed {SEED}: {error:.4} m and headings {better:.3} with a gyroscope, {without:.4} m and {heading:.3} without; {gyro:?}"
    );
    assert!((gyro.bias - 0.03).abs() < 0.005, "seed {SEED}: {gyro:?}");
    assert!(gyro.believed as f64 > 0.7 * gyro.measured as f64, "seed {SEED}: {gyro:?}");
    assert!(error < 0.1 && better < 0.5 * heading, "seed {SEED}: {error} m, {better}, without {without} m, {heading}");
    for (name, spoil) in [
        ("upside down", &(|_, turn: f64| Some(-turn)) as &dyn Fn(f64, f64) -> Option<f64>),
        ("stuck after 30 s", &|stamp, turn| Some(if stamp < 30.0 { turn } else { 0.05 })),
        ("gaps", &|stamp, turn| (stamp % 4.0 < 3.0).then_some(turn)),
        ("no numbers", &|stamp, turn| Some(if stamp % 4.0 < 3.0 { turn } else { f64::NAN })),
    ] {
        let (error, _, gyro) = drive(spoil);
        println!("seed {SEED}, {name}: {error:.4} m, {gyro:?}");
        assert!(error < without.max(0.1) + 0.03, "seed {SEED}, {name}: {error} m, {without} m without, {gyro:?}");
    }
}

/// In the room where the drive begins; in the corridor behind it nothing tells how far the robot went.
#[test]
fn without_odometry_scans_alone_tell_the_way_through_a_room() {
    let simulation = simulation(8.0);
    let truth = truth(&simulation);
    let mut slam = Slam::new(few_maps());
    for entry in simulation.open().unwrap() {
        let mut entry = entry.unwrap();
        if let LogEntry::Laser(reading) = &mut entry {
            reading.odom_from_robot = Pose::IDENTITY;
        }
        if !matches!(entry, LogEntry::Odometry { .. }) {
            slam.add(&entry, &mut |_| {});
        }
    }
    let trajectory = slam.result().trajectory();
    let error = absolute_error(&trajectory, &truth);
    let way = (trajectory[trajectory.len() - 1].pose.position() - trajectory[0].pose.position()).norm();
    println!("seed {SEED}: {error:.4} m, {way:.1} m from the start");
    assert!(error < 0.05 && way > 1.0, "seed {SEED}: {error} m, {way} m from the start");
}

/// A log in memory.
#[derive(Clone)]
struct Entries(Vec<LogEntry>);

struct EntriesReader(std::vec::IntoIter<LogEntry>, LogStats);

impl LogSource for Entries {
    fn name(&self) -> String {
        "entries".to_owned()
    }

    fn open(&self) -> Result<Box<dyn LogReader>, LogError> {
        Ok(Box::new(EntriesReader(self.0.clone().into_iter(), LogStats::default())))
    }
}

impl Iterator for EntriesReader {
    type Item = Result<LogEntry, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.0.next().map(Ok)
    }
}

impl LogReader for EntriesReader {
    fn stats(&self) -> &LogStats {
        &self.1
    }

    fn progress(&self) -> Option<(u64, u64)> {
        None
    }
}

/// Two people, round and 0.5 m wide, walk ahead of the robot to its left and right, 1.3 to 2.3 m away, all the time.
fn walk_along(entry: &mut LogEntry) {
    let LogEntry::Laser(reading) = entry else { return };
    let time = reading.stamp;
    for (bearing, rate) in [(-0.8, 0.19), (0.9, 0.23)] {
        let (bearing, distance) = (bearing + 0.4 * (time * rate).sin(), 1.8 + 0.5 * (time * 1.7 * rate).cos());
        for (beam, range) in reading.ranges.iter_mut().enumerate() {
            let off = reading.first_angle + beam as f64 * reading.angle_step - bearing;
            let (across, along) = (distance * off.sin(), distance * off.cos());
            if across.abs() < 0.25 && along > 0.0 {
                *range = range.min(along - (0.0625 - across * across).sqrt());
            }
        }
    }
}

/// Where people walked is no wall, and the walls behind them are still there.
#[test]
fn people_who_walk_along_leave_no_walls() {
    let alone = SimulationConfig { seed: SEED, duration: Some(40.0), ..SimulationConfig::default() };
    let alone = SimulationConfig { laser: Laser { people: 0.0, ..alone.laser }, ..alone };
    let simulation = Simulation::new("building".to_owned(), building(), alone).unwrap();
    let world_from_map = simulation.truth().next().unwrap().pose;
    let walls = simulation.world().walls();
    let is_wall = |cluster: &Cluster| {
        let middle = world_from_map * cluster.mean;
        walls.iter().any(|wall| distance(wall, middle) < 0.3)
    };
    let mapped = |entries: &Entries| {
        let config = few_maps();
        let mut result = Run::of(entries).run(&mut Slam::new(config), &mut [], &mut |_| true).unwrap().result;
        let in_the_way = |result: &RunResult| result.map.clusters.iter().filter(|cluster| !is_wall(cluster)).count();
        let before = in_the_way(&result);
        config.smoother().smooth(entries, &mut result, &mut |_| {}).unwrap();
        let length: f64 = result.map.clusters.iter().filter(|cluster| is_wall(cluster)).map(Cluster::length).sum();
        (before, in_the_way(&result), length, result.looked_through)
    };
    let mut entries = Entries(simulation.open().unwrap().map(Result::unwrap).collect());
    let (_, none, length, nothing) = mapped(&entries);
    entries.0.iter_mut().for_each(walk_along);
    let (before, after, length_behind, people) = mapped(&entries);
    println!(
        "seed {SEED}: {before} clusters in the way, then {after}; {length_behind:.1} m of wall, alone {length:.1} m"
    );
    assert!(none == 0 && before > 20, "seed {SEED}: {none} without people, {before} with them");
    // What only scans from one side saw, along which they cannot look, may be left.
    assert!(4 * after <= before, "seed {SEED}: {after} clusters where people walked, of {before}");
    // Two people fill a fifth of the view, and a part of them is where scans look again.
    assert!(
        nothing < 0.02 && people > 0.03,
        "seed {SEED}: {nothing} looked through without people, {people} with them"
    );
    assert!(length_behind > 0.9 * length, "seed {SEED}: {length_behind} m of wall, alone {length} m");
}

fn distance(wall: &Wall, point: Point2<f64>) -> f64 {
    let along = wall.b - wall.a;
    let share = ((point - wall.a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    (point - (wall.a + along * share)).norm()
}
