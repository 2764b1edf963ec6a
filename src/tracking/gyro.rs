//! A gyroscope: how far the robot turns between two readings, less a bias that scans show.
//!
//! Over a second or more, scan matching finds a turn θ and the gyroscope ∫ω dt = θ + b t + noise, where b is its bias \[rad/s\]. So each
//! such window measures b, whether the robot stands or drives, and a Kalman filter of this one number takes it in.
//!
//! A gyroscope may be stuck, in other units, or mounted otherwise than it says. It is believed as long as most of the turns that it
//! measured were those that scans saw; before the first of them it is not.

use crate::geometry::wrap_angle;
use serde::Serialize;

/// What a gyroscope had to say in a drive.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct GyroUse {
    /// Readings whose turn it measured.
    pub measured: u64,
    /// Of these, those where it was believed.
    pub believed: u64,
    /// Its bias \[rad/s\].
    pub bias: f64,
}

/// Standard deviation of the bias before anything is known of it \[rad/s\]: the offset of a cheap sensor without calibration.
const FIRST_BIAS: f64 = 0.1;
/// How far a bias wanders in a second, standard deviation \[rad/s\]: by some 0.01 rad/s in an hour, with the temperature.
const DRIFT: f64 = 2e-4;
/// Turns are compared over this time at least \[s\]: over less, the scan match is too inexact to show a bias.
const WINDOW: f64 = 1.0;
/// A turn shows whether the gyroscope is right where it is this many standard deviations long ...
const SEEN: f64 = 4.0;
/// ... and the two agree where they differ by no more than this many, ...
const AGREE: f64 = 3.0;
/// ... and this share of the turn: a wrong scale factor is a few per cent.
const SCALE: f64 = 0.1;
/// It is believed where more than this share of the turns agree.
const BELIEVED: f64 = 0.5;
/// Weight of a new turn in the running share of those that agree: it covers about five of them.
const SHARE: f64 = 0.2;

/// What is known of the gyroscope.
#[derive(Clone, Debug)]
pub(super) struct Gyro {
    /// How far the robot turned since the last reading, if that was measured \[rad\].
    pending: Option<f64>,
    bias: f64,
    /// Variance of the bias.
    variance: f64,
    /// Running share of the turns that were those that scans saw.
    agreement: f64,
    window: Option<Window>,
    measured: u64,
    believed: u64,
}

/// From one scan match to another.
#[derive(Clone, Copy, Debug)]
struct Window {
    /// By the gyroscope \[rad\].
    turn: f64,
    seconds: f64,
    /// Heading and its variance at the first scan match, relative to the last step.
    heading: f64,
    variance: f64,
}

impl Default for Gyro {
    fn default() -> Self {
        Self {
            pending: None,
            bias: 0.0,
            variance: FIRST_BIAS * FIRST_BIAS,
            agreement: 0.0,
            window: None,
            measured: 0,
            believed: 0,
        }
    }
}

impl Gyro {
    /// Takes what the gyroscope measured since the last reading \[rad\].
    pub(super) fn add(&mut self, turn: f64) {
        // Odometry that is no number is no reading here, and left a turn behind.
        let turn = self.pending.unwrap_or(0.0) + turn;
        self.pending = turn.is_finite().then_some(turn);
    }

    /// The turn in the time since the last reading \[s\]; `None` where it was not measured or is not believed.
    pub(super) fn take(&mut self, seconds: f64) -> Option<f64> {
        let Some(turn) = self.pending.take() else {
            self.window = None;
            return None;
        };
        if let Some(window) = &mut self.window {
            window.turn += turn;
            window.seconds += seconds;
        }
        self.measured += 1;
        let is_believed = self.agreement > BELIEVED;
        self.believed += u64::from(is_believed);
        is_believed.then_some(turn - self.bias * seconds)
    }

    /// A scan match found this heading, relative to the last step, with this standard deviation \[rad\].
    pub(super) fn compare(&mut self, heading: f64, sigma: f64) {
        let now = Window { turn: 0.0, seconds: 0.0, heading, variance: sigma * sigma };
        match self.window {
            Some(window) if window.seconds < WINDOW => {}
            Some(window) => {
                self.learn(&window, wrap_angle(heading - window.heading), window.variance + now.variance);
                self.window = Some(now);
            }
            None => self.window = Some(now),
        }
    }

    /// Learns from a turn that scans saw, with its variance.
    fn learn(&mut self, &Window { turn, seconds, .. }: &Window, by_scans: f64, variance: f64) {
        self.variance += DRIFT * DRIFT * seconds;
        let expected = turn - self.bias * seconds;
        let (off, noise) = (expected - by_scans, (variance + self.variance * seconds * seconds).sqrt());
        let longest = by_scans.abs().max(expected.abs());
        let agrees = off.abs() < AGREE * noise + SCALE * by_scans.abs();
        if longest > SEEN * noise {
            self.agreement += SHARE * (f64::from(u8::from(agrees)) - self.agreement);
        }
        if agrees {
            let gain = self.variance / (self.variance + variance / (seconds * seconds));
            self.bias += gain * off / seconds;
            self.variance *= 1.0 - gain;
        }
    }

    /// A step begins at this heading, relative to the last one.
    pub(super) fn begin_step(&mut self, heading: f64) {
        if let Some(window) = &mut self.window {
            window.heading -= heading;
        }
    }

    /// `None` where there is no gyroscope.
    pub(super) fn used(&self) -> Option<GyroUse> {
        let Self { measured, believed, bias, .. } = *self;
        (measured > 0).then_some(GyroUse { measured, believed, bias })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Draw, normals};

    /// Bias of the gyroscope \[rad/s\].
    const BIAS: f64 = 0.05;
    /// Standard deviation of the headings that scan matching finds \[rad\].
    const SIGMA: f64 = 0.005;

    /// How far the robot turns in the tenth of a second before a reading, and in all: it stands for five seconds, and then turns for ten,
    /// now to the left and now to the right.
    fn turn(reading: u32) -> f64 {
        match reading {
            0..50 => 0.0,
            _ if (reading / 10).is_multiple_of(2) => 0.04,
            _ => -0.03,
        }
    }

    /// Drives; `spoil` changes what the gyroscope says. Returns the error of each reading's turn, where one is given.
    fn drive(gyro: &mut Gyro, spoil: impl Fn(u32, f64) -> Option<f64>) -> Vec<Option<f64>> {
        let mut heading = 0.0;
        let after = |reading: u32| {
            heading += turn(reading);
            if let Some(measured) = spoil(reading, turn(reading) + 0.1 * BIAS) {
                gyro.add(measured);
            }
            let given = gyro.take(0.1);
            let [noise, ..] = normals(3, 0, reading, Draw::Motion);
            gyro.compare(heading + SIGMA * f64::from(noise), SIGMA);
            if reading.is_multiple_of(7) {
                gyro.begin_step(heading);
                heading = 0.0;
            }
            given.map(|given| given - turn(reading))
        };
        (0..400).map(after).collect()
    }

    #[test]
    fn the_bias_is_learnt_from_scans() {
        let mut gyro = Gyro::default();
        let errors = drive(&mut gyro, |_, measured| Some(measured));
        let GyroUse { measured, believed, bias } = gyro.used().unwrap();
        // 39 windows of a second, each of which measures it to 0.007 rad/s.
        assert!((bias - BIAS).abs() < 0.004, "{bias}");
        assert!(errors[..50].iter().all(Option::is_none), "believed before it was seen to be right");
        assert!(measured == 400 && believed > 300, "{measured} {believed}");
        assert!(errors[100..].iter().all(|error| error.is_some_and(|error| error.abs() < 1e-3)), "{errors:?}");
    }

    #[test]
    fn a_gyroscope_that_is_wrong_is_not_believed() {
        type Spoil = fn(u32, f64) -> Option<f64>;
        let wrong: [(&str, Spoil); 5] = [
            ("stuck", |_, _| Some(0.02)),
            ("dead", |_, _| Some(0.0)),
            ("upside down", |_, measured| Some(-measured)),
            ("degrees", |_, measured| Some(measured.to_degrees())),
            ("no number", |_, _| Some(f64::NAN)),
        ];
        for (name, spoil) in wrong {
            let mut gyro = Gyro::default();
            let given = drive(&mut gyro, spoil).into_iter().flatten().count();
            assert_eq!(given, 0, "{name}: {gyro:?}");
        }
        assert_eq!(Gyro::default().used(), None);
    }

    #[test]
    fn one_that_fails_is_given_up_and_taken_again() {
        let mut gyro = Gyro::default();
        let errors = drive(&mut gyro, |reading, measured| match reading {
            150..250 => Some(0.02),
            300..310 => None,
            _ => Some(measured),
        });
        assert!(errors[140].is_some() && errors[200..250].iter().all(Option::is_none), "{errors:?}");
        assert!(errors[300..310].iter().all(Option::is_none));
        assert!(errors[395].is_some_and(|error| error.abs() < 1e-3), "{errors:?}");
    }
}
