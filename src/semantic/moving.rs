//! Objects that move: they are no landmarks.
//!
//! Of classes whose objects may move, detections are followed through all frames, in the frame of odometry: over the few seconds
//! for which an object is seen, odometry errs by less than detections do. An object has moved if its last place is farther from its
//! first one than errors explain.

use super::linear::{GATES, Linear};
use super::sensor_model::SensorModel;
use super::world::World;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeSet;

/// After so long without a detection, an object is seen anew \[s\].
const LOST: f64 = 0.5;
/// Standard deviation of the speed of an object that was seen once, in each direction \[m/s\]: traffic in a town.
const SPEED: f64 = 10.0;
/// Standard deviation by which a speed changes in a second \[m/s/√s\].
const SPEED_CHANGE: f64 = 2.0;

/// Frame and number of each detection of an object that moves.
pub fn moving<W: World>(recording: &W::Recording, model: &SensorModel<'_, W>) -> BTreeSet<(usize, usize)> {
    let movable = W::movable(model.sensors());
    if movable.is_empty() {
        return BTreeSet::new();
    }
    let (mut live, mut done): (Vec<Track>, Vec<Track>) = (Vec::new(), Vec::new());
    let (mut pose, mut way, mut last) = (W::origin(), 0.0, None);
    for (frame, (stamp, seen)) in W::frames(recording).into_iter().enumerate() {
        let motion = W::motion(recording, last.unwrap_or(stamp), stamp);
        pose = pose * motion.start_from_end;
        way += motion.distance;
        let drift = model.motion_variances(&motion)[0];
        let place = |(number, seen): &(usize, W::Detection)| place(model, pose, seen, (frame, *number));
        let places = seen.iter().filter(|(_, seen)| movable.contains(&W::label(seen))).filter_map(place);
        let elapsed = stamp - last.unwrap_or(stamp);
        live.iter_mut().for_each(|track| track.predict(elapsed, drift));
        advance(&mut live, places.collect(), stamp, way);
        let lost: Vec<Track>;
        (lost, live) = live.into_iter().partition(|track| stamp - track.stamp > LOST);
        done.extend(lost);
        last = Some(stamp);
    }
    let scale = model.calibration_sigmas().as_ref()[0];
    let has_moved = |track: &Track| track.has_moved(model.error, scale);
    done.into_iter().chain(live).filter(has_moved).flat_map(|track| track.seen).collect()
}

/// Where a detection's object is.
#[derive(Clone, Debug)]
struct Place {
    position: DVector<f64>,
    covariance: DMatrix<f64>,
    /// Frame and number of the detection.
    seen: (usize, usize),
}

fn place<W: World>(
    model: &SensorModel<'_, W>,
    pose: W::Pose,
    detection: &W::Detection,
    seen: (usize, usize),
) -> Option<Place> {
    let position = model.position(pose, detection);
    let prediction = model.predict(pose, position)?;
    let known_pose = DMatrix::zeros(W::POSE, W::POSE);
    let covariance = prediction.grown(model.variances(detection), known_pose);
    let covariance = covariance.view((W::POSE, W::POSE), (W::POINT, W::POINT)).into_owned();
    let numbers: W::Numbers = position.into();
    Some(Place { position: DVector::from_column_slice(numbers.as_ref()), covariance, seen })
}

/// An object that is followed: a Kalman filter of its position and velocity.
#[derive(Clone, Debug)]
struct Track {
    seen: Vec<(usize, usize)>,
    /// When it was last detected \[s\].
    stamp: f64,
    first: Place,
    /// The way of the robot between its first detection and the last \[m\].
    way: [f64; 2],
    state: DVector<f64>,
    covariance: DMatrix<f64>,
    /// As it was when it was last detected.
    last: Place,
}

impl Track {
    fn new(first: Place, stamp: f64, way: f64) -> Self {
        let size = first.position.len();
        let mut covariance = DMatrix::identity(2 * size, 2 * size) * (SPEED * SPEED);
        covariance.view_mut((0, 0), (size, size)).copy_from(&first.covariance);
        Self {
            seen: vec![first.seen],
            stamp,
            way: [way; 2],
            state: first.position.clone().resize_vertically(2 * size, 0.0),
            covariance,
            last: first.clone(),
            first,
        }
    }

    fn size(&self) -> usize {
        self.first.position.len()
    }

    /// Moves it on by a time \[s\] in which odometry errs by `drift` \[m²\].
    fn predict(&mut self, elapsed: f64, drift: f64) {
        let size = self.size();
        let mut transition = DMatrix::identity(2 * size, 2 * size);
        (0..size).for_each(|axis| transition[(axis, size + axis)] = elapsed);
        self.state = &transition * &self.state;
        self.covariance = &transition * &self.covariance * transition.transpose();
        for axis in 0..size {
            self.covariance[(axis, axis)] += drift;
            self.covariance[(size + axis, size + axis)] += SPEED_CHANGE * SPEED_CHANGE * elapsed;
        }
    }

    /// The difference of a place from where it should be, and the inverse of that difference's covariance.
    fn innovation(&self, place: &Place) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let size = self.size();
        let spread = self.covariance.view((0, 0), (size, size)) + &place.covariance;
        Some((&place.position - self.state.rows(0, size), spread.try_inverse()?))
    }

    fn squared_distance(&self, place: &Place) -> Option<f64> {
        let (off, inverse) = self.innovation(place)?;
        let squared = off.dot(&(inverse * &off));
        (squared < GATES[self.size() - 2]).then_some(squared)
    }

    fn update(&mut self, place: &Place, stamp: f64, way: f64) {
        let size = self.size();
        let Some((off, inverse)) = self.innovation(place) else { return };
        let cross = self.covariance.columns(0, size).into_owned();
        let gain = &cross * inverse;
        self.state += &gain * off;
        let updated = &self.covariance - &gain * cross.transpose();
        // Rounding would make it less and less symmetric.
        self.covariance = (&updated + updated.transpose()) / 2.0;
        self.seen.push(place.seen);
        (self.stamp, self.way[1]) = (stamp, way);
        self.last = Place {
            position: self.state.rows(0, size).into_owned(),
            covariance: self.covariance.view((0, 0), (size, size)).into_owned(),
            seen: place.seen,
        };
    }

    /// Whether it has moved, where detections of one object from different sides differ by `error` \[m\] and the `scale` of odometry
    /// is as wrong.
    fn has_moved(&self, error: f64, scale: f64) -> bool {
        let off = &self.last.position - &self.first.position;
        let odometry = scale * (self.way[1] - self.way[0]);
        let both = DMatrix::identity(off.len(), off.len()) * (error * error + odometry * odometry);
        let inverse = (&self.first.covariance + &self.last.covariance + both).try_inverse();
        inverse.is_some_and(|inverse| off.dot(&(inverse * &off)) > GATES[off.len() - 2])
    }
}

/// Gives places to tracks, the closest first; what is left begins tracks.
fn advance(tracks: &mut Vec<Track>, places: Vec<Place>, stamp: f64, way: f64) {
    let mut pairs = Vec::new();
    for (number, track) in tracks.iter().enumerate() {
        let near = |(place, seen)| Some((track.squared_distance(seen)?, number, place));
        pairs.extend(places.iter().enumerate().filter_map(near));
    }
    pairs.sort_by(|(a, ..), (b, ..)| a.total_cmp(b));
    let (mut followed, mut taken) = (vec![false; tracks.len()], vec![false; places.len()]);
    for (_, track, place) in pairs {
        if !followed[track] && !taken[place] {
            (followed[track], taken[place]) = (true, true);
            tracks[track].update(&places[place], stamp, way);
        }
    }
    let new = places.into_iter().zip(taken).filter(|(_, taken)| !taken);
    tracks.extend(new.map(|(place, _)| Track::new(place, stamp, way)));
}
