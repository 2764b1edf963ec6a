//! The sum of all factors.

use super::{Factor, GraphError, Loss, Noise, Values, VariableId};
use nalgebra::DMatrixViewMut;
use std::sync::Arc;

/// Names a term of a [`Graph`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TermId(u32);

impl TermId {
    /// Its number, counted from 0 in the order in which terms were added.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// w ρ(‖R e‖).
#[derive(Clone, Debug)]
struct Term {
    factor: Arc<dyn Factor>,
    noise: Noise,
    loss: Loss,
    weight: f64,
}

/// All factors, each with its noise, loss and weight. A copy shares the factors.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    terms: Vec<Term>,
}

/// A term at given values: the residual and its derivative, both divided by the noise.
#[derive(Debug, Default)]
pub(super) struct Linear {
    pub residual: Vec<f64>,
    /// Column by column, as many rows as residuals.
    pub jacobian: Vec<f64>,
    /// w ρ: what the term adds to the error.
    pub error: f64,
    /// What ½ ‖residual‖² is to be multiplied by, to have the slope of the error.
    pub weight: f64,
}

impl Graph {
    /// No factors.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a factor of weight one and squared loss.
    ///
    /// # Errors
    /// The noise is of another length than the residual, or the factor names a variable twice.
    pub fn add(&mut self, factor: impl Factor + 'static, noise: Noise) -> Result<TermId, GraphError> {
        if noise.dimension() != factor.dimension() {
            return Err(GraphError::Length { wanted: factor.dimension(), found: noise.dimension() });
        }
        let mut sorted = factor.variables().to_vec();
        sorted.sort_unstable();
        if let Some(pair) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(GraphError::Repeated { variable: pair[0] });
        }
        self.terms.push(Term { factor: Arc::new(factor), noise, loss: Loss::default(), weight: 1.0 });
        Ok(TermId(self.terms.len() as u32 - 1))
    }

    fn term(&mut self, id: TermId) -> Result<&mut Term, GraphError> {
        self.terms.get_mut(id.index()).ok_or(GraphError::Term(id))
    }

    /// Gives a term another weight w; with 0 the term is left out.
    ///
    /// # Errors
    /// There is no such term, or the weight is negative or not finite.
    pub fn set_weight(&mut self, id: TermId, weight: f64) -> Result<(), GraphError> {
        if !(weight.is_finite() && weight >= 0.0) {
            return Err(GraphError::Weight(weight));
        }
        self.term(id)?.weight = weight;
        Ok(())
    }

    /// Gives a term another loss ρ.
    ///
    /// # Errors
    /// There is no such term, or the scale of the loss is not positive.
    pub fn set_loss(&mut self, id: TermId, loss: Loss) -> Result<(), GraphError> {
        if !loss.is_valid() {
            return Err(GraphError::Loss(loss));
        }
        self.term(id)?.loss = loss;
        Ok(())
    }

    /// Gives a term another noise R.
    ///
    /// # Errors
    /// There is no such term, or its residual is of another length.
    pub fn set_noise(&mut self, id: TermId, noise: Noise) -> Result<(), GraphError> {
        let term = self.term(id)?;
        if noise.dimension() != term.factor.dimension() {
            return Err(GraphError::Length { wanted: term.factor.dimension(), found: noise.dimension() });
        }
        term.noise = noise;
        Ok(())
    }

    /// How many terms there are.
    pub fn len(&self) -> usize {
        self.terms.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.terms.is_empty()
    }

    /// The variables of each term.
    pub(super) fn variables(&self) -> impl Iterator<Item = &[VariableId]> {
        self.terms.iter().map(|term| term.factor.variables())
    }

    /// The error E of all terms.
    ///
    /// # Errors
    /// A factor does not fit the values, or its residual is not finite.
    pub fn error(&self, values: &Values) -> Result<f64, GraphError> {
        let mut linear = Linear::default();
        let mut error = 0.0;
        for id in (0..self.terms.len() as u32).map(TermId) {
            self.evaluate(id, values, false, &mut linear)?;
            error += linear.error;
        }
        Ok(error)
    }

    /// The error of one term.
    ///
    /// # Errors
    /// There is no such term, it does not fit the values, or its residual is not finite.
    pub fn term_error(&self, id: TermId, values: &Values) -> Result<f64, GraphError> {
        let mut linear = Linear::default();
        self.evaluate(id, values, false, &mut linear)?;
        Ok(linear.error)
    }

    /// All terms at these values, one after the other.
    pub(super) fn linearize(
        &self,
        values: &Values,
        mut each: impl FnMut(&Linear, &[VariableId]),
    ) -> Result<(), GraphError> {
        let mut linear = Linear::default();
        for id in (0..self.terms.len() as u32).map(TermId) {
            self.evaluate(id, values, true, &mut linear)?;
            each(&linear, self.terms[id.index()].factor.variables());
        }
        Ok(())
    }

    /// One term; without `derivatives` the Jacobian stays empty.
    fn evaluate(&self, id: TermId, values: &Values, derivatives: bool, linear: &mut Linear) -> Result<(), GraphError> {
        let Term { factor, noise, loss, weight } = self.terms.get(id.index()).ok_or(GraphError::Term(id))?;
        let rows = factor.dimension();
        let mut columns = 0;
        if derivatives {
            for variable in factor.variables() {
                columns += values.kind(*variable)?.dimension();
            }
        }
        linear.residual.clear();
        linear.residual.resize(rows, 0.0);
        linear.jacobian.clear();
        linear.jacobian.resize(rows * columns, 0.0);
        (linear.error, linear.weight) = (0.0, 0.0);
        // A term that is left out may be undefined.
        if *weight == 0.0 {
            return Ok(());
        }

        if derivatives {
            let mut jacobian = DMatrixViewMut::from_slice(&mut linear.jacobian, rows, columns);
            factor.evaluate(values, &mut linear.residual, Some(&mut jacobian))?;
            noise.whiten(jacobian);
        } else {
            factor.evaluate(values, &mut linear.residual, None)?;
        }
        noise.whiten(DMatrixViewMut::from_slice(&mut linear.residual, rows, 1));
        let squared: f64 = linear.residual.iter().map(|number| number * number).sum();
        let (cost, slope) = loss.cost_and_weight(squared);
        (linear.error, linear.weight) = (weight * cost, weight * slope);
        if linear.error.is_finite() && linear.jacobian.iter().all(|number| number.is_finite()) {
            Ok(())
        } else {
            Err(GraphError::NotFinite(id))
        }
    }
}
