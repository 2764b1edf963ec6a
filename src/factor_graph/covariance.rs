//! How well the variables are known.

use super::linear::{Cholesky, Normal, Structure};
use super::{Graph, GraphError, Values, VariableId};
use nalgebra::DMatrix;

/// Covariances at given values, of the normal density that has the curvature of the error there: blocks of H⁻¹, in the
/// variables' steps. Of a pose they are in its own frame, (forward, sideways \[m\], turn \[rad\]).
pub struct Covariances {
    values: Values,
    structure: Structure,
    cholesky: Cholesky,
}

/// The columns of one variable in the covariance of all.
pub struct Columns<'a> {
    values: &'a Values,
    columns: DMatrix<f64>,
}

impl Covariances {
    /// Factorises H at these values, at best those of a [`Solver`](super::Solver).
    ///
    /// # Errors
    /// A factor does not fit the values, a residual is not finite, or the factors leave a direction free.
    pub fn new(graph: &Graph, values: &Values) -> Result<Self, GraphError> {
        let structure = Structure::new(graph, values)?;
        let mut normal = Normal::default();
        structure.assemble(graph, values, &mut normal)?;
        let mut cholesky = Cholesky::new(&structure)?;
        cholesky.factorize_determined(&structure, &normal, values)?;
        Ok(Self { values: values.clone(), structure, cholesky })
    }

    /// The covariance of one variable.
    ///
    /// # Errors
    /// There is no such variable, or too little memory.
    pub fn block(&self, variable: VariableId) -> Result<DMatrix<f64>, GraphError> {
        self.columns(variable)?.with(variable)
    }

    /// The covariance of several variables together, one variable after the other.
    ///
    /// # Errors
    /// There is no such variable, or too little memory.
    pub fn joint(&self, variables: &[VariableId]) -> Result<DMatrix<f64>, GraphError> {
        let mut ranges = Vec::with_capacity(variables.len());
        for variable in variables {
            ranges.push(self.values.tangent(*variable)?);
        }
        let at: Vec<usize> = ranges.into_iter().flatten().collect();
        Ok(self.solve(&at)?.select_rows(&at))
    }

    /// The covariance of a variable with every other one: cheaper than [`Self::joint`] where one pose is paired with many
    /// points.
    ///
    /// # Errors
    /// There is no such variable, or too little memory.
    pub fn columns(&self, variable: VariableId) -> Result<Columns<'_>, GraphError> {
        let at: Vec<usize> = self.values.tangent(variable)?.collect();
        Ok(Columns { values: &self.values, columns: self.solve(&at)? })
    }

    /// Columns of H⁻¹.
    fn solve(&self, at: &[usize]) -> Result<DMatrix<f64>, GraphError> {
        let mut columns = DMatrix::zeros(self.structure.dimension(), at.len());
        for (column, row) in at.iter().enumerate() {
            columns[(*row, column)] = 1.0;
        }
        self.cholesky.solve(&self.structure, columns.as_mut_slice())?;
        Ok(columns)
    }
}

impl Columns<'_> {
    /// The covariance of another variable, in the rows, with this one, in the columns; of this one with itself, its own.
    ///
    /// # Errors
    /// There is no such variable.
    pub fn with(&self, other: VariableId) -> Result<DMatrix<f64>, GraphError> {
        let range = self.values.tangent(other)?;
        Ok(self.columns.rows(range.start, range.len()).into_owned())
    }
}
