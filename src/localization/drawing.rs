//! How particles are drawn: around the initial pose, anywhere, and anew after each step.

use super::clouds::Clouds;
use super::{InitialPose, Localization, LocalizationConfig};
use crate::evaluator::Weighed;
use crate::evaluator::grouping::sort_by_place;
use crate::evaluator::pose::LocalPose;
use crate::filter::kld::{SampleSize, sample_size};
use crate::filter::resampling::resample;
use crate::geometry::Pose;
use crate::random::{Draw, bits, normals};
use std::f64::consts::{PI, TAU};

/// Size of a bin of KLD sampling, and of the search for clouds \[m, m, rad\].
pub(super) const BIN: [f64; 3] = [0.5, 0.5, PI / 18.0];

/// Particles from anywhere have this share of the weight of others: robots are seldom carried away, and a place where the map
/// lacks something for a while is still the likeliest.
const CARRIED_AWAY: f64 = 0.1;

/// A pose that the robot may have.
#[derive(Clone, Copy)]
pub(super) struct Particle {
    pub pose: LocalPose,
    /// The number of the particle that it was; `u32::MAX` where it comes from anywhere.
    pub parent: u32,
    /// Its share of the weight until it is weighed.
    pub share: f64,
    /// What speaks for the place where it is.
    pub credit: f64,
}

/// Particles, and how many bins they are in.
pub(super) struct Drawn {
    pub particles: Vec<Particle>,
    pub bins: usize,
}

impl Localization {
    /// Draws the particles anew, of every cloud by itself: it keeps its share of the weight, and has as many particles as
    /// it takes to tell its bins apart. Particles from anywhere take a share of the weight from all, and what speaks against
    /// the heaviest place speaks against theirs: nothing has explained the way so far.
    pub(super) fn resample(&self, weighed: &[Weighed], weights: &[f64], clouds: &Clouds, from_anywhere: f64) -> Drawn {
        let LocalizationConfig { max_particles, min_particles, .. } = self.config;
        let words = |number| bits(self.config.seed, self.steps, number, Draw::Resample);
        let all = Stratum::new((0..weighed.len() as u32).collect(), weights);
        let drawn = |stratum: &Stratum, number| {
            let words = words(number);
            weighed[stratum.drawn(fraction(words[1], words[2])) as usize].pose
        };
        let SampleSize { particles: enough, bins } = self.sample_size(|number| {
            let is_from_anywhere = fraction(words(number)[0], 0) < from_anywhere;
            if is_from_anywhere { self.anywhere(self.steps, number) } else { drawn(&all, number) }
        });
        let share_from_anywhere = CARRIED_AWAY * from_anywhere;

        let mut particles = Vec::with_capacity(enough);
        let mut draw = |stratum: &Stratum, number: u32, count: usize| {
            let share = (1.0 - share_from_anywhere) * stratum.weight() / all.weight() / count as f64;
            let offset = fraction(words(u32::MAX - number)[0], 0);
            particles.extend(resample(&stratum.weights, count, offset).into_iter().map(|index| {
                let parent = stratum.members[index];
                Particle { pose: weighed[parent as usize].pose, parent, share, credit: self.credits[parent as usize] }
            }));
        };
        let mut left = max_particles;
        for (number, members) in (1..).zip(&clouds.clouds) {
            let cloud = Stratum::new(members.clone(), weights);
            let least = (min_particles as f64 * cloud.weight() / all.weight()).round().max(1.0) as usize;
            let most = (max_particles / clouds.clouds.len()).max(1);
            let count = sample_size(least, most, |number| bin(drawn(&cloud, number))).particles;
            draw(&cloud, number, count);
            left -= count.min(left);
        }
        let count = |share: f64| (share * enough as f64).round() as usize;
        let new = count(from_anywhere).min(left / 2);
        // Where particles come from anywhere, as many strays are kept: the right place may be among them.
        let strays = Stratum::new(clouds.strays.clone(), weights);
        if strays.weight() > 0.0 {
            let kept = count(from_anywhere.max(strays.weight() / all.weight())).min(left - new);
            draw(&strays, 0, if clouds.clouds.is_empty() { kept.max(1) } else { kept });
        }
        let share = share_from_anywhere / new as f64;
        let credit = self.credit.min(0.0);
        let from = |number| Particle { pose: self.anywhere(self.steps, number), parent: u32::MAX, share, credit };
        particles.extend((0..new as u32).map(from));
        Drawn { particles, bins }
    }

    /// Particles around the initial pose, or anywhere; as many as their bins take.
    pub(super) fn first_particles(&self, initial: Option<InitialPose>) -> Drawn {
        let pose = |number: u32| match initial {
            None => self.anywhere(u32::MAX, number),
            Some(InitialPose { world_from_robot, position_sigma, heading_sigma }) => {
                let [x, y, turn, _] = normals(self.config.seed, u32::MAX, number, Draw::Motion).map(f64::from);
                let Pose { x: x0, y: y0, heading: heading0 } = world_from_robot;
                let pose = Pose::new(x0 + position_sigma * x, y0 + position_sigma * y, heading0 + heading_sigma * turn);
                LocalPose::new(pose, self.walls.table.anchor())
            }
        };
        let SampleSize { particles: count, bins } = self.sample_size(pose);
        let share = 1.0 / count as f64;
        let particle = |number| Particle { pose: pose(number), parent: number, share, credit: 0.0 };
        Drawn { particles: (0..count as u32).map(particle).collect(), bins }
    }

    /// The number of particles that the KLD bound asks for, given the bins that they fall in.
    fn sample_size(&self, particle: impl Fn(u32) -> LocalPose) -> SampleSize {
        let LocalizationConfig { max_particles, min_particles, .. } = self.config;
        sample_size(min_particles, max_particles, |number| bin(particle(number)))
    }

    /// A pose anywhere in the free area.
    fn anywhere(&self, step: u32, number: u32) -> LocalPose {
        let words = bits(self.config.seed, step, number, Draw::Anywhere);
        let position = self.free.sample([fraction(words[0], 0), fraction(words[1], 0)]);
        let heading = TAU * fraction(words[2], 0) - PI;
        LocalPose::new(Pose::new(position.x, position.y, heading), self.walls.table.anchor())
    }
}

/// Particles that are drawn from by themselves.
struct Stratum {
    members: Vec<u32>,
    weights: Vec<f64>,
    /// Sums of the first weights.
    sums: Vec<f64>,
}

impl Stratum {
    fn new(members: Vec<u32>, weights: &[f64]) -> Self {
        let weights: Vec<f64> = members.iter().map(|&number| weights[number as usize]).collect();
        let mut sum = 0.0;
        let add = |weight: &f64| {
            sum += weight;
            sum
        };
        let sums = weights.iter().map(add).collect();
        Self { members, weights, sums }
    }

    fn weight(&self) -> f64 {
        self.sums.last().copied().unwrap_or(0.0)
    }

    /// The member at this share of the weight.
    fn drawn(&self, share: f64) -> u32 {
        let target = share * self.weight();
        let index = self.sums.partition_point(|&sum| sum <= target);
        self.members[index.min(self.members.len() - 1)]
    }
}

/// Orders particles by their places: systematic resampling of neighbours lets no place gain or lose by chance.
pub(super) fn in_order(mut particles: Vec<Particle>) -> Vec<Particle> {
    sort_by_place(&mut particles, |particle| particle.pose);
    particles
}

/// The bin of a pose.
pub(super) fn bin(pose: LocalPose) -> [i32; 3] {
    let at = [pose.x, pose.y, pose.heading].map(f64::from);
    std::array::from_fn(|axis| (at[axis] / BIN[axis]).floor() as i32)
}

/// A number in [0, 1] of 64 random bits.
fn fraction(high: u32, low: u32) -> f64 {
    (f64::from(high) + f64::from(low) / 4_294_967_296.0) / 4_294_967_296.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_are_half_a_metre_and_ten_degrees() {
        let pose = |x: f32, y: f32, degrees: f32| LocalPose { x, y, heading: degrees.to_radians() };
        assert_eq!(bin(pose(0.49, -0.01, 9.9)), [0, -1, 0]);
        assert_eq!(bin(pose(0.51, 0.49, 10.1)), [1, 0, 1]);
        assert_eq!(bin(pose(-7.3, 12.2, -179.0)), [-15, 24, -18]);
    }
}
