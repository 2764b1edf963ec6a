//! Factor graphs of space against a program that is known to be right, central differences, and each other.

use crate::factor_graph::{Bent, distance, jacobian_error, patient, sigmas};
use ipslam::factor_graph::{
    Covariances, Factor, Graph, GraphError, Inertial, Jacobian, Kind, Loss, Odometry3, Prior, Stereo, StereoCamera,
    Track, Values, VariableId, Walk,
};
use ipslam::geometry::{Pinhole, Pose3};
use ipslam::inertial::{ImuBias, ImuNoise, ImuReading, Preintegration};
use nalgebra::{DMatrix, DVector, Point2, Point3, Rotation3, UnitQuaternion, Vector2, Vector3, Vector6};

/// A pose by its position [m] and rotation vector [rad].
fn pose(position: [f64; 3], rotation: [f64; 3]) -> Pose3 {
    Pose3::new(Point3::from(position), UnitQuaternion::from_scaled_axis(Vector3::from(rotation)))
}

const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);

/// The oracle: GTSAM 4.3.0 (its Python wheel) on the same graph, built of PriorFactorPose3 and BetweenFactorPose3, solved by
/// LevenbergMarquardtOptimizer with both tolerances 1e-15, five times over; covariances by Marginals, their rotations put
/// last. Odometry whose calibration is known to be (1, 1) is a BetweenFactorPose3.
#[test]
fn the_optimum_is_that_of_gtsam() {
    let starts = [
        pose([0.0; 3], [0.0; 3]),
        pose([1.1, 0.2, -0.1], [0.2, -0.1, 0.9]),
        pose([1.0, 1.4, 0.3], [-0.3, 0.4, 1.7]),
        pose([-0.2, 1.1, 0.2], [0.5, 0.2, 2.6]),
    ];
    let motions = [
        pose([1.0, 0.1, 0.1], [0.1, -0.2, 0.8]),
        pose([1.2, -0.1, 0.2], [0.3, 0.1, 0.9]),
        pose([1.1, 0.2, -0.3], [-0.2, 0.5, 0.7]),
        pose([1.3, -0.2, 0.4], [-0.6, -0.1, -2.9]),
    ];
    let optimum = [
        pose([0.1, -0.05, 0.02], [0.02, 0.01, -0.03]),
        pose(
            [1.446788504859846, -0.463977580324687, -0.110120451006515],
            [0.105433169289888, -0.049740853760043, 0.885562995862279],
        ),
        pose(
            [2.166477697998679, 0.144448452734816, 0.01106380069532],
            [0.388911149036945, 0.149290459613387, 2.041453103275853],
        ),
        pose(
            [1.285642397716346, 0.287535079722374, -0.213255678445988],
            [0.097451110751748, 0.047071940027824, 2.942439315980241],
        ),
    ];
    #[rustfmt::skip]
    const COVARIANCE: [f64; 36] = [
        0.034990018408868, -0.007824345265842, 0.002036585385723, 0.000081504339672, 0.00253897304063, 0.005887333888044,
        -0.007824345265842, 0.027060705056181, 0.007775575016554, -0.002740616283799, -0.000061878686896, -0.003766279596682,
        0.002036585385723, 0.007775575016554, 0.037340775658884, -0.006923515359156, 0.003646945193486, 0.000442267732502,
        0.000081504339672, -0.002740616283799, -0.006923515359156, 0.006204595058277, -0.000890283216155, 0.000428666127307,
        0.00253897304063, -0.000061878686896, 0.003646945193486, -0.000890283216155, 0.005599174720075, 0.001319836324954,
        0.005887333888044, -0.003766279596682, 0.000442267732502, 0.000428666127307, 0.001319836324954, 0.006900515346153,
    ];

    let (mut graph, mut values) = (Graph::new(), Values::new());
    let ids = starts.map(|start| values.add_pose3(start));
    let calibration = values.add_vector(&Odometry3::CALIBRATED);
    graph.add(Prior::vector(calibration, &Odometry3::CALIBRATED), sigmas(&[1e-7; 2])).unwrap();
    let tight = sigmas(&[0.05, 0.06, 0.07, 0.02, 0.03, 0.04]);
    graph.add(Prior::pose3(ids[0], pose([0.1, -0.05, 0.02], [0.02, 0.01, -0.03])), tight).unwrap();
    for (place, motion) in motions.into_iter().enumerate() {
        let odometry = Odometry3::new(ids[place], ids[(place + 1) % 4], calibration, motion);
        graph.add(odometry, sigmas(&[0.1, 0.2, 0.15, 0.05, 0.1, 0.08])).unwrap();
    }
    assert!((graph.error(&values).unwrap() - 310.26700557753367).abs() < 1e-9);
    let solution = patient().solve(&graph, &mut values).unwrap();
    assert!((solution.error - 45.908598741388104).abs() < 1e-9, "{solution:?}");
    for (id, expected) in ids.into_iter().zip(optimum) {
        let error = values.pose3(id).unwrap().seen_from(expected).log().amax();
        assert!(error < 1e-6, "{id:?}: {error}");
    }
    let covariance = Covariances::new(&graph, &values).unwrap().block(ids[2]).unwrap();
    assert!((&covariance - DMatrix::from_row_slice(6, 6, &COVARIANCE)).amax() < 1e-7, "{covariance}");
}

const NOISE: ImuNoise = ImuNoise { rate: 1.7e-3, force: 2e-2, rate_walk: 1e-5, force_walk: 1e-3, integration: 1e-3 };

/// Half a second of readings, and the bias that is taken off them.
fn preintegration() -> Preintegration {
    let bias = ImuBias { rate: Vector3::new(-0.002, 0.02, 0.07), force: Vector3::new(0.05, -0.1, 0.02) };
    let mut motion = Preintegration::new(bias);
    for step in 0..50 {
        let t = 0.01 * f64::from(step);
        let force = Vector3::new(9.2 + 0.5 * (7.0 * t).sin(), 0.3 * (5.0 * t).cos() - 0.4, -3.1 + t);
        let rate = Vector3::new(0.8 * (3.0 * t).cos(), -1.1 + 2.0 * t, 0.6 * (4.0 * t).sin() + 0.2);
        motion.add(rate, force, 0.01, &NOISE);
    }
    motion
}

/// A bias a little off that of the readings.
fn other_bias() -> ImuBias {
    ImuBias { rate: Vector3::new(0.003, 0.01, 0.075), force: Vector3::new(0.07, -0.13, 0.05) }
}

/// Two poses with velocities and a bias, and the factor between them.
fn flight() -> (Values, Inertial) {
    let mut values = Values::new();
    let from = values.add_pose3(pose([1.0, 2.0, -0.5], [0.3, -0.4, 1.2]));
    let from_velocity = values.add_vector(&[0.4, -0.3, 0.8]);
    let to = values.add_pose3(pose([1.3, 2.1, -0.2], [0.5, -0.7, 0.9]));
    let to_velocity = values.add_vector(&[0.9, 0.1, 0.3]);
    let bias = values.add_vector(other_bias().to_vector().as_slice());
    let factor = Inertial::new([from, from_velocity], [to, to_velocity], bias, preintegration(), GRAVITY);
    (values, factor)
}

/// The oracle: GTSAM 4.3.0, PreintegratedImuMeasurementsManifold on the same readings. Its covariance has the order rotation,
/// position, velocity, the latter two in the frame at the end; its residual (NavState.localCoordinates of `predict`) is
/// taken from the end of the motion. Both are turned into ours.
#[test]
fn preintegration_is_that_of_gtsam() {
    let motion = preintegration();
    let close = |found: &[f64], expected: &[f64], scale: f64| {
        let error = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        found.len() == expected.len() && error < scale
    };
    let rotation = motion.rotation.scaled_axis();
    assert!(close(rotation.as_slice(), &[0.2503895143934, -0.3308713517213, 0.2757403599486], 1e-12), "{rotation}");
    let (position, velocity) = (motion.position, motion.velocity);
    assert!(close(position.as_slice(), &[1.2123679600608, 0.0869565623415, -0.1880439658767], 1e-12), "{position}");
    assert!(close(velocity.as_slice(), &[4.8359435444566, 0.5427666260795, -0.4266692163329], 1e-12), "{velocity}");
    #[rustfmt::skip]
    let rows = [
        (0, [1.7173837848181e-05, -4.0480008527148e-08, 4.0534775926515e-08, -3.2136945836628e-08, -5.2983920646724e-08,
             -4.6042056662979e-08, 5.0041095225508e-05, -2.1295050147795e-07, 1.8397512382814e-07]),
        (4, [-5.2983920646724e-08, 9.8591629827393e-08, -5.5279165280807e-07, -4.3316362734622e-12, 1.4449930307623e-06,
             -4.0124352952742e-12, -1.6503002555706e-07, 6.4698984801645e-07, -3.3425258179359e-06]),
        (8, [1.8397512382815e-07, 2.3296948213223e-08, 5.2091990707851e-05, -2.8701022131256e-07, -3.3425258179359e-06,
             8.2363740036386e-07, 3.7299012896813e-07, 4.3879262100502e-08, 2.1118295208454e-04]),
    ];
    for (row, expected) in rows {
        let found: Vec<f64> = motion.covariance.row(row).iter().copied().collect();
        assert!(close(&found, &expected, 1e-15), "row {row}: {found:?}");
    }

    // With another bias, so that its derivatives take part.
    let (values, factor) = flight();
    let mut residual = [0.0; 9];
    factor.evaluate(&values, &mut residual, None).unwrap();
    #[rustfmt::skip]
    let expected = [
        -0.4604496034511, -0.0838045374763, 1.0763772550924,
        -0.3935496264325, -0.0584301512385, -0.4409044058663,
        -2.346170004991, -0.8265115250941, 4.1393240318443,
    ];
    assert!(close(&residual, &expected, 1e-9), "{residual:?}");
}

/// The oracle: the readings themselves, with another bias taken off.
#[test]
fn another_bias_is_taken_off_to_first_order() {
    let readings: Vec<ImuReading> = (0..200)
        .map(|step| {
            let stamp = 0.005 * f64::from(step);
            let rate = Vector3::new((9.0 * stamp).sin(), 0.5, (4.0 * stamp).cos());
            ImuReading { stamp, rate, force: Vector3::new(1.0, (5.0 * stamp).cos(), 9.8) }
        })
        .collect();
    let error = |size: f64, use_derivative: bool| {
        let bias = ImuBias::from_vector(size * Vector6::new(0.3, -0.5, 0.4, 1.0, 0.7, -0.8));
        let with = |bias| Preintegration::between(&readings, 0.1024, 0.8521, bias, &NOISE).unwrap();
        let (old, new) = (with(ImuBias::default()), with(bias));
        assert!((new.duration - 0.7497).abs() < 1e-12, "{}", new.duration);
        let (rotation, position, velocity) = old.corrected(if use_derivative { bias } else { ImuBias::default() });
        let turn = (rotation.inverse() * new.rotation).scaled_axis().amax();
        turn.max((position - new.position).amax()).max((velocity - new.velocity).amax())
    };
    let (small, large) = (error(1e-3, true), error(1e-2, true));
    assert!(small < 2e-6 && large / small > 80.0, "the error is not of second order: {small} {large}");
    assert!(error(1e-3, false) > 1e-4);
}

#[test]
fn jacobians_are_the_derivatives_of_residuals() {
    let mut values = Values::new();
    let from = values.add_pose3(pose([1.0, -2.0, 0.5], [0.4, -1.1, 2.0]));
    let point = values.add_point3(Point3::new(-0.4, 1.3, 2.2));
    let walk = [[0.1, 0.2, 0.3], [0.4, 0.6, 0.1]].map(|numbers| values.add_vector(&numbers));
    let to = values.add_pose3(pose([0.3, -1.2, 0.1], [-0.2, 0.1, 0.6]));
    let sensor = pose([0.1, -0.05, 0.2], [-0.3, 0.1, 0.2]);
    let check = |name: &str, factor: &dyn Factor, bent: &dyn Factor, values: &Values, tolerance: f64| {
        let (error, bent) = (jacobian_error(factor, values), jacobian_error(bent, values));
        assert!(error < tolerance, "{name}: {error}");
        assert!(bent > 5e-5, "{name}: a wrong Jacobian passes");
    };
    macro_rules! check {
        ($name:literal, $factor:expr) => {
            check($name, &$factor, &Bent($factor), &values, 1e-8)
        };
    }
    check!("prior of a pose", Prior::pose3(to, pose([0.0, -1.0, 2.7], [1.0, 2.0, 0.3])));
    check!("prior of a point", Prior::point3(point, Point3::new(1.0, 2.0, 3.0)));
    check!("walk", Walk::new(walk[0], walk[1], 3));
    let camera = Pinhole { focal: [1.2, 1.1], centre: [0.4, 0.3] };
    let camera = StereoCamera { pinhole: camera, baseline: 0.3, reach: 0.2, robot_from_camera: sensor };
    check!("stereo", Stereo::new(to, point, Vector3::new(0.7, 0.2, 0.1), camera));
    let calibration = values.add_vector(&[0.9, 1.2]);
    let values = values;
    let odometry = Odometry3::new(from, to, calibration, pose([1.1, 0.3, 0.2], [0.3, 0.1, -0.2]));
    check("odometry", &odometry, &Bent(odometry.clone()), &values, 1e-8);
    let (values, inertial) = flight();
    check("inertial", &inertial, &Bent(inertial.clone()), &values, 1e-8);
}

/// Four poses on a curve, each with a camera, and eight points ahead of them; what they see is a little off.
struct Views {
    poses: [Pose3; 4],
    points: Vec<Point3<f64>>,
    seen: Vec<Vec<(usize, Point2<f64>)>>,
}

const CAMERA: Pinhole = Pinhole { focal: [450.0, 460.0], centre: [320.0, 240.0] };

fn mounting() -> Pose3 {
    // The body's x axis looks along the camera's z axis.
    let axes = Rotation3::from_matrix_unchecked(nalgebra::Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0));
    Pose3::new(Point3::new(0.1, 0.02, 0.05), UnitQuaternion::from_rotation_matrix(&axes))
}

/// A point in the picture: e = π(q) - measured \[pixels\], q = C⁻¹ P⁻¹ p for a pose P and a mounting C. Its derivatives are
/// central differences. A point behind the camera has no pixel.
#[derive(Debug)]
struct Pixel {
    variables: [VariableId; 2],
    measured: Point2<f64>,
}

impl Pixel {
    fn error(&self, pose: Pose3, point: Point3<f64>) -> Vector2<f64> {
        let pixel = CAMERA.project(((pose * mounting()).inverse() * point).coords);
        pixel.map_or(Vector2::repeat(f64::NAN), |(pixel, _)| pixel - self.measured)
    }
}

impl Factor for Pixel {
    fn variables(&self) -> &[VariableId] {
        &self.variables
    }

    fn dimension(&self) -> usize {
        2
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        const STEP: f64 = 1e-5;
        let [pose, point] = self.variables;
        let (pose, point) = (values.pose3(pose)?, values.point3(point)?);
        residual.copy_from_slice(self.error(pose, point).as_slice());
        if let Some(jacobian) = jacobian {
            let slope = |after: Vector2<f64>, before: Vector2<f64>| (after - before) / (2.0 * STEP);
            for axis in 0..6 {
                let step = Vector6::ith(axis, STEP);
                let [after, before] = [step, -step].map(|step| self.error(pose * Pose3::exp(step), point));
                jacobian.set_column(axis, &slope(after, before));
            }
            for axis in 0..3 {
                let step = Vector3::ith(axis, STEP);
                jacobian.set_column(6 + axis, &slope(self.error(pose, point + step), self.error(pose, point - step)));
            }
        }
        Ok(())
    }
}

impl Views {
    fn new() -> Self {
        let poses =
            [0.0, 1.0, 2.0, 3.0].map(|t: f64| pose([0.1 * t, 0.4 * t, 0.05 * t * t], [0.02 * t, 0.0, -0.05 * t]));
        let spread = |place: f64| (12.9898 * place).sin();
        let points: Vec<_> = (0..8)
            .map(|i| f64::from(i) * 3.0)
            .map(|i| Point3::new(5.0 + 2.0 * spread(i), 2.0 * spread(i + 1.0), 1.5 * spread(i + 2.0)))
            .collect();
        let seen = points.iter().enumerate().map(|(number, point)| {
            let see = |place: usize| {
                let in_camera = (poses[place] * mounting()).inverse() * *point;
                let noise = [0.0, 1.0].map(|axis| spread((number * 8 + place * 2) as f64 + axis + 0.3));
                let pixel = CAMERA.project(in_camera.coords).unwrap().0;
                (place, Point2::new(pixel.x + noise[0], pixel.y + noise[1]))
            };
            // The last point is seen from two poses only.
            (if number == 7 { 1..3 } else { 0..4 }).map(see).collect()
        });
        let seen = seen.collect();
        Self { poses, points, seen }
    }

    /// The poses, a little off, with the first two known, and as the case may be the points.
    fn graph(&self) -> (Graph, Values, [VariableId; 4]) {
        let (mut graph, mut values) = (Graph::new(), Values::new());
        let off = Pose3::exp(Vector6::new(0.02, -0.03, 0.02, 0.01, -0.01, 0.02));
        let ids = self.poses.map(|pose| values.add_pose3(pose * off));
        graph.add(Prior::pose3(ids[0], self.poses[0]), sigmas(&[1e-3; 6])).unwrap();
        graph.add(Prior::pose3(ids[1], self.poses[1]), sigmas(&[1e-2; 6])).unwrap();
        (graph, values, ids)
    }

    fn tracks(&self, ids: [VariableId; 4]) -> Vec<Track> {
        let views = |seen: &Vec<(usize, Point2<f64>)>| {
            let views: Vec<_> = seen.iter().map(|(place, pixel)| (ids[*place], *pixel)).collect();
            Track::new(views, CAMERA, mounting())
        };
        self.seen.iter().map(views).collect()
    }
}

/// The graph with tracks and the one with points, solved.
struct Both {
    tracked: (Graph, Values),
    explicit: (Graph, Values),
    ids: [VariableId; 4],
}

impl Both {
    fn solve(views: &Views, loss_scale: Option<f64>) -> Self {
        const SIGMA: f64 = 1.3;
        let (mut tracked, mut poses, ids) = views.graph();
        for track in views.tracks(ids) {
            let noise = sigmas(&vec![SIGMA; track.dimension()]);
            let track = loss_scale.map_or(track.clone(), |scale| track.with_loss(scale * SIGMA));
            tracked.add(track, noise).unwrap();
        }
        let (mut explicit, mut all, _) = views.graph();
        for (point, seen) in views.points.iter().zip(&views.seen) {
            let point = all.add_point3(*point);
            for (place, pixel) in seen {
                let seen = Pixel { variables: [ids[*place], point], measured: *pixel };
                let term = explicit.add(seen, sigmas(&[SIGMA; 2])).unwrap();
                explicit.set_loss(term, loss_scale.map_or(Loss::Squared, Loss::Cauchy)).unwrap();
            }
        }
        let before = poses.clone();
        let found = patient().solve(&tracked, &mut poses).unwrap();
        let expected = patient().solve(&explicit, &mut all).unwrap();
        assert!((found.error - expected.error).abs() < 1e-8, "{found:?} {expected:?}");
        assert!(found.error > 1.0 && distance(&before, &poses) > 1e-3, "there is nothing to do");
        for id in ids {
            let error = poses.pose3(id).unwrap().seen_from(all.pose3(id).unwrap()).log().amax();
            assert!(error < 1e-7, "{id:?}: {error}");
        }
        Self { tracked: (tracked, poses), explicit: (explicit, all), ids }
    }
}

/// The oracle: the same graph with the points in it.
#[test]
fn a_track_is_a_landmark_that_is_eliminated() {
    let views = Views::new();
    let Both { tracked, explicit, ids } = Both::solve(&views, None);
    let covariance = |(graph, values): &(Graph, Values)| Covariances::new(graph, values).unwrap();
    let (marginal, joint) = (covariance(&tracked), covariance(&explicit));
    for id in ids {
        let (own, expected) = (marginal.block(id).unwrap(), joint.block(id).unwrap());
        assert!((&own - &expected).amax() < 1e-7 * expected.amax(), "{own} {expected}");
    }
    // Its place is that of the point.
    let place = views.tracks(ids)[0].triangulate(&tracked.1).unwrap().unwrap();
    let point = Point3::from_homogeneous(place).unwrap();
    let expected = explicit.1.point3(explicit.1.ids().nth(4).unwrap()).unwrap();
    assert!((point - expected).amax() < 1e-6, "{point} {expected}");
}

/// The oracle: the same graph with the points in it, each view with Cauchy's loss.
#[test]
fn a_track_stands_wrong_views() {
    let mut views = Views::new();
    let straight = Both::solve(&views, None).tracked.1;
    // The first view of one track, from which it would be triangulated, and the last of another.
    views.seen[2][0].1.x += 30.0;
    views.seen[4][3].1.y -= 25.0;
    let robust = Both::solve(&views, Some(2.0)).tracked.1;
    let squared = Both::solve(&views, None).tracked.1;
    let (robust, squared) = (distance(&straight, &robust), distance(&straight, &squared));
    assert!(robust < 0.2 * squared, "{robust} {squared}");
}

/// The oracle: central differences of ½ ‖e‖², whose slope is that of the residual times its Jacobian.
#[test]
fn the_slope_of_a_track_is_a_derivative() {
    let views = Views::new();
    let (_, values, ids) = views.graph();
    for track in views.tracks(ids) {
        let columns: Vec<usize> = track.variables().iter().flat_map(|id| values.tangent(*id).unwrap()).collect();
        let mut residual = DVector::zeros(track.dimension());
        let mut jacobian = DMatrix::zeros(track.dimension(), columns.len());
        track.evaluate(&values, residual.as_mut_slice(), Some(&mut jacobian.as_view_mut())).unwrap();
        let slope = jacobian.tr_mul(&residual);
        let error = |column: usize, step: f64| {
            let mut steps = vec![0.0; values.dimension()];
            steps[column] = step;
            let mut residual = DVector::zeros(track.dimension());
            track.evaluate(&values.retract(&steps).unwrap(), residual.as_mut_slice(), None).unwrap();
            0.5 * residual.norm_squared()
        };
        let numeric = columns.iter().map(|&column| (error(column, 1e-5) - error(column, -1e-5)) / 2e-5);
        let numeric = DVector::from_iterator(columns.len(), numeric);
        assert!((&slope - &numeric).amax() < 1e-6 * slope.amax(), "{slope} {numeric}");
        jacobian *= 1.001;
        assert!((jacobian.tr_mul(&residual) - numeric).amax() > 1e-6 * slope.amax(), "a wrong Jacobian passes");
    }
}

/// From one place nothing tells how far a feature is, but all that it tells of the rotation counts.
#[test]
fn a_track_without_a_baseline_tells_the_rotation() {
    let mut values = Values::new();
    let ids = [[0.0; 3], [0.01, 0.02, -0.03]].map(|turn| values.add_pose3(pose([0.0; 3], turn)));
    let camera = |turn: [f64; 3]| pose([0.0; 3], turn) * mounting();
    let turn = [0.02, -0.01, 0.03];
    let mut graph = Graph::new();
    graph.add(Prior::pose3(ids[0], Pose3::identity()), sigmas(&[1e-3; 6])).unwrap();
    // Its position is known, as the camera is not where the body turns.
    graph.add(Prior::pose3(ids[1], pose([0.0; 3], [0.0; 3])), sigmas(&[1e-3, 1e-3, 1e-3, 10.0, 10.0, 10.0])).unwrap();
    for far in [[1e7, 2e6, 0.0], [1e7, -3e6, 1e6], [1e7, 1e6, -3e6]] {
        let see = |turn| CAMERA.project((camera(turn).inverse() * Point3::from(far)).coords).unwrap().0;
        let track = Track::new([(ids[0], see([0.0; 3])), (ids[1], see(turn))], CAMERA, mounting());
        graph.add(track, sigmas(&[1.0; 4])).unwrap();
    }
    patient().solve(&graph, &mut values).unwrap();
    let error = (values.pose3(ids[1]).unwrap().rotation.scaled_axis() - Vector3::from(turn)).amax();
    assert!(error < 1e-4, "{error}");
}

#[test]
fn what_cannot_be_is_an_error() {
    let mut values = Values::new();
    let (flat, space) = (values.add_pose(Default::default()), values.add_pose3(Pose3::identity()));
    let behind = values.add_point3(Point3::new(-1.0, 0.0, 0.0));
    let solve = |factor: Prior| {
        let mut graph = Graph::new();
        graph.add(factor, sigmas(&[1.0; 6])).unwrap();
        graph.error(&values).unwrap_err()
    };
    let error = solve(Prior::pose3(flat, Pose3::identity()));
    assert!(matches!(error, GraphError::Kind { variable, kind: Kind::Pose, .. } if variable == flat), "{error}");
    // A point behind the camera has no pixel.
    let mut graph = Graph::new();
    let seen = Pixel { variables: [space, behind], measured: Point2::origin() };
    graph.add(seen, sigmas(&[1.0; 2])).unwrap();
    assert!(matches!(graph.error(&values), Err(GraphError::NotFinite(_))));
    assert!(Preintegration::between(&[], 0.0, 1.0, ImuBias::default(), &NOISE).is_none());
}
