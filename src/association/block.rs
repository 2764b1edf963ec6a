//! A frame in parts: detections and landmarks that gated pairs join, and their terms in linear space.

use crate::association::Table;
use nalgebra::DMatrix;

/// Part of a frame, whose assignments do not depend on the rest of it.
pub(super) struct Block {
    /// The detections, as the table numbers them; they are the rows of the block.
    pub detections: Vec<usize>,
    /// The landmarks, likewise; they are its columns.
    pub landmarks: Vec<usize>,
    /// Log pair terms.
    pub pairs: DMatrix<f64>,
    /// Log null terms, one per row.
    pub nulls: Vec<f64>,
}

impl Block {
    fn new(table: &Table, detections: Vec<usize>, landmarks: Vec<usize>) -> Self {
        let at = |row, column| table.pairs()[(detections[row], landmarks[column])];
        let pairs = DMatrix::from_fn(detections.len(), landmarks.len(), at);
        let nulls = detections.iter().map(|&detection| table.nulls()[detection]).collect();
        Self { detections, landmarks, pairs, nulls }
    }

    /// All detections, and the landmarks that any of them may be.
    pub fn whole(table: &Table) -> Self {
        let columns = table.pairs().column_iter().enumerate();
        let landmarks =
            columns.filter(|(_, pairs)| pairs.iter().any(|pair| pair.is_finite())).map(|(j, _)| j).collect();
        Self::new(table, (0..table.nulls().len()).collect(), landmarks)
    }

    /// The connected components of the graph whose edges are the possible pairs, in order of their first detections.
    /// Each detection is in one of them; a landmark that no detection can be is in none.
    pub fn components(table: &Table) -> Vec<Self> {
        // Union-find over the detections: a landmark joins all that it may have given rise to.
        let mut parents: Vec<usize> = (0..table.nulls().len()).collect();
        let mut firsts = Vec::with_capacity(table.pairs().ncols());
        for pairs in table.pairs().column_iter() {
            let mut first = None;
            for (detection, _) in pairs.iter().enumerate().filter(|(_, pair)| pair.is_finite()) {
                let (a, b) = (root(&mut parents, *first.get_or_insert(detection)), root(&mut parents, detection));
                // The smaller number is the root, which keeps the components in order.
                parents[a.max(b)] = a.min(b);
            }
            firsts.push(first);
        }
        let mut members = vec![(Vec::new(), Vec::new()); parents.len()];
        for detection in 0..parents.len() {
            members[root(&mut parents, detection)].0.push(detection);
        }
        for (landmark, first) in firsts.into_iter().enumerate() {
            if let Some(detection) = first {
                members[root(&mut parents, detection)].1.push(landmark);
            }
        }
        let members = members.into_iter().filter(|(detections, _)| !detections.is_empty());
        members.map(|(detections, landmarks)| Self::new(table, detections, landmarks)).collect()
    }

    /// Log-likelihood of one assignment: of each row its column, or none. Terms are added in the order of the rows.
    pub fn log_likelihood(&self, columns: &[Option<usize>]) -> f64 {
        columns.iter().enumerate().map(|(row, &column)| self.log_term(row, column)).sum()
    }

    /// The term of a row that takes this column, or none.
    pub fn log_term(&self, row: usize, column: Option<usize>) -> f64 {
        column.map_or(self.nulls[row], |column| self.pairs[(row, column)])
    }

    /// The largest term of a row.
    pub fn row_maximum(&self, row: usize) -> f64 {
        self.pairs.row(row).iter().copied().fold(self.nulls[row], f64::max)
    }

    /// Each row scaled by its largest term; `None` where a row has no possible term.
    pub fn scaled_by_rows(&self) -> Option<Scaled> {
        let rows: Vec<f64> = (0..self.nulls.len()).map(|row| self.row_maximum(row)).collect();
        rows.iter().all(|log| log.is_finite()).then(|| self.scaled(&rows, &vec![0.0; self.landmarks.len()]))
    }

    /// Every assignment's weight divided by exp(Σ rows + Σ columns).
    pub fn scaled(&self, rows: &[f64], columns: &[f64]) -> Scaled {
        let pair = |row, column| f64::exp(self.pairs[(row, column)] - rows[row] - columns[column]);
        Scaled {
            pairs: DMatrix::from_fn(rows.len(), columns.len(), pair),
            nulls: self.nulls.iter().zip(rows).map(|(null, row)| (null - row).exp()).collect(),
            missed: columns.iter().map(|column| (-column).exp()).collect(),
            log_scale: rows.iter().chain(columns).sum(),
        }
    }
}

/// The root of a detection's tree, whose path is halved on the way.
fn root(parents: &mut [usize], mut detection: usize) -> usize {
    while parents[detection] != detection {
        parents[detection] = parents[parents[detection]];
        detection = parents[detection];
    }
    detection
}

/// A block in linear space. The weight of an assignment is the product of the terms of its pairs, of the null terms of
/// the rows without a pair, and of the missed terms of the columns without one, all at most about 1.
pub(super) struct Scaled {
    pub pairs: DMatrix<f64>,
    pub nulls: Vec<f64>,
    pub missed: Vec<f64>,
    /// ln of what the weight of every assignment was divided by.
    pub log_scale: f64,
}

/// The sum over the assignments of a block.
pub(super) struct Marginals {
    /// The share of all weight that each pair has.
    pub pairs: DMatrix<f64>,
    /// The share that none has, per row.
    pub nulls: Vec<f64>,
    /// ln of the sum of all weights, not scaled.
    pub log_sum: f64,
}
