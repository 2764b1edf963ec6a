//! Pictures are read back as a viewer would: the SVG as XML, the PNG as pixels, and lengths by the scale bar.

use ipslam::detections::{Detection, Frame, Odometry, Recording, Sensors};
use ipslam::geometry::{Pose, StampedPose};
use ipslam::map::LineMap;
use ipslam::picture::{Figures, Line, Picture, PointRaster, Stroke, View, object_map, svg_to_png};
use ipslam::ppca::Cluster;
use ipslam::report::{Confidence, Estimate, RunResult};
use ipslam::scan::Scan;
use ipslam::semantic::{History, Landmark, Mapped, SemanticMap, Verdict, Weight};
use ipslam::tracking::OdometryErrors;
use nalgebra::{Matrix2, Matrix3, Point2, Vector2};
use resvg::tiny_skia::Pixmap;
use resvg::usvg::roxmltree::{Document, Node};

const RED: Line = Line { colour: [255, 0, 0], stroke: Stroke::Solid };
const BLUE: Line = Line { colour: [0, 0, 255], stroke: Stroke::Solid };

fn poses(positions: &[(f64, f64)]) -> Vec<StampedPose> {
    positions.iter().map(|&(x, y)| StampedPose { stamp: 0.0, pose: Pose::new(x, y, 0.0) }).collect()
}

fn wall(y: f64) -> PointRaster {
    let mut raster = PointRaster::new();
    (0..1000).for_each(|i| raster.add(Point2::new(0.01 * f64::from(i), y)));
    raster
}

fn cluster(x: f64, y: f64, angle: f64) -> Cluster {
    Cluster {
        mean: Point2::new(x, y),
        direction: Vector2::new(angle.cos(), angle.sin()),
        along_variance: 1.0,
        across_variance: 0.0004,
        count: 100.0,
    }
}

/// A room-sized view, the same for every scene.
fn room() -> View {
    View { min: Point2::new(-1.0, -1.0), max: Point2::new(11.0, 7.0) }
}

/// The picture as pixels, one to a unit of the SVG.
fn pixels(svg: &str) -> Pixmap {
    let document = Document::parse(svg).unwrap();
    let length = |name| document.root_element().attribute(name).unwrap().parse::<f64>().unwrap();
    let side = length("width").max(length("height")).round() as u32;
    Pixmap::decode_png(&svg_to_png(svg, side).unwrap()).unwrap()
}

/// Places of the pixels for which a test of red, green and blue holds.
fn places(pixmap: &Pixmap, test: impl Fn(u8, u8, u8) -> bool) -> Vec<(f64, f64)> {
    let width = pixmap.width() as usize;
    let pixels = pixmap.pixels().iter().enumerate();
    let chosen = pixels.filter(|(_, p)| test(p.red(), p.green(), p.blue()));
    chosen.map(|(i, _)| ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5)).collect()
}

fn mean(places: &[(f64, f64)]) -> (f64, f64) {
    assert!(!places.is_empty(), "no such pixels");
    let sum = places.iter().fold((0.0, 0.0), |sum, place| (sum.0 + place.0, sum.1 + place.1));
    (sum.0 / places.len() as f64, sum.1 / places.len() as f64)
}

fn node<'a>(document: &'a Document<'a>, id: &str) -> Node<'a, 'a> {
    document.descendants().find(|node| node.attribute("id") == Some(id)).unwrap_or_else(|| panic!("no {id}"))
}

/// Numbers of a path's `d`.
fn numbers(d: &str) -> Vec<f64> {
    d.split(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-')).filter_map(|word| word.parse().ok()).collect()
}

/// Pixels per metre as the scale bar tells: its drawn length by its label.
fn pixels_per_metre(svg: &str) -> f64 {
    let document = Document::parse(svg).unwrap();
    let bar = node(&document, "scale-bar");
    let label = bar.descendants().find(|n| n.has_tag_name("text")).unwrap().text().unwrap();
    let metres: f64 = label.strip_suffix(" m").unwrap().parse().unwrap();
    let d = bar.descendants().find(|n| n.has_tag_name("path")).unwrap().attribute("d").unwrap();
    let (bar_from, bar_to) = d.split_once('H').map(|(left, right)| (numbers(left), numbers(right))).unwrap();
    (bar_to[0] - bar_from[bar_from.len() - 2]) / metres
}

/// Two trajectories 4 m apart and 10 m long are 4 and 10 scale-bar metres apart and long, the higher y above.
#[test]
fn y_is_up_and_lengths_are_those_of_the_scale_bar() {
    let (low, high) = (poses(&[(0.0, 1.0), (10.0, 1.0)]), poses(&[(0.0, 5.0), (10.0, 5.0)]));
    let svg = Picture::new("").view(room()).trajectory("low", RED, &low).trajectory("high", BLUE, &high).to_svg();
    let scale = pixels_per_metre(&svg);
    let pixmap = pixels(&svg);
    let document = Document::parse(&svg).unwrap();
    let top = numbers(node(&document, "map").descendants().next_back().unwrap().attribute("y").unwrap())[0];
    // Below the legend, which has the same colours.
    let inside = |places: Vec<(f64, f64)>| places.into_iter().filter(|p| p.1 > top).collect::<Vec<_>>();
    let red = inside(places(&pixmap, |r, g, b| r > 250 && g < 5 && b < 5));
    let blue = inside(places(&pixmap, |r, g, b| r < 5 && g < 5 && b > 250));
    let apart = mean(&red).1 - mean(&blue).1;
    assert!((apart - 4.0 * scale).abs() < 1.5, "{apart} pixels for 4 m at {scale} pixels per metre");
    let left = red.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let right = red.iter().map(|p| p.0).fold(0.0, f64::max);
    // The markers' circles reach 9 pixels beyond the ends at most.
    assert!((right - left - 10.0 * scale - 15.0).abs() < 4.0, "{} for 10 m at {scale}", right - left);
}

/// Rows of the picture where a wall's points are dark, counted from the bottom of the view in metres.
fn ink_heights(svg: &str) -> Vec<f64> {
    let scale = pixels_per_metre(svg);
    let document = Document::parse(svg).unwrap();
    let map = node(&document, "map").descendants().next_back().unwrap();
    let number = |name| map.attribute(name).unwrap().parse::<f64>().unwrap();
    let (left, top, width, height) = (number("x"), number("y"), number("width"), number("height"));
    let within = |p: &(f64, f64)| p.0 > left + 3.0 && p.0 < left + width - 3.0 && p.1 > top + 3.0;
    let ink = places(&pixels(svg), |r, _, _| r < 150);
    let ink = ink.into_iter().filter(|p| within(p) && p.1 < top + height - 3.0);
    ink.map(|p| (top + height - p.1) / scale).collect()
}

/// How far the middle of the ink is from a height, and whether any of it is more than 5 cm away.
fn wall_is_at(svg: &str, height: f64) -> bool {
    let heights = ink_heights(svg);
    heights.len() > 1000 && heights.iter().all(|h| (h - height).abs() < 0.05)
}

#[test]
fn points_are_where_the_wall_is_and_nowhere_else() {
    let picture = |y: f64| Picture::new("").view(room()).points("points", &wall(y)).to_svg();
    // The view's lower edge is at y = -1 m.
    assert!(wall_is_at(&picture(2.01), 3.01), "{:?}", ink_heights(&picture(2.01)).first());
    assert!(!wall_is_at(&picture(2.2), 3.01), "a wall 20 cm off is told apart");
    assert!(ink_heights(&Picture::new("").view(room()).to_svg()).is_empty());
}

/// A wall of ones own standard deviation, one metre, is 2 √3 m long: to its ends, at its angle. The figure of the paper has an
/// ellipse of one standard deviation besides.
#[test]
fn walls_are_drawn_to_their_ends() {
    for angle in [0.0f64, 0.5, 2.0, -1.2] {
        let map = [cluster(4.0, 3.0, angle)];
        let svg = Picture::new("").view(room()).clusters(&map).to_svg();
        let scale = pixels_per_metre(&svg);
        let document = Document::parse(&svg).unwrap();
        let lines: Vec<_> = node(&document, "clusters").descendants().filter(|n| n.has_tag_name("line")).collect();
        assert_eq!(lines.len(), 1);
        let number = |name| lines[0].attribute(name).unwrap().parse::<f64>().unwrap();
        let (dx, dy) = (number("x2") - number("x1"), number("y2") - number("y1"));
        assert!((dx - 12f64.sqrt() * scale * angle.cos()).abs() < 0.1);
        assert!((dy + 12f64.sqrt() * scale * angle.sin()).abs() < 0.1);
        assert!(!svg.contains("<ellipse"));
        let svg_of_paper = Picture::new("").view(room()).clusters(&map).deviations().to_svg();
        let document = Document::parse(&svg_of_paper).unwrap();
        let ellipse = node(&document, "deviations").descendants().find(|n| n.has_tag_name("ellipse")).unwrap();
        assert!((ellipse.attribute("rx").unwrap().parse::<f64>().unwrap() - scale).abs() < 0.1);
        // All of its ink lies within the line's width; the legend's does not count.
        let centre = ((number("x1") + number("x2")) / 2.0, (number("y1") + number("y2")) / 2.0);
        let ink = places(&pixels(&svg), |r, g, _| r > 180 && g < 80);
        let ink: Vec<_> = ink.iter().filter(|p| p.1 > 200.0).map(|p| (p.0 - centre.0, p.1 - centre.1)).collect();
        assert!(ink.len() as f64 > 4.0 * scale, "{} pixels", ink.len());
        for (x, y) in ink {
            let across = (x * angle.sin() + y * angle.cos()).abs();
            assert!(across < 0.02 * scale + 3.0, "{across} pixels off the line of angle {angle}");
        }
    }
}

/// A few rays through a window must not shrink the building, and clusters alone decide where there are some.
#[test]
fn far_points_do_not_shrink_the_building() {
    let path = poses(&[(0.0, 0.0), (10.0, 0.0)]);
    let mut raster = wall(2.0);
    let building = Picture::new("").points("points", &raster).trajectory("path", RED, &path).to_svg();
    (0..4).for_each(|i| raster.add(Point2::new(900.0, 300.0 * f64::from(i))));
    let far = Picture::new("").points("points", &raster).trajectory("path", RED, &path).to_svg();
    assert!((pixels_per_metre(&far) / pixels_per_metre(&building) - 1.0).abs() < 0.05);
    // Where they are many they are part of the place.
    (0..400).for_each(|i| raster.add(Point2::new(900.0, 2.0 * f64::from(i))));
    let many = Picture::new("").points("points", &raster).trajectory("path", RED, &path).to_svg();
    assert!(pixels_per_metre(&many) < 0.1 * pixels_per_metre(&building));
    let map = [cluster(5.0, 2.0, 0.0)];
    let mapped = Picture::new("").points("points", &raster).clusters(&map).trajectory("path", RED, &path).to_svg();
    assert!(pixels_per_metre(&mapped) > 50.0);
}

#[test]
fn strange_input_makes_a_legal_picture() {
    let nan = f64::NAN;
    let broken = [
        Cluster { along_variance: nan, ..cluster(0.0, 0.0, 0.0) },
        Cluster { across_variance: -1.0, ..cluster(0.0, 0.0, 0.0) },
        cluster(f64::INFINITY, 0.0, 0.0),
        cluster(1e300, 0.0, 0.0),
        cluster(1.0, 1.0, 0.3),
    ];
    let (single, none) = (poses(&[(3.0, -2.0)]), poses(&[]));
    let torn = poses(&[(0.0, 0.0), (1.0, 0.0), (nan, 5.0), (2.0, 1.0), (f64::INFINITY, 0.0), (1e200, 0.0), (3.0, 1.0)]);
    let mut raster = PointRaster::new();
    [nan, f64::INFINITY, 1e300].into_iter().for_each(|x| raster.add(Point2::new(x, 0.0)));
    assert_eq!(raster.count(), 0);
    let pictures = [
        Picture::new("<&>\"' \u{0} \u{1b} \u{ffff} ünïcode ± σ"),
        Picture::new("").note("empty").points("", &raster).clusters(&[]).trajectory("", RED, &none),
        Picture::new("single").trajectory("single", RED, &single),
        Picture::new("torn").points("points", &raster).clusters(&broken).trajectory("torn", BLUE, &torn),
    ];
    for picture in pictures {
        let svg = picture.to_svg();
        let document = Document::parse(&svg).unwrap_or_else(|error| panic!("{error}: {svg}"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert!(document.descendants().count() > 5);
        let png = svg_to_png(&svg, 400).unwrap();
        let pixmap = Pixmap::decode_png(&png).unwrap();
        assert_eq!(pixmap.width().max(pixmap.height()), 400);
    }
    let svg = Picture::new("torn").view(room()).trajectory("torn", BLUE, &torn).clusters(&broken).to_svg();
    let document = Document::parse(&svg).unwrap();
    assert_eq!(node(&document, "clusters").descendants().filter(|n| n.has_tag_name("line")).count(), 1);
    let path = node(&document, "trajectory-0").descendants().find(|n| n.has_tag_name("path")).unwrap();
    assert_eq!(path.attribute("d").unwrap().matches('M').count(), 3, "gaps stay gaps");
    assert!(
        svg_to_png("no picture", 400).is_err() && svg_to_png(&svg, 0).is_err() && svg_to_png(&svg, u32::MAX).is_err()
    );
}

/// A straight path needs two points however often it was sampled; a bent one keeps its corner.
#[test]
fn trajectories_are_simplified_without_losing_corners() {
    let straight: Vec<_> = (0..5000).map(|i| (0.001 * f64::from(i), 0.0)).collect();
    let bent: Vec<_> = straight.iter().copied().chain((0..5000).map(|i| (5.0, 0.001 * f64::from(i)))).collect();
    for (positions, points) in [(straight, 2), (bent, 3)] {
        let svg = Picture::new("").view(room()).trajectory("path", RED, &poses(&positions)).to_svg();
        let document = Document::parse(&svg).unwrap();
        let path = node(&document, "trajectory-0").descendants().find(|n| n.has_tag_name("path")).unwrap();
        assert_eq!(numbers(path.attribute("d").unwrap()).len(), 2 * points);
    }
}

/// Text must show on a machine without fonts: a title makes ink.
#[test]
fn titles_are_drawn() {
    let ink = |title: &str| places(&pixels(&Picture::new(title).to_svg()), |r, _, _| r < 100);
    let in_title = |places: Vec<(f64, f64)>| places.iter().filter(|p| p.1 < 65.0).count();
    assert!(in_title(ink("Stata Center")) > 500);
    assert_eq!(in_title(ink("")), 0);
}

/// More cells than are kept make the cells coarser; no point is lost by that.
#[test]
fn a_large_place_is_kept_more_coarsely() {
    let mut raster = PointRaster::new();
    for i in 0..300 {
        for j in 0..300 {
            raster.add(Point2::new(f64::from(i) - 150.0, f64::from(j) - 150.0));
        }
    }
    assert_eq!(raster.count(), 90_000);
    let svg = Picture::new("").points("points", &raster).to_svg();
    let scale = pixels_per_metre(&svg);
    assert!((scale * 300.0 / 1400.0 - 1.0).abs() < 0.1, "{scale} pixels per metre");
}

/// A robot that drives along a wall while its odometry turns away from it.
fn run() -> (RunResult, Vec<(Scan, Pose, Pose)>) {
    let points: Vec<_> = (0..200).map(|i| Point2::new(0.01 * f64::from(i), 2.0 + 0.02 * f64::from(i % 2))).collect();
    let mut scans = Vec::new();
    for i in 0..50 {
        let world = Pose::new(0.2 * f64::from(i), 0.0, 0.0);
        let odom = Pose::new(100.0, 50.0, 1.0) * Pose::new(0.2 * f64::from(i), 0.1 * f64::from(i), 0.01 * f64::from(i));
        let mut points = points.clone();
        points.push(Point2::new(0.0, -5.0));
        scans.push((Scan { stamp: f64::from(i), points, ..Scan::default() }, odom, world));
    }
    let clusters = vec![Cluster { along_variance: 12.0, across_variance: 0.0004, ..cluster(5.9, 2.01, 0.0) }];
    let estimate = |(scan, odom_from_robot, pose): &(Scan, Pose, Pose)| Estimate {
        stamp: scan.stamp,
        odom_from_robot: *odom_from_robot,
        world_from_robot: Some(*pose),
        covariance: None,
        confidence: None,
    };
    let poses = scans.iter().map(estimate).collect();
    (
        RunResult {
            map: LineMap { clusters, free: None },
            poses,
            refused_odometry: Vec::new(),
            odometry_errors: OdometryErrors::default(),
            gyro: None,
            loops: Vec::new(),
            earlier: Vec::new(),
            looked_through: 0.0,
            objects: None,
        },
        scans,
    )
}

/// Numbers stand at the metres that they tell.
#[test]
fn axes_tell_metres() {
    let svg = Picture::new("").view(room()).to_svg();
    let (scale, document) = (pixels_per_metre(&svg), Document::parse(&svg).unwrap());
    let numbers: Vec<(f64, f64)> = node(&document, "axes")
        .descendants()
        .filter(|n| n.has_tag_name("text"))
        .filter_map(|n| Some((n.text()?.parse().ok()?, n.attribute("x")?.parse().ok()?)))
        .collect();
    assert!(numbers.len() >= 4, "{numbers:?}");
    for pair in numbers.windows(2) {
        assert!((pair[1].1 - pair[0].1 - scale * (pair[1].0 - pair[0].0)).abs() < 0.2, "{numbers:?}");
    }
    assert!(numbers.iter().any(|number| number.0 == 0.0), "{numbers:?}");
}

/// A robot that is not located for a while: the path has a hole, and odometry leads from its one side to the other.
#[test]
fn what_is_not_located_is_dotted() {
    let (mut result, scans) = run();
    let hidden = |is_located| Some(Confidence { weight: 1.0, explained: 1.0, is_located });
    for (index, estimate) in result.poses.iter_mut().enumerate() {
        estimate.odom_from_robot = scans[index].2;
        estimate.confidence = hidden(!(20..30).contains(&index));
    }
    let svg = |result: &RunResult| {
        let files = Figures::new("corridor", result, &[]).map().unwrap();
        String::from_utf8(files[0].1.clone()).unwrap()
    };
    let drawn = svg(&result);
    let scale = pixels_per_metre(&drawn);
    let document = Document::parse(&drawn).unwrap();
    let path = |id: &str| {
        let path = node(&document, id).descendants().find(|n| n.has_tag_name("path")).unwrap();
        (path.attribute("d").unwrap().to_owned(), path.attribute("stroke-dasharray").is_some())
    };
    let ((solid, is_dashed), (dotted, is_dotted)) = (path("trajectory-0"), path("trajectory-1"));
    assert!(!is_dashed && is_dotted && solid.matches('M').count() == 2 && dotted.matches('M').count() == 1);
    // From 3.8 to 6 m.
    let ends = numbers(&dotted);
    assert!((ends[ends.len() - 2] - ends[0] - 2.2 * scale).abs() < 1.0, "{dotted}");
    result.poses.iter_mut().for_each(|estimate| estimate.confidence = hidden(true));
    assert!(!svg(&result).contains("trajectory-1"));
}

#[test]
fn figures_of_a_run() {
    let (result, scans) = run();
    let draw = |shift: f64| {
        let mut figures = Figures::new("corridor", &result, &[]);
        for (scan, odom, world) in &scans {
            figures.add_scan(scan, *odom, Pose::new(0.0, shift, 0.0) * *world);
        }
        figures.finish().unwrap()
    };
    let files = draw(0.0);
    let names: Vec<_> = files.iter().map(|(name, _)| *name).collect();
    let expected = [
        "map.svg",
        "map.png",
        "figure3_odometry_map.png",
        "figure4a_trajectory.png",
        "figure4b_clusters.png",
        "figure4c_points.png",
        "figure4d_reprojected.png",
    ];
    assert_eq!(names, expected);
    let svg = std::str::from_utf8(&files[0].1).unwrap();
    assert!(Document::parse(svg).is_ok() && svg.contains("10,050 points of 50 scans; path 10 m"), "{svg:.900}");
    for (name, png) in &files[1..] {
        let pixmap = Pixmap::decode_png(png).unwrap();
        assert_eq!(pixmap.width().max(pixmap.height()), 1600, "{name}");
    }
    // Scans registered 30 cm off change every picture that shows registered points, and no other.
    let moved = draw(0.3);
    for (before, after) in files.iter().zip(&moved) {
        let registered = !before.0.starts_with("figure3") && !before.0.starts_with("figure4a");
        assert_eq!(before.1 != after.1, registered, "{}", before.0);
    }
}

/// Two walls of noise 1 cm either side of a cluster's line fall on it, and the lone point far from it is left out.
#[test]
fn reprojected_points_lie_on_their_cluster() {
    let (result, scans) = run();
    let mut figures = Figures::new("", &result, &[]);
    scans.iter().for_each(|(scan, odom, world)| figures.add_scan(scan, *odom, *world));
    let files = figures.finish().unwrap();
    let dark = |name: &str| {
        let png = &files.iter().find(|(found, _)| *found == name).unwrap().1;
        let pixmap = Pixmap::decode_png(png).unwrap();
        // The map's middle: away from text, frame and scale bar.
        let (low, high) = (0.1 * f64::from(pixmap.width()), 0.9 * f64::from(pixmap.width()));
        let ink = places(&pixmap, |r, _, b| r < 120 && b > 100);
        let rows: std::collections::BTreeSet<u32> =
            ink.iter().filter(|p| p.0 > low && p.0 < high && p.1 > 200.0).map(|p| p.1 as u32).collect();
        rows.len()
    };
    let (noisy, projected) = (dark("figure4c_points.png"), dark("figure4d_reprojected.png"));
    assert!(projected >= 1 && noisy >= projected + 2, "{noisy} rows of ink became {projected}");
}

/// A robot at (1, 0) that looks ahead and sees two doors and a chair; one door is clutter, and the other door's landmark is
/// known to 20 cm along x and to 10 cm along y.
fn objects() -> (Recording, SemanticMap) {
    let sensors = Sensors::new(["chair", "door"].map(str::to_owned).to_vec(), 0.9);
    let seen = |class, range, bearing| Detection { class, score: 1.0, range, bearing };
    let detections = vec![seen(1, 3.0, 0.0), seen(1, 2.0, 1.0), seen(0, 2.0, -1.0)];
    let recording = Recording {
        sensors,
        odometry: Odometry::Velocities(Vec::new()),
        frames: vec![Frame { stamp: 0.0, detections }],
    };
    let landmark = |x, y, [xx, yy]: [f64; 2], classes: [f64; 2]| Landmark {
        position: Point2::new(x, y),
        covariance: Matrix2::new(xx, 0.0, 0.0, yy),
        classes: classes.to_vec(),
        weight: 1.0,
    };
    let keyframe = |x, frame| Mapped { stamp: x, pose: Pose::new(x, 0.0, 0.0), covariance: Matrix3::zeros(), frame };
    let weight = |detection, landmark, weight| Weight { frame: 0, detection, landmark, weight };
    let evidence = Verdict {
        explained: 1.0,
        unseen: None,
        detection_error: 1.0,
        odometry_error: 1.0,
        calibration: 0.0,
        agreeing_runs: None,
    };
    let map = SemanticMap {
        keyframes: vec![keyframe(1.0, Some(0)), keyframe(6.0, None)],
        landmarks: vec![landmark(4.0, 0.5, [0.04, 0.01], [0.1, 0.9]), landmark(2.0, -1.7, [0.01; 2], [0.8, 0.2])],
        weights: vec![weight(0, 0, 0.9), weight(2, 1, 1.0)],
        calibration: [1.0, 1.0, 0.0],
        detection_probability: 0.9,
        objective: 0.0,
        runs: Vec::new(),
        moving: Vec::new(),
        detections: 3,
        verdict: evidence,
        history: History::default(),
    };
    (recording, map)
}

#[test]
fn a_map_of_objects_shows_classes_uncertainty_and_weights() {
    let (recording, map) = objects();
    let files = object_map("<hall>", &recording, &map, &map.trajectory(), &[]).unwrap();
    assert_eq!(files.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["map.svg", "map.png"]);
    let svg = std::str::from_utf8(&files[0].1).unwrap();
    let (document, scale) = (Document::parse(svg).unwrap(), pixels_per_metre(svg));
    let number = |node: &Node<'_, '_>, name| node.attribute(name).unwrap().parse::<f64>().unwrap();
    let in_landmarks = |tag| node(&document, "landmarks").descendants().filter(move |n| n.has_tag_name(tag));
    let ellipses: Vec<_> = in_landmarks("ellipse").collect();
    let markers: Vec<_> = in_landmarks("circle").collect();
    assert_eq!((ellipses.len(), markers.len()), (2, 2));
    // A normal error of the plane is within 2.448 standard deviations with 95 %.
    let turn = numbers(ellipses[0].attribute("transform").unwrap())[0].to_radians();
    let (rx, ry) = (number(&ellipses[0], "rx"), number(&ellipses[0], "ry"));
    let along_x = (rx * turn.cos()).hypot(ry * turn.sin()) / scale;
    assert!((along_x - 2.448 * 0.2).abs() < 0.001 && (rx * ry / scale / scale - 2.448f64.powi(2) * 0.02).abs() < 0.001);
    // Landmarks are where they are, and of the colour of their class.
    let apart = (number(&markers[0], "cx") - number(&markers[1], "cx")) / scale;
    assert!((apart - 2.0).abs() < 0.01, "{apart} m");
    let colours: Vec<_> = markers.iter().map(|marker| marker.attribute("fill").unwrap()).collect();
    assert_ne!(colours[0], colours[1]);
    // Three detections; two of them have a line to their landmark.
    let paths = |id| node(&document, id).descendants().filter_map(|n| n.attribute("d")).collect::<String>();
    assert_eq!((paths("detections").matches('M').count(), paths("weights").matches('L').count()), (3, 2));
    // The detection of the door lies half a metre below its landmark.
    let door = paths("weights");
    let line = door.split('M').map(numbers).find(|line| line.len() == 4 && (line[0] - line[2]).abs() < 0.2).unwrap();
    assert!(((line[1] - line[3]) / scale - 0.5).abs() < 0.01, "{line:?}");
    for text in ["&lt;hall&gt;", "2 objects from 3 detections; path 5 m", "chair (1)", "door (1)"] {
        assert!(svg.contains(text), "{text}");
    }
    let pixmap = Pixmap::decode_png(&files[1].1).unwrap();
    assert_eq!(pixmap.width().max(pixmap.height()), 1600);
}

#[test]
fn strange_objects_make_a_legal_picture() {
    let (recording, mut map) = objects();
    map.landmarks[0].position.x = f64::NAN;
    map.landmarks[1].covariance = Matrix2::repeat(f64::INFINITY);
    map.weights[1].landmark = 7;
    let files = object_map("", &recording, &map, &map.trajectory(), &[]).unwrap();
    let svg = std::str::from_utf8(&files[0].1).unwrap();
    let document = Document::parse(svg).unwrap();
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    let landmarks = node(&document, "landmarks").descendants();
    assert_eq!(landmarks.filter(|n| n.has_tag_name("circle") || n.has_tag_name("ellipse")).count(), 1);
}
