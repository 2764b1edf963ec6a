//! Objects in space, seen by two cameras: the semantic term of the graph on real measurements.

use crate::needs::data_folder;
use ipslam::factor_graph::{Between3, Graph, Loss, Noise, Prior, Projection, Solver, SolverConfig, Values, VariableId};
use ipslam::geometry::{Pinhole, Pose3, StampedPose3};
use ipslam::metrics::space::space_errors;
use nalgebra::{Matrix3, Point2, Point3, Rotation3, UnitQuaternion, Vector3, Vector6};
use std::collections::{BTreeMap, HashMap};

/// Starry Night, between these rows: where the camera sees something most of the time.
const FIRST: usize = 1214;
const LAST: usize = 1714;

/// A file of the set.
fn text(name: &str) -> String {
    std::fs::read_to_string(data_folder().join("semantic/starry_night").join(name)).unwrap()
}

/// The numbers of a table, without its header.
fn table(name: &str) -> Vec<Vec<f64>> {
    let row = |line: &str| line.split(',').map(|number| number.parse().unwrap()).collect();
    text(name).lines().skip(1).map(row).collect()
}

/// The name of an object, and where each camera sees it.
type Sighting = (u64, [Point2<f64>; 2]);

/// Two cameras on a rig, and the variances of all measurements.
struct Rig {
    camera: Pinhole,
    cameras: [Pose3; 2],
    baseline: f64,
    pixel_sigmas: [[f64; 2]; 2],
    speed_sigmas: Vec<f64>,
}

impl Rig {
    fn read() -> Self {
        let text = text("calibration.txt");
        let of: HashMap<&str, Vec<f64>> = text
            .lines()
            .map(|line| line.split_once(' ').unwrap())
            .map(|(name, rest)| (name, rest.split_whitespace().map(|number| number.parse().unwrap()).collect()))
            .collect();
        let camera_from_rig = Matrix3::from_row_slice(&of["C_c_v"]);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&camera_from_rig.transpose()));
        let left = Pose3::new(Point3::from_slice(&of["rho_v_c_v"]), rotation);
        let baseline = of["b"][0];
        let right = left * Pose3::new(Point3::new(baseline, 0.0, 0.0), UnitQuaternion::identity());
        let pixel: Vec<f64> = of["y_var"].iter().map(|variance| variance.sqrt()).collect();
        Self {
            camera: Pinhole { focal: [of["fu"][0], of["fv"][0]], centre: [of["cu"][0], of["cv"][0]] },
            cameras: [left, right],
            baseline,
            pixel_sigmas: [[pixel[0], pixel[1]], [pixel[2], pixel[3]]],
            speed_sigmas: of["v_var"].iter().chain(&of["w_var"]).map(|variance| variance.sqrt()).collect(),
        }
    }

    /// Where an object is that both cameras see.
    fn place(&self, world_from_rig: Pose3, [left, right]: [Point2<f64>; 2]) -> Point3<f64> {
        let depth = self.camera.focal[0] * self.baseline / (left.x - right.x).max(1.0);
        world_from_rig * (self.cameras[0] * (self.camera.ray(left) * depth))
    }
}

/// Which object is seen is known here. The published course's own numbers give GTSAM 0.034 m.
fn objects_of_known_names_are_mapped() {
    let (rig, speeds, truth) = (Rig::read(), table("odometry.csv"), table("truth.csv"));
    let true_pose = |row: usize| {
        let [_, _, rest @ ..] = &truth[row][..] else { panic!("row {row} of truth.csv is short") };
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::from_column_slice(&rest[..3]));
        Pose3::new(Point3::from_slice(&rest[3..6]), rotation)
    };
    let mut seen: BTreeMap<usize, Vec<Sighting>> = BTreeMap::new();
    for row in table("stereo.csv") {
        let pixels = [Point2::new(row[2], row[3]), Point2::new(row[4], row[5])];
        seen.entry(row[0] as usize).or_default().push((row[1] as u64, pixels));
    }

    let (mut graph, mut values) = (Graph::new(), Values::new());
    let mut solver = Solver::new(SolverConfig { iterations: 10, relative_tolerance: 1e-4, absolute_tolerance: 1e-2 });
    let (mut poses, mut reckoned) = (Vec::<VariableId>::new(), vec![true_pose(FIRST)]);
    let mut objects: HashMap<u64, VariableId> = HashMap::new();
    let mut sightings = 0;
    for row in FIRST..=LAST {
        let pose = match poses.last() {
            None => {
                let pose = values.add_pose3(true_pose(row));
                graph.add(Prior::pose3(pose, true_pose(row)), Noise::sigmas(&[1e-4; 6]).unwrap()).unwrap();
                pose
            }
            Some(&last) => {
                let seconds = speeds[row][1] - speeds[row - 1][1];
                let motion = Pose3::exp(Vector6::from_column_slice(&speeds[row - 1][2..8]) * seconds);
                reckoned.push(*reckoned.last().unwrap() * motion);
                let pose = values.add_pose3(values.pose3(last).unwrap() * motion);
                let sigmas: Vec<f64> = rig.speed_sigmas.iter().map(|sigma| sigma * seconds).collect();
                graph.add(Between3::new(last, pose, motion), Noise::sigmas(&sigmas).unwrap()).unwrap();
                pose
            }
        };
        poses.push(pose);
        for (name, pixels) in seen.get(&row).into_iter().flatten() {
            let place = rig.place(values.pose3(pose).unwrap(), *pixels);
            let object = *objects.entry(*name).or_insert_with(|| values.add_point3(place));
            for ((pixel, camera), sigmas) in pixels.iter().zip(rig.cameras).zip(rig.pixel_sigmas) {
                let projection = Projection::new(pose, object, *pixel, rig.camera, camera);
                let term = graph.add(projection, Noise::sigmas(&sigmas).unwrap()).unwrap();
                graph.set_loss(term, Loss::Cauchy(3.0)).unwrap();
                sightings += 1;
            }
        }
        if row.is_multiple_of(50) {
            solver.solve(&graph, &mut values).unwrap();
        }
    }
    let solution = Solver::default().solve(&graph, &mut values).unwrap();
    assert!(solution.converged && sightings > 3000, "{solution:?}, {sightings} sightings");

    let stamped = |pose: &dyn Fn(usize) -> Pose3| -> Vec<StampedPose3> {
        (0..poses.len()).map(|place| StampedPose3 { stamp: place as f64, pose: pose(place) }).collect()
    };
    let truth = stamped(&|place| true_pose(FIRST + place));
    let error = |found: &[StampedPose3]| space_errors(&truth, found).unwrap().position.rmse;
    let alone = error(&stamped(&|place| reckoned[place]));
    let mapped = error(&stamped(&|place| values.pose3(poses[place]).unwrap()));
    println!("odometry alone {alone:.3} m, with {} objects {mapped:.4} m", objects.len());
    assert!(alone > 0.5 && mapped < 0.034, "{alone} m, {mapped} m");
}

crate::needs::trials! {
    "space":
    Data { objects_of_known_names_are_mapped }
}
