//! The n most likely assignments of a frame (K. G. Murty, "An algorithm for ranking all the assignments in order of
//! increasing cost", Operations Research 16, 1968).
//!
//! The most likely assignment splits the others into families: those that agree with it in the first i detections and
//! differ in the next one. The most likely of each family is found like the first; the likeliest of them is the second,
//! and splits its family in the same way.

use crate::association::Table;
use crate::association::block::Block;
use crate::association::optimal::Problem;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// One assignment of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Assignment {
    /// Of each detection its landmark, or none (K).
    pub landmarks: Vec<Option<usize>>,
    /// Sum of its terms, [`Table::constant`] included. Less the log-likelihood of
    /// [`Policy::Soft`](crate::association::Policy::Soft), it is the log-probability of the assignment.
    pub log_likelihood: f64,
}

/// The `count` most likely assignments of a frame, or all where there are fewer, the likeliest first; without those that
/// are less likely than the best one by more than `margin` \[nats\], which may be infinite.
///
/// Assignments that differ by less than 1e-12 K in log-likelihood may be left out in favour of each other; which ones
/// is the same every time. Equal ones are in lexicographic order, none before the first landmark. Takes
/// O(`count` K) assignment problems of K x (M + K), and memory O(`count` K²).
pub fn best_assignments(table: &Table, count: usize, margin: f64) -> Vec<Assignment> {
    let block = Block::whole(table);
    let problem = Problem::new(&block);
    let family = |agreed: usize, start: &[Option<usize>], excluded: Vec<Option<usize>>| {
        let columns = problem.solve(&start[..agreed], &excluded)?;
        Some(Family { log_likelihood: block.log_likelihood(&columns), columns, agreed, excluded })
    };
    let mut families: BinaryHeap<Family> = family(0, &[], Vec::new()).into_iter().collect();
    let least = families.peek().map_or(0.0, |first| first.log_likelihood - margin);
    let mut best = Vec::new();
    while best.len() < count
        && let Some(Family { columns, log_likelihood, agreed, excluded }) = families.pop()
        && log_likelihood >= least
    {
        // Nothing comes after the last one.
        let rows = if best.len() + 1 < count { agreed..columns.len() } else { 0..0 };
        for row in rows {
            let mut excluded = if row == agreed { excluded.clone() } else { Vec::new() };
            excluded.push(columns[row]);
            families.extend(family(row, &columns, excluded));
        }
        let landmarks = columns.into_iter().map(|column| column.map(|column| block.landmarks[column])).collect();
        best.push(Assignment { landmarks, log_likelihood: log_likelihood + table.constant() });
    }
    // Problems are solved in steps of 2⁻⁴⁰ nats, which may exchange neighbours.
    best.sort_by(|a, b| b.log_likelihood.total_cmp(&a.log_likelihood).then_with(|| a.landmarks.cmp(&b.landmarks)));
    best
}

/// Assignments that agree in the first rows and take nothing excluded in the next one, by the most likely of them.
struct Family {
    columns: Vec<Option<usize>>,
    log_likelihood: f64,
    agreed: usize,
    excluded: Vec<Option<usize>>,
}

impl Ord for Family {
    fn cmp(&self, other: &Self) -> Ordering {
        let key = |family: &Self| Reverse(family.columns.clone());
        self.log_likelihood.total_cmp(&other.log_likelihood).then_with(|| key(self).cmp(&key(other)))
    }
}

impl PartialOrd for Family {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Family {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Family {}
