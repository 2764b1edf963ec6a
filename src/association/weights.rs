//! Weights of a frame.

use crate::association::Table;
use crate::association::block::{Block, Marginals};
use nalgebra::DMatrix;

/// What a frame's detections show, by one of the policies. Of each detection, the weights of all pairs and the null
/// weight sum to one.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// w_kj, in 0..=1: that detection k shows landmark j; a row per detection and a column per landmark (K x M).
    pub pairs: DMatrix<f64>,
    /// That a detection shows no landmark of the map, in 0..=1 (K).
    pub nulls: Vec<f64>,
    /// Log-likelihood of the set of detections, [`Table::constant`] included: of the sum over all assignments where the
    /// policy is soft, else of the one assignment that was taken. -∞ where none is possible.
    pub log_likelihood: f64,
}

impl Weights {
    /// No detection shows anything, and of none the likelihood has been counted.
    pub(super) fn none(table: &Table) -> Self {
        let (detections, landmarks) = table.pairs().shape();
        let (pairs, nulls) = (DMatrix::zeros(detections, landmarks), vec![1.0; detections]);
        Self { pairs, nulls, log_likelihood: table.constant() }
    }

    /// Each detection takes its likeliest option. Of equal ones it takes none, or else the first landmark.
    pub(super) fn give_likeliest(&mut self, table: &Table) {
        for (detection, &null) in table.nulls().iter().enumerate() {
            let (mut likeliest, mut log) = (None, null);
            for (landmark, &pair) in table.pairs().row(detection).iter().enumerate() {
                if pair > log {
                    (likeliest, log) = (Some(landmark), pair);
                }
            }
            self.take(detection, likeliest);
            self.log_likelihood += log;
        }
    }

    /// Weights of a block's pairs; `None` where no assignment is possible.
    pub(super) fn give_marginals(&mut self, block: &Block, marginals: Option<Marginals>) {
        let Some(marginals) = marginals else {
            self.log_likelihood = f64::NEG_INFINITY;
            return;
        };
        for (row, &detection) in block.detections.iter().enumerate() {
            self.nulls[detection] = marginals.nulls[row];
            for (column, &landmark) in block.landmarks.iter().enumerate() {
                self.pairs[(detection, landmark)] = marginals.pairs[(row, column)];
            }
        }
        self.log_likelihood += marginals.log_sum;
    }

    /// One assignment of a block, by columns of the block; `None` where none is possible.
    pub(super) fn give_assignment(&mut self, block: &Block, assignment: Option<Vec<Option<usize>>>) {
        let Some(columns) = assignment else {
            self.log_likelihood = f64::NEG_INFINITY;
            return;
        };
        self.log_likelihood += block.log_likelihood(&columns);
        for (&detection, column) in block.detections.iter().zip(columns) {
            self.take(detection, column.map(|column| block.landmarks[column]));
        }
    }

    fn take(&mut self, detection: usize, landmark: Option<usize>) {
        if let Some(landmark) = landmark {
            self.pairs[(detection, landmark)] = 1.0;
            self.nulls[detection] = 0.0;
        }
    }
}
