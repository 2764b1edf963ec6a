//! Maps, scans and poses to evaluate: random ones, real ones, and hard ones.

use crate::needs::data_folder;
use crate::oracle::Likelihood;
use crate::wall::wall;
use ipslam::ablation::Latent;
use ipslam::clustering::{ClusteringConfig, cluster_scan};
use ipslam::evaluator::pose::LocalPose;
use ipslam::evaluator::table::ClusterTable;
use ipslam::evaluator::tiles::{Tile, tiles};
use ipslam::evaluator::{Scene, Start};
use ipslam::geometry::Pose;
use ipslam::io::carmen::CarmenLog;
use ipslam::likelihood::LikelihoodConfig;
use ipslam::log::{LogEntry, LogSource};
use ipslam::map::{MapCluster, Pool, Slot};
use ipslam::ppca::Cluster;
use ipslam::random::{Draw, bits, normals, uniform};
use ipslam::scan::{Scan, ScanConfig};
use nalgebra::{Point2, Vector2};
use std::f64::consts::PI;

/// A map, a scan, and the robot somewhere around `pose`.
pub struct World {
    pub name: String,
    pub config: Likelihood,
    pub clusters: Vec<Cluster>,
    pub points: Vec<Point2<f64>>,
    pub pose: Pose,
    /// Poses of the robot to evaluate.
    pub poses: Vec<Pose>,
    pub tiles: Vec<Tile>,
    pub table: ClusterTable,
    pub maps: Vec<Vec<Slot>>,
}

impl World {
    pub fn new(
        name: &str,
        config: Likelihood,
        clusters: Vec<Cluster>,
        points: Vec<Point2<f64>>,
        pose: Pose,
        count: usize,
    ) -> Self {
        let mut pool = Pool::default();
        let entry = |&cluster: &Cluster| MapCluster { cluster, last_step: 0, sightings: 1 };
        let slots: Vec<Slot> = clusters.iter().map(|cluster| pool.insert(entry(cluster))).collect();
        let mut table = ClusterTable::new(config.config, config.latent, config.capture_sigma);
        table.update(&mut pool, pose);
        let near = |i: u32| {
            let [x, y, heading, _] = normals(5, 0, i, Draw::Motion).map(f64::from);
            pose * Pose::new(0.05 * x, 0.05 * y, 0.02 * heading)
        };
        let poses = (0..count as u32).map(near).collect();
        let tiles = tiles(&points, usize::MAX);
        Self { name: name.to_owned(), config, clusters, points, pose, poses, tiles, table, maps: vec![slots] }
    }

    pub fn scene(&self) -> Scene<'_> {
        Scene { table: &self.table, tiles: &self.tiles, maps: &self.maps }
    }

    pub fn local(&self, pose: Pose) -> LocalPose {
        LocalPose::new(pose, self.table.anchor())
    }

    pub fn local_poses(&self) -> Vec<LocalPose> {
        self.poses.iter().map(|&pose| self.local(pose)).collect()
    }

    pub fn start(&self) -> Start {
        Start { mean: self.local(self.pose), prior: self.local(self.pose) }
    }
}

/// The latents and floors that the presets have.
pub fn configs() -> [Likelihood; 2] {
    let config = LikelihoodConfig { sigma_floor: 0.05, outlier_density: 1e-8, ..LikelihoodConfig::default() };
    [Likelihood::default(), Likelihood { config, latent: Latent::Normal, ..Likelihood::default() }]
}

/// Walls in all directions around `pose`, and points on and off them, by angle.
pub fn random(seed: u64, config: Likelihood, pose: Pose, walls: usize, count: usize) -> World {
    let mut uniforms = (0..).flat_map(|i| bits(seed, 1, i, Draw::Motion)).map(|word| f64::from(uniform(word)));
    let mut between = |low: f64, high: f64| low + (high - low) * uniforms.next().unwrap();
    let clusters: Vec<Cluster> = (0..walls)
        .map(|_| {
            let a = [pose.x + between(-10.0, 10.0), pose.y + between(-10.0, 10.0)];
            let (angle, length) = (between(-PI, PI), between(0.2, 6.0));
            wall(a, [a[0] + length * angle.cos(), a[1] + length * angle.sin()], between(0.0, 0.05), 50.0)
        })
        .collect();
    let mut points: Vec<Point2<f64>> = (0..181)
        .map(|i| {
            let cluster = &clusters[i % walls];
            let scatter = if i % 10 == 0 { 1.0 } else { 0.03 };
            let along = cluster.direction * (0.55 * cluster.length() * between(-1.0, 1.0));
            let off = Vector2::new(between(-1.7, 1.7), between(-1.7, 1.7)) * scatter;
            pose.inverse() * (cluster.mean + along + off)
        })
        .collect();
    points.sort_by(|a, b| a.y.atan2(a.x).total_cmp(&b.y.atan2(b.x)));
    let name = format!("seed {seed}, {:?}, {count} particles at {pose:?}", config.latent);
    World::new(&name, config, clusters, points, pose, count)
}

/// Every kind of input.
pub fn all() -> Vec<World> {
    let [uniform, normal] = configs();
    let pose = Pose::new(3.2, -1.7, 0.8);
    let mut worlds: Vec<World> = (0..4).flat_map(|seed| configs().map(|c| random(seed, c, pose, 40, 70))).collect();
    // Numbers of particles: one, few, a prime, a full group and one more.
    worlds.extend([1, 2, 13, 33, 64, 65, 97].map(|count| random(7, uniform, pose, 30, count)));
    // Headings that wrap within a group.
    worlds.push(random(8, uniform, Pose::new(0.0, 0.0, PI - 1e-4), 40, 70));
    worlds.push(random(9, uniform, Pose::new(1.0, 2.0, -PI + 1e-3), 40, 20));
    // Kilometres from the origin.
    worlds.push(random(10, uniform, Pose::new(10_000.0, -7_000.0, 2.0), 40, 70));
    worlds.push(random(11, normal, Pose::new(-10_000.3, 9_000.7, -1.0), 40, 20));
    let World { clusters, points, .. } = random(12, uniform, pose, 30, 1);
    worlds.push(World::new("no points", uniform, clusters.clone(), vec![], pose, 70));
    worlds.push(World::new("no clusters", uniform, vec![], points.clone(), pose, 70));
    worlds.push(World::new("neither", uniform, vec![], vec![], pose, 3));
    let degenerate = |scale: f64| {
        let flat = |c: &Cluster| Cluster { along_variance: scale * c.along_variance, across_variance: 0.0, ..*c };
        clusters.iter().map(flat).collect()
    };
    worlds.push(World::new("no thickness", normal, degenerate(1.0), points.clone(), pose, 70));
    worlds.push(World::new("points for clusters", uniform, degenerate(0.0), points.clone(), pose, 70));
    // The same clusters twice, and walls that are as far from a point on either side.
    let twice = clusters.iter().chain(&clusters).copied().collect();
    worlds.push(World::new("every cluster twice", uniform, twice, points.clone(), pose, 70));
    let parallel =
        vec![wall([-4.0, 0.96875], [4.0, 0.96875], 0.03, 50.0), wall([-4.0, 1.03125], [4.0, 1.03125], 0.03, 50.0)];
    let between: Vec<_> = (-16..=16).map(|i| Point2::new(f64::from(i) * 0.125, 1.0)).collect();
    let mut tie = World::new("points on a tie", uniform, parallel, between, Pose::IDENTITY, 3);
    tie.poses = vec![Pose::IDENTITY, Pose::new(0.5, 0.0, 0.0), Pose::new(-0.25, 0.0, 0.0)];
    worlds.push(tie);
    let mut lost = World::new("particles that see nothing", uniform, clusters, points, pose, 70);
    lost.poses = lost.poses.iter().map(|&pose| Pose::new(0.0, 90.0, 0.0) * pose).collect();
    worlds.push(lost);
    // More clusters at one place than a list holds.
    worlds.push(random(13, uniform, pose, 900, 70));
    worlds.extend(real());
    worlds
}

/// Real scans: a map of one of them, seen by the next one.
fn real() -> Vec<World> {
    let path = data_folder().join("csail/mit-csail.clf.gz");
    if !path.is_file() {
        return Vec::new();
    }
    let scans = CarmenLog::new(path).open().unwrap().filter_map(|entry| match entry.unwrap() {
        LogEntry::Laser(reading) => Some(Scan::from_reading(&reading, &ScanConfig::default())),
        _ => None,
    });
    let pose = Pose::new(-4.0, 12.0, 2.5);
    let scans: Vec<Scan> = scans.take(1500).step_by(250).collect();
    let world = |(number, scan): (usize, &Scan)| {
        let clusters = cluster_scan(scan, &ClusteringConfig::default()).clusters;
        let clusters = clusters.iter().map(|cluster| cluster.transformed(pose)).collect();
        World::new(&format!("real scan {number}"), configs()[0], clusters, scan.points.clone(), pose, 70)
    };
    let worlds: Vec<World> = scans.iter().enumerate().map(world).collect();
    assert_eq!(worlds.len(), 6);
    worlds
}
