//! Mapping live: the filter, whose map is published while the robot drives.

use super::messages::Empty;
use super::node::{LiveError, Node, Publishers};
use super::publisher::{Clock, Reporter, show_grid};
use crate::geometry::Pose;
use crate::gpu::DeviceError;
use crate::grid::{GridBuilder, OccupancyGrid};
use crate::io::mcap::FrameNames;
use crate::log::LogEntry;
use crate::objects::Landmark;
use crate::pipeline::NO_ODOMETRY;
use crate::report::{Estimate, Estimator, Event, RunResult};
use crate::scan::Scan;
use crate::slam::Slam;
use ros2_client::Subscription;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

/// How often the grid is drawn anew, at most.
const EVERY: Duration = Duration::from_secs(3);

/// A filter whose map others see.
pub struct LiveMapping {
    slam: Slam,
    reporter: Reporter,
    /// Whoever asks for the map to be saved.
    requests: Subscription<Empty>,
    is_asked: bool,
    /// Scans of steps that were not yet handed to who draws.
    seen: Vec<Seen>,
    drawing: SyncSender<Drawing>,
    clock: Clock,
    effective_sample_size: f64,
    walls: usize,
    has_odometry: bool,
}

/// The scan of a step.
struct Seen {
    scan: Scan,
    robot_from_laser: Pose,
}

/// The grid to be drawn.
struct Drawing {
    stamp: f64,
    /// Of the steps since the last drawing.
    seen: Vec<Seen>,
    /// `world_from_robot` at every step.
    path: Vec<Pose>,
    /// To be saved with the grid.
    result: Option<RunResult>,
}

/// Saves the result so far and its grid, on a thread of its own.
pub type Save = Box<dyn FnMut(RunResult, OccupancyGrid) + Send>;

impl LiveMapping {
    /// A filter before its first reading, of a robot with these frames. The grid has cells of this side \[m\]; `save` is called
    /// where somebody asks for it.
    ///
    /// # Errors
    /// The topic for such requests cannot be made, or the system gives no thread.
    pub fn new(node: &mut Node, frames: FrameNames, slam: Slam, cell_size: f64, save: Save) -> Result<Self, LiveError> {
        let requests = node.save_requests()?;
        let (drawing, drawings) = sync_channel(1);
        let (publishers, map_frame) = (Arc::clone(&node.publishers), node.names.map_frame.clone());
        let draw = move || draw(&drawings, &publishers, &map_frame, cell_size, save);
        std::thread::Builder::new().name("map".to_owned()).spawn(draw)?;
        Ok(Self {
            slam,
            has_odometry: frames.odom.is_some(),
            reporter: Reporter::new(node, frames),
            requests,
            is_asked: false,
            seen: Vec::new(),
            drawing,
            clock: Clock::default(),
            effective_sample_size: 0.0,
            walls: 0,
        })
    }

    /// Hands what is new to who draws, unless the last grid is still being drawn.
    fn draw(&mut self, stamp: f64) {
        self.is_asked |= matches!(self.requests.take(), Ok(Some(_)));
        let has_news = !self.seen.is_empty() && self.clock.is_due(EVERY);
        if !has_news && !self.is_asked {
            return;
        }
        let result = self.is_asked.then(|| self.slam.result());
        let drawing = Drawing { stamp, seen: std::mem::take(&mut self.seen), path: self.slam.path(), result };
        match self.drawing.try_send(drawing) {
            Ok(()) => self.is_asked = false,
            Err(TrySendError::Full(drawing) | TrySendError::Disconnected(drawing)) => self.seen = drawing.seen,
        }
    }
}

impl Estimator for LiveMapping {
    fn add(&mut self, entry: &LogEntry, observe: &mut dyn FnMut(&Event<'_>)) {
        let Self { slam, reporter, seen, effective_sample_size, walls, .. } = self;
        slam.add(entry, &mut |event| {
            if let (Event::Step(report), LogEntry::Laser(reading)) = (event, entry) {
                seen.push(Seen { scan: report.scan.clone(), robot_from_laser: reading.robot_from_laser });
                (*effective_sample_size, *walls) = (report.effective_sample_size, report.map.len());
            }
            reporter.on_event(entry, event);
            observe(event);
        });
        self.reporter.taken(entry);
        self.draw(entry.stamp());
        let Self { slam, reporter, walls, effective_sample_size, has_odometry, .. } = self;
        reporter.diagnose(entry.stamp(), || {
            let (open, mut numbers) = judge_loops(slam);
            let doubts = open.into_iter().chain((!*has_odometry).then(|| NO_ODOMETRY.to_owned()));
            numbers.push(("walls", walls.to_string()));
            numbers.push(("effective sample size", format!("{effective_sample_size:.1}")));
            (doubts.collect(), numbers)
        });
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

/// Draws grids until no more are wanted. A path changes as it grows, so that all of it is drawn each time.
fn draw(drawings: &Receiver<Drawing>, publishers: &Publishers, map_frame: &str, cell_size: f64, mut save: Save) {
    let mut all: Vec<Seen> = Vec::new();
    for Drawing { stamp, seen, path, result } in drawings {
        all.extend(seen);
        let mut builder = GridBuilder::new(cell_size);
        for (Seen { scan, robot_from_laser }, &world_from_robot) in all.iter().zip(&path) {
            builder.add_scan(scan, *robot_from_laser, world_from_robot);
        }
        // A grid that is too large is an error of the run's end.
        let Ok(grid) = builder.finish() else { continue };
        show_grid(publishers, map_frame, stamp, &grid);
        if let Some(result) = result {
            save(result, grid);
        }
    }
}

/// What is doubtful of the loops, and their numbers.
fn judge_loops(slam: &Slam) -> (Option<String>, Vec<(&'static str, String)>) {
    let loops = slam.loops();
    let open = loops.iter().filter(|found| !found.is_closed).count();
    let doubt = (open > 0).then(|| format!("loops that were found and that the path does not close: {open}"));
    (doubt, vec![("loops found", loops.len().to_string()), ("loops open", open.to_string())])
}
