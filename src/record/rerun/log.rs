//! Steps and results as entities of a recording.

use super::layout;
use crate::geometry::{Pose, StampedPose};
use crate::ppca::Cluster;
use crate::record::{ReportedParticle, RunResult, StageTimes, StepReport};
use ::rerun::archetypes::Clear;
use ::rerun::{Arrows2D, LineStrips2D, Points2D, RecordingStream, RecordingStreamResult, Scalars};
use nalgebra::Point2;
use std::f64::consts::TAU;

/// Of more particles than this, so many are shown, evenly spread over their order.
const MOST_PARTICLES: usize = 2000;
/// Poses in a piece of a trail. A step logs the last piece anew, so its cost does not grow with the run.
const TRAIL_PIECE: usize = 64;
/// Ellipses take several times the room of the clusters, so they follow every so many steps.
const ELLIPSES_EVERY: u32 = 10;
/// Corners of the polygon that stands for an ellipse.
const ELLIPSE_CORNERS: u32 = 16;
/// Length of the robot's arrow \[m\].
const ARROW: f64 = 1.0;

/// What is remembered from step to step.
pub(super) struct Recorder {
    stream: RecordingStream,
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
    pub(super) fn new(stream: RecordingStream) -> Self {
        Self {
            stream,
            step: 0,
            first_stamp: None,
            time: 0.0,
            world_from_odom: None,
            trajectory: Trail::new(layout::TRAIL, layout::log_trajectory_style),
            odometry: Trail::new(layout::ODOMETRY_TRAIL, layout::log_odometry_style),
            map: Vec::new(),
        }
    }

    pub(super) fn stream(&self) -> &RecordingStream {
        &self.stream
    }

    /// The step logged last.
    pub(super) fn step(&self) -> u32 {
        self.step
    }

    pub(super) fn log_step(&mut self, report: &StepReport<'_>) -> RecordingStreamResult<()> {
        self.set_time(report.step, report.stamp);
        let pose = report.world_from_robot;
        let world_from_odom = *self.world_from_odom.get_or_insert(pose * report.odom_from_robot.inverse());
        let stream = &self.stream;
        stream
            .log(layout::SCAN_POINTS, &Points2D::new(report.scan.points.iter().map(|&point| position(pose * point))))?;
        let scan_clusters: Vec<_> = report.scan_clusters.iter().map(|cluster| cluster.transformed(pose)).collect();
        stream.log(layout::SCAN_CLUSTERS, &ends(&scan_clusters))?;
        stream.log(layout::PARTICLES, &particles(report.particles))?;
        stream.log(layout::ROBOT, &arrow(pose))?;
        self.trajectory.push(stream, pose)?;
        self.odometry.push(stream, world_from_odom * report.odom_from_robot)?;
        if self.map != report.map {
            self.map = report.map.to_vec();
            stream.log(layout::MAP_CLUSTERS, &ends(&self.map))?;
        }
        if report.step.is_multiple_of(ELLIPSES_EVERY) {
            stream.log(layout::MAP_ELLIPSES, &ellipses(&self.map))?;
        }

        let size = Scalars::new([report.effective_sample_size]);
        stream.log(layout::EFFECTIVE_SAMPLE_SIZE, &size)?;
        if report.resampled {
            stream.log(layout::RESAMPLED, &size)?;
        }
        stream.log(layout::CLUSTERS, &Scalars::new([report.map.len() as f64]))?;
        stream.log(layout::SECONDS, &Scalars::new(seconds(&report.times)))
    }

    /// Logs the result as one more step, which shows nothing else.
    pub(super) fn log_result(&mut self, result: &RunResult) -> RecordingStreamResult<()> {
        let first = |poses: &[StampedPose]| poses.first().map_or(Pose::IDENTITY, |stamped| stamped.pose);
        let world_from_odom = first(&result.trajectory) * first(&result.odometry).inverse();
        if let Some(last) = result.trajectory.last() {
            self.set_time(self.step + 1, last.stamp);
        }
        let stream = &self.stream;
        stream.log(layout::STEP, &Clear::recursive())?;
        stream.log(layout::MAP_CLUSTERS, &ends(&result.map))?;
        stream.log(layout::MAP_ELLIPSES, &ellipses(&result.map))?;
        let path = result.trajectory.iter().map(|stamped| position(stamped.pose.position()));
        stream.log(layout::TRAJECTORY, &LineStrips2D::new([path.collect::<Vec<_>>()]))?;
        let path = result.odometry.iter().map(|stamped| position((world_from_odom * stamped.pose).position()));
        stream.log(layout::ODOMETRY, &LineStrips2D::new([path.collect::<Vec<_>>()]))
    }

    /// Moves both timelines; what is logged next belongs there.
    fn set_time(&mut self, step: u32, stamp: f64) {
        self.step = step;
        let first = *self.first_stamp.get_or_insert(stamp);
        // A stamp that is no number moves nothing.
        self.time = self.time.max(stamp - first);
        self.stream.set_time_sequence(layout::STEP_TIMELINE, step);
        self.stream.set_duration_secs(layout::TIME_TIMELINE, self.time);
    }
}

/// A path that grows with every step, as polylines of a bounded length that touch.
struct Trail {
    path: &'static str,
    log_style: fn(&RecordingStream, &str) -> RecordingStreamResult<()>,
    pieces: u32,
    last_piece: Vec<[f32; 2]>,
}

impl Trail {
    fn new(path: &'static str, log_style: fn(&RecordingStream, &str) -> RecordingStreamResult<()>) -> Self {
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

fn position(point: Point2<f64>) -> [f32; 2] {
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

fn arrow(pose: Pose) -> Arrows2D {
    let vector = pose.direction() * ARROW;
    Arrows2D::from_vectors([[vector.x as f32, vector.y as f32]]).with_origins([position(pose.position())])
}

/// The likeliest are logged last, so that they lie above.
fn particles(all: &[ReportedParticle]) -> Points2D {
    let shown = all.len().min(MOST_PARTICLES);
    let mut sample: Vec<_> = (0..shown).map(|i| all[i * all.len() / shown]).collect();
    sample.sort_by(|a, b| a.weight.total_cmp(&b.weight));
    let largest = all.iter().map(|particle| particle.weight).fold(0.0, f64::max);
    Points2D::new(sample.iter().map(|particle| position(particle.world_from_robot.position())))
        .with_colors(sample.iter().map(|particle| layout::colour(layout::particle_colour(particle.weight / largest))))
}

/// In the order of [`layout::STAGES`].
fn seconds(times: &StageTimes) -> [f64; 6] {
    let StageTimes { cluster, track, propagate, weigh, resample, merge } = *times;
    [cluster, track, propagate, weigh, resample, merge]
}
