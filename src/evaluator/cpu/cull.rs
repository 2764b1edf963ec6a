//! Candidate lists: which clusters can explain a point of a tile, from any pose of a group.
//!
//! A cluster can win a point only inside an ellipse around it; outside, an outlier is likelier. The points of a tile,
//! seen from all poses of a group, lie in a circle. Clusters whose ellipse does not reach the circle are left out, and
//! no maximum changes. Twin of `shaders/cull.wgsl`.

use crate::evaluator::pose::LocalPose;
use crate::evaluator::tiles::Tile;
use crate::likelihood::ClusterParams;
use crate::math::{sin_cos, wrap};
use pulp::{Arch, Simd, WithSimd};

/// The clusters of one map around the robot.
#[derive(Clone, Debug, Default)]
pub struct LocalMap {
    /// In the order of the map.
    clusters: Vec<ClusterParams>,
    /// The same, `LANES` a block, with what the circles are measured by.
    blocks: Vec<Block>,
    log_outlier: f32,
}

const LANES: usize = 16;

#[derive(Clone, Copy, Debug)]
struct Block {
    along: [[f32; LANES]; 3],
    across: [[f32; LANES]; 3],
    half_length: [f32; LANES],
    log_peak: [f32; LANES],
    /// What a metre is along, and across.
    metre_along: [f32; LANES],
    metre_across: [f32; LANES],
}

impl LocalMap {
    /// These clusters.
    pub fn new(clusters: impl IntoIterator<Item = ClusterParams>, log_outlier: f32) -> Self {
        let clusters: Vec<_> = clusters.into_iter().collect();
        let blocks = clusters.chunks(LANES).map(Block::new).collect();
        Self { clusters, blocks, log_outlier }
    }

    /// ln of the density of a point that no cluster explains.
    pub fn log_outlier(&self) -> f32 {
        self.log_outlier
    }
}

impl Block {
    fn new(clusters: &[ClusterParams]) -> Self {
        let none = [0.0; LANES];
        let mut block = Self {
            along: [none; 3],
            across: [none; 3],
            half_length: none,
            // Lanes without a cluster are never near.
            log_peak: [f32::NEG_INFINITY; LANES],
            metre_along: none,
            metre_across: none,
        };
        for (lane, cluster) in clusters.iter().enumerate() {
            for k in 0..3 {
                block.along[k][lane] = cluster.along[k];
                block.across[k][lane] = cluster.across[k];
            }
            block.half_length[lane] = cluster.half_length;
            block.log_peak[lane] = cluster.log_peak;
        }
        let length = |[x, y, _]: &[[f32; LANES]; 3], lane: usize| (x[lane] * x[lane] + y[lane] * y[lane]).sqrt();
        block.metre_along = std::array::from_fn(|lane| length(&block.along, lane));
        block.metre_across = std::array::from_fn(|lane| length(&block.across, lane));
        block
    }

    /// Which lanes can explain a point of this circle.
    #[inline(always)]
    fn reach(&self, x: f32, y: f32, radius: f32, log_outlier: f32) -> [bool; LANES] {
        std::array::from_fn(|i| {
            let along = (self.along[0][i] * x + self.along[1][i] * y + self.along[2][i]).abs();
            let across = (self.across[0][i] * x + self.across[1][i] * y + self.across[2][i]).abs();
            let along = (along - self.half_length[i] - radius * self.metre_along[i]).max(0.0);
            let across = (across - radius * self.metre_across[i]).max(0.0);
            self.log_peak[i] - along * along - across * across > log_outlier
        })
    }
}

/// A box around the poses of a group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Its middle.
    pub middle: LocalPose,
    /// Half its size \[m, m, rad\].
    pub half: [f32; 3],
}

impl Bounds {
    /// The smallest box around these poses, wider by the slack on every side.
    pub fn around(poses: impl IntoIterator<Item = LocalPose>, slack: [f32; 2]) -> Self {
        let mut poses = poses.into_iter();
        let first = poses.next().unwrap_or_default();
        let (mut low, mut high) = ([0f32; 3], [0f32; 3]);
        for pose in poses {
            for (axis, off) in offset(pose, first).into_iter().enumerate() {
                low[axis] = low[axis].min(off);
                high[axis] = high[axis].max(off);
            }
        }
        let middle: [f32; 3] = std::array::from_fn(|axis| 0.5 * (low[axis] + high[axis]));
        let slack = [slack[0], slack[0], slack[1]];
        Self {
            middle: LocalPose { x: first.x + middle[0], y: first.y + middle[1], heading: first.heading + middle[2] },
            half: std::array::from_fn(|axis| 0.5 * (high[axis] - low[axis]) + slack[axis]),
        }
    }

    /// Whether a pose is inside.
    pub fn contain(&self, pose: LocalPose) -> bool {
        offset(pose, self.middle).into_iter().zip(self.half).all(|(off, half)| off.abs() <= half)
    }

    /// The circle around all points of a tile, seen from all these poses.
    fn circle(&self, tile: &Tile) -> (f32, f32, f32) {
        let (sin, cos) = sin_cos(self.middle.heading);
        let [cx, cy] = tile.centre;
        let reach = (cx * cx + cy * cy).sqrt();
        let shift = (self.half[0] * self.half[0] + self.half[1] * self.half[1]).sqrt();
        let radius = tile.radius + shift + reach * self.half[2] + ROUNDING;
        (self.middle.x + cos * cx - sin * cy, self.middle.y + sin * cx + cos * cy, radius)
    }
}

/// Room for the rounding of coordinates \[m\].
const ROUNDING: f32 = 1e-3;

fn offset(pose: LocalPose, from: LocalPose) -> [f32; 3] {
    [pose.x - from.x, pose.y - from.y, wrap(pose.heading - from.heading)]
}

/// For each tile the clusters that can explain a point of it, in the order of the map.
#[derive(Clone, Debug, Default)]
pub struct Candidates {
    bounds: Option<Bounds>,
    /// Where the list of each tile ends; it begins where the one before it ends.
    ends: Vec<usize>,
    clusters: Vec<ClusterParams>,
    /// Place of each in the map.
    numbers: Vec<u32>,
}

impl Candidates {
    /// Makes the lists hold for all these poses, where they do not already, and for what is within `slack` \[m, rad\]. Map
    /// and tiles are the same in every call.
    pub fn cover(&mut self, map: &LocalMap, tiles: &[Tile], poses: &[LocalPose], slack: [f32; 2]) {
        let covered = |bounds: Bounds| poses.iter().all(|&pose| bounds.contain(pose));
        if !self.bounds.is_some_and(covered) {
            let bounds = Bounds::around(poses.iter().copied(), slack);
            Arch::new().dispatch(Cull { candidates: self, map, tiles, bounds });
        }
    }

    /// Every cluster for every tile: nothing is left out, wherever the poses are.
    pub fn everything(map: &LocalMap, tiles: &[Tile]) -> Self {
        let count = map.clusters.len();
        Self {
            bounds: None,
            ends: (1..=tiles.len()).map(|tile| tile * count).collect(),
            clusters: tiles.iter().flat_map(|_| map.clusters.iter().copied()).collect(),
            numbers: tiles.iter().flat_map(|_| 0..count as u32).collect(),
        }
    }

    /// The candidates of a tile, and their places in the map.
    #[inline(always)]
    pub fn of(&self, tile: usize) -> (&[ClusterParams], &[u32]) {
        let begin = if tile == 0 { 0 } else { self.ends[tile - 1] };
        (&self.clusters[begin..self.ends[tile]], &self.numbers[begin..self.ends[tile]])
    }

    /// How many there are, over all tiles.
    pub fn len(&self) -> usize {
        self.clusters.len()
    }

    /// Whether no cluster can explain any point.
    pub fn is_empty(&self) -> bool {
        self.clusters.is_empty()
    }
}

/// The making of candidate lists, to be compiled for the instructions that the processor has.
struct Cull<'a> {
    candidates: &'a mut Candidates,
    map: &'a LocalMap,
    tiles: &'a [Tile],
    bounds: Bounds,
}

impl WithSimd for Cull<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { candidates: Candidates { bounds, ends, clusters, numbers }, map, tiles, .. } = self;
        *bounds = Some(self.bounds);
        ends.clear();
        numbers.clear();
        for tile in tiles {
            let (x, y, radius) = self.bounds.circle(tile);
            for (block, first) in map.blocks.iter().zip((0..).step_by(LANES)) {
                let near = block.reach(x, y, radius, map.log_outlier);
                // Most blocks have nothing near. In those that have, which lanes do is hard to foresee for the
                // processor, so each is written and only those that count are kept.
                if near != [false; LANES] {
                    let mut count = numbers.len();
                    numbers.resize(count + LANES, 0);
                    for (number, near) in (first..).zip(near) {
                        numbers[count] = number;
                        count += usize::from(near);
                    }
                    numbers.truncate(count);
                }
            }
            ends.push(numbers.len());
        }
        clusters.clear();
        clusters.extend(numbers.iter().map(|&number| map.clusters[number as usize]));
    }
}
