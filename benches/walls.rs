//! How many clusters a wall takes: noisy walls, a door in its frame, curved walls. `cargo bench --bench walls`.
//!
//! A robot drives past a wall, 3 m off, and takes 40 scans of 361 beams; its poses are known, so that nothing but clustering (III-B),
//! matching (III-D) and merging (III-E) is measured. Each case is mapped by the default thresholds of thickness and by thresholds in
//! units of the noise of the laser: 2 and 3 standard deviations, as the defaults are for a laser of 0.01 m.
#![allow(missing_docs, clippy::unwrap_used)]

use ipslam::clustering::{ClusteringConfig, cluster_scan};
use ipslam::geometry::Pose;
use ipslam::map::MapCluster;
use ipslam::map::merging::{MapChange, counts, merge_scan};
use ipslam::ppca::Cluster;
use ipslam::random::{Draw, normals};
use ipslam::scan::Scan;
use ipslam::slam::SlamConfig;
use nalgebra::{Point2, Vector2};
use std::time::Instant;

/// From the start of a beam along its direction to what it hits \[m\].
type Scene<'a> = &'a dyn Fn(Point2<f64>, Vector2<f64>) -> Option<f64>;

const SEED: u64 = 1;
const SCANS: u32 = 40;
const BEAMS: u32 = 361;
/// A beam finds nothing further off \[m\].
const RANGE: f64 = 15.0;

fn segment(a: Point2<f64>, b: Point2<f64>) -> impl Fn(Point2<f64>, Vector2<f64>) -> Option<f64> {
    move |from, direction| {
        let (way, to) = (b - a, a - from);
        let cross = direction.perp(&way);
        let (range, share) = (to.perp(&way) / cross, to.perp(&direction) / cross);
        (range > 0.0 && (0.0..=1.0).contains(&share)).then_some(range)
    }
}

/// The nearest of some segments along a beam.
fn segments(corners: &[(f64, f64)]) -> impl Fn(Point2<f64>, Vector2<f64>) -> Option<f64> + use<> {
    let point = |&(x, y): &(f64, f64)| Point2::new(x, y);
    let sides: Vec<_> = corners.windows(2).map(|ends| segment(point(&ends[0]), point(&ends[1]))).collect();
    move |from, direction| sides.iter().filter_map(|side| side(from, direction)).min_by(f64::total_cmp)
}

/// The inside of a circle, its middle at (6, 3 - radius): the wall bulges away from the robot.
fn circle(radius: f64) -> impl Fn(Point2<f64>, Vector2<f64>) -> Option<f64> {
    move |from, direction| {
        let to = Point2::new(6.0, 3.0 - radius) - from;
        let along = to.dot(&direction);
        let square = radius * radius - (to.norm_squared() - along * along);
        let range = along + square.max(0.0).sqrt();
        let hit = from + direction * range;
        (square > 0.0 && range > 0.0 && hit.y > 3.0 - 0.5 * radius && (hit.x - 6.0).abs() < 6.0).then_some(range)
    }
}

/// The map of a drive along the x axis from 0 to 12 m, and the seconds a scan that clustering took.
fn mapped(scene: Scene<'_>, noise: f64, clustering: &ClusteringConfig, max_across: f64) -> (Vec<Cluster>, f64) {
    let SlamConfig { matching, mut merging, ablation, .. } = SlamConfig::default();
    merging.max_across = max_across;
    let mut map: Vec<(u32, MapCluster)> = Vec::new();
    let (mut next, mut seconds) = (0, 0.0);
    for step in 0..SCANS {
        let world_from_robot = Pose::new(12.0 * f64::from(step) / f64::from(SCANS - 1), 0.0, 0.0);
        let beam = |beam: u32| {
            let direction = Pose::new(0.0, 0.0, f64::from(beam) * 0.5f64.to_radians()).direction();
            let error = noise * f64::from(normals(SEED, step, beam, Draw::Motion)[0]);
            let range = scene(world_from_robot.position(), direction)? + error;
            (range < RANGE).then(|| Point2::from(direction * range))
        };
        let scan = Scan { points: (0..BEAMS).filter_map(beam).collect(), ..Scan::default() };
        let began = Instant::now();
        let clusters = cluster_scan(&scan, clustering).clusters;
        seconds += began.elapsed().as_secs_f64();
        let clusters: Vec<Cluster> = clusters.iter().map(|cluster| cluster.transformed(world_from_robot)).collect();
        let MapChange { removed, added } =
            merge_scan(&map, &clusters, &counts(&clusters), step, &matching, &merging, &ablation);
        map.retain(|(slot, _)| !removed.contains(slot));
        map.extend((next..).zip(added.iter().copied()));
        next += added.len() as u32;
    }
    let walls = map.iter().filter(|(_, entry)| entry.sightings >= merging.min_sightings);
    (walls.map(|(_, entry)| entry.cluster).collect(), seconds / f64::from(SCANS))
}

/// By the default thresholds, and by those in units of the noise.
fn both(scene: Scene<'_>, noise: f64) -> [(Vec<Cluster>, f64); 2] {
    let SlamConfig { clustering, merging, .. } = SlamConfig::default();
    let sigma = noise.max(clustering.noise);
    let scaled = ClusteringConfig { max_across: 2.0 * sigma, noise: sigma, ..clustering };
    [mapped(scene, noise, &clustering, merging.max_across), mapped(scene, noise, &scaled, 3.0 * sigma)]
}

/// How many clusters lie over a place of the wall, on average over places that have one.
fn layers(map: &[Cluster]) -> f64 {
    let over =
        |place: f64| map.iter().filter(|c| (c.mean.x - place).abs() < 0.5 * c.length() * c.direction.x.abs()).count();
    let places: Vec<usize> = (0..120).map(|i| over(0.1 * f64::from(i))).filter(|&clusters| clusters > 0).collect();
    places.iter().sum::<usize>() as f64 / places.len().max(1) as f64
}

/// Root mean square distance of true points from the line of their likeliest cluster \[m\].
fn residual(map: &[Cluster], truth: &[Point2<f64>]) -> f64 {
    let off = |&point: &Point2<f64>| {
        let density = |cluster: &&Cluster| cluster.with_variance_floor(1e-4).log_density(point);
        let likeliest = map.iter().max_by(|a, b| density(a).total_cmp(&density(b))).unwrap();
        (point - likeliest.reprojected(point)).norm_squared()
    };
    (truth.iter().map(off).sum::<f64>() / truth.len() as f64).sqrt()
}

fn main() {
    println!("A straight wall of 12 m:\n");
    println!("| range noise [m] | thresholds | clusters | layers | clustering a scan [ms] |\n|---|---|---|---|---|");
    let wall = segments(&[(0.0, 3.0), (12.0, 3.0)]);
    for noise in [0.01, 0.03, 0.1] {
        for ((map, seconds), thresholds) in both(&wall, noise).into_iter().zip(["as by default", "2 and 3 sigma"]) {
            println!("| {noise} | {thresholds} | {} | {:.2} | {:.2} |", map.len(), layers(&map), 1e3 * seconds);
        }
    }
    println!("\nA door of 0.9 m in the middle of that wall; of its own: a cluster that lies within the door:\n");
    println!(
        "| recess [m] | range noise [m] | thresholds | clusters | layers | door of its own |\n|---|---|---|---|---|---|"
    );
    for recess in [0.02, 0.05, 0.1, 0.2] {
        let (left, right, back) = (5.55, 6.45, 3.0 + recess);
        let door = segments(&[(0.0, 3.0), (left, 3.0), (left, back), (right, back), (right, 3.0), (12.0, 3.0)]);
        for noise in [0.01, 0.03] {
            for ((map, _), thresholds) in both(&door, noise).into_iter().zip(["as by default", "2 and 3 sigma"]) {
                let is_door = |c: &Cluster| {
                    c.endpoints().iter().all(|end| (left - 0.1..right + 0.1).contains(&end.x))
                        && (c.mean.y - back).abs() < 0.4 * recess
                };
                let own = if map.iter().any(is_door) { "yes" } else { "no" };
                println!("| {recess} | {noise} | {thresholds} | {} | {:.2} | {own} |", map.len(), layers(&map));
            }
        }
    }
    println!("\nA curved wall, 12 m wide at most, range noise 0.01 m:\n");
    println!("| radius [m] | thickness allowed [m] | parameters | residual, rms [m] | layers |\n|---|---|---|---|---|");
    for radius in [2.0, 5.0, 20.0] {
        let wall = circle(radius);
        let half = 6.0f64.min(0.86 * radius);
        let x = |i: i32| -half + 2.0 * half * f64::from(i) / 200.0;
        let truth: Vec<Point2<f64>> =
            (0..=200).map(|i| Point2::new(6.0 + x(i), 3.0 - radius + (radius * radius - x(i) * x(i)).sqrt())).collect();
        for thickness in [0.5, 1.0, 2.0, 4.0] {
            let SlamConfig { clustering, merging, .. } = SlamConfig::default();
            let max_across = thickness * merging.max_across;
            let clustering = ClusteringConfig { max_across: thickness * clustering.max_across, ..clustering };
            let (map, _) = mapped(&wall, 0.01, &clustering, max_across);
            let (parameters, residual) = (5 * map.len(), residual(&map, &truth));
            println!("| {radius} | {max_across} | {parameters} | {residual:.3} | {:.2} |", layers(&map));
        }
    }
}
