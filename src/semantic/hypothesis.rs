//! One hypothesis of the forward pass: which detection showed which landmark up to now, and the extended Kalman filter of
//! pose, odometry's calibration and landmarks that follows from it.

use super::keyframes::Keyframe;
use super::sensor_model::{CALIBRATION_SIGMAS, LOSS_SCALE, SensorModel, motion_variances};
use crate::association::{Table, best_assignments};
use crate::detections::Detection;
use crate::factor_graph::{Odometry, Prediction};
use crate::geometry::Pose;
use nalgebra::{Cholesky, DMatrix, DVector, Matrix2, Matrix3, Point2, SMatrix, Vector2, Vector3};

/// Degrees of freedom before the landmarks: pose and calibration.
const FIRST_LANDMARK: usize = 6;
/// Pairs that are farther apart than this are not weighed \[standard deviations\].
const GATE: f64 = 6.0;
/// An assignment is not followed that is less likely than the best one of its frame by this \[nats\]: e⁻⁸ = 0.0003.
const BRANCH_MARGIN: f64 = 8.0;
/// With more landmarks than this, the one seen least is forgotten: a step takes time by the square of their number.
const MAX_LANDMARKS: usize = 60;

/// A landmark of a hypothesis.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// Its number in the hypothesis; never given twice.
    pub id: usize,
    /// In the world \[m\].
    pub position: Point2<f64>,
    /// Probability of each class.
    pub classes: Vec<f64>,
    /// How many detections it has.
    pub sightings: usize,
}

/// A Gaussian of (pose, calibration, landmarks), given one assignment of all detections.
///
/// The error of the pose is a step in its own frame: pose · exp(step).
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// `world_from_robot`.
    pub pose: Pose,
    /// Forward scale, turn scale, curvature \[rad/m\].
    pub calibration: Vector3<f64>,
    /// The map.
    pub landmarks: Vec<Tracked>,
    covariance: DMatrix<f64>,
    /// ln p(all detections up to now, under these assignments).
    pub log_likelihood: f64,
    /// Index of its past.
    pub past: Option<usize>,
    next_id: usize,
}

/// A continuation of a hypothesis: an assignment of the detections of a frame.
#[derive(Clone, Debug)]
pub struct Branch {
    /// For each detection the index of its landmark in the hypothesis; `None` if it is a new one.
    pub landmarks: Vec<Option<usize>>,
    /// Log-likelihood of the continued hypothesis.
    pub log_likelihood: f64,
    /// Pose after the update.
    pub pose: Pose,
}

/// The pairs of a frame, as the update of the filter takes them.
struct Pairs {
    /// Detection, landmark and prediction of each.
    pairs: Vec<(usize, usize, Prediction)>,
    /// Measured less predicted, two numbers a pair.
    innovation: DVector<f64>,
    /// The factor of its covariance H Σ Hᵀ + R.
    factor: Cholesky<f64, nalgebra::Dyn>,
}

impl Hypothesis {
    /// The state before the first detection, with the robot at the world's origin.
    pub fn start() -> Self {
        let calibration = Vector3::from(CALIBRATION_SIGMAS).map(|sigma| sigma * sigma);
        let mut covariance = DMatrix::zeros(FIRST_LANDMARK, FIRST_LANDMARK);
        covariance.fixed_view_mut::<3, 3>(3, 3).set_diagonal(&calibration);
        Self {
            pose: Pose::IDENTITY,
            calibration: Vector3::from(Odometry::CALIBRATED),
            landmarks: Vec::new(),
            covariance,
            log_likelihood: 0.0,
            past: None,
            next_id: 0,
        }
    }

    /// The index of the landmark with a number; `None` if it does not exist or was forgotten.
    pub fn place(&self, number: usize) -> Option<usize> {
        self.landmarks.iter().position(|landmark| landmark.id == number)
    }

    /// The covariance of pose, calibration, and the landmarks at some places, in this order.
    pub fn covariance_of(&self, landmarks: &[usize]) -> DMatrix<f64> {
        let of_landmarks = landmarks.iter().flat_map(|place| [0, 1].map(|axis| FIRST_LANDMARK + 2 * place + axis));
        let rows: Vec<usize> = (0..FIRST_LANDMARK).chain(of_landmarks).collect();
        self.covariance.select_rows(&rows).select_columns(&rows)
    }

    /// Moves the robot by calibrated odometry.
    pub fn predict(&mut self, model: &SensorModel<'_>, keyframe: &Keyframe) {
        let (twist, by_calibration) = Odometry::calibrated(keyframe.twist, self.calibration);
        let moved = Pose::exp(twist);
        let by_pose = moved.inverse().adjoint();
        let by_calibration = Pose::exp_jacobian(twist) * by_calibration;
        let noise = motion_variances(model.sensors.odometry.variances(&keyframe.motion));
        self.pose = self.pose * moved;
        let covariance = &mut self.covariance;
        let rows = by_pose * covariance.fixed_rows::<3>(0) + by_calibration * covariance.fixed_rows::<3>(3);
        let own = rows.fixed_columns::<3>(0) * by_pose.transpose()
            + rows.fixed_columns::<3>(3) * by_calibration.transpose()
            + Matrix3::from_diagonal(&noise);
        covariance.fixed_rows_mut::<3>(0).copy_from(&rows);
        covariance.fixed_columns_mut::<3>(0).copy_from(&rows.transpose());
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&own);
    }

    /// The covariance of pose and landmark `a` in the rows with pose and landmark `b` in the columns.
    fn joint(&self, a: usize, b: usize) -> SMatrix<f64, 5, 5> {
        let (a, b) = (FIRST_LANDMARK + 2 * a, FIRST_LANDMARK + 2 * b);
        let mut joint = SMatrix::<f64, 5, 5>::zeros();
        joint.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.covariance.fixed_view::<3, 3>(0, 0));
        joint.fixed_view_mut::<3, 2>(0, 3).copy_from(&self.covariance.fixed_view::<3, 2>(0, b));
        joint.fixed_view_mut::<2, 3>(3, 0).copy_from(&self.covariance.fixed_view::<2, 3>(a, 0));
        joint.fixed_view_mut::<2, 2>(3, 3).copy_from(&self.covariance.fixed_view::<2, 2>(a, b));
        joint
    }

    /// The most likely continuations, by the joint density of the frame under H Σ Hᵀ + R, the classes, and `log_new`, the
    /// log-density of a new landmark.
    pub fn branches(&self, model: &SensorModel<'_>, seen: &[Detection], log_new: f64, count: usize) -> Vec<Branch> {
        let predictions: Vec<_> =
            self.landmarks.iter().map(|landmark| model.predict(self.pose, landmark.position)).collect();
        let covariances: Vec<Option<Matrix2<f64>>> = predictions
            .iter()
            .enumerate()
            .map(|(place, prediction)| {
                let derivative = derivative(prediction.as_ref()?);
                Some(derivative * self.joint(place, place) * derivative.transpose())
            })
            .collect();
        let table = Table::new(vec![log_new; seen.len()], self.landmarks.len(), |detection, place| {
            let (Some(prediction), Some(covariance)) = (&predictions[place], covariances[place]) else {
                return f64::NEG_INFINITY;
            };
            let fit =
                Fit::new(model, &seen[detection], prediction, covariance).filter(|fit| fit.squared <= GATE * GATE);
            fit.map_or(f64::NEG_INFINITY, |fit| {
                fit.log_density + model.class_log_likelihood(&self.landmarks[place].classes, seen[detection].class)
            })
        });
        let assignments = best_assignments(&table, count, BRANCH_MARGIN).into_iter();
        assignments.filter_map(|assignment| self.branch(model, seen, log_new, assignment.landmarks)).collect()
    }

    fn branch(
        &self,
        model: &SensorModel<'_>,
        seen: &[Detection],
        log_new: f64,
        landmarks: Vec<Option<usize>>,
    ) -> Option<Branch> {
        let mut log_likelihood = self.log_likelihood;
        for (detection, place) in landmarks.iter().enumerate() {
            log_likelihood += place.map_or(log_new, |place| {
                model.class_log_likelihood(&self.landmarks[place].classes, seen[detection].class)
            });
        }
        let mut pose = self.pose;
        if let Some(pairs) = self.pairs(model, seen, &landmarks)? {
            let whitened = pairs.factor.l_dirty().solve_lower_triangular(&pairs.innovation)?;
            let log_determinant: f64 = pairs.factor.l_dirty().diagonal().iter().map(|root| root.ln()).sum();
            log_likelihood -=
                0.5 * whitened.norm_squared() + log_determinant + pairs.pairs.len() as f64 * std::f64::consts::TAU.ln();
            let cross = self.cross(&pairs, 3);
            let step = cross * pairs.factor.solve(&pairs.innovation);
            pose = pose * Pose::exp(step.fixed_rows::<3>(0).into_owned());
        }
        Some(Branch { landmarks, log_likelihood, pose })
    }

    /// The pairs of an assignment; `Some(None)` if it has none, and `None` if their covariance is not positive definite.
    fn pairs(&self, model: &SensorModel<'_>, seen: &[Detection], landmarks: &[Option<usize>]) -> Option<Option<Pairs>> {
        let mut pairs = Vec::new();
        for (detection, place) in landmarks.iter().enumerate() {
            if let Some(place) = *place {
                pairs.push((detection, place, model.predict(self.pose, self.landmarks[place].position)?));
            }
        }
        if pairs.is_empty() {
            return Some(None);
        }
        let mut innovation = DVector::zeros(2 * pairs.len());
        let mut covariance = DMatrix::zeros(2 * pairs.len(), 2 * pairs.len());
        for (row, (detection, a, prediction)) in pairs.iter().enumerate() {
            let by_a = derivative(prediction);
            for (column, (_, b, other)) in pairs.iter().enumerate().take(row + 1) {
                let block = by_a * self.joint(*a, *b) * derivative(other).transpose();
                covariance.fixed_view_mut::<2, 2>(2 * row, 2 * column).copy_from(&block);
                covariance.fixed_view_mut::<2, 2>(2 * column, 2 * row).copy_from(&block.transpose());
            }
            let own = covariance.fixed_view::<2, 2>(2 * row, 2 * row).into_owned();
            let seen = &seen[*detection];
            let Fit { noise, .. } = Fit::new(model, seen, prediction, own)?;
            covariance.fixed_view_mut::<2, 2>(2 * row, 2 * row).copy_from(&(own + Matrix2::from_diagonal(&noise)));
            innovation.fixed_rows_mut::<2>(2 * row).copy_from(&prediction.innovation(seen.range, seen.bearing));
        }
        Some(Some(Pairs { pairs, innovation, factor: Cholesky::new(covariance)? }))
    }

    /// Σ Hᵀ: the first `rows` rows.
    fn cross(&self, pairs: &Pairs, rows: usize) -> DMatrix<f64> {
        let mut cross = DMatrix::zeros(rows, 2 * pairs.pairs.len());
        for (column, (_, place, prediction)) in pairs.pairs.iter().enumerate() {
            let by_pose = self.covariance.view((0, 0), (rows, 3)) * prediction.by_pose.transpose();
            let landmark = FIRST_LANDMARK + 2 * place;
            let by_point = self.covariance.view((0, landmark), (rows, 2)) * prediction.by_point.transpose();
            cross.columns_mut(2 * column, 2).copy_from(&(by_pose + by_point));
        }
        cross
    }

    /// Follows an assignment: updates the filter and the classes, and adds new landmarks. Returns the number of the landmark of
    /// each detection.
    pub fn follow(&mut self, model: &SensorModel<'_>, seen: &[Detection], landmarks: &[Option<usize>]) -> Vec<usize> {
        if let Some(Some(pairs)) = self.pairs(model, seen, landmarks) {
            self.update(&pairs);
        }
        let mut ids = Vec::with_capacity(seen.len());
        for (seen, place) in seen.iter().zip(landmarks) {
            let place = place.unwrap_or_else(|| self.add(model, seen));
            let landmark = &mut self.landmarks[place];
            landmark.sightings += 1;
            for (class, share) in landmark.classes.iter_mut().enumerate() {
                *share *= model.confusion(class, seen.class);
            }
            let sum: f64 = landmark.classes.iter().sum();
            landmark.classes.iter_mut().for_each(|share| *share /= sum);
            ids.push(landmark.id);
        }
        while self.landmarks.len() > MAX_LANDMARKS {
            self.forget_least();
        }
        ids
    }

    fn update(&mut self, pairs: &Pairs) {
        let cross = self.cross(pairs, self.covariance.nrows());
        // Σ - W Wᵀ with W = Σ Hᵀ L⁻ᵀ stays symmetric.
        let Some(whitened) = pairs.factor.l_dirty().solve_lower_triangular(&cross.transpose()) else { return };
        let step = &cross * pairs.factor.solve(&pairs.innovation);
        self.covariance.gemm_tr(-1.0, &whitened, &whitened, 1.0);
        self.pose = self.pose * Pose::exp(step.fixed_rows::<3>(0).into_owned());
        self.calibration += step.fixed_rows::<3>(3);
        for (place, landmark) in self.landmarks.iter_mut().enumerate() {
            landmark.position += step.fixed_rows::<2>(FIRST_LANDMARK + 2 * place);
        }
    }

    /// Adds a landmark at the position of a detection; returns its index.
    fn add(&mut self, model: &SensorModel<'_>, seen: &Detection) -> usize {
        let position = model.position(self.pose, seen);
        let before = self.covariance.nrows();
        let covariance = std::mem::replace(&mut self.covariance, DMatrix::zeros(0, 0));
        let mut covariance = covariance.resize(before + 2, before + 2, 0.0);
        // The landmark is where its prediction agrees with the detection: by_pose dx + by_point dl = noise.
        let derivatives = model.predict(self.pose, position).and_then(|prediction| {
            let by_measurement = prediction.by_point.try_inverse()?;
            Some((-by_measurement * prediction.by_pose, by_measurement))
        });
        if let Some((by_pose, by_measurement)) = derivatives {
            let rows = by_pose * covariance.view((0, 0), (3, before));
            let noise = Matrix2::from_diagonal(&model.variances(seen));
            let own = rows.columns(0, 3) * by_pose.transpose() + by_measurement * noise * by_measurement.transpose();
            covariance.view_mut((before, 0), (2, before)).copy_from(&rows);
            covariance.view_mut((0, before), (before, 2)).copy_from(&rows.transpose());
            covariance.view_mut((before, before), (2, 2)).copy_from(&own);
        }
        self.covariance = covariance;
        let classes = vec![1.0 / model.classes() as f64; model.classes()];
        self.landmarks.push(Tracked { id: self.next_id, position, classes, sightings: 0 });
        self.next_id += 1;
        self.landmarks.len() - 1
    }

    /// Forgets the landmark that was seen least, of equal ones the oldest.
    fn forget_least(&mut self) {
        let least = self.landmarks.iter().enumerate().min_by_key(|(_, landmark)| landmark.sightings);
        let Some(place) = least.map(|(place, _)| place) else { return };
        self.landmarks.remove(place);
        let covariance = std::mem::replace(&mut self.covariance, DMatrix::zeros(0, 0));
        let first = FIRST_LANDMARK + 2 * place;
        self.covariance = covariance.remove_rows(first, 2).remove_columns(first, 2);
    }
}

/// Derivative of a prediction by the steps of pose and landmark.
fn derivative(prediction: &Prediction) -> SMatrix<f64, 2, 5> {
    let mut derivative = SMatrix::<f64, 2, 5>::zeros();
    derivative.fixed_view_mut::<2, 3>(0, 0).copy_from(&prediction.by_pose);
    derivative.fixed_view_mut::<2, 2>(0, 3).copy_from(&prediction.by_point);
    derivative
}

/// How well a detection fits a landmark.
struct Fit {
    /// The squared distance between the two \[standard deviations\].
    squared: f64,
    /// Variances of the detection. Beyond [`LOSS_SCALE`] standard deviations they grow with the square of the distance, so
    /// that an outlier does not pull.
    noise: Vector2<f64>,
    /// Its log-density with this noise.
    log_density: f64,
}

impl Fit {
    /// `predicted` is the covariance of the prediction; `None` if it is not positive definite.
    fn new(
        model: &SensorModel<'_>,
        seen: &Detection,
        prediction: &Prediction,
        predicted: Matrix2<f64>,
    ) -> Option<Self> {
        let innovation = prediction.innovation(seen.range, seen.bearing);
        let distance = |covariance: Matrix2<f64>| Some((covariance.try_inverse()? * innovation).dot(&innovation));
        let mut noise = model.variances(seen);
        let squared = distance(predicted + Matrix2::from_diagonal(&noise))?;
        noise *= (squared / (LOSS_SCALE * LOSS_SCALE)).max(1.0);
        let covariance = predicted + Matrix2::from_diagonal(&noise);
        let log_density =
            -0.5 * distance(covariance)? - 0.5 * covariance.determinant().ln() - std::f64::consts::TAU.ln();
        Some(Self { squared, noise, log_density })
    }
}
