//! What a recording holds: its paths, how they look, and how the viewer lays them out.
//!
//! | Path | What | When |
//! |---|---|---|
//! | [`SCAN_POINTS`] | the scan, where the best particle saw it | every step |
//! | [`SCAN_CLUSTERS`] | the clusters of the scan, there as well | every step |
//! | [`PARTICLES`] | positions of the particles, brighter where they weigh more | every step |
//! | [`ROBOT`] | pose of the best particle, an arrow | every step |
//! | [`TRAIL`], [`ODOMETRY_TRAIL`] | poses so far, in pieces `/0`, `/1`, .. | every step |
//! | [`MAP_CLUSTERS`] | clusters of the best particle's map, from end to end | where it changed |
//! | [`MAP_ELLIPSES`] | one standard deviation around their means | now and then, and at the end |
//! | [`TRAJECTORY`], [`ODOMETRY`] | the whole path of the best particle, and odometry | at the end |
//! | [`EFFECTIVE_SAMPLE_SIZE`], [`RESAMPLED`] | 1 / Σ w², and the same where the step resampled | every step |
//! | [`CLUSTERS`] | clusters in the map | every step |
//! | [`SECONDS`] | seconds by stage, in the order of [`STAGES`] | every step |
//!
//! Everything under [`WORLD`] is in the world's frame in metres, and odometry is moved as a whole so that it starts at
//! the robot's first pose. What is under [`STEP`] is cleared at the end of the run.
//!
//! The y axis of a 2-D view points down, that of the world up. [`WORLD`] therefore carries a transform that turns y
//! around, and the view shows the world from outside of it, so that numbers stay true and the map is not mirrored.

use ::rerun::blueprint::components::PanelState;
use ::rerun::blueprint::{
    Blueprint, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel, Spatial2DView, TimePanel, TimeSeriesView,
    Vertical,
};
use ::rerun::components::Radius;
use ::rerun::{
    Arrows2D, Color, LineStrips2D, Points2D, RecordingStream, RecordingStreamResult, SeriesLines, SeriesPoints,
    Transform3D,
};

/// Timeline: steps from 0.
pub const STEP_TIMELINE: &str = "step";
/// Timeline: seconds since the first step's stamp.
pub const TIME_TIMELINE: &str = "time";

/// Everything in the world's frame.
pub const WORLD: &str = "world";
/// What a step shows and the end clears.
pub const STEP: &str = "world/step";
/// Points of the scan.
pub const SCAN_POINTS: &str = "world/step/scan/points";
/// Clusters of the scan.
pub const SCAN_CLUSTERS: &str = "world/step/scan/clusters";
/// Positions of the particles.
pub const PARTICLES: &str = "world/step/particles";
/// Pose of the best particle.
pub const ROBOT: &str = "world/step/robot";
/// Poses of the best particle so far, as each step reported them.
pub const TRAIL: &str = "world/step/trajectory";
/// Odometry so far.
pub const ODOMETRY_TRAIL: &str = "world/step/odometry";
/// Clusters of the map.
pub const MAP_CLUSTERS: &str = "world/map/clusters";
/// Ellipses of the clusters of the map.
pub const MAP_ELLIPSES: &str = "world/map/ellipses";
/// The best particle's whole path.
pub const TRAJECTORY: &str = "world/result/trajectory";
/// The whole odometry.
pub const ODOMETRY: &str = "world/result/odometry";

/// Effective sample size.
pub const EFFECTIVE_SAMPLE_SIZE: &str = "plots/particles/effective_sample_size";
/// Effective sample size of the steps that resampled.
pub const RESAMPLED: &str = "plots/particles/resampled";
/// Number of clusters in the map.
pub const CLUSTERS: &str = "plots/clusters";
/// Seconds by stage.
pub const SECONDS: &str = "plots/seconds";
/// Stages of a step, with their colours.
pub const STAGES: [(&str, [u8; 3]); 6] = [
    ("cluster", [86, 180, 233]),
    ("track", [0, 158, 115]),
    ("propagate", [240, 228, 66]),
    ("weigh", [204, 121, 167]),
    ("resample", [160, 160, 160]),
    ("merge", [230, 159, 0]),
];

const POINT: [u8; 3] = [170, 225, 255];
const SCAN: [u8; 3] = [60, 140, 235];
const MAP: [u8; 3] = [235, 80, 70];
const ELLIPSE: [u8; 3] = [130, 50, 46];
const PATH: [u8; 3] = [245, 245, 245];
const DRIFT: [u8; 3] = [214, 140, 40];

/// Logs the styles and the direction of y, once for the whole recording.
pub(super) fn log_styles(stream: &RecordingStream) -> RecordingStreamResult<()> {
    stream.log_static(WORLD, &Transform3D::from_scale([1.0, -1.0, 1.0]))?;
    stream.log_static(SCAN_POINTS, &points(1.5, 31.0).with_colors([colour(POINT)]))?;
    stream.log_static(SCAN_CLUSTERS, &lines(SCAN, 2.0, 30.0))?;
    stream.log_static(PARTICLES, &points(2.0, 50.0))?;
    let robot = Arrows2D::update_fields().with_colors([colour(PATH)]).with_radii([Radius::new_ui_points(2.5)]);
    stream.log_static(ROBOT, &robot.with_draw_order(40.0))?;
    stream.log_static(MAP_CLUSTERS, &lines(MAP, 1.2, 20.0))?;
    stream.log_static(MAP_ELLIPSES, &lines(ELLIPSE, 0.5, 10.0))?;
    log_trajectory_style(stream, TRAJECTORY)?;
    log_odometry_style(stream, ODOMETRY)?;

    let line = |name: &str, rgb| SeriesLines::new().with_names([name]).with_colors([colour(rgb)]).with_widths([1.5]);
    stream.log_static(EFFECTIVE_SAMPLE_SIZE, &line("effective sample size", SCAN))?;
    let resampled = SeriesPoints::new().with_names(["resampled"]).with_colors([colour(DRIFT)]);
    stream.log_static(RESAMPLED, &resampled.with_marker_sizes([2.5]))?;
    stream.log_static(CLUSTERS, &line("clusters in the map", MAP))?;
    let stages = SeriesLines::new().with_names(STAGES.map(|stage| stage.0));
    stream.log_static(SECONDS, &stages.with_colors(STAGES.map(|stage| colour(stage.1))))
}

/// Logs how a path of the best particle looks.
pub(super) fn log_trajectory_style(stream: &RecordingStream, path: &str) -> RecordingStreamResult<()> {
    stream.log_static(path, &lines(PATH, 0.9, 26.0))
}

/// Logs how a path by odometry looks.
pub(super) fn log_odometry_style(stream: &RecordingStream, path: &str) -> RecordingStreamResult<()> {
    stream.log_static(path, &lines(DRIFT, 0.7, 25.0))
}

/// The map, large, and the three plots beside it.
pub(super) fn blueprint() -> Blueprint {
    // The title is the legend: a 2-D view has no other.
    let map =
        Spatial2DView::new("map red · scan blue · trajectory white · odometry orange · particles yellow = likely")
            .with_origin("/")
            .with_contents([format!("{WORLD}/**")]);
    let plot = |name: &str, path: &str| -> ContainerLike { TimeSeriesView::new(name).with_origin(path).into() };
    let plots = Vertical::new([
        plot("Effective sample size", "plots/particles"),
        plot("Clusters in the map", CLUSTERS),
        plot("Seconds a step", SECONDS),
    ])
    // The last plot has the longest legend.
    .with_row_shares([1.0, 1.0, 1.4]);
    Blueprint::new(Horizontal::new([map.into(), plots.into()]).with_column_shares([2.0, 1.0]))
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(TimePanel::new().with_state(PanelState::Collapsed).with_timeline(STEP_TIMELINE))
}

/// Colour of a particle of a share of the largest weight, by the logarithm of that share: yellow for one, dark violet
/// for 1e-4 and less.
pub fn particle_colour(share: f64) -> [u8; 3] {
    const DECADES: f64 = 4.0;
    const RARE: [f64; 3] = [80.0, 30.0, 120.0];
    const LIKELY: [f64; 3] = [255.0, 225.0, 40.0];
    // A weight that is no number counts as none.
    let brightness = (1.0 + share.max(0.0).log10() / DECADES).clamp(0.0, 1.0);
    std::array::from_fn(|i| (RARE[i] + brightness * (LIKELY[i] - RARE[i])).round() as u8)
}

pub(super) fn colour([red, green, blue]: [u8; 3]) -> Color {
    Color::from_rgb(red, green, blue)
}

/// Radius in points of the screen; what has a higher order lies above.
fn points(radius: f32, order: f32) -> Points2D {
    Points2D::update_fields().with_radii([Radius::new_ui_points(radius)]).with_draw_order(order)
}

fn lines(rgb: [u8; 3], radius: f32, order: f32) -> LineStrips2D {
    LineStrips2D::update_fields()
        .with_colors([colour(rgb)])
        .with_radii([Radius::new_ui_points(radius)])
        .with_draw_order(order)
}
