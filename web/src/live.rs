//! A run that is watched.

use crate::Viewer;
use crate::backend::Backend;
use crate::mapped::Mapped;
use ipslam::config::SlamConfig;
use ipslam::geometry::Pose;
use ipslam::gpu::DeviceError;
use ipslam::log::{LogEntry, LogSource};
use ipslam::objects::Landmark;
use ipslam::pipeline::{Progress, Run};
use ipslam::ppca::Cluster;
use ipslam::report::{Estimate, Estimator, Event, ReportedParticle, RunResult, StepReport};
use ipslam::slam::Slam;
use std::time::Duration;
use web_time::Instant;

/// Pictures come no faster than this: drawing them takes time from mapping.
const BETWEEN_PICTURES: Duration = Duration::from_millis(50);

/// Maps a log, of which the number of scans may be known.
pub fn map(
    log: &dyn LogSource,
    scans: Option<u64>,
    config: SlamConfig,
    backend: Backend,
    viewer: &Viewer,
) -> Result<Mapped, String> {
    let (evaluator, evaluated_on) = backend.choose()?;
    let slam = match evaluator {
        Some(evaluator) => Slam::with_evaluator(config, evaluator),
        None => Slam::new(config),
    };
    let mut slam = Watched { slam, viewer, scans: 0, due: Instant::now() };
    let run = Run { smoothing: Some(config.smoother()), ..Run::of(log) };
    let mut due = Instant::now();
    let mut tell = |progress: Progress<'_>| {
        if Instant::now() >= due {
            match progress {
                Progress::Entry { bytes, counts } => {
                    let of_bytes = bytes.map(|(read, all)| read as f64 / all.max(1) as f64);
                    let of_scans = scans.map(|all| counts.scans as f64 / all.max(1) as f64);
                    viewer.progress("Mapping", of_scans.or(of_bytes));
                }
                Progress::Smoothing(share) => viewer.progress("Fitting all scans to the map", Some(share)),
                _ => {}
            }
            due = Instant::now() + BETWEEN_PICTURES;
        }
        true
    };
    let outcome = run.run(&mut slam, &mut [], &mut tell).map_err(|error| error.to_string())?;
    viewer.progress("Drawing what is free", None);
    Mapped::new(log, &config.scan, outcome, evaluated_on)
}

/// The filter, which shows its steps.
struct Watched<'a> {
    slam: Slam,
    viewer: &'a Viewer,
    scans: u64,
    /// When the next picture is due.
    due: Instant,
}

impl Estimator for Watched<'_> {
    fn add(&mut self, entry: &LogEntry, observe: &mut dyn FnMut(&Event<'_>)) {
        let mut picture = None;
        self.slam.add(entry, &mut |event| {
            self.scans += u64::from(matches!(event, Event::Scan(_)));
            if let Event::Step(step) = event
                && Instant::now() >= self.due
            {
                picture = Some(Picture::of(step));
            }
            observe(event);
        });
        if let Some(Picture { walls, scan, particles, effective_sample_size }) = picture {
            let path = poses(self.slam.path());
            self.viewer.step(walls, path, scan, particles, self.scans as f64, effective_sample_size);
            self.due = Instant::now() + BETWEEN_PICTURES;
        }
    }

    fn result(&self) -> RunResult {
        self.slam.result()
    }

    fn landmarks(&self, poses: &[Estimate]) -> Vec<Landmark> {
        self.slam.landmarks(poses)
    }

    fn evaluator_failure(&self) -> Option<&DeviceError> {
        self.slam.evaluator_failure()
    }
}

/// What is shown of a step.
struct Picture {
    walls: Vec<f32>,
    scan: Vec<f32>,
    particles: Vec<f32>,
    effective_sample_size: f64,
}

impl Picture {
    fn of(step: &StepReport<'_>) -> Self {
        let robot = step.world_from_robot;
        let points = step.scan.points.iter().map(|&point| robot * point);
        let particle = |particle: &ReportedParticle| {
            let Pose { x, y, heading } = particle.world_from_robot;
            [x as f32, y as f32, heading as f32, particle.weight as f32]
        };
        Self {
            walls: walls(step.map),
            scan: points.flat_map(|point| [point.x as f32, point.y as f32]).collect(),
            particles: step.particles.iter().flat_map(particle).collect(),
            effective_sample_size: step.effective_sample_size,
        }
    }
}

/// Walls to their ends.
pub fn walls(clusters: &[Cluster]) -> Vec<f32> {
    let ends = clusters.iter().flat_map(Cluster::endpoints);
    ends.flat_map(|end| [end.x as f32, end.y as f32]).collect()
}

/// Rows of `x y heading`.
pub fn poses(poses: impl IntoIterator<Item = Pose>) -> Vec<f32> {
    poses.into_iter().flat_map(|Pose { x, y, heading }| [x as f32, y as f32, heading as f32]).collect()
}
