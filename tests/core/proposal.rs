//! Scan matching in a room that is known, and draws from the Laplace approximation.

use crate::{uniforms, wall};
use ipslam::ablation::Latent;
use ipslam::evaluator::cholesky::{Cholesky, unpacked};
use ipslam::evaluator::cpu::propagate_all;
use ipslam::evaluator::pose::LocalPose;
use ipslam::evaluator::table::ClusterTable;
use ipslam::evaluator::tiles::{Tile, tiles};
use ipslam::evaluator::{Mode, Propagation, Proposal, Scene, Start};
use ipslam::geometry::Pose;
use ipslam::likelihood::LikelihoodConfig;
use ipslam::map::{Map, MapCluster, Pool};
use ipslam::random::Draw;
use nalgebra::{Matrix3, Point2, Vector3};

const SEED: u64 = 61;
const ROOM: [f64; 2] = [6.0, 4.0];

fn walls() -> Vec<ipslam::ppca::Cluster> {
    let [w, h] = ROOM;
    let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]];
    (0..4).map(|i| wall(corners[i], corners[(i + 1) % 4], 0.01, 50.0)).collect()
}

/// What a laser of 181 beams over 270° sees in the room, in the robot's frame.
fn scan(world_from_robot: Pose) -> Vec<Point2<f64>> {
    let beams = (0..181).map(|i| (f64::from(i) * 1.5 - 135.0).to_radians());
    beams
        .map(|angle| {
            let beam = Pose::new(0.0, 0.0, world_from_robot.heading + angle).direction();
            let hit = |from: f64, step: f64, size: f64| if step > 0.0 { (size - from) / step } else { -from / step };
            let range = hit(world_from_robot.x, beam.x, ROOM[0]).min(hit(world_from_robot.y, beam.y, ROOM[1]));
            Point2::new(range * angle.cos(), range * angle.sin())
        })
        .collect()
}

/// Walls as thick as this are found from where these tests start.
const CAPTURE: f32 = 0.15;

/// Proposals of `count` particles that start at `start` exactly; the prior is a ball of this information around `prior`.
fn propose(
    start: Pose,
    (prior, information): (Pose, f32),
    capture_sigma: f32,
    spread: f32,
    count: usize,
    tiles: &[Tile],
) -> Vec<Proposal> {
    let mut pool = Pool::default();
    let slots = walls().into_iter().map(|cluster| pool.insert(MapCluster { cluster, last_step: 0, sightings: 1 }));
    let map = Map { slots: slots.collect() };
    let mut table = ClusterTable::new(LikelihoodConfig::default(), Latent::Uniform, CAPTURE.into());
    table.update(&mut pool, start);
    let start = Start { mean: LocalPose::new(start, table.anchor()), prior: LocalPose::new(prior, table.anchor()) };
    let how = Propagation {
        is_heavy_tailed: false,
        seed: SEED,
        step: 1,
        draw: Draw::Motion,
        starts: &[start],
        particles_per_map: count,
        exact_first: false,
        noise: Cholesky([0.0; 6]),
        prior_information: [information, 0.0, 0.0, information, 0.0, information],
        iterations: 20,
        capture_sigma,
        spread,
    };
    let proposals = propagate_all(&Scene { table: &table, tiles, maps: &[map.slots] }, &how);
    assert_eq!(proposals.len(), count);
    proposals
}

/// Where one climbs to; the prior says next to nothing.
fn climbed(start: Pose, capture_sigma: f32, tiles: &[Tile]) -> Pose {
    propose(start, (start, 1e-3), capture_sigma, 1.0, 1, tiles)[0].mode.pose.in_world(Point2::origin())
}

fn off(found: Pose, truth: Pose) -> (f64, f64) {
    let error = found.seen_from(truth);
    (error.x.hypot(error.y), error.heading.abs())
}

#[test]
fn climbs_to_where_the_scan_was_taken() {
    let truth = Pose::new(2.2, 1.7, 0.9);
    let seen = tiles(&scan(truth), usize::MAX);
    let numbers: Vec<f64> = uniforms(SEED).map(|u| 2.0 * u - 1.0).take(60).collect();
    let mut worst: (f64, f64) = (0.0, 0.0);
    for (number, u) in numbers.chunks(3).enumerate() {
        let start = truth * Pose::new(0.14 * u[0], 0.14 * u[1], 0.1 * u[2]);
        let (position, heading) = off(climbed(start, CAPTURE, &seen), truth);
        worst = (worst.0.max(position), worst.1.max(heading));
        assert!(position < 1e-3 && heading < 1e-3, "seed {SEED}, start {number}: {position} m, {heading} rad off");
    }
    println!("worst of {} starts: {:.1e} m, {:.1e} rad", numbers.len() / 3, worst.0, worst.1);

    // Walls as they are are found from nearby alone.
    let far = truth * Pose::new(0.3, 0.3, 0.0);
    let [thick, thin] = [CAPTURE, 0.0].map(|capture_sigma| off(climbed(far, capture_sigma, &seen), truth).0);
    assert!(thick < 1e-3 && thin > 0.1, "{thick} m off with thick walls, {thin} m without");

    // A scan taken elsewhere leads elsewhere.
    let elsewhere = tiles(&scan(truth * Pose::new(0.02, 0.0, 0.0)), usize::MAX);
    assert!(off(climbed(truth, CAPTURE, &elsewhere), truth).0 > 1e-2);
}

/// Where the scan says nothing, the prior decides; where both speak, the mode lies between them, as Cauchy's density has
/// it; where they differ beyond reason, the scan wins.
#[test]
fn the_prior_counts() {
    let truth = Pose::new(2.2, 1.7, 0.9);
    let seen = tiles(&scan(truth), usize::MAX);
    let found = |expected: Pose, information: f32, tiles: &[Tile]| {
        let start = Pose::new(2.21, 1.69, 0.91);
        propose(start, (expected, information), CAPTURE, 1.0, 1, tiles)[0].mode
    };
    let pose = |mode: Mode| mode.pose.in_world(Point2::origin());

    let far = Pose::new(2.25, 1.75, 0.92);
    let (position, heading) = off(pose(found(far, 1.0, &[])), far);
    assert!(position < 1e-3 && heading < 1e-3, "without a scan {position} m, {heading} rad off the prior");
    let (position, heading) = off(pose(found(far, 1e12, &seen)), truth);
    assert!(position < 1e-3 && heading < 1e-3, "a prior that cannot be true pulls by {position} m, {heading} rad");

    // By the robot's axes at the truth; the scan's own mode and information are those without a prior.
    let alone = found(truth, 1e-3, &seen);
    let scan_information = unpacked(alone.information);
    let mode_alone = pose(alone);
    let offset = |pose: Pose| {
        let off = pose.seen_from(mode_alone);
        Vector3::new(off.x, off.y, off.heading)
    };
    let expected = truth * Pose::new(2e-3, -1e-3, 1e-3);
    // The mode that a prior with this information makes, by weighted least squares until the weight settles.
    let between = |information: f64| {
        let mut mode = Vector3::zeros();
        for _ in 0..200 {
            let distance2 = information * (offset(expected) - mode).norm_squared();
            let weighted = information / (1.0 + distance2 / 5.68775);
            let sum = scan_information + Matrix3::identity() * weighted;
            mode = sum.try_inverse().unwrap() * offset(expected) * weighted;
        }
        mode
    };
    for information in [1e5f32, 1e6, 4e6] {
        let mode = offset(pose(found(expected, information, &seen)));
        let error = |information: f64| (mode - between(information)).norm();
        assert!(error(f64::from(information)) < 5e-5, "information {information}: {mode}");
        assert!(error(0.5 * f64::from(information)) > 5e-5, "half the information goes unnoticed");
    }
}

/// Covariance of a draw: spread² times the inverse information; the errors of a sample's covariance are those of a
/// Wishart matrix.
#[test]
fn draws_have_the_covariance_of_the_laplace_approximation() {
    const COUNT: u32 = 20_000;
    const SPREAD: f64 = 2.0;
    let truth = Pose::new(2.2, 1.7, 0.9);
    let proposals =
        propose(truth, (truth, 1e-3), CAPTURE, SPREAD as f32, COUNT as usize, &tiles(&scan(truth), usize::MAX));
    let mode = proposals[0].mode;
    let draws: Vec<Vector3<f64>> = proposals
        .iter()
        .map(|proposal| {
            assert_eq!(proposal.mode, mode, "from one place all climb to one top");
            let [drawn, top] = [proposal.drawn, mode.pose].map(|pose| pose.in_world(Point2::origin()));
            let step = drawn.seen_from(top);
            Vector3::new(step.x, step.y, step.heading)
        })
        .collect();
    let n = f64::from(COUNT);
    let mean = draws.iter().sum::<Vector3<f64>>() / n;
    let covariance = draws.iter().map(|d| (d - mean) * (d - mean).transpose()).sum::<Matrix3<f64>>() / n;
    // The greatest deviation in standard errors.
    let deviation = |expected: Matrix3<f64>| {
        let of = |i: usize, j: usize| {
            let variance = expected[(i, i)] * expected[(j, j)] + expected[(i, j)].powi(2);
            (covariance[(i, j)] - expected[(i, j)]).abs() / (variance / n).sqrt()
        };
        (0..9).map(|k| of(k / 3, k % 3)).fold(0.0, f64::max)
    };
    let expected = unpacked(mode.information).try_inverse().unwrap() * SPREAD.powi(2);
    assert!(deviation(expected) < 4.5, "seed {SEED}: {covariance}, not {expected}");
    assert!(deviation(expected * 1.1) > 4.5, "a spread that is 5 % off goes unnoticed");
    for axis in 0..3 {
        let error = (expected[(axis, axis)] / n).sqrt();
        assert!(mean[axis].abs() < 4.5 * error, "seed {SEED}: mean {mean}");
    }
}

/// Nothing seen, nothing expected: there is no top, and nothing is drawn.
#[test]
fn a_mode_without_information_is_kept() {
    let start = Pose::new(1.0, 2.0, 3.0);
    let Proposal { drawn, mode } = propose(start, (start, 0.0), CAPTURE, 1.0, 1, &[])[0];
    assert_eq!((drawn, mode.pose, mode.information), (LocalPose::new(start, Point2::origin()), drawn, [0.0; 6]));
}
