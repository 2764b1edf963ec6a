//! The clusters of all maps in f32, as both backends hold them: a row for each slot of the pool.
//!
//! Rows are relative to an anchor near the robot, so that a map kilometres from the origin keeps its millimetres. When
//! the robot has gone too far from it, the anchor follows and all rows are written anew.

use super::layout::{ClusterParams, LikelihoodConfig};
use crate::geometry::Pose;
use crate::map::{Pool, Slot};
use crate::ppca::Cluster;
use nalgebra::Point2;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Everything that a scan may meet.
#[derive(Debug)]
pub struct ClusterTable {
    likelihood: LikelihoodConfig,
    anchor: Point2<f64>,
    fine: Vec<ClusterParams>,
    coarse: Vec<ClusterParams>,
    circles: Vec<Circle>,
    revision: Revision,
    changed: Changed,
}

/// Which state of which table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Revision {
    table: u64,
    update: u64,
}

impl Revision {
    /// Whether it is the state that the next update made of this one.
    pub fn follows(self, earlier: Self) -> bool {
        self == Self { update: earlier.update + 1, ..earlier }
    }
}

/// Rows that the last update wrote.
#[derive(Clone, Debug, PartialEq)]
pub enum Changed {
    /// Every one of them.
    All,
    /// These.
    Slots(Vec<Slot>),
}

/// Where a cluster is, and where it can be likelier than an outlier: nowhere outside this circle.
#[derive(Clone, Copy, Debug, Default)]
struct Circle {
    x: f32,
    y: f32,
    radius: f32,
}

/// The anchor follows where the robot is further from it than this \[m\].
const MAX_OFF: f64 = 16.0;

impl ClusterTable {
    /// A table without rows.
    pub fn new(likelihood: LikelihoodConfig) -> Self {
        static TABLES: AtomicU64 = AtomicU64::new(0);
        Self {
            likelihood,
            anchor: Point2::origin(),
            fine: Vec::new(),
            coarse: Vec::new(),
            circles: Vec::new(),
            revision: Revision { table: TABLES.fetch_add(1, Ordering::Relaxed), update: 0 },
            changed: Changed::All,
        }
    }

    /// Writes what has changed in the pool since the last update. The robot is somewhere near `robot`.
    pub fn update(&mut self, pool: &mut Pool, robot: Pose) {
        let inserted = pool.take_inserted();
        let off = robot.position() - self.anchor;
        let slots = if off.amax() > MAX_OFF && off.iter().all(|o| o.is_finite()) {
            self.anchor = robot.position().map(f64::round);
            (0..pool.capacity() as Slot).collect()
        } else {
            inserted
        };
        let rows = pool.capacity();
        self.changed = if slots.len() == rows { Changed::All } else { Changed::Slots(slots.clone()) };
        self.fine.resize(rows, ClusterParams::default());
        self.coarse.resize(rows, ClusterParams::default());
        self.circles.resize(rows, Circle::default());
        let written: Vec<(usize, [ClusterParams; 2], Circle)> = slots
            .into_par_iter()
            .map(|slot| {
                let cluster = &pool.get(slot).cluster;
                let params = [self.likelihood, self.likelihood.capturing()];
                let params = params.map(|likelihood| ClusterParams::new(cluster, self.anchor, &likelihood));
                (slot as usize, params, self.circle(cluster, params))
            })
            .collect();
        for (row, [fine, coarse], circle) in written {
            self.fine[row] = fine;
            self.coarse[row] = coarse;
            self.circles[row] = circle;
        }
        self.revision.update += 1;
    }

    fn circle(&self, cluster: &Cluster, params: [ClusterParams; 2]) -> Circle {
        let mean = cluster.mean - self.anchor;
        let radius = |params: ClusterParams| {
            // Where ln p falls to that of an outlier, in units of √2 standard deviations.
            let reach = (params.log_peak - self.log_outlier()).max(0.0).sqrt();
            let metres = |distance: f32, [x, y, _]: [f32; 3]| distance / x.hypot(y);
            metres(params.half_length + reach, params.along).hypot(metres(reach, params.across))
        };
        // Its whole length in any case: who looks for walls to match needs those that explain nothing, too.
        let radius = params.map(radius).into_iter().fold(0.5 * cluster.length() as f32, f32::max);
        // Room for rounding.
        Circle { x: mean.x as f32, y: mean.y as f32, radius: radius * 1.001 + 0.001 }
    }

    /// Origin of the evaluator's frame, in the world.
    pub fn anchor(&self) -> Point2<f64> {
        self.anchor
    }

    /// ln of the density of a point that no cluster explains.
    pub fn log_outlier(&self) -> f32 {
        self.likelihood.log_outlier()
    }

    /// The clusters as they are, by slot.
    pub fn fine(&self) -> &[ClusterParams] {
        &self.fine
    }

    /// The clusters as thick as they are for the first steps of a climb, by slot.
    pub fn coarse(&self) -> &[ClusterParams] {
        &self.coarse
    }

    /// Which state this is.
    pub fn revision(&self) -> Revision {
        self.revision
    }

    /// What the last update wrote.
    pub fn changed(&self) -> &Changed {
        &self.changed
    }

    /// Those of these slots that can explain a point within `reach` \[m\] of a place, in their order.
    pub fn near(&self, slots: &[Slot], x: f32, y: f32, reach: f32) -> Vec<Slot> {
        let is_near = |slot: &Slot| {
            let circle = &self.circles[*slot as usize];
            let (dx, dy, reach) = (circle.x - x, circle.y - y, reach + circle.radius);
            dx * dx + dy * dy <= reach * reach
        };
        slots.iter().copied().filter(is_near).collect()
    }
}
