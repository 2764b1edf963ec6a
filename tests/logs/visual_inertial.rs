//! A camera with an inertial sensor on a real flight, scored by its true poses.

use crate::needs::data_folder;
use ipslam::io::datasets::imu_tracks;
use ipslam::metrics::space::space_errors;
use ipslam::visual_inertial::estimate;

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

crate::needs::trials! {
    "visual_inertial":
    Data { half_a_minute_of_euroc }
}
