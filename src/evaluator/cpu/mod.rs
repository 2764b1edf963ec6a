//! The evaluator on the CPU, on all cores. Each file is the twin of the kernel of its name in `shaders/`.

use super::grouping::{ParticleGroup, by_place, in_order};
use super::pose::LocalPose;
use super::sighting::Sighting;
use super::{Advance, Evaluator, Mode, PosePrior, Propagation, Proposal, Scene, Weighed};
use crate::evaluator::tiles::Tile;
use crate::gpu::DeviceError;
use crate::likelihood::ClusterParams;
use crate::map::Slot;
use cull::{Candidates, LocalMap};
use rayon::prelude::*;

mod associate;
pub mod cull;
mod draw;
mod likeliest;
mod propagate;
mod refine;
mod weigh;

pub use likeliest::View;
pub use refine::Evaluation;
use refine::refine;

/// The evaluator on the CPU. It never fails.
#[derive(Clone, Copy, Debug, Default)]
pub struct CpuEvaluator;

/// Particles that climb together: few, so that tracking between steps, which has few, keeps all cores busy.
const CLIMBERS: usize = 16;
/// Particles that are weighed together: many, so that their lists cost little next to what they serve.
const WEIGHED: usize = 64;

impl Evaluator for CpuEvaluator {
    fn propagate(&mut self, scene: &Scene<'_>, how: &Propagation<'_>) -> Result<Vec<Proposal>, DeviceError> {
        Ok(propagate_all(scene, how))
    }

    fn weigh(&mut self, scene: &Scene<'_>, poses: &[LocalPose]) -> Result<Vec<f32>, DeviceError> {
        Ok(weigh_all(scene, poses))
    }

    fn advance(&mut self, scene: &Scene<'_>, how: &Advance, poses: &[LocalPose]) -> Result<Vec<Weighed>, DeviceError> {
        Ok(advance_all(scene, how, poses))
    }

    fn associate(&mut self, sighting: &Sighting<'_>, poses: &[LocalPose]) -> Result<Vec<f32>, DeviceError> {
        Ok(associate_all(sighting, poses))
    }
}

/// As [`Evaluator::propagate`].
pub fn propagate_all(scene: &Scene<'_>, how: &Propagation<'_>) -> Vec<Proposal> {
    let propose = |ParticleGroup { map, particles }: ParticleGroup| {
        let sampled: Vec<LocalPose> =
            particles.iter().map(|&particle| propagate::propagate(particle, map, how)).collect();
        if how.iterations == 0 {
            let stay = |&drawn: &LocalPose| Proposal { drawn, mode: Mode { pose: drawn, ..Mode::default() } };
            return sampled.iter().map(stay).collect::<Vec<_>>();
        }
        let prior = PosePrior { pose: how.starts[map].prior, information: how.prior_information };
        let slots = &scene.maps[map];
        let thick = thick_map(scene, slots, how.capture_sigma);
        let captured: Vec<LocalPose> =
            refine(&thick, &sampled, &prior, scene.tiles, how.iterations / 2).iter().map(|mode| mode.pose).collect();
        let modes = refine(&local_map(scene, slots), &captured, &prior, scene.tiles, how.iterations);
        particles.iter().zip(modes).map(|(&particle, mode)| draw::draw(particle, mode, how)).collect()
    };
    in_order(how.starts.len(), how.particles_per_map, CLIMBERS).into_par_iter().flat_map_iter(propose).collect()
}

/// As [`Evaluator::weigh`].
pub fn weigh_all(scene: &Scene<'_>, poses: &[LocalPose]) -> Vec<f32> {
    // Once a map: with many particles there are many groups of each.
    let maps: Vec<LocalMap> = scene.maps.par_iter().map(|slots| local_map(scene, slots)).collect();
    let weigh = |group: &ParticleGroup| {
        let poses: Vec<LocalPose> = group.particles.iter().map(|&particle| poses[particle as usize]).collect();
        weigh::weigh(&maps[group.map], scene.tiles, &poses)
    };
    let groups = by_place(scene.maps.len(), poses, WEIGHED);
    let weighed: Vec<Vec<f32>> = groups.par_iter().map(weigh).collect();
    let mut log_likelihoods = vec![0.0; poses.len()];
    for (group, weighed) in groups.iter().zip(weighed) {
        for (&particle, log_likelihood) in group.particles.iter().zip(weighed) {
            log_likelihoods[particle as usize] = log_likelihood;
        }
    }
    log_likelihoods
}

/// As [`Evaluator::advance`].
pub fn advance_all(scene: &Scene<'_>, how: &Advance, poses: &[LocalPose]) -> Vec<Weighed> {
    let map = thick_map(scene, scene.maps.first().map_or(&[], Vec::as_slice), how.capture_sigma);
    let advance = |(group, poses): (usize, &[LocalPose])| {
        let moved = |(particle, pose): (u32, &LocalPose)| propagate::advance(particle, *pose, how);
        let poses: Vec<LocalPose> = ((group * WEIGHED) as u32..).zip(poses).map(moved).collect();
        let log_likelihoods = weigh::weigh(&map, scene.tiles, &poses);
        let weighed = |(pose, log_likelihood)| Weighed { pose, log_likelihood };
        poses.into_iter().zip(log_likelihoods).map(weighed).collect::<Vec<_>>()
    };
    poses.par_chunks(WEIGHED).enumerate().flat_map_iter(advance).collect()
}

/// As [`Evaluator::associate`].
pub fn associate_all(sighting: &Sighting<'_>, poses: &[LocalPose]) -> Vec<f32> {
    let Sighting { seen, horizon, landmarks } = sighting;
    let poses_per_map = (poses.len() / landmarks.len().max(1)).max(1);
    let associate = |(number, &pose): (usize, &LocalPose)| {
        associate::associate(seen, horizon, &landmarks[number / poses_per_map], pose)
    };
    poses.par_iter().enumerate().map(associate).collect()
}

/// A scan matched to a map.
#[derive(Clone, Debug, PartialEq)]
pub struct Matched {
    /// The mode of the posterior that Gauss-Newton steps from the mean of the prior climb to.
    pub mode: Mode,
    /// For each point the number of its likeliest cluster from there (the maximum of eq. 18); `None` for an outlier.
    pub likeliest: Vec<Option<usize>>,
}

/// Matches one scan to one map. [`Evaluator`] has many particles for one scan, smoothing has many scans and one pose of each: it
/// calls this for each scan, on all cores.
pub fn match_scan(
    clusters: impl IntoIterator<Item = ClusterParams>,
    log_outlier: f32,
    prior: &PosePrior,
    tiles: &[Tile],
    iterations: u32,
) -> Matched {
    let map = LocalMap::new(clusters, log_outlier);
    let stay = Mode { pose: prior.pose, information: prior.information, ..Mode::default() };
    let mode = refine(&map, &[prior.pose], prior, tiles, iterations).first().copied().unwrap_or(stay);
    let mut candidates = Candidates::default();
    candidates.cover(&map, tiles, &[mode.pose], [0.0; 2]);
    let likeliest = View { tiles, candidates: &candidates, log_outlier }.explain(mode.pose);
    Matched { mode, likeliest }
}

fn local_map(scene: &Scene<'_>, slots: &[Slot]) -> LocalMap {
    LocalMap::new(slots.iter().map(|&slot| scene.table.rows()[slot as usize]), scene.table.log_outlier())
}

fn thick_map(scene: &Scene<'_>, slots: &[Slot], capture_sigma: f32) -> LocalMap {
    let rows = slots.iter().map(|&slot| scene.table.rows()[slot as usize].thickened(capture_sigma));
    LocalMap::new(rows, scene.table.log_outlier())
}
