//! Particles that hang together: the places where the robot may be.

use super::drawing::{BIN, bin};
use crate::evaluator::Weighed;
use std::collections::{BTreeMap, HashMap};
use std::f64::consts::TAU;

/// A cloud hangs together by bins with at least this share of the weight: strays do not tie two of them together.
const LIGHTEST_BIN: f64 = 1e-4;
/// A cloud has at least this share of the weight: the doubt that is let pass.
pub(super) const LIGHTEST_CLOUD: f64 = 0.01;

/// Which particles are in which cloud, by their numbers.
pub(super) struct Clouds {
    /// In the order of where they are.
    pub clouds: Vec<Vec<u32>>,
    /// In none.
    pub strays: Vec<u32>,
}

impl Clouds {
    /// Bins that have much of the weight, as far as they touch, with the bins around them.
    pub fn of(particles: &[Weighed], shares: &[f64]) -> Self {
        let bins: Vec<[i32; 3]> = particles.iter().map(|particle| bin(particle.pose)).collect();
        let mut shares_of: HashMap<[i32; 3], f64> = HashMap::new();
        for (&bin, share) in bins.iter().zip(shares) {
            *shares_of.entry(bin).or_default() += share;
        }
        let mut heavy: BTreeMap<[i32; 3], f64> =
            shares_of.into_iter().filter(|&(_, share)| share >= LIGHTEST_BIN).collect();
        let (mut cloud_of, mut count) = (HashMap::new(), 0);
        while let Some((first, share)) = heavy.pop_first() {
            let (mut cloud, mut total, mut next) = (vec![first], share, 0);
            while let Some(&bin) = cloud.get(next) {
                for neighbour in neighbours(bin) {
                    if let Some(share) = heavy.remove(&neighbour) {
                        cloud.push(neighbour);
                        total += share;
                    }
                }
                next += 1;
            }
            if total >= LIGHTEST_CLOUD {
                cloud_of.extend(cloud.into_iter().flat_map(neighbours).map(|bin| (bin, count)));
                count += 1;
            }
        }
        let (mut clouds, mut strays) = (vec![Vec::new(); count], Vec::new());
        for (number, bin) in (0..).zip(&bins) {
            cloud_of.get(bin).map_or(&mut strays, |&cloud| &mut clouds[cloud]).push(number);
        }
        Self { clouds, strays }
    }
}

/// A bin and those around it; headings go round.
fn neighbours([x, y, heading]: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    let turn = (TAU / BIN[2]).round() as i32;
    let wrapped = move |heading: i32| (heading + turn / 2).rem_euclid(turn) - turn / 2;
    (0..27).map(move |n| [x + n % 3 - 1, y + n / 3 % 3 - 1, wrapped(heading + n / 9 - 1)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluator::pose::LocalPose;

    /// Particles in a row of bins, each with a share of the weight.
    fn row(bins: &[(i32, i32, f64)]) -> (Vec<Weighed>, Vec<f64>) {
        let at = |&(x, heading, share): &(i32, i32, f64)| {
            let pose =
                LocalPose { x: 0.5 * x as f32 + 0.2, y: 0.1, heading: (10.0 * heading as f32 + 4.0).to_radians() };
            (Weighed { pose, log_likelihood: 0.0 }, share)
        };
        bins.iter().map(at).unzip()
    }

    #[test]
    fn bins_that_touch_are_one_cloud() {
        // A cloud over three bins, one at its edge light; one that lies across the turn of headings; strays.
        let (particles, shares) = row(&[
            (0, 0, 0.3),
            (1, 1, 0.1),
            (2, 1, 1e-5),
            (3, 1, 1e-5),
            (10, 17, 0.2),
            (10, -18, 0.3),
            (20, 0, 0.009),
            (30, 0, 0.09),
        ]);
        let Clouds { clouds, strays } = Clouds::of(&particles, &shares);
        assert_eq!(clouds, [vec![0, 1, 2], vec![4, 5], vec![7]]);
        assert_eq!(strays, [3, 6]);
    }

    #[test]
    fn a_light_bin_ties_nothing_together() {
        let (particles, shares) = row(&[(0, 0, 0.5), (1, 0, 1e-5), (2, 0, 0.5)]);
        let Clouds { clouds, .. } = Clouds::of(&particles, &shares);
        assert_eq!(clouds, [vec![0], vec![1, 2]], "the bin between them is in one of them");
        assert!(Clouds::of(&[], &[]).clouds.is_empty());
    }
}
