//! All assignments of a block summed exactly, without enumeration.
//!
//! A programme over the sets of detections that are used, one landmark after the other. F_j(s) is the sum over the
//! assignments of the first j landmarks that use exactly the detections s, and B_j(s) the sum over what the others can
//! do with the rest:
//!
//! F_0(∅) = 1, F_{j+1}(s) = m_j F_j(s) + Σ_{k ∈ s} L_kj F_j(s \ k);
//! B_M(s) = Π_{k ∉ s} u_k, B_j(s) = m_j B_{j+1}(s) + Σ_{k ∉ s} L_kj B_{j+1}(s ∪ k);
//! p(S) = Σ_s F_M(s) B_M(s), w_kj = L_kj Σ_{s ∌ k} F_j(s) B_{j+1}(s ∪ k) / p(S),
//!
//! m_j being the scaled term of a landmark without a detection. All terms are positive and nothing is subtracted, so no
//! digits cancel. The problem is the same with detections and landmarks exchanged, and sets are made of the fewer ones.
//! Time O(n 2ⁿ N) and memory O(2ⁿ N), for n of the fewer and N of the other.

use crate::association::block::{Block, Marginals, Scaled};
use nalgebra::DMatrix;

/// However many the others are, n may be as large as this,
const MAX_MEMBERS: usize = 10;
/// and larger where n 2ⁿ N is at most this, which takes some milliseconds: 11 of the fewer with 23 of the other.
const MAX_PRODUCTS: usize = 1 << 19;

/// A sum below this is taken again with better scales. What underflows is below 1e-307, so 1e-107 of the sum at most.
const LEAST_SUM: f64 = 1e-200;

/// Whether a block is small enough.
pub(super) fn is_feasible(block: &Block) -> bool {
    let (detections, landmarks) = (block.detections.len(), block.landmarks.len());
    let (fewer, more) = (detections.min(landmarks), detections.max(landmarks));
    fewer <= MAX_MEMBERS || fewer < 16 && (fewer << fewer) * more <= MAX_PRODUCTS
}

/// The marginals of a block that is small enough; `None` where the sum comes close to underflow.
pub(super) fn marginals(block: &Scaled) -> Option<Marginals> {
    let Scaled { pairs, nulls, missed, log_scale } = block;
    let sums = if pairs.nrows() <= pairs.ncols() {
        Sums::new(pairs, nulls, missed)
    } else {
        Sums::new(&pairs.transpose(), missed, nulls).transposed()
    };
    let Sums { total, pairs, members, .. } = sums;
    (total >= LEAST_SUM).then(|| Marginals {
        pairs: pairs / total,
        nulls: members.into_iter().map(|sum| sum / total).collect(),
        log_sum: total.ln() + log_scale,
    })
}

/// Sums of the weights of assignments.
struct Sums {
    /// Of all.
    total: f64,
    /// Of those with a pair; a row per member of the sets, a column per item.
    pairs: DMatrix<f64>,
    /// Of those that leave a member without an item.
    members: Vec<f64>,
    /// Of those that leave an item without a member.
    items: Vec<f64>,
}

impl Sums {
    /// The programme; `pairs` has a row per member and a column per item, `single_members` and `single_items` are the
    /// terms of members and items without a pair.
    fn new(pairs: &DMatrix<f64>, single_members: &[f64], single_items: &[f64]) -> Self {
        let size = 1 << single_members.len();
        let mut forward = vec![0.0; size * (single_items.len() + 1)];
        forward[0] = 1.0;
        for (item, &single) in single_items.iter().enumerate() {
            let (before, after) = forward[size * item..].split_at_mut(size);
            let after = &mut after[..size];
            scale_into(after, before, single);
            for (member, &pair) in pairs.column(item).iter().enumerate() {
                for ([_, with], [without, _]) in split_mut(after, member).zip(split(before, member)) {
                    add_product(with, without, pair);
                }
            }
        }

        let last = &forward[size * single_items.len()..];
        let mut backward = vec![1.0; size];
        for (member, &single) in single_members.iter().enumerate() {
            for [without, _] in split_mut(&mut backward, member) {
                without.iter_mut().for_each(|sum| *sum *= single);
            }
        }
        let halves = |member| split(last, member).zip(split(&backward, member));
        let without = |member| halves(member).map(|([forward, _], [backward, _])| dot(forward, backward)).sum();
        let members = (0..single_members.len()).map(without).collect();
        let total = dot(last, &backward);

        let mut sums = Self { total, pairs: DMatrix::zeros(pairs.nrows(), pairs.ncols()), members, items: Vec::new() };
        let mut earlier = vec![0.0; size];
        for (item, &single) in single_items.iter().enumerate().rev() {
            let before = &forward[size * item..][..size];
            sums.items.push(single * dot(before, &backward));
            scale_into(&mut earlier, &backward, single);
            for (member, &pair) in pairs.column(item).iter().enumerate() {
                let mut sum = 0.0;
                let halves = split_mut(&mut earlier, member).zip(split(before, member)).zip(split(&backward, member));
                for (([without, _], [before, _]), [_, with]) in halves {
                    sum += dot(before, with);
                    add_product(without, with, pair);
                }
                sums.pairs[(member, item)] = pair * sum;
            }
            std::mem::swap(&mut earlier, &mut backward);
        }
        sums.items.reverse();
        sums
    }

    /// With members and items exchanged.
    fn transposed(self) -> Self {
        Self { total: self.total, pairs: self.pairs.transpose(), members: self.items, items: self.members }
    }
}

/// Numbers of all sets, by their bit masks, as runs of pairs: sets without a member, and the same sets with it.
fn split(sets: &[f64], member: usize) -> impl Iterator<Item = [&[f64]; 2]> {
    sets.chunks_exact(2 << member).map(move |run| <[_; 2]>::from(run.split_at(1 << member)))
}

fn split_mut(sets: &mut [f64], member: usize) -> impl Iterator<Item = [&mut [f64]; 2]> {
    sets.chunks_exact_mut(2 << member).map(move |run| <[_; 2]>::from(run.split_at_mut(1 << member)))
}

fn scale_into(to: &mut [f64], from: &[f64], factor: f64) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to = factor * from);
}

fn add_product(to: &mut [f64], from: &[f64], factor: f64) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += factor * from);
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
