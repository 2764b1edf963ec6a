//! Data association of one frame: which of K detections shows which of M landmarks (the E-step of semantic SLAM;
//! S. L. Bowman, N. Atanasov, K. Daniilidis, G. J. Pappas, "Probabilistic Data Association for Semantic SLAM",
//! ICRA 2017).
//!
//! An assignment D gives each detection one landmark or none, and each landmark at most one detection. With pair terms
//! L_kj and null terms u_k ([`Table`] says what they hold), the likelihood of the set of detections and the weight of a
//! pair are
//!
//! p(S) = Σ_D Π_k (L_kD(k), or u_k where D(k) is none), and
//! w_kj = Σ over D with D(k) = j of the same product, / p(S):
//!
//! the share of all assignments that hold the pair. The second is the E-step of that paper, its sum over the landmark's
//! classes taken inside the pair term ([`class_log_likelihood`]): a landmark takes at most one detection of a frame, so
//! the sum over classes factorises.
//!
//! | File | Task |
//! |---|---|
//! | `table` | pair terms, null terms, missed detections, classes |
//! | `weights` | the result: weights of pairs and of none, and the log-likelihood of the set |
//! | `block` | the frame split into parts that share no landmark, scaled for linear space |
//! | `exact` | all assignments summed, by a programme over sets |
//! | `belief` | the same, approximately, by belief propagation, for larger blocks |
//! | `optimal` | the one assignment that is most likely |
//! | `best` | the n most likely ones |
//!
//! Projection, gates, clutter densities and the map are the caller's.

mod belief;
mod best;
mod block;
mod exact;
mod optimal;
mod table;
mod weights;

pub use best::{Assignment, best_assignments};
pub use table::{Table, class_log_likelihood};
pub use weights::Weights;

use block::{Block, Marginals};
use serde::{Deserialize, Serialize};

/// How detections are given to landmarks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Policy {
    /// By their probability over all one-to-one assignments. A block of the frame, whose detections compete for
    /// landmarks, is summed exactly where it has at most ten detections or at most ten landmarks, or eleven with at most 23
    /// of the other: to 1e-12 of each weight. Larger blocks take belief propagation. Against exact sums of random blocks of two to eight detections
    /// whose terms are spread over 1, 3 and 10 nats, its weights are off by 0.002, 0.004 and 0.008 in the mean and by
    /// 0.06, 0.15 and 0.44 at most, and its log-likelihood is too low by up to 0.3, 0.8 and 1.3. It is worst where two
    /// detections fit two landmarks in both ways equally well, and nothing else: it may then take one way for certain.
    Soft,
    /// Each detection takes its likeliest option, whatever the others take. A landmark may have several detections, and
    /// the log-likelihood is the sum of the maxima: eq. 18 of IPSLAM, with landmarks for clusters.
    Max,
    /// The single most likely one-to-one assignment. Terms are compared to 2⁻⁴⁰ (1e-12).
    Hungarian,
    /// The weights of [`Soft`](Policy::Soft). They are the component weights of a max-mixture: at each linearisation
    /// point, the caller takes for each detection the component of largest ln w_kj + ln p(z_k | x, l_j), each density
    /// normalised, in place of the sum over all.
    MaxMixture,
}

/// The weights of all pairs of a frame.
///
/// Where no assignment is possible (a detection that can be neither a landmark nor none, or two that can only be the
/// same landmark), the detections of that block get null weight 1 and the log-likelihood is -∞.
pub fn associate(table: &Table, policy: Policy) -> Weights {
    let mut weights = Weights::none(table);
    match policy {
        Policy::Max => weights.give_likeliest(table),
        Policy::Soft | Policy::MaxMixture => {
            for block in Block::components(table) {
                weights.give_marginals(&block, marginals(&block));
            }
        }
        Policy::Hungarian => {
            for block in Block::components(table) {
                weights.give_assignment(&block, optimal::assignment(&block));
            }
        }
    }
    weights
}

/// The sum over the assignments of a block; `None` where none is possible.
fn marginals(block: &Block) -> Option<Marginals> {
    if !exact::is_feasible(block) {
        return Some(belief::marginals(&optimal::scaled(block)?));
    }
    // Rows scaled by their maxima are enough unless detections fight for a landmark over hundreds of nats.
    block
        .scaled_by_rows()
        .and_then(|scaled| exact::marginals(&scaled))
        .or_else(|| exact::marginals(&optimal::scaled(block)?))
}
