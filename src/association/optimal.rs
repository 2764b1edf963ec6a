//! The most likely assignment of a block, and the scales under which its weight is 1.

use crate::association::block::{Block, Scaled};
use nalgebra::DMatrix;
use pathfinding::kuhn_munkres::kuhn_munkres;
use pathfinding::matrix::Matrix;

/// Steps per nat. Terms are compared as whole numbers, since rounding can keep the algorithm from ending.
const STEPS: f64 = (1u64 << 40) as f64;
/// No possible term is further below its row's maximum; further ones count as this \[steps\].
const LEAST: f64 = -1e27;
/// A pair that is not possible: worse than any number of possible ones.
const IMPOSSIBLE: i128 = -(1 << 110);

/// The most likely assignment of a block: of each row its column, or none. `None` where none is possible.
pub(super) fn assignment(block: &Block) -> Option<Vec<Option<usize>>> {
    Problem::new(block).solve(&[], &[])
}

/// A block scaled so that the most likely assignment has weight 1, and no term is larger; `None` where no assignment is
/// possible. Then no weight that matters can underflow.
///
/// The scales are the dual of the assignment problem: ln L_kj ≤ r_k + c_j, ln u_k ≤ r_k, 0 ≤ c_j, with equality for
/// what the best assignment takes. The c are the smallest that are possible: longest paths from 0, by as many
/// rounds as a path can have edges.
pub(super) fn scaled(block: &Block) -> Option<Scaled> {
    let best = assignment(block)?;
    let mut columns = vec![0.0; block.landmarks.len()];
    let row_scales = |columns: &[f64]| -> Vec<f64> {
        let scale = |(row, &column): (usize, &Option<usize>)| {
            block.log_term(row, column) - column.map_or(0.0, |column| columns[column])
        };
        best.iter().enumerate().map(scale).collect()
    };
    for _ in 0..best.len() {
        let rows = row_scales(&columns);
        for &column in best.iter().flatten() {
            let pairs = block.pairs.column(column);
            let excess = pairs.iter().zip(&rows).map(|(pair, row)| pair - row);
            columns[column] = excess.fold(columns[column], f64::max);
        }
    }
    Some(block.scaled(&row_scales(&columns), &columns))
}

/// A block's terms as whole numbers.
pub(super) struct Problem {
    pairs: DMatrix<i128>,
    nulls: Vec<i128>,
}

impl Problem {
    pub fn new(block: &Block) -> Self {
        let maxima: Vec<f64> = (0..block.nulls.len()).map(|row| block.row_maximum(row)).collect();
        let steps = |log: f64, row: usize| match log {
            f64::NEG_INFINITY => IMPOSSIBLE,
            _ => ((log - maxima[row]) * STEPS).round().max(LEAST) as i128,
        };
        let (rows, columns) = block.pairs.shape();
        Self {
            pairs: DMatrix::from_fn(rows, columns, |row, column| steps(block.pairs[(row, column)], row)),
            nulls: block.nulls.iter().enumerate().map(|(row, &null)| steps(null, row)).collect(),
        }
    }

    /// The most likely assignment whose first rows take what `start` says, and whose next row takes nothing of
    /// `excluded`. `None` where none is possible.
    pub fn solve(&self, start: &[Option<usize>], excluded: &[Option<usize>]) -> Option<Vec<Option<usize>>> {
        let (rows, columns) = (self.nulls.len() - start.len(), self.pairs.ncols());
        if rows == 0 {
            return Some(start.to_vec());
        }
        // A row that takes none takes a column of its own.
        let terms = Matrix::from_fn(rows, columns + rows, |(row, column)| {
            let option = (column < columns).then_some(column);
            let barred = row == 0 && excluded.contains(&option) || option.is_some() && start.contains(&option);
            match option {
                _ if barred => IMPOSSIBLE,
                Some(column) => self.pairs[(start.len() + row, column)],
                None if column == columns + row => self.nulls[start.len() + row],
                None => IMPOSSIBLE,
            }
        });
        let (_, taken) = kuhn_munkres(&terms);
        if taken.iter().enumerate().any(|(row, &column)| terms[(row, column)] == IMPOSSIBLE) {
            return None;
        }
        let taken = taken.into_iter().map(|column| (column < columns).then_some(column));
        Some(start.iter().copied().chain(taken).collect())
    }
}
