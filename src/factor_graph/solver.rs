//! Levenberg-Marquardt.

use super::linear::{Cholesky, Normal, Structure};
use super::{Graph, GraphError, Values};

/// When the search for a minimum ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolverConfig {
    /// Maximum number of steps.
    pub iterations: usize,
    /// The search has ended when a step promises to lower the error by less than this share.
    pub relative_tolerance: f64,
    /// The same in units of the error, in nats.
    pub absolute_tolerance: f64,
}

impl Default for SolverConfig {
    fn default() -> Self {
        Self { iterations: 100, relative_tolerance: 1e-9, absolute_tolerance: 1e-9 }
    }
}

/// The damping after the first step that failed, as a share of the information.
const FIRST_LAMBDA: f64 = 1e-6;
/// Damping falls at most by this factor at a time.
const MAX_FALL: f64 = 0.1;
/// Less damping is none.
const MIN_LAMBDA: f64 = 1e-14;
/// No shorter step is tried: it would be rounded away.
const MAX_LAMBDA: f64 = 1e12;
/// A step is good that lowers the error by this share of what it promised.
const MIN_GAIN: f64 = 1e-3;

/// How a search ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// How many steps were taken.
    pub iterations: usize,
    /// The error before the first step.
    pub initial_error: f64,
    /// The error after the last step.
    pub error: f64,
    /// Whether the last step promised no more than the tolerances. Else the search ran out of steps, or no step
    /// lowered the error.
    pub converged: bool,
}

/// Finds the minimum of the error of a [`Graph`] near the values it is given.
///
/// Each step d solves (H + λ diag H) d = -g, with H = Σ w JᵀJ and g = Σ w Jᵀr: for λ = 0 that of Gauss and Newton. A
/// step that lowers the error is taken, and λ follows how much of its promise it kept; else λ grows, faster at each failure.
/// The pattern of H is analysed at the first solve, and again
/// only where factors join other variables than at the last one, so that it costs nothing to change weights.
#[derive(Default)]
pub struct Solver {
    /// When to stop.
    pub config: SolverConfig,
    workspace: Option<Workspace>,
}

struct Workspace {
    structure: Structure,
    cholesky: Cholesky,
    normal: Normal,
    /// Whether the factor is that of H as it is.
    is_factorised: bool,
    damped: Vec<f64>,
    step: Vec<f64>,
}

impl Workspace {
    fn new(graph: &Graph, values: &Values) -> Result<Self, GraphError> {
        let structure = Structure::new(graph, values)?;
        let cholesky = Cholesky::new(&structure)?;
        let normal = Normal::default();
        Ok(Self { structure, cholesky, normal, is_factorised: false, damped: Vec::new(), step: Vec::new() })
    }

    /// The step of this damping, and by how much it promises to lower the error; none where the damped H is not positive
    /// definite.
    fn step(&mut self, lambda: f64) -> Result<Option<f64>, GraphError> {
        if !std::mem::take(&mut self.is_factorised) || lambda != 0.0 {
            self.structure.damp(&self.normal.hessian, lambda, &mut self.damped);
            if !self.cholesky.factorize(&self.structure, &self.damped) {
                return Ok(None);
            }
        }
        self.step.clear();
        self.step.extend(self.normal.gradient.iter().map(|slope| -slope));
        self.cholesky.solve(&self.structure, &mut self.step)?;
        // -(g·d + ½ d·H d), where H d = -g - λ diag(H) d.
        let along: f64 = self.normal.gradient.iter().zip(&self.step).map(|(slope, step)| slope * step).sum();
        let damping: f64 =
            self.structure.diagonal(&self.normal.hessian).zip(&self.step).map(|(h, step)| h * step * step).sum();
        Ok(Some(0.5 * (lambda * damping - along)).filter(|promise| promise.is_finite()))
    }
}

impl Solver {
    /// A solver that stops by these rules.
    pub fn new(config: SolverConfig) -> Self {
        Self { config, workspace: None }
    }

    /// Moves the values to the minimum. On an error they stay as they are.
    ///
    /// # Errors
    /// A factor does not fit the values; a residual is not finite at the start; or the factors leave a direction free at
    /// the start ([`GraphError::Singular`]).
    pub fn solve(&mut self, graph: &Graph, values: &mut Values) -> Result<Solution, GraphError> {
        let mut workspace = match self.workspace.take().filter(|workspace| workspace.structure.fits(graph, values)) {
            Some(workspace) => workspace,
            None => Workspace::new(graph, values)?,
        };
        let solution = minimise(&self.config, &mut workspace, graph, values);
        self.workspace = Some(workspace);
        solution
    }
}

fn minimise(
    config: &SolverConfig,
    workspace: &mut Workspace,
    graph: &Graph,
    values: &mut Values,
) -> Result<Solution, GraphError> {
    let mut current = values.clone();
    workspace.structure.assemble(graph, &current, &mut workspace.normal)?;
    // Damping would hide a direction that is free.
    workspace.cholesky.factorize_determined(&workspace.structure, &workspace.normal, &current)?;
    workspace.is_factorised = true;
    let initial_error = workspace.normal.error;
    let mut solution = Solution { iterations: 0, initial_error, error: initial_error, converged: false };
    let mut damping = Damping { lambda: 0.0, growth: 2.0 };
    while solution.iterations < config.iterations && !solution.converged {
        let Some((next, error)) = descend(config, workspace, graph, &current, &mut damping, &mut solution.converged)?
        else {
            break;
        };
        current = next;
        solution.iterations += 1;
        solution.error = error;
        if !solution.converged && solution.iterations < config.iterations {
            workspace.structure.assemble(graph, &current, &mut workspace.normal)?;
        }
    }
    *values = current;
    Ok(solution)
}

/// One step that lowers the error: the values and the error there. None where there is no such step, or none is needed.
fn descend(
    config: &SolverConfig,
    workspace: &mut Workspace,
    graph: &Graph,
    current: &Values,
    damping: &mut Damping,
    converged: &mut bool,
) -> Result<Option<(Values, f64)>, GraphError> {
    let before = workspace.normal.error;
    while damping.lambda <= MAX_LAMBDA {
        if let Some(promise) = workspace.step(damping.lambda)? {
            let next = current.retract(&workspace.step)?;
            // Where a residual is undefined, the step was too long.
            let error = graph.error(&next).unwrap_or(f64::INFINITY);
            // A heavily damped step promises little wherever it starts.
            *converged =
                damping.lambda < 1.0 && promise <= config.absolute_tolerance + config.relative_tolerance * before;
            if *converged {
                return Ok((error <= before).then_some((next, error)));
            }
            let gain = (before - error) / promise;
            if gain >= MIN_GAIN {
                damping.relax(gain);
                return Ok(Some((next, error)));
            }
        }
        damping.grow();
    }
    Ok(None)
}

/// The damping λ of the next step, by the rule of H. B. Nielsen, "Damping parameter in Marquardt's method", 1999.
struct Damping {
    lambda: f64,
    /// By how much it grows at the next failure.
    growth: f64,
}

impl Damping {
    /// A step was too long.
    fn grow(&mut self) {
        self.lambda = (self.lambda * self.growth).max(FIRST_LAMBDA);
        self.growth *= 2.0;
    }

    /// A step kept this share of what it promised.
    fn relax(&mut self, gain: f64) {
        self.lambda *= (1.0 - (2.0 * gain - 1.0).powi(3)).max(MAX_FALL);
        if self.lambda < MIN_LAMBDA {
            self.lambda = 0.0;
        }
        self.growth = 2.0;
    }
}
