//! The graph of all keyframes.

use super::{Camera, FeatureFrame, Recording, Rest, State, VisualInertialError};
use crate::factor_graph::{
    Factor as _, Graph, Inertial, Noise, Prior, Solution, Solver, SolverConfig, Track, Values, VariableId, Walk,
};
use crate::geometry::Pose3;
use crate::inertial::{GRAVITY, ImuBias, ImuReading, Preintegration};
use nalgebra::{DMatrix, Matrix3, Point2, Point3, Vector3, Vector6};
use std::collections::BTreeMap;

/// The first position and heading are the origin \[m, rad\].
const ORIGIN_SIGMA: f64 = 1e-4;
/// Of the gyroscope's bias, as estimated at rest \[rad/s\].
const RATE_BIAS_SIGMA: f64 = 2e-3;
/// Of the accelerometer's bias, which is not observable at rest \[m/s²\].
const FORCE_BIAS_SIGMA: f64 = 0.2;
/// A body at rest moves so fast \[m/s\].
const REST_SIGMA: f64 = 1e-2;
/// Of Cauchy's loss, in standard deviations: where all features are right, it has 95 % of the efficiency of squares.
const LOSS_SCALE: f64 = 2.385;

/// A motion that is over before the next reading is not observed \[s\].
const MAX_GAP: f64 = 0.1;

/// Variables of a state: pose, velocity, bias.
type StateIds = [VariableId; 3];

/// All keyframes so far.
pub(super) struct Keyframes<'a> {
    recording: &'a Recording,
    rest: &'a Rest,
    states: Vec<State>,
    /// From each keyframe to the next.
    motions: Vec<Preintegration>,
    /// Of each track, the keyframes that see it, and where.
    tracks: BTreeMap<u64, Vec<(usize, Point2<f64>)>>,
}

impl<'a> Keyframes<'a> {
    pub(super) fn new(recording: &'a Recording, rest: &'a Rest) -> Self {
        Self { recording, rest, states: Vec::new(), motions: Vec::new(), tracks: BTreeMap::new() }
    }

    pub(super) fn into_states(self) -> Vec<State> {
        self.states
    }

    /// One keyframe more, where the inertial readings lead.
    pub(super) fn add(&mut self, frame: &FeatureFrame) -> Result<(), VisualInertialError> {
        let Recording { imu, imu_noise, .. } = self.recording;
        let state = match self.states.last() {
            None => State { stamp: frame.stamp, pose: self.origin(), velocity: Vector3::zeros(), bias: self.rest.bias },
            Some(last) => {
                let (from, to) = (last.stamp, frame.stamp);
                let gap = widest_gap(imu, from, to);
                let motion = Preintegration::between(imu, from, to, last.bias, imu_noise)
                    .filter(|_| gap.1 - gap.0 <= MAX_GAP)
                    .ok_or(VisualInertialError::Gap { from: gap.0, to: gap.1 })?;
                let (pose, velocity) = motion.predict(last.pose, last.velocity);
                let state = State { stamp: to, pose, velocity, bias: last.bias };
                self.motions.push(motion);
                state
            }
        };
        for feature in &frame.features {
            self.tracks.entry(feature.track).or_default().push((self.states.len(), feature.pixel));
        }
        self.states.push(state);
        Ok(())
    }

    fn origin(&self) -> Pose3 {
        Pose3::new(Point3::origin(), self.rest.world_from_body)
    }

    /// Moves all states to where they are likeliest.
    pub(super) fn solve(&mut self, config: SolverConfig) -> Result<Solution, VisualInertialError> {
        let (mut graph, mut values) = (Graph::new(), Values::new());
        let add_state = |state: &State| {
            let (pose, velocity) = (values.add_pose3(state.pose), values.add_vector(state.velocity.as_slice()));
            [pose, velocity, values.add_vector(state.bias.to_vector().as_slice())]
        };
        let ids: Vec<StateIds> = self.states.iter().map(add_state).collect();
        let Some(first) = ids.first() else { return Err(VisualInertialError::Empty) };
        self.add_priors(&mut graph, *first)?;
        self.add_rest(&mut graph, &ids)?;
        self.add_inertial(&mut graph, &ids)?;
        self.add_geometric(&mut graph, &ids)?;
        let solution = Solver::new(config).solve(&graph, &mut values)?;
        for (state, [pose, velocity, bias]) in self.states.iter_mut().zip(ids) {
            state.pose = values.pose3(pose)?;
            state.velocity.copy_from_slice(values.vector(velocity)?);
            state.bias = ImuBias::from_vector(Vector6::from_column_slice(values.vector(bias)?));
        }
        Ok(solution)
    }

    /// The first state: position and heading are the origin, and gravity determines the other angles, as far as the
    /// accelerometer's bias lets it.
    fn add_priors(&self, graph: &mut Graph, [pose, _, bias]: StateIds) -> Result<(), VisualInertialError> {
        let tilt = FORCE_BIAS_SIGMA / GRAVITY.norm();
        let in_world = Matrix3::from_diagonal(&Vector3::new(tilt, tilt, ORIGIN_SIGMA).map(|sigma| sigma * sigma));
        let body_from_world = self.rest.world_from_body.inverse().to_rotation_matrix().into_inner();
        let mut covariance = DMatrix::identity(6, 6) * ORIGIN_SIGMA.powi(2);
        covariance.view_mut((3, 3), (3, 3)).copy_from(&(body_from_world * in_world * body_from_world.transpose()));
        graph.add(Prior::pose3(pose, self.origin()), Noise::covariance(&covariance)?)?;
        let sigmas = [[RATE_BIAS_SIGMA; 3], [FORCE_BIAS_SIGMA; 3]].concat();
        graph.add(Prior::vector(bias, self.rest.bias.to_vector().as_slice()), Noise::sigmas(&sigmas)?)?;
        Ok(())
    }

    /// No speed while the body rests: without motion, images do not show the distance of features.
    fn add_rest(&self, graph: &mut Graph, ids: &[StateIds]) -> Result<(), VisualInertialError> {
        let resting = self.states.iter().zip(ids).take_while(|(state, _)| state.stamp <= self.rest.end);
        for (_, [_, velocity, _]) in resting {
            graph.add(Prior::vector(*velocity, &[0.0; 3]), Noise::sigmas(&[REST_SIGMA; 3])?)?;
        }
        Ok(())
    }

    /// Eq. 9: the motions between keyframes, and biases that wander.
    fn add_inertial(&self, graph: &mut Graph, ids: &[StateIds]) -> Result<(), VisualInertialError> {
        let noise = &self.recording.imu_noise;
        for (ends, motion) in ids.windows(2).zip(&self.motions) {
            let ([pose, velocity, bias], [next_pose, next_velocity, next_bias]) = (ends[0], ends[1]);
            let covariance = DMatrix::from_column_slice(9, 9, motion.covariance.as_slice());
            let factor = Inertial::new([pose, velocity], [next_pose, next_velocity], bias, motion.clone(), GRAVITY);
            graph.add(factor, Noise::covariance(&covariance)?)?;
            let [rate, force] = [noise.rate_walk, noise.force_walk].map(|density| density * motion.duration.sqrt());
            let sigmas = [[rate; 3], [force; 3]].concat();
            graph.add(Walk::new(bias, next_bias, 6), Noise::sigmas(&sigmas)?)?;
        }
        Ok(())
    }

    /// Eq. 8: features that more than one keyframe sees.
    fn add_geometric(&self, graph: &mut Graph, ids: &[StateIds]) -> Result<(), VisualInertialError> {
        let Camera { pinhole, body_from_camera, noise } = self.recording.camera;
        for views in self.tracks.values().filter(|views| views.len() > 1) {
            let views = views.iter().map(|&(keyframe, pixel)| (ids[keyframe][0], pixel));
            let track = Track::new(views, pinhole, body_from_camera).with_loss(LOSS_SCALE * noise);
            let sigmas = vec![noise; track.dimension()];
            graph.add(track, Noise::sigmas(&sigmas)?)?;
        }
        Ok(())
    }
}

/// The longest time without a reading between two moments \[s\].
fn widest_gap(imu: &[ImuReading], from: f64, to: f64) -> (f64, f64) {
    let place = |stamp: f64| imu.partition_point(|reading| reading.stamp < stamp);
    let inner = imu.get(place(from)..place(to)).unwrap_or_default().iter().map(|reading| reading.stamp);
    let (mut widest, mut last) = ((from, from), from);
    for stamp in inner.chain([to]) {
        if stamp - last > widest.1 - widest.0 {
            widest = (last, stamp);
        }
        last = stamp;
    }
    widest
}
