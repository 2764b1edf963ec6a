//! Drawing a pose from the motion (eq. 17); twin of `shaders/propagate.wgsl`.

use crate::evaluator::pose::LocalPose;
use crate::evaluator::{Advance, MAX_TAIL, Propagation};
use crate::random::{Draw, normals};

/// A pose from the motion (eq. 17).
pub(super) fn propagate(particle: u32, map: usize, how: &Propagation<'_>) -> LocalPose {
    let mean = how.starts[map].mean;
    if how.exact_first && particle as usize == map * how.particles_per_map {
        return mean;
    }
    let [x, y, heading, divisor] = normals(how.seed, how.step, particle, how.draw);
    // Normal numbers over the size of another one are Cauchy's.
    let tail = if how.is_heavy_tailed { (1.0 / divisor.abs()).min(MAX_TAIL) } else { 1.0 };
    mean.moved(how.noise.times([x, y, heading].map(|number| tail * number)))
}

/// The pose of a particle that moves from where it is.
pub(super) fn advance(particle: u32, pose: LocalPose, how: &Advance) -> LocalPose {
    let [x, y, heading, _] = normals(how.seed, how.step, particle, Draw::Motion);
    pose.moved(how.motion).moved(how.noise.times([x, y, heading]))
}
