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
//! | [`CONFIDENCE`] | share of the weight around the pose, and share of the scan explained there | every step in a known map |
//! | [`PARTICLE_COUNT`] | log₁₀ of the number of particles | every step in a known map |
//! | [`SECONDS`] | seconds by stage, in the order of [`StageTimes::NAMES`] | every step |
//! | [`ABOUT`] | TOML: program, version, log, device, the earlier drive that is continued, configuration with its seed | at the start |
//! | [`EARLIER_WALLS`] | mean x, y, direction x, y, variances along and across, number of points of each wall of an earlier drive | at the start |
//! | [`EARLIER_FREE`] | its free area: side of a cell, x, y, heading of the raster; then of each row its number and its runs, start and end | at the start |
//! | [`LASER`] | x, y, heading and stamp of odometry, mounting x, y, heading, angle of the first beam and from one to the next, maximum range, motion during the sweep x, y, heading, all ranges | every reading |
//! | [`ODOMETRY_READING`], [`TRUTH`] | x, y, heading, stamp | every reading |
//! | [`TURN`] | stamp and turn by a gyroscope | every reading that has one |
//! | [`POSE`] | x, y and heading of the best particle, as f64 | every step |
//! | [`CHECKSUM`] | that of the step | every step |
//! | [`ALL_PARTICLES`] | x, y, heading and weight of every particle, as f64 | every step, if in full |
//! | [`PARENTS`] | for each map the number of the one that it was before the step | every step, if in full |
//! | [`RESULT`] | checksum of the result, and 1 where it was smoothed | at the end |
//!
//! With two runs side by side, the paths of each have a root: [`RECORDED`], [`REPLAYED`].
//!
//! Everything under [`WORLD`] is in the world's frame in metres, and odometry is moved as a whole so that it starts at
//! the robot's first pose. What is under [`STEP`] is cleared at the end of the run.
//!
//! The y axis of a 2-D view points down, that of the world up. [`WORLD`] therefore carries a transform that turns y
//! around, and the view shows the world from outside of it, so that numbers stay true and the map is not mirrored.

use crate::config::Config;
use crate::report::StageTimes;
use ::rerun::blueprint::components::{PanelState, PlayState};
use ::rerun::blueprint::{
    Blueprint, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel, Spatial2DView, Tabs, TextDocumentView,
    TimePanel, TimeSeriesView, Vertical,
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
/// Timeline of the log: its entries from 0.
pub const ENTRY_TIMELINE: &str = "entry";

/// What the run was started with.
pub const ABOUT: &str = "run/about";
/// Walls of the earlier drive whose map is continued.
pub const EARLIER_WALLS: &str = "run/earlier/walls";
/// Free area of that map.
pub const EARLIER_FREE: &str = "run/earlier/free";
/// Laser readings, as they came.
pub const LASER: &str = "run/log/laser";
/// Odometry, as it came.
pub const ODOMETRY_READING: &str = "run/log/odometry";
/// Turns by a gyroscope.
pub const TURN: &str = "run/log/turn";
/// True poses in the log.
pub const TRUTH: &str = "run/log/truth";
/// Pose of the best particle.
pub const POSE: &str = "run/step/pose";
/// [`StepReport::checksum`](crate::report::StepReport::checksum).
pub const CHECKSUM: &str = "run/step/checksum";
/// Every particle.
pub const ALL_PARTICLES: &str = "run/step/particles";
/// Ancestry.
pub const PARENTS: &str = "run/step/parents";
/// [`RunResult::checksum`](crate::report::RunResult::checksum).
pub const RESULT: &str = "run/result";

/// Root of a recorded run beside its replay.
pub const RECORDED: &str = "recorded";
/// Root of the replay.
pub const REPLAYED: &str = "replayed";

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
/// How far the pose can be relied on.
pub const CONFIDENCE: &str = "plots/confidence";
/// Powers of ten.
pub const PARTICLE_COUNT: &str = "plots/particle_count";
/// Seconds by stage.
pub const SECONDS: &str = "plots/seconds";
/// Colours of the stages, in the order of [`StageTimes::NAMES`].
const STAGES: [[u8; 3]; 7] =
    [[86, 180, 233], [0, 158, 115], [240, 228, 66], [204, 121, 167], [0, 114, 178], [160, 160, 160], [230, 159, 0]];

const POINT: [u8; 3] = [170, 225, 255];
const SCAN: [u8; 3] = [60, 140, 235];
const MAP: [u8; 3] = [235, 80, 70];
const ELLIPSE: [u8; 3] = [130, 50, 46];
const PATH: [u8; 3] = [245, 245, 245];
const DRIFT: [u8; 3] = [214, 140, 40];
const LOCATED: [u8; 3] = [60, 220, 110];
const LOST: [u8; 3] = [150, 150, 150];

/// The entity of a path of this module in a run whose paths lie under `root`; empty for a single run.
pub(super) fn under(root: &str, path: &str) -> String {
    if root.is_empty() { path.to_owned() } else { format!("{root}/{path}") }
}

/// Logs the styles and the direction of y, once for the whole run.
pub(super) fn log_styles(stream: &RecordingStream, root: &str) -> RecordingStreamResult<()> {
    let at = |path| under(root, path);
    stream.log_static(at(WORLD), &Transform3D::from_scale([1.0, -1.0, 1.0]))?;
    stream.log_static(at(SCAN_POINTS), &points(1.5, 31.0).with_colors([colour(POINT)]))?;
    stream.log_static(at(SCAN_CLUSTERS), &lines(SCAN, 2.0, 30.0))?;
    stream.log_static(at(PARTICLES), &points(2.0, 50.0))?;
    let robot = Arrows2D::update_fields().with_colors([colour(PATH)]).with_radii([Radius::new_ui_points(2.5)]);
    stream.log_static(at(ROBOT), &robot.with_draw_order(40.0))?;
    stream.log_static(at(MAP_CLUSTERS), &lines(MAP, 1.2, 20.0))?;
    stream.log_static(at(MAP_ELLIPSES), &lines(ELLIPSE, 0.5, 10.0))?;
    log_trajectory_style(stream, &at(TRAJECTORY))?;
    log_odometry_style(stream, &at(ODOMETRY))?;

    // Two runs share a plot, so the name of each series has its root.
    let named = |name: &str| if root.is_empty() { name.to_owned() } else { format!("{root}: {name}") };
    let (size, clusters) = if root == RECORDED { (PATH, DRIFT) } else { (SCAN, MAP) };
    let line = |name, rgb| SeriesLines::new().with_names([named(name)]).with_colors([colour(rgb)]).with_widths([1.5]);
    stream.log_static(at(EFFECTIVE_SAMPLE_SIZE), &line("effective sample size", size))?;
    let resampled = SeriesPoints::new().with_names([named("resampled")]).with_colors([colour(DRIFT)]);
    stream.log_static(at(RESAMPLED), &resampled.with_marker_sizes([2.5]))?;
    stream.log_static(at(CLUSTERS), &line("clusters in the map", clusters))?;
    let confidence = SeriesLines::new().with_names(["weight around the pose", "scan explained there"].map(named));
    stream.log_static(at(CONFIDENCE), &confidence.with_colors([SCAN, LOCATED].map(colour)).with_widths([1.5, 1.5]))?;
    stream.log_static(at(PARTICLE_COUNT), &line("log10 of the number of particles", DRIFT))?;
    let stages = SeriesLines::new().with_names(StageTimes::NAMES);
    stream.log_static(at(SECONDS), &stages.with_colors(STAGES.map(colour)))
}

/// Logs how a path of the best particle looks.
pub(super) fn log_trajectory_style(stream: &RecordingStream, path: &str) -> RecordingStreamResult<()> {
    stream.log_static(path, &lines(PATH, 0.9, 26.0))
}

/// Logs how a path by odometry looks.
pub(super) fn log_odometry_style(stream: &RecordingStream, path: &str) -> RecordingStreamResult<()> {
    stream.log_static(path, &lines(DRIFT, 0.7, 25.0))
}

/// The map, large, and three plots beside it.
pub(super) fn views(config: &Config) -> Blueprint {
    let (legend, first, second) = match config {
        // Recordings of objects have another blueprint.
        Config::Slam(_) | Config::Semantic(_) => (
            LEGEND,
            plot("Effective sample size", ["plots/particles/**".to_owned()]),
            plot("Clusters in the map", [CLUSTERS.to_owned()]),
        ),
        Config::Localization(_) => (
            "map red · scan blue · particles yellow = likely · arrow green = located, grey = not",
            plot("Confidence", [CONFIDENCE.to_owned()]),
            plot("Particles, powers of ten", [PARTICLE_COUNT.to_owned()]),
        ),
    };
    let plots = Vertical::new([first, second, plot("Seconds a step", [SECONDS.to_owned()])])
        // The last plot has the longest legend.
        .with_row_shares([1.0, 1.0, 1.4])
        .with_name("Plots");
    let about = TextDocumentView::new("Configuration").with_origin(ABOUT);
    let beside = Tabs::new([plots.into(), about.into()]);
    whole(Horizontal::new([map_view(legend, "").into(), beside.into()]).with_column_shares([2.0, 1.0]).into())
}

/// A recorded run and its replay: two maps side by side, and plots that show both.
pub(super) fn comparison_blueprint() -> Blueprint {
    let roots = [RECORDED, REPLAYED];
    let maps = roots.map(|root| map_view(&format!("{root}: {LEGEND}"), root).into());
    let both = |path: &str| roots.map(|root| under(root, path));
    let plots = Horizontal::new([
        plot("Effective sample size", both("plots/particles/**")),
        plot("Clusters in the map", both(CLUSTERS)),
        plot("Seconds a step, recorded", [under(RECORDED, SECONDS)]),
        plot("Seconds a step, replayed", [under(REPLAYED, SECONDS)]),
    ]);
    whole(Vertical::new([Horizontal::new(maps).into(), plots.into()]).with_row_shares([2.2, 1.0]).into())
}

/// The title is the legend: a 2-D view has no other.
const LEGEND: &str = "map red · scan blue · trajectory white · odometry orange · particles yellow = likely";

pub(super) fn map_view(title: &str, root: &str) -> Spatial2DView {
    Spatial2DView::new(title).with_origin(format!("/{root}")).with_contents([format!("{}/**", under(root, WORLD))])
}

pub(super) fn plot(name: &str, contents: impl IntoIterator<Item = String>) -> ContainerLike {
    TimeSeriesView::new(name).with_origin("/").with_contents(contents).into()
}

pub(super) fn whole(views: ContainerLike) -> Blueprint {
    // The end of the run shows the whole map.
    let time = TimePanel::new().with_timeline(STEP_TIMELINE).with_play_state(PlayState::Following);
    let time = time.with_state(PanelState::Collapsed);
    Blueprint::new(views)
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(time)
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

/// Colour of the robot in a known map.
pub(super) fn confidence_colour(is_located: bool) -> Color {
    colour(if is_located { LOCATED } else { LOST })
}

pub(super) fn colour([red, green, blue]: [u8; 3]) -> Color {
    Color::from_rgb(red, green, blue)
}

/// Radius in points of the screen; what has a higher order lies above.
pub(super) fn points(radius: f32, order: f32) -> Points2D {
    Points2D::update_fields().with_radii([Radius::new_ui_points(radius)]).with_draw_order(order)
}

pub(super) fn lines(rgb: [u8; 3], radius: f32, order: f32) -> LineStrips2D {
    LineStrips2D::update_fields()
        .with_colors([colour(rgb)])
        .with_radii([Radius::new_ui_points(radius)])
        .with_draw_order(order)
}
