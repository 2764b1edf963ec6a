//! The simulator against closed forms: ray casting, the drive, the noise of odometry and laser, and repeatability.
use ipslam::geometry::{Pose, wrap_angle};
use ipslam::log::{LaserReading, LogEntry, LogSource as _};
use ipslam::scan::{Scan, ScanConfig};
use ipslam::simulate::{
    Laser, OdometryNoise, Plan, Simulation, SimulationConfig, Step, Wall, World, building, random_offices,
};
use nalgebra::{Point2, Vector2};
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

fn unit(angle: f64) -> Vector2<f64> {
    Vector2::new(angle.cos(), angle.sin())
}

fn outline(corners: &[(f64, f64)]) -> Vec<Wall> {
    let corner = |index: usize| Point2::new(corners[index % corners.len()].0, corners[index % corners.len()].1);
    (0..corners.len()).map(|index| Wall { a: corner(index), b: corner(index + 1) }).collect()
}

fn rectangle(width: f64, height: f64) -> Vec<Wall> {
    outline(&[(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])
}

/// The closed form: from inside a rectangle a beam leaves by the nearer of the two sides that it heads for.
fn distance_in_rectangle(width: f64, height: f64, from: Point2<f64>, ahead: Vector2<f64>) -> f64 {
    let side = |at: f64, length: f64, speed: f64| if speed > 0.0 { (length - at) / speed } else { -at / speed };
    let x = if ahead.x == 0.0 { f64::INFINITY } else { side(from.x, width, ahead.x) };
    let y = if ahead.y == 0.0 { f64::INFINITY } else { side(from.y, height, ahead.y) };
    x.min(y)
}

/// Brute force by another formula: in a frame along the ray, a wall is met where its ends lie on different sides.
fn distance_by_brute_force(walls: &[Wall], from: Point2<f64>, angle: f64) -> Option<f64> {
    let (sin, cos) = angle.sin_cos();
    let in_ray = |p: Point2<f64>| {
        let (x, y) = (p.x - from.x, p.y - from.y);
        (cos * x + sin * y, -sin * x + cos * y)
    };
    let meets = walls.iter().filter_map(|wall| {
        let ((along_a, across_a), (along_b, across_b)) = (in_ray(wall.a), in_ray(wall.b));
        (across_a * across_b < 0.0).then(|| along_a + (along_b - along_a) * across_a / (across_a - across_b))
    });
    meets.filter(|&along| along >= 0.0).reduce(f64::min)
}

proptest! {
    #[test]
    fn rays_in_a_rectangle(
        width in 0.5..80.0, height in 0.5..80.0, x in 0.01..0.99, y in 0.01..0.99, angle in -PI..PI, quarter in 0..8,
    ) {
        // Half of the rays run along an axis.
        let angle = if quarter < 4 { f64::from(quarter) * PI / 2.0 } else { angle };
        let (from, ahead) = (Point2::new(x * width, y * height), unit(angle));
        let expected = distance_in_rectangle(width, height, from, ahead);
        let cast = World::new(rectangle(width, height)).cast(from, ahead, 1000.0).unwrap();
        prop_assert!((cast - expected).abs() < 1e-9, "{cast} is not {expected}");
        let other = World::new(rectangle(width * 1.001, height * 1.001)).cast(from, ahead, 1000.0).unwrap();
        prop_assert!((other - expected).abs() > 1e-9 || ahead.x < 0.0 || ahead.y < 0.0, "{other} of a larger room");
        prop_assert_eq!(World::new(rectangle(width, height)).cast(from, ahead, 0.999 * expected), None);
    }

    #[test]
    fn the_grid_finds_what_brute_force_finds(
        walls in proptest::collection::vec((-30.0..30.0, -30.0..30.0, -PI..PI, 0.0..3.0f64), 0..120),
        rays in proptest::collection::vec((-60.0..60.0, -60.0..60.0, -PI..PI), 40),
        stretch in prop_oneof![Just(1.0), Just(300.0)],
    ) {
        // Lengths from 5 cm to a kilometre; stretched, the world is wider than the grid has metre cells.
        let walls: Vec<Wall> = walls.iter().map(|&(x, y, angle, size)| {
            let a = Point2::new(x * stretch, y);
            Wall { a, b: a + unit(angle) * 0.05 * 10f64.powf(1.43 * size) }
        }).collect();
        let world = World::new(walls.clone());
        for (x, y, angle) in rays {
            let from = Point2::new(x * stretch, y);
            let expected = distance_by_brute_force(&walls, from, angle);
            let cast = world.cast(from, unit(angle), f64::INFINITY);
            match (cast, expected) {
                (None, None) => {}
                (Some(cast), Some(expected)) => prop_assert!((cast - expected).abs() < 1e-6, "{cast} is not {expected}"),
                _ => prop_assert!(false, "{cast:?} is not {expected:?} from {from} at {angle}"),
            }
        }
    }

    #[test]
    fn rays_in_a_circle(angle in -PI..PI, along in 0.0..0.5, at in -PI..PI) {
        let (radius, count) = (3.0, 720);
        let corner = |k: usize| (radius * (TAU * k as f64 / count as f64).cos(), radius * (TAU * k as f64 / count as f64).sin());
        let world = World::new(outline(&(0..count).map(corner).collect::<Vec<_>>()));
        let (from, ahead) = (Point2::from(unit(at) * along * radius), unit(angle));
        let b = from.coords.dot(&ahead);
        let expected = -b + (b * b + radius * radius - from.coords.norm_squared()).sqrt();
        let cast = world.cast(from, ahead, 100.0).unwrap();
        // The polygon lies inside the circle by at most the sagitta, met at no more than asin(1/2) from the normal.
        let tolerance = radius * (1.0 - (PI / count as f64).cos()) / 0.75f64.sqrt();
        prop_assert!(cast < expected + 1e-9 && cast > expected - 1.01 * tolerance, "{cast} is not {expected} - {tolerance}");
    }
}

#[test]
fn rays_that_leave_the_world_meet_nothing() {
    let world = World::new(outline(&[(0.0, 0.0), (2.0, 0.0), (2.0, 1.0)]));
    assert_eq!(world.cast(Point2::new(3.0, 0.5), unit(0.0), 100.0), None);
    assert_eq!(world.cast(Point2::new(-1.0, 5.0), unit(0.3), 100.0), None);
    assert!((world.cast(Point2::new(5.0, 0.5), unit(PI), 100.0).unwrap() - 3.0).abs() < 1e-12);
    assert_eq!(World::new(vec![]).cast(Point2::origin(), unit(1.0), 100.0), None);
    assert_eq!(world.cast(Point2::new(f64::NAN, 0.0), unit(1.0), 100.0), None);
}

/// A robot that circles in an empty room with the given corner, without people and dropouts.
fn in_room(width: f64, height: f64, laser: Laser, odometry: OdometryNoise, duration: f64) -> Simulation {
    let at = |x: f64, y: f64| Point2::new(x * width, y * height);
    let tour = vec![at(0.4, 0.4), at(0.6, 0.4), at(0.6, 0.6), at(0.4, 0.6), at(0.4, 0.4)];
    let config = SimulationConfig { seed: 5, laser, odometry, duration: Some(duration) };
    Simulation::new("room".to_owned(), Plan { walls: rectangle(width, height), tour, ..Plan::default() }, config)
        .unwrap()
}

fn entries(simulation: &Simulation) -> Vec<LogEntry> {
    simulation.open().unwrap().map(Result::unwrap).collect()
}

fn sweeps(simulation: &Simulation) -> Vec<(LaserReading, Pose)> {
    let mut readings = Vec::new();
    let mut truths = Vec::new();
    for entry in entries(simulation) {
        match entry {
            LogEntry::Laser(reading) => readings.push(reading),
            LogEntry::Truth { world_from_robot, stamp } => {
                assert_eq!(readings.last().map(|reading| reading.stamp), Some(stamp));
                truths.push(world_from_robot);
            }
            LogEntry::Odometry { .. } | LogEntry::Turn { .. } => {}
        }
    }
    assert_eq!(readings.len(), truths.len());
    readings.into_iter().zip(truths).collect()
}

fn offices(seed: u64, width: f64, height: f64) -> Simulation {
    let plan = random_offices(seed, width, height).unwrap();
    Simulation::new("random".to_owned(), plan, SimulationConfig { seed, ..SimulationConfig::default() }).unwrap()
}

/// Whether two stretches cross: the ends of each lie on different sides of the other.
fn cross(a: Point2<f64>, b: Point2<f64>, wall: &Wall) -> bool {
    let side = |from: Point2<f64>, to: Point2<f64>, p: Point2<f64>| (to - from).perp(&(p - from));
    side(a, b, wall.a) * side(a, b, wall.b) < 0.0 && side(wall.a, wall.b, a) * side(wall.a, wall.b, b) < 0.0
}

fn distance_to_wall(point: Point2<f64>, wall: &Wall) -> f64 {
    let along = wall.b - wall.a;
    let share = ((point - wall.a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    (wall.a + along * share - point).norm()
}

/// How often a path, moved by an offset, crosses a wall.
fn crossings(simulation: &Simulation, offset: Vector2<f64>) -> usize {
    let path: Vec<_> = simulation.steps().map(|step| step.world_from_robot.position() + offset).collect();
    path.windows(2).flat_map(|leg| simulation.world().walls().iter().filter(|wall| cross(leg[0], leg[1], wall))).count()
}

fn clearance(simulation: &Simulation) -> f64 {
    let path = simulation.steps().step_by(3).map(|step| step.world_from_robot.position());
    let nearest =
        path.flat_map(|point| simulation.world().walls().iter().map(move |wall| distance_to_wall(point, wall)));
    nearest.fold(f64::INFINITY, f64::min)
}

#[test]
fn no_drive_goes_through_a_wall() {
    let mut drives = vec![("building".to_owned(), Simulation::building(1))];
    for seed in 0..20 {
        let (width, height) = (16.0 + 3.0 * seed as f64, 45.0 - 1.4 * seed as f64);
        drives.push((format!("random, seed {seed}, {width} x {height}"), offices(seed, width, height)));
    }
    for (name, drive) in drives {
        assert_eq!(crossings(&drive, Vector2::zeros()), 0, "{name}");
        let clearance = clearance(&drive);
        assert!(clearance > 0.25, "{name}: the robot comes within {clearance} m of a wall");
        assert!(crossings(&drive, Vector2::new(1.3, 1.3)) > 0, "{name}: a path beside the corridor crosses nothing");
    }
}

#[test]
fn the_drive_is_smooth_and_closes() {
    for drive in [Simulation::building(1), offices(3, 60.0, 40.0)] {
        let steps: Vec<Step> = drive.steps().collect();
        assert!(steps.len() > 1000);
        for pair in steps.windows(2) {
            let [before, after] = [pair[0], pair[1]];
            assert!((0.0..=0.1).contains(&after.distance), "{after:?} is faster than 1 m/s");
            assert!(after.turn.abs() <= 0.1 + 1e-12, "{after:?} turns faster than 1 rad/s");
            assert!(
                (after.distance - before.distance).abs() <= 0.008 + 1e-12,
                "{before:?} to {after:?}: above 0.8 m/s²"
            );
            assert!((after.turn - before.turn).abs() <= 0.03 + 1e-12, "{before:?} to {after:?}: above 3 rad/s²");
            let moved = after.world_from_robot.seen_from(before.world_from_robot);
            assert!((wrap_angle(moved.heading - after.turn)).abs() < 1e-9);
            // The chord of the arc.
            let chord = after.distance * (1.0 - after.turn * after.turn / 24.0);
            assert!((moved.position().coords.norm() - chord).abs() < 1e-6, "{before:?} to {after:?}");
        }
        let (first, last) = (steps[0].world_from_robot, steps[steps.len() - 1].world_from_robot);
        assert!((first.position() - last.position()).norm() < 1.0, "{first:?} {last:?}");
    }
}

#[test]
fn the_building_has_loops_and_revisits() {
    let drive = Simulation::building(1);
    let truth: Vec<_> = drive.truth().collect();
    let seconds = truth[truth.len() - 1].stamp;
    assert!((250.0..350.0).contains(&seconds), "{seconds} s");
    let length = drive.steps().map(|step| step.distance).sum::<f64>();
    assert!((0.6..1.0).contains(&(length / seconds)), "{length} m in {seconds} s");
    // The first way round: the robot comes back to a place after at least 80 m.
    let near = |a: Pose, b: Pose| (a.position() - b.position()).norm() < 0.5;
    let mut driven = 0.0;
    let mut back = None;
    for step in drive.steps() {
        driven += step.distance;
        if driven > 80.0 && near(step.world_from_robot, truth[0].pose) {
            back = Some(driven);
            break;
        }
    }
    assert!(back.is_some_and(|driven| driven < 130.0), "{back:?}");
    let revisits =
        truth.iter().filter(|now| truth.iter().any(|then| now.stamp > then.stamp + 30.0 && near(now.pose, then.pose)));
    let share = revisits.count() as f64 / truth.len() as f64;
    assert!(share > 0.3, "{share} of the drive sees a place again");
    let walls = drive.world().walls();
    let reach = walls.iter().fold(Vector2::zeros(), |reach: Vector2<f64>, wall| reach.sup(&wall.a.coords));
    assert!((reach - Vector2::new(42.5, 30.0)).norm() < 0.3, "{reach}");
}

#[test]
fn raw_odometry_drifts_by_metres() {
    for seed in 0..8 {
        let off: Vec<f64> = sweeps(&Simulation::building(seed))
            .iter()
            .map(|(reading, truth)| (reading.odom_from_robot.position() - truth.position()).norm())
            .collect();
        let largest = off.iter().copied().fold(0.0, f64::max);
        assert!(off[0] == 0.0 && (1.5..30.0).contains(&largest), "seed {seed}: {largest} m");
    }
    let config = SimulationConfig { odometry: OdometryNoise::default().scaled(0.0), ..SimulationConfig::default() };
    let perfect = Simulation::new("perfect".to_owned(), building(), config).unwrap();
    for (reading, truth) in sweeps(&perfect) {
        assert!((reading.odom_from_robot.position() - truth.position()).norm() < 1e-9);
    }
}

/// Distance and turn of the arc between two poses.
fn reported(before: Pose, after: Pose) -> (f64, f64) {
    let moved = after.seen_from(before);
    let half = 0.5 * moved.heading;
    let chord = moved.x * half.cos() + moved.y * half.sin();
    (if half.abs() < 1e-9 { chord } else { chord * half / half.sin() }, moved.heading)
}

/// Mean and variance, with the spread of each for that many normal numbers.
fn moments(numbers: &[f64]) -> (f64, f64) {
    let n = numbers.len() as f64;
    let mean = numbers.iter().sum::<f64>() / n;
    (mean, numbers.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / n)
}

fn standard_normal(numbers: &[f64]) -> bool {
    let n = numbers.len() as f64;
    let (mean, variance) = moments(numbers);
    mean.abs() < 5.0 / n.sqrt() && (variance - 1.0).abs() < 5.0 * (2.0 / n).sqrt()
}

#[test]
fn odometry_noise_has_its_moments() {
    // Biases large enough that leaving one out cannot hide in the noise of 30 000 steps.
    let noise = OdometryNoise { distance_bias: 0.03, turn_bias: -0.2, veer: 0.01, ..OdometryNoise::default() };
    let laser = Laser { beams: 2, ..Laser::default() };
    let simulation = in_room(20.0, 20.0, laser, noise, 3000.0);
    let odometry: Vec<Pose> = entries(&simulation)
        .iter()
        .filter_map(|entry| match entry {
            LogEntry::Odometry { odom_from_robot, .. } => Some(*odom_from_robot),
            _ => None,
        })
        .collect();
    let steps: Vec<Step> = simulation.steps().collect();
    assert_eq!((odometry.len(), steps.len()), (30_001, 30_001));
    // Normalised residuals of a step, were the odometry's errors as the argument says.
    let residuals = |noise: OdometryNoise| {
        let each = odometry.windows(2).zip(&steps[1..]).filter(|(_, step)| step.distance > 0.01).map(|(pair, step)| {
            let (distance, turn) = reported(pair[0], pair[1]);
            let turn_spread =
                (noise.turn_spread.powi(2) * step.turn.abs() + noise.veer_spread.powi(2) * step.distance).sqrt();
            (
                (distance - step.distance * (1.0 + noise.distance_bias))
                    / (noise.distance_spread * step.distance.sqrt()),
                (turn - step.turn * (1.0 + noise.turn_bias) - noise.veer * step.distance) / turn_spread,
            )
        });
        each.unzip::<f64, f64, Vec<f64>, Vec<f64>>()
    };
    let (distance, turn) = residuals(noise);
    assert!(distance.len() > 20_000);
    assert!(standard_normal(&distance), "seed 5: {:?}", moments(&distance));
    assert!(standard_normal(&turn), "seed 5: {:?}", moments(&turn));

    assert!(!standard_normal(&residuals(OdometryNoise { distance_bias: 0.0, ..noise }).0));
    assert!(!standard_normal(&residuals(OdometryNoise { distance_spread: 0.032, ..noise }).0));
    assert!(!standard_normal(&residuals(OdometryNoise { turn_bias: 0.0, ..noise }).1));
    assert!(!standard_normal(&residuals(OdometryNoise { veer: 0.0, ..noise }).1));
    assert!(!standard_normal(&residuals(OdometryNoise { turn_spread: 0.033, ..noise }).1));
    assert!(!standard_normal(&residuals(OdometryNoise { veer_spread: 0.011, ..noise }).1));
}

#[test]
fn ranges_have_their_noise() {
    let laser = Laser { dropouts: 0.0, people: 0.0, ..Laser::default() };
    let (width, height) = (14.0, 9.0);
    let simulation = in_room(width, height, laser, OdometryNoise::default(), 100.0);
    let mut residuals = Vec::new();
    for (reading, truth) in sweeps(&simulation) {
        assert_eq!(reading.ranges.len(), 361);
        let eye = truth.position() + truth.direction() * 0.1;
        for (beam, range) in reading.ranges.iter().enumerate() {
            let ahead = unit(truth.heading + (beam as f64 * 0.5 - 90.0).to_radians());
            residuals.push(range - distance_in_rectangle(width, height, eye, ahead));
        }
    }
    assert_eq!(residuals.len(), 501 * 361);
    let scaled = |sigma: f64| residuals.iter().map(|residual| residual / sigma).collect::<Vec<_>>();
    assert!(standard_normal(&scaled(0.015)), "seed 5: {:?}", moments(&scaled(0.015)));
    assert!(!standard_normal(&scaled(0.0155)));
}

#[test]
fn dropouts_and_people_come_as_often_as_asked() {
    // Far walls, so that nobody stands behind one.
    let laser = Laser { range_noise: 0.0, ..Laser::default() };
    let simulation = in_room(60.0, 60.0, laser, OdometryNoise::default(), 400.0);
    let all = sweeps(&simulation);
    let count = all.len() as f64;
    let lost = all.iter().flat_map(|(reading, _)| &reading.ranges).filter(|&&range| range == 81.91).count() as f64;
    let peopled = all.iter().filter(|(reading, _)| reading.ranges.iter().any(|&range| range < 4.5)).count() as f64;
    let nearest = all.iter().flat_map(|(reading, _)| &reading.ranges).copied().fold(f64::INFINITY, f64::min);
    for (what, hits, n, share) in [("dropouts", lost, count * 361.0, 0.01), ("people", peopled, count, 0.1)] {
        let tolerance = 5.0 * (share * (1.0 - share) / n).sqrt();
        assert!((hits / n - share).abs() < tolerance, "{what}, seed 5: {} is not {share} ± {tolerance}", hits / n);
    }
    assert!((0.6..1.0).contains(&nearest), "the nearest person stands {nearest} m away");
}

#[test]
fn the_laser_is_the_one_asked_for() {
    let laser = Laser {
        beams: 5,
        field_of_view: 1.5 * PI,
        max_range: 6.0,
        range_noise: 0.0,
        dropouts: 0.0,
        people: 0.0,
        robot_from_laser: Pose::new(-0.2, 0.1, 0.3),
    };
    let simulation = in_room(20.0, 12.0, laser, OdometryNoise::default(), 30.0);
    let mut no_returns = 0;
    for (reading, truth) in sweeps(&simulation) {
        assert_eq!((reading.ranges.len(), reading.max_range), (5, 6.0));
        assert_eq!(reading.robot_from_laser, laser.robot_from_laser);
        let eye = truth * Point2::new(-0.2, 0.1);
        for (beam, &range) in reading.ranges.iter().enumerate() {
            assert!(
                (reading.first_angle + reading.angle_step * beam as f64 - 0.375 * PI * (beam as f64 - 2.0)).abs()
                    < 1e-12
            );
            let ahead = unit(truth.heading + 0.3 + 0.375 * PI * (beam as f64 - 2.0));
            let expected = distance_in_rectangle(20.0, 12.0, eye, ahead).min(6.0);
            assert!((range - expected).abs() < 0.00051, "{range} is not {expected}");
            no_returns += usize::from(range == 6.0);
        }
    }
    assert!(no_returns > 0);
}

/// Share of the measured points that lie within five standard deviations (and half a millimetre) of a wall, where the
/// robot is believed to stand at its true pose moved by `error`.
fn share_on_walls(simulation: &Simulation, error: Pose) -> f64 {
    let (mut on, mut all) = (0, 0);
    for (reading, truth) in sweeps(simulation).iter().step_by(40) {
        for point in Scan::from_reading(reading, &ScanConfig { min_range: 0.0, max_range: 80.0 }).points {
            let point = *truth * error * point;
            all += 1;
            on += usize::from(
                simulation.world().walls().iter().any(|wall| distance_to_wall(point, wall) < 5.0 * 0.015 + 0.0005),
            );
        }
    }
    assert!(all > 10_000);
    f64::from(on as u32) / f64::from(all as u32)
}

#[test]
fn points_seen_from_the_true_pose_lie_on_walls() {
    for simulation in [Simulation::building(2), offices(6, 40.0, 30.0)] {
        let share = share_on_walls(&simulation, Pose::IDENTITY);
        assert!(share > 0.95, "{share}");
        for error in [Pose::new(0.2, 0.0, 0.0), Pose::new(0.0, 0.2, 0.0), Pose::new(0.0, 0.0, 0.1)] {
            let share = share_on_walls(&simulation, error);
            assert!(share < 0.95, "{share} at {error:?}");
        }
    }
}

#[test]
fn a_seed_names_a_log() {
    let (once, again, other) = (Simulation::building(1), Simulation::building(1), Simulation::building(2));
    let log = entries(&once);
    assert!(log == entries(&once), "reading again changed the log");
    assert!(log == entries(&again), "the same seed made another log");
    let differing = log.iter().zip(entries(&other)).skip(1).filter(|(a, b)| *a != b);
    let counts = differing.fold((0, 0, 0), |(odometry, laser, truth), (entry, _)| match entry {
        LogEntry::Odometry { .. } => (odometry + 1, laser, truth),
        LogEntry::Laser(_) => (odometry, laser + 1, truth),
        LogEntry::Truth { .. } => (odometry, laser, truth + 1),
        LogEntry::Turn { .. } => (odometry, laser, truth),
    });
    let sweeps = once.sweeps() as usize;
    // Odometry at the start is the true pose; from the first sweep on, everything but the truth is noise.
    assert_eq!((counts.1, counts.2), (sweeps, 0));
    assert!(counts.0 > sweeps);
    let walls = |seed| random_offices(seed, 30.0, 30.0).unwrap().walls;
    assert_eq!(walls(1), walls(1));
    assert_ne!(walls(1), walls(2));
}

#[test]
fn the_log_is_in_order_and_as_long_as_it_says() {
    let simulation = Simulation::building(1);
    assert_eq!(simulation.name(), "building");
    let mut reader = simulation.open().unwrap();
    let (_, all) = reader.progress().unwrap();
    assert_eq!(reader.progress(), Some((0, all)));
    let mut log = Vec::new();
    for entry in reader.by_ref() {
        log.push(entry.unwrap());
    }
    assert_eq!(reader.progress(), Some((all, all)));
    assert_eq!(log.len() as u64, all);
    assert_eq!(reader.stats().laser, simulation.sweeps());
    assert_eq!(reader.stats().odometry + 2 * reader.stats().laser, all);
    let stamps: Vec<f64> = log.iter().map(LogEntry::stamp).collect();
    assert_eq!(stamps[0], 0.0);
    assert!(stamps.windows(2).all(|pair| (0.0..0.1001).contains(&(pair[1] - pair[0]))));
    let truth: Vec<Pose> = sweeps(&simulation).into_iter().map(|(_, truth)| truth).collect();
    assert_eq!(truth, simulation.truth().map(|stamped| stamped.pose).collect::<Vec<_>>());
}

#[test]
fn a_duration_cuts_or_repeats_the_tour() {
    let drive = |duration| {
        let laser = Laser { beams: 2, ..Laser::default() };
        let config = SimulationConfig { duration, laser, ..SimulationConfig::default() };
        Simulation::new("building".to_owned(), building(), config).unwrap()
    };
    let (once, short, long) = (drive(None), drive(Some(60.0)), drive(Some(700.0)));
    assert_eq!(short.sweeps(), 301);
    assert_eq!(entries(&short)[..], entries(&once)[..entries(&short).len()]);
    assert_eq!(long.truth().last().map(|last| last.stamp), Some(700.0));
    assert_eq!(crossings(&long, Vector2::zeros()), 0);
}

#[test]
fn absurd_options_are_refused_by_name() {
    let (laser, odometry) = (Laser::default(), OdometryNoise::default());
    let with_laser = |laser| SimulationConfig { laser, ..SimulationConfig::default() };
    let with_odometry = |odometry| SimulationConfig { odometry, ..SimulationConfig::default() };
    let bad = [
        ("beams", with_laser(Laser { beams: 0, ..laser })),
        ("beams", with_laser(Laser { beams: usize::MAX, ..laser })),
        ("field of view", with_laser(Laser { field_of_view: 7.0, ..laser })),
        ("field of view", with_laser(Laser { field_of_view: f64::NAN, ..laser })),
        ("field of view", with_laser(Laser { field_of_view: 0.0, ..laser })),
        ("maximum range", with_laser(Laser { max_range: f64::INFINITY, ..laser })),
        ("range noise", with_laser(Laser { range_noise: -0.1, ..laser })),
        ("dropouts", with_laser(Laser { dropouts: 1.5, ..laser })),
        ("people", with_laser(Laser { people: f64::NAN, ..laser })),
        ("pose of the laser", with_laser(Laser { robot_from_laser: Pose::new(f64::NAN, 0.0, 0.0), ..laser })),
        ("distance spread", with_odometry(OdometryNoise { distance_spread: -1.0, ..odometry })),
        ("veer", with_odometry(OdometryNoise { veer: f64::INFINITY, ..odometry })),
        ("duration", SimulationConfig { duration: Some(-1.0), ..SimulationConfig::default() }),
        ("duration", SimulationConfig { duration: Some(1e12), ..SimulationConfig::default() }),
    ];
    for (what, config) in bad {
        let error = Simulation::new("bad".to_owned(), building(), config).unwrap_err().to_string();
        assert!(error.contains(what) && error.contains("has to be"), "{error:?} does not name {what}");
    }
    for (width, height) in [(15.0, 40.0), (40.0, 1e9), (f64::NAN, 40.0), (40.0, -3.0)] {
        let error = random_offices(1, width, height).unwrap_err().to_string();
        assert!(error.contains("building") && error.contains("16 to 1000 m"), "{error}");
    }
    let tour = |points: &[(f64, f64)]| points.iter().map(|&(x, y)| Point2::new(x, y)).collect::<Vec<_>>();
    let tours =
        [vec![], tour(&[(1.0, 1.0)]), tour(&[(0.0, 0.0), (0.1, 0.0), (0.0, 0.0)]), tour(&[(0.0, 0.0), (9.0, 0.0)])];
    for tour in tours {
        let plan = Plan { walls: rectangle(10.0, 10.0), tour, ..Plan::default() };
        let error = Simulation::new("bad".to_owned(), plan, SimulationConfig::default()).unwrap_err().to_string();
        assert!(error.contains("tour"), "{error}");
    }
    let plan = Plan { walls: rectangle(f64::NAN, 10.0), ..building() };
    assert!(Simulation::new("bad".to_owned(), plan, SimulationConfig::default()).is_err());
}
