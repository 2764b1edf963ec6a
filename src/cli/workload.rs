//! Work of any size to measure evaluators by, and what the processor could do at best.

use ipslam::ablation::Latent;
use ipslam::evaluator::cholesky::Cholesky;
use ipslam::evaluator::cpu::cull::{Candidates, LocalMap};
use ipslam::evaluator::cpu::{View, advance_all, weigh_all};
use ipslam::evaluator::grouping::by_place;
use ipslam::evaluator::pose::LocalPose;
use ipslam::evaluator::table::ClusterTable;
use ipslam::evaluator::tiles::{TILE, Tile, reach, tiles};
use ipslam::evaluator::{Advance, Evaluator, Scene, Weighed};
use ipslam::geometry::Pose;
use ipslam::gpu::DeviceError;
use ipslam::likelihood::LikelihoodConfig;
use ipslam::map::{MapCluster, Pool, Slot};
use ipslam::ppca::Cluster;
use ipslam::random::{Draw, normals};
use nalgebra::{Point2, Vector2};
use pulp::{Arch, Simd, WithSimd};
use std::hint::black_box;
use web_time::{Duration, Instant};

/// Floating-point operations of one point in one cluster, as the kernels of both backends have it: each of the two offsets
/// two multiply-adds (8), the fall-off beyond the ends a difference and a maximum (2), two squares taken off the peak (4),
/// the maximum over the clusters (1). An absolute value counts for nothing.
pub const FLOP: f64 = 15.0;

/// Walls of poses that move are at least as thick \[m\].
const CAPTURE_SIGMA: f32 = 0.15;

/// One cloud of particles in one map, and a scan.
#[derive(Debug)]
pub struct Workload {
    table: ClusterTable,
    tiles: Vec<Tile>,
    maps: [Vec<Slot>; 1],
    poses: Vec<LocalPose>,
    points: usize,
}

impl Workload {
    /// `particles` in the middle of a building of offices with open doors, `clusters` walls in all, and the scan all round
    /// that the robot takes there, of `points` beams. More clusters make a larger building.
    pub fn new(particles: usize, points: usize, clusters: usize) -> Self {
        let walls = walls(clusters);
        let mut pool = Pool::default();
        let entry = |&cluster: &Cluster| MapCluster { cluster, last_step: 0, sightings: 1 };
        let slots: Vec<Slot> = walls.iter().map(|cluster| pool.insert(entry(cluster))).collect();
        let mut table = ClusterTable::new(LikelihoodConfig::default(), Latent::Uniform, CAPTURE_SIGMA.into());
        table.update(&mut pool, Pose::IDENTITY);
        let tiles = tiles(&scan(&walls, points), usize::MAX);
        let maps = [table.near(&slots, 0.0, 0.0, reach(&tiles) + 1.0)];
        let near = |particle: u32| {
            let [x, y, heading, _] = normals(1, 0, particle, Draw::Motion);
            LocalPose { x: 0.1 * x, y: 0.1 * y, heading: 0.03 * heading }
        };
        let poses = (0..particles as u32).map(near).collect();
        Self { table, tiles, maps, poses, points }
    }

    fn scene(&self) -> Scene<'_> {
        Scene { table: &self.table, tiles: &self.tiles, maps: &self.maps }
    }

    /// Points times particles times clusters: what weighing comes to where nothing is left out.
    pub fn pairs(&self) -> f64 {
        (self.poses.len() * self.points * self.table.rows().len()) as f64
    }

    /// The same with candidates alone, of groups of this size.
    pub fn candidate_pairs(&self, group: usize) -> f64 {
        let map = self.local_map();
        let mut pairs = 0.0;
        for group in by_place(1, &self.poses, group) {
            let poses: Vec<LocalPose> = group.particles.iter().map(|&particle| self.poses[particle as usize]).collect();
            let mut candidates = Candidates::default();
            candidates.cover(&map, &self.tiles, &poses, [0.0; 2]);
            pairs += (candidates.len() * TILE * poses.len()) as f64;
        }
        pairs
    }

    fn local_map(&self) -> LocalMap {
        let rows = self.maps[0].iter().map(|&slot| self.table.rows()[slot as usize]);
        LocalMap::new(rows, self.table.log_outlier())
    }

    /// Seconds to weigh all particles once: the best of several times. The first call, which makes things ready, is not
    /// counted.
    ///
    /// # Errors
    /// The evaluator failed.
    pub fn weigh(&self, evaluator: &mut dyn Evaluator, least: Duration) -> Result<f64, DeviceError> {
        evaluator.weigh(&self.scene(), &self.poses)?;
        best_of(least, || evaluator.weigh(&self.scene(), &self.poses).map(|weighed| drop(black_box(weighed))))
    }

    /// Seconds that one thread takes to weigh all particles with every cluster at every point.
    pub fn weigh_by_brute_force(&self, least: Duration) -> f64 {
        let map = self.local_map();
        let everything = Candidates::everything(&map, &self.tiles);
        let view = View { tiles: &self.tiles, candidates: &everything, log_outlier: self.table.log_outlier() };
        let mut out = vec![0.0; self.poses.len()];
        let weigh = || -> Result<(), std::convert::Infallible> {
            view.log_likelihoods(&self.poses, black_box(&mut out));
            Ok(())
        };
        best_of(least, weigh).unwrap_or_else(|never| match never {})
    }

    /// Clusters around the robot, all of which brute force evaluates.
    pub fn clusters_near(&self) -> usize {
        self.maps[0].len()
    }

    #[cfg_attr(not(feature = "gpu"), allow(dead_code, reason = "without devices there is nothing to compare"))]
    /// How far the weights of an evaluator are from those of the CPU at most, of poses that stay and of poses that move,
    /// in nats a point.
    ///
    /// # Errors
    /// The evaluator failed.
    pub fn difference(&self, evaluator: &mut dyn Evaluator) -> Result<f64, DeviceError> {
        let how = Advance {
            seed: 1,
            step: 0,
            motion: [0.1, 0.0, 0.02],
            noise: Cholesky([0.01, 0.0, 0.01, 0.0, 0.0, 0.01]),
            capture_sigma: CAPTURE_SIGMA,
        };
        let moved = |advanced: Vec<Weighed>| advanced.into_iter().map(|weighed| weighed.log_likelihood);
        let mut weighed = evaluator.weigh(&self.scene(), &self.poses)?;
        weighed.extend(moved(evaluator.advance(&self.scene(), &how, &self.poses)?));
        let mut expected = weigh_all(&self.scene(), &self.poses);
        expected.extend(moved(advance_all(&self.scene(), &how, &self.poses)));
        // A weight that is not a number is as far off as can be.
        let apart = |(a, b): (&f32, &f32)| Some(f64::from((a - b).abs())).filter(|d| !d.is_nan());
        let differences = weighed.iter().zip(&expected).map(|pair| apart(pair).unwrap_or(f64::INFINITY));
        let worst = differences.fold(0.0, f64::max);
        Ok(if weighed.len() == expected.len() { worst / self.points as f64 } else { f64::INFINITY })
    }
}

/// The shortest of several times, for at least this long altogether.
fn best_of<E>(least: Duration, mut work: impl FnMut() -> Result<(), E>) -> Result<f64, E> {
    let (began, mut best) = (Instant::now(), f64::INFINITY);
    let mut rounds = 0;
    while rounds < 3 || began.elapsed() < least {
        let round = Instant::now();
        work()?;
        best = best.min(round.elapsed().as_secs_f64());
        rounds += 1;
    }
    Ok(best)
}

/// Offices of 4 m by 4 m on a square grid, with a door of 1 m in the corner of every wall. However many walls there are,
/// those around the middle are the same.
fn walls(count: usize) -> Vec<Cluster> {
    let columns = (count as f64 / 2.0).sqrt().ceil() as i64;
    let wall = |i: i64| {
        let (column, row) = (i / 2 % columns - columns / 2, i / 2 / columns - columns / 2);
        let direction = if i % 2 == 0 { Vector2::x() } else { Vector2::y() };
        let corner = Point2::new(4.0 * column as f64 - 2.0, 4.0 * row as f64 - 2.0);
        Cluster::wall(corner, corner + 3.0 * direction, 0.01, 100.0)
    };
    (0..count as i64).map(wall).collect()
}

/// What a laser in the middle sees of the walls within 30 m; beams that meet none end there.
fn scan(walls: &[Cluster], points: usize) -> Vec<Point2<f64>> {
    let beam = |i: usize| {
        let beam = Pose::new(0.0, 0.0, std::f64::consts::TAU * (i as f64 + 0.5) / points as f64).direction();
        let hit = |wall: &Cluster| {
            let [a, b] = wall.endpoints();
            let across = |p: Point2<f64>| beam.perp(&p.coords);
            let share = across(a) / (across(a) - across(b));
            let range = beam.dot(&(a + (b - a) * share).coords);
            ((0.0..=1.0).contains(&share) && range > 0.0).then_some(range)
        };
        Point2::from(beam * walls.iter().filter_map(hit).fold(30.0, f64::min))
    };
    (0..points).map(beam).collect()
}

/// Multiply-adds that one thread does a second at best with the instructions that the kernels use, as flop a second.
pub fn peak_flops() -> f64 {
    Arch::new().dispatch(Peak)
}

struct Peak;

impl WithSimd for Peak {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        /// As many as are under way at a time: two a cycle, four or five cycles each.
        const CHAINS: usize = 10;
        const ROUNDS: usize = 1_000_000;
        let factor = simd.splat_f32s(black_box(0.999_999_9));
        let mut best = f64::INFINITY;
        for _ in 0..20 {
            let mut sums = [simd.splat_f32s(black_box(1.0)); CHAINS];
            let began = Instant::now();
            for _ in 0..ROUNDS {
                for sum in &mut sums {
                    *sum = simd.mul_add_e_f32s(*sum, factor, factor);
                }
            }
            black_box(sums);
            best = best.min(began.elapsed().as_secs_f64());
        }
        2.0 * (S::F32_LANES * CHAINS * ROUNDS) as f64 / best
    }
}

/// The instructions that the kernels use on this processor.
pub fn instructions() -> String {
    format!("{:?}", Arch::new()).split(['(', ' ']).next().unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ipslam::evaluator::cpu::CpuEvaluator;
    use ipslam::evaluator::sighting::Sighting;
    use ipslam::evaluator::{Propagation, Proposal};

    /// The CPU, but for the first weight of poses that stay, and of poses that move.
    #[derive(Debug)]
    struct Wrong([f32; 2]);

    impl Evaluator for Wrong {
        fn propagate(&mut self, _: &Scene<'_>, _: &Propagation<'_>) -> Result<Vec<Proposal>, DeviceError> {
            Ok(Vec::new())
        }

        fn weigh(&mut self, scene: &Scene<'_>, poses: &[LocalPose]) -> Result<Vec<f32>, DeviceError> {
            let mut weighed = CpuEvaluator.weigh(scene, poses)?;
            weighed[0] += self.0[0];
            Ok(weighed)
        }

        fn advance(
            &mut self,
            scene: &Scene<'_>,
            how: &Advance,
            poses: &[LocalPose],
        ) -> Result<Vec<Weighed>, DeviceError> {
            let mut weighed = CpuEvaluator.advance(scene, how, poses)?;
            weighed[0].log_likelihood += self.0[1];
            Ok(weighed)
        }

        fn associate(&mut self, _: &Sighting<'_>, _: &[LocalPose]) -> Result<Vec<f32>, DeviceError> {
            Ok(Vec::new())
        }
    }

    #[test]
    fn a_wrong_weight_is_a_difference() {
        let workload = Workload::new(100, 180, 50);
        for (off, expected) in [([18.0, 0.0], 0.1), ([0.0, 18.0], 0.1), ([f32::NAN, 0.0], f64::INFINITY)] {
            let found = workload.difference(&mut Wrong(off)).unwrap();
            assert!(found == expected || (found - expected).abs() < 1e-5, "{off:?}: {found}, not {expected}");
        }
    }

    #[test]
    fn a_workload_is_as_large_as_asked_for() {
        let workload = Workload::new(100, 180, 50);
        assert_eq!(workload.pairs(), 100.0 * 180.0 * 50.0);
        assert_eq!(workload.difference(&mut CpuEvaluator).map_err(|e| e.to_string()), Ok(0.0));
        let pairs = workload.candidate_pairs(16);
        assert!(pairs > 0.0 && pairs < 0.5 * workload.pairs(), "{pairs} of {}", workload.pairs());
        // The robot sees walls around it, and is close to where it sees them best.
        let weighed = weigh_all(&workload.scene(), &[LocalPose::default()]);
        assert!(weighed[0] > 0.0, "{weighed:?}");
    }
}
