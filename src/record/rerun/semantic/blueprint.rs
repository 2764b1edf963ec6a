//! The blueprint of a recording of objects: the paths of its entities, their styles, and the views of the Rerun viewer. What it has in
//! common with the recording of a run is in [`blueprint`](super::super::blueprint).

use super::super::blueprint::{self as shared, ABOUT, colour, lines, map_view, plot, points, under, whole};
use crate::picture::class_colour;
use ::rerun::blueprint::{Blueprint, Horizontal, Spatial2DView, Tabs, TextDocumentView, Vertical};
use ::rerun::components::Radius;
use ::rerun::{Arrows2D, Color, RecordingStream, RecordingStreamResult, SeriesLines, SeriesPoints, Transform3D};

/// Timeline: keyframes from 0.
pub const FRAME_TIMELINE: &str = "frame";

/// The sensors of the recording.
pub const SENSORS: &str = "run/sensors";
/// Odometry as speeds.
pub const SPEEDS: &str = "run/log/speeds";
/// What was detected.
pub const DETECTIONS: &str = "run/log/detections";
/// Which objects the detections show.
pub const IDS: &str = "run/log/ids";

/// Pose of the best hypothesis.
pub const ROBOT: &str = "world/step/robot";
/// Positions of all hypotheses.
pub const HYPOTHESES: &str = "world/step/hypotheses";
/// What the best hypothesis saw.
pub const SEEN: &str = "world/step/detections";
/// The path.
pub const TRAJECTORY: &str = "world/result/trajectory";
/// The path by odometry alone.
pub const ODOMETRY: &str = "world/result/odometry";
/// The map.
pub const LANDMARKS: &str = "world/map/landmarks";
/// How well it is known.
pub const ELLIPSES: &str = "world/map/ellipses";
/// Which detections show which landmarks.
pub const WEIGHTS: &str = "world/result/weights";
/// Pose at a keyframe.
pub const FRAME_ROBOT: &str = "world/frame/robot";
/// What was seen there.
pub const FRAME_SEEN: &str = "world/frame/detections";
/// Which landmarks that shows.
pub const FRAME_WEIGHTS: &str = "world/frame/weights";

/// Detections in the picture.
pub const CAMERA_SEEN: &str = "camera/detections";
/// Where landmarks would be seen in it.
pub const CAMERA_LANDMARKS: &str = "camera/landmarks";
/// Which detections show which.
pub const CAMERA_WEIGHTS: &str = "camera/weights";

/// Hypotheses of the forward pass.
pub const HYPOTHESIS_COUNT: &str = "plots/hypotheses";
/// The objective.
pub const OBJECTIVE: &str = "plots/objective";
/// Landmarks of the map.
pub const LANDMARK_COUNT: &str = "plots/landmarks";

const PATH: [u8; 3] = [245, 245, 245];
const DRIFT: [u8; 3] = [150, 110, 70];
const ELLIPSE: [u8; 3] = [150, 150, 150];

const LEGEND: &str = "landmarks large · detections small, in the colour of their class · weights grey lines · trajectory white · \
                      odometry brown · hypotheses yellow = likely";

/// The colour of a class.
pub(super) fn colour_of(class: usize) -> Color {
    colour(class_colour(class))
}

/// A weight's line, dark for 0 and bright for 1.
pub(super) fn weight_colour(weight: f64) -> Color {
    let grey = (50.0 + 170.0 * weight.clamp(0.0, 1.0)) as u8;
    colour([grey; 3])
}

/// Logs the styles and the direction of y, once for the whole recording.
pub(super) fn log_styles(stream: &RecordingStream, root: &str) -> RecordingStreamResult<()> {
    let at = |path| under(root, path);
    stream.log_static(at(shared::WORLD), &Transform3D::from_scale([1.0, -1.0, 1.0]))?;
    let arrow = || Arrows2D::update_fields().with_colors([colour(PATH)]).with_radii([Radius::new_ui_points(2.5)]);
    for robot in [ROBOT, FRAME_ROBOT] {
        stream.log_static(at(robot), &arrow().with_draw_order(60.0))?;
    }
    for seen in [SEEN, FRAME_SEEN] {
        stream.log_static(at(seen), &points(3.0, 50.0))?;
    }
    stream.log_static(at(CAMERA_SEEN), &points(4.0, 50.0))?;
    stream.log_static(at(CAMERA_LANDMARKS), &points(8.0, 40.0))?;
    stream.log_static(at(CAMERA_WEIGHTS), &lines(ELLIPSE, 0.6, 45.0))?;
    stream.log_static(at(HYPOTHESES), &points(2.5, 55.0))?;
    stream.log_static(at(LANDMARKS), &points(6.0, 40.0))?;
    stream.log_static(at(ELLIPSES), &lines(ELLIPSE, 1.0, 35.0))?;
    for weights in [WEIGHTS, FRAME_WEIGHTS] {
        stream.log_static(at(weights), &lines(ELLIPSE, 0.6, if weights == WEIGHTS { 10.0 } else { 45.0 }))?;
    }
    stream.log_static(at(TRAJECTORY), &lines(PATH, 1.0, 30.0))?;
    stream.log_static(at(ODOMETRY), &lines(DRIFT, 0.7, 20.0))?;

    // Two mappings share a plot, so the name of each series has its root.
    let named = |name: &str| if root.is_empty() { name.to_owned() } else { format!("{root}: {name}") };
    let rgb = if root == shared::REPLAYED { [235, 80, 70] } else { [60, 140, 235] };
    let dots = |name| SeriesPoints::new().with_names([named(name)]).with_colors([colour(rgb)]).with_marker_sizes([4.0]);
    let line = SeriesLines::new().with_names([named("hypotheses")]).with_colors([colour(rgb)]).with_widths([1.5]);
    stream.log_static(at(HYPOTHESIS_COUNT), &line)?;
    stream.log_static(at(OBJECTIVE), &dots("objective of a sweep [nats]"))?;
    stream.log_static(at(LANDMARK_COUNT), &dots("landmarks"))
}

/// One map for each root, and below it what the camera saw, where there is one; and plots that all share.
pub(super) fn views(roots: &[&str], has_pictures: bool) -> Blueprint {
    let title = |root: &str| if root.is_empty() { LEGEND.to_owned() } else { format!("{root}: {LEGEND}") };
    let camera = |root: &str| {
        let (origin, contents) = (under(root, "camera"), format!("{}/**", under(root, "camera")));
        Spatial2DView::new("Camera: detections, landmarks large").with_origin(origin).with_contents([contents])
    };
    let maps = roots.iter().map(|root| match has_pictures {
        true => {
            Vertical::new([map_view(&title(root), root).into(), camera(root).into()]).with_row_shares([2.5, 1.0]).into()
        }
        false => map_view(&title(root), root).into(),
    });
    let all = |name, path: &str| plot(name, roots.iter().map(|root| under(root, path)));
    let plots = Vertical::new([
        all("Hypotheses of the forward pass", HYPOTHESIS_COUNT),
        all("Objective over the sweeps", OBJECTIVE),
        all("Landmarks", LANDMARK_COUNT),
    ]);
    let first = roots.first().copied().unwrap_or_default();
    let text = |name, path| TextDocumentView::new(name).with_origin(under(first, path)).into();
    let beside = Tabs::new([plots.with_name("Plots").into(), text("Configuration", ABOUT), text("Sensors", SENSORS)]);
    whole(Horizontal::new([Horizontal::new(maps).into(), beside.into()]).with_column_shares([2.4, 1.0]).into())
}
