//! 2-D laser SLAM whose map is a few hundred Gaussian line clusters.
//!
//! # The problem
//! A robot drives through a building it does not know. Its odometry, which drifts, measures the motions u₁..uₜ; its laser
//! measures the scans z₁..zₜ. Wanted are the path x₁..xₜ and the map m, by their posterior density
//!
//! p(x₁..xₜ, m | z₁..zₜ, u₁..uₜ) = p(m | x₁..xₜ, z₁..zₜ) · p(x₁..xₜ | z₁..zₜ, u₁..uₜ).
//!
//! The path is sampled by a particle filter; given a path, the map is a set of clusters, each a line of walls as a
//! Gaussian of two dimensions: mean, direction, and variance along and across. This is IPSLAM (E. Brunskill, N. Roy,
//! "SLAM using Incremental Probabilistic PCA and Dimensionality Reduction", ICRA 2005). Sections, equations and
//! Table I named in this documentation are those of that paper.
//!
//! # The journey of one scan
//! 1. A source of readings ([`log`]; from [`io`] or [`simulate`]) gives odometry and ranges; [`scan`] makes points of the
//!    ranges.
//! 2. Between steps, the robot is tracked in the best map by odometry and scan matching ([`tracking`], [`slam`]). Once it
//!    has moved far enough, the scan makes a step of the filter:
//! 3. [`clustering`] splits the points into lines, each a [`ppca`] model, in the robot's frame and so once for all
//!    particles.
//! 4. Each particle draws a pose: [`motion`] gives the distribution of where the robot may be by odometry, and the
//!    [`evaluator`], on the CPU or on a GPU, climbs from there to a mode of the posterior in the particle's own map.
//! 5. The evaluator computes the log-likelihood of the points there ([`likelihood`]): the particle's weight. [`filter`]
//!    resamples where the effective sample size is low.
//! 6. [`map`] finds for each cluster of the scan the wall that it is part of and merges the two, or adds it as a new wall.
//! 7. A [`report::StepReport`] is handed to observers.
//!
//! [`pipeline`] runs a source, an estimator and observers. After the last scan, [`smoothing`] matches every scan to the
//! finished map and fits the map to all scans; [`picture`] draws the result, [`metrics`] score it.
//!
//! # The modules: each uses only those above it
//! | Module | Task | Paper |
//! |---|---|---|
//! | [`geometry`] | poses of the plane and of space, and cameras | |
//! | [`math`] | logarithm, sine and cosine, the same on every device | |
//! | [`random`] | draws that depend on seed, step, particle and draw number alone | |
//! | [`ablation`] | the paper's own rules in place of ours | |
//! | [`inertial`] | motions by gyroscope and accelerometer, preintegrated | |
//! | [`association`] | which detections of a frame show which landmarks | |
//! | [`factor_graph`] | the most likely values of many variables, and how well they are known | |
//! | [`log`] | readings, and where they come from | |
//! | [`detections`] | what a detector of objects saw, with odometry beside it | |
//! | [`ppca`] | the model of one cluster: fit, density, moments | III-A, eq. 7-13 |
//! | [`scan`] | ranges to points in the robot's frame | |
//! | [`motion`] | odometry to a distribution of motions | eq. 17 |
//! | [`likelihood`] | how likely a point is, given a map | eq. 18 |
//! | [`clustering`] | points to clusters | III-B |
//! | [`grid`] | cells free and occupied, and the area where a robot can be | |
//! | [`map`] | clusters of all maps, matching and merging | III-D, III-E |
//! | [`gpu`] | devices, buffers, submissions | |
//! | [`evaluator`] | poses drawn where motion and scan agree, and how likely the scan is from there | eq. 17, 18 |
//! | [`filter`] | weights, resampling, ancestry, KLD sampling, recovery | IV |
//! | [`tracking`] | the motion since the last step | |
//! | [`report`] | events, step reports, results; estimators and observers | |
//! | [`semantic`] | semantic SLAM by expectation maximisation (Bowman et al., ICRA 2017) | |
//! | [`visual_inertial`] | the way of a camera with an inertial sensor | |
//! | `images` | features, tracks and objects in pictures, with the feature of that name | |
//! | [`smoothing`] | all scans and the finished map, fitted to each other | |
//! | [`loops`] | loops found in the older map and closed by a pose graph | |
//! | [`slam`] | one step after the other | Table I |
//! | [`localization`] | where the robot is in a map that is known | |
//! | [`config`] | the configuration of a run | |
//! | [`pipeline`] | source + estimator + observers -> result | |
//! | [`io`] | files in and out: logs, detections, trajectories, relations, `map.json`, grids of ROS, GeoJSON | |
//! | [`simulate`] | a robot in a building, as a log with known truth | |
//! | [`metrics`] | errors of a trajectory against the truth | |
//! | [`picture`] | a run seen from above, as SVG and PNG | fig. 3, 4 |
//! | [`record`] | recordings for the Rerun viewer | |
//! | `live` | a node of ROS 2, with the feature `live` | |
//! | [`cli`] | the command line | |
//!
//! # Use
//! Half a minute of a simulated drive, mapped by four particles with a map each:
//! ```
//! use ipslam::config::SlamConfig;
//! use ipslam::pipeline::{Outcome, Run};
//! use ipslam::simulate::Simulation;
//! use ipslam::slam::Slam;
//!
//! let config = SlamConfig { particles: 4, maps: 4, ..SlamConfig::default() };
//! let drive = Simulation::building(1);
//! let run = Run { max_scans: Some(300), smoothing: Some(config.smoother()), ..Run::of(&drive) };
//! let Outcome { result, counts, .. } = run.run(&mut Slam::new(config), &mut [], &mut |_| true)?;
//!
//! let walked = result.trajectory().last().map_or(0.0, |last| last.pose.position().coords.norm());
//! println!("{} steps, {} walls, {walked:.1} m from the start", counts.steps, result.map.clusters.len());
//! # assert!(counts.steps > 1 && result.map.clusters.len() > 5 && walked > 1.0, "{counts:?} {walked}");
//! # Ok::<(), ipslam::log::LogError>(())
//! ```
//! Frames: `odom` drifts with the odometry; `world` has its origin at the robot's pose at the first scan; poses are
//! named `world_from_robot`. Units: metres, radians, seconds.

// The command line is written as any program that uses the library.
extern crate self as ipslam;

pub mod ablation;
pub mod association;
#[cfg(not(target_family = "wasm"))]
pub mod cli;
pub mod clustering;
pub mod config;
pub mod detections;
pub mod evaluator;
pub mod factor_graph;
pub mod filter;
pub mod geometry;
pub mod gpu;
pub mod grid;
#[cfg(feature = "images")]
pub mod images;
pub mod inertial;
pub mod io;
pub mod likelihood;
#[cfg(feature = "live")]
pub mod live;
pub mod localization;
pub mod log;
pub mod loops;
pub mod map;
pub mod math;
pub mod metrics;
pub mod motion;
pub mod objects;
mod parameters;
pub mod picture;
pub mod pipeline;
pub mod ppca;
pub mod random;
pub mod record;
pub mod report;
pub mod scan;
pub mod semantic;
pub mod simulate;
pub mod slam;
pub mod smoothing;
pub mod tracking;
pub mod visual_inertial;
