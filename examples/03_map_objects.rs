//! Detections in, a map of objects out: `cargo run --release --example 03_map_objects [FOLDER]`.
//!
//! Maps the objects of a recording (`docs/formats.md`), or of a drive past trees and cars that is made up here; prints the
//! objects, and the detection that is in most doubt.

use ipslam::detections::{Detection, Frame, Odometry, Recording, Sensors, Velocity, View};
use ipslam::geometry::Pose;
use ipslam::io::semantic::read;
use ipslam::semantic::{SemanticConfig, SemanticMap, map};
use nalgebra::Point2;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let recording = match std::env::args_os().nth(1) {
        Some(folder) => read(folder.as_ref())?.recording,
        None => drive(),
    };

    let found: SemanticMap = map(&recording, &SemanticConfig::default(), &|_| ())?;

    let classes = &recording.sensors.classes;
    println!("{} objects from {} detections:", found.landmarks.len(), found.detections);
    for landmark in &found.landmarks {
        let (class, share) = (landmark.class(), 100.0 * landmark.classes[landmark.class()]);
        let sigma = landmark.covariance.trace().sqrt();
        let Point2 { coords: at } = landmark.position;
        println!("{:8} ({share:5.1} %) at ({:6.2}, {:6.2}), known to {sigma:.2} m", classes[class], at.x, at.y);
    }

    // Σ over landmarks of a detection's weights is 1, less the probability that it is clutter.
    let mut shown: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for weight in &found.weights {
        shown.entry((weight.frame, weight.detection)).or_default().push((weight.landmark, weight.weight));
    }
    let most = |weights: &Vec<(usize, f64)>| weights.iter().map(|(_, weight)| *weight).fold(0.0, f64::max);
    if let Some(((frame, _), weights)) = shown.iter().min_by(|a, b| most(a.1).total_cmp(&most(b.1))) {
        println!("most in doubt, at {:.1} s: (landmark, weight) {weights:.2?}", recording.frames[*frame].stamp);
    }
    match found.verdict.doubts().as_slice() {
        [] => println!("nothing speaks against this map"),
        doubts => println!("doubtful: {}", doubts.join("; ")),
    }
    Ok(())
}

/// Two rounds of a circle of 5 m; odometry tells a tenth too much of both way and turn, and every ninth label is wrong.
fn drive() -> Recording {
    let mut sensors = Sensors::new(vec!["tree".to_owned(), "car".to_owned()], 0.9);
    sensors.view = View { max_range: 6.0, min_bearing: -1.2, max_bearing: 1.2, ..View::default() };
    let (mut frames, mut seen_before) = (Vec::new(), 0);
    for step in 0..250 {
        let angle = 2.0 * TAU * f64::from(step) / 250.0;
        let world_from_robot = Pose::new(5.0 * angle.sin(), 5.0 - 5.0 * angle.cos(), angle);
        let mut detections = Vec::new();
        // The last one stands beside the first.
        for object in 0..10 {
            let (sin, cos) = (TAU * f64::from(object) / 9.0).sin_cos();
            let radius = if object == 9 { 7.3 } else { 7.0 };
            let seen = world_from_robot.inverse() * Point2::new(radius * cos, 5.0 + radius * sin);
            let (range, bearing) = (seen.coords.norm(), seen.y.atan2(seen.x));
            if sensors.view.holds(range, bearing) {
                seen_before += 1;
                let class = (object as usize + usize::from(seen_before % 9 == 0)) % 2;
                detections.push(Detection { class, score: 1.0, range, bearing });
            }
        }
        frames.push(Frame { stamp: 0.5 * f64::from(step), detections });
    }
    let (turn, forward) = (2.0 * TAU / 125.0, 10.0 * TAU / 125.0);
    let speed = Velocity { stamp: 0.0, forward: 1.1 * forward, turn: 1.1 * turn };
    Recording { sensors, odometry: Odometry::Velocities(vec![speed]), frames }
}
