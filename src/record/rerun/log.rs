//! Entries of the log, steps and results as entities of a recording.

use super::rows::Rows;
use super::{Level, blueprint, earlier};
use crate::config::Config;
use crate::geometry::{Pose, StampedPose};
use crate::log::{LaserReading, LogEntry};
use crate::pipeline::{Continued, RunInfo};
use crate::ppca::Cluster;
use crate::report::{Confidence, ReportedParticle, RunResult, StepReport};
use ::rerun::archetypes::Clear;
use ::rerun::{Arrows2D, LineStrips2D, Points2D, RecordingStream, RecordingStreamResult, Scalars, TextDocument};
use nalgebra::Point2;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::time::{Duration, Instant};

/// At most this many particles are shown, at a uniform stride.
const MOST_PARTICLES: usize = 2000;
/// The same where the recording is light.
const MOST_PARTICLES_IF_LIGHT: usize = 250;
/// Poses in a piece of a trail. A step logs the last piece anew, so its cost does not grow with the run.
const TRAIL_PIECE: usize = 64;
/// Ellipses take several times the room of the clusters, so they are logged every few steps.
const ELLIPSES_EVERY: u32 = 10;
/// Corners of the polygon that stands for an ellipse.
const ELLIPSE_CORNERS: u32 = 16;
/// Length of the robot's arrow \[m\].
const ARROW: f64 = 1.0;
/// Entries of the log are sent together, and never later than this.
const ENTRIES_EVERY: Duration = Duration::from_millis(300);

/// [`blueprint::ABOUT`] as TOML.
#[derive(Serialize, Deserialize)]
pub(super) struct About {
    /// Version of the program.
    pub version: String,
    /// Name of the log.
    pub log: String,
    /// What evaluated the particles.
    pub device: String,
    /// The earlier drive that was continued.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub continues: Option<AboutContinued>,
    /// Everything that was set.
    pub configuration: Config,
}

/// [`Continued`] but for its map.
#[derive(Serialize, Deserialize)]
pub(super) struct AboutContinued {
    pub name: String,
    pub first_scan: usize,
    pub world_from_robot: Pose,
}

/// State from step to step.
pub(super) struct Recorder {
    stream: RecordingStream,
    /// What all paths lie under.
    root: &'static str,
    is_mapping: bool,
    level: Level,
    entries: Entries,
    step: u32,
    first_stamp: Option<f64>,
    /// On the timeline of time \[s\].
    time: f64,
    world_from_odom: Option<Pose>,
    trajectory: Trail,
    odometry: Trail,
    map: Vec<Cluster>,
}

impl Recorder {
    /// Logs what does not change.
    pub(super) fn new(
        stream: RecordingStream,
        root: &'static str,
        level: Level,
        info: &RunInfo,
    ) -> RecordingStreamResult<Self> {
        blueprint::log_styles(&stream, root)?;
        let about = About {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            log: info.log.clone(),
            device: info.device.clone(),
            continues: info.continues.as_ref().map(|Continued { name, first_scan, world_from_robot, .. }| {
                AboutContinued { name: name.clone(), first_scan: *first_scan, world_from_robot: *world_from_robot }
            }),
            configuration: info.config,
        };
        // A configuration that was found valid can be written.
        let text = toml::to_string(&about).unwrap_or_default();
        stream.log_static(blueprint::under(root, blueprint::ABOUT), &TextDocument::new(text))?;
        if let Some(Continued { map, .. }) = &info.continues {
            earlier::send(map, &stream, root)?;
        }
        let trail = |path, log_style| Trail::new(blueprint::under(root, path), log_style);
        Ok(Self {
            trajectory: trail(blueprint::TRAIL, blueprint::log_trajectory_style),
            odometry: trail(blueprint::ODOMETRY_TRAIL, blueprint::log_odometry_style),
            stream,
            root,
            is_mapping: matches!(info.config, Config::Slam(_)),
            level,
            entries: Entries::new(),
            step: 0,
            first_stamp: None,
            time: 0.0,
            world_from_odom: None,
            map: Vec::new(),
        })
    }

    pub(super) fn stream(&self) -> &RecordingStream {
        &self.stream
    }

    /// The step logged last.
    pub(super) fn step(&self) -> u32 {
        self.step
    }

    fn path(&self, path: &str) -> String {
        blueprint::under(self.root, path)
    }

    pub(super) fn log_entry(&mut self, entry: &LogEntry) -> RecordingStreamResult<()> {
        self.entries.push(entry);
        if self.entries.sent.elapsed() > ENTRIES_EVERY { self.entries.send(&self.stream, self.root) } else { Ok(()) }
    }

    pub(super) fn log_step(&mut self, report: &StepReport<'_>) -> RecordingStreamResult<()> {
        // A step that is recorded can be repeated: what led to it is there before it.
        self.entries.send(&self.stream, self.root)?;
        self.set_time(report.step, report.stamp);
        let pose = report.world_from_robot;
        let world_from_odom = *self.world_from_odom.get_or_insert(pose * report.odom_from_robot.inverse());
        let stream = &self.stream;
        let points = report.scan.points.iter().map(|&point| position(pose * point));
        stream.log(self.path(blueprint::SCAN_POINTS), &Points2D::new(points))?;
        stream.log(self.path(blueprint::PARTICLES), &self.particles(report.particles))?;
        let robot = match report.confidence {
            Some(confidence) => arrow(pose).with_colors([blueprint::confidence_colour(confidence.is_located)]),
            None => arrow(pose),
        };
        stream.log(self.path(blueprint::ROBOT), &robot)?;
        if let Some(Confidence { weight, explained, .. }) = report.confidence {
            stream.log(self.path(blueprint::CONFIDENCE), &Scalars::new([weight, explained]))?;
            // On a scale of tens: they fall from a million to a few hundred.
            let number = (report.particles.len().max(1) as f64).log10();
            stream.log(self.path(blueprint::PARTICLE_COUNT), &Scalars::new([number]))?;
        }
        if report.confidence.is_none_or(|confidence| confidence.is_located) {
            self.trajectory.push(stream, pose)?;
        }
        // In a known map odometry starts nowhere.
        if self.is_mapping {
            self.odometry.push(stream, world_from_odom * report.odom_from_robot)?;
        }
        if self.map != report.map {
            self.map = report.map.to_vec();
            stream.log(self.path(blueprint::MAP_CLUSTERS), &ends(&self.map))?;
        }
        stream.log(self.path(blueprint::POSE), &Scalars::new([pose.x, pose.y, pose.heading]))?;
        stream.log(self.path(blueprint::CHECKSUM), &Scalars::new([f64::from(report.checksum())]))?;
        if self.level == Level::Full {
            self.log_in_full(report)?;
        }

        let size = Scalars::new([report.effective_sample_size]);
        stream.log(self.path(blueprint::EFFECTIVE_SAMPLE_SIZE), &size)?;
        if report.resampled {
            stream.log(self.path(blueprint::RESAMPLED), &size)?;
        }
        stream.log(self.path(blueprint::CLUSTERS), &Scalars::new([report.map.len() as f64]))?;
        stream.log(self.path(blueprint::SECONDS), &Scalars::new(report.times.seconds()))
    }

    fn log_in_full(&self, report: &StepReport<'_>) -> RecordingStreamResult<()> {
        let stream = &self.stream;
        let pose = report.world_from_robot;
        let scan_clusters: Vec<_> = report.scan_clusters.iter().map(|cluster| cluster.transformed(pose)).collect();
        stream.log(self.path(blueprint::SCAN_CLUSTERS), &ends(&scan_clusters))?;
        if report.step.is_multiple_of(ELLIPSES_EVERY) {
            stream.log(self.path(blueprint::MAP_ELLIPSES), &ellipses(&self.map))?;
        }
        let particles = report
            .particles
            .iter()
            .flat_map(|ReportedParticle { world_from_robot: pose, weight }| [pose.x, pose.y, pose.heading, *weight]);
        stream.log(self.path(blueprint::ALL_PARTICLES), &Scalars::new(particles))?;
        let parents = report.parents.iter().map(|&parent| f64::from(parent));
        stream.log(self.path(blueprint::PARENTS), &Scalars::new(parents))
    }

    /// Logs the result as one more step, which shows nothing else.
    pub(super) fn log_result(&mut self, result: &RunResult, is_smoothed: bool) -> RecordingStreamResult<()> {
        self.entries.send(&self.stream, self.root)?;
        let (trajectory, odometry) = (result.trajectory(), result.odometry());
        let first = |poses: &[StampedPose]| poses.first().map_or(Pose::IDENTITY, |stamped| stamped.pose);
        let world_from_odom = first(&trajectory) * first(&odometry).inverse();
        if let Some(last) = trajectory.last() {
            self.set_time(self.step + 1, last.stamp);
        }
        let stream = &self.stream;
        stream.log(self.path(blueprint::STEP), &Clear::recursive())?;
        stream.log(self.path(blueprint::MAP_CLUSTERS), &ends(&result.map.clusters))?;
        stream.log(self.path(blueprint::MAP_ELLIPSES), &ellipses(&result.map.clusters))?;
        let path = trajectory.iter().map(|stamped| position(stamped.pose.position()));
        stream.log(self.path(blueprint::TRAJECTORY), &LineStrips2D::new([path.collect::<Vec<_>>()]))?;
        let path = odometry.iter().map(|stamped| position((world_from_odom * stamped.pose).position()));
        stream.log(self.path(blueprint::ODOMETRY), &LineStrips2D::new([path.collect::<Vec<_>>()]))?;
        let result = [f64::from(result.checksum()), f64::from(u8::from(is_smoothed))];
        stream.log(self.path(blueprint::RESULT), &Scalars::new(result))
    }

    /// Moves both timelines; what is logged next belongs there.
    fn set_time(&mut self, step: u32, stamp: f64) {
        self.step = step;
        let first = *self.first_stamp.get_or_insert(stamp);
        // A stamp that is no number moves nothing.
        self.time = self.time.max(stamp - first);
        self.stream.set_time_sequence(blueprint::STEP_TIMELINE, step);
        self.stream.set_duration_secs(blueprint::TIME_TIMELINE, self.time);
    }

    /// The likeliest are logged last, so that they lie above.
    fn particles(&self, all: &[ReportedParticle]) -> Points2D {
        let most = if self.level == Level::Full { MOST_PARTICLES } else { MOST_PARTICLES_IF_LIGHT };
        let shown = all.len().min(most);
        let mut sample: Vec<_> = (0..shown).map(|i| all[i * all.len() / shown]).collect();
        sample.sort_by(|a, b| a.weight.total_cmp(&b.weight));
        let largest = all.iter().map(|particle| particle.weight).fold(0.0, f64::max);
        let colour = |particle: &ReportedParticle| blueprint::particle_colour(particle.weight / largest);
        Points2D::new(sample.iter().map(|particle| position(particle.world_from_robot.position())))
            .with_colors(sample.iter().map(|particle| blueprint::colour(colour(particle))))
    }
}

/// Entries of the log that wait to be sent.
struct Entries {
    next: i64,
    laser: Rows,
    odometry: Rows,
    turn: Rows,
    truth: Rows,
    sent: Instant,
}

impl Entries {
    fn new() -> Self {
        let [laser, odometry, turn, truth] = Default::default();
        Self { next: 0, laser, odometry, turn, truth, sent: Instant::now() }
    }

    fn push(&mut self, entry: &LogEntry) {
        let pose = |Pose { x, y, heading }: Pose| [x, y, heading];
        match entry {
            LogEntry::Odometry { stamp, odom_from_robot } => {
                self.odometry.push(self.next, pose(*odom_from_robot).into_iter().chain([*stamp]));
            }
            LogEntry::Turn { stamp, by_gyro } => self.turn.push(self.next, [*stamp, *by_gyro]),
            LogEntry::Truth { stamp, world_from_robot } => {
                self.truth.push(self.next, pose(*world_from_robot).into_iter().chain([*stamp]));
            }
            LogEntry::Laser(LaserReading {
                stamp,
                odom_from_robot,
                robot_from_laser,
                start_from_end,
                first_angle,
                angle_step,
                max_range,
                ranges,
            }) => {
                let poses = pose(*odom_from_robot).into_iter().chain([*stamp]).chain(pose(*robot_from_laser));
                let beams = [*first_angle, *angle_step, *max_range].into_iter().chain(pose(*start_from_end));
                self.laser.push(self.next, poses.chain(beams).chain(ranges.iter().copied()));
            }
        }
        self.next += 1;
    }

    fn send(&mut self, stream: &RecordingStream, root: &str) -> RecordingStreamResult<()> {
        self.sent = Instant::now();
        self.laser.send(stream, &blueprint::under(root, blueprint::LASER))?;
        self.odometry.send(stream, &blueprint::under(root, blueprint::ODOMETRY_READING))?;
        self.turn.send(stream, &blueprint::under(root, blueprint::TURN))?;
        self.truth.send(stream, &blueprint::under(root, blueprint::TRUTH))
    }
}

/// A path that grows with every step, as polylines of a bounded length that touch.
struct Trail {
    path: String,
    log_style: fn(&RecordingStream, &str) -> RecordingStreamResult<()>,
    pieces: u32,
    last_piece: Vec<[f32; 2]>,
}

impl Trail {
    fn new(path: String, log_style: fn(&RecordingStream, &str) -> RecordingStreamResult<()>) -> Self {
        Self { path, log_style, pieces: 0, last_piece: Vec::new() }
    }

    fn push(&mut self, stream: &RecordingStream, pose: Pose) -> RecordingStreamResult<()> {
        let full = self.last_piece.len() == TRAIL_PIECE;
        if full || self.pieces == 0 {
            // The new piece starts where the one before ends.
            self.last_piece.drain(..self.last_piece.len().saturating_sub(1));
            self.pieces += 1;
            (self.log_style)(stream, &self.piece())?;
        }
        self.last_piece.push(position(pose.position()));
        stream.log(self.piece(), &LineStrips2D::new([&self.last_piece[..]]))
    }

    fn piece(&self) -> String {
        format!("{}/{}", self.path, self.pieces.saturating_sub(1))
    }
}

pub(super) fn position(point: Point2<f64>) -> [f32; 2] {
    [point.x as f32, point.y as f32]
}

fn ends(clusters: &[Cluster]) -> LineStrips2D {
    LineStrips2D::new(clusters.iter().map(|cluster| cluster.endpoints().map(position)))
}

/// Where z = μ + √λ₁ cos t u₁ + √λ₂ sin t u₂.
fn ellipses(clusters: &[Cluster]) -> LineStrips2D {
    LineStrips2D::new(clusters.iter().map(|cluster| {
        let along = cluster.direction * cluster.along_variance.sqrt();
        let across = cluster.normal() * cluster.across_variance.sqrt();
        let corner = |i| {
            let (sin, cos) = (TAU * f64::from(i) / f64::from(ELLIPSE_CORNERS)).sin_cos();
            position(cluster.mean + along * cos + across * sin)
        };
        (0..=ELLIPSE_CORNERS).map(corner).collect::<Vec<_>>()
    }))
}

pub(super) fn arrow(pose: Pose) -> Arrows2D {
    let vector = pose.direction() * ARROW;
    Arrows2D::from_vectors([[vector.x as f32, vector.y as f32]]).with_origins([position(pose.position())])
}
