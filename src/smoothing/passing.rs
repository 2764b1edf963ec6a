//! How many beams of a scan go through the clusters of a map.

use super::POSITION_SIGMA;
use crate::ppca::Cluster;
use nalgebra::Point2;

/// The beams from the laser to these points that go through each cluster.
pub(super) fn passing(map: &[Cluster], laser: Point2<f64>, points: &[Point2<f64>]) -> Vec<u32> {
    let reach = points.iter().map(|point| (point - laser).norm()).fold(0.0, f64::max);
    let through = |cluster: &Cluster| {
        if cluster.may_be_within(reach, laser) { passing_one(cluster, laser, points) } else { 0 }
    };
    map.iter().map(through).collect()
}

/// A beam goes through a cluster that it meets within a standard deviation of the centre, because where a wall ends nobody
/// knows to the centimetre, and that it leaves behind by three standard deviations, of the cluster across and of the robot.
fn passing_one(cluster: &Cluster, laser: Point2<f64>, points: &[Point2<f64>]) -> u32 {
    let margin = 3.0 * (cluster.across_variance + POSITION_SIGMA.powi(2)).sqrt();
    let half = cluster.along_variance.sqrt();
    let before = cluster.normal().dot(&(laser - cluster.mean));
    if before.abs() <= margin {
        // Along a wall beams tell nothing.
        return 0;
    }
    // The laser's side is the positive one.
    let (normal, before) = (cluster.normal() * before.signum(), before.abs());
    let goes_through = |point: &&Point2<f64>| {
        let after = normal.dot(&(*point - cluster.mean));
        if after >= -margin {
            return false;
        }
        let met = laser + (*point - laser) * (before / (before - after));
        cluster.direction.dot(&(met - cluster.mean)).abs() <= half
    };
    points.iter().filter(goes_through).count() as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    /// A wall of 4 m from (10, 3) to (10, 7), of which √(4/3) = 1.15 m either way are within a standard deviation; three
    /// standard deviations across are 0.15 m.
    #[test]
    fn beams_go_through_the_middle_of_a_wall() {
        let wall = Cluster {
            mean: Point2::new(10.0, 5.0),
            direction: Vector2::y(),
            along_variance: 16.0 / 12.0,
            across_variance: 0.04 * 0.04,
            count: 100.0,
        };
        for (laser, point, expected) in [
            ([8.0, 5.0], [10.0, 5.0], 0),
            ([8.0, 5.0], [10.14, 5.0], 0),
            ([8.0, 5.0], [10.16, 5.0], 1),
            ([12.0, 5.0], [9.84, 5.0], 1),
            ([12.0, 5.0], [9.86, 5.0], 0),
            ([8.0, 8.1], [12.0, 4.1], 1),
            ([8.0, 8.2], [12.0, 4.2], 0),
            ([8.0, 3.9], [12.0, 3.9], 1),
            ([8.0, 3.8], [12.0, 3.8], 0),
            ([10.1, 4.0], [9.0, 6.0], 0),
            ([8.0, 5.0], [6.0, 5.0], 0),
        ] {
            let (laser, point) = (Point2::from(laser), Point2::from(point));
            assert_eq!(passing(&[wall], laser, &[point]), [expected], "from {laser} to {point}");
        }
        let far = Cluster { mean: Point2::new(10.0, 50.0), ..wall };
        let points = [[10.0, 5.0], [12.0, 5.0], [12.0, 5.1]].map(Point2::from);
        assert_eq!(passing(&[far, wall], Point2::new(8.0, 5.0), &points), [0, 2]);
    }
}
