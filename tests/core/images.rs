//! Features of pictures against known homographies, motions of cameras against known ones.

use image::{GrayImage, Luma};
use ipslam::geometry::{Pinhole, Pose3};
use ipslam::images::{Keyframe, Orb, OrbFeature, Pair, Tracker, VisualOdometry, match_features, relative_pose};
use ipslam::random::{Draw, bits, normals, uniform};
use ipslam::visual_inertial::Feature;
use nalgebra::{Matrix3, Point2, Point3, UnitQuaternion, Vector3, Vector6};
use std::f64::consts::PI;

const CAMERA: Pinhole = Pinhole { focal: [400.0; 2], centre: [200.0, 150.0] };

/// Rectangles of all sizes and greys, drawn four to a pixel, so that they can be seen from anywhere.
fn scene() -> GrayImage {
    let mut scene = GrayImage::from_pixel(1200, 1000, Luma([128]));
    for number in 0..500 {
        let [a, b, c, d] = bits(3, 0, number, Draw::Anywhere).map(|word| f64::from(uniform(word)));
        let grey = Luma([(255.0 * uniform(bits(3, 1, number, Draw::Anywhere)[0])) as u8]);
        let (left, top) = ((1200.0 * a) as u32, (1000.0 * b) as u32);
        for row in top..(top + 16 + (80.0 * c) as u32).min(1000) {
            for column in left..(left + 16 + (80.0 * d) as u32).min(1200) {
                scene.put_pixel(column, row, grey);
            }
        }
    }
    scene
}

/// The scene as seen where `scene_from_picture` takes pixels to it; a pixel is the mean of nine places.
fn seen(scene: &GrayImage, scene_from_picture: &Matrix3<f64>) -> GrayImage {
    GrayImage::from_fn(400, 300, |column, row| {
        let mut sum = 0;
        for (across, down) in (0..9).map(|part| (f64::from(part % 3), f64::from(part / 3))) {
            let at = Point2::new(f64::from(column) + (across - 1.0) / 3.0, f64::from(row) + (down - 1.0) / 3.0);
            let place = mapped(scene_from_picture, at) * 2.0;
            let grey = scene.get_pixel_checked((place.x + 200.0) as u32, (place.y + 200.0) as u32);
            sum += grey.map_or(128, |grey| u32::from(grey[0]));
        }
        Luma([(sum / 9) as u8])
    })
}

fn mapped(homography: &Matrix3<f64>, at: Point2<f64>) -> Point2<f64> {
    let place = homography * at.to_homogeneous();
    Point2::new(place.x / place.z, place.y / place.z)
}

/// How many features match, and the share of them that the homography takes to each other.
fn share_right(first: &[OrbFeature], second: &[OrbFeature], first_from_second: &Matrix3<f64>) -> (usize, f64) {
    let matches = match_features(first, second);
    let is_right = |&&(one, other): &&(usize, usize)| {
        let (one, other) = (&first[one], &second[other]);
        (mapped(first_from_second, other.pixel) - one.pixel).norm() < 2.0 * one.scale.max(other.scale)
    };
    let right = matches.iter().filter(is_right).count();
    (matches.len(), right as f64 / matches.len().max(1) as f64)
}

/// A turn about the middle of the picture, then a change of size and of view.
fn homography(angle: f64, size: f64, tilt: f64) -> Matrix3<f64> {
    let (sin, cos) = angle.sin_cos();
    let middle = Matrix3::new(1.0, 0.0, 200.0, 0.0, 1.0, 150.0, 0.0, 0.0, 1.0);
    let turn = Matrix3::new(size * cos, -size * sin, 0.0, size * sin, size * cos, 0.0, tilt, tilt / 2.0, 1.0);
    middle * turn * Matrix3::new(1.0, 0.0, -200.0, 0.0, 1.0, -150.0, 0.0, 0.0, 1.0)
}

/// The oracle: the homography that the second picture was made with.
#[test]
fn features_are_found_again_in_a_warped_picture() {
    let (scene, orb) = (scene(), Orb::new());
    let first = orb.features(&seen(&scene, &Matrix3::identity()), 500);
    assert!(first.len() > 300, "{} features", first.len());
    for (angle, size, tilt) in [(0.1, 1.0, 0.0), (0.4, 1.2, 0.0), (-0.2, 0.8, 2e-4), (0.0, 1.0, 5e-4)] {
        let warp = homography(angle, size, tilt);
        let second = orb.features(&seen(&scene, &warp), 500);
        let (count, share) = share_right(&first, &second, &warp);
        assert!(count > 60 && share > 0.9, "{angle} {size} {tilt}: {share} of {count}");
        let moved = Matrix3::new(1.0, 0.0, 12.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0) * warp;
        assert!(share_right(&first, &second, &moved).1 < 0.1);
    }
}

/// Directions turn with the picture, and descriptors stay: FAST and steered BRIEF do not depend on how the camera is held.
#[test]
fn features_turn_with_the_picture() {
    let (scene, orb) = (scene(), Orb::new());
    let first = orb.features(&seen(&scene, &Matrix3::identity()), 500);
    for step in 1..6 {
        let angle = PI / 3.0 * f64::from(step);
        let turn = homography(angle, 1.0, 0.0);
        let second = orb.features(&seen(&scene, &turn), 500);
        let (count, share) = share_right(&first, &second, &turn);
        assert!(count > 50 && share > 0.9, "{angle}: {share} of {count}");
        let matches = match_features(&first, &second);
        let off = |&(one, other): &(usize, usize)| {
            let turned = first[one].direction - second[other].direction - angle;
            (turned + PI).rem_euclid(2.0 * PI) - PI
        };
        let mut off: Vec<f64> = matches.iter().map(|pair| off(pair).abs()).collect();
        off.sort_by(f64::total_cmp);
        assert!(off[off.len() / 2] < 0.1, "{angle}: directions are off by {}", off[off.len() / 2]);
    }
}

/// A picture without corners, and one that is too small.
#[test]
fn a_picture_may_show_nothing() {
    let orb = Orb::new();
    assert!(orb.features(&GrayImage::new(400, 300), 500).is_empty());
    assert!(orb.features(&GrayImage::new(10, 7), 500).is_empty());
    let mut tracker = Tracker::new(CAMERA);
    for _ in 0..2 {
        let keyframe = tracker.add(&GrayImage::new(400, 300)).unwrap();
        assert!(keyframe.features.is_empty() && keyframe.motion.is_none());
    }
}

/// The second picture is the first, moved, and so are the tracks; a camera that stands still makes no keyframe.
#[test]
fn tracks_follow_the_picture() {
    let scene = scene();
    let shift = Matrix3::new(1.0, 0.0, 9.0, 0.0, 1.0, -4.0, 0.0, 0.0, 1.0);
    let mut tracker = Tracker::new(CAMERA);
    let first = tracker.add(&seen(&scene, &Matrix3::identity())).unwrap();
    assert!(tracker.add(&seen(&scene, &Matrix3::identity())).is_none());
    let second = tracker.add(&seen(&scene, &shift)).unwrap();
    let (mut followed, mut right) = (0, 0);
    for (feature, scale) in second.features.iter().zip(&second.scales) {
        let Some(before) = first.features.iter().find(|before| before.track == feature.track) else { continue };
        followed += 1;
        right += usize::from((mapped(&shift, feature.pixel) - before.pixel).norm() < 2.0 * scale);
    }
    assert!(followed > 100 && right as f64 > 0.97 * f64::from(followed), "{right} of {followed} are right");
}

/// Points around a place ahead, and where a camera at a pose sees them, with noise of a third of a pixel.
fn pixel(number: u32, pose: Pose3, draw: u32) -> Option<Point2<f64>> {
    let [a, b, c, _] = bits(1, 0, number, Draw::Anywhere).map(|word| f64::from(uniform(word)));
    let point = Point3::new(16.0 * a - 8.0, 8.0 * b - 4.0, 4.0 + 20.0 * c);
    let [u, v, ..] = normals(2, draw, number, Draw::Anywhere).map(|normal| 0.3 * f64::from(normal));
    let (pixel, _) = CAMERA.project((pose.inverse() * point).coords)?;
    let noisy = Point2::new(pixel.x + u, pixel.y + v);
    ((0.0..400.0).contains(&noisy.x) && (0.0..300.0).contains(&noisy.y)).then_some(noisy)
}

/// The oracle: the motion that the pairs were made with; two in five pairs are wrong.
#[test]
fn the_motion_between_two_pictures_is_found() {
    let moved = Pose3::exp(Vector6::new(0.5, 0.1, 0.9, 0.02, 0.1, -0.03));
    let is_wrong = |number: u32| number % 5 < 2;
    let (mut pairs, mut wrong) = (Vec::new(), Vec::new());
    for number in 0..400 {
        let (Some(first), Some(mut second)) = (pixel(number, Pose3::identity(), 0), pixel(number, moved, 1)) else {
            continue;
        };
        if is_wrong(number) {
            let [u, v, ..] = bits(4, 0, number, Draw::Anywhere).map(|word| f64::from(uniform(word)));
            second = Point2::new(400.0 * u, 300.0 * v);
        }
        pairs.push(Pair { first: CAMERA.ray(first), second: CAMERA.ray(second), sigma: 0.3 / 400.0 });
        wrong.push(is_wrong(number));
    }
    assert!(pairs.len() > 150, "{} pairs", pairs.len());
    let found = relative_pose(&pairs, 0, 0).unwrap();
    let turn = found.first_from_second.rotation.angle_to(&moved.rotation).to_degrees();
    let direction = found.first_from_second.position.coords.angle(&moved.position.coords).to_degrees();
    assert!(turn < 0.1 && direction < 1.0, "off by {turn}° and {direction}°");
    let agree = |of_wrong: bool| {
        let of_kind = found.agrees.iter().zip(&wrong).filter(|(_, wrong)| **wrong == of_wrong);
        let count = of_kind.clone().count();
        of_kind.filter(|(agrees, _)| **agrees).count() as f64 / count as f64
    };
    assert!(agree(false) > 0.85 && agree(true) < 0.1, "{} of the right, {} of the wrong", agree(false), agree(true));
    assert!(relative_pose(&pairs[..7], 0, 0).is_none());
}

/// The oracle: the path that the features were seen from, of which one camera does not tell the scale.
#[test]
fn the_way_follows_from_tracks() {
    let truth = |step: u32| {
        let t = f64::from(step);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.01 * t, 0.05 * (0.3 * t).sin(), 0.0));
        Pose3::new(Point3::new(0.2 * (0.4 * t).sin(), 0.02 * t, 0.3 * t), turn)
    };
    let way = |wrong: bool| {
        let mut odometry = VisualOdometry::new(CAMERA);
        let mut last: Option<Pose3> = None;
        for step in 0..12 {
            let seen_as = if wrong && step == 6 { truth(9) } else { truth(step) };
            let feature = |number: u32| Some(Feature { track: number.into(), pixel: pixel(number, seen_as, step)? });
            let features: Vec<Feature> = (0..300).filter_map(feature).collect();
            let motion = last.map(|last| {
                let moved = truth(step).seen_from(last);
                let direction = moved.position.coords.normalize();
                ipslam::images::TwoView {
                    first_from_second: Pose3::new(direction.into(), moved.rotation),
                    agrees: vec![true; features.len()],
                }
            });
            let scales = vec![1.0; features.len()];
            odometry.add(f64::from(step), &Keyframe { features, scales, motion }).unwrap();
            last = Some(truth(step));
        }
        assert!(odometry.finish().unwrap().converged);
        odometry.path().iter().map(|pose| pose.pose).collect::<Vec<_>>()
    };
    let worst = |path: &[Pose3]| {
        let from_first = |step: usize| truth(step as u32).seen_from(truth(0)).position.coords;
        let scale = from_first(11).norm() / path[11].position.coords.norm();
        let off = path.iter().enumerate().map(|(step, pose)| (pose.position.coords * scale - from_first(step)).norm());
        off.fold(0.0, f64::max)
    };
    let (right, wrong) = (worst(&way(false)), worst(&way(true)));
    assert!(right < 0.03 && wrong > 0.3, "off by {right} m of 3.3; with a wrong picture by {wrong} m");
}
