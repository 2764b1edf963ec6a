//! Harder logs: each kind of damage does what its name says, computed a second time from the readings before and after.
use ipslam::geometry::Pose;
use ipslam::io::carmen::CarmenWriter;
use ipslam::log::{LaserReading, LogEntry};
use ipslam::simulate::Damage;
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};

/// Seconds between scans.
const PERIOD: f64 = 0.25;
const RANGE: f64 = 6.0;
const NO_RETURN: f64 = 80.0;

/// A drive with an odometry reading and the truth before each; the last beam does not return.
fn drive(scans: usize) -> Vec<LogEntry> {
    let mut pose = Pose::new(3.0, -2.0, 1.0);
    let mut entries = Vec::new();
    for scan in 0..scans {
        let stamp = PERIOD * scan as f64;
        pose = pose * Pose::new(0.2, 0.01, 0.1 * (0.05 * scan as f64).sin());
        entries.push(LogEntry::Odometry { stamp: stamp - 0.1, odom_from_robot: pose });
        entries.push(LogEntry::Truth { stamp, world_from_robot: pose });
        let mut ranges = vec![RANGE; 181];
        ranges[180] = NO_RETURN;
        entries.push(LogEntry::Laser(LaserReading {
            stamp,
            odom_from_robot: pose,
            robot_from_laser: Pose::IDENTITY,
            start_from_end: Pose::IDENTITY,
            first_angle: -FRAC_PI_2,
            angle_step: PI / 180.0,
            max_range: NO_RETURN,
            ranges,
        }));
    }
    entries
}

/// Stamp, odometry and, where the scan was kept, its ranges.
type Reading = (f64, Pose, Option<Vec<f64>>);

fn readings(entries: &[LogEntry]) -> Vec<Reading> {
    let reading = |entry: &LogEntry| match entry {
        LogEntry::Odometry { stamp, odom_from_robot } => Some((*stamp, *odom_from_robot, None)),
        LogEntry::Laser(reading) => Some((reading.stamp, reading.odom_from_robot, Some(reading.ranges.clone()))),
        LogEntry::Turn { .. } | LogEntry::Truth { .. } => None,
    };
    entries.iter().filter_map(reading).collect()
}

/// The scans of a drive before and after; stamps and truth are as they were.
fn both(damage: Damage, seed: u64, scans: usize) -> (Vec<Reading>, Vec<Reading>) {
    let before: Vec<LogEntry> =
        drive(scans).into_iter().filter(|entry| !matches!(entry, LogEntry::Odometry { .. })).collect();
    let after = damage.apply(drive(scans), seed).unwrap();
    let truth =
        |entries: &[LogEntry]| -> Vec<_> { entries.iter().filter(|entry| !entry.is_reading()).cloned().collect() };
    assert_eq!(truth(&before), truth(&after));
    let (before, after) = (readings(&before), readings(&after));
    assert!(before.iter().map(|reading| reading.0).eq(after.iter().map(|reading| reading.0)));
    (before, after)
}

fn motions(readings: &[Reading]) -> Vec<Pose> {
    readings.windows(2).map(|pair| pair[1].1.seen_from(pair[0].1)).collect()
}

fn is_near(a: Pose, b: Pose) -> bool {
    let off = a.seen_from(b);
    off.x.abs().max(off.y.abs()).max(off.heading.abs()) < 1e-9
}

/// Stretches of successive numbers.
fn stretches(numbers: impl IntoIterator<Item = usize>) -> Vec<Vec<usize>> {
    let mut stretches: Vec<Vec<usize>> = Vec::new();
    for number in numbers {
        match stretches.last_mut().filter(|stretch| stretch.last() == Some(&(number - 1))) {
            Some(stretch) => stretch.push(number),
            None => stretches.push(vec![number]),
        }
    }
    stretches
}

/// Mean and standard deviation.
fn moments(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (mean, (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt())
}

/// Values that should be normal with mean 0 and this deviation, within five of their standard errors.
fn assert_normal(values: &[f64], sigma: f64) {
    let ((mean, std), root) = (moments(values), (values.len() as f64).sqrt());
    assert!(mean.abs() < 5.0 * sigma / root, "mean {mean}, not 0, where σ is {sigma}");
    assert!((std / sigma - 1.0).abs() < 5.0 / (root * 2f64.sqrt()), "σ is {std}, not {sigma}");
}

const NONE: fn() -> Damage = Damage::default;

#[test]
fn without_damage_scans_are_as_they_were() {
    let (before, after) = both(NONE(), 1, 50);
    assert!(before.iter().zip(&after).all(|(a, b)| is_near(a.1, b.1) && a.2 == b.2));
    assert_eq!(NONE().apply(Vec::new(), 1).unwrap(), []);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn odometry_is_scaled(distance in 0.2..5.0, turn in 0.2..5.0) {
        let (before, after) = both(Damage { scale_distance: distance, scale_turn: turn, ..NONE() }, 1, 60);
        for (a, b) in motions(&before).into_iter().zip(motions(&after)) {
            prop_assert!(is_near(Pose::new(distance * a.x, distance * a.y, turn * a.heading), b));
            prop_assert!(is_near(a, b) == ((distance - 1.0).abs() < 1e-9));
        }
    }

    #[test]
    fn wheels_spin_and_signs_are_lost(seed: u64, count in 1u32..6) {
        let (before, after) = both(Damage { slip: count, ..NONE() }, seed, 600);
        let (a, b) = (motions(&before), motions(&after));
        let spun = stretches((0..a.len()).filter(|&i| !is_near(a[i], b[i])));
        prop_assert_eq!(spun.len(), count as usize);
        for stretch in spun {
            prop_assert!(stretch.len() <= 8, "2 s at 4 scans a second");
            let turn: f64 = stretch.iter().map(|&i| b[i].heading - a[i].heading).sum();
            prop_assert!((turn - 0.3).abs() < 1e-9);
            prop_assert!(stretch.iter().all(|&i| (b[i].x - 1.5 * a[i].x).hypot(b[i].y - 1.5 * a[i].y) < 1e-9));
        }

        let (before, after) = both(Damage { backwards: count, ..NONE() }, seed, 600);
        let (a, b) = (motions(&before), motions(&after));
        let lost = stretches((0..a.len()).filter(|&i| !is_near(a[i], b[i])));
        prop_assert_eq!(lost.len(), count as usize);
        prop_assert!(lost.iter().all(|stretch| stretch.len() <= 8));
        for i in lost.into_iter().flatten() {
            prop_assert!(is_near(Pose::new(-a[i].x, -a[i].y, -a[i].heading), b[i]));
        }
    }

    #[test]
    fn odometry_jumps_and_starts_again(seed: u64, count in 1u32..6) {
        let (before, after) = both(Damage { spike: count, ..NONE() }, seed, 600);
        let off: Vec<Pose> = before.iter().zip(&after).map(|(a, b)| b.1.seen_from(a.1)).collect();
        let spikes: Vec<&Pose> = off.iter().filter(|off| off.x.abs() > 1e-6).collect();
        prop_assert_eq!(spikes.len(), count as usize);
        prop_assert!(spikes.iter().all(|off| (off.x.hypot(off.y) - 5.0).abs() < 1e-6 && (off.heading - 1.0).abs() < 1e-6));

        let (before, after) = both(Damage { reset: count, ..NONE() }, seed, 600);
        let resets = (1..600).filter(|&i| after[i].1 == Pose::IDENTITY).count();
        prop_assert_eq!(resets, count as usize);
        for (i, (a, b)) in motions(&before).into_iter().zip(motions(&after)).enumerate() {
            prop_assert!(is_near(a, b) != (after[i + 1].1 == Pose::IDENTITY));
        }
    }

    #[test]
    fn odometry_lags(late in 0.01..3.0) {
        let (before, after) = both(Damage { late, ..NONE() }, 1, 100);
        for (stamp, pose, _) in after {
            let then = (stamp - late).max(0.0) / PERIOD;
            let (from, to) = (before[then.floor() as usize].1, before[then.ceil() as usize].1);
            let share = then.fract();
            prop_assert!((pose.x - from.x * (1.0 - share) - to.x * share).abs() < 1e-9);
            prop_assert!((pose.y - from.y * (1.0 - share) - to.y * share).abs() < 1e-9);
        }
    }

    #[test]
    fn scans_are_left_out(seed: u64, skip in 1u32..9, blank in 0u32..4, distance in 0.0..2.0, turn in 0.0..1.0) {
        let sparse = Damage { sparse_distance: distance, sparse_turn: turn, ..NONE() };
        let (before, after) = both(Damage { skip, blank, ..sparse }, seed, 900);
        // Odometry is as it was, also where the scan is gone.
        prop_assert!(before.iter().zip(&after).all(|(a, b)| is_near(a.1, b.1)));

        let mut last: Option<Pose> = None;
        let far = |i: &usize| {
            let motion = last.map(|last| before[*i].1.seen_from(last));
            let is_far = motion.is_none_or(|m| m.x.hypot(m.y) >= distance || m.heading.abs() >= turn);
            last = if is_far { Some(before[*i].1) } else { last };
            is_far
        };
        let far: Vec<usize> = (0..900).filter(far).collect();
        let kept = |damage: Damage| -> Vec<usize> {
            let after = both(damage, seed, 900).1;
            (0..900).filter(|&i| after[i].2.is_some()).collect()
        };
        prop_assert_eq!(&kept(sparse), &far);
        // 15 s at 4 scans a second; two that lie close together may meet.
        let all = kept(Damage { blank, ..NONE() });
        let gone = stretches((0..900).filter(|i| all.binary_search(i).is_err()));
        prop_assert!(gone.len() <= blank as usize && gone.is_empty() == (blank == 0));
        prop_assert!(gone.iter().all(|stretch| stretch.len() >= 60 || stretch.last() == Some(&899)));
        let left: Vec<usize> = far.into_iter().filter(|i| all.binary_search(i).is_ok()).step_by(skip as usize).collect();
        prop_assert_eq!(kept(Damage { skip, blank, ..sparse }), left);
    }

    #[test]
    fn beams_at_the_sides_do_not_return(degrees in 1.0..180.0) {
        let (_, after) = both(Damage { field_of_view: f64::to_radians(degrees), ..NONE() }, 1, 3);
        for ranges in after.into_iter().filter_map(|reading| reading.2) {
            for (beam, range) in ranges.into_iter().enumerate().take(180) {
                let off = (beam as f64 - 90.0).abs();
                prop_assert_eq!(range == f64::INFINITY, off > degrees / 2.0, "beam {}", beam);
            }
        }
    }

    /// What hides a beam lies on a circle of 0.25 m whose middle is where the shortest of them points.
    #[test]
    fn people_walk_along(seed: u64) {
        let (_, after) = both(Damage { crowd: 1, ..NONE() }, seed, 200);
        let mut seen = 0;
        for ranges in after.into_iter().filter_map(|reading| reading.2) {
            let hidden: Vec<usize> = (0..180).filter(|&beam| ranges[beam] != RANGE).collect();
            prop_assert!(stretches(hidden.iter().copied()).len() <= 1);
            // Whole inside the field of view.
            if hidden.is_empty() || hidden.contains(&0) || hidden.contains(&179) {
                continue;
            }
            seen += 1;
            let near = hidden.iter().map(|&beam| ranges[beam]).fold(f64::INFINITY, f64::min);
            prop_assert!((0.8 - 0.25 - 1e-3..2.0 - 0.25 + 1e-2).contains(&near), "{}", near);
            // sin of half the angle under which a circle is seen is radius over distance.
            let half = (0.25 / (near + 0.25)).asin().to_degrees();
            prop_assert!((hidden.len() as f64 - 2.0 * half).abs() < 2.5, "{} beams, {}°", hidden.len(), 2.0 * half);
        }
        prop_assert!(seen > 0);
    }
}

#[test]
fn noise_has_the_deviations_that_are_asked_for() {
    let noise = 2.0;
    let (before, after) = both(Damage { noise, ..NONE() }, 7, 4000);
    let mut errors = [const { Vec::new() }; 3];
    for (a, b) in motions(&before).into_iter().zip(motions(&after)) {
        let distance = a.x.hypot(a.y);
        errors[0].push((b.x - a.x) / (0.1 * distance));
        errors[1].push((b.y - a.y) / (0.05 * distance));
        errors[2].push((b.heading - a.heading) / (0.1 * a.heading.abs() + 0.02 * distance));
    }
    errors.iter().for_each(|errors| assert_normal(errors, noise));
    let (before, after) = both(Damage { no_odometry: true, ..NONE() }, 7, 20);
    assert!(after.iter().all(|reading| reading.1 == Pose::IDENTITY) && before[0].1 != Pose::IDENTITY);
}

#[test]
fn ranges_get_noise_and_strays() {
    let ranges = |damage: Damage| -> Vec<f64> {
        let (_, after) = both(damage, 7, 100);
        after.into_iter().filter_map(|reading| reading.2).flat_map(|ranges| ranges.into_iter().take(180)).collect()
    };
    let noisy = ranges(Damage { range_noise: 0.1, ..NONE() });
    assert_normal(&noisy.iter().map(|range| range - RANGE).collect::<Vec<_>>(), 0.1);
    let (_, after) = both(Damage { range_noise: 0.1, ..NONE() }, 7, 100);
    assert!(after.iter().filter_map(|reading| reading.2.as_ref()).all(|ranges| ranges[180] == NO_RETURN));

    let strays: Vec<f64> =
        ranges(Damage { random: 0.2, ..NONE() }).into_iter().filter(|&range| range != RANGE).collect();
    let (share, spread) = (strays.len() as f64 / 18_000.0, (0.2 * 0.8 / 18_000.0f64).sqrt());
    assert!((share - 0.2).abs() < 5.0 * spread, "{share}");
    // Uniform over 9.7 m: mean 5.15, deviation 9.7 / √12.
    let ((mean, std), root) = (moments(&strays), (strays.len() as f64).sqrt());
    assert!((mean - 5.15).abs() < 5.0 * 2.8 / root && (std - 9.7 / 12f64.sqrt()).abs() < 0.1, "{mean} ± {std}");
    assert!(strays.iter().all(|range| (0.3..10.0).contains(range)));
}

/// Of all that is drawn.
#[test]
fn a_seed_is_a_log() {
    let kinds = [
        Damage { noise: 1.0, ..NONE() },
        Damage { slip: 2, ..NONE() },
        Damage { backwards: 2, ..NONE() },
        Damage { spike: 2, ..NONE() },
        Damage { reset: 2, ..NONE() },
        Damage { blank: 2, ..NONE() },
        Damage { range_noise: 0.1, ..NONE() },
        Damage { random: 0.1, ..NONE() },
        Damage { crowd: 2, ..NONE() },
    ];
    for damage in kinds {
        let bytes = |seed: u64| {
            let mut writer = CarmenWriter::new(Vec::new());
            damage.apply(drive(300), seed).unwrap().iter().for_each(|entry| writer.write(entry).unwrap());
            writer.finish().unwrap()
        };
        assert!(bytes(1) == bytes(1), "{damage:?}");
        assert!(bytes(1) != bytes(2) && bytes(1) != bytes(1 + (1 << 32)), "{damage:?}");
    }
}

#[test]
fn numbers_out_of_range_are_refused() {
    for (damage, words) in [
        (Damage { noise: -1.0, ..NONE() }, "damage.noise is -1, but has to be 0 to 1000"),
        (Damage { noise: f64::NAN, ..NONE() }, "damage.noise is NaN"),
        (Damage { scale_turn: 0.0, ..NONE() }, "damage.scale_turn is 0, but has to be 0.1 to 10"),
        (Damage { skip: 0, ..NONE() }, "damage.skip is 0, but has to be 1 to 10000"),
        (Damage { random: 1.5, ..NONE() }, "damage.random is 1.5, but has to be 0 to 1"),
        (Damage { crowd: 5000, ..NONE() }, "damage.crowd is 5000, but has to be 0 to 1000"),
    ] {
        let message = damage.apply(drive(3), 1).unwrap_err().to_string();
        assert!(message.contains(words), "{message:?} does not say {words:?}");
    }
}
