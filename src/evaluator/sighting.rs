//! What a detector saw from the robot, and the landmarks of all maps, in f32 as both backends take them.

use bytemuck::{Pod, Zeroable};

/// Detections of a frame that count: the programme over their sets has 2⁸ sums.
pub const MOST_SEEN: usize = 8;
/// Sectors of a horizon.
pub const SECTORS: usize = 128;

/// One detection. Densities are per square metre of the plane.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Seen {
    /// Where the object is, in the robot's frame \[m\].
    pub x: f32,
    /// Likewise.
    pub y: f32,
    /// Covariance of that, by the robot's axes \[m²\].
    pub xx: f32,
    /// Likewise.
    pub xy: f32,
    /// Likewise.
    pub yy: f32,
    /// ln u_k: log-density of a detection of this label here that shows no landmark of the map.
    pub log_null: f32,
    /// WGSL would do without; eight numbers can be loaded in two.
    pub padding: [f32; 2],
}

/// A landmark of one map.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LandmarkRow {
    /// Where it is, in the evaluator's frame \[m\].
    pub x: f32,
    /// Likewise.
    pub y: f32,
    /// Covariance of that \[m²\].
    pub xx: f32,
    /// Likewise.
    pub xy: f32,
    /// Likewise.
    pub yy: f32,
    /// ln of the probability that it is there and detected, where it is in view.
    pub log_detected: f32,
    /// ln of the probability that it is not detected, where it is in view.
    pub log_missed: f32,
    /// As above.
    pub padding: f32,
    /// Of each detection ln p(label | landmark).
    pub log_label: [f32; MOST_SEEN],
}

/// How far the detector can surely see in every direction: no farther than what the laser hit.
///
/// Sectors are even in y / (|x| + |y|), which needs no arc tangent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Horizon {
    /// Where the detector is, in the robot's frame \[m\].
    pub sensor: [f32; 2],
    /// The nearest that it sees \[m\].
    pub min_range: f32,
    /// The farthest in each sector \[m\], counter-clockwise from straight ahead of the robot; 0 where nothing is known.
    pub max_ranges: [f32; SECTORS],
}

impl Horizon {
    /// The sector of a direction.
    pub fn sector(x: f32, y: f32) -> usize {
        let sum = x.abs() + y.abs();
        let quotient = if sum > 0.0 { y / sum } else { 0.0 };
        let turned = if x < 0.0 {
            2.0 - quotient
        } else if quotient < 0.0 {
            4.0 + quotient
        } else {
            quotient
        };
        ((turned * (SECTORS as f32 / 4.0)) as usize).min(SECTORS - 1)
    }

    /// The direction of the middle of a sector \[rad\].
    pub fn middle(sector: usize) -> f64 {
        let turned = (sector as f64 + 0.5) * 4.0 / SECTORS as f64;
        let y = if turned < 1.0 {
            turned
        } else if turned < 3.0 {
            2.0 - turned
        } else {
            turned - 4.0
        };
        let x = if (1.0..3.0).contains(&turned) { y.abs() - 1.0 } else { 1.0 - y.abs() };
        f64::atan2(y, x)
    }

    /// Whether a place, in the robot's frame \[m\], is surely in view.
    pub fn holds(&self, x: f32, y: f32) -> bool {
        let (x, y) = (x - self.sensor[0], y - self.sensor[1]);
        let (square, farthest) = (x * x + y * y, self.max_ranges[Self::sector(x, y)]);
        square <= farthest * farthest && square >= self.min_range * self.min_range
    }
}

/// A frame of detections, and what they may show.
#[derive(Clone, Copy, Debug)]
pub struct Sighting<'a> {
    /// The detections, at most [`MOST_SEEN`]; none where the detector worked and saw nothing.
    pub seen: &'a [Seen],
    /// What is in view.
    pub horizon: &'a Horizon,
    /// For each map its landmarks that may be in view, or detected.
    pub landmarks: &'a [Vec<LandmarkRow>],
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sectors_go_round() {
        for sector in 0..SECTORS {
            let (y, x) = Horizon::middle(sector).sin_cos();
            assert_eq!(Horizon::sector(x as f32, y as f32), sector);
        }
        assert_eq!(Horizon::sector(0.0, 0.0), 0);
        assert_eq!(Horizon::sector(1.0, -1e-9), SECTORS - 1);
    }
}
