//! Clouds, that is connected components of particles: the places where the robot may be.

use super::bins::{bin, neighbours};
use crate::evaluator::Weighed;
use std::collections::{BTreeMap, HashMap};

/// Bins with at least this share of the weight connect a cloud: strays do not join two clouds.
const LIGHTEST_BIN: f64 = 1e-4;
/// A cloud has at least this share of the weight; lighter places are neglected.
pub(super) const LIGHTEST_CLOUD: f64 = 0.01;

/// The clouds, as indices of particles.
pub(super) struct Clouds {
    /// Sorted by place.
    pub clouds: Vec<Vec<u32>>,
    /// Particles in no cloud.
    pub strays: Vec<u32>,
}

impl Clouds {
    /// Connected components of heavy bins, each with the bins around it. `shares` are the particles' shares of the weight.
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
    fn a_light_bin_joins_no_clouds() {
        let (particles, shares) = row(&[(0, 0, 0.5), (1, 0, 1e-5), (2, 0, 0.5)]);
        let Clouds { clouds, .. } = Clouds::of(&particles, &shares);
        assert_eq!(clouds, [vec![0], vec![1, 2]], "the bin between them is in one of them");
        assert!(Clouds::of(&[], &[]).clouds.is_empty());
    }
}
