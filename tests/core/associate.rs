//! The set likelihood of detections, in f32 by a programme over sets, against an enumeration of all assignments in f64.

use crate::assignments::{Frame, TOLERANCE};
use ipslam::evaluator::cpu::associate_all;

#[test]
fn detections_are_as_likely_as_the_sum_over_all_assignments() {
    let (mut worst, mut nulls) = (0.0_f64, 0);
    for frame in Frame::all() {
        let found = associate_all(&frame.sighting(), &frame.poses);
        assert_eq!(found.len(), frame.poses.len());
        for (found, expected) in found.iter().zip(frame.slow()) {
            worst = worst.max((f64::from(*found) - expected).abs());
            let null: f32 = frame.seen.iter().map(|seen| seen.log_null).sum();
            nulls += u32::from((found - null).abs() < 1.0);
        }
    }
    println!("worst difference: {worst:.1e}");
    assert!(worst < TOLERANCE, "{worst:e}");
    // Most frames show landmarks: else little would be compared.
    assert!(nulls < 20, "{nulls}");
}

/// Each part of a frame counts.
#[test]
fn a_frame_that_differs_is_found_out() {
    type Change = fn(&mut Frame);
    let changes: [(&str, Change); 7] = [
        ("a place", |f| f.seen[0].x += 0.01),
        ("a covariance", |f| f.seen[0].xx *= 1.2),
        ("a null term", |f| f.seen[3].log_null += 0.01),
        ("a landmark", |f| f.landmarks[0][0].y += 0.01),
        ("its covariance", |f| f.landmarks[0][0].yy *= 1.1),
        ("a label", |f| f.landmarks[0][0].log_label[0] -= 0.1),
        ("what is in view", |f| f.horizon.max_ranges = [0.0; _]),
    ];
    let frame = Frame::random(6, 4, 5, 1, 40);
    let expected = frame.slow();
    for (what, change) in changes {
        let mut changed = frame.clone();
        change(&mut changed);
        let found = associate_all(&changed.sighting(), &frame.poses);
        let worst = found.iter().zip(&expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
        assert!(worst > 3.0 * TOLERANCE, "{what}: {worst:e}");
    }
}

/// Detections that all show one landmark: all but one have to be something else, however unlikely that is.
#[test]
fn nothing_underflows() {
    let mut frame = Frame::random(3, 8, 2, 1, 1);
    for seen in &mut frame.seen {
        *seen =
            ipslam::evaluator::sighting::Seen { log_null: -40.0, x: 2.0, y: 0.3, xx: 1e-4, xy: 0.0, yy: 1e-4, ..*seen };
    }
    let pose = frame.poses[0];
    let (sin, cos) = pose.heading.sin_cos();
    for row in &mut frame.landmarks[0] {
        (row.x, row.y) = (pose.x + 2.0 * cos - 0.3 * sin, pose.y + 2.0 * sin + 0.3 * cos);
    }
    let (found, expected) = (associate_all(&frame.sighting(), &frame.poses)[0], frame.slow()[0]);
    assert!(expected < -200.0 && (f64::from(found) - expected).abs() < TOLERANCE, "{found} {expected}");
}
