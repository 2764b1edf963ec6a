//! A log made harder: its odometry worse, its scans fewer or worse.
//!
//! In: the entries of a log. Out: an entry for each laser reading, with its stamp: the reading, or, where its scan is left out,
//! its odometry alone. So what is known of the log's true path holds for the harder one too. True poses stay; odometry
//! between scans is left out.
//!
//! The motions of odometry from scan to scan, (forward, sideways \[m\], turn \[rad\]) in the robot's frame, are scaled, then mistaken where
//! wheels spin or a sign is lost, then disturbed by noise, and put together again from the first pose. What happens N
//! times happens once in each of N equal parts of the way, somewhere in its middle 80 %, where the robot moves.

use crate::geometry::Pose;
use crate::log::{LaserReading, LogEntry};
use crate::parameters::{ConfigError, parameters};
use crate::random::{Draw, bits, normals, uniform};
use std::ops::Range;

parameters! {
    /// What is made worse; by default nothing is.
    pub struct Damage {
        /// Gaussian noise of motions, in units of 0.1 of the distance forward, 0.05 of it sideways, and for the turn 0.1 of itself and
        /// 0.02 rad for each metre.
        noise: f64 = 0.0, in 0.0..=1000.0;
        /// Factor of distances forward and sideways.
        scale_distance: f64 = 1.0, in 0.1..=10.0;
        /// Factor of turns.
        scale_turn: f64 = 1.0, in 0.1..=10.0;
        /// Times that wheels spin for 2 s: distances come out 1.5 times as long, and turns 0.3 rad too large in all.
        slip: u32 = 0, in 0.0..=1000.0;
        /// Times that for 2 s the robot's motion is reported as its reverse.
        backwards: u32 = 0, in 0.0..=1000.0;
        /// Times that one reading of odometry is 5 m and 1 rad off, and the next is right again.
        spike: u32 = 0, in 0.0..=1000.0;
        /// Times that odometry starts again at the origin.
        reset: u32 = 0, in 0.0..=1000.0;
        /// Whether every pose of odometry is the origin.
        no_odometry: bool = false;
        /// Time by which odometry lags behind the scans \[s\].
        late: f64 = 0.0, in 0.0..=60.0;
        /// Only every N-th scan is kept, of those that the others leave.
        skip: u32 = 1, in 1.0..=10000.0;
        /// Only scans at least this far after the last one are kept, by the odometry of the log \[m\], or ...
        sparse_distance: f64 = 0.0, in 0.0..=1000.0;
        /// ... this much turned \[rad\]. With 0, all are kept.
        sparse_turn: f64 = 0.0, in 0.0..=4.0;
        /// Times that for 15 s there is no scan.
        blank: u32 = 0, in 0.0..=1000.0;
        /// Only beams in the middle of the sweep return, over this angle \[rad\].
        field_of_view: f64 = std::f64::consts::TAU, in 0.0..=std::f64::consts::TAU;
        /// Gaussian noise of ranges below 50 m \[m\].
        range_noise: f64 = 0.0, in 0.0..=10.0;
        /// Share of the ranges that become any from 0.3 to 10 m.
        random: f64 = 0.0, in 0.0..=1.0;
        /// People, 0.5 m wide, who walk along 0.8 to 2 m from the laser all the time.
        crowd: u32 = 0, in 0.0..=1000.0;
    }
}

/// Standard deviations at a noise of 1: forward and sideways by distance, turn by turn, turn by distance \[rad/m\].
const NOISE: [f64; 4] = [0.1, 0.05, 0.1, 0.02];
const MISHAP_SECONDS: f64 = 2.0;
const SLIP_FACTOR: f64 = 1.5;
/// \[rad\].
const SLIP_TURN: f64 = 0.3;
const SPIKE: Pose = Pose { x: 3.0, y: 4.0, heading: 1.0 };
const BLANK_SECONDS: f64 = 15.0;
/// Longer ranges are taken for no return \[m\].
const LONGEST: f64 = 50.0;
/// No range gets shorter by noise \[m\].
const SHORTEST: f64 = 0.05;
const RANDOM_RANGE: Range<f64> = 0.3..10.0;
/// Of a person \[m\].
const RADIUS: f64 = 0.25;

/// What happens at some moments, or is drawn once for a log: each draws numbers of its own.
#[derive(Clone, Copy)]
enum Event {
    Slip,
    Backwards,
    Spike,
    Reset,
    Blank,
    Person,
}

/// A number in (0, 1), drawn for the `count`-th event of a kind.
fn share(seed: u64, count: u32, event: Event) -> f64 {
    f64::from(uniform(bits(seed, count, event as u32, Draw::Event)[0]))
}

impl Damage {
    /// The harder log. The same seed gives the same one.
    ///
    /// # Errors
    /// A number is out of its range.
    pub fn apply(&self, mut entries: Vec<LogEntry>, seed: u64) -> Result<Vec<LogEntry>, ConfigError> {
        self.check("damage")?;
        entries.retain(|entry| !matches!(entry, LogEntry::Odometry { .. }));
        let scans = entries.iter().filter_map(|entry| match entry {
            LogEntry::Laser(reading) => Some((reading.stamp, reading.odom_from_robot)),
            _ => None,
        });
        let drive = Drive::new(scans.collect(), seed);
        let people: Vec<Person> = (0..self.crowd).map(|number| Person::new(seed, number)).collect();
        let mut odometry_and_kept = self.odometry(&drive).into_iter().zip(self.kept(&drive)).zip(0..);
        for entry in &mut entries {
            let LogEntry::Laser(reading) = entry else { continue };
            let Some(((odom_from_robot, is_kept), number)) = odometry_and_kept.next() else { break };
            let stamp = reading.stamp;
            if is_kept {
                reading.odom_from_robot = odom_from_robot;
                self.damage_ranges(reading, seed, number);
                people.iter().for_each(|person| person.hide(reading, stamp - drive.scans[0].0));
                self.narrow(reading);
            } else {
                *entry = LogEntry::Odometry { stamp, odom_from_robot };
            }
        }
        Ok(entries)
    }

    /// Odometry at each scan.
    fn odometry(&self, drive: &Drive) -> Vec<Pose> {
        let mut motions = drive.motions();
        for Pose { x, y, heading } in &mut motions {
            (*x, *y, *heading) = (*x * self.scale_distance, *y * self.scale_distance, *heading * self.scale_turn);
        }
        // The motion of this number ends at the scan of the next.
        let into = |scans: Range<usize>| scans.start.max(1) - 1..scans.end.max(1) - 1;
        for first in drive.moments(self.slip, Event::Slip) {
            let spun = &mut motions[into(drive.during(first, MISHAP_SECONDS))];
            let turn = SLIP_TURN / spun.len().max(1) as f64;
            for Pose { x, y, heading } in spun {
                (*x, *y, *heading) = (*x * SLIP_FACTOR, *y * SLIP_FACTOR, *heading + turn);
            }
        }
        for first in drive.moments(self.backwards, Event::Backwards) {
            for Pose { x, y, heading } in &mut motions[into(drive.during(first, MISHAP_SECONDS))] {
                (*x, *y, *heading) = (-*x, -*y, -*heading);
            }
        }
        if self.noise > 0.0 {
            for (Pose { x, y, heading }, number) in motions.iter_mut().zip(0..) {
                let z = normals(drive.seed, number, 0, Draw::Wheels).map(|z| self.noise * f64::from(z));
                let (distance, turn) = (x.hypot(*y), heading.abs());
                *x += NOISE[0] * distance * z[0];
                *y += NOISE[1] * distance * z[1];
                *heading += (NOISE[2] * turn + NOISE[3] * distance) * z[2];
            }
        }
        let resets: Vec<usize> = drive.moments(self.reset, Event::Reset).collect();
        let mut odometry: Vec<Pose> = drive.scans.first().map(|&(_, first)| first).into_iter().collect();
        for (motion, scan) in motions.into_iter().zip(1..) {
            let before = odometry[scan - 1];
            let motion = Pose::new(motion.x, motion.y, motion.heading);
            odometry.push(if resets.contains(&scan) { Pose::IDENTITY } else { before * motion });
        }
        for scan in drive.moments(self.spike, Event::Spike) {
            odometry[scan] = odometry[scan] * SPIKE;
        }
        if self.late > 0.0 {
            odometry = drive.late(&odometry, self.late);
        }
        if self.no_odometry {
            odometry.fill(Pose::IDENTITY);
        }
        odometry
    }

    /// Which scans are kept.
    fn kept(&self, drive: &Drive) -> Vec<bool> {
        let mut kept = vec![true; drive.scans.len()];
        for first in drive.moments(self.blank, Event::Blank) {
            kept[drive.during(first, BLANK_SECONDS)].fill(false);
        }
        let mut last = None;
        for (kept, &(_, pose)) in kept.iter_mut().zip(&drive.scans) {
            let motion = last.map(|last| pose.seen_from(last));
            let is_far = motion.is_none_or(|motion| {
                motion.x.hypot(motion.y) >= self.sparse_distance || motion.heading.abs() >= self.sparse_turn
            });
            *kept &= is_far;
            last = if is_far { Some(pose) } else { last };
        }
        let left = kept.iter_mut().filter(|kept| **kept);
        left.zip(0u32..).for_each(|(kept, number)| *kept = number.is_multiple_of(self.skip));
        kept
    }

    fn damage_ranges(&self, reading: &mut LaserReading, seed: u64, scan: u32) {
        for (range, beam) in reading.ranges.iter_mut().zip(0..) {
            if self.range_noise > 0.0 && (0.0..LONGEST.min(reading.max_range)).contains(range) {
                let z = f64::from(normals(seed, scan, beam, Draw::Range)[0]);
                *range = (*range + self.range_noise * z).max(SHORTEST);
            }
            if self.random > 0.0 {
                let [chance, far, ..] = bits(seed, scan, beam, Draw::Stray).map(|word| f64::from(uniform(word)));
                if chance < self.random {
                    *range = RANDOM_RANGE.start + far * (RANDOM_RANGE.end - RANDOM_RANGE.start);
                }
            }
        }
    }

    /// Beams outside the field of view do not return.
    fn narrow(&self, reading: &mut LaserReading) {
        let middle = (reading.ranges.len().saturating_sub(1)) as f64 / 2.0;
        for (beam, range) in reading.ranges.iter_mut().enumerate() {
            let off = (beam as f64 - middle) * reading.angle_step;
            if off.abs() > self.field_of_view / 2.0 {
                *range = f64::INFINITY;
            }
        }
    }
}

/// The scans of a log: stamp and odometry as recorded.
struct Drive {
    scans: Vec<(f64, Pose)>,
    /// Metres driven at each scan.
    way: Vec<f64>,
    seed: u64,
}

impl Drive {
    fn new(scans: Vec<(f64, Pose)>, seed: u64) -> Self {
        let mut this = Self { scans, way: vec![0.0], seed };
        for motion in this.motions() {
            this.way.push(this.way[this.way.len() - 1] + motion.x.hypot(motion.y));
        }
        this
    }

    /// From each scan to the next.
    fn motions(&self) -> Vec<Pose> {
        self.scans.windows(2).map(|pair| pair[1].1.seen_from(pair[0].1)).collect()
    }

    /// The scans at which something happens, one in each of `count` parts of the way; the first scan is none of them.
    fn moments(&self, count: u32, event: Event) -> impl Iterator<Item = usize> {
        let parts = if self.scans.len() > 1 { 0..count } else { 0..0 };
        parts.map(move |part| {
            let middle = 0.1 + 0.8 * share(self.seed, part, event);
            let driven = (f64::from(part) + middle) / f64::from(count) * self.way[self.way.len() - 1];
            self.way.partition_point(|&way| way < driven).clamp(1, self.scans.len() - 1)
        })
    }

    /// The scans from one on, for some seconds.
    fn during(&self, first: usize, seconds: f64) -> Range<usize> {
        let began = self.scans[first].0;
        let inside = self.scans[first..].iter().take_while(|(stamp, _)| *stamp < began + seconds).count();
        first..first + inside
    }

    /// Odometry as it was some seconds before each scan; the first pose before there was any.
    fn late(&self, odometry: &[Pose], seconds: f64) -> Vec<Pose> {
        let mut stamped: Vec<(f64, Pose)> =
            self.scans.iter().zip(odometry).map(|(&(stamp, _), &pose)| (stamp, pose)).collect();
        stamped.sort_by(|a, b| a.0.total_cmp(&b.0));
        let then = |(stamp, _): &(f64, Pose)| {
            let stamp = stamp - seconds;
            let after = stamped.partition_point(|(other, _)| *other <= stamp);
            match (after.checked_sub(1).map(|before| stamped[before]), stamped.get(after)) {
                (Some((from, before)), Some(&(to, next))) => before.interpolated(next, (stamp - from) / (to - from)),
                (Some((_, pose)), None) | (None, Some(&(_, pose))) => pose,
                (None, None) => Pose::IDENTITY,
            }
        };
        self.scans.iter().map(then).collect()
    }
}

/// Somebody beside the robot, who sways in front of the laser: bearing and distance are sines of time.
struct Person {
    /// Middle, amplitude, radians a second and phase, of the bearing \[rad\] and the distance \[m\].
    bearing: [f64; 4],
    distance: [f64; 4],
}

impl Person {
    fn new(seed: u64, number: u32) -> Self {
        let drawn =
            |index: u32, from: f64, to: f64| from + (to - from) * share(seed, 8 * number + index, Event::Person);
        Self {
            bearing: [drawn(0, -1.4, 1.4), 0.8, drawn(1, 0.1, 0.3), drawn(2, 0.0, 6.0)],
            distance: [1.4, 0.6, drawn(3, 0.1, 0.4), drawn(4, 0.0, 6.0)],
        }
    }

    /// Shortens the beams that meet the person, this many seconds after the first scan.
    fn hide(&self, reading: &mut LaserReading, seconds: f64) {
        let sine = |[middle, amplitude, rate, phase]: [f64; 4]| middle + amplitude * (seconds * rate + phase).sin();
        let (bearing, distance) = (sine(self.bearing), sine(self.distance));
        for (beam, range) in reading.ranges.iter_mut().enumerate() {
            let (sin, cos) = (reading.first_angle + beam as f64 * reading.angle_step - bearing).sin_cos();
            let (along, across) = (distance * cos, distance * sin);
            if along > 0.0 && across.abs() < RADIUS {
                *range = range.min(along - (RADIUS * RADIUS - across * across).sqrt());
            }
        }
    }
}
