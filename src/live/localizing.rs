//! Localisation live: the robot in a map that is known, and a user who may say where it is.

use super::messages::PoseWithCovariance;
use super::node::{LiveError, Node};
use super::publisher::{Reporter, show_grid};
use crate::gpu::DeviceError;
use crate::grid::OccupancyGrid;
use crate::io::mcap::FrameNames;
use crate::localization::{InitialPose, Localization};
use crate::log::LogEntry;
use crate::report::{Confidence, Estimator, Event, RunResult};
use ros2_client::Subscription;

/// Standard deviations of a pose without any \[m, rad\]: that of a click on a map.
const CLICK: [f64; 2] = [0.5, 0.26];

/// A filter whose pose others see.
pub struct LiveLocalization {
    filter: Localization,
    reporter: Reporter,
    map_frame: String,
    initial_poses: Subscription<PoseWithCovariance>,
    /// Why a pose was not taken.
    refused: Option<String>,
    confidence: Option<Confidence>,
    particles: usize,
}

impl LiveLocalization {
    /// A filter before its first reading, of a robot with these frames; publishes the grid of its map.
    ///
    /// # Errors
    /// The topic of initial poses cannot be made.
    pub fn new(
        node: &mut Node,
        frames: FrameNames,
        filter: Localization,
        grid: &OccupancyGrid,
    ) -> Result<Self, LiveError> {
        show_grid(&node.publishers, &node.names.map_frame, 0.0, grid);
        Ok(Self {
            filter,
            reporter: Reporter::new(node, frames),
            map_frame: node.names.map_frame.clone(),
            initial_poses: node.initial_poses()?,
            refused: None,
            confidence: None,
            particles: 0,
        })
    }

    /// Takes what a user says of where the robot is.
    fn take_initial_pose(&mut self) {
        let Ok(Some((message, _))) = self.initial_poses.take() else { return };
        let frame = message.header.frame_id.trim_start_matches('/');
        if frame != self.map_frame.trim_start_matches('/') {
            self.refused = Some(format!("an initial pose in frame `{frame:.50}`, not `{}`", self.map_frame));
            return;
        }
        let Some((world_from_robot, spread)) = message.of_plane() else {
            self.refused = Some("an initial pose that is not finite".to_owned());
            return;
        };
        let [position_sigma, heading_sigma] = if spread == [0.0, 0.0] { CLICK } else { spread };
        self.filter.begin_at(InitialPose { world_from_robot, position_sigma, heading_sigma });
        (self.refused, self.confidence) = (None, None);
    }
}

impl Estimator for LiveLocalization {
    fn add(&mut self, entry: &LogEntry, observe: &mut dyn FnMut(&Event<'_>)) {
        self.take_initial_pose();
        let Self { filter, reporter, confidence, particles, .. } = self;
        filter.add(entry, &mut |event| {
            if let Event::Step(report) = event {
                (*confidence, *particles) = (report.confidence, report.particles.len());
            }
            reporter.on_event(entry, event);
            observe(event);
        });
        reporter.taken(entry);
        let (confidence, refused) = (self.confidence, self.refused.clone());
        reporter.diagnose(entry.stamp(), || {
            let is_located = confidence.is_some_and(|confidence| confidence.is_located);
            let doubts = (!is_located).then(|| "not located".to_owned()).into_iter().chain(refused).collect();
            let share = |share: Option<f64>| format!("{:.2}", share.unwrap_or(0.0));
            let numbers = vec![
                ("particles", self.particles.to_string()),
                ("weight", share(confidence.map(|confidence| confidence.weight))),
                ("explained", share(confidence.map(|confidence| confidence.explained))),
            ];
            (doubts, numbers)
        });
    }

    fn result(&self) -> RunResult {
        self.filter.result()
    }

    fn evaluator_failure(&self) -> Option<&DeviceError> {
        self.filter.evaluator_failure()
    }
}
