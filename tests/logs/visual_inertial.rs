//! A camera with an inertial sensor on a real flight, scored by its true poses.

use crate::needs::data_folder;
use assert_cmd::cargo::cargo_bin;
use ipslam::io::datasets::imu_tracks;
use ipslam::metrics::space::space_errors;
use ipslam::visual_inertial::estimate;
use std::path::Path;
use std::process::Command;

/// GTSAM with combined inertial and smart projection factors and the same time between keyframes is 0.021 m and 0.45° off.
fn half_a_minute_of_euroc() {
    let (recording, truth) = imu_tracks::read(&data_folder().join("semantic/vio_v101_30s")).unwrap();
    let stamps = || recording.frames.iter().map(|frame| frame.stamp);
    let found = estimate(&recording).unwrap().trajectory(&recording, stamps());
    let errors = space_errors(&truth, &found).unwrap();
    let (position, rotation) = (errors.position.rmse, errors.rotation.rmse.to_degrees());
    println!("{} poses, {position:.4} m, {rotation:.3}°", errors.position.count);
    assert!(errors.position.count > 550, "{errors:?}");
    assert!(position <= 0.025 && rotation <= 0.6, "{position} m, {rotation}°");
}

/// The same by the program, from a folder of plain files.
fn the_program_tells_the_way() {
    let place = tempfile::tempdir().unwrap();
    let (folder, out) = (place.path().join("euroc"), place.path().join("out"));
    let ipslam = |args: &[&Path]| {
        let done = Command::new(cargo_bin("ipslam")).args(args).output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    };
    ipslam(&[Path::new("convert"), &data_folder().join("semantic/vio_v101_30s"), &folder]);
    ipslam(&[Path::new("semantic"), &folder, Path::new("--out"), &out]);
    let text = std::fs::read_to_string(out.join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&text).unwrap();
    let error = |name: &str| summary["rms_error"][name].as_f64().unwrap();
    assert!(error("position") <= 0.025 && error("rotation").to_degrees() <= 0.6, "{summary:#}");
    let poses = ipslam::io::tum::read3(&out.join("trajectory.tum")).unwrap();
    assert!(poses.len() > 550 && poses.len() as u64 == summary["poses"].as_u64().unwrap());
    let picture = std::fs::read_to_string(out.join("map.svg")).unwrap();
    assert!(picture.contains("true path") && out.join("map.png").is_file());
}

crate::needs::trials! {
    "visual_inertial":
    Data { half_a_minute_of_euroc, the_program_tells_the_way }
}
