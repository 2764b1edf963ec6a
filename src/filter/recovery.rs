//! Augmented MCL: a robot that was carried away is found again (S. Thrun, W. Burgard, D. Fox, "Probabilistic Robotics",
//! table 8.3).

/// Long and short averages of how well scans fit. Where the short one falls below the long one, or below what is enough,
/// particles from anywhere are mixed in: where scans never fit, nothing is lost by looking elsewhere.
#[derive(Clone, Copy, Debug)]
pub struct Recovery {
    enough: f64,
    slow: f64,
    fast: f64,
}

/// Decay rate of the long average: about fifty steps, 15 m of way.
const ALPHA_SLOW: f64 = 0.02;
/// Decay rate of the short average: about three steps, so that one bad scan does not scatter the particles.
const ALPHA_FAST: f64 = 0.3;

impl Recovery {
    /// Both averages start at what is enough, from 0 to 1.
    pub fn new(enough: f64) -> Self {
        Self { enough, slow: enough, fast: enough }
    }

    /// Takes in how well a scan fits, from 0 to 1; returns the share of particles that should come from anywhere,
    /// max(0, 1 - fast / max(slow, enough)).
    pub fn update(&mut self, fit: f64) -> f64 {
        self.slow += ALPHA_SLOW * (fit - self.slow);
        self.fast += ALPHA_FAST * (fit - self.fast);
        let usual = self.slow.max(self.enough);
        if usual > 0.0 { (1.0 - self.fast / usual).max(0.0) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Table 8.3 by hand: from 0.6 up to 0.608, then a scan that fits not at all leaves 0.59584 and 0.504.
    #[test]
    fn particles_come_from_anywhere_where_scans_fit_worse_than_they_used_to() {
        let mut recovery = Recovery::new(0.6);
        assert_eq!(recovery.update(0.6), 0.0);
        assert_eq!(recovery.update(1.0), 0.0, "better than before");
        assert!((recovery.update(0.0) - (1.0 - 0.504 / 0.6)).abs() < 1e-12);
        assert_eq!(Recovery::new(0.0).update(0.0), 0.0);
    }

    /// However long it has been so: from then on a third of the particles.
    #[test]
    fn particles_come_from_anywhere_where_scans_never_fit() {
        let mut recovery = Recovery::new(0.6);
        let last = (0..1000).map(|_| recovery.update(0.4)).last();
        assert!((last.unwrap_or(0.0) - 1.0 / 3.0).abs() < 1e-6, "{last:?}");
    }
}
