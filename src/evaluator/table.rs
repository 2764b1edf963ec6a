//! The clusters of all maps in f32, as both backends store them: one row per slot of the pool.
//!
//! Rows are relative to an anchor near the robot, so that a map kilometres from the origin keeps its millimetres. When
//! the robot has gone too far from it, the anchor follows and all rows are written anew.

use crate::ablation::Latent;
use crate::geometry::Pose;
use crate::likelihood::{ClusterParams, LikelihoodConfig};
use crate::map::{Pool, Slot};
use crate::ppca::Cluster;
use nalgebra::Point2;
use rayon::prelude::*;
use std::f32::consts::FRAC_1_SQRT_2;
use std::sync::atomic::{AtomicU64, Ordering};

/// Everything that a scan may meet.
#[derive(Debug)]
pub struct ClusterTable {
    likelihood: LikelihoodConfig,
    latent: Latent,
    max_capture_sigma: f64,
    anchor: Point2<f64>,
    rows: Vec<ClusterParams>,
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

/// Where a cluster is, and where it can be likelier than an outlier, as thick as it ever is: nowhere outside this circle.
#[derive(Clone, Copy, Debug, Default)]
struct Circle {
    x: f32,
    y: f32,
    radius: f32,
}

/// The anchor follows where the robot is further from it than this \[m\].
const MAX_OFF: f64 = 16.0;

impl ClusterTable {
    /// A table without rows; walls will be thickened to at most `max_capture_sigma` \[m\].
    pub fn new(likelihood: LikelihoodConfig, latent: Latent, max_capture_sigma: f64) -> Self {
        static TABLES: AtomicU64 = AtomicU64::new(0);
        Self {
            likelihood,
            latent,
            max_capture_sigma,
            anchor: Point2::origin(),
            rows: Vec::new(),
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
        let count = pool.capacity();
        self.changed = if slots.len() == count { Changed::All } else { Changed::Slots(slots.clone()) };
        self.rows.resize(count, ClusterParams::default());
        self.circles.resize(count, Circle::default());
        let written: Vec<(usize, ClusterParams, Circle)> = slots
            .into_par_iter()
            .map(|slot| {
                let cluster = &pool.get(slot).cluster;
                let row = ClusterParams::new(cluster, self.anchor, &self.likelihood, self.latent);
                (slot as usize, row, self.circle(cluster, row))
            })
            .collect();
        for (slot, row, circle) in written {
            self.rows[slot] = row;
            self.circles[slot] = circle;
        }
        self.revision.update += 1;
    }

    fn circle(&self, cluster: &Cluster, row: ClusterParams) -> Circle {
        let mean = cluster.mean - self.anchor;
        let metres = |distance: f32, [x, y, _]: [f32; 3]| distance / x.hypot(y);
        // Where ln p falls to that of an outlier, in units of √2 standard deviations.
        let reach = |row: ClusterParams| (row.log_peak - self.log_outlier()).max(0.0).sqrt();
        let along = metres(row.half_length + reach(row), row.along);
        // Across, it reaches further the thicker it is, until its peak is half a nat above an outlier:
        // d/dσ of σ² (ln peak - ln outlier) = 0.
        let furthest = metres(FRAC_1_SQRT_2, row.across) * (row.log_peak - self.log_outlier() - 0.5).exp();
        let thick = row.thickened(furthest.min(self.max_capture_sigma as f32));
        let across = metres(reach(thick), thick.across);
        // Its whole length in any case: matching needs walls that explain nothing as well.
        let radius = along.hypot(across).max(0.5 * cluster.length() as f32);
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

    /// The clusters by slot.
    pub fn rows(&self) -> &[ClusterParams] {
        &self.rows
    }

    /// Which state this is.
    pub fn revision(&self) -> Revision {
        self.revision
    }

    /// What the last update wrote.
    pub fn changed(&self) -> &Changed {
        &self.changed
    }

    /// Those of these slots that can explain a point within `reach` \[m\] of a place, in their order, even where walls are
    /// thickened, up to the `max_capture_sigma` of the table.
    pub fn near(&self, slots: &[Slot], x: f32, y: f32, reach: f32) -> Vec<Slot> {
        let is_near = |slot: &Slot| {
            let circle = &self.circles[*slot as usize];
            let (dx, dy, reach) = (circle.x - x, circle.y - y, reach + circle.radius);
            dx * dx + dy * dy <= reach * reach
        };
        slots.iter().copied().filter(is_near).collect()
    }
}
