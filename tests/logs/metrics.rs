//! Errors of trajectories: known errors in, the same errors out; and real logs, where an independent program (written
//! in Python, beside the data) and the published figures say what should come out.

use crate::needs::data_folder;
use ipslam::geometry::{Pose, StampedPose};
use ipslam::io::relations::Relation;
use ipslam::io::{relations, tum};
use ipslam::metrics::PoseErrors;
use ipslam::metrics::relations::{RelationErrors, relation_errors};
use ipslam::metrics::trajectory::reference_errors;
use serde_json::Value;
use std::io::Read as _;
use std::path::Path;
use std::process::Command;

/// A drive of 60 s, ten poses a second, at 1 m/s, which turns and returns.
fn drive() -> Vec<StampedPose> {
    let mut pose = Pose::new(3.0, -2.0, 0.4);
    let step = |i: u32| Pose::new(0.1, 0.0, 0.05 * (f64::from(i) / 40.0).sin());
    let mut next = |i| {
        pose = pose * step(i);
        StampedPose { stamp: 1e9 + f64::from(i) / 10.0, pose }
    };
    (0..600).map(&mut next).collect()
}

/// The same drive told in another frame.
fn moved(trajectory: &[StampedPose]) -> Vec<StampedPose> {
    let other_from_world = Pose::new(-40.0, 70.0, 2.5);
    trajectory.iter().map(|at| StampedPose { pose: other_from_world * at.pose, ..*at }).collect()
}

/// True relations over 1 s and over 30 s.
fn true_relations(trajectory: &[StampedPose]) -> Vec<Relation> {
    let between = |a: &StampedPose, b: &StampedPose| Relation {
        first_stamp: a.stamp,
        second_stamp: b.stamp,
        first_from_second: a.pose.inverse() * b.pose,
    };
    let over = |steps: usize| trajectory.iter().zip(&trajectory[steps..]).map(move |(a, b)| between(a, b));
    over(10).chain(over(300)).collect()
}

#[track_caller]
fn assert_close(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((found - expected).abs() <= tolerance, "{what}: {found}, not {expected} (± {tolerance})");
}

fn a_trajectory_in_another_frame_has_no_error() {
    let (truth, relations) = (drive(), true_relations(&drive()));
    let largest = |trajectory: &[StampedPose]| {
        let by_relations = relation_errors(&relations, trajectory);
        let by_reference = reference_errors(&truth, trajectory);
        assert_eq!((by_relations.unmatched, by_reference.unmatched), (0, 0));
        let parts = [by_relations.local, by_relations.loop_closing, by_reference.relative_in_time];
        let parts = parts.into_iter().chain([by_reference.relative_in_path]).map(Option::unwrap);
        let mut errors: Vec<f64> = parts.flat_map(|part| [part.translation.max, part.rotation.max]).collect();
        errors.push(by_reference.absolute.unwrap().max);
        assert_eq!(errors.len(), 9);
        errors
    };
    for error in largest(&moved(&truth)) {
        assert_close(error, 0.0, 1e-9, "error of the moved trajectory");
    }
    // One pose moved and turned a little shows in every one of the errors.
    let mut perturbed = moved(&truth);
    perturbed[300].pose = perturbed[300].pose * Pose::new(1e-4, 1e-4, 1e-4);
    for error in largest(&perturbed) {
        assert!(error > 5e-5, "an error of 1e-4 counts as {error}");
    }
}

fn a_known_error_of_a_relation_comes_out() {
    let trajectory = drive();
    let mut relations = true_relations(&trajectory);
    relations.truncate(4);
    // The robot is found 0.3 m ahead and 0.4 m to the left of where relation 1 has it, turned by -0.2.
    relations[1].first_from_second = relations[1].first_from_second * Pose::new(0.3, 0.4, -0.2).inverse();
    relations[2].second_stamp = 5.0;
    let errors = relation_errors(&relations, &trajectory);
    assert_eq!((errors.relations, errors.unmatched, errors.loop_closing), (4, 1, None));
    let PoseErrors { translation, rotation } = errors.all.unwrap();
    assert_eq!((translation.count, errors.local), (3, errors.all));
    assert_close(translation.mean, 0.5 / 3.0, 1e-12, "mean");
    assert_close(translation.std, 0.5 * 2_f64.sqrt() / 3.0, 1e-12, "std");
    assert_close(translation.median, 0.0, 1e-9, "median");
    assert_close(translation.max, 0.5, 1e-12, "max");
    assert_close(rotation.max, 0.2, 1e-12, "rotation");
}

fn absolute_error_of_a_square_told_too_large() {
    // Alignment can only turn and shift: it puts one square into the middle of the other, and each corner, √2 m from
    // the middle, is then 10 % of that too far out.
    let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
    let square = |scale: f64| -> Vec<StampedPose> {
        let at = |(i, &(x, y)): (usize, &(f64, f64))| StampedPose {
            stamp: i as f64,
            pose: Pose::new(scale * x, scale * y, 0.0),
        };
        corners.iter().enumerate().map(at).collect()
    };
    let errors = reference_errors(&square(1.0), &moved(&square(1.1)));
    let absolute = errors.absolute.unwrap();
    assert_close(absolute.rmse, 0.1 * 2_f64.sqrt(), 1e-9, "rmse");
    assert_close(absolute.max, 0.1 * 2_f64.sqrt(), 1e-9, "max");
    let back = errors.reference_from_world * Pose::new(-40.0, 70.0, 2.5);
    assert_close(back.x.hypot(back.y).max(back.heading.abs()), 0.0, 1e-9, "alignment");
}

fn no_other_alignment_is_better() {
    let truth = drive();
    let bent: Vec<StampedPose> = moved(&truth)
        .iter()
        .map(|at| StampedPose { pose: Pose::new(at.pose.x + 1e-3 * at.pose.y.powi(2), at.pose.y, 0.0), ..*at })
        .collect();
    let errors = reference_errors(&truth, &bent);
    let rmse = |alignment: Pose| {
        let square =
            |(q, p): (&StampedPose, &StampedPose)| (alignment * p.pose.position() - q.pose.position()).norm_squared();
        (truth.iter().zip(&bent).map(square).sum::<f64>() / truth.len() as f64).sqrt()
    };
    let best = errors.absolute.unwrap().rmse;
    assert!(best > 0.01, "the bend does not show: {best}");
    assert_close(rmse(errors.reference_from_world), best, 1e-9, "rmse");
    for change in [(1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0), (0.0, 0.0, 1e-5)] {
        for sign in [-1.0, 1.0] {
            let other = Pose::new(sign * change.0, sign * change.1, sign * change.2) * errors.reference_from_world;
            assert!(rmse(other) > best, "{other:?} is better: {} < {best}", rmse(other));
        }
    }
}

fn relative_errors_of_known_drifts() {
    let straight = |scale: f64| -> Vec<StampedPose> {
        let at =
            |i: u32| StampedPose { stamp: f64::from(i) / 8.0, pose: Pose::new(scale * f64::from(i) / 8.0, 0.0, 0.0) };
        (0..240).map(at).collect()
    };
    // 1 m/s told 2 % too fast: 2 cm too far in 1 s and 20 cm in 10 m.
    let errors = reference_errors(&straight(1.0), &moved(&straight(1.02)));
    let (time, path) = (errors.relative_in_time.unwrap(), errors.relative_in_path.unwrap());
    assert_close(time.translation.median, 0.02, 1e-9, "in 1 s");
    assert_close(path.translation.median, 0.2, 1e-9, "in 10 m");
    // The last six poses have none even 0.75 s later, the last 60 none even 7.5 m on; the medians are of the others.
    assert_eq!((time.translation.count, path.translation.count), (234, 180));
    assert_close(time.rotation.max.max(path.rotation.max), 0.0, 1e-9, "rotation");

    // A robot that turns on the spot, whose turn is told 0.01 rad/s too fast.
    let turning = |rate: f64| -> Vec<StampedPose> {
        let at =
            |i: u32| StampedPose { stamp: f64::from(i) / 8.0, pose: Pose::new(5.0, 6.0, rate * f64::from(i) / 8.0) };
        (0..240).map(at).collect()
    };
    let errors = reference_errors(&turning(0.5), &moved(&turning(0.51)));
    let time = errors.relative_in_time.unwrap();
    assert_close(time.rotation.median, 0.01, 1e-9, "rotation in 1 s");
    assert_close(time.translation.max, 0.0, 1e-9, "translation in 1 s");
    assert_eq!(errors.relative_in_path, None, "there is no path");
}

fn a_trajectory_of_another_time_has_no_score() {
    let later: Vec<_> = drive().iter().map(|at| StampedPose { stamp: at.stamp + 1e6, ..*at }).collect();
    for trajectory in [later, Vec::new()] {
        let errors = reference_errors(&drive(), &trajectory);
        assert_eq!((errors.unmatched, errors.absolute, errors.relative_in_time), (600, None, None));
        let errors = relation_errors(&true_relations(&drive()), &trajectory);
        assert_eq!((errors.unmatched, errors.all), (errors.relations, None));
    }
}

/// Numbers of the two programs may differ by this [m, deg]: both compute in f64, so that rounding stays far below.
const AGREEMENT: f64 = 1e-6;

/// What the independent program says.
fn python(data: &Path, relations: &str, trajectory: &str) -> Value {
    let output = Command::new(crate::needs::python())
        .arg(data.join("../tools/relations_metric.py"))
        .args([data.join(relations), data.join(trajectory)])
        .arg("--json")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Everything in which two results differ.
fn differences(ours: &RelationErrors, theirs: &Value) -> Vec<String> {
    let mut pairs = vec![
        ("relations".to_owned(), ours.relations as f64, theirs["relations"].as_f64()),
        ("unmatched".to_owned(), ours.unmatched as f64, theirs["unmatched"].as_f64()),
    ];
    for (name, ours, theirs) in [
        ("all", ours.all, theirs),
        ("local", ours.local, &theirs["local"]),
        ("loop", ours.loop_closing, &theirs["loop"]),
    ] {
        let PoseErrors { translation, rotation } = ours.unwrap();
        for (part, stats, factor) in
            [("translation_m", translation, 1.0), ("rotation_deg", rotation, 1_f64.to_degrees())]
        {
            let count = stats.count as f64 / factor;
            let values = [("n", count), ("mean", stats.mean), ("std", stats.std), ("median", stats.median)];
            for (key, value) in values.into_iter().chain([("max", stats.max)]) {
                pairs.push((format!("{name} {part} {key}"), value * factor, theirs[part][key].as_f64()));
            }
        }
    }
    assert_eq!(pairs.len(), 32);
    let differs = |(_, ours, theirs): &(String, f64, Option<f64>)| {
        theirs.is_none_or(|theirs| (ours - theirs).abs().is_nan() || (ours - theirs).abs() > AGREEMENT)
    };
    pairs.into_iter().filter(differs).map(|(name, ours, theirs)| format!("{name}: {ours}, not {theirs:?}")).collect()
}

#[track_caller]
fn assert_agree(ours: &RelationErrors, theirs: &Value) {
    let differences = differences(ours, theirs);
    assert!(differences.is_empty(), "{differences:#?}");
}

/// Mean and standard deviation as published, to the digits published.
#[track_caller]
fn assert_published(errors: &RelationErrors, metres: [f64; 2], degrees: [f64; 2], rounding: [f64; 2]) {
    let PoseErrors { translation, rotation } = errors.all.unwrap();
    assert_close(translation.mean, metres[0], rounding[0], "translation, mean");
    assert_close(translation.std, metres[1], rounding[0], "translation, std");
    assert_close(rotation.mean.to_degrees(), degrees[0], rounding[1], "rotation, mean");
    assert_close(rotation.std.to_degrees(), degrees[1], rounding[1], "rotation, std");
}

/// Odometry at the scans of a CARMEN log, `FLASER n r1..rn x y theta ...  ipc_stamp host logger_stamp`.
fn raw_odometry(log: &Path) -> Vec<StampedPose> {
    let mut text = String::new();
    flate2::read::MultiGzDecoder::new(std::fs::File::open(log).unwrap()).read_to_string(&mut text).unwrap();
    let scan = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let beams: usize = words[1].parse().unwrap();
        let number = |index: usize| words[index].parse::<f64>().unwrap();
        let pose = Pose::new(number(beams + 2), number(beams + 3), number(beams + 4));
        StampedPose { stamp: number(words.len() - 3), pose }
    };
    text.lines().filter(|line| line.starts_with("FLASER")).map(scan).collect()
}

fn raw_odometry_of_csail_scores_as_published() {
    let data = data_folder();
    let odometry = raw_odometry(&data.join("csail/mit-csail.clf.gz"));
    assert_eq!(odometry.len(), 1988);
    // By way of a file, so that writing and reading count as well.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("odometry.tum");
    tum::write(&file, &odometry).unwrap();
    let relations = relations::read(&data.join("csail/mit-csail.relations.gz")).unwrap();
    let ours = relation_errors(&relations, &tum::read(&file).unwrap());
    assert_published(&ours, [1.68, 5.29], [5.07, 8.24], [0.005, 0.005]);
    let theirs = python(&data, "csail/mit-csail.relations.gz", "csail/mit-csail.clf.gz");
    assert_agree(&ours, &theirs);
    // Ours of the file, theirs of the log; and theirs of the file.
    assert_agree(&ours, &python(&data, "csail/mit-csail.relations.gz", file.to_str().unwrap()));
    // One relation's pose moved by a centimetre does not pass.
    let mut perturbed = odometry.clone();
    let named = perturbed.iter_mut().find(|at| (at.stamp - relations[0].first_stamp).abs() < 1e-4).unwrap();
    named.pose.x += 0.01;
    assert!(!differences(&relation_errors(&relations, &perturbed), &theirs).is_empty());
}

fn references_score_as_published() {
    let data = data_folder();
    let csail = "csail/mit-csail.relations.gz";
    let mut scored = Vec::new();
    // The poses of csail.gmapping are seconds apart: some relations are interpolated and some find no pose. Stamps of
    // the Intel log repeat and go backwards.
    for (relations, trajectory) in [
        (csail, "csail/csail.graph.xyt.gz"),
        (csail, "csail/csail.gmapping.xyt.gz"),
        ("intel/intel.relations.gz", "intel/intel.gmapping.xyt.gz"),
    ] {
        let theirs = python(&data, relations, trajectory);
        let relations = relations::read(&data.join(relations)).unwrap();
        let ours = relation_errors(&relations, &tum::read(&data.join(trajectory)).unwrap());
        assert_agree(&ours, &theirs);
        scored.push(ours);
    }
    assert_published(&scored[0], [0.0045, 0.0093], [0.046, 0.087], [0.00005, 0.0005]);
    assert!(scored[1].unmatched > 0 && scored[1].unmatched < scored[1].relations);
    assert_published(&scored[2], [0.042, 0.037], [1.91, 1.67], [0.0005, 0.005]);
}

fn a_real_reference_agrees_with_itself() {
    let data = data_folder();
    let trajectory = tum::read(&data.join("intel/intel.gmapping.xyt.gz")).unwrap();
    let errors = reference_errors(&trajectory, &moved(&trajectory));
    // Two stamps come twice, and only their later poses have a counterpart.
    assert!(errors.unmatched <= 2, "{} unmatched", errors.unmatched);
    let parts = [errors.relative_in_time.unwrap(), errors.relative_in_path.unwrap()];
    for error in parts.iter().flat_map(|part| [part.translation.max, part.rotation.max]) {
        assert_close(error, 0.0, 1e-9, "relative error");
    }
    assert_close(errors.absolute.unwrap().max, 0.0, 1e-9, "absolute error");
}

crate::needs::trials! {
    "metrics":
    Nothing { a_trajectory_in_another_frame_has_no_error, a_known_error_of_a_relation_comes_out, absolute_error_of_a_square_told_too_large, no_other_alignment_is_better, relative_errors_of_known_drifts, a_trajectory_of_another_time_has_no_score }
    DataAndPython { raw_odometry_of_csail_scores_as_published, references_score_as_published }
    Data { a_real_reference_agrees_with_itself }
}
