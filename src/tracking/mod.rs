//! The motion of the robot since the last step of a filter: by odometry, and as corrected by scans.
//!
//! Odometry is not always a measurement:
//! - A motion between two readings that no robot can have driven is refused. The robot is taken to move on at its velocity, with
//!   the noise of an unmeasured motion, and scan matching decides. A motion far faster than any before in this drive is refused too,
//!   unless the next one is as fast and leads on: where readings are seconds apart, odometry that starts again jumps no faster than a
//!   robot drives.
//! - A reading that is off is left out: where the robot cannot have driven from it either, but from the reading before it, the motion
//!   is from there.
//! - Odometry that never changes measures nothing. The robot is taken to move on at the velocity that scans have shown, with the
//!   noise of an unmeasured motion.
//! - Odometry that stops changing means that the robot stands or that odometry is late. The noise then covers the distance that
//!   the robot would have driven at its velocity. When odometry changes again, its motion starts at the pose where it stopped
//!   changing, not at the pose to which scans have tracked the robot since.
//! - Where a gyroscope measured a turn, it counts in place of that of the odometry.

use crate::evaluator::PRIOR_TAIL;
use crate::geometry::{Pose, wrap_angle};
use crate::motion::{Motion, MotionConfig, Travel};
use crate::parameters::parameters;
use errors::Errors;
use gyro::Gyro;
use nalgebra::{Matrix3, Vector3};

mod errors;
mod gyro;
pub mod starts;
pub use errors::OdometryErrors;
pub use gyro::GyroUse;

parameters! {
    /// How the robot is tracked between steps, and when a step is taken.
    pub struct TrackingConfig {
        /// A step is taken once the robot has moved this far \[m\] or turned by `step_turn`. Both zero: a step every scan, as
        /// in the paper.
        step_distance: f64 = 0.3, in 0.0..=f64::INFINITY;
        /// A step is taken once the robot has turned this far \[rad\] or moved by `step_distance`.
        step_turn: f64 = 0.2, in 0.0..=f64::INFINITY;
        /// Starts of scan matching at each scan, drawn from the motion model; 0 uses odometry alone and at its word, as in the
        /// paper.
        starts: u32 = 24, in 0.0..=1e6;
        /// Odometry that moves faster is refused \[m/s\]: no robot with a planar laser drives as fast indoors.
        max_speed: f64 = 5.0, in 1e-3..=f64::INFINITY;
        /// Odometry that turns faster is refused \[rad/s\]: robots on two wheels turn at up to 3.
        max_turn_rate: f64 = 4.0, in 1e-3..=f64::INFINITY;
        /// Odometry that accelerates faster is refused \[m/s²\]: tyres slide at about 10.
        max_acceleration: f64 = 10.0, in 1e-3..=f64::INFINITY;
    }
}

/// The time between two readings is taken to be at least this \[s\]: logs lose readings, and stamps of receipt jitter by as much.
const MIN_ELAPSED: f64 = 0.5;
/// This many times as fast as ever before in a drive is a jump, ...
const JUMP: f64 = 3.0;
/// ... unless it is slower than this \[m/s\]: walking pace, at which any robot may drive off.
const WALKING: f64 = 1.0;
/// A motion is extrapolated for at most this time \[s\].
const MAX_GUESS: f64 = 1.0;
/// Odometry is late once it has not changed for this share of its period: stamps jitter.
const LATE: f64 = 0.9;
/// Weight of a new interval in the running average of the period, which so covers about ten of them.
const PERIOD_SHARE: f64 = 0.1;
/// A scan tells the error of a motion where it knows the motion to this share of the error that odometry is expected to have.
const SURE: f64 = 0.5;

impl TrackingConfig {
    /// Whether a robot that has moved by this since the last step is still too near to it for another one.
    pub fn is_too_near(&self, moved: Pose) -> bool {
        moved.x.hypot(moved.y) < self.step_distance && moved.heading.abs() < self.step_turn
    }

    /// Whether a robot that drove at `speed` \[m/s\] can have made this motion in this time \[s\].
    fn can_be_driven(&self, moved: Pose, seconds: f64, speed: f64) -> bool {
        let seconds = duration(seconds);
        let distance = moved.x.hypot(moved.y);
        let reachable = (speed + self.max_acceleration * seconds).min(self.max_speed) * seconds;
        moved.is_finite() && distance <= reachable && moved.heading.abs() <= self.max_turn_rate * seconds
    }
}

/// The time in which a motion was made \[s\], by the stamps of its ends: stamps jitter, so that a short time is none to go by.
fn duration(seconds: f64) -> f64 {
    if seconds > 0.0 { seconds.max(MIN_ELAPSED) } else { MAX_GUESS }
}

/// The speed of a motion \[m/s\].
fn mean_speed(moved: Pose, seconds: f64) -> f64 {
    moved.x.hypot(moved.y) / duration(seconds)
}

/// A motion of the same length along an arc of another turn \[rad\].
fn turning(moved: Pose, turn: f64) -> Pose {
    let chord = Pose::new(0.0, 0.0, 0.5 * wrap_angle(turn - moved.heading)) * Pose { heading: 0.0, ..moved };
    Pose::new(chord.x, chord.y, turn)
}

/// The prior of where the robot is, as seen from the last step, with the errors that the odometry of this drive has shown.
#[derive(Clone, Copy, Debug)]
pub struct Prior {
    mean: Pose,
    /// Inverse covariance of (forward, sideways, heading) in the frame of the mean; zeros where that has none.
    information: Matrix3<f64>,
}

impl Prior {
    fn new(Motion { mean, covariance }: &Motion) -> Self {
        Self { mean: *mean, information: covariance.try_inverse().unwrap_or_else(Matrix3::zeros) }
    }

    /// Log of Cauchy's robust density, but for a constant: 0 at the mean.
    pub fn log_density(&self, step_from_robot: Pose) -> f64 {
        let Pose { x, y, heading } = step_from_robot.seen_from(self.mean);
        let off = Vector3::new(x, y, heading);
        let tail = f64::from(PRIOR_TAIL);
        -0.5 * tail * (off.dot(&(self.information * off)) / tail).ln_1p()
    }
}

/// The last change of odometry.
#[derive(Clone, Copy, Debug)]
struct Change {
    stamp: f64,
    odom_from_robot: Pose,
}

/// The pose at an earlier reading, relative to the last step.
#[derive(Clone, Copy, Debug)]
struct Place {
    by_odometry: Pose,
    tracked: Pose,
}

/// Odometry stopped changing.
#[derive(Clone, Copy, Debug)]
struct Stall {
    /// Where.
    place: Place,
    /// Motion that it may have missed since.
    missed: Travel,
}

/// The last reading was refused.
#[derive(Clone, Copy, Debug)]
struct Refused {
    /// The last reading that was not.
    odom_from_robot: Pose,
    place: Place,
    /// Time since then \[s\].
    seconds: f64,
    /// Whether a robot can have driven from there, if faster than ever before.
    was_drivable: bool,
}

/// The motion since the last step.
#[derive(Clone, Debug)]
pub struct Tracker {
    motion: MotionConfig,
    tracking: TrackingConfig,
    last: Option<Change>,
    /// Stamp of the last reading \[s\].
    stamp: f64,
    stall: Option<Stall>,
    gyro: Gyro,
    /// How far the robot has turned by the gyroscope since odometry changed \[rad\]; `None` where that was not measured throughout.
    turned: Option<f64>,
    /// Time from one change of odometry to the next, on average \[s\].
    period: Option<f64>,
    /// Velocity by the motions that were accepted: forward and sideways \[m/s\], turn \[rad/s\].
    velocity: Pose,
    /// The fastest of these motions \[m/s\].
    fastest: Option<f64>,
    last_refused: Option<Refused>,
    since_step: Travel,
    /// The motion from the last step to the last scan that corrected it, and the travel since.
    corrected: Motion,
    /// Stamp of that scan \[s\].
    corrected_at: f64,
    is_corrected: bool,
    since_correction: Travel,
    refused: Vec<f64>,
    position_errors: Errors,
    heading_errors: Errors,
}

impl Tracker {
    /// A tracker before the first reading.
    pub fn new(motion: MotionConfig, tracking: TrackingConfig) -> Self {
        Self {
            motion,
            tracking,
            last: None,
            stamp: 0.0,
            stall: None,
            gyro: Gyro::default(),
            turned: None,
            period: None,
            velocity: Pose::IDENTITY,
            fastest: None,
            last_refused: None,
            since_step: Travel::default(),
            corrected: Motion::none(),
            corrected_at: 0.0,
            is_corrected: false,
            since_correction: Travel::default(),
            refused: Vec::new(),
            position_errors: Errors::default(),
            heading_errors: Errors::default(),
        }
    }

    /// Adds how far the robot has turned since the last reading, by a gyroscope \[rad\]; before the reading that has the motion.
    pub fn turn(&mut self, by_gyro: f64) {
        self.gyro.add(by_gyro);
    }

    /// Adds the motion since the last reading. Poses that are not finite are refused and have no other effect.
    pub fn add(&mut self, stamp: f64, odom_from_robot: Pose) {
        if !odom_from_robot.is_finite() {
            self.refused.push(stamp);
            return;
        }
        let before = std::mem::replace(&mut self.stamp, stamp);
        let elapsed = (stamp - before).clamp(0.0, MAX_GUESS);
        let turn = self.gyro.take((stamp - before).max(0.0));
        let turned = self.turned.zip(turn).map(|(before, turn)| before + turn);
        self.turned = turned;
        let Some(last) = self.last else {
            self.last = Some(Change { stamp, odom_from_robot });
            self.turned = Some(0.0);
            return;
        };
        if last.odom_from_robot == odom_from_robot {
            self.stand(stamp - last.stamp, elapsed, turn);
            return;
        }
        self.last = Some(Change { stamp, odom_from_robot });
        self.turned = Some(0.0);
        let by_odometry = odom_from_robot.seen_from(last.odom_from_robot);
        let moved = turned.map_or(by_odometry, |turn| turning(by_odometry, turn));
        // Odometry is late by a second at most: a robot that stood for an hour cannot have driven a mile since.
        let seconds = stamp - last.stamp.max(before - MAX_GUESS);
        let (stall, refused) = (self.stall.take(), self.last_refused.take());
        let refused = refused.map(|refused| Refused { seconds: refused.seconds + seconds, ..refused });
        let is_drivable = self.can_drive(moved, seconds);
        if !is_drivable || self.is_jump(moved, seconds) {
            // Either reading may be the one that is off.
            if let Some(before) = refused {
                let moved = odom_from_robot.seen_from(before.odom_from_robot);
                if self.can_drive(moved, before.seconds) && !self.is_jump(moved, before.seconds) {
                    self.go_back(before.place);
                    return self.go_on(Travel::measured(moved), before.seconds, None);
                }
            }
            if !is_drivable || refused.is_none_or(|before| !before.was_drivable) {
                let place = stall.map_or_else(|| self.place(), |stall| stall.place);
                let first =
                    Refused { odom_from_robot: last.odom_from_robot, place, seconds, was_drivable: is_drivable };
                self.last_refused = Some(refused.unwrap_or(first));
                self.refused.push(stamp);
                return self.travel(self.guess(elapsed, turn));
            }
        }
        self.go_on(Travel::measured(moved).doubting(by_odometry.heading), seconds, stall);
    }

    /// Adds a motion that odometry measured since the last reading, or since it stalled.
    fn go_on(&mut self, mut travel: Travel, seconds: f64, stall: Option<Stall>) {
        self.accept(travel.mean(), seconds);
        if let Some(Stall { place, missed }) = stall {
            self.go_back(place);
            // Odometry that was late may still be late.
            travel = travel.then(&missed);
        }
        self.travel(travel);
    }

    /// Whether the robot can have made this motion, at the velocity that it has.
    fn can_drive(&self, moved: Pose, seconds: f64) -> bool {
        self.tracking.can_be_driven(moved, seconds, self.velocity.x.hypot(self.velocity.y))
    }

    fn place(&self) -> Place {
        Place { by_odometry: self.by_odometry().mean, tracked: self.tracked().mean }
    }

    /// Puts the robot back where it was at an earlier reading, with the noise of the motions since.
    fn go_back(&mut self, Place { by_odometry, tracked }: Place) {
        self.since_step = self.since_step.moved_to(by_odometry);
        self.since_correction = self.since_correction.moved_to(tracked.seen_from(self.corrected.mean));
    }

    /// Odometry has not changed for `unchanged` \[s\], `elapsed` of them since the last reading.
    fn stand(&mut self, unchanged: f64, elapsed: f64, turn: Option<f64>) {
        if self.tracking.starts == 0 {
            // No scan would find what odometry missed, and noise of a metre is more than particles from odometry alone can fill.
            return;
        }
        let Some(period) = self.period else {
            // It never changed: nothing measures the motion.
            return self.travel(self.guess(elapsed, turn));
        };
        if unchanged > MAX_GUESS {
            // The robot stands.
            self.velocity = Pose::IDENTITY;
        }
        // A scan between two odometry readings repeats the first one.
        if unchanged >= LATE * period {
            let place = self.place();
            let stall = self.stall.get_or_insert(Stall { place, missed: Travel::default() });
            stall.missed = stall.missed.then(&Travel::missed(self.velocity, elapsed));
        }
        self.travel(Travel::missed(self.velocity, elapsed));
    }

    /// The motion of this time \[s\] at the velocity; its turn where it was measured.
    fn guess(&self, seconds: f64, turn: Option<f64>) -> Travel {
        let Pose { x, y, heading } = self.velocity;
        let driven = Pose::new(x * seconds, y * seconds, heading * seconds);
        turn.map_or_else(
            || Travel::unmeasured(driven, seconds),
            |turn| Travel::unmeasured(turning(driven, turn), seconds).with_measured_turn(),
        )
    }

    fn travel(&mut self, travel: Travel) {
        self.since_step = self.since_step.then(&travel);
        self.since_correction = self.since_correction.then(&travel);
    }

    /// Whether it is far faster than any motion that was accepted.
    fn is_jump(&self, moved: Pose, seconds: f64) -> bool {
        self.fastest.is_some_and(|fastest| mean_speed(moved, seconds) > (JUMP * fastest).max(WALKING))
    }

    /// Updates the velocity, averaged over the last half second.
    fn accelerate(&mut self, moved: Pose, seconds: f64) {
        let share = (seconds / MIN_ELAPSED).min(1.0);
        let blend = |old: f64, moved: f64| old + share * (moved / seconds - old);
        let Pose { x, y, heading } = self.velocity;
        self.velocity = Pose { x: blend(x, moved.x), y: blend(y, moved.y), heading: blend(heading, moved.heading) };
    }

    /// Updates the velocity, and the period, averaged over the last intervals. Stamps that are repeated or go backwards change
    /// neither.
    fn accept(&mut self, moved: Pose, seconds: f64) {
        self.fastest = Some(self.fastest.unwrap_or(0.0).max(mean_speed(moved, seconds)));
        if seconds > 0.0 {
            self.accelerate(moved, seconds);
            let seconds = seconds.min(MAX_GUESS);
            self.period = Some(self.period.map_or(seconds, |period| period + PERIOD_SHARE * (seconds - period)));
        }
    }

    /// The motion since the last step by odometry alone (eq. 17).
    pub fn by_odometry(&self) -> Motion {
        self.since_step.motion(&self.motion, self.velocity)
    }

    /// The motion since the last step, as corrected by scans. The floors of the odometry's noise are always added, as the
    /// information of a scan match is overconfident.
    pub fn tracked(&self) -> Motion {
        self.tracked_with(&self.motion)
    }

    fn tracked_with(&self, noise: &MotionConfig) -> Motion {
        let has_moved = self.since_correction != Travel::default();
        let velocity = if has_moved { self.velocity } else { Pose::IDENTITY };
        self.corrected.then(&self.since_correction.motion(noise, velocity))
    }

    /// The prior by the motion as corrected by scans.
    pub fn prior(&self) -> Prior {
        Prior::new(&self.tracked_with(&self.learnt()))
    }

    /// The prior by odometry alone.
    pub fn prior_by_odometry(&self) -> Prior {
        Prior::new(&self.since_step.motion(&self.learnt(), self.velocity))
    }

    /// The noise of the odometry as this drive has shown it.
    fn learnt(&self) -> MotionConfig {
        self.odometry_errors().scaled(&self.motion)
    }

    /// Whether the robot can have come this far from the last step since the scan that was matched last.
    pub fn can_be_driven(&self, step_from_robot: Pose) -> bool {
        self.can_drive(step_from_robot.seen_from(self.corrected.mean), self.stamp - self.corrected_at)
    }

    /// Sets the motion since the last step to what a scan match found.
    pub fn correct(&mut self, tracked: Motion) {
        let seconds = self.stamp - self.corrected_at;
        if self.period.is_none() && seconds > 0.0 {
            self.accelerate(tracked.mean.seen_from(self.corrected.mean), seconds.min(MAX_GUESS));
        }
        let sigma = tracked.covariance[(2, 2)].max(0.0).sqrt() + self.motion.heading_floor;
        self.gyro.compare(tracked.mean.heading, sigma);
        self.corrected_at = self.stamp;
        self.corrected = tracked;
        self.is_corrected = true;
        self.since_correction = Travel::default();
    }

    /// What the odometry of this drive is worth.
    pub fn odometry_errors(&self) -> OdometryErrors {
        OdometryErrors { position: self.position_errors.factor(), heading: self.heading_errors.factor() }
    }

    /// What a gyroscope had to say; `None` where there is none.
    pub fn gyro(&self) -> Option<GyroUse> {
        self.gyro.used()
    }

    /// Compares what odometry has measured since the last step with what the scans make of it.
    fn compare(&mut self) {
        if !self.is_corrected || !self.since_step.is_measured() {
            return;
        }
        let odometry = self.since_step.motion(&self.motion, self.velocity);
        let Pose { x, y, heading } = self.tracked().mean.seen_from(odometry.mean);
        for (axis, off) in [x, y, heading].into_iter().enumerate() {
            let (known, expected) = (self.corrected.covariance[(axis, axis)], odometry.covariance[(axis, axis)]);
            // Where the scan knows no better than odometry, the two agree, right or wrong.
            if known < SURE * SURE * expected {
                let errors = if axis == 2 { &mut self.heading_errors } else { &mut self.position_errors };
                errors.add(off / expected.sqrt());
            }
        }
    }

    /// Starts a new step at the current pose.
    pub fn begin_step(&mut self) {
        self.compare();
        let now = self.tracked().mean;
        self.gyro.begin_step(now.heading);
        let seen_from_now = |place: Place| {
            let place = place.tracked.seen_from(now);
            Place { by_odometry: place, tracked: place }
        };
        self.stall = self.stall.map(|stall| Stall { place: seen_from_now(stall.place), ..stall });
        self.last_refused = self.last_refused.map(|last| Refused { place: seen_from_now(last.place), ..last });
        self.since_step = Travel::default();
        self.corrected = Motion::none();
        self.is_corrected = false;
        self.since_correction = Travel::default();
    }

    /// Stamps \[s\] of the odometry that was refused, in the order of the log.
    pub fn refused(&self) -> &[f64] {
        &self.refused
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: MotionConfig = MotionConfig {
        position_per_distance: 0.1,
        position_per_turn: 0.0,
        heading_per_distance: 0.0,
        heading_per_turn: 0.0,
        position_floor: 0.01,
        heading_floor: 0.01,
        stamp_error: 0.0,
    };

    /// Half a metre a second, a reading each tenth of one; `spoil` changes odometry.
    fn drive(spoil: impl Fn(u32, Pose) -> Pose) -> Tracker {
        let mut tracker = Tracker::new(CONFIG, TrackingConfig::default());
        for reading in 0..100 {
            let pose = Pose::new(0.05 * f64::from(reading), 0.0, 0.0);
            tracker.add(0.1 * f64::from(reading), spoil(reading, pose));
        }
        tracker
    }

    #[test]
    fn odometry_that_can_be_driven_is_accepted() {
        let tracker = drive(|_, pose| pose);
        assert!(tracker.refused().is_empty());
        assert!((tracker.by_odometry().mean.x - 4.95).abs() < 1e-9);
        assert!((tracker.by_odometry().covariance[(0, 0)].sqrt() - 0.505).abs() < 1e-9);
    }

    /// The robot goes on as before: a spike costs one reading, and so does a restart. What follows is accepted again.
    #[test]
    fn a_jump_is_no_motion() {
        let far = Pose::new(5.0, 0.0, 0.0);
        let spike = drive(|reading, pose| if reading == 50 { far * pose } else { pose });
        let endless = drive(|reading, pose| if reading == 50 { Pose { x: 1e200, ..pose } } else { pose });
        let restart = drive(|reading, pose| if reading < 50 { Pose::new(7.0, 9.0, 1.0) * pose } else { pose });
        let turned = drive(|reading, pose| if reading == 50 { Pose { heading: 3.0, ..pose } } else { pose });
        for (name, tracker, stamps) in [
            ("spike", spike, vec![5.0]),
            ("1e200", endless, vec![5.0]),
            ("restart", restart, vec![5.0]),
            ("turned", turned, vec![5.0]),
        ] {
            let refused: Vec<f64> = tracker.refused().iter().map(|stamp| (stamp * 10.0).round() / 10.0).collect();
            assert_eq!(refused, stamps, "{name}");
            let Motion { mean, covariance } = tracker.by_odometry();
            assert!((mean.x - 4.95).abs() < 0.02 && mean.y.abs() < 1e-9, "{name}: {mean:?}");
            assert!(covariance[(0, 0)].sqrt() > 0.5, "{name}: as if it had been measured");
        }
        let mut blind = Tracker::new(CONFIG, TrackingConfig::default());
        blind.add(0.0, Pose { x: f64::NAN, ..Pose::IDENTITY });
        blind.add(0.1, Pose::new(3.0, 0.0, 0.0));
        assert_eq!(
            (blind.refused(), blind.by_odometry().mean),
            (&[0.0][..], Pose::IDENTITY),
            "nothing to compare with"
        );
    }

    /// Odometry that never changes: after a second anything within half a metre is likely.
    #[test]
    fn a_motion_that_nobody_measured_is_doubted() {
        let tracker = drive(|_, _| Pose::new(1.0, 2.0, 0.5));
        let Motion { mean, covariance } = tracker.by_odometry();
        assert_eq!((mean, tracker.refused().len()), (Pose::IDENTITY, 0));
        assert!((covariance[(0, 0)].sqrt() - (0.01 + 0.5 * 9.9)).abs() < 1e-6, "{covariance}");
    }

    /// Without odometry, and scans that show half a metre a second: the robot is expected to drive on.
    #[test]
    fn without_odometry_the_robot_drives_on_as_scans_have_shown() {
        let mut tracker = Tracker::new(CONFIG, TrackingConfig::default());
        for scan in 0..100 {
            tracker.add(0.1 * f64::from(scan), Pose::IDENTITY);
            tracker.correct(Motion { mean: Pose::new(0.05, 0.0, 0.02), ..Motion::none() });
            tracker.begin_step();
        }
        tracker.add(10.0, Pose::IDENTITY);
        let Motion { mean, covariance } = tracker.tracked();
        assert!((mean.x - 0.05).abs() < 1e-6 && (mean.heading - 0.02).abs() < 1e-6, "{mean:?}");
        assert!(covariance[(0, 0)].sqrt() > 0.05, "{covariance}");
    }

    /// Odometry that has shown a tenth of the errors that are configured speaks ten times as hard against a place that is off. By hand:
    /// half a metre at 0.5 m/s is expected to err by 0.01 + 0.1 · 0.05 m.
    #[test]
    fn a_place_is_as_unlikely_as_the_odometry_of_the_drive_is_good() {
        let log_prior = |sigmas: f64| -0.5 * 5.687_75 * (1.0 + sigmas * sigmas / 5.687_75).ln();
        let at = |tracker: &Tracker, off: f64| {
            tracker.prior().log_density(tracker.tracked().mean * Pose::new(off, 0.0, 0.0))
        };
        let mut tracker = Tracker::new(CONFIG, TrackingConfig::default());
        tracker.add(0.0, Pose::IDENTITY);
        tracker.add(0.1, Pose::new(0.05, 0.0, 0.0));
        let sigma = 0.015;
        assert!((at(&tracker, 0.3) - log_prior(0.3 / sigma)).abs() < 1e-5, "as configured");
        for reading in 2..200 {
            let stamp = 0.1 * f64::from(reading);
            let error = if reading % 2 == 0 { 0.1 } else { -0.1 } * sigma * 0.674_489_750_196_082;
            tracker.correct(Motion { mean: Pose::new(0.05 + error, error, 0.0), ..Motion::none() });
            tracker.begin_step();
            tracker.add(stamp, Pose::new(0.05 * f64::from(reading), 0.0, 0.0));
        }
        let (shown, expected) = (at(&tracker, 0.3), log_prior(0.3 / (0.01 + 0.1 * 0.005)));
        assert!((shown - expected).abs() < 0.02 * expected.abs(), "{shown} {expected}");
        assert!(at(&tracker, 0.3) < at(&tracker, 0.2) && at(&tracker, 0.0) == 0.0);
        // A scan moves what is tracked and not what odometry says.
        let expected = tracker.by_odometry().mean;
        tracker.correct(Motion { mean: Pose::new(0.2, 0.0, 0.0), ..Motion::none() });
        assert_eq!(tracker.prior_by_odometry().log_density(expected), 0.0);
        assert!(tracker.prior().log_density(expected) < -1.0);
    }

    /// The turn is that of the gyroscope, in place of the odometry's, which has none here, and of the guess without odometry.
    #[test]
    fn a_gyroscope_that_scans_confirm_measures_turns() {
        for has_odometry in [false, true] {
            let (mut tracker, mut odom_from_robot) = (Tracker::new(CONFIG, TrackingConfig::default()), Pose::IDENTITY);
            let turn = |scan: u32| if (scan / 10).is_multiple_of(2) { 0.05 } else { -0.03 };
            for scan in 0..100 {
                if has_odometry {
                    odom_from_robot = odom_from_robot * Pose::new(0.05, 0.0, 0.0);
                }
                if scan > 0 {
                    tracker.turn(turn(scan));
                }
                tracker.add(0.1 * f64::from(scan), odom_from_robot);
                tracker.correct(Motion { mean: Pose::new(0.05, 0.0, turn(scan)), ..Motion::none() });
                tracker.begin_step();
            }
            tracker.turn(0.2);
            if has_odometry {
                odom_from_robot = odom_from_robot * Pose::new(0.05, 0.0, 0.0);
            }
            tracker.add(10.0, odom_from_robot);
            let Motion { mean, covariance } = tracker.tracked();
            assert!((mean.heading - 0.2).abs() < 1e-3, "{has_odometry}: {mean:?}");
            // Along an arc, whose chord has half the turn.
            assert!((mean.x - 0.05 * 0.1_f64.cos()).abs() < 2e-3, "{has_odometry}: {mean:?}");
            assert!((mean.y - 0.05 * 0.1_f64.sin()).abs() < 2e-3, "{has_odometry}: {mean:?}");
            // Without odometry nothing else was measured.
            assert_eq!(covariance[(0, 0)].sqrt() > 0.05, !has_odometry, "{covariance}");
            assert!(covariance[(2, 2)].sqrt() < 0.02, "{covariance}");
        }
    }

    #[test]
    fn a_scan_corrects_what_is_tracked_and_a_step_begins_anew() {
        let mut tracker = drive(|_, pose| pose);
        let corrected = Motion { mean: Pose::new(4.0, 0.5, 0.0), covariance: nalgebra::Matrix3::identity() * 1e-6 };
        tracker.correct(corrected);
        let floor = |motion: &Motion| (motion.covariance[(0, 0)] - corrected.covariance[(0, 0)]).sqrt();
        assert!(tracker.tracked().mean == corrected.mean && (floor(&tracker.tracked()) - 0.01).abs() < 1e-9);
        tracker.add(10.0, Pose::new(5.0, 0.0, 0.0));
        let Motion { mean, covariance } = tracker.tracked();
        assert!((mean.x - 4.05).abs() < 1e-9 && (tracker.by_odometry().mean.x - 5.0).abs() < 1e-9);
        assert!((covariance[(0, 0)] - 1e-6 - (0.01f64 + 0.1 * 0.05).powi(2)).abs() < 1e-9, "{covariance}");
        tracker.begin_step();
        assert_eq!((tracker.tracked().mean, tracker.by_odometry().mean), (Pose::IDENTITY, Pose::IDENTITY));
    }

    /// Odometry stands still for half a second, while scans follow the robot; then it makes up for what it missed. A step may
    /// be taken meanwhile.
    #[test]
    fn late_odometry_begins_where_it_stalled() {
        for steps in [false, true] {
            let mut tracker = Tracker::new(CONFIG, TrackingConfig::default());
            let pose = |reading: u32| Pose::new(100.1 + 0.05 * f64::from(reading), 7.3, 0.0);
            for reading in 0..20 {
                tracker.add(0.1 * f64::from(reading), pose(reading));
            }
            tracker.begin_step();
            for reading in 20..25 {
                tracker.add(0.1 * f64::from(reading), pose(19));
                let sigma = tracker.tracked().covariance[(0, 0)].sqrt();
                assert!(sigma > 0.05, "{sigma}: as if it had been measured");
                let moved = if steps { 0.05 } else { 0.05 * f64::from(reading - 19) };
                tracker.correct(Motion { mean: Pose::new(moved, 0.0, 0.0), ..Motion::none() });
                if steps {
                    tracker.begin_step();
                }
            }
            tracker.add(2.5, pose(25));
            let expected = if steps { 0.05 } else { 0.3 };
            for (name, Motion { mean, covariance }) in
                [("tracked", tracker.tracked()), ("by odometry", tracker.by_odometry())]
            {
                assert!((mean.x - expected).abs() < 1e-9, "{name} {steps}: {mean:?}");
                // It may be late still.
                assert!(covariance[(0, 0)].sqrt() > 0.25, "{name} {steps}: {covariance}");
            }
            tracker.correct(Motion { mean: Pose::new(expected, 0.0, 0.0), ..Motion::none() });
            tracker.add(2.6, pose(26));
            let Motion { mean, covariance } = tracker.tracked();
            assert!(
                (mean.x - expected - 0.05).abs() < 1e-9 && covariance[(0, 0)].sqrt() < 0.02,
                "{mean:?} {covariance}"
            );
        }
    }

    /// A scan between two odometry readings repeats the first one, and its correction stays; also where the clock once went
    /// back.
    #[test]
    fn a_scan_between_two_readings_is_no_stall() {
        let mut tracker = Tracker::new(CONFIG, TrackingConfig::default());
        let pose = |reading: u32| Pose::new(0.05 * f64::from(reading), 0.0, 0.0);
        let stamp = |reading: u32| if reading < 5 { 100.0 } else { 0.0 } + 0.1 * f64::from(reading);
        for reading in 0..20 {
            tracker.add(stamp(reading), pose(reading));
        }
        tracker.begin_step();
        tracker.add(1.94, pose(19));
        tracker.correct(Motion { mean: Pose::new(0.03, 0.0, 0.0), ..Motion::none() });
        tracker.add(2.0, pose(20));
        assert!((tracker.tracked().mean.x - 0.08).abs() < 1e-9, "{:?}", tracker.tracked());
    }

    /// A reading of odometry every 2.5 s, at 0.4 m/s; it starts again 7 m off, which is 2.8 m/s, or is 7 m off once. A robot that drives
    /// off at 2 m/s is believed at the second reading, and what no robot can drive never.
    #[test]
    fn a_jump_between_readings_that_are_far_apart_is_no_motion() {
        let drive = |places: &[f64]| {
            let mut tracker = Tracker::new(CONFIG, TrackingConfig::default());
            (0..10).for_each(|reading| tracker.add(2.5 * f64::from(reading), Pose::new(f64::from(reading), 0.0, 0.0)));
            for (reading, &x) in (10..).zip(places) {
                tracker.add(2.5 * f64::from(reading), Pose::new(x, 0.0, 0.0));
            }
            (tracker.by_odometry().mean.x, tracker.refused().to_vec())
        };
        let (x, refused) = drive(&[3.0, 4.0, 5.0]);
        assert_eq!(refused, [25.0]);
        // Nine metres, a second at 0.4 m/s, two metres.
        assert!((x - 11.4).abs() < 1e-6, "{x}");
        let (x, refused) = drive(&[17.0, 11.0, 12.0]);
        assert_eq!(refused, [25.0]);
        assert!((x - 12.0).abs() < 1e-6, "{x}");
        // Off twice, at different places.
        let (x, refused) = drive(&[17.0, 2.0, 12.0]);
        assert_eq!(refused, [25.0, 27.5]);
        assert!((x - 12.0).abs() < 1e-6, "{x}");
        let (x, refused) = drive(&[14.0, 19.0, 24.0, 29.0]);
        assert_eq!(refused, [25.0]);
        assert!((x - 24.4).abs() < 1e-6, "{x}");
        assert_eq!(drive(&[100.0, 200.0, 300.0]).1, [25.0, 27.5, 30.0]);
        // Twice as fast is no jump, and neither is walking pace after a crawl.
        assert!(drive(&[11.0, 13.0]).1.is_empty());
    }

    /// At 0.4 m/s, a reading of odometry every 2.5 s; one is 4 m to the left, which is 1.6 m/s to it and from it. A step may be taken
    /// there.
    #[test]
    fn a_reading_that_is_off_is_left_out() {
        for steps in [false, true] {
            let mut tracker = Tracker::new(CONFIG, TrackingConfig::default());
            for reading in 0..10 {
                tracker.add(2.5 * f64::from(reading), Pose::new(f64::from(reading), 0.0, 0.0));
            }
            let from_ninth = if steps { 0.0 } else { 9.0 };
            if steps {
                tracker.begin_step();
            }
            tracker.add(25.0, Pose::new(10.0, 4.0, 0.0));
            // The scan there was matched to a wrong place, too.
            tracker.correct(Motion { mean: Pose::new(from_ninth + 3.0, 0.5, 0.1), ..Motion::none() });
            let wrong = tracker.tracked().mean;
            if steps {
                tracker.begin_step();
            }
            tracker.add(27.5, Pose::new(11.0, 0.0, 0.0));
            let expected = Pose::new(from_ninth + 2.0, 0.0, 0.0);
            let found = if steps { wrong * tracker.tracked().mean } else { tracker.tracked().mean };
            let off = found.seen_from(expected);
            assert!(off.x.abs() < 1e-9 && off.y.abs() < 1e-9 && off.heading.abs() < 1e-9, "{steps}: {found:?}");
            assert_eq!(tracker.refused(), [25.0]);
        }
    }

    /// A robot that has stood for an hour is not a mile away at the next reading.
    #[test]
    fn a_jump_after_a_rest_is_no_motion() {
        let mut tracker = Tracker::new(CONFIG, TrackingConfig::default());
        for (stamp, x) in [(0.0, 0.0), (1.0, 0.0), (3600.0, 0.0), (3600.1, 20.0), (3600.2, 20.05)] {
            tracker.add(stamp, Pose::new(x, 0.0, 0.0));
        }
        assert_eq!(tracker.refused(), [3600.1]);
        assert!((tracker.by_odometry().mean.x - 0.05).abs() < 1e-9);
    }
}
