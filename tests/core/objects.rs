//! Lines and objects together: places that are alike to a laser.

use ipslam::config::SlamConfig;
use ipslam::geometry::StampedPose;
use ipslam::metrics::trajectory::reference_errors;
use ipslam::objects::Detections;
use ipslam::pipeline::{Outcome, Run};
use ipslam::simulate::{Laser, OdometryNoise, Simulation, SimulationConfig, camera, look_alike_wings};
use ipslam::slam::Slam;

fn number(name: &str, default: f64) -> f64 {
    std::env::var(name).ok().and_then(|t| t.parse().ok()).unwrap_or(default)
}

#[test]
fn explore() {
    let (first, last) = (number("FIRST", 1.0) as u64, number("LAST", 1.0) as u64);
    for seed in first..=last {
        let plan = look_alike_wings(seed);
        let (classes, objects) = (plan.classes.clone(), plan.objects.clone());
        let laser = Laser { max_range: number("RANGE", 81.91), ..Laser::default() };
        let odometry = OdometryNoise::default().scaled(number("NOISE", 1.0));
        let config = SimulationConfig { seed, laser, odometry, ..SimulationConfig::default() };
        let simulation = Simulation::new("wings".to_owned(), plan, config).unwrap();
        let sensors = camera(&classes);
        let frames = simulation.frames(&sensors);
        let detections = Detections { sensors, frames };
        let truth: Vec<StampedPose> = simulation.truth().collect();
        for with in [false, true] {
            let n = number("MAPS", 32.0) as usize;
            let slam_config =
                SlamConfig { maps: n, particles: n * number("PER", 1.0) as usize, ..SlamConfig::default() };
            let slam = Slam::new(slam_config);
            let mut slam = if with { slam.detecting(detections.clone()) } else { slam };
            let began = std::time::Instant::now();
            let run = Run { smoothing: Some(slam_config.smoother()), ..Run::of(&simulation) };
            let Outcome { result, counts, .. } = run.run(&mut slam, &mut [], &mut |_| true).unwrap();
            let errors = reference_errors(&truth, &result.trajectory()).absolute.unwrap();
            let odo = reference_errors(&truth, &result.odometry()).absolute.unwrap();
            let sure: Vec<_> = result.landmarks.iter().filter(|l| l.is_sure()).collect();
            if std::env::var("TRACE").is_ok() {
                let first = truth[0].pose;
                let found = result.trajectory();
                for at in truth.iter().step_by(50) {
                    let Some(f) = found.iter().find(|f| f.stamp == at.stamp) else { continue };
                    let off = f.pose.seen_from(at.pose.seen_from(first));
                    println!(
                        "  {:.1} s at {:.1} {:.1}: off {:.2} {:.2} {:.3}",
                        at.stamp, at.pose.x, at.pose.y, off.x, off.y, off.heading
                    );
                }
            }
            println!(
                "seed {seed} objects {with}: rmse {:.3} max {:.3} odometry {:.2}; steps {}, loops {}/{}, landmarks {} of {} objects; {:.1} s",
                errors.rmse,
                errors.max,
                odo.rmse,
                counts.steps,
                result.loops.iter().filter(|l| l.is_closed).count(),
                result.loops.len(),
                sure.len(),
                objects.len(),
                began.elapsed().as_secs_f64()
            );
        }
    }
}
