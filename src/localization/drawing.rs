//! How particles are drawn: around the initial pose, from the whole free area, and by resampling after each step.

use super::bins::bin;
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

/// Weight of a particle from anywhere relative to the others: robots are seldom carried away, and a place where the map lacks
/// some walls is still the most likely.
const CARRIED_AWAY: f64 = 0.1;

/// A pose that the robot may have.
#[derive(Clone, Copy)]
pub(super) struct Particle {
    pub pose: LocalPose,
    /// Index of its parent; `u32::MAX` if it was drawn from the whole free area.
    pub parent: u32,
    /// Its share of the weight before it is weighed.
    pub share: f64,
    /// Accumulated evidence for its place.
    pub evidence: f64,
}

/// Particles, and the number of bins that they occupy.
pub(super) struct Drawn {
    pub particles: Vec<Particle>,
    pub bins: usize,
}

impl Localization {
    /// Resamples every cloud by itself: it keeps its share of the weight and gets the number of particles that the KLD bound asks
    /// for. Particles from anywhere take a share of the weight from all. They start with the evidence of the heaviest place where
    /// that is negative, as no place has explained the steps so far.
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
                Particle {
                    pose: weighed[parent as usize].pose,
                    parent,
                    share,
                    evidence: self.evidence[parent as usize],
                }
            }));
        };
        let count = |share: f64| (share * enough as f64).round() as usize;
        // A quarter of all particles may come from anywhere, and as many may be strays: clouds would take all there are.
        let room = max_particles - 2 * count(from_anywhere).min(max_particles / 4);
        let mut left = max_particles;
        for (number, members) in (1..).zip(&clouds.clouds) {
            let cloud = Stratum::new(members.clone(), weights);
            let least = (min_particles.min(room) as f64 * cloud.weight() / all.weight()).round().max(1.0) as usize;
            let most = (room / clouds.clouds.len()).max(1);
            let count = sample_size(least, most, |number| bin(drawn(&cloud, number))).particles;
            draw(&cloud, number, count);
            left -= count.min(left);
        }
        let new = count(from_anywhere).min(left / 2);
        // As many strays are kept as particles come from anywhere: one of them may be at the right place.
        let strays = Stratum::new(clouds.strays.clone(), weights);
        if strays.weight() > 0.0 {
            let kept = count(from_anywhere.max(strays.weight() / all.weight())).min(left - new);
            draw(&strays, 0, if clouds.clouds.is_empty() { kept.max(1) } else { kept });
        }
        let share = share_from_anywhere / new as f64;
        let evidence = self.best_evidence.min(0.0);
        let from = |number| Particle { pose: self.anywhere(self.steps, number), parent: u32::MAX, share, evidence };
        particles.extend((0..new as u32).map(from));
        Drawn { particles, bins }
    }

    /// Particles around the initial pose, or anywhere; as many as the KLD bound asks for.
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
        let particle = |number| Particle { pose: pose(number), parent: number, share, evidence: 0.0 };
        Drawn { particles: (0..count as u32).map(particle).collect(), bins }
    }

    /// The number of particles that the KLD bound asks for, and the number of their bins.
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

/// Particles that are resampled by themselves.
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

    /// The member at this share, 0 to 1, of the cumulative weight.
    fn drawn(&self, share: f64) -> u32 {
        let target = share * self.weight();
        let index = self.sums.partition_point(|&sum| sum <= target);
        self.members[index.min(self.members.len() - 1)]
    }
}

/// Sorts particles by place: systematic resampling of sorted particles has the least variance, place by place.
pub(super) fn in_order(mut particles: Vec<Particle>) -> Vec<Particle> {
    sort_by_place(&mut particles, |particle| particle.pose);
    particles
}

/// A number in [0, 1] of 64 random bits.
fn fraction(high: u32, low: u32) -> f64 {
    (f64::from(high) + f64::from(low) / 4_294_967_296.0) / 4_294_967_296.0
}
