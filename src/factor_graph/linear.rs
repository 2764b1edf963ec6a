//! The normal equations H d = -g: sparse, symmetric, and of one pattern while the same factors join the same variables.
//!
//! H = Σ w JᵀJ and g = Σ w Jᵀr over the terms. H is held as its lower triangle, column by column. A variable is a block of
//! neighbouring rows and columns, and all columns of a block have the same rows below the block of the diagonal.

use super::{Graph, GraphError, Values, VariableId};
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::amd;
use faer::sparse::linalg::cholesky::supernodal::SupernodalLltRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};

/// A pivot of the elimination that is smaller, as a share of the information it started with, is zero: rounding leaves
/// some 1e-15 of a direction that is free.
const FREE: f64 = 1e-12;

/// The pattern of H, and of its Cholesky factor.
#[derive(Debug)]
pub(super) struct Structure {
    /// Where each variable's rows start, and where the last one's end.
    starts: Vec<usize>,
    /// The variables of all terms, one term after the other, and where each term's end.
    joined: Vec<VariableId>,
    ends: Vec<usize>,
    /// Where each column starts among the entries.
    columns: Vec<usize>,
    rows: Vec<usize>,
    /// Of each term and pair of its variables, the first of the pair running slowest: where the rows of the later variable
    /// start below the diagonal block of the earlier one; of a variable with itself nothing.
    places: Vec<usize>,
    symbolic: SymbolicCholesky<usize>,
}

/// H and g at some values, and the error there.
#[derive(Debug, Default)]
pub(super) struct Normal {
    pub hessian: Vec<f64>,
    pub gradient: Vec<f64>,
    pub error: f64,
}

impl Structure {
    /// Analyses the pattern.
    pub(super) fn new(graph: &Graph, values: &Values) -> Result<Self, GraphError> {
        if values.is_empty() {
            return Err(GraphError::Empty);
        }
        let mut starts = vec![0];
        for variable in values.ids() {
            starts.push(values.tangent(variable)?.end);
        }
        let (mut joined, mut ends, mut blocks) = (Vec::new(), Vec::new(), Vec::new());
        for variables in graph.variables() {
            for (i, &a) in variables.iter().enumerate() {
                values.kind(a)?;
                blocks.extend(variables[i + 1..].iter().map(|&b| (a.min(b).index(), a.max(b).index())));
            }
            joined.extend_from_slice(variables);
            ends.push(joined.len());
        }
        blocks.sort_unstable();
        blocks.dedup();

        // Of each block below the diagonal, where its rows start; and of each variable, its first block.
        let mut offsets = Vec::with_capacity(blocks.len());
        let mut first_block = vec![0; values.len() + 1];
        let (mut columns, mut rows) = (vec![0], Vec::new());
        for earlier in 0..values.len() {
            let from = first_block[earlier];
            let to = from + blocks[from..].partition_point(|block| block.0 == earlier);
            first_block[earlier + 1] = to;
            let mut below = Vec::new();
            for &(_, later) in &blocks[from..to] {
                offsets.push(below.len());
                below.extend(starts[later]..starts[later + 1]);
            }
            for column in starts[earlier]..starts[earlier + 1] {
                rows.extend(column..starts[earlier + 1]);
                rows.extend_from_slice(&below);
                columns.push(rows.len());
            }
        }

        let mut places = Vec::new();
        for variables in graph.variables() {
            for (i, &a) in variables.iter().enumerate() {
                for &b in &variables[i + 1..] {
                    let (earlier, later) = (a.min(b).index(), a.max(b).index());
                    let range = first_block[earlier]..first_block[earlier + 1];
                    let place = blocks[range.clone()].partition_point(|block| block.1 < later);
                    places.push(offsets[range.start + place]);
                }
            }
        }
        let symbolic = analyse(&starts, &blocks, &columns, &rows)?;
        Ok(Self { starts, joined, ends, columns, rows, places, symbolic })
    }

    /// Whether it is the pattern of this graph.
    pub(super) fn fits(&self, graph: &Graph, values: &Values) -> bool {
        let mut from = 0;
        graph.len() == self.ends.len()
            && values.len() + 1 == self.starts.len()
            && values
                .ids()
                .zip(&self.starts[1..])
                .all(|(id, end)| values.tangent(id).is_ok_and(|range| range.end == *end))
            && graph.variables().zip(&self.ends).all(|(variables, &end)| {
                let before = std::mem::replace(&mut from, end);
                self.joined[before..end] == *variables
            })
    }

    /// How many unknowns there are.
    pub(super) fn dimension(&self) -> usize {
        self.columns.len() - 1
    }

    /// H's diagonal.
    pub(super) fn diagonal<'a>(&'a self, hessian: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        self.columns[..self.dimension()].iter().map(|&column| hessian[column])
    }

    /// H + lambda · diag H.
    pub(super) fn damp(&self, hessian: &[f64], lambda: f64, damped: &mut Vec<f64>) {
        damped.clear();
        damped.extend_from_slice(hessian);
        for &column in &self.columns[..self.dimension()] {
            damped[column] *= 1.0 + lambda;
        }
    }

    /// H, g and the error of all terms at these values.
    pub(super) fn assemble(&self, graph: &Graph, values: &Values, normal: &mut Normal) -> Result<(), GraphError> {
        normal.hessian.clear();
        normal.hessian.resize(self.rows.len(), 0.0);
        normal.gradient.clear();
        normal.gradient.resize(self.dimension(), 0.0);
        normal.error = 0.0;
        let mut places = self.places.iter();
        graph.linearize(values, |linear, variables| {
            normal.error += linear.error;
            // A residual of nothing has no columns to go through.
            let rows = linear.residual.len().max(1);
            let mut first = linear.jacobian.as_slice();
            for (i, &a) in variables.iter().enumerate() {
                let (of_a, rest) = first.split_at(rows * self.width(a));
                first = rest;
                for (gradient, column) in
                    normal.gradient[self.starts[a.index()]..].iter_mut().zip(of_a.chunks_exact(rows))
                {
                    *gradient += linear.weight * dot(column, &linear.residual);
                }
                self.add_diagonal(&mut normal.hessian, a, of_a, rows, linear.weight);
                let mut second = rest;
                for &b in &variables[i + 1..] {
                    let (of_b, rest) = second.split_at(rows * self.width(b));
                    second = rest;
                    let place = places.next().copied().unwrap_or_default();
                    let (earlier, of_earlier, of_later) = if a < b { (a, of_a, of_b) } else { (b, of_b, of_a) };
                    for (k, column) in of_earlier.chunks_exact(rows).enumerate() {
                        let at = self.columns[self.starts[earlier.index()] + k] + self.width(earlier) - k + place;
                        for (entry, row) in normal.hessian[at..].iter_mut().zip(of_later.chunks_exact(rows)) {
                            *entry += linear.weight * dot(row, column);
                        }
                    }
                }
            }
        })
    }

    fn width(&self, variable: VariableId) -> usize {
        self.starts[variable.index() + 1] - self.starts[variable.index()]
    }

    fn add_diagonal(&self, hessian: &mut [f64], variable: VariableId, jacobian: &[f64], rows: usize, weight: f64) {
        for (k, column) in jacobian.chunks_exact(rows).enumerate() {
            let at = self.columns[self.starts[variable.index()] + k];
            for (entry, row) in hessian[at..].iter_mut().zip(jacobian[k * rows..].chunks_exact(rows)) {
                *entry += weight * dot(row, column);
            }
        }
    }

    /// The error that names the variable of a row.
    fn singular(&self, row: usize, values: &Values) -> GraphError {
        let index = self.starts.partition_point(|start| *start <= row).saturating_sub(1);
        values.ids().nth(index).map_or(GraphError::Empty, |variable| GraphError::Singular { variable })
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Long residuals as four sums, so that no product waits for the one before it.
    let ((a_fours, a_rest), (b_fours, b_rest)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    let mut sums = [0.0; 4];
    for (a, b) in a_fours.iter().zip(b_fours) {
        (0..4).for_each(|lane| sums[lane] += a[lane] * b[lane]);
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

/// The pattern of the Cholesky factor. Variables are eliminated in an order that leaves few entries; it is found on the
/// blocks, which are a tenth of the entries.
fn analyse(
    starts: &[usize],
    blocks: &[(usize, usize)],
    columns: &[usize],
    rows: &[usize],
) -> Result<SymbolicCholesky<usize>, GraphError> {
    let (variables, dimension) = (starts.len() - 1, columns.len() - 1);
    let memory = |_| GraphError::Memory(dimension);
    let (mut block_columns, mut block_rows) = (vec![0], Vec::with_capacity(blocks.len() + variables));
    let mut rest = blocks.iter().peekable();
    for earlier in 0..variables {
        block_rows.push(earlier);
        while let Some(block) = rest.next_if(|block| block.0 == earlier) {
            block_rows.push(block.1);
        }
        block_columns.push(block_rows.len());
    }
    let pattern = SymbolicSparseColMatRef::new_checked(variables, variables, &block_columns, None, &block_rows);
    let (mut order, mut inverse) = (vec![0; variables], vec![0; variables]);
    let mut scratch = scratch(amd::order_maybe_unsorted_scratch::<usize>(variables, block_rows.len()), dimension)?;
    amd::order_maybe_unsorted(&mut order, &mut inverse, pattern, amd::Control::default(), MemStack::new(&mut scratch))
        .map_err(memory)?;

    let order: Vec<usize> = order.into_iter().flat_map(|variable| starts[variable]..starts[variable + 1]).collect();
    let mut inverse = vec![0; dimension];
    order.iter().enumerate().for_each(|(place, &row)| inverse[row] = place);
    factorize_symbolic_cholesky(
        SymbolicSparseColMatRef::new_checked(dimension, dimension, columns, None, rows),
        Side::Lower,
        SymmetricOrdering::Custom(PermRef::new_checked(&order, &inverse, dimension)),
        CholeskySymbolicParams::default(),
    )
    .map_err(memory)
}

fn scratch(size: StackReq, dimension: usize) -> Result<MemBuffer, GraphError> {
    MemBuffer::try_new(size).map_err(|_| GraphError::Memory(dimension))
}

/// The Cholesky factor of a matrix of the structure's pattern, on one thread: a sum has one order.
pub(super) struct Cholesky {
    factor: Vec<f64>,
    scratch: MemBuffer,
}

impl Cholesky {
    /// Room for a factor.
    pub(super) fn new(structure: &Structure) -> Result<Self, GraphError> {
        let symbolic = &structure.symbolic;
        let size = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, faer::Spec::default());
        Ok(Self { factor: vec![0.0; symbolic.len_val()], scratch: scratch(size, structure.dimension())? })
    }

    /// Factorises H, of which every direction has to be determined.
    pub(super) fn factorize_determined(
        &mut self,
        structure: &Structure,
        normal: &Normal,
        values: &Values,
    ) -> Result<(), GraphError> {
        let hessian = &normal.hessian;
        if let Some(row) = structure.diagonal(hessian).position(|information| information <= 0.0) {
            return Err(structure.singular(row, values));
        }
        let mut share = 0.0;
        let mut row = structure.dimension() - 1;
        if self.factorize(structure, hessian) {
            (share, row) = self.least_pivot(structure, hessian);
        } else {
            // With a little damping there are pivots to test.
            let mut damped = Vec::new();
            structure.damp(hessian, 1e3 * FREE, &mut damped);
            if self.factorize(structure, &damped) {
                row = self.least_pivot(structure, &damped).1;
            }
        }
        if share > FREE { Ok(()) } else { Err(structure.singular(row, values)) }
    }

    /// Factorises a matrix; returns whether it is positive definite.
    pub(super) fn factorize(&mut self, structure: &Structure, matrix: &[f64]) -> bool {
        let n = structure.dimension();
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &structure.columns, None, &structure.rows);
        structure
            .symbolic
            .factorize_numeric_llt::<f64>(
                &mut self.factor,
                SparseColMatRef::new(pattern, matrix),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut self.scratch),
                faer::Spec::default(),
            )
            .is_ok()
    }

    /// The least pivot, as a share of the information that its row started with, and that row.
    fn least_pivot(&self, structure: &Structure, matrix: &[f64]) -> (f64, usize) {
        let information: Vec<f64> = structure.diagonal(matrix).collect();
        let order = structure.symbolic.perm();
        let mut least = (f64::INFINITY, 0);
        let mut compare = |place: usize, root: f64| {
            let row = order.map_or(place, |perm| perm.arrays().0[place]);
            let share = root * root / information[row];
            if share < least.0 {
                least = (share, row);
            }
        };
        match structure.symbolic.raw() {
            SymbolicCholeskyRaw::Simplicial(symbolic) => {
                let columns = symbolic.col_ptr()[..structure.dimension()].iter().enumerate();
                columns.for_each(|(place, &column)| compare(place, self.factor[column]));
            }
            SymbolicCholeskyRaw::Supernodal(symbolic) => {
                let factor = SupernodalLltRef::new(symbolic, &self.factor);
                for node in (0..symbolic.n_supernodes()).map(|node| factor.supernode(node)) {
                    let block = node.val();
                    (0..block.ncols()).for_each(|column| compare(node.start() + column, block[(column, column)]));
                }
            }
        }
        least
    }

    /// Solves for each of the right sides, which lie one after the other, in place.
    pub(super) fn solve(&self, structure: &Structure, sides: &mut [f64]) -> Result<(), GraphError> {
        let n = structure.dimension();
        let count = sides.len() / n;
        let symbolic = &structure.symbolic;
        let mut scratch = scratch(symbolic.solve_in_place_scratch::<f64>(count, Par::Seq), n)?;
        LltRef::new(symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(sides, n, count),
            Par::Seq,
            MemStack::new(&mut scratch),
        );
        Ok(())
    }
}
