//! The core of the filter against formulas written out a second time, published values, and worlds that are known.
//!
//! Random numbers are the library's own counter-based ones, whose known answers are tested beside them; every seed is a
//! constant and part of the message of a failure.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test's helpers may fail as a test does")]

mod anderson_darling;
#[path = "../common/assignments.rs"]
mod assignments;
mod associate;
mod association;
mod clustering;
mod covariance;
mod damage;
mod drive;
mod evaluator;
mod factor_graph;
mod failover;
mod grid;
#[cfg(feature = "images")]
mod images;
mod localization;
mod loops;
mod matching;
mod merging;
mod objects;
#[path = "../common/oracle.rs"]
mod oracle;
mod picture;
mod proposal;
mod semantic;
mod semantic_space;
mod simulate;
mod space;
mod visual_inertial;
#[path = "../common/wall.rs"]
mod wall;

use ipslam::geometry::Pose;
use ipslam::random::{self, Draw};
use nalgebra::Point2;
use proptest::prelude::*;
use wall::wall;

/// Of every simulation.
const SEED: u64 = 1;

/// Standard normal numbers.
fn normals(seed: u64) -> impl Iterator<Item = f64> {
    (0..).flat_map(move |i| random::normals(seed, 0, i, Draw::Motion)).map(f64::from)
}

/// Uniform numbers in (0, 1), independent of [`normals`].
fn uniforms(seed: u64) -> impl Iterator<Item = f64> {
    (0..).flat_map(move |i| random::bits(seed, 0, i, Draw::Resample)).map(|word| f64::from(random::uniform(word)))
}

/// Points of a wall from `a` to `b`: uniform along it, normal with `noise` [m] across it.
fn wall_points(a: [f64; 2], b: [f64; 2], noise: f64, count: usize, seed: u64) -> Vec<Point2<f64>> {
    let (a, b) = (Point2::from(a), Point2::from(b));
    let along = b - a;
    let normal = nalgebra::Vector2::new(-along.y, along.x).normalize();
    uniforms(seed).zip(normals(seed)).take(count).map(|(share, z)| a + along * share + normal * (noise * z)).collect()
}

/// Poses up to 100 m off, in any direction.
fn poses() -> impl Strategy<Value = Pose> {
    (-100.0..100.0, -100.0..100.0, -3.1..3.1).prop_map(|(x, y, heading)| Pose::new(x, y, heading))
}
