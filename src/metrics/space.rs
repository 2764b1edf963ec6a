//! Errors of a trajectory of space against reference poses, after alignment (Umeyama, "Least-squares estimation of
//! transformation parameters between two point patterns", IEEE TPAMI 13(4), 1991, without scale).

use super::{ErrorStats, SAME_STAMP};
use crate::geometry::{Pose3, StampedPose3};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Errors of all poses whose stamps are in both lists.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpaceErrors {
    /// The alignment: takes the trajectory's world to that of the reference.
    pub reference_from_world: Pose3,
    /// Distances of the positions \[m\].
    pub position: ErrorStats,
    /// Angles between the orientations \[rad\].
    pub rotation: ErrorStats,
}

/// Compares a trajectory with a reference; the stamps of both rise. None where no stamp is in both, or a position is not
/// finite.
pub fn space_errors(reference: &[StampedPose3], trajectory: &[StampedPose3]) -> Option<SpaceErrors> {
    let counterpart = |found: &StampedPose3| {
        let place = reference.partition_point(|pose| pose.stamp < found.stamp - SAME_STAMP);
        let near = reference.get(place).filter(|pose| pose.stamp <= found.stamp + SAME_STAMP)?;
        Some((near.pose, found.pose))
    };
    let pairs: Vec<(Pose3, Pose3)> = trajectory.iter().filter_map(counterpart).collect();
    let reference_from_world = align(&pairs)?;
    let aligned = |&(reference, found): &(Pose3, Pose3)| (reference, reference_from_world * found);
    let distance = |(reference, found): (Pose3, Pose3)| (found.position - reference.position).norm();
    let angle = |(reference, found): (Pose3, Pose3)| found.rotation.angle_to(&reference.rotation);
    let position = ErrorStats::of(&pairs.iter().map(aligned).map(distance).collect::<Vec<_>>())?;
    let rotation = ErrorStats::of(&pairs.iter().map(aligned).map(angle).collect::<Vec<_>>())?;
    Some(SpaceErrors { reference_from_world, position, rotation })
}

/// The rigid motion that takes the second positions of the pairs closest to the first ones, in least squares.
fn align(pairs: &[(Pose3, Pose3)]) -> Option<Pose3> {
    let mean = |position: fn(&(Pose3, Pose3)) -> Vector3<f64>| {
        pairs.iter().map(position).sum::<Vector3<f64>>() / pairs.len() as f64
    };
    let (reference, found) = (mean(|pair| pair.0.position.coords), mean(|pair| pair.1.position.coords));
    let centred = |(a, b): &(Pose3, Pose3)| (a.position.coords - reference) * (b.position.coords - found).transpose();
    let covariance: Matrix3<f64> = pairs.iter().map(centred).sum();
    if pairs.is_empty() || !covariance.iter().all(|number| number.is_finite()) {
        return None;
    }
    let svd = covariance.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    // A reflection would fit better still; the least singular value pays for it.
    let signs = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * signs * v_t));
    Some(Pose3::new((reference - rotation * found).into(), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Vector6};

    /// The oracle: a path that is moved as a whole, and one pose of it by a known error.
    #[test]
    fn errors_are_those_that_were_put_in() {
        let moved = Pose3::exp(Vector6::new(3.0, -2.0, 1.0, 0.4, 2.0, -0.7));
        let mut reference = Vec::new();
        for step in 0..40 {
            let t = f64::from(step);
            let position = Point3::new((0.3 * t).sin(), 0.1 * t, (0.2 * t).cos());
            let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.02 * t, 0.5, -0.1));
            reference.push(StampedPose3 { stamp: 0.5 * t, pose: Pose3::new(position, rotation) });
        }
        let mut found = reference.clone();
        found.iter_mut().for_each(|found| found.pose = moved.inverse() * found.pose);
        found.push(StampedPose3 { stamp: 99.0, pose: Pose3::identity() });
        let errors = space_errors(&reference, &found).unwrap();
        assert_eq!(errors.position.count, 40);
        assert!(errors.position.max < 1e-12 && errors.rotation.max < 1e-7, "{errors:?}");
        assert!(errors.reference_from_world.seen_from(moved).log().norm() < 1e-12);
        found[7].pose = found[7].pose * Pose3::exp(Vector6::new(0.0, 0.0, 0.0, 0.0, 0.25, 0.0));
        found[9].pose.position.x += 0.01;
        let errors = space_errors(&reference, &found).unwrap();
        assert!((errors.rotation.max - 0.25).abs() < 2e-3, "{errors:?}");
        assert!((errors.position.max - 0.01).abs() < 1e-3, "{errors:?}");
        assert!(space_errors(&reference, &[]).is_none());
    }
}
