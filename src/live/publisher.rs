//! What an estimator reports, for others: the correction of the odometry, the robot's pose, walls and diagnostics.

use super::input::Shared;
use super::messages::{
    DiagnosticStatus, Diagnostics, Header, MapMetaData, Marker, Markers, OccupancyGrid, PoseWithCovariance,
    StampedTransform, Time, Transforms,
};
use super::node::{Node, Publishers};
use crate::geometry::Pose;
use crate::grid;
use crate::io::mcap::FrameNames;
use crate::log::LogEntry;
use crate::ppca::Cluster;
use crate::report::{Estimate, Event};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How often walls and diagnostics are published, at most.
const EVERY: Duration = Duration::from_secs(1);
/// Walls are shown as thick as a cell of the grid \[m\].
const WIDTH: f64 = 0.05;

/// Publishes the events of one estimator.
pub(super) struct Reporter {
    publishers: Arc<Publishers>,
    shared: Shared,
    map_frame: String,
    frames: FrameNames,
    walls: Clock,
    diagnostics: Clock,
}

/// When something was done last.
#[derive(Default)]
pub(super) struct Clock(Option<Instant>);

impl Clock {
    /// Whether it is time again, after so long or for the first time; if so, it is taken as done.
    pub fn is_due(&mut self, every: Duration) -> bool {
        let is_due = self.0.is_none_or(|last| last.elapsed() >= every);
        if is_due {
            self.0 = Some(Instant::now());
        }
        is_due
    }
}

impl Reporter {
    pub fn new(node: &Node, frames: FrameNames) -> Self {
        Self {
            publishers: Arc::clone(&node.publishers),
            shared: node.shared.clone(),
            map_frame: node.names.map_frame.clone(),
            frames,
            walls: Clock::default(),
            diagnostics: Clock::default(),
        }
    }

    /// An entry was taken in.
    pub fn taken(&self, entry: &LogEntry) {
        if let LogEntry::Laser(reading) = entry {
            self.shared.taken(reading.stamp);
        }
    }

    /// What followed from an entry.
    pub fn on_event(&mut self, entry: &LogEntry, event: &Event<'_>) {
        match event {
            Event::Step(report) => self.show_walls(report.map, report.stamp),
            Event::Pose(estimate) => self.show_pose(matches!(entry, LogEntry::Laser(_)), estimate),
            _ => {}
        }
    }

    fn header(&self, stamp: f64) -> Header {
        Header { stamp: Time::of(stamp), frame_id: self.map_frame.clone() }
    }

    /// The pose where it can be relied on, and no correction where it can't: who drives by it stops.
    fn show_pose(&self, is_of_scan: bool, estimate: &Estimate) {
        let pose = estimate.relied_on();
        let correction = self.frames.odom.clone().zip(pose);
        self.shared.state().correction =
            correction.map(|(odom, pose)| (odom, pose * estimate.odom_from_robot.inverse()));
        let (Some(pose), true) = (pose, is_of_scan) else { return };
        // What cannot be sent now is out of date by the time it can be.
        if let Some(covariance) = &estimate.covariance {
            let _ =
                self.publishers.pose.publish(PoseWithCovariance::new(self.header(estimate.stamp), pose, covariance));
        }
        if self.frames.odom.is_none() {
            let header = self.header(estimate.stamp);
            let robot = StampedTransform { header, child_frame_id: self.frames.robot.clone(), transform: pose.into() };
            let _ = self.publishers.transforms.publish(Transforms { transforms: vec![robot] });
        }
    }

    fn show_walls(&mut self, map: &[Cluster], stamp: f64) {
        if self.walls.is_due(EVERY) {
            let ends = map.iter().map(Cluster::endpoints);
            let markers = vec![Marker::lines(self.header(stamp), ends, WIDTH)];
            let _ = self.publishers.walls.publish(Markers { markers });
        }
    }

    /// Publishes what is doubtful, if anything, and some numbers, when it is time to.
    pub fn diagnose(&mut self, stamp: f64, judge: impl FnOnce() -> (Vec<String>, Vec<(&'static str, String)>)) {
        if !self.diagnostics.is_due(EVERY) {
            return;
        }
        let (mut doubts, numbers) = judge();
        let state = self.shared.now();
        if state.dropped > 0 {
            doubts.push(format!("{} of {} scans dropped: too slow for this robot", state.dropped, state.scans));
        }
        let of_input = [
            ("scans", state.scans.to_string()),
            ("dropped scans", state.dropped.to_string()),
            ("behind [s]", format!("{:.1}", state.behind())),
        ];
        let values = of_input.into_iter().chain(numbers).map(|(key, value)| (key.to_owned(), value));
        let status = DiagnosticStatus {
            level: u8::from(!doubts.is_empty()),
            name: "ipslam".to_owned(),
            message: if doubts.is_empty() { "consistent".to_owned() } else { doubts.join("; ") },
            hardware_id: String::new(),
            values: values.collect(),
        };
        let header = Header { frame_id: String::new(), ..self.header(stamp) };
        let _ = self.publishers.diagnostics.publish(Diagnostics { header, status: vec![status] });
    }
}

/// Publishes a grid.
pub(super) fn show_grid(publishers: &Publishers, map_frame: &str, stamp: f64, grid: &grid::OccupancyGrid) {
    let value = |cell: &grid::Cell| match cell {
        grid::Cell::Unknown => -1,
        grid::Cell::Free => 0,
        grid::Cell::Occupied => 100,
    };
    let stamp = Time::of(stamp);
    let info = MapMetaData {
        map_load_time: stamp,
        resolution: grid.resolution() as f32,
        width: grid.width(),
        height: grid.height(),
        origin: Pose::into(grid.world_from_grid()),
    };
    let header = Header { stamp, frame_id: map_frame.to_owned() };
    let data = grid.cells().iter().map(value).collect();
    let _ = publishers.map.publish(OccupancyGrid { header, info, data });
}
