//! Drawing a pose around a mode, from the Laplace approximation of the posterior; twin of `shaders/draw.wgsl`.

use crate::evaluator::cholesky::Cholesky;
use crate::evaluator::{Mode, Propagation, Proposal};
use crate::random::{Draw, normals};

/// A pose around a mode.
pub(super) fn draw(particle: u32, mode: Mode, how: &Propagation<'_>) -> Proposal {
    let [x, y, heading, _] = normals(how.seed, how.step, particle, Draw::Proposal);
    let drawn = Cholesky::new(mode.information).map_or(mode.pose, |cholesky| {
        mode.pose.moved(cholesky.solve_transposed([x, y, heading].map(|z| z * how.spread)))
    });
    Proposal { drawn, mode }
}
