//! Objects are mapped, recorded, and mapped again from the recording.
use ipslam::config::SemanticConfig;
use ipslam::detections::{Detection, Detection3, Frame, Odometry, Odometry3, Recording, Recording3, Sensors, Sensors3};
use ipslam::detections::{Velocity, Velocity3, View};
use ipslam::geometry::{Pinhole, Pose};
use ipslam::io::semantic as recordings;
use ipslam::record::rerun::read::Store;
use ipslam::record::rerun::semantic::{self, Mapping, RecordedMapping};
use ipslam::semantic::{SemanticMap, Space, map};
use nalgebra::{Point2, Point3, UnitQuaternion, Vector3};
use rerun::components::{LineStrip2D, Position2D};
use rerun::{ChunkStore, ChunkStoreConfig, Component, ComponentDescriptor, LineStrips2D, Points2D, StoreKind};
use std::path::Path;
use std::process::{Command, Output};

/// Ten objects of two classes round a circle that the robot drives once and a half.
fn recording() -> Recording {
    let mut sensors = Sensors::new(["tree", "car"].map(str::to_owned).to_vec(), 0.9);
    sensors.view = View { max_range: 5.0, min_bearing: -1.4, max_bearing: 1.4, ..View::default() };
    let frame = |step: u32| {
        let angle = 0.1 * f64::from(step);
        let pose = Pose::new(3.0 * angle.sin(), 3.0 - 3.0 * angle.cos(), angle);
        let object = |number: u32| {
            let (sin, cos) = (0.628 * f64::from(number)).sin_cos();
            let seen = pose.inverse() * Point2::new(4.5 * cos, 3.0 + 4.5 * sin);
            // Errors of a few centimetres that repeat nowhere.
            let off = 0.05 * f64::from((step * 7 + number * 5) % 11) / 11.0;
            Detection {
                class: number as usize % 2,
                score: 1.0,
                range: seen.coords.norm() + off,
                bearing: seen.y.atan2(seen.x),
            }
        };
        let seen = (0..10).map(object).filter(|seen| sensors.view.holds(seen.range, seen.bearing));
        Frame { stamp: 0.5 * f64::from(step), detections: seen.collect() }
    };
    let frames = (0..95).map(frame).collect();
    let odometry = Odometry::Velocities(vec![Velocity { stamp: 0.0, forward: 0.62, turn: 0.2 }]);
    Recording { sensors, odometry, frames }
}

fn ipslam(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ipslam")).current_dir(folder).args(args).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn recorded(folder: &Path, change: impl FnOnce(&mut SemanticMap)) -> (Recording, SemanticMap) {
    let recording = recording();
    let config = SemanticConfig { beam: 4, ..SemanticConfig::default() };
    let mut found = map(&recording, &config, &|_| ()).unwrap();
    change(&mut found);
    let mapping = Mapping { name: "circle", recording: &recording, objects: None, config, map: &found };
    semantic::record(&folder.join("circle.rrd"), mapping).unwrap();
    (recording, found)
}

/// All values of a component that a path of a recording holds, in the order of a timeline.
fn rows<C: Component>(
    path: &Path,
    entity: &str,
    timeline: &'static str,
    descriptor: &ComponentDescriptor,
) -> Vec<(i64, Vec<C>)> {
    let mut file = std::fs::File::open(path).unwrap();
    let stores = ChunkStore::from_rrd_reader(&ChunkStoreConfig::ALL_DISABLED, &mut file).unwrap();
    let (_, store) = stores.iter().find(|(id, _)| id.kind() == StoreKind::Recording).unwrap();
    let mut rows = Vec::new();
    for chunk in store.iter_physical_chunks().filter(|chunk| chunk.entity_path() == &entity.into()) {
        let times = chunk.iter_component_indices(timeline.into(), descriptor.component);
        let values = chunk.iter_component::<C>(descriptor.component);
        rows.extend(times.zip(values).map(|((time, _), values)| (time.as_i64(), values.as_slice().to_vec())));
    }
    rows.sort_by_key(|(time, _)| *time);
    rows
}

#[test]
fn a_recording_holds_the_mapping() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, found) = recorded(folder.path(), |_| ());
    let path = folder.path().join("circle.rrd");
    let read: RecordedMapping = RecordedMapping::new(Store::open(&path).unwrap()).unwrap();
    assert_eq!(read.recording, recording);
    assert_eq!(read.poses, found.keyframes.iter().map(|keyframe| keyframe.pose).collect::<Vec<_>>());
    assert_eq!((read.result.checksum, &read.checksums), (found.checksum(), &found.history.checksums()));
    assert_eq!(read.config.beam, 4);
    assert!(found.landmarks.len() == 10 && found.weights.len() > 200, "{:?}", found.runs);

    let last = (found.history.candidates.len() + found.history.sweeps.len()) as i64;
    let landmarks: Vec<(i64, Vec<Position2D>)> =
        rows(&path, semantic::LANDMARKS, "step", &Points2D::descriptor_positions());
    let (step, shown) = landmarks.last().unwrap();
    assert_eq!((*step, shown.len(), landmarks.len()), (last, 10, found.history.sweeps.len() + 1));
    for (shown, landmark) in shown.iter().zip(&found.landmarks) {
        let apart = Point2::new(f64::from(shown.x()), f64::from(shown.y())) - landmark.position;
        assert!(apart.norm() < 1e-5, "{apart}");
    }
    // The links of all frames are all weights, and each ends at its landmark.
    let strips = LineStrips2D::descriptor_strips();
    let links: Vec<(i64, Vec<LineStrip2D>)> = rows(&path, semantic::FRAME_WEIGHTS, "frame", &strips);
    let links: Vec<LineStrip2D> = links.into_iter().flat_map(|(_, links)| links).collect();
    assert_eq!(links.len(), found.weights.len());
    let ends =
        links.iter().filter_map(|link| link.0.last()).map(|end| Point2::new(f64::from(end.x()), f64::from(end.y())));
    for end in ends {
        assert!(found.landmarks.iter().any(|landmark| (landmark.position - end).norm() < 1e-5), "{end}");
    }
}

#[test]
fn a_replay_is_the_mapping_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    recordings::write(&folder.path().join("circle"), &recording()).unwrap();
    let done = ipslam(folder.path(), &["semantic", "circle", "--record", "circle.rrd"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let done = ipslam(folder.path(), &["replay", "circle.rrd", "--verify", "--threads", "1"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("identical bit for bit"), "{}", text(&done.stdout));

    // With other settings it is another mapping: compared, not verified.
    std::fs::write(folder.path().join("max.toml"), "association = \"max\"\nsweeps = 3\n").unwrap();
    let done = ipslam(folder.path(), &["replay", "circle.rrd", "--config", "max.toml", "--json"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let compared: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(compared["recorded"]["settings"]["association"], "soft");
    assert_eq!(compared["replayed"]["settings"]["sweeps"], 3);
    assert_eq!(compared["first_step_that_differs"], 95, "the forward pass is the same: {compared}");
    assert!(compared["trajectories_apart_m"]["max"].as_f64().unwrap() < 0.05, "{compared}");
    assert!(folder.path().join("ipslam-out/circle-replayed-2/replay.rrd").is_file());

    let done = ipslam(folder.path(), &["replay", "circle.rrd", "--seed", "3"]);
    assert!(!done.status.success() && text(&done.stderr).contains("--config"), "{}", text(&done.stderr));
    let done = ipslam(folder.path(), &["semantic", "circle", "--record", "circle/detections.csv"]);
    assert!(text(&done.stderr).contains("record to another one"), "{}", text(&done.stderr));
}

/// A camera that turns round six posts; z is ahead.
fn recording3() -> Recording3 {
    let camera = Pinhole { focal: [300.0; 2], centre: [320.0, 240.0] };
    let mut sensors = Sensors3::new(["tree", "car"].map(str::to_owned).to_vec(), 0.9, camera, 0.4);
    sensors.robot_from_camera.rotation = UnitQuaternion::from_euler_angles(0.3, -0.2, 0.1);
    let frame = |step: u32| {
        let turn = UnitQuaternion::from_euler_angles(0.0, 0.08 * f64::from(step), 0.0);
        let object = |number: u32| {
            let (sin, cos) = (1.05 * f64::from(number)).sin_cos();
            let in_world = Point3::new(4.0 * sin, 0.3 * f64::from(number) - 0.7, 4.0 * cos);
            let seen = sensors.robot_from_camera.inverse() * (turn.inverse() * in_world);
            // Errors of a pixel or so that repeat nowhere.
            let off = f64::from((step * 7 + number * 5) % 11) / 11.0;
            let pixel = [300.0 * seen.x / seen.z + 320.0 + off, 300.0 * seen.y / seen.z + 240.0 - off];
            let is_seen = seen.z > 0.5 && pixel.iter().all(|number| (0.0..640.0).contains(number));
            is_seen.then_some(Detection3 { class: number as usize % 2, score: 1.0, pixel, disparity: 120.0 / seen.z })
        };
        Frame { stamp: 0.5 * f64::from(step), detections: (0..6).filter_map(object).collect() }
    };
    let frames = (0..90).map(frame).collect();
    let (linear, angular) = (Vector3::zeros(), Vector3::new(0.0, 0.16, 0.0));
    let odometry = Odometry3::Velocities(vec![Velocity3 { stamp: 0.0, linear, angular }]);
    Recording3 { sensors, odometry, frames }
}

#[test]
fn a_replay_in_space_is_the_mapping_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    recordings::write3(&folder.path().join("posts"), &recording3()).unwrap();
    let done = ipslam(folder.path(), &["semantic", "posts", "--beam", "4", "--record", "posts.rrd"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let path = folder.path().join("posts.rrd");
    let read = RecordedMapping::<Space>::new(Store::open(&path).unwrap()).unwrap();
    assert_eq!(read.recording, recording3());
    assert!(read.result.landmarks == 6 && read.poses.len() > 80, "{:?}", read.result);
    let seen: Vec<(i64, Vec<Position2D>)> =
        rows(&path, semantic::CAMERA_SEEN, "frame", &Points2D::descriptor_positions());
    let landmarks: Vec<(i64, Vec<Position2D>)> =
        rows(&path, semantic::CAMERA_LANDMARKS, "frame", &Points2D::descriptor_positions());
    assert!(seen.len() == read.poses.len() && landmarks.len() == seen.len());
    // Each object is seen where its landmark is.
    for ((_, seen), (_, landmarks)) in seen.iter().zip(&landmarks) {
        assert_eq!(seen.len(), landmarks.len());
        let near = |a: &Position2D, b: &Position2D| (a.x() - b.x()).hypot(a.y() - b.y()) < 6.0;
        assert!(
            seen.iter().all(|seen| landmarks.iter().any(|landmark| near(seen, landmark))),
            "{seen:?} {landmarks:?}"
        );
    }
    let done = ipslam(folder.path(), &["replay", "posts.rrd", "--verify"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("identical bit for bit"), "{}", text(&done.stdout));
}

#[test]
fn a_replay_of_known_objects_knows_them() {
    let folder = tempfile::tempdir().unwrap();
    let recording = recording();
    recordings::write(&folder.path().join("circle"), &recording).unwrap();
    // Nobody knows what the first detection of each frame shows.
    let id = |(number, seen): (usize, &Detection)| (number > 0).then_some(seen.class as u64);
    let ids: Vec<Vec<_>> =
        recording.frames.iter().map(|frame| frame.detections.iter().enumerate().map(id).collect()).collect();
    let path = folder.path().join("ids.csv");
    recordings::truth::write_ids(&path, &recording.frames, &ids).unwrap();
    let done = ipslam(folder.path(), &["semantic", "circle", "--known-ids", "ids.csv", "--record", "known.rrd"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let read: RecordedMapping = RecordedMapping::new(Store::open(&folder.path().join("known.rrd")).unwrap()).unwrap();
    assert_eq!(read.objects, Some(ids));
    let done = ipslam(folder.path(), &["replay", "known.rrd", "--verify"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
}

#[test]
fn a_replay_finds_the_step_that_differs() {
    let folder = tempfile::tempdir().unwrap();
    let verify = || ipslam(folder.path(), &["replay", "circle.rrd", "--verify"]);
    recorded(folder.path(), |found| found.history.candidates[7][0].log_likelihood += 1e-9);
    let error = text(&verify().stderr);
    assert!(error.contains("step 7: the hypotheses"), "{error}");
    recorded(folder.path(), |found| found.history.sweeps[2].poses[4].x += 1e-12);
    let error = text(&verify().stderr);
    assert!(error.contains("step 97: sweep 2"), "{error}");
    recorded(folder.path(), |found| found.weights[3].weight -= 1e-12);
    let error = text(&verify().stderr);
    assert!(error.contains("the result differs"), "{error}");
    recorded(folder.path(), |_| ());
    assert!(verify().status.success());
}
