//! Factor graphs against a program that is known to be right, central differences, dense matrices and known truth.

use ipslam::factor_graph::{
    Between, Covariances, Factor, Graph, GraphError, Jacobian, Kind, Loss, Noise, Odometry, Prior, RangeBearing,
    Sighting, Solver, SolverConfig, TermId, Values, VariableId,
};
use ipslam::geometry::Pose;
use nalgebra::{DMatrix, DMatrixViewMut, Point2};

pub(crate) fn sigmas(sigmas: &[f64]) -> Noise {
    Noise::sigmas(sigmas).unwrap()
}

/// Stops only where rounding does.
pub(crate) fn patient() -> Solver {
    Solver::new(SolverConfig { iterations: 1000, relative_tolerance: 1e-14, absolute_tolerance: 0.0 })
}

/// Five poses once round a room and three points, of which two sightings are off.
struct Room {
    graph: Graph,
    values: Values,
    poses: Vec<VariableId>,
    points: Vec<VariableId>,
    sightings: Vec<TermId>,
}

const STARTS: [(f64, f64, f64); 5] =
    [(0.0, 0.0, 0.0), (2.2, 0.1, 1.4), (2.1, 1.8, 3.0), (0.2, 2.1, -1.7), (0.1, -0.2, 0.1)];
const POINTS: [(f64, f64); 3] = [(3.2, 1.1), (-0.7, 1.2), (1.2, 3.4)];
const MOTIONS: [(f64, f64, f64); 4] = [(2.0, 0.1, 1.5), (1.9, -0.1, 1.6), (2.1, 0.05, 1.45), (1.95, 0.0, 1.62)];
/// Pose, point, range [m], bearing [rad].
const SIGHTINGS: [(usize, usize, f64, f64); 10] = [
    (0, 0, 3.4, 0.3),
    (0, 1, 1.3, 2.1),
    (1, 0, 1.55, -0.75),
    (1, 2, 3.5, 0.4),
    (2, 1, 2.8, 0.25),
    (2, 2, 1.75, -1.1),
    (3, 1, 1.4, -0.9),
    (3, 2, 2.6, 2.2),
    (4, 0, 3.2, 0.35),
    (4, 2, 4.9, 1.1),
];

impl Room {
    fn new() -> Self {
        let (mut graph, mut values) = (Graph::new(), Values::new());
        let poses: Vec<_> = STARTS.iter().map(|&(x, y, heading)| values.add_pose(Pose::new(x, y, heading))).collect();
        let points: Vec<_> = POINTS.iter().map(|&(x, y)| values.add_point(Point2::new(x, y))).collect();
        graph.add(Prior::pose(poses[0], Pose::new(0.1, -0.05, 0.02)), sigmas(&[0.1, 0.1, 0.05])).unwrap();
        for (pair, &(x, y, turn)) in poses.windows(2).zip(&MOTIONS) {
            let motion = Between::new(pair[0], pair[1], Pose::new(x, y, turn));
            graph.add(motion, sigmas(&[0.2, 0.1, 0.1])).unwrap();
        }
        let sightings = SIGHTINGS
            .iter()
            .map(|&(pose, point, range, bearing)| {
                let sighting = RangeBearing::new(poses[pose], points[point], range, bearing);
                graph.add(sighting, sigmas(&[0.15, 0.05])).unwrap()
            })
            .collect();
        Self { graph, values, poses, points, sightings }
    }
}

/// How far two sets of values of the same variables are apart at most, in metres and radians.
pub(crate) fn distance(a: &Values, b: &Values) -> f64 {
    a.ids()
        .map(|id| match a.kind(id).unwrap() {
            Kind::Pose => b.pose(id).unwrap().seen_from(a.pose(id).unwrap()).log().amax(),
            Kind::Point => (a.point(id).unwrap() - b.point(id).unwrap()).amax(),
            Kind::Pose3 => b.pose3(id).unwrap().seen_from(a.pose3(id).unwrap()).log().amax(),
            Kind::Point3 => (a.point3(id).unwrap() - b.point3(id).unwrap()).amax(),
            Kind::Vector(_) => {
                let pairs = a.vector(id).unwrap().iter().zip(b.vector(id).unwrap());
                pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            }
        })
        .fold(0.0, f64::max)
}

/// The oracle: GTSAM 4.3.0 (its Python wheel) on the same graph, built of PriorFactorPose2, BetweenFactorPose2 and
/// BearingRangeFactor2D with the mEstimators Huber(1.345) and Cauchy(1.5), solved by LevenbergMarquardtOptimizer with both
/// tolerances 1e-15, five times over; covariances by Marginals.
#[test]
fn the_optimum_is_that_of_gtsam() {
    const OPTIMUM: [(f64, f64, f64); 5] = [
        (0.100000000, -0.050000000, 0.020000000),
        (2.133201778, 0.069013166, 1.441804966),
        (2.287920306, 1.928235452, -3.111347419),
        (0.204242946, 1.858144766, -1.488137876),
        (0.355711110, -0.128722586, 0.055612874),
    ];
    const POINTS: [(f64, f64); 3] = [(3.32215535, 1.0649918), (-0.60579595, 1.07397772), (1.47325411, 3.46120593)];
    const LAST_POSE: [f64; 9] = [
        0.0364945505,
        -0.0043820948,
        0.0048847399,
        -0.0043820948,
        0.0352846629,
        -0.0050289835,
        0.0048847399,
        -0.0050289835,
        0.0079584034,
    ];
    const LAST_POSE_AND_POINT: [f64; 6] =
        [0.0088375573, 0.0019333658, -0.0000686452, 0.0195448585, -0.0142032136, 0.0042381493];

    let Room { mut graph, mut values, poses, points, sightings } = Room::new();
    graph.set_loss(sightings[7], Loss::Huber(1.345)).unwrap();
    graph.set_loss(sightings[9], Loss::Cauchy(1.5)).unwrap();
    assert!((graph.error(&values).unwrap() - 64.70674889238461).abs() < 1e-9);
    let solution = patient().solve(&graph, &mut values).unwrap();
    assert!(solution.converged, "{solution:?}");
    assert!((solution.error - 17.88100612226551).abs() < 1e-9, "{solution:?}");
    for (id, (x, y, heading)) in poses.iter().zip(OPTIMUM) {
        let error = values.pose(*id).unwrap().seen_from(Pose::new(x, y, heading)).log().amax();
        assert!(error < 1e-6, "{id:?}: {error}");
    }
    for (id, (x, y)) in points.iter().zip(POINTS) {
        let error = (values.point(*id).unwrap() - Point2::new(x, y)).amax();
        assert!(error < 1e-6, "{id:?}: {error}");
    }
    let joint = Covariances::new(&graph, &values).unwrap().joint(&[poses[4], points[2]]).unwrap();
    let own = joint.view((0, 0), (3, 3)) - DMatrix::from_row_slice(3, 3, &LAST_POSE);
    let cross = joint.view((0, 3), (3, 2)) - DMatrix::from_row_slice(3, 2, &LAST_POSE_AND_POINT);
    assert!(own.amax() < 1e-7 && cross.amax() < 1e-7, "{joint}");
}

#[test]
fn a_bad_start_ends_at_the_same_optimum() {
    let Room { graph, mut values, poses, .. } = Room::new();
    let mut far = values.clone();
    patient().solve(&graph, &mut values).unwrap();
    for (id, offset) in poses.iter().zip([0.0, 0.7, -0.8, 0.9, 1.0]) {
        far.set_pose(*id, far.pose(*id).unwrap() * Pose::new(2.0 * offset, -offset, offset)).unwrap();
    }
    let solution = patient().solve(&graph, &mut far).unwrap();
    assert!(solution.converged && distance(&values, &far) < 1e-6, "{solution:?}, {} off", distance(&values, &far));
}

/// The greatest difference between a factor's Jacobian and central differences of its residual.
pub(crate) fn jacobian_error(factor: &dyn Factor, values: &Values) -> f64 {
    const STEP: f64 = 1e-5;
    let rows = factor.dimension();
    let columns: Vec<usize> = factor.variables().iter().flat_map(|id| values.tangent(*id).unwrap()).collect();
    let mut numbers = vec![0.0; rows * columns.len()];
    let mut jacobian = DMatrixViewMut::from_slice(&mut numbers, rows, columns.len());
    factor.evaluate(values, &mut vec![0.0; rows], Some(&mut jacobian)).unwrap();
    let residual = |column: usize, step: f64| {
        let mut steps = vec![0.0; values.dimension()];
        steps[column] = step;
        let mut residual = nalgebra::DVector::zeros(rows);
        factor.evaluate(&values.retract(&steps).unwrap(), residual.as_mut_slice(), None).unwrap();
        residual
    };
    let error = |(place, column): (usize, usize)| {
        (jacobian.column(place) - (residual(column, STEP) - residual(column, -STEP)) / (2.0 * STEP)).amax()
    };
    columns.into_iter().enumerate().map(error).fold(0.0, f64::max)
}

/// A factor whose Jacobian is wrong in its last entry.
#[derive(Debug)]
pub(crate) struct Bent<F>(pub(crate) F);

impl<F: Factor> Factor for Bent<F> {
    fn variables(&self) -> &[VariableId] {
        self.0.variables()
    }

    fn dimension(&self) -> usize {
        self.0.dimension()
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        let Some(jacobian) = jacobian else {
            return self.0.evaluate(values, residual, None);
        };
        self.0.evaluate(values, residual, Some(jacobian))?;
        let last = (jacobian.nrows() - 1, jacobian.ncols() - 1);
        jacobian[last] += 1e-4;
        Ok(())
    }
}

#[test]
fn jacobians_are_the_derivatives_of_residuals() {
    let mut values = Values::new();
    let from = values.add_pose(Pose::new(1.0, -2.0, 2.9));
    let point = values.add_point(Point2::new(-0.4, 1.3));
    let to = values.add_pose(Pose::new(0.3, -1.2, -2.8));
    let calibration = values.add_vector(&[0.9, 1.1, -0.05]);
    let sensor = Pose::new(0.2, -0.1, 0.4);
    let check = |name: &str, factor: &dyn Factor, bent: &dyn Factor| {
        let (error, bent) = (jacobian_error(factor, &values), jacobian_error(bent, &values));
        assert!(error < 1e-6, "{name}: {error}");
        assert!(bent > 5e-5, "{name}: a wrong Jacobian passes");
    };
    macro_rules! check {
        ($name:literal, $factor:expr) => {
            check($name, &$factor, &Bent($factor))
        };
    }
    check!("prior of a pose", Prior::pose(to, Pose::new(0.0, -1.0, 2.7)));
    check!("prior of a point", Prior::point(point, Point2::new(1.0, 2.0)));
    check!("prior of a vector", Prior::vector(calibration, &Odometry::CALIBRATED));
    let together =
        || Prior::joint([Prior::pose(to, Pose::new(0.0, -1.0, 2.7)), Prior::point(point, Point2::new(1.0, 2.0))]);
    check!("prior of both", together());
    check!("between", Between::new(from, to, Pose::new(1.1, 0.3, 0.2)));
    check!("odometry", Odometry::new(from, to, calibration, Pose::new(1.1, 0.3, 0.2)));
    check!("odometry that turns far", Odometry::new(to, from, calibration, Pose::new(-0.6, 0.4, 2.2)));
    check!("odometry straight ahead", Odometry::new(from, to, calibration, Pose::new(0.8, 0.0, 0.0)));
    check!("range and bearing", RangeBearing::new(from, point, 3.0, 1.0));
    check!("range and bearing of a sensor", RangeBearing::new(to, point, 3.0, -1.0).from_sensor(sensor));
    check!("sighting", Sighting::new(from, point, Point2::new(2.0, 1.0)));
    check!("sighting of a sensor", Sighting::new(to, point, Point2::new(2.0, 1.0)).from_sensor(sensor));
}

#[test]
fn what_no_factor_determines_is_named() {
    let Room { mut graph, mut values, poses, points, .. } = Room::new();
    let before = values.clone();
    let stray = values.add_point(Point2::new(1.0, 1.0));
    let error = Solver::default().solve(&graph, &mut values).unwrap_err();
    assert_eq!(error, GraphError::Singular { variable: stray });

    // A sighting ties it to the map, until it weighs nothing.
    let sighting = graph.add(RangeBearing::new(poses[1], stray, 1.0, 0.3), sigmas(&[0.1, 0.1])).unwrap();
    let mut solver = Solver::default();
    solver.solve(&graph, &mut values).unwrap();
    graph.set_weight(sighting, 0.0).unwrap();
    assert_eq!(solver.solve(&graph, &mut values).unwrap_err(), GraphError::Singular { variable: stray });
    assert!(matches!(Covariances::new(&graph, &values), Err(GraphError::Singular { variable }) if variable == stray));

    // A range alone leaves a point free to go round.
    graph.set_weight(sighting, 1.0).unwrap();
    graph.set_noise(sighting, sigmas(&[0.1, 1e9])).unwrap();
    assert_eq!(solver.solve(&graph, &mut values).unwrap_err(), GraphError::Singular { variable: stray });

    // A map that nothing ties to the world.
    let mut afloat = Graph::new();
    for (pose, point, range, bearing) in SIGHTINGS {
        let sighting = RangeBearing::new(poses[pose], points[point], range, bearing);
        afloat.add(sighting, sigmas(&[0.15, 0.05])).unwrap();
    }
    let mut values = before.clone();
    assert!(matches!(Solver::default().solve(&afloat, &mut values), Err(GraphError::Singular { .. })));
    assert_eq!(values, before, "an error leaves the values as they are");
}

/// A long chain loses its beginning in rounding: the free direction is still found, and a prior still ends it.
#[test]
fn a_long_chain_is_free_without_a_prior_and_not_with_one() {
    let (mut graph, mut values) = (Graph::new(), Values::new());
    let motion = Pose::new(0.2, 0.0, 0.01);
    let mut last = values.add_pose(Pose::IDENTITY);
    let mut world_from_last = Pose::IDENTITY;
    for _ in 0..3000 {
        world_from_last = world_from_last * motion;
        let next = values.add_pose(world_from_last);
        graph.add(Between::new(last, next, motion), sigmas(&[0.01, 0.003, 0.002])).unwrap();
        last = next;
    }
    let error = Solver::default().solve(&graph, &mut values).unwrap_err();
    assert!(matches!(error, GraphError::Singular { .. }), "{error}");
    graph.add(Prior::pose(last, world_from_last), sigmas(&[1.0; 3])).unwrap();
    assert!(Solver::default().solve(&graph, &mut values).unwrap().error < 1e-9);
}

#[test]
fn a_weight_is_a_number_of_factors() {
    let weighted = {
        let Room { mut graph, mut values, sightings, .. } = Room::new();
        graph.set_weight(sightings[3], 3.0).unwrap();
        graph.set_weight(sightings[5], 0.0).unwrap();
        graph.set_weight(sightings[6], 0.25).unwrap();
        patient().solve(&graph, &mut values).unwrap();
        values
    };
    let Room { mut graph, mut values, poses, points, sightings } = Room::new();
    let (pose, point, range, bearing) = SIGHTINGS[3];
    for _ in 0..2 {
        let again = RangeBearing::new(poses[pose], points[point], range, bearing);
        graph.add(again, sigmas(&[0.15, 0.05])).unwrap();
    }
    graph.set_noise(sightings[5], sigmas(&[1e6, 1e6])).unwrap();
    graph.set_noise(sightings[6], sigmas(&[0.3, 0.1])).unwrap();
    let plain = distance(&weighted, &values);
    patient().solve(&graph, &mut values).unwrap();
    assert!(distance(&weighted, &values) < 1e-8, "{}", distance(&weighted, &values));
    assert!(plain > 1e-3, "nothing has moved");
}

/// A solver that keeps its pattern finds to the bit what a new one finds.
#[test]
fn a_solver_can_be_used_again() {
    let Room { mut graph, values: start, poses, points, sightings } = Room::new();
    let mut kept = Solver::default();
    kept.solve(&graph, &mut start.clone()).unwrap();
    for change in 0..3 {
        match change {
            0 => graph.set_weight(sightings[2], 0.3).unwrap(),
            1 => graph.set_loss(sightings[4], Loss::Cauchy(1.0)).unwrap(),
            _ => {
                let sighting = Sighting::new(poses[2], points[0], Point2::new(-1.0, 0.8));
                graph.add(sighting, sigmas(&[0.1; 2])).unwrap();
            }
        }
        let (mut a, mut b) = (start.clone(), start.clone());
        assert_eq!(kept.solve(&graph, &mut a).unwrap(), Solver::default().solve(&graph, &mut b).unwrap());
        assert_eq!(a, b, "change {change}");
    }
}

/// The oracle: the normal equations as a dense matrix.
#[test]
fn covariances_are_those_of_the_dense_inverse() {
    fn add<F: Factor + Clone + 'static>(
        (graph, dense, values): (&mut Graph, &mut DMatrix<f64>, &Values),
        factor: F,
        covariance: &DMatrix<f64>,
    ) {
        let rows = factor.dimension();
        let columns: Vec<usize> = factor.variables().iter().flat_map(|id| values.tangent(*id).unwrap()).collect();
        let mut jacobian = DMatrix::zeros(rows, columns.len());
        factor.evaluate(values, &mut vec![0.0; rows], Some(&mut jacobian.as_view_mut())).unwrap();
        let block = jacobian.transpose() * covariance.clone().try_inverse().unwrap() * jacobian;
        for (i, row) in columns.iter().enumerate() {
            for (j, column) in columns.iter().enumerate() {
                dense[(*row, *column)] += block[(i, j)];
            }
        }
        graph.add(factor, Noise::covariance(covariance).unwrap()).unwrap();
    }

    let mut values = Values::new();
    // The calibration comes between, so that blocks of all widths follow each other.
    let first = values.add_pose(Pose::IDENTITY);
    let tree = values.add_point(Point2::new(2.0, 3.0));
    let calibration = values.add_vector(&[0.9, 1.1, 0.02]);
    let second = values.add_pose(Pose::new(1.0, 0.2, 0.4));
    let third = values.add_pose(Pose::new(1.8, 0.9, 0.9));
    let mut graph = Graph::new();
    let mut dense = DMatrix::zeros(values.dimension(), values.dimension());
    let wide = DMatrix::from_row_slice(3, 3, &[0.04, 0.01, 0.0, 0.01, 0.02, 0.003, 0.0, 0.003, 0.01]);
    let narrow = DMatrix::from_row_slice(2, 2, &[0.03, -0.005, -0.005, 0.002]);
    let mut all = (&mut graph, &mut dense, &values);
    let add_to = |all: &mut (&mut Graph, &mut DMatrix<f64>, &Values), seen: (VariableId, Point2<f64>)| {
        add((&mut *all.0, &mut *all.1, all.2), Sighting::new(seen.0, tree, seen.1), &narrow);
    };
    add((&mut *all.0, &mut *all.1, all.2), Prior::pose(first, Pose::new(0.1, 0.0, 0.0)), &wide);
    add((&mut *all.0, &mut *all.1, all.2), Prior::vector(calibration, &Odometry::CALIBRATED), &wide);
    for (from, to) in [(first, second), (second, third), (third, first)] {
        let motion = Odometry::new(from, to, calibration, Pose::new(1.0, 0.1, 0.5));
        add((&mut *all.0, &mut *all.1, all.2), motion, &wide);
    }
    add_to(&mut all, (second, Point2::new(1.9, 2.2)));
    add_to(&mut all, (third, Point2::new(1.5, 1.2)));

    let inverse = dense.try_inverse().unwrap();
    let covariances = Covariances::new(&graph, &values).unwrap();
    for id in values.ids() {
        let range = values.tangent(id).unwrap();
        let expected = inverse.view((range.start, range.start), (range.len(), range.len()));
        assert!((covariances.block(id).unwrap() - expected).amax() < 1e-9, "{id:?}");
        let cross = covariances.columns(id).unwrap().with(tree).unwrap();
        let expected = inverse.view((values.tangent(tree).unwrap().start, range.start), (2, range.len()));
        assert!((cross - expected).amax() < 1e-9, "{id:?} and the point");
    }
    let joint = covariances.joint(&[third, tree]).unwrap();
    let at: Vec<usize> = [third, tree].into_iter().flat_map(|id| values.tangent(id).unwrap()).collect();
    assert!((joint - inverse.select_rows(&at).select_columns(&at)).amax() < 1e-9);
}

/// The oracle: odometry that is wrong by a known calibration, along arcs.
#[test]
fn odometry_is_calibrated() {
    let (scale, turn_scale, curvature) = (0.88, 0.92, -0.06);
    let (mut graph, mut values) = (Graph::new(), Values::new());
    let calibration = values.add_vector(&Odometry::CALIBRATED);
    let points: Vec<_> = [(2.0, 1.0), (-1.0, 3.0), (0.5, -2.0)].map(|(x, y)| Point2::new(x, y)).to_vec();
    let trees: Vec<_> =
        points.iter().map(|point| values.add_point(point + nalgebra::Vector2::new(0.2, -0.1))).collect();
    let (mut truth, mut measured, mut last) = (Pose::IDENTITY, Pose::IDENTITY, None);
    for step in 0..12 {
        let pose = values.add_pose(measured);
        match last {
            None => {
                graph.add(Prior::pose(pose, truth), sigmas(&[1e-3; 3])).unwrap();
            }
            Some((from, motion)) => {
                let odometry = Odometry::new(from, pose, calibration, motion);
                graph.add(odometry, sigmas(&[0.01, 0.01, 0.01])).unwrap();
            }
        }
        for (point, tree) in points.iter().zip(&trees) {
            let seen = (truth.inverse() * *point).coords;
            let sighting = RangeBearing::new(pose, *tree, seen.norm(), seen.y.atan2(seen.x));
            graph.add(sighting, sigmas(&[0.1, 0.02])).unwrap();
        }
        let twist = nalgebra::Vector3::new(0.4 + 0.05 * f64::from(step), 0.01, 0.8 - 0.1 * f64::from(step));
        let true_twist =
            nalgebra::Vector3::new(scale * twist.x, scale * twist.y, turn_scale * twist.z + curvature * twist.x);
        (truth, measured) = (truth * Pose::exp(true_twist), measured * Pose::exp(twist));
        last = Some((pose, Pose::exp(twist)));
    }
    let solution = patient().solve(&graph, &mut values).unwrap();
    assert!(solution.error < 1e-15, "{solution:?}");
    for (found, expected) in values.vector(calibration).unwrap().iter().zip([scale, turn_scale, curvature]) {
        assert!((found - expected).abs() < 1e-7, "{found} for {expected}");
    }
}

#[test]
fn what_cannot_be_is_an_error() {
    let Room { mut graph, values, poses, points, sightings } = Room::new();
    let (pose, point) = (poses[0], points[0]);
    for bad in [&[0.1, 0.0][..], &[-1.0, 1.0], &[f64::NAN, 1.0], &[f64::INFINITY, 1.0]] {
        assert_eq!(Noise::sigmas(bad).unwrap_err(), GraphError::Noise);
    }
    for bad in [[1.0, 2.0, 2.0, 1.0], [1.0, 0.5, 0.0, 1.0], [f64::NAN, 0.0, 0.0, 1.0]] {
        assert_eq!(Noise::covariance(&DMatrix::from_row_slice(2, 2, &bad)).unwrap_err(), GraphError::Noise);
    }
    let short = graph.add(RangeBearing::new(pose, point, 1.0, 0.0), sigmas(&[0.1]));
    assert_eq!(short.unwrap_err(), GraphError::Length { wanted: 2, found: 1 });
    let twice = graph.add(Between::new(pose, pose, Pose::IDENTITY), sigmas(&[0.1; 3]));
    assert_eq!(twice.unwrap_err(), GraphError::Repeated { variable: pose });
    assert!(matches!(graph.set_weight(sightings[0], -1.0), Err(GraphError::Weight(_))));
    assert!(matches!(graph.set_weight(sightings[0], f64::NAN), Err(GraphError::Weight(_))));
    assert!(matches!(graph.set_loss(sightings[0], Loss::Cauchy(0.0)), Err(GraphError::Loss(_))));
    assert!(matches!(Solver::default().solve(&Graph::new(), &mut Values::new()), Err(GraphError::Empty)));

    let refused = |factor: RangeBearing, values: &Values| {
        let mut graph = graph.clone();
        graph.add(factor, sigmas(&[0.1, 0.1])).unwrap();
        Solver::default().solve(&graph, &mut values.clone()).unwrap_err()
    };
    let swapped = refused(RangeBearing::new(point, pose, 1.0, 0.0), &values);
    assert!(matches!(swapped, GraphError::Kind { variable, kind: Kind::Point, .. } if variable == point), "{swapped}");
    let nan = refused(RangeBearing::new(pose, point, f64::NAN, 0.0), &values);
    assert!(matches!(nan, GraphError::NotFinite(term) if term.index() == graph.len()), "{nan}");
    // A point where the robot stands has no bearing.
    let mut on_top = values.clone();
    on_top.set_point(point, values.pose(pose).unwrap().position()).unwrap();
    assert!(matches!(Solver::default().solve(&graph, &mut on_top), Err(GraphError::NotFinite(_))));
    let mut fewer = Values::new();
    fewer.add_pose(Pose::IDENTITY);
    assert!(matches!(Solver::default().solve(&graph, &mut fewer), Err(GraphError::Unknown { .. })));
}
