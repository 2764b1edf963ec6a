//! 2-D laser SLAM whose map is a few hundred Gaussian line clusters.
//!
//! # The problem
//! A robot drives through a building it does not know. Its odometry, which drifts, tells the motions u₁..uₜ; its laser
//! tells the scans z₁..zₜ. Wanted are the path x₁..xₜ and the map m, by their posterior density
//!
//! p(x₁..xₜ, m | z₁..zₜ, u₁..uₜ) = p(m | x₁..xₜ, z₁..zₜ) · p(x₁..xₜ | z₁..zₜ, u₁..uₜ).
//!
//! The path is sampled by a particle filter; given a path, the map is a set of clusters, each a line of walls as a
//! Gaussian of two dimensions: mean, direction, and variance along and across. This is IPSLAM (E. Brunskill, N. Roy,
//! "SLAM using Incremental Probabilistic PCA and Dimensionality Reduction", ICRA 2005). Sections, equations and
//! Table I named in this documentation are those of that paper.
//!
//! # The modules, in the order of the data
//! | Module | Task | Paper |
//! |---|---|---|
//! | [`io`] | files in and out: logs, trajectories, relations, `map.json` | |
//! | [`simulate`] | a robot in a building, as a log with known truth | |
//! | [`config`] | everything that can be set | |
//! | [`geometry`] | poses of the plane | |
//! | [`scan`] | ranges to points in the robot's frame | |
//! | [`ppca`] | the model of one cluster: fit, density, moments | III-A, eq. 7-13 |
//! | [`clustering`] | points to clusters | III-B |
//! | [`random`] | draws that depend on seed, step, particle and draw number alone | |
//! | [`motion`] | odometry to a distribution of motions | eq. 17 |
//! | [`evaluator`] | how likely points are, given a pose and a map | eq. 18 |
//! | [`proposal`] | poses drawn where motion and scan agree | |
//! | [`filter`] | weights, resampling, the paths of all particles | IV |
//! | [`map`] | clusters of all maps, matching and merging | III-D, III-E |
//! | [`slam`] | one step after the other | Table I |
//! | [`record`] | what a step reports, and to whom | |
//! | [`metrics`] | errors of a trajectory against the truth | |
//! | [`picture`] | a run seen from above, as SVG and PNG | fig. 3, 4 |
//!
//! # Use
//! ```
//! use ipslam::{config::Config, io::LogSource as _, simulate::Simulation, slam::Slam};
//!
//! let mut slam = Slam::new(Config { particles: 4, maps: 4, ..Config::default() });
//! for entry in Simulation::building(1).open()?.take(100) {
//!     slam.add(&entry?, &mut |step| println!("{} clusters", step.map.len()));
//! }
//! let result = slam.finish();
//! assert!(!result.map.is_empty());
//! # Ok::<(), ipslam::io::LogError>(())
//! ```
//! Frames: `odom` drifts with the odometry; `world` has its origin at the robot's pose at the first scan; poses are
//! named `world_from_robot`. Units: metres, radians, seconds.

pub mod clustering;
pub mod config;
pub mod evaluator;
pub mod filter;
pub mod geometry;
pub mod io;
pub mod map;
pub mod metrics;
pub mod motion;
pub mod picture;
pub mod ppca;
pub mod proposal;
pub mod random;
pub mod record;
pub mod scan;
pub mod simulate;
pub mod slam;
pub mod smoothing;
