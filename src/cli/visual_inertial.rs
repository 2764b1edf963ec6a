//! `ipslam semantic` of a folder without detections: a camera's tracks and inertial readings in; trajectory and a summary out.

use super::output::Outputs;
use super::say::print_line;
use anyhow::Context as _;
use ipslam::geometry::{Pose3, StampedPose, StampedPose3};
use ipslam::io::semantic::{DETECTIONS, truth};
use ipslam::io::{tum, visual_inertial as recordings};
use ipslam::metrics::space::{SpaceErrors, space_errors};
use ipslam::picture::{Line, PNG_SIDE, Picture, View, svg_to_png};
use ipslam::visual_inertial;
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// Whether a folder holds inertial readings and no detections.
pub fn is_recording(folder: &Path) -> bool {
    folder.join(recordings::IMU).is_file() && !folder.join(DETECTIONS).is_file()
}

/// Estimates the way and writes the outputs.
pub fn estimate(folder: &Path, name: &str, outputs: &mut Outputs) -> anyhow::Result<()> {
    let recording = recordings::read(folder)?;
    let began = Instant::now();
    let found = visual_inertial::estimate(&recording).with_context(|| folder.display().to_string())?;
    let seconds = began.elapsed().as_secs_f64();
    let trajectory = found.trajectory(&recording, recording.frames.iter().map(|frame| frame.stamp));
    let truth = Some(folder.join(truth::TRAJECTORY)).filter(|path| path.is_file());
    let reference = truth.map(|path| tum::read3(&path)).transpose()?.unwrap_or_default();
    let errors = space_errors(&reference, &trajectory);

    let trajectory_path = outputs.stage("trajectory.tum");
    outputs.note(tum::write3(&trajectory_path, &trajectory));
    draw(name, &trajectory, &reference, errors.as_ref(), outputs);
    let last = found.states.last().map(|state| state.bias);
    let summary = json!({
        "recording": name,
        "seconds": seconds,
        "inertial_readings": recording.imu.len(),
        "pictures": recording.frames.len(),
        "keyframes": found.states.len(),
        "poses": trajectory.len(),
        "converged": found.solution.converged,
        "bias": last.map(|bias| json!({
            "rate": bias.rate.as_slice(),
            "force": bias.force.as_slice(),
        })),
        "rms_error": errors.map(|errors| json!({
            "position": errors.position.rmse,
            "rotation": errors.rotation.rmse,
        })),
    });
    outputs.write("summary.json", format!("{summary:#}\n").as_bytes());
    outputs.finish();
    let score = errors.map_or_else(String::new, |errors| {
        let degrees = errors.rotation.rmse.to_degrees();
        format!("; rms error {:.3} m, {degrees:.2}°", errors.position.rmse)
    });
    let verdict =
        if found.solution.converged { "" } else { "; doubtful: the search for the likeliest way has not converged" };
    print_line!(
        "{} poses from {} pictures and {} inertial readings, {} keyframes, {seconds:.1} s{score}{verdict}",
        trajectory.len(),
        recording.frames.len(),
        recording.imu.len(),
        found.states.len(),
    );
    Ok(())
}

/// The way seen from above.
fn draw(
    name: &str,
    trajectory: &[StampedPose3],
    reference: &[StampedPose3],
    errors: Option<&SpaceErrors>,
    outputs: &mut Outputs,
) {
    let world_from_reference = errors.map_or_else(Pose3::identity, |errors| errors.reference_from_world.inverse());
    let path = from_above(trajectory, Pose3::identity());
    let mut reference = from_above(reference, world_from_reference);
    if let (Some(first), Some(last)) = (path.first(), path.last()) {
        reference.retain(|pose| (first.stamp..=last.stamp).contains(&pose.stamp));
    }
    let mut picture = Picture::new(name).view(View::around([&path[..], &reference[..]], &[], None)).trajectory(
        "path, from above",
        Line::ESTIMATE,
        &path,
    );
    if !reference.is_empty() {
        picture = picture.trajectory("true path", Line::REFERENCE, &reference);
    }
    let svg = picture.to_svg();
    outputs.write("map.svg", svg.as_bytes());
    match svg_to_png(&svg, PNG_SIDE) {
        Ok(png) => outputs.write("map.png", &png),
        Err(error) => outputs.note(Err(error)),
    }
}

fn from_above(path: &[StampedPose3], world_from_path: Pose3) -> Vec<StampedPose> {
    let moved = |&StampedPose3 { stamp, pose }: &StampedPose3| StampedPose3 { stamp, pose: world_from_path * pose };
    path.iter().map(|pose| moved(pose).from_above()).collect()
}
