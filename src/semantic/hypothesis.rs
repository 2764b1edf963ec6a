//! One hypothesis of the forward pass: which detection showed which landmark up to now, and the extended Kalman filter of
//! pose, odometry's calibration and landmarks that follows from it.

use super::keyframes::Keyframe;
use super::linear::{Linear, Pair, log_normal};
use super::sensor_model::SensorModel;
use super::world::{Moved, World};
use crate::association::{Table, best_assignments};
use nalgebra::{Cholesky, DMatrix, DVector};

/// Pairs that are farther apart than this are not weighed \[standard deviations\].
const GATE: f64 = 6.0;
/// An assignment is not followed that is less likely than the best one of its frame by this \[nats\]: e⁻⁸ = 0.0003.
const BRANCH_MARGIN: f64 = 8.0;
/// A landmark that was seen so often is none of chance.
const KNOWN_BY: usize = 4;
/// Of the others, so many are kept, the newest of those seen most: many are clutter, and a step takes time by the square of their
/// number.
const MAX_DOUBTFUL: usize = 45;
/// As many landmarks are known at most; of more, the one seen least is forgotten.
const MAX_KNOWN: usize = 400;

/// A landmark of a hypothesis.
#[derive(Clone, Debug)]
pub struct Tracked<W: World> {
    /// Its number in the hypothesis; never given twice.
    pub id: usize,
    /// In the world \[m\].
    pub position: W::Point,
    /// Probability of each class.
    pub classes: Vec<f64>,
    /// How many detections it has.
    pub sightings: usize,
}

/// A Gaussian of (pose, calibration, landmarks), given one assignment of all detections.
///
/// The error of the pose is a step in its own frame: pose · exp(step).
#[derive(Clone, Debug)]
pub struct Hypothesis<W: World> {
    /// `world_from_robot`.
    pub pose: W::Pose,
    /// Of the odometry.
    pub calibration: W::Calibration,
    /// The map.
    pub landmarks: Vec<Tracked<W>>,
    covariance: DMatrix<f64>,
    /// ln p(all detections up to now, under these assignments).
    pub log_likelihood: f64,
    /// Index of its past.
    pub past: Option<usize>,
    next_id: usize,
}

/// A continuation of a hypothesis: an assignment of the detections of a frame.
#[derive(Clone, Debug)]
pub struct Branch<W: World> {
    /// Of each detection the place of its landmark in the hypothesis; none where it is a new one.
    pub landmarks: Vec<Option<usize>>,
    /// Log-likelihood of the continued hypothesis.
    pub log_likelihood: f64,
    /// The pose afterwards.
    pub pose: W::Pose,
}

/// Pairs of a frame, with what an update needs of them.
struct Pairs<W: World> {
    pairs: Vec<Pair<W::Prediction>>,
    /// Measured less predicted.
    innovation: DVector<f64>,
    /// The factor of its covariance H Σ Hᵀ + R.
    factor: Cholesky<f64, nalgebra::Dyn>,
}

impl<W: World> Hypothesis<W> {
    /// Nothing seen yet; the world's origin is where the robot is.
    pub fn start(model: &SensorModel<'_, W>) -> Self {
        let sigmas = model.calibration_sigmas();
        let known = std::iter::repeat_n(0.0, W::POSE);
        let variances: Vec<f64> = known.chain(sigmas.as_ref().iter().map(|sigma| sigma * sigma)).collect();
        Self {
            pose: W::origin(),
            calibration: W::CALIBRATED,
            landmarks: Vec::new(),
            covariance: DMatrix::from_diagonal(&variances.into()),
            log_likelihood: 0.0,
            past: None,
            next_id: 0,
        }
    }

    /// Degrees of freedom before the landmarks: pose and calibration.
    fn own() -> usize {
        W::POSE + W::CALIBRATED.as_ref().len()
    }

    /// Where the landmark at a place starts in the covariance.
    fn first(place: usize) -> usize {
        Self::own() + W::POINT * place
    }

    /// The place of the landmark of a number; none where it has none, or forgot it.
    pub fn place(&self, number: usize) -> Option<usize> {
        self.landmarks.iter().position(|landmark| landmark.id == number)
    }

    /// The covariance of pose, calibration, and the landmarks at some places, in this order.
    pub fn covariance_of(&self, landmarks: &[usize]) -> DMatrix<f64> {
        let of_landmarks = landmarks.iter().flat_map(|place| Self::first(*place)..Self::first(*place + 1));
        let rows: Vec<usize> = (0..Self::own()).chain(of_landmarks).collect();
        self.covariance.select_rows(&rows).select_columns(&rows)
    }

    /// Moves the robot by calibrated odometry.
    pub fn predict(&mut self, model: &SensorModel<'_, W>, keyframe: &Keyframe<W>) {
        let Moved { pose, by_pose, by_calibration } = W::moved(&keyframe.motion, self.calibration);
        let noise = DMatrix::from_diagonal(&model.motion_variances(&keyframe.motion).into());
        self.pose = self.pose * pose;
        let covariance = &mut self.covariance;
        let (pose, calibration) = (W::POSE, by_calibration.ncols());
        let rows = &by_pose * covariance.rows(0, pose) + &by_calibration * covariance.rows(pose, calibration);
        let own = rows.columns(0, pose) * by_pose.transpose()
            + rows.columns(pose, calibration) * by_calibration.transpose()
            + noise;
        covariance.rows_mut(0, pose).copy_from(&rows);
        covariance.columns_mut(0, pose).copy_from(&rows.transpose());
        covariance.view_mut((0, 0), (pose, pose)).copy_from(&own);
    }

    /// The likeliest ways to go on, by the joint density of the frame under H Σ Hᵀ + R, the classes, and `log_new`, the
    /// log-density of a landmark that is new.
    pub fn branches(
        &self,
        model: &SensorModel<'_, W>,
        seen: &[W::Detection],
        log_new: f64,
        count: usize,
    ) -> Vec<Branch<W>> {
        let look = |(place, landmark): (usize, &Tracked<W>)| {
            let prediction = model.predict(self.pose, landmark.position)?;
            Some((prediction, prediction.spread(Self::first(place), &self.covariance)))
        };
        let predictions: Vec<_> = self.landmarks.iter().enumerate().map(look).collect();
        let table = Table::new(vec![log_new; seen.len()], self.landmarks.len(), |detection, place| {
            let Some((prediction, spread)) = predictions[place] else { return f64::NEG_INFINITY };
            let seen = &seen[detection];
            let pair = pair(model, prediction, Self::first(place), seen);
            let fit = Linear::fit(&pair, &spread).filter(|fit| fit.squared <= GATE * GATE);
            fit.map_or(f64::NEG_INFINITY, |fit| {
                fit.log_density + model.class_log_likelihood(&self.landmarks[place].classes, W::label(seen))
            })
        });
        let assignments = best_assignments(&table, count, BRANCH_MARGIN).into_iter();
        assignments.filter_map(|assignment| self.branch(model, seen, log_new, assignment.landmarks)).collect()
    }

    fn branch(
        &self,
        model: &SensorModel<'_, W>,
        seen: &[W::Detection],
        log_new: f64,
        landmarks: Vec<Option<usize>>,
    ) -> Option<Branch<W>> {
        let mut log_likelihood = self.log_likelihood;
        for (detection, place) in landmarks.iter().enumerate() {
            log_likelihood += place.map_or(log_new, |place| {
                model.class_log_likelihood(&self.landmarks[place].classes, W::label(&seen[detection]))
            });
        }
        let mut pose = self.pose;
        if let Some(pairs) = self.pairs(model, seen, &landmarks)? {
            let whitened = pairs.factor.l_dirty().solve_lower_triangular(&pairs.innovation)?;
            let log_determinant: f64 = pairs.factor.l_dirty().diagonal().iter().map(|root| 2.0 * root.ln()).sum();
            log_likelihood += log_normal(whitened.norm_squared(), log_determinant, pairs.innovation.len());
            let cross = Linear::cross(&pairs.pairs, W::POSE, &self.covariance);
            pose = W::step(pose, (cross * pairs.factor.solve(&pairs.innovation)).as_slice());
        }
        Some(Branch { landmarks, log_likelihood, pose })
    }

    /// The pairs of an assignment; nothing where it has none, and no result where their covariance is not positive.
    fn pairs(
        &self,
        model: &SensorModel<'_, W>,
        seen: &[W::Detection],
        landmarks: &[Option<usize>],
    ) -> Option<Option<Pairs<W>>> {
        let mut pairs = Vec::new();
        for (seen, place) in seen.iter().zip(landmarks) {
            if let Some(place) = *place {
                let prediction = model.predict(self.pose, self.landmarks[place].position)?;
                pairs.push(pair(model, prediction, Self::first(place), seen));
            }
        }
        if pairs.is_empty() {
            return Some(None);
        }
        let (innovation, covariance) = Linear::innovations(&pairs, &self.covariance)?;
        Some(Some(Pairs { pairs, innovation, factor: Cholesky::new(covariance)? }))
    }

    /// Goes on by an assignment: the filter's update, the classes, and the landmarks that are new. Returns the number of
    /// the landmark of each detection.
    pub fn follow(
        &mut self,
        model: &SensorModel<'_, W>,
        seen: &[W::Detection],
        landmarks: &[Option<usize>],
    ) -> Vec<usize> {
        if let Some(Some(pairs)) = self.pairs(model, seen, landmarks) {
            self.update(&pairs);
        }
        let mut ids = Vec::with_capacity(seen.len());
        for (seen, place) in seen.iter().zip(landmarks) {
            let place = place.unwrap_or_else(|| self.add(model, seen));
            let landmark = &mut self.landmarks[place];
            landmark.sightings += 1;
            for (class, share) in landmark.classes.iter_mut().enumerate() {
                *share *= model.confusion(class, W::label(seen));
            }
            let sum: f64 = landmark.classes.iter().sum();
            landmark.classes.iter_mut().for_each(|share| *share /= sum);
            ids.push(landmark.id);
        }
        self.forget(MAX_DOUBTFUL, |landmark| landmark.sightings < KNOWN_BY);
        self.forget(MAX_KNOWN, |landmark| landmark.sightings >= KNOWN_BY);
        ids
    }

    fn update(&mut self, pairs: &Pairs<W>) {
        let cross = Linear::cross(&pairs.pairs, self.covariance.nrows(), &self.covariance);
        // Σ - W Wᵀ with W = Σ Hᵀ L⁻ᵀ stays symmetric.
        let Some(whitened) = pairs.factor.l_dirty().solve_lower_triangular(&cross.transpose()) else { return };
        let step = &cross * pairs.factor.solve(&pairs.innovation);
        // `gemm_tr` multiplies without vector instructions.
        self.covariance.gemm(-1.0, &whitened.transpose(), &whitened, 1.0);
        let (pose, rest) = step.as_slice().split_at(W::POSE);
        self.pose = W::step(self.pose, pose);
        let mut rest = rest.iter();
        let mut add =
            |numbers: &mut [f64]| numbers.iter_mut().zip(rest.by_ref()).for_each(|(number, step)| *number += step);
        add(self.calibration.as_mut());
        for landmark in &mut self.landmarks {
            let mut position: W::Numbers = landmark.position.into();
            add(position.as_mut());
            landmark.position = position.into();
        }
    }

    /// A new landmark, where a detection is; returns its place.
    fn add(&mut self, model: &SensorModel<'_, W>, seen: &W::Detection) -> usize {
        let position = model.position(self.pose, seen);
        let covariance = std::mem::replace(&mut self.covariance, DMatrix::zeros(0, 0));
        self.covariance = match model.predict(self.pose, position) {
            Some(prediction) => prediction.grown(model.variances(seen), covariance),
            None => {
                let size = covariance.nrows() + W::POINT;
                covariance.resize(size, size, 0.0)
            }
        };
        let classes = vec![1.0 / model.classes() as f64; model.classes()];
        self.landmarks.push(Tracked { id: self.next_id, position, classes, sightings: 0 });
        self.next_id += 1;
        self.landmarks.len() - 1
    }

    /// Forgets those of some landmarks that were seen least, of equal ones the oldest, until so many are left.
    fn forget(&mut self, most: usize, is_one: impl Fn(&Tracked<W>) -> bool) {
        while self.landmarks.iter().filter(|landmark| is_one(landmark)).count() > most {
            let ones = self.landmarks.iter().enumerate().filter(|(_, landmark)| is_one(landmark));
            let Some((place, _)) = ones.min_by_key(|(_, landmark)| landmark.sightings) else { return };
            self.landmarks.remove(place);
            let covariance = std::mem::replace(&mut self.covariance, DMatrix::zeros(0, 0));
            let first = Self::first(place);
            self.covariance = covariance.remove_rows(first, W::POINT).remove_columns(first, W::POINT);
        }
    }
}

/// A detection, and a landmark that it may show.
fn pair<W: World>(
    model: &SensorModel<'_, W>,
    prediction: W::Prediction,
    first: usize,
    seen: &W::Detection,
) -> Pair<W::Prediction> {
    Pair { prediction, first, innovation: W::innovation(&prediction, seen), variances: model.variances(seen) }
}
