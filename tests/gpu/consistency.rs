//! GPU against CPU, and both against f64.

use crate::oracle::{Likelihood, slow, slow_climb, slow_density, thick};
use crate::wall::wall;
use crate::worlds::{World, all, configs, random};
use ipslam::config::SlamConfig;
use ipslam::evaluator::cholesky::{Cholesky, unpacked};
use ipslam::evaluator::cpu::CpuEvaluator;
use ipslam::evaluator::gpu::GpuEvaluator;
use ipslam::evaluator::gpu::kernels::Sharing;
use ipslam::evaluator::pose::LocalPose;
use ipslam::evaluator::table::ClusterTable;
use ipslam::evaluator::{Advance, Evaluator, Propagation, Proposal, Scene, Start};
use ipslam::geometry::{Pose, StampedPose, wrap_angle};
use ipslam::gpu::device::Adapter;
use ipslam::log::{LogEntry, LogSource};
use ipslam::map::{MapCluster, Pool};
use ipslam::metrics::trajectory::reference_errors;
use ipslam::random::{Draw, bits, uniform};
use ipslam::report::Estimator as _;
use ipslam::simulate::Simulation;
use ipslam::slam::Slam;
use nalgebra::{Matrix3, Point2, Vector3};
use std::f64::consts::{PI, TAU};

/// Mean over the points, in nats. Coordinates of up to 32 m are rounded by 2 µm, and products of them a few times; where
/// a standard deviation is 3 cm and a point lies three of them off, 5 µm change ln p by 3 · 5 µm / 3 cm = 5e-4. Few points
/// lie so, and signs differ.
pub const WEIGH: f64 = 1e-4;
/// Metres, and radians of the same size at a wall a few metres off. Poses up to 32 m from the anchor are rounded by 2 µm;
/// normal numbers of up to 5.77 come with an error of 1e-6, times a noise of decimetres.
pub const POSE: f64 = 1e-5;
/// Metres and radians after a climb. Whether it ends with a step of just below 0.5 mm or takes one more may hang on the
/// last bit; Gauss-Newton leaves a small part of a step to the next one.
pub const REFINED: f64 = 5e-5;

/// What a comparison found: the worst difference of each kind, and the first that is too large.
#[derive(Default)]
pub struct Found {
    pub worst: [f64; 3],
    pub wrong: Option<String>,
}

impl Found {
    fn compare(&mut self, kind: usize, difference: f64, tolerance: f64, what: impl FnOnce() -> String) {
        self.worst[kind] = self.worst[kind].max(difference);
        self.judge(difference, tolerance, what);
    }

    /// A difference of another kind, which is not among the worst.
    fn judge(&mut self, difference: f64, tolerance: f64, what: impl FnOnce() -> String) {
        if difference.is_nan() || difference > tolerance {
            self.wrong.get_or_insert_with(|| format!("{}: {difference:e}, and {tolerance:e} is allowed", what()));
        }
    }

    fn report(self, kinds: [&str; 3]) {
        for (kind, worst) in kinds.into_iter().zip(self.worst).filter(|(kind, _)| !kind.is_empty()) {
            println!("worst difference, {kind}: {worst:.1e}");
        }
        assert!(self.wrong.is_none(), "{}", self.wrong.unwrap_or_default());
    }
}

/// The device, with each way in which lanes come by the clusters that they all look through: devices differ in which
/// they take.
fn both_ways(adapter: &Adapter) -> Vec<GpuEvaluator> {
    let can = |sharing: &Sharing| *sharing == Sharing::Loads || adapter.can_broadcast();
    let ways = Sharing::ALL.into_iter().filter(can);
    ways.map(|sharing| GpuEvaluator::with_sources(adapter, |kernel, _| kernel.source(sharing)).unwrap()).collect()
}

fn apart(a: Pose, b: Pose) -> f64 {
    (a.x - b.x).hypot(a.y - b.y).max(wrap_angle(a.heading - b.heading).abs())
}

pub fn how<'a>(starts: &'a [Start], particles_per_map: usize, iterations: u32) -> Propagation<'a> {
    Propagation {
        seed: 0x1234_5678_9abc_def0,
        step: 17,
        draw: Draw::Motion,
        starts,
        particles_per_map,
        exact_first: false,
        is_heavy_tailed: false,
        noise: Cholesky([0.1, 0.02, 0.1, 0.01, -0.02, 0.05]),
        prior_information: [400.0, 20.0, 0.0, 400.0, -10.0, 1000.0],
        iterations,
        capture_sigma: 0.15,
        spread: 2.0,
    }
}

/// How many times as wide as a normal one the noise of a particle with heavy tails is, at most 30; in f64.
fn tail(how: &Propagation<'_>, particle: u32) -> f64 {
    let [_, _, c, d] = bits(how.seed, how.step, particle, how.draw).map(|word| f64::from(uniform(word)));
    let divisor = (-2.0 * c.ln()).sqrt() * (TAU * d).sin();
    if how.is_heavy_tailed { (1.0 / divisor.abs()).min(30.0) } else { 1.0 }
}

/// Eq. 17 in f64: Box-Muller and a matrix of noise.
fn slow_propagate(how: &Propagation<'_>, particle: u32, mean: Pose) -> Pose {
    let [a, b, c, d] = bits(how.seed, how.step, particle, how.draw).map(|word| f64::from(uniform(word)));
    let (r, s) = ((-2.0 * a.ln()).sqrt(), (-2.0 * c.ln()).sqrt());
    let normals = Vector3::new(r * (TAU * b).cos(), r * (TAU * b).sin(), s * (TAU * d).cos());
    let [l00, l10, l11, l20, l21, l22] = how.noise.0.map(f64::from);
    let noise = Matrix3::new(l00, 0.0, 0.0, l10, l11, 0.0, l20, l21, l22) * normals * tail(how, particle);
    mean * Pose::new(noise.x, noise.y, noise.z)
}

pub fn compare_propagated(evaluator: &mut dyn Evaluator) -> Found {
    let mut found = Found::default();
    for world in all() {
        let starts = [world.start()];
        let exact = Propagation { exact_first: true, ..how(&starts, world.poses.len(), 0) };
        let heavy = Propagation { is_heavy_tailed: true, ..how(&starts, world.poses.len(), 0) };
        for how in [how(&starts, world.poses.len(), 0), exact, heavy] {
            let gpu = evaluator.propagate(&world.scene(), &how).unwrap();
            let cpu = CpuEvaluator.propagate(&world.scene(), &how).unwrap();
            assert_eq!((gpu.len(), cpu.len()), (world.poses.len(), world.poses.len()));
            for (particle, (gpu, cpu)) in (0..).zip(gpu.iter().zip(&cpu)) {
                let [gpu, cpu] = [gpu, cpu].map(|proposal| proposal.drawn.in_world(world.table.anchor()));
                let mean = starts[0].mean.in_world(world.table.anchor());
                let is_mean = how.exact_first && particle == 0;
                let slow = if is_mean { mean } else { slow_propagate(&how, particle, mean) };
                // What divides by a small number enlarges its error by as much, twice.
                let allowed = POSE * tail(&how, particle).powi(2);
                let name = |of: &str| format!("{}, particle {particle}, {of}", world.name);
                found.compare(0, apart(gpu, cpu), allowed, || name("GPU and CPU"));
                found.compare(1, apart(gpu, slow), allowed, || name("GPU and f64"));
                found.compare(2, apart(cpu, slow), allowed, || name("CPU and f64"));
            }
        }
    }
    found
}

pub fn poses_are_propagated_alike(adapter: &Adapter) {
    for mut gpu in both_ways(adapter) {
        compare_propagated(&mut gpu).report(["GPU and CPU", "GPU and f64", "CPU and f64"]);
    }
}

pub fn compare_weighed(evaluator: &mut dyn Evaluator) -> Found {
    let mut found = Found::default();
    for world in all() {
        let poses = world.local_poses();
        let gpu = evaluator.weigh(&world.scene(), &poses).unwrap();
        let cpu = CpuEvaluator.weigh(&world.scene(), &poses).unwrap();
        assert_eq!((gpu.len(), cpu.len()), (poses.len(), poses.len()));
        let points = world.points.len().max(1) as f64;
        for (particle, (&gpu, &cpu)) in gpu.iter().zip(&cpu).enumerate() {
            // The pose that was evaluated is the one in f32.
            let pose = poses[particle].in_world(world.table.anchor());
            let slow = slow(&world.clusters, pose, &world.points, &world.config);
            let [gpu, cpu] = [gpu, cpu].map(f64::from);
            let name = &world.name;
            let what = |pair: &'static str| move || format!("{name}, particle {particle}, {pair}");
            found.compare(0, (gpu - cpu).abs() / points, WEIGH, what("GPU and CPU"));
            found.compare(1, (gpu - slow).abs() / points, WEIGH, what("GPU and f64"));
            found.compare(2, (cpu - slow).abs() / points, WEIGH, what("CPU and f64"));
        }
    }
    found
}

pub fn scans_are_weighed_alike(adapter: &Adapter) {
    for mut gpu in both_ways(adapter) {
        compare_weighed(&mut gpu).report(["GPU and CPU", "GPU and f64", "CPU and f64"]);
    }
}

/// A motion, and noise of centimetres.
fn onward(capture_sigma: f32) -> Advance {
    Advance {
        seed: 0x0fed_cba9_8765_4321,
        step: 23,
        motion: [0.3, -0.05, 0.2],
        noise: Cholesky([0.03, 0.005, 0.02, 0.002, -0.003, 0.02]),
        capture_sigma,
    }
}

pub fn compare_advanced(evaluator: &mut dyn Evaluator) -> Found {
    let mut found = Found::default();
    // Some walls are thicker than the second.
    for (how, world) in
        [0.12, 0.04].into_iter().flat_map(|sigma| all().into_iter().map(move |world| (onward(sigma), world)))
    {
        let poses = world.local_poses();
        let gpu = evaluator.advance(&world.scene(), &how, &poses).unwrap();
        let cpu = CpuEvaluator.advance(&world.scene(), &how, &poses).unwrap();
        assert_eq!((gpu.len(), cpu.len()), (poses.len(), poses.len()));
        let points = world.points.len().max(1) as f64;
        let walls = thick(&world.clusters, how.capture_sigma.into());
        let drawn = Propagation { seed: how.seed, step: how.step, noise: how.noise, ..self::how(&[], 0, 0) };
        for (particle, (gpu, cpu)) in (0..).zip(gpu.iter().zip(&cpu)) {
            let mean = poses[particle as usize].in_world(world.table.anchor());
            let [forward, sideways, turn] = how.motion.map(f64::from);
            let slow_pose = slow_propagate(&drawn, particle, mean * Pose::new(forward, sideways, turn));
            let what = |pair: &'static str| {
                let name = &world.name;
                move || format!("{name}, particle {particle}, {pair}")
            };
            for (weighed, pair) in [(gpu, "GPU and f64"), (cpu, "CPU and f64")] {
                let pose = weighed.pose.in_world(world.table.anchor());
                // Some worlds put particles far from the anchor: each of the two motions rounds what it adds to.
                let far = f64::from(weighed.pose.x.abs().max(weighed.pose.y.abs()));
                let rounding = 2.0 * far * f64::from(f32::EPSILON);
                found.compare(0, apart(pose, slow_pose), POSE + rounding, what(pair));
                let slow = slow(&walls, pose, &world.points, &world.config);
                let off = (f64::from(weighed.log_likelihood) - slow).abs() / points;
                found.compare(1, off, WEIGH, what(pair));
            }
            let off = f64::from(gpu.log_likelihood - cpu.log_likelihood).abs() / points;
            found.compare(2, off, WEIGH, what("GPU and CPU"));
        }
    }
    found
}

pub fn poses_advance_alike(adapter: &Adapter) {
    for mut gpu in both_ways(adapter) {
        compare_advanced(&mut gpu).report(["poses, to f64", "log-likelihoods, to f64", "log-likelihoods"]);
    }
}

/// Worlds in which a climb has one way to go: the robot is off by centimetres, and its walls by metres.
fn rooms() -> Vec<World> {
    let room = |pose: Pose, count: usize, walls: usize| {
        let at = |x: f64, y: f64| [pose.x + x, pose.y + y];
        let corners = [at(-3.0, -2.0), at(3.0, -2.0), at(3.5, 2.0), at(-3.0, 2.5)];
        let clusters: Vec<_> = (0..walls).map(|i| wall(corners[i], corners[(i + 1) % 4], 0.02, 50.0)).collect();
        let on = |cluster: &ipslam::ppca::Cluster| {
            let cluster = *cluster;
            (-20..=20).map(move |i| cluster.mean + cluster.direction * (0.02 * f64::from(i) * cluster.length()))
        };
        let points = clusters.iter().flat_map(on).map(|point| pose.inverse() * point).collect();
        World::new(
            &format!("{walls} walls, {count} particles at {pose:?}"),
            configs()[0],
            clusters,
            points,
            pose,
            count,
        )
    };
    vec![
        room(Pose::new(0.0, 0.0, 0.3), 1, 4),
        room(Pose::new(5.0, -3.0, 1.5), 3, 4),
        room(Pose::new(5.0, -3.0, PI - 1e-4), 97, 4),
        room(Pose::new(8_000.0, 900.0, 1e-4 - PI), 64, 4),
        // Along the one wall the prior alone decides.
        room(Pose::new(5.0, -3.0, 1.5), 20, 1),
    ]
}

pub fn compare_refined(evaluator: &mut dyn Evaluator) -> Found {
    let mut found = Found::default();
    // From afar thick walls alone lead to the truth: nothing but the prior does, and it is where the start is.
    let near = rooms().into_iter().map(|world| (world.pose, [400.0, 20.0, 0.0, 400.0, -10.0, 1000.0], world));
    let far = rooms().into_iter().filter(|world| world.clusters.len() > 1);
    let far = far.map(|world| (world.pose * Pose::new(0.2, -0.2, 0.0), [1.0, 0.0, 0.0, 1.0, 0.0, 1.0], world));
    let near_and_far = near.chain(far).map(|(start, information, world)| (start, start, information, world));
    // Odometry that is off by many of its own sigmas: the climb starts where the scan fits.
    let doubted = rooms().into_iter().filter(|world| world.clusters.len() > 1);
    let doubted = doubted
        .map(|world| (world.pose, world.pose * Pose::new(0.2, -0.2, 0.1), [4e3, 0.0, 0.0, 4e3, 0.0, 4e3], world));
    for (start, prior, prior_information, world) in near_and_far.chain(doubted) {
        let starts = [Start { mean: world.local(start), prior: world.local(prior) }];
        let how = Propagation { prior_information, ..how(&starts, world.poses.len(), 12) };
        let gpu = evaluator.propagate(&world.scene(), &how).unwrap();
        let cpu = CpuEvaluator.propagate(&world.scene(), &how).unwrap();
        for (particle, (gpu, cpu)) in gpu.iter().zip(&cpu).enumerate() {
            let name = &world.name;
            let what = |pair: &'static str| move || format!("{name}, particle {particle}, {pair}");
            let [gpu_pose, cpu_pose] = [gpu, cpu].map(|proposal| proposal.mode.pose.in_world(world.table.anchor()));
            found.compare(0, apart(gpu_pose, cpu_pose), REFINED, what("GPU and CPU"));
            let sampled = slow_propagate(&how, particle as u32, starts[0].mean.in_world(world.table.anchor()));
            let prior = (prior, unpacked(prior_information));
            let config = Likelihood { capture_sigma: how.capture_sigma.into(), ..world.config };
            let slow_pose = slow_climb(&world.clusters, sampled, prior, &world.points, &config, 12);
            found.compare(1, apart(gpu_pose, slow_pose), REFINED, what("GPU and f64"));
            found.compare(2, apart(cpu_pose, slow_pose), REFINED, what("CPU and f64"));

            // The quadratic model and the log-likelihood are those of the place.
            let log_likelihood = slow(&world.clusters, gpu_pose, &world.points, &world.config);
            let error = (f64::from(gpu.mode.log_likelihood) - log_likelihood).abs() / world.points.len() as f64;
            found.judge(error, WEIGH, what("log-likelihood, GPU and f64"));
            let relative = |a: [f32; 6], b: [f32; 6]| {
                let [a, b] = [a, b].map(unpacked);
                (a - b).norm() / b.norm()
            };
            found.judge(relative(gpu.mode.information, cpu.mode.information), 1e-2, what("information"));
        }
    }
    found
}

/// In worlds where every climb has one top, the tops are the same; in worlds of clutter, where a bit may decide between
/// two, nearly all of them.
pub fn poses_are_refined_alike(adapter: &Adapter) {
    for mut gpu in both_ways(adapter) {
        compare_refined(&mut gpu).report(["GPU and CPU", "GPU and f64", "CPU and f64"]);
    }
    let mut gpu = GpuEvaluator::new(adapter).unwrap();
    let (mut same, mut all_climbs) = (0, 0);
    for world in all() {
        let starts = [world.start()];
        let how = how(&starts, world.poses.len(), 6);
        let proposals = [&mut gpu as &mut dyn Evaluator, &mut CpuEvaluator]
            .map(|evaluator| evaluator.propagate(&world.scene(), &how).unwrap());
        for (gpu, cpu) in proposals[0].iter().zip(&proposals[1]) {
            let [a, b] = [gpu, cpu].map(|proposal| proposal.mode.pose.in_world(world.table.anchor()));
            same += usize::from(apart(a, b) < REFINED);
            all_climbs += 1;
        }
    }
    println!("in clutter {same} of {all_climbs} climbs end at the same place");
    assert!(same as f64 > 0.95 * all_climbs as f64, "{same} of {all_climbs}");
}

/// From the same mode the draw is the same; its width is tested on the CPU, against the covariance.
pub fn compare_draws(evaluator: &mut dyn Evaluator) -> Found {
    let mut found = Found::default();
    for world in rooms() {
        let starts = [world.start()];
        let how = how(&starts, world.poses.len(), 12);
        let gpu = evaluator.propagate(&world.scene(), &how).unwrap();
        for (particle, proposal) in (0..).zip(&gpu) {
            let cholesky = Cholesky::new(proposal.mode.information).unwrap();
            let normals = ipslam::random::normals(how.seed, how.step, particle, Draw::Proposal);
            let step = cholesky.solve_transposed([normals[0], normals[1], normals[2]].map(|z| z * how.spread));
            let [drawn, expected] = [proposal.drawn, proposal.mode.pose.moved(step)];
            let [drawn, expected] = [drawn, expected].map(|pose| pose.in_world(world.table.anchor()));
            found.compare(0, apart(drawn, expected), POSE, || format!("{}, particle {particle}", world.name));
        }
    }
    found
}

pub fn draws_are_alike(adapter: &Adapter) {
    for mut gpu in both_ways(adapter) {
        compare_draws(&mut gpu).report(["GPU and CPU", "", ""]);
    }
}

/// No list misses a cluster that is likelier than an outlier for some point from some pose, and none is much longer than
/// that of the CPU.
pub fn compare_lists(evaluator: &mut GpuEvaluator) -> Found {
    use ipslam::evaluator::cpu::cull::{Candidates, LocalMap};
    let mut found = Found::default();
    let (mut overflown, mut listed_by_gpu, mut listed_by_cpu) = (0, 0, 0);
    for world in all() {
        let poses: Vec<LocalPose> = world.local_poses().into_iter().take(64).collect();
        let lists = evaluator.candidate_lists(&world.scene(), &poses).unwrap();
        assert_eq!(lists.len(), world.tiles.len());
        let map = LocalMap::new(world.table.rows().iter().copied(), world.table.log_outlier());
        let mut candidates = Candidates::default();
        candidates.cover(&map, &world.tiles, &poses, [0.0; 2]);
        for (tile, list) in lists.iter().enumerate() {
            let Some(list) = list else {
                overflown += 1;
                continue;
            };
            listed_by_gpu += list.len();
            listed_by_cpu += candidates.of(tile).1.len();
            let points: Vec<Point2<f64>> = world.points.iter().copied().skip(16 * tile).take(16).collect();
            for (slot, cluster) in (0..).zip(&world.clusters) {
                let floor = world.config.outlier_density.ln() + WEIGH;
                let sees = |pose: &LocalPose| {
                    let pose = pose.in_world(world.table.anchor());
                    points.iter().any(|&point| slow_density(cluster, pose * point, &world.config) > floor)
                };
                let is_missed = !list.contains(&slot) && poses.iter().any(sees);
                found.compare(0, f64::from(u8::from(is_missed)), 0.0, || {
                    format!("{}, tile {tile}, cluster {slot} is missing", world.name)
                });
            }
        }
    }
    println!("{listed_by_gpu} candidates on the GPU, {listed_by_cpu} on the CPU; {overflown} lists were too long");
    assert!(overflown > 0, "no list was too long: nothing tested");
    let ratio = listed_by_gpu as f64 / f64::from(listed_by_cpu as u32);
    found.compare(1, (ratio - 1.0).abs(), 0.01, || "the lists are not of one length".to_owned());
    found
}

pub fn candidate_lists_leave_nothing_out(adapter: &Adapter) {
    for mut gpu in both_ways(adapter) {
        compare_lists(&mut gpu).report(["", "length of lists", ""]);
    }
}

/// More groups than a dispatch can have workgroups.
pub fn work_is_split_to_fit(adapter: &Adapter) {
    let mut gpu = GpuEvaluator::new(adapter).unwrap();
    let world = random(21, configs()[0], Pose::new(1.0, 2.0, 0.5), 12, 1);
    let tiles = &world.tiles[..2];
    let maps = vec![world.maps[0].clone(); 66_000];
    let scene = Scene { table: &world.table, tiles, maps: &maps };
    let poses: Vec<LocalPose> =
        (0..maps.len()).map(|i| world.local(world.pose * Pose::new(1e-6 * i as f64, 0.0, 0.0))).collect();
    let weighed = gpu.weigh(&scene, &poses).unwrap();
    let expected = CpuEvaluator.weigh(&scene, &poses).unwrap();
    assert_eq!(weighed.len(), maps.len());
    for (number, (a, b)) in weighed.iter().zip(&expected).enumerate() {
        assert!(f64::from((a - b).abs()) < 32.0 * WEIGH, "particle {number}: {a}, not {b}");
    }
    assert!(weighed[0] != weighed[65_999], "all particles weigh the same: nothing tested");
    let starts = vec![world.start(); maps.len()];
    let drawn = gpu.propagate(&scene, &how(&starts, 1, 0)).unwrap();
    let expected = CpuEvaluator.propagate(&scene, &how(&starts, 1, 0)).unwrap();
    let worst = drawn.iter().zip(&expected).map(|(a, b)| f64::from((a.drawn.x - b.drawn.x).abs())).fold(0.0, f64::max);
    assert!(drawn.len() == maps.len() && worst < POSE, "{} poses, {worst} m", drawn.len());
}

/// Clusters that come, go and change between steps, few and many, and an anchor that moves.
pub fn a_step_uploads_what_changed(adapter: &Adapter) {
    let mut gpu = GpuEvaluator::new(adapter).unwrap();
    let world = random(22, configs()[0], Pose::new(1.0, 2.0, 0.5), 60, 5);
    let (mut pool, mut table) =
        (Pool::default(), ClusterTable::new(world.config.config, world.config.latent, world.config.capture_sigma));
    let mut slots = Vec::new();
    for step in 0..40u32 {
        // Some go, others take their slots; the robot drives away and comes back.
        slots = slots.split_off(slots.len().min(if step % 7 == 6 { 30 } else { 3 }));
        pool.keep_only([&ipslam::map::Map { slots: slots.clone() }]);
        let new = world.clusters.iter().cycle().skip(step as usize * 7).take(if step % 11 == 10 { 50 } else { 5 });
        slots.extend(new.map(|&cluster| pool.insert(MapCluster { cluster, last_step: step, sightings: 1 })));
        let robot = if step % 13 == 12 { Pose::new(30.0, 0.0, 0.0) * world.pose } else { world.pose };
        table.update(&mut pool, robot);
        let maps = [slots.clone()];
        let scene = Scene { table: &table, tiles: &world.tiles, maps: &maps };
        let poses: Vec<LocalPose> = world.poses.iter().map(|&pose| LocalPose::new(pose, table.anchor())).collect();
        // Every now and then the device misses an update.
        if step % 5 == 4 {
            continue;
        }
        let weighed = gpu.weigh(&scene, &poses).unwrap();
        for (a, b) in weighed.iter().zip(CpuEvaluator.weigh(&scene, &poses).unwrap()) {
            let error = f64::from((a - b).abs()) / world.points.len() as f64;
            assert!(error < WEIGH, "step {step}: {a}, not {b}");
        }
    }
}

/// Maps of one table that differ, each with particles of its own: every group has to find its own clusters and start.
pub fn every_particle_has_its_own_map(adapter: &Adapter) {
    const PARTICLES: usize = 70;
    let world = random(23, configs()[0], Pose::new(1.0, 2.0, 0.5), 60, 1);
    let maps: Vec<Vec<u32>> = vec![(0..20).collect(), (10..60).rev().collect(), vec![], (0..60).step_by(3).collect()];
    let scene = Scene { table: &world.table, tiles: &world.tiles, maps: &maps };
    let pose = |map: usize| world.pose * Pose::new(0.05 * map as f64, -0.03 * map as f64, 0.01 * map as f64);
    let starts: Vec<Start> =
        (0..maps.len()).map(|map| Start { mean: world.local(pose(map)), prior: world.local(world.pose) }).collect();
    let poses: Vec<LocalPose> = (0..maps.len() * PARTICLES)
        .map(|i| world.local(pose(i / PARTICLES) * Pose::new(1e-3 * i as f64, 0.0, 0.0)))
        .collect();
    for mut gpu in both_ways(adapter) {
        let weighed = gpu.weigh(&scene, &poses).unwrap();
        let expected = CpuEvaluator.weigh(&scene, &poses).unwrap();
        let error = |(a, b): (&f32, &f32)| f64::from((a - b).abs()) / world.points.len() as f64;
        let worst = weighed.iter().zip(&expected).map(error).fold(0.0, f64::max);
        assert!(worst < WEIGH, "{worst} nats a point");
        assert!(expected[0] != expected[3 * PARTICLES], "all maps are the same: nothing tested");

        let how = Propagation { exact_first: true, ..how(&starts, PARTICLES, 6) };
        let proposals = gpu.propagate(&scene, &how).unwrap();
        let expected = CpuEvaluator.propagate(&scene, &how).unwrap();
        let in_world = |proposal: &Proposal| proposal.mode.pose.in_world(world.table.anchor());
        let same = proposals.iter().zip(&expected).filter(|(a, b)| apart(in_world(a), in_world(b)) < REFINED).count();
        println!("{same} of {} climbs end at the same place", proposals.len());
        assert_eq!((proposals.len(), expected.len()), (poses.len(), poses.len()));
        assert!(same as f64 > 0.95 * poses.len() as f64, "{same} of {}", poses.len());
    }
}

/// A short drive through the simulated building, mapped on the device: as good as on the CPU.
pub fn a_drive_is_mapped_as_well(adapter: &Adapter) {
    let config = SlamConfig { particles: 8, maps: 8, ..SlamConfig::default() };
    let error = |mut slam: Slam| {
        let mut truth = Vec::new();
        for entry in Simulation::building(1).open().unwrap().take(600) {
            let entry = entry.unwrap();
            if let LogEntry::Truth { stamp, world_from_robot } = entry {
                truth.push(StampedPose { stamp, pose: world_from_robot });
            }
            slam.add(&entry, &mut |_| ());
        }
        assert!(slam.evaluator_failure().is_none());
        reference_errors(&truth, &slam.result().trajectory()).absolute.unwrap().mean
    };
    let on_device = error(Slam::with_evaluator(config, Box::new(GpuEvaluator::new(adapter).unwrap())));
    let on_cpu = error(Slam::new(config));
    println!("mean error on the device {on_device:.3} m, on the CPU {on_cpu:.3} m");
    // Millimetres are a matter of which particles survive.
    assert!(on_device < on_cpu + 0.02 && on_cpu < 0.1, "{on_device} m, on the CPU {on_cpu} m");
}
