//! What the host and the kernels share: the structs of `shaders/shared/layout.wgsl`, field by field.

use crate::evaluator::{Advance, Propagation};
use crate::random::Draw;
use bytemuck::{Pod, Zeroable};

/// Particles of one map that lie close together, one workgroup's work.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Group {
    /// Place of the first among the poses of the dispatch.
    pub first: u32,
    /// How many.
    pub count: u32,
    /// Where the slots of their map begin.
    pub first_slot: u32,
    /// How many slots.
    pub slot_count: u32,
    /// Where the motion leads on average; the motion itself where particles start from their own poses.
    pub mean: [f32; 3],
    /// 1 where the first starts at the mean itself.
    pub exact_first: u32,
    /// Mean of the prior.
    pub prior: [f32; 3],
    /// Number of the first among all particles of the step.
    pub number: u32,
}

/// What a climb leaves of a particle, beside its pose.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct ParticleMode {
    /// Negative Hessian: xx, xy, xh, yy, yh, hh.
    pub information: [f32; 6],
    /// Log-likelihood plus log prior.
    pub log_posterior: f32,
    /// Climbing, due a last evaluation, or settled.
    pub state: u32,
    /// The pose drawn around it.
    pub drawn: [f32; 4],
}

/// The box that the candidate lists of a group hold for.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct GroupBounds {
    /// Its middle.
    pub middle: [f32; 3],
    /// WGSL aligns three numbers as four.
    pub padding: f32,
    /// Half its size.
    pub half: [f32; 3],
    /// As above.
    pub end_padding: f32,
}

/// What is the same for all particles.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Job {
    /// Low and high half.
    pub seed: [u32; 2],
    /// Step that random numbers are for.
    pub step: u32,
    /// Draw that the noise of the motion takes.
    pub draw: u32,
    /// Lower triangle: l00, l10, l11, l20, l21, l22.
    pub noise: [f32; 8],
    /// xx, xy, xh, yy, yh, hh.
    pub prior_information: [f32; 8],
    /// How far outside their poses lists hold.
    pub slack: [f32; 3],
    /// Width of the draws.
    pub spread: f32,
    /// Tiles of the scan.
    pub tile_count: u32,
    /// ln of the density of a point that no cluster explains.
    pub log_outlier: f32,
    /// 1: particles start from where they are, and the mean of their group is a motion.
    pub from_own_pose: u32,
    /// Standard deviation across thick walls at least.
    pub capture_sigma: f32,
    /// 1: the noise of the motion has the tails of Cauchy's distribution.
    pub is_heavy_tailed: u32,
    /// A uniform takes a multiple of 16 bytes.
    pub padding0: u32,
    /// As above.
    pub padding1: u32,
    /// As above.
    pub padding2: u32,
}

impl Job {
    /// A job that evaluates poses as they are.
    pub fn evaluate(tile_count: usize, log_outlier: f32) -> Self {
        Self { tile_count: tile_count as u32, log_outlier, ..Self::zeroed() }
    }

    /// A job that moves poses and evaluates them.
    pub fn advance(how: &Advance, tile_count: usize, log_outlier: f32) -> Self {
        Self {
            seed: [how.seed as u32, (how.seed >> 32) as u32],
            step: how.step,
            draw: Draw::Motion as u32,
            noise: padded(how.noise.0),
            from_own_pose: 1,
            capture_sigma: how.capture_sigma,
            ..Self::evaluate(tile_count, log_outlier)
        }
    }

    /// A job that draws particles.
    pub fn propagation(how: &Propagation<'_>, slack: [f32; 2], tile_count: usize, log_outlier: f32) -> Self {
        Self {
            seed: [how.seed as u32, (how.seed >> 32) as u32],
            step: how.step,
            draw: how.draw as u32,
            noise: padded(how.noise.0),
            prior_information: padded(how.prior_information),
            slack: [slack[0], slack[0], slack[1]],
            spread: how.spread,
            capture_sigma: how.capture_sigma,
            is_heavy_tailed: how.is_heavy_tailed.into(),
            ..Self::evaluate(tile_count, log_outlier)
        }
    }
}

fn padded(numbers: [f32; 6]) -> [f32; 8] {
    std::array::from_fn(|i| numbers.get(i).copied().unwrap_or(0.0))
}

/// Which dispatch of a climb this is.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Phase {
    /// 1: every particle starts to climb; lists of before are worth nothing.
    pub restart: u32,
    /// 1: a step may follow the evaluation.
    pub may_step: u32,
}

impl Phase {
    /// As many as there are.
    pub const COUNT: u32 = 4;

    /// One of them.
    pub fn new(restart: bool, may_step: bool) -> Self {
        Self { restart: restart.into(), may_step: may_step.into() }
    }

    /// Below [`Phase::COUNT`], another one for each.
    pub fn number(self) -> u32 {
        self.restart | self.may_step << 1
    }
}

/// Clusters in a candidate list; where more reach a tile, all clusters of the map are evaluated.
pub const LIST_ROOM: usize = 63;
/// Particles in a group: lanes of a workgroup.
pub const GROUP: usize = 64;
