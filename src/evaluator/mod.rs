//! The part of the filter that runs over every particle and every point.
//!
//! An [`Evaluator`] draws the poses of all particles and computes the log-likelihood of the scan at each of them. There are two,
//! with the same steps under the same names, and the same answers but for rounding: [`cpu`], and with the feature `gpu`
//! `gpu`, whose kernels are the files of `shaders/`.
//!
//! | Step | What | Equation |
//! |---|---|---|
//! | `propagate` | a pose for each particle, drawn from the motion | 17 |
//! | `cull` | which clusters each tile of points can meet at all, from a group of poses | |
//! | `refine` | Gauss-Newton steps from there to a mode of the posterior: the log of eq. 18 plus that of eq. 17 | |
//! | `draw` | a pose around the mode, from the Laplace approximation | |
//! | `weigh` | the log-likelihood of the scan | 18 |
//! | `associate` | that of the detections of a frame, over all assignments to the landmarks of the map | |
//!
//! `advance` is `propagate` and `weigh` of poses that each start from where they are, as localisation in a known map needs
//! it by the million.
//!
//! `propagate`, `refine` and `draw` together are the optimal proposal of FastSLAM 2.0, approximated: drawn from the
//! posterior itself, a particle needs no correction for the proposal; its weight is that of eq. 18.
//!
//! Everything here is f32 in a frame near the robot, that of the [`ClusterTable`], so that a map kilometres from the
//! origin keeps its millimetres; the host goes on in f64.

use crate::gpu::DeviceError;
use crate::map::Slot;
use crate::parameters::parameters;
use crate::random::Draw;
use pose::LocalPose;
use sighting::Sighting;
use table::ClusterTable;
use tiles::Tile;

pub mod by_size;
pub mod cholesky;
pub mod cpu;
pub mod failover;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod grouping;
pub mod pose;
pub mod sighting;
pub mod table;
pub mod tiles;

parameters! {
    /// How particles are proposed.
    pub struct ProposalConfig {
        /// At most this many Gauss-Newton steps; 0 proposes from the odometry alone, as in the paper.
        iterations: u32 = ITERATIONS, in 0.0..=1e4;
        /// No standard deviation across a wall is taken to be smaller in the first steps of a climb \[m\]: how far off a
        /// wall is still found.
        capture_sigma: f64 = 0.15, in 1e-6..=1e3;
        /// Draws spread this many times as wide as the Laplace approximation of a posterior whose points err
        /// independently; neighbouring points do not, and what the map has wrong they have wrong together.
        spread: f64 = 2.0, in 0.0..=1e3;
    }
}

/// Gauss-Newton steps of a climb: most converge in fewer.
pub const ITERATIONS: u32 = 6;

/// What the particles of a step are evaluated against.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// Every cluster.
    pub table: &'a ClusterTable,
    /// The points of the scan.
    pub tiles: &'a [Tile],
    /// For each map the slots of the clusters that the scan can meet, wherever its particles may be.
    pub maps: &'a [Vec<Slot>],
}

/// How the particles of a step are drawn.
#[derive(Clone, Debug)]
pub struct Propagation<'a> {
    /// Seed of the random numbers.
    pub seed: u64,
    /// Step that they are for.
    pub step: u32,
    /// Draw that the noise of the motion takes.
    pub draw: Draw,
    /// For each map, where its particles start.
    pub starts: &'a [Start],
    /// Particles of each map; those of the first map come first.
    pub particles_per_map: usize,
    /// Whether the first particle of each map starts at the mean of the motion itself.
    pub exact_first: bool,
    /// Whether the noise of the motion has the tails of Cauchy's distribution, to find a robot that odometry has lost.
    pub is_heavy_tailed: bool,
    /// Lower triangle whose product with standard normal numbers is the noise of the motion, in the robot's frame.
    pub noise: cholesky::Cholesky,
    /// Inverse covariance of the prior of (forward, sideways, heading) \[m, m, rad\] in the frame of its mean, packed: xx, xy, xh,
    /// yy, yh, hh.
    pub prior_information: [f32; 6],
    /// Maximum number of Gauss-Newton steps, after half as many with thick walls; 0 draws from the motion alone.
    pub iterations: u32,
    /// Standard deviation across thick walls at least \[m\]; that of the scene's table at most.
    pub capture_sigma: f32,
    /// Draws spread this many times as wide as the Laplace approximation.
    pub spread: f32,
}

/// Where the particles of one map start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Mean of the motion that particles are drawn from.
    pub mean: LocalPose,
    /// Mean of the prior of the climb.
    pub prior: LocalPose,
}

/// The prior of a particle's pose by the motion alone.
#[derive(Clone, Copy, Debug)]
pub struct PosePrior {
    /// The mean.
    pub pose: LocalPose,
    /// Inverse covariance of (forward, sideways, heading) in the robot's frame: xx, xy, xh, yy, yh, hh.
    pub information: [f32; 6],
}

/// A mode of the posterior density of one particle's pose. Without scan matching (0 iterations) only the pose is set.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mode {
    /// Where it is.
    pub pose: LocalPose,
    /// Log-likelihood of the scan there (eq. 18).
    pub log_likelihood: f32,
    /// The same plus the log of the prior, but for a constant.
    pub log_posterior: f32,
    /// Negative Hessian of that, by (forward, sideways, heading) in the robot's frame: xx, xy, xh, yy, yh, hh.
    pub information: [f32; 6],
}

/// A proposed pose, and the mode that it was drawn around.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Proposal {
    /// Its pose.
    pub drawn: LocalPose,
    /// The mode of the posterior that it was drawn around.
    pub mode: Mode,
}

/// Log-likelihoods are multiplied by this where modes of one pose are compared: of the points of a scan, those of one wall err
/// together, and what a map has wrong they have wrong together: as the weights of the filter are tempered.
pub(crate) const MODE_TEMPER: f64 = 0.025;

impl Mode {
    /// Tempered: taken at their word, two points that a wrong place explains would outweigh any odometry.
    pub fn tempered_log_likelihood(&self) -> f64 {
        MODE_TEMPER * f64::from(self.log_likelihood)
    }

    /// Log of the posterior, but for a constant, with the tempered likelihood.
    pub fn tempered_log_posterior(&self) -> f64 {
        f64::from(self.log_posterior) - f64::from(self.log_likelihood) + self.tempered_log_likelihood()
    }
}

/// Modes this close together are one \[m, rad\].
pub(crate) const APART: [f64; 2] = [0.3, 0.1];

/// The modes of the highest posteriors that particles climbed to, best first, at most `count`; of the climbs to one mode the one
/// that came highest.
pub fn best_modes(modes: impl Iterator<Item = Mode>, count: usize) -> Vec<Mode> {
    let mut all: Vec<Mode> = modes.filter(|mode| mode.tempered_log_posterior().is_finite()).collect();
    all.sort_by(|a, b| b.tempered_log_posterior().total_cmp(&a.tempered_log_posterior()));
    distinct(all, count, |one, other| one.pose.is_near(other.pose, APART))
}

/// The first items of each kind, at most `count`.
pub(crate) fn distinct<T>(
    items: impl IntoIterator<Item = T>,
    count: usize,
    is_same: impl Fn(&T, &T) -> bool,
) -> Vec<T> {
    let mut kept: Vec<T> = Vec::new();
    for item in items {
        if kept.len() < count && !kept.iter().any(|other| is_same(&item, other)) {
            kept.push(item);
        }
    }
    kept
}

/// How poses move that each start from where they are.
#[derive(Clone, Copy, Debug)]
pub struct Advance {
    /// Seed of the random numbers.
    pub seed: u64,
    /// Step that they are for.
    pub step: u32,
    /// Mean of the motion: forward, sideways \[m\], turn \[rad\].
    pub motion: [f32; 3],
    /// Lower triangle whose product with standard normal numbers is its noise, in the robot's frame.
    pub noise: cholesky::Cholesky,
    /// Standard deviation across a wall at least \[m\]; that of the scene's table at most.
    pub capture_sigma: f32,
}

/// A pose, and how well the scan fits there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Weighed {
    /// Its heading is not wrapped.
    pub pose: LocalPose,
    /// Log-likelihood of the scan (eq. 18).
    pub log_likelihood: f32,
}

/// Draws and weighs particles.
pub trait Evaluator: std::fmt::Debug + Send {
    /// Draws a pose for every particle: motion, climb and draw. As many proposals as maps times particles a map; the
    /// scene has as many maps as there are starts.
    ///
    /// # Errors
    /// The device failed; the same call to another evaluator gives what this one should have given.
    fn propagate(&mut self, scene: &Scene<'_>, how: &Propagation<'_>) -> Result<Vec<Proposal>, DeviceError>;

    /// The log-likelihood (eq. 18) of the scan from each pose; as many poses for each map, those of the first map first.
    /// Their number is a multiple of that of the maps.
    ///
    /// # Errors
    /// As for `propagate`.
    fn weigh(&mut self, scene: &Scene<'_>, poses: &[LocalPose]) -> Result<Vec<f32>, DeviceError>;

    /// Moves every pose by a motion of its own, drawn from `how` (eq. 17), and computes the log-likelihood of the scan
    /// there with thickened walls, which sparse particles hit more easily. All poses are of the scene's
    /// first map. Neighbours in `poses` should lie close together: they share candidate lists.
    ///
    /// # Errors
    /// As for `propagate`.
    fn advance(&mut self, scene: &Scene<'_>, how: &Advance, poses: &[LocalPose]) -> Result<Vec<Weighed>, DeviceError>;

    /// The log-likelihood of the detections from each pose, summed over all one-to-one assignments of detections to the
    /// landmarks of its map; as many poses for each map, those of the first map first. Their number is a multiple of that of
    /// the maps.
    ///
    /// # Errors
    /// As for `propagate`.
    fn associate(&mut self, sighting: &Sighting<'_>, poses: &[LocalPose]) -> Result<Vec<f32>, DeviceError>;
}

/// Widest factor of heavy-tailed noise: farther starts lie outside the reach of any climb.
pub const MAX_TAIL: f32 = 30.0;
/// c² of Cauchy's robust density, which the prior of a climb has in place of a Gaussian one: beyond c standard deviations a
/// scan that disagrees with odometry wins. 2.3849² keeps 95 % of the efficiency of least squares where errors are Gaussian
/// (P. J. Huber, Robust Statistics).
pub const PRIOR_TAIL: f32 = 5.687_75;
/// Longest step of one iteration \[m, m, rad\]: a quadratic is trusted no further.
pub const MAX_STEP: [f32; 3] = [0.3, 0.3, 0.15];
/// A step that moves the robot less than this changes nothing \[m, m, rad\].
pub const CONVERGED: [f32; 3] = [5e-4, 5e-4, 2e-4];
/// Candidate lists of a climb hold for poses this much outside those they were made for \[m, rad\], so that not every
/// step needs new ones.
pub const SLACK: [f32; 2] = [0.1, 0.03];

impl Propagation<'_> {
    /// Number of particles, of all maps together.
    pub fn particles(&self) -> usize {
        self.starts.len() * self.particles_per_map
    }

    /// How far \[m\] a particle can come to be from its map's `mean`: the longest noise there is, and all steps of a
    /// climb.
    pub fn longest_way(&self) -> f32 {
        // Box-Muller of 23 bits: no number is greater than √(-2 ln 2⁻²⁴).
        const LARGEST_NORMAL: f32 = 5.77;
        let [l00, l10, l11, ..] = self.noise.0;
        let widest = if self.is_heavy_tailed { MAX_TAIL } else { 1.0 };
        let noise = widest * LARGEST_NORMAL * (l00.abs() + l10.abs() + l11.abs());
        noise + (self.iterations / 2 + self.iterations) as f32 * MAX_STEP[0].hypot(MAX_STEP[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_the_climbs_to_one_mode_the_highest_counts() {
        let mode = |x, log_posterior| {
            let pose = LocalPose { x, ..LocalPose::default() };
            Mode { pose, log_posterior, ..Mode::default() }
        };
        let modes = [mode(0.2, 1.0), mode(0.0, 3.0), mode(5.0, 2.0), mode(9.0, f32::NAN), mode(7.0, 0.5)];
        let places =
            |count| best_modes(modes.into_iter(), count).into_iter().map(|mode| mode.pose.x).collect::<Vec<_>>();
        assert_eq!(places(2), [0.0, 5.0]);
        assert_eq!(places(9), [0.0, 5.0, 7.0], "what is no number is no mode");
    }
}
