//! The motion between two pictures, and which pairs of features agree with it.
//!
//! Where a camera sees the same point along b₁ in one picture and along b₂ in another, b₁ᵀ \[t\]ₓ R b₂ = 0 with R and t the
//! second camera's rotation and translation as seen from the first: the epipolar constraint. RANSAC (M. Fischler, R. Bolles,
//! CACM 24(6), 1981) finds R and the direction of t from five pairs at a time, by steps of Gauss and Newton (V. Lui,
//! T. Drummond, "An iterative 5-pt algorithm for fast and robust essential matrix estimation", BMVC 2013).

use crate::geometry::Pose3;
use crate::random::{Draw, bits, normals};
use nalgebra::{Matrix3x2, Matrix5, Point3, UnitQuaternion, Vector3, Vector5};

/// A pair whose distance from its epipolar line is larger, in standard deviations, is wrong: 95 % of the right ones are nearer.
const GATE: f64 = 1.96;
/// At most so many sets of five pairs are tried: enough to have one without wrong pairs in 99 % of the cases where 40 % are
/// right.
const TRIALS: u32 = 450;
/// A set without wrong pairs is found with this probability.
const CONFIDENCE: f64 = 0.99;
/// Steps until five pairs fit.
const STEPS: usize = 8;
/// Of those steps: far less than what a pair with a thousandth of a radian of parallax adds.
const DAMPING: f64 = 1e-9;
/// Steps with all pairs that agree.
const REFINEMENTS: usize = 10;
/// From one picture to the next a camera turns by less \[rad\]; the other solutions of a set of five turn by more.
const MAX_TURN: f64 = 0.8;

/// A point seen in two pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Where it is in the first picture, in the camera's plane z = 1.
    pub first: Point3<f64>,
    /// The same in the second.
    pub second: Point3<f64>,
    /// Standard deviation of both places, in each direction.
    pub sigma: f64,
}

/// A motion that pairs agree with.
#[derive(Clone, Debug, PartialEq)]
pub struct TwoView {
    /// The second camera as seen from the first; the distance, which pictures do not show, is 1.
    pub first_from_second: Pose3,
    /// Of each pair, whether it agrees.
    pub agrees: Vec<bool>,
}

/// The motion that most pairs agree with; none with less than eight pairs that do. `seed` and `step` name the draws.
pub fn relative_pose(pairs: &[Pair], seed: u64, step: u32) -> Option<TwoView> {
    const LEAST: usize = 8;
    if pairs.len() < LEAST {
        return None;
    }
    let (mut best, mut least, mut trials) = (None, f64::INFINITY, f64::from(TRIALS));
    for trial in 0..TRIALS {
        if f64::from(trial) >= trials {
            break;
        }
        let motion = draw(pairs, seed, step, trial).and_then(|five| Motion::of_five(&five, seed, step, trial));
        let Some(motion) = motion else { continue };
        let (cost, right) = motion.cost(pairs);
        if cost < least {
            (best, least) = (Some(motion), cost);
            let share = right as f64 / pairs.len() as f64;
            trials = ((1.0 - CONFIDENCE).ln() / (1.0 - share.powi(5)).ln()).max(1.0);
        }
    }
    let mut best = best?;
    for _ in 0..REFINEMENTS {
        let refined = best.refined(pairs)?;
        let cost = refined.cost(pairs).0;
        if cost >= least {
            break;
        }
        (best, least) = (refined, cost);
    }
    let best = best.with_points_ahead(pairs);
    let agrees: Vec<bool> = pairs.iter().map(|pair| best.error(pair).abs() < GATE && best.is_ahead(pair)).collect();
    let enough = agrees.iter().filter(|agrees| **agrees).count() >= LEAST;
    let first_from_second = Pose3::new(best.direction.into(), best.rotation);
    enough.then_some(TwoView { first_from_second, agrees })
}

/// Five different pairs.
fn draw(pairs: &[Pair], seed: u64, step: u32, trial: u32) -> Option<[Pair; 5]> {
    let words = [0, 1].map(|half| bits(seed, step, 2 * trial + half, Draw::Picture));
    let mut places = Vec::with_capacity(5);
    for word in words.into_iter().flatten() {
        let place = ((u64::from(word) * pairs.len() as u64) >> 32) as usize;
        if !places.contains(&place) {
            places.push(place);
        }
    }
    let five: Vec<Pair> = places.iter().take(5).map(|place| pairs[*place]).collect();
    five.try_into().ok()
}

/// R and the direction of t.
#[derive(Clone, Copy, Debug)]
struct Motion {
    rotation: UnitQuaternion<f64>,
    direction: Vector3<f64>,
}

impl Motion {
    /// Fits five pairs, from no turn and any direction.
    fn of_five(five: &[Pair; 5], seed: u64, step: u32, trial: u32) -> Option<Self> {
        let [x, y, z, _] = normals(seed ^ 1, step, trial, Draw::Picture).map(f64::from);
        let direction = Vector3::new(x, y, z).try_normalize(1e-9)?;
        let mut motion = Self { rotation: UnitQuaternion::identity(), direction };
        for _ in 0..STEPS {
            // A camera that only turned has no direction of motion: the damping holds any.
            let (mut hessian, mut gradient) = (Matrix5::identity() * DAMPING, Vector5::zeros());
            for pair in five {
                let (error, slope) = motion.linear(pair);
                hessian += slope * slope.transpose();
                gradient += slope * error;
            }
            motion = motion.moved(&-hessian.cholesky()?.solve(&gradient))?;
        }
        let fits = five.iter().all(|pair| motion.error(pair).abs() < 1.0);
        (fits && motion.rotation.angle() < MAX_TURN).then_some(motion)
    }

    /// b₁ᵀ \[t\]ₓ R b₂, and its derivative by steps of the rotation (in its own frame) and of the direction (on the sphere).
    fn linear(&self, Pair { first, second, .. }: &Pair) -> (f64, Vector5<f64>) {
        let turned = self.rotation * second.coords;
        let across = first.coords.cross(&self.direction);
        let by_rotation = second.coords.cross(&(self.rotation.inverse() * across));
        let by_direction = tangents(&self.direction).tr_mul(&turned.cross(&first.coords));
        let slope = [by_rotation.x, by_rotation.y, by_rotation.z, by_direction.x, by_direction.y];
        (across.dot(&turned), Vector5::from(slope))
    }

    fn moved(&self, step: &Vector5<f64>) -> Option<Self> {
        let rotation = self.rotation * UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
        let direction = self.direction + tangents(&self.direction) * step.fixed_rows::<2>(3);
        Some(Self { rotation, direction: direction.try_normalize(1e-9)? })
    }

    /// By what b₁ᵀ \[t\]ₓ R b₂ is divided to have unit variance, to first order (P. Sampson, CGIP 18, 1982).
    fn sigma(&self, Pair { first, second, sigma }: &Pair) -> f64 {
        let by_first = self.direction.cross(&(self.rotation * second.coords));
        let by_second = self.rotation.inverse() * first.coords.cross(&self.direction);
        sigma * by_first.xy().norm().hypot(by_second.xy().norm())
    }

    /// The distance from the epipolar lines, in standard deviations.
    fn error(&self, pair: &Pair) -> f64 {
        let sigma = self.sigma(pair);
        if sigma > 0.0 { self.linear(pair).0 / sigma } else { 0.0 }
    }

    /// The sum of squared errors, each at most that of the gate; and how many are below it.
    fn cost(&self, pairs: &[Pair]) -> (f64, usize) {
        let (mut cost, mut right) = (0.0, 0);
        for pair in pairs {
            let squared = self.error(pair).powi(2);
            cost += squared.min(GATE * GATE);
            right += usize::from(squared < GATE * GATE);
        }
        (cost, right)
    }

    /// One step with all pairs that agree.
    fn refined(&self, pairs: &[Pair]) -> Option<Self> {
        let (mut hessian, mut gradient) = (Matrix5::identity() * DAMPING, Vector5::zeros());
        for pair in pairs {
            let (error, slope) = self.linear(pair);
            let sigma = self.sigma(pair);
            if error.abs() < GATE * sigma {
                hessian += slope * slope.transpose() / (sigma * sigma);
                gradient += slope * error / (sigma * sigma);
            }
        }
        self.moved(&-hessian.cholesky()?.solve(&gradient))
    }

    /// Of t and -t, which the constraint does not tell apart, the one with more points ahead of both cameras.
    fn with_points_ahead(self, pairs: &[Pair]) -> Self {
        let back = Self { direction: -self.direction, ..self };
        let ahead = |motion: &Self| {
            let is_right = |pair: &&Pair| motion.error(pair).abs() < GATE && motion.is_ahead(pair);
            pairs.iter().filter(is_right).count()
        };
        if ahead(&back) > ahead(&self) { back } else { self }
    }

    /// Whether the rays meet ahead of both cameras, or far away, within the noise.
    fn is_ahead(&self, Pair { first, second, sigma }: &Pair) -> bool {
        // z₁ b₁ = t + z₂ R b₂, in least squares.
        let (one, other) = (first.coords, self.rotation * second.coords);
        let (aa, ab, bb) = (one.dot(&one), one.dot(&other), other.dot(&other));
        let (at, bt) = (one.dot(&self.direction), other.dot(&self.direction));
        let sine = aa * bb - ab * ab;
        let (first_depth, second_depth) = (bb * at - ab * bt, ab * at - aa * bt);
        // Rays that are parallel within three standard deviations meet anywhere.
        let parallel = sine < (3.0 * sigma).powi(2) * 2.0 * aa * bb;
        parallel || (first_depth > 0.0 && second_depth > 0.0)
    }
}

/// Two directions across a direction.
fn tangents(direction: &Vector3<f64>) -> Matrix3x2<f64> {
    let axis = if direction.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let one = direction.cross(&axis).normalize();
    Matrix3x2::from_columns(&[one, direction.cross(&one)])
}
