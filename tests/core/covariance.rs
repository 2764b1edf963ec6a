//! What is said of a pose against how far off it is, on simulated drives whose truth is known.

use crate::localization;
use ipslam::config::SlamConfig;
use ipslam::geometry::{Pose, StampedPose, wrap_angle};
use ipslam::localization::{InitialPose, Localization, LocalizationConfig};
use ipslam::log::LogEntry;
use ipslam::pipeline::Run;
use ipslam::report::{Estimate, Estimator as _};
use ipslam::simulate::{Simulation, SimulationConfig, building};
use ipslam::slam::Slam;
use nalgebra::{Matrix3, Vector2, Vector3};

/// The 95 % quantile of the χ² distribution of three degrees of freedom.
const CHI2_95_3DOF: f64 = 7.815;

/// Squared error of a pose, in units of its covariance: 3 on average where that is right.
fn normalised_square(covariance: &Matrix3<f64>, found: Pose, truth: Pose) -> f64 {
    let error = Vector3::new(found.x - truth.x, found.y - truth.y, wrap_angle(found.heading - truth.heading));
    assert!((covariance - covariance.transpose()).amax() < 1e-12, "{covariance}");
    error.dot(&covariance.cholesky().unwrap().solve(&error))
}

/// The motion that lays poses over others with the least squares of distance (in the plane Horn's method is one angle).
fn laid_over(poses: &[(Pose, Pose)]) -> Pose {
    let count = poses.len() as f64;
    let middle = |of: fn(&(Pose, Pose)) -> Pose| -> Vector2<f64> {
        poses.iter().map(|pair| of(pair).position().coords).sum::<Vector2<f64>>() / count
    };
    let (from, to) = (middle(|pair| pair.0), middle(|pair| pair.1));
    let turn = poses.iter().fold(Vector2::zeros(), |sum: Vector2<f64>, (a, b)| {
        let (a, b) = (a.position().coords - from, b.position().coords - to);
        sum + Vector2::new(a.dot(&b), a.perp(&b))
    });
    Pose::new(to.x, to.y, 0.0) * Pose::new(0.0, 0.0, turn.y.atan2(turn.x)) * Pose::new(-from.x, -from.y, 0.0)
}

/// Mean of the normalised squares, and the share below the quantile, of covariances times `factor`.
fn consistency(scans: &[(Estimate, Pose)], factor: f64) -> (f64, f64) {
    let pairs: Vec<(Pose, Pose)> =
        scans.iter().map(|(found, truth)| (found.world_from_robot.unwrap(), *truth)).collect();
    let over = laid_over(&pairs);
    let squares: Vec<f64> = scans
        .iter()
        .map(|(found, truth)| {
            let turn = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), over.heading).into_inner();
            let covariance = turn * found.covariance.unwrap() * turn.transpose() * factor;
            normalised_square(&covariance, over * found.world_from_robot.unwrap(), *truth)
        })
        .collect();
    let count = squares.len() as f64;
    let inside = squares.iter().filter(|square| **square < CHI2_95_3DOF).count() as f64 / count;
    (squares.iter().sum::<f64>() / count, inside)
}

/// The readings whose stamps have a true pose, one each.
fn with_truth(estimates: &[Estimate], truth: &[StampedPose]) -> Vec<(Estimate, Pose)> {
    let of = |truth: &StampedPose| {
        // The scan comes after the odometry of its stamp.
        let found = estimates.iter().rfind(|estimate| estimate.stamp == truth.stamp)?;
        Some((*found, truth.pose))
    };
    truth.iter().filter_map(of).collect()
}

/// Laid over the truth: how all of the map lies is no error of a pose in it.
#[test]
fn poses_of_mapping_are_as_far_off_as_they_say() {
    for seed in [1, 2] {
        let config = SimulationConfig { seed, duration: Some(60.0), ..SimulationConfig::default() };
        let simulation = Simulation::new("building".to_owned(), building(), config).unwrap();
        let config = SlamConfig { maps: 64, particles: 64, ..SlamConfig::default() };
        let run = Run { smoothing: Some(config.smoother()), ..Run::of(&simulation) };
        let result = run.run(&mut Slam::new(config), &mut [], &mut |_| true).unwrap().result;
        assert!(result.poses.iter().all(|estimate| estimate.covariance.is_some()));
        let scans = with_truth(&result.poses, &simulation.truth().collect::<Vec<_>>());
        assert_eq!(scans.len() as u64, simulation.sweeps());
        let (mean, inside) = consistency(&scans, 1.0);
        println!("seed {seed}: NEES {mean:.2}, {inside:.3} within 95 %");
        assert!((0.3..5.0).contains(&mean) && inside > 0.85, "seed {seed}: NEES {mean}, {inside} within 95 %");
        let [(small, few), (large, _)] = [1.0 / 16.0, 16.0].map(|factor| consistency(&scans, factor));
        assert!(small > 5.0 && few < 0.85, "covariances that are too small go unnoticed");
        assert!(large < 0.3, "covariances that are too large go unnoticed");
    }
}

/// In a known map nothing is laid over anything. Errors are about a fifth of the floor of what is said.
#[test]
fn poses_of_localisation_are_as_far_off_as_they_say() {
    let drive = localization::drive(1);
    let readings = &drive[drive.len() / 3..][..1500];
    let initial = InitialPose { world_from_robot: readings[0].1, position_sigma: 0.3, heading_sigma: 0.2 };
    let map = localization::MAP.clone();
    let mut filter = Localization::new(map, Some(initial), LocalizationConfig::default(), None).unwrap();
    let mut squares = Vec::new();
    for (entry, truth) in readings {
        filter.add(entry, &mut |_| {});
        let Some(found) = filter.result().poses.last().copied() else { continue };
        if let (LogEntry::Laser(_), Some(pose)) = (entry, found.relied_on()) {
            squares.push(normalised_square(&found.covariance.unwrap(), pose, *truth));
        }
    }
    let count = squares.len() as f64;
    let mean = squares.iter().sum::<f64>() / count;
    let inside = squares.iter().filter(|square| **square < CHI2_95_3DOF).count() as f64 / count;
    println!("{count} located scans: NEES {mean:.2}, {inside:.3} within 95 %");
    assert!(count > 500.0 && (0.01..3.0).contains(&mean) && inside > 0.95, "NEES {mean}, {inside} within 95 %");
    assert!(100.0 * mean > 3.0, "standard deviations of a tenth go unnoticed");
}
