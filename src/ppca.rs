//! Probabilistic PCA: the model of one cluster (III-A of the paper).
//!
//! A cluster explains points of the plane (d = 2) by one latent number (q = 1): z = W ζ + μ + ε, so that
//! z ~ N(μ, C) with C = W Wᵀ + σ² I (eq. 6-10). At the maximum of the likelihood μ is the mean of the points,
//! W = u₁ (λ₁ - σ²)^½ and σ² = λ₂ (eq. 11-13), λ and u being the eigenvalues and -vectors of the points' covariance.
//!
//! | paper | here |
//! |---|---|
//! | μ | `mean` |
//! | u₁ | `direction` |
//! | λ₁ | `along_variance` |
//! | σ² = λ₂ | `across_variance` |
//! | N | `count` |

use crate::geometry::Pose;
use nalgebra::{Matrix2, Point2, Vector2};

/// Points of the plane summarised by a PPCA model: a Gaussian that is long along a wall and thin across it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cluster {
    /// Centre μ \[m\], in the frame that the owner names.
    pub mean: Point2<f64>,
    /// Principal direction u₁, of length one; its sign has no meaning.
    pub direction: Vector2<f64>,
    /// Variance λ₁ along the direction \[m²\], at least `across_variance`.
    pub along_variance: f64,
    /// Variance σ² = λ₂ across the direction \[m²\].
    pub across_variance: f64,
    /// How many points it stands for; not a whole number once points were shared out softly.
    pub count: f64,
}

/// Sums that determine a cluster; they add up where clusters merge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// Sum of the weights.
    pub count: f64,
    /// Weighted mean \[m\].
    pub mean: Vector2<f64>,
    /// Weighted sum of (z - mean)(z - mean)ᵀ \[m²\].
    pub scatter: Matrix2<f64>,
}

impl Default for Moments {
    fn default() -> Self {
        Self { count: 0.0, mean: Vector2::zeros(), scatter: Matrix2::zeros() }
    }
}

impl Moments {
    /// Adds one point with a weight (Welford's update, which does not cancel far from the origin).
    pub fn add(&mut self, point: Point2<f64>, weight: f64) {
        if weight <= 0.0 {
            return;
        }
        self.count += weight;
        let before = point.coords - self.mean;
        self.mean += before * (weight / self.count);
        let after = point.coords - self.mean;
        self.scatter += before * after.transpose() * weight;
    }

    /// The moments of both sets of points together.
    pub fn union(&self, other: &Self) -> Self {
        let count = self.count + other.count;
        if count <= 0.0 {
            return *self;
        }
        let apart = other.mean - self.mean;
        Self {
            count,
            mean: self.mean + apart * (other.count / count),
            scatter: self.scatter + other.scatter + apart * apart.transpose() * (self.count * other.count / count),
        }
    }

    /// The maximum-likelihood cluster of these points (eq. 11-13), or `None` without points.
    pub fn fit(&self) -> Option<Cluster> {
        if self.count <= 0.0 || !self.count.is_finite() {
            return None;
        }
        let (direction, along_variance, across_variance) = principal_axes(&(self.scatter / self.count));
        Some(Cluster { mean: self.mean.into(), direction, along_variance, across_variance, count: self.count })
    }
}

impl Cluster {
    /// The maximum-likelihood cluster of some points (eq. 11-13), or `None` of no points.
    pub fn fit(points: impl IntoIterator<Item = Point2<f64>>) -> Option<Self> {
        let mut moments = Moments::default();
        points.into_iter().for_each(|point| moments.add(point, 1.0));
        moments.fit()
    }

    /// A wall from `a` to `b`, known to `across` \[m\] and seen in `count` points that lie evenly along it: the variance along
    /// it is length² / 12.
    pub fn wall(a: impl Into<Point2<f64>>, b: impl Into<Point2<f64>>, across: f64, count: f64) -> Self {
        let (a, b) = (a.into(), b.into());
        let way = b - a;
        Self {
            mean: nalgebra::center(&a, &b),
            direction: way.normalize(),
            along_variance: way.norm_squared() / 12.0,
            across_variance: across * across,
            count,
        }
    }

    /// The moments of the points that this cluster stands for.
    pub fn moments(&self) -> Moments {
        Moments { count: self.count, mean: self.mean.coords, scatter: self.covariance() * self.count }
    }

    /// C = W Wᵀ + σ² I (eq. 10) \[m²\].
    pub fn covariance(&self) -> Matrix2<f64> {
        let normal = self.normal();
        self.direction * self.direction.transpose() * self.along_variance
            + normal * normal.transpose() * self.across_variance
    }

    /// The unit vector across the cluster.
    pub fn normal(&self) -> Vector2<f64> {
        Vector2::new(-self.direction.y, self.direction.x)
    }

    /// ln p(z) under N(μ, C) (eq. 9); the unit of p is 1/m².
    pub fn log_density(&self, point: Point2<f64>) -> f64 {
        let offset = point - self.mean;
        let (along, across) = (self.direction.dot(&offset), self.normal().dot(&offset));
        -std::f64::consts::TAU.ln()
            - 0.5 * (self.along_variance * self.across_variance).ln()
            - 0.5 * (along * along / self.along_variance + across * across / self.across_variance)
    }

    /// The same cluster in another frame, or moved: `world_from_robot` takes a cluster of the robot's frame to the
    /// world. PPCA is equivariant under rigid motion, so this equals fitting the moved points.
    pub fn transformed(&self, to_from: Pose) -> Self {
        Self { mean: to_from * self.mean, direction: to_from * self.direction, ..*self }
    }

    /// The same cluster with neither variance below a floor \[m²\]: a laser's noise keeps every real density finite.
    pub fn with_variance_floor(&self, floor: f64) -> Self {
        Self {
            along_variance: self.along_variance.max(floor),
            across_variance: self.across_variance.max(floor),
            ..*self
        }
    }

    /// Whether the wall stands between two points, beyond doubt: they are on either side of it, and the line between them
    /// meets it away from its ends, each by more than three standard deviations across, none of them less than
    /// `least_sigma` \[m\].
    pub fn separates(&self, one: Point2<f64>, other: Point2<f64>, least_sigma: f64) -> bool {
        let margin = 3.0 * self.across_variance.sqrt().max(least_sigma);
        let [one, other] = [one, other].map(|point| point - self.mean);
        let [a, b] = [one, other].map(|offset| self.normal().dot(&offset));
        if a * b >= 0.0 || a.abs().min(b.abs()) <= margin {
            return false;
        }
        let met = one.lerp(&other, a / (a - b));
        self.direction.dot(&met).abs() < 0.5 * self.length() - margin
    }

    /// Ends of the wall that the cluster stands for: √3 standard deviations either side of the centre, where a
    /// uniformly covered segment of the same variance ends.
    pub fn endpoints(&self) -> [Point2<f64>; 2] {
        let half = self.direction * (3.0 * self.along_variance).sqrt();
        [self.mean - half, self.mean + half]
    }

    /// Length of that wall \[m\].
    pub fn length(&self) -> f64 {
        (12.0 * self.along_variance).sqrt()
    }

    /// Whether some of that wall may be this close to a point \[m\]; false only where none is.
    pub fn may_be_within(&self, reach: f64, point: Point2<f64>) -> bool {
        (self.mean - point).norm() < reach + 0.5 * self.length()
    }

    /// The point of the cluster's line that explains a point best: projected to the latent line and back (Fig. 4d).
    pub fn reprojected(&self, point: Point2<f64>) -> Point2<f64> {
        self.mean + self.direction * self.direction.dot(&(point - self.mean))
    }
}

/// Eigenvectors and -values of a symmetric matrix: (u₁, λ₁, λ₂) with λ₁ ≥ λ₂ ≥ 0 and |u₁| = 1.
///
/// Closed form by the half angle, which is exact for axis-parallel matrices and for multiples of the identity.
pub fn principal_axes(symmetric: &Matrix2<f64>) -> (Vector2<f64>, f64, f64) {
    let (xx, xy, yy) = (symmetric.m11, 0.5 * (symmetric.m12 + symmetric.m21), symmetric.m22);
    let half_angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    let direction = Vector2::new(half_angle.cos(), half_angle.sin());
    let normal = Vector2::new(-direction.y, direction.x);
    let form = |v: Vector2<f64>| xx * v.x * v.x + 2.0 * xy * v.x * v.y + yy * v.y * v.y;
    (direction, form(direction).max(0.0), form(normal).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SymmetricEigen;
    use proptest::prelude::*;

    fn points() -> impl Strategy<Value = Vec<Point2<f64>>> {
        proptest::collection::vec((-5.0..5.0, -2.0..2.0).prop_map(|(x, y)| Point2::new(x + 0.5 * y, y)), 3..60)
    }

    /// The oracle: two-pass mean and covariance (eq. 12) and nalgebra's general eigen-decomposition.
    fn batch(points: &[Point2<f64>]) -> (Vector2<f64>, Matrix2<f64>) {
        let n = points.len() as f64;
        let mean = points.iter().map(|p| p.coords).sum::<Vector2<f64>>() / n;
        let covariance =
            points.iter().map(|p| (p.coords - mean) * (p.coords - mean).transpose()).sum::<Matrix2<f64>>() / n;
        (mean, covariance)
    }

    proptest! {
        #[test]
        fn fit_is_the_eigen_decomposition(points in points()) {
            let cluster = Cluster::fit(points.iter().copied()).unwrap();
            let (mean, covariance) = batch(&points);
            let mut eigenvalues = SymmetricEigen::new(covariance).eigenvalues;
            if eigenvalues[0] < eigenvalues[1] { eigenvalues.swap_rows(0, 1); }
            prop_assert!((cluster.mean.coords - mean).norm() < 1e-10);
            prop_assert!((cluster.along_variance - eigenvalues[0]).abs() < 1e-9, "{} {}", cluster.along_variance, eigenvalues[0]);
            prop_assert!((cluster.across_variance - eigenvalues[1]).abs() < 1e-9);
            prop_assert!((cluster.covariance() - covariance).norm() < 1e-9);
        }

        #[test]
        fn moments_of_a_union_are_those_of_all_points(a in points(), b in points()) {
            let of = |points: &[Point2<f64>]| points.iter().fold(Moments::default(), |mut m, &p| { m.add(p, 1.0); m });
            let all: Vec<_> = a.iter().chain(&b).copied().collect();
            let (mean, covariance) = batch(&all);
            let union = of(&a).union(&of(&b));
            prop_assert!((union.mean - mean).norm() < 1e-9);
            prop_assert!((union.scatter / union.count - covariance).norm() < 1e-9);
        }

        #[test]
        fn moved_cluster_is_the_cluster_of_moved_points(points in points(), x in -1e3..1e3, y in -1e3..1e3, heading in -3.0..3.0) {
            let pose = Pose::new(x, y, heading);
            let moved = Cluster::fit(points.iter().copied()).unwrap().transformed(pose);
            let refitted = Cluster::fit(points.iter().map(|&p| pose * p)).unwrap();
            prop_assert!((moved.mean - refitted.mean).norm() < 1e-8);
            prop_assert!((moved.covariance() - refitted.covariance()).norm() < 1e-7);
        }
    }

    /// Fit of an isotropic set is legal: any direction will do, and the variances are equal.
    #[test]
    fn a_square_has_equal_variances() {
        let square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| Point2::new(x, y));
        let cluster = Cluster::fit(square).unwrap();
        assert!((cluster.along_variance - 0.25).abs() < 1e-15 && (cluster.across_variance - 0.25).abs() < 1e-15);
        assert!(Cluster::fit([]).is_none());
    }

    /// A wall of 4 m along the y axis that is known to 1 cm, or to 20 cm.
    #[test]
    fn a_wall_separates_what_is_clearly_on_either_side_of_it() {
        let wall = |across: f64| Cluster {
            mean: Point2::new(10.0, 5.0),
            direction: Vector2::y(),
            along_variance: 16.0 / 12.0,
            across_variance: across * across,
            count: 100.0,
        };
        let separates = |across: f64, [ax, ay, bx, by]: [f64; 4]| {
            let (a, b) = (Point2::new(ax, ay), Point2::new(bx, by));
            let (one, other) = (wall(across).separates(a, b, 0.1), wall(across).separates(b, a, 0.1));
            assert_eq!(one, other, "either way the same");
            one
        };
        assert!(separates(0.01, [8.0, 5.0, 12.0, 5.0]) && separates(0.01, [9.69, 3.31, 10.31, 3.31]));
        // It meets the wall 1.65 m from its middle, but begins beyond its end.
        assert!(separates(0.01, [8.0, 8.65, 12.0, 4.65]));
        assert!(!separates(0.01, [8.0, 5.0, 9.0, 6.0]), "on one side");
        assert!(!separates(0.01, [9.71, 5.0, 12.0, 5.0]), "starts at the wall");
        assert!(!separates(0.01, [8.0, 5.0, 10.29, 5.0]), "ends at the wall");
        assert!(!separates(0.01, [8.0, 6.75, 12.0, 6.75]) && !separates(0.01, [8.0, 3.25, 12.0, 3.25]), "near an end");
        assert!(!separates(0.01, [10.0, 1.0, 10.0, 9.0]), "along it");
        assert!(separates(0.2, [9.3, 5.0, 10.7, 5.0]), "three standard deviations");
        assert!(!separates(0.2, [9.5, 5.0, 12.0, 5.0]) && !separates(0.2, [8.0, 6.5, 12.0, 6.5]), "known badly");
    }

    /// Eq. 9 written out with the general inverse and determinant.
    #[test]
    fn log_density_is_the_gaussian() {
        let cluster =
            Cluster::fit([(0.0, 0.0), (1.0, 0.4), (2.0, 1.1), (3.0, 1.2)].map(|(x, y)| Point2::new(x, y))).unwrap();
        let covariance = cluster.covariance();
        for point in [Point2::new(0.3, -0.2), Point2::new(10.0, 7.0), cluster.mean] {
            let offset = point - cluster.mean;
            let form = (offset.transpose() * covariance.try_inverse().unwrap() * offset)[0];
            let expected = -(std::f64::consts::TAU * covariance.determinant().sqrt()).ln() - 0.5 * form;
            assert!((cluster.log_density(point) - expected).abs() < 1e-9 * (1.0 + expected.abs()));
        }
    }

    /// Data drawn from a known model give the model back.
    #[test]
    fn fit_recovers_the_model_that_made_the_data() {
        use crate::random::{Draw, normals};
        let (angle, along, across) = (0.7f64, 2.0, 0.05);
        let (u, v) = (Vector2::new(angle.cos(), angle.sin()), Vector2::new(-angle.sin(), angle.cos()));
        let count = 40_000;
        let cluster = Cluster::fit((0..count).map(|i| {
            let z = normals(11, 0, i, Draw::Motion);
            Point2::new(3.0, -4.0) + u * (along * f64::from(z[0])) + v * (across * f64::from(z[1]))
        }))
        .unwrap();
        // Standard errors: σ/√n of the mean, σ²√(2/n) of a variance, σ₂/(σ₁√n) of the angle; five of each.
        let n = f64::from(count);
        assert!((cluster.mean - Point2::new(3.0, -4.0)).norm() < 5.0 * along / n.sqrt(), "seed 11");
        assert!((cluster.along_variance / (along * along) - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
        assert!((cluster.across_variance / (across * across) - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
        assert!(cluster.direction.dot(&v).abs() < 5.0 * across / along / n.sqrt());
    }

    #[test]
    fn endpoints_are_those_of_a_uniform_segment() {
        let count = 10_001;
        let cluster =
            Cluster::fit((0..count).map(|i| Point2::new(4.0 * f64::from(i) / f64::from(count - 1), 1.0))).unwrap();
        let [a, b] = cluster.endpoints();
        assert!(((a - b).norm() - 4.0).abs() < 1e-3 && (cluster.length() - 4.0).abs() < 1e-3, "{a} {b}");
    }
}
