//! Factor graphs: the most likely values of many variables, given many measurements of a few of them each.
//!
//! The density of all variables x is a product of factors. Its negative logarithm, but for a constant, is the error
//!
//! E(x) = Σᵢ wᵢ ρᵢ(‖Rᵢ eᵢ(x)‖)
//!
//! with eᵢ the residual of a [`Factor`], Rᵢ the square root of its information ([`Noise`]), ρᵢ a [`Loss`], ½ d² by default,
//! and wᵢ ≥ 0 a weight: in an M step, the probability that the measurement belongs to the variables it is said to.
//! A [`Solver`] finds a minimum of E, [`Covariances`] the covariance there.
//!
//! Poses are named `world_from_robot`. Metres and radians.
//!
//! ```
//! use ipslam::factor_graph::{Between, Covariances, Graph, Noise, Prior, RangeBearing, Solver, Values};
//! use ipslam::geometry::Pose;
//! use nalgebra::Point2;
//!
//! let mut values = Values::new();
//! let (start, end) = (values.add_pose(Pose::IDENTITY), values.add_pose(Pose::new(1.1, 0.0, 0.0)));
//! let tree = values.add_point(Point2::new(2.0, 1.0));
//! let (tight, odometry) = (Noise::sigmas(&[1e-3; 3])?, Noise::sigmas(&[0.1, 0.1, 0.05])?);
//!
//! let mut graph = Graph::new();
//! graph.add(Prior::pose(start, Pose::IDENTITY), tight)?;
//! graph.add(Between::new(start, end, Pose::new(1.0, 0.0, 0.0)), odometry)?;
//! let sight = Noise::sigmas(&[0.05, 0.01])?;
//! graph.add(RangeBearing::new(start, tree, 5.0_f64.sqrt(), 0.5_f64.atan()), sight.clone())?;
//! let seen_again = graph.add(RangeBearing::new(end, tree, 2.0_f64.sqrt(), 1.0_f64.atan()), sight)?;
//! graph.set_weight(seen_again, 0.9)?;
//!
//! let solution = Solver::default().solve(&graph, &mut values)?;
//! assert!(solution.converged && (values.pose(end)?.x - 1.0).abs() < 1e-6);
//! let joint = Covariances::new(&graph, &values)?.joint(&[end, tree])?;
//! assert_eq!(joint.shape(), (5, 5));
//! # Ok::<(), ipslam::factor_graph::GraphError>(())
//! ```

mod covariance;
mod factors;
mod graph;
mod linear;
mod noise;
mod solver;
mod variables;

pub use covariance::{Columns, Covariances};
pub use factors::{
    Between, Factor, Inertial, Jacobian, Odometry, Odometry3, Prediction, Prior, RangeBearing, Sighting, Stereo,
    StereoCamera, Track, Walk,
};
pub use graph::{Graph, TermId};
pub use noise::{Loss, Noise};
pub use solver::{Solution, Solver, SolverConfig};
pub use variables::{Kind, Value, Values, VariableId};

/// Why a graph has no solution.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GraphError {
    /// A factor names a variable that the values do not have.
    #[error("there is no variable {}", variable.index())]
    Unknown {
        /// The variable.
        variable: VariableId,
    },
    /// A factor needs another kind of variable.
    #[error("variable {} is a {kind:?}, but has to be {wanted}", variable.index())]
    Kind {
        /// The variable.
        variable: VariableId,
        /// What it is.
        kind: Kind,
        /// What it has to be.
        wanted: &'static str,
    },
    /// A factor names a variable twice.
    #[error("a factor names variable {} twice", variable.index())]
    Repeated {
        /// The variable.
        variable: VariableId,
    },
    /// A vector is too long or too short.
    #[error("{found} numbers where {wanted} have to be")]
    Length {
        /// How many there have to be.
        wanted: usize,
        /// How many there are.
        found: usize,
    },
    /// A standard deviation is not positive, or a covariance not positive definite.
    #[error("noise has to be positive: standard deviations above zero, or a symmetric, positive definite covariance")]
    Noise,
    /// The scale of a loss is not positive.
    #[error("the scale of {0:?} has to be a positive number")]
    Loss(Loss),
    /// A weight is negative or no number.
    #[error("a factor's weight is {0}, but has to be 0 or more")]
    Weight(f64),
    /// The graph has no such term.
    #[error("the graph has no term {}", .0.index())]
    Term(TermId),
    /// A residual or a derivative is no finite number.
    #[error("the residual of term {} or its derivative is not finite", .0.index())]
    NotFinite(TermId),
    /// The factors leave a direction free: a variable that nothing measures, or a map that nothing ties to the world.
    /// Add a prior or another measurement.
    #[error(
        "the factors do not determine variable {}, or another one tied to it: a prior or another measurement is due",
        variable.index()
    )]
    Singular {
        /// The last variable that the elimination left free.
        variable: VariableId,
    },
    /// There are no variables.
    #[error("there are no variables to solve for")]
    Empty,
    /// There is too little memory for the matrices.
    #[error("there is too little memory for a system of {0} unknowns")]
    Memory(usize),
}
