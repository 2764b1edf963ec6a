//! Objects beside lines: landmarks and poses against formulas of one dimension, and places that are alike to a laser.

use ipslam::config::SlamConfig;
use ipslam::detections::{Detection, Frame, Sensors};
use ipslam::geometry::{Pose, StampedPose};
use ipslam::metrics::trajectory::reference_errors;
use ipslam::objects::{Detections, Landmark, Objects};
use ipslam::pipeline::Run;
use ipslam::report::RunResult;
use ipslam::scan::Scan;
use ipslam::simulate::{Laser, Simulation, SimulationConfig, camera, look_alike_wings};
use ipslam::slam::Slam;
use nalgebra::{Matrix2, Matrix3, Point2};

fn sensors() -> Sensors {
    Sensors::new(["door", "chair"].map(str::to_owned).to_vec(), 0.9)
}

/// An object straight ahead, at these ranges, a frame a second; each is a step of a robot that stands.
fn seen_ahead(detections: &[(usize, f64)]) -> Objects {
    let seen = |(class, range): (usize, f64)| Detection { class, score: 1.0, range, bearing: 0.0 };
    let frame = |(number, &detection): (usize, &(usize, f64))| Frame {
        stamp: number as f64,
        detections: vec![seen(detection)],
    };
    let frames = detections.iter().enumerate().map(frame).collect();
    let mut objects = Objects::new(Detections { sensors: sensors(), frames });
    for step in 0..detections.len() {
        objects.follow(step as f64, Pose::IDENTITY);
        objects.observe(step as u32, step, Pose::IDENTITY, &Scan::default()).unwrap();
    }
    objects
}

/// The mean of independent measurements, and of their labels the posterior by Bayes' rule.
#[test]
fn a_landmark_is_the_mean_of_its_detections() {
    let objects = seen_ahead(&[(1, 2.1), (1, 2.0), (0, 1.9), (1, 2.04)]);
    let landmarks = objects.mapped(|_| Pose::new(1.0, 2.0, 0.0)).landmarks;
    let [Landmark { position, covariance, classes, existence, sightings }] = &landmarks[..] else {
        panic!("{} landmarks", landmarks.len())
    };
    // Weights are below 1 by the share of clutter, a wrong label included.
    assert!((position.x - 3.01).abs() < 2e-3 && (position.y - 2.0).abs() < 1e-9, "{position}");
    assert!((covariance.m11 / (0.01 / 4.0) - 1.0).abs() < 0.02, "{covariance}");
    assert!((classes[1] - 0.9f64.powi(2) / (0.9f64.powi(2) + 0.1f64.powi(2))).abs() < 0.01, "{classes:?}");
    assert!(*existence > 0.99 && (3.8..4.0).contains(sightings), "{existence} {sightings}");
}

/// What is in view and not seen again was none; in which nobody looks stays.
#[test]
fn what_is_missed_goes() {
    let (frame, empty) = (
        |stamp| Frame { stamp, detections: vec![Detection { class: 0, score: 1.0, range: 2.0, bearing: 0.0 }] },
        |stamp| Frame { stamp, detections: Vec::new() },
    );
    let walls: Vec<Point2<f64>> = (-50..=50).map(|y| Point2::new(2.1, 0.02 * f64::from(y))).collect();
    let left = |points: &[Point2<f64>]| {
        let frames = vec![frame(0.0), empty(1.0), empty(2.0)];
        let mut objects = Objects::new(Detections { sensors: sensors(), frames });
        let scan = Scan { points: points.to_vec(), ..Scan::default() };
        for step in 0..3 {
            objects.follow(f64::from(step), Pose::IDENTITY);
            objects.observe(step, step as usize, Pose::IDENTITY, &scan).unwrap();
        }
        objects.mapped(|_| Pose::IDENTITY).landmarks.len()
    };
    assert_eq!((left(&walls), left(&[])), (0, 1));
    let nearer: Vec<Point2<f64>> = walls.iter().map(|wall| wall * 0.5).collect();
    assert_eq!(left(&nearer), 1, "it is hidden");
}

/// Two measurements of one number: the motion, and the landmark ahead.
#[test]
fn a_pose_goes_where_the_landmark_fits() {
    let objects = seen_ahead(&[(0, 1.9)]);
    let landmark = Landmark {
        position: Point2::new(5.0, 3.0),
        covariance: Matrix2::identity() * 0.02f64.powi(2),
        classes: vec![1.0, 0.0],
        existence: 0.99,
        sightings: 9.0,
    };
    // It looks along y, and the landmark is 2 m ahead.
    let mode = Pose::new(5.0, 1.0, std::f64::consts::FRAC_PI_2);
    let information = Matrix3::from_diagonal(&[0.05f64, 0.01, 0.01].map(|sigma| sigma.powi(-2)).into());
    let (fitted, found) = objects.fitted(&[landmark], &objects.observations()[0], mode, &information).unwrap();
    let (motion, detection) = (0.05f64.powi(2), 0.1f64.powi(2) + 0.02f64.powi(2));
    let expected = 0.1 * motion / (motion + detection);
    assert!((fitted.y - 1.0 - expected).abs() < 0.01 * expected, "{fitted:?} and not {expected} m ahead");
    assert!((fitted.x - 5.0).abs() < 1e-9 && (fitted.heading - mode.heading).abs() < 1e-9, "{fitted:?}");
    assert!((found[(0, 0)] / (1.0 / motion + 1.0 / detection) - 1.0).abs() < 0.01, "{found}");
    assert!(objects.fitted(&[], &objects.observations()[0], mode, &information).is_none());
}

fn run(simulation: &Simulation, detections: Option<Detections>) -> RunResult {
    let config = SlamConfig::default();
    let slam = Slam::new(config);
    let mut slam = match detections {
        Some(detections) => slam.detecting(detections),
        None => slam,
    };
    let run = Run { smoothing: Some(config.smoother()), ..Run::of(simulation) };
    run.run(&mut slam, &mut [], &mut |_| true).unwrap().result
}

/// A laser that reaches 5 m sees two bare walls along the corridor, and one wing is like another: lines alone take the second for
/// the first, and close a loop that is none. Doors, chairs and plants stand otherwise there.
#[test]
fn objects_tell_wings_apart_that_are_alike_to_lines() {
    const SEED: u64 = 4;
    let plan = look_alike_wings(SEED);
    let (sensors, count) = (camera(&plan.classes), plan.objects.len());
    let laser = Laser { max_range: 5.0, ..Laser::default() };
    let config = SimulationConfig { seed: SEED, laser, ..SimulationConfig::default() };
    let simulation = Simulation::new("wings".to_owned(), plan, config).unwrap();
    let truth: Vec<StampedPose> = simulation.truth().collect();
    let error = |result: &RunResult| reference_errors(&truth, &result.trajectory()).absolute.unwrap().rmse;
    let closed = |result: &RunResult| result.loops.iter().filter(|found| found.is_closed).count();

    let lines = run(&simulation, None);
    let frames = simulation.frames(&sensors);
    let both = run(&simulation, Some(Detections { sensors, frames }));
    let objects = both.objects.as_ref().unwrap();
    println!(
        "seed {SEED}: lines {:.2} m, {} loops; with objects {:.2} m, {} loops, {} objects of {count}",
        error(&lines),
        closed(&lines),
        error(&both),
        closed(&both),
        objects.landmarks.len()
    );
    assert!(lines.objects.is_none() && error(&lines) > 4.0 && closed(&lines) > 0, "lines alone would do");
    assert!(error(&both) < 2.5 && closed(&both) == 0, "{} m", error(&both));
    assert!((count - 5..=count + 3).contains(&objects.landmarks.len()), "{} of {count}", objects.landmarks.len());
}
