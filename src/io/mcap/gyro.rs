//! Rates of rotation, summed up to turns between the readings of a bag.

use std::collections::VecDeque;

/// Rates further apart than this say nothing of the time between \[ns\]: a robot may have turned and stopped.
const MAX_GAP: i64 = 200_000_000;
/// A reading waits so long for rates \[ns\] ...
const PATIENCE: i64 = 300_000_000;
/// ... where the last one is no older than this \[ns\]: a sensor that is switched off holds nothing up.
const ALIVE: i64 = 1_000_000_000;
/// Rates that wait for a reading, at most: those of ten seconds and more.
const MAX_WAITING: usize = 1 << 14;

/// The rates that were read, and the reading that was handed out last.
#[derive(Debug, Default)]
pub(super) struct Gyro {
    /// Stamps \[ns\] and rates \[rad/s\], in their order.
    rates: VecDeque<(i64, f64)>,
    /// Stamp of the last reading \[ns\].
    last: Option<i64>,
}

impl Gyro {
    /// Adds a rate. One that does not come after the one before is left out, unless its clock began anew.
    pub(super) fn add(&mut self, stamp: i64, rate: f64) {
        if self.rates.back().is_some_and(|&(last, _)| last.saturating_sub(stamp) > ALIVE) {
            self.rates.clear();
        }
        if self.rates.back().is_none_or(|&(last, _)| last < stamp) {
            self.rates.push_back((stamp, rate));
        }
        if self.rates.len() > MAX_WAITING {
            self.rates.pop_front();
        }
    }

    /// Whether a reading of this stamp has to wait for rates, while others are there up to `newest` \[ns\].
    pub(super) fn is_awaited(&self, stamp: i64, newest: i64) -> bool {
        let is_near = |&(last, _): &(i64, f64)| last < stamp && stamp.saturating_sub(last) <= ALIVE;
        self.rates.back().is_some_and(is_near) && newest.saturating_sub(stamp) <= PATIENCE
    }

    /// The turn from the reading before to one of this stamp \[rad\], the integral of rates that change evenly from one to the next;
    /// `None` where they do not cover that time.
    pub(super) fn turn(&mut self, stamp: i64) -> Option<f64> {
        let from = self.last.replace(stamp)?;
        // The last one before the reading before stays the first.
        while self.rates.get(1).is_some_and(|&(second, _)| second <= from) {
            self.rates.pop_front();
        }
        let (&(first, _), &(last, _)) = (self.rates.front()?, self.rates.back()?);
        if stamp < from || first > from || last < stamp {
            return None;
        }
        let mut turn = 0.0;
        for ((start, rate), (end, next)) in self.rates.iter().zip(self.rates.iter().skip(1)) {
            if *start >= stamp {
                break;
            }
            let duration = end.saturating_sub(*start);
            if duration > MAX_GAP {
                return None;
            }
            let at = |time: i64| rate + (next - rate) * (time - start) as f64 / duration as f64;
            let (begin, finish) = ((*start).max(from), (*end).min(stamp));
            turn += 0.5 * (at(begin) + at(finish)) * (finish - begin) as f64 / 1e9;
        }
        Some(turn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MILLI: i64 = 1_000_000;

    /// Rates each 10 ms over a second, of this function of the time \[s\].
    fn gyro(rate: impl Fn(f64) -> f64) -> Gyro {
        let mut gyro = Gyro::default();
        (0..=100).for_each(|number: i32| gyro.add(i64::from(number) * 10 * MILLI, rate(f64::from(number) / 100.0)));
        gyro
    }

    /// ∫ 3t² dt = t³, and the trapezoids of 10 ms are off by 3/6 · 10⁻⁴ · t.
    #[test]
    fn a_turn_is_the_integral_of_the_rates() {
        let mut gyro = gyro(|t| 3.0 * t * t);
        assert_eq!(gyro.turn(0), None, "there is no reading before");
        let mut before = 0.0_f64;
        for stamp in [33, 40, 333, 334, 999] {
            let (turn, now) = (gyro.turn(stamp * MILLI).unwrap(), stamp as f64 / 1e3);
            let expected = now.powi(3) - before.powi(3);
            assert!((turn - expected).abs() < 6e-5 * (now - before) + 1e-6, "{stamp}: {turn}, not {expected}");
            before = now;
        }
    }

    #[test]
    fn what_is_not_covered_is_not_measured() {
        let mut gyro = Gyro::default();
        for stamp in (100..=400).chain(700..=900) {
            gyro.add(stamp * MILLI, 1.0);
        }
        let turns = [50, 150, 250, 350, 450, 650, 750, 850, 850, 950, 850].map(|stamp| gyro.turn(stamp * MILLI));
        let is_measured = turns.map(|turn| turn.is_some());
        assert_eq!(is_measured, [false, false, true, true, false, false, false, true, true, false, false], "{turns:?}");
        let measured: Vec<f64> = turns.into_iter().flatten().collect();
        assert!(
            measured.iter().zip([0.1, 0.1, 0.1, 0.0]).all(|(turn, expected)| (turn - expected).abs() < 1e-9),
            "{turns:?}"
        );
    }

    #[test]
    fn readings_wait_for_rates_that_can_be_expected() {
        let gyro = gyro(|_| 0.0);
        for (stamp, newest, is_awaited) in
            [(1000, 1000, false), (1001, 1001, true), (1001, 1400, false), (2100, 2100, false), (1900, 2000, true)]
        {
            assert_eq!(gyro.is_awaited(stamp * MILLI, newest * MILLI), is_awaited, "{stamp} {newest}");
        }
        assert!(!Gyro::default().is_awaited(0, 0));
    }

    #[test]
    fn stamps_may_be_anything() {
        let mut gyro = gyro(|_| 1.0);
        gyro.add(500 * MILLI, 9.0);
        gyro.add(i64::MAX, 9.0);
        gyro.add(i64::MIN, 9.0);
        gyro.add(0, 1.0);
        for stamp in [i64::MIN, 0, i64::MAX, i64::MIN] {
            assert_eq!(gyro.turn(stamp), None);
            assert!(!gyro.is_awaited(stamp, i64::MAX) && !gyro.is_awaited(stamp, i64::MIN));
        }
        (0..100_000).for_each(|number| gyro.add(number, 0.0));
        assert!(gyro.rates.len() <= MAX_WAITING);
    }
}
