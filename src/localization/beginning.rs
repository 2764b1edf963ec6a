//! Where a drive begins in the map of an earlier one.
//!
//! A robot is located only after some metres, when one place is left. From there its readings are followed once more, back to
//! the first scan: time runs the other way, and the place is known from the start.

use super::{InitialPose, Localization, LocalizationConfig, LocalizationError};
use crate::geometry::Pose;
use crate::log::{LaserReading, LogEntry, LogError, LogSource, readings};
use crate::map::LineMap;
use crate::report::{Estimate, Estimator as _, Event};

/// Where a drive begins in a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beginning {
    /// Number of the reading, a scan, as [`readings`] counts them: the first scan, unless the robot came into the map later.
    pub reading: usize,
    /// Where the robot was there.
    pub world_from_robot: Pose,
}

/// Why nobody knows where a drive begins.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BeginningError {
    /// The log cannot be read so far.
    #[error(transparent)]
    Log(#[from] LogError),
    /// Nothing can be located in this map.
    #[error(transparent)]
    Map(#[from] LocalizationError),
    /// The robot is located nowhere on its way.
    #[error("the robot is located nowhere in it, in {metres:.0} m of way by odometry")]
    NotFound {
        /// The way that was looked at \[m\].
        metres: f64,
    },
}

/// How well the pose of a robot that is located is known \[m, rad\].
const LOCATED: [f64; 2] = [0.1, 0.05];

/// People around the robot hide the map for a while: so far it is followed by odometry \[m\], ...
const HIDDEN: f64 = 2.0;
/// ... which is off by no more than this behind it \[m, rad\]. Another place would be farther away.
const OFF: [f64; 2] = [0.5, 0.25];

/// Finds where the drive of a log begins in a map. `initial` says where its first scan may be, if that is known. The readings
/// up to where the robot is located are kept in memory.
///
/// # Errors
/// The log cannot be read, the map is none to be located in, or the robot is not located.
pub fn find_beginning(
    map: &LineMap,
    source: &dyn LogSource,
    initial: Option<InitialPose>,
    config: &LocalizationConfig,
) -> Result<Beginning, BeginningError> {
    let mut filter = Localization::new(map.clone(), initial, *config, None)?;
    let (mut way, mut driven) = (Vec::new(), Driven::default());
    for reading in readings(source)? {
        let (_, entry) = reading?;
        let Some(estimate) = estimate(&mut filter, &entry) else { continue };
        driven.add(&estimate);
        way.push(entry);
        if let (Some(pose), Some(LogEntry::Laser(_))) = (estimate.relied_on(), way.last()) {
            return Ok(back(map, &way, pose, config)?);
        }
    }
    Err(BeginningError::NotFound { metres: driven.metres })
}

/// Way by odometry.
#[derive(Default)]
struct Driven {
    metres: f64,
    last: Option<Pose>,
}

impl Driven {
    fn add(&mut self, estimate: &Estimate) {
        let odom_from_robot = estimate.odom_from_robot;
        let moved = self.last.replace(odom_from_robot).map(|last| odom_from_robot.seen_from(last));
        self.metres += moved.map_or(0.0, |moved| moved.x.hypot(moved.y));
    }
}

fn estimate(filter: &mut Localization, entry: &LogEntry) -> Option<Estimate> {
    let mut told = None;
    filter.add(entry, &mut |event| {
        if let Event::Pose(estimate) = event {
            told = Some(**estimate);
        }
    });
    told
}

/// Follows the way back from its last reading, a scan at a known pose, as far as the map explains the scans, but for short
/// stretches.
fn back(
    map: &LineMap,
    way: &[LogEntry],
    world_from_robot: Pose,
    config: &LocalizationConfig,
) -> Result<Beginning, LocalizationError> {
    let [position_sigma, heading_sigma] = LOCATED;
    let initial = InitialPose { world_from_robot, position_sigma, heading_sigma };
    let mut filter = Localization::new(map.clone(), Some(initial), *config, None)?;
    let mut beginning = Beginning { reading: way.len() - 1, world_from_robot };
    let (mut hidden, mut world_from_odom) = (Driven::default(), None);
    for (reading, entry) in way.iter().enumerate().rev() {
        let mirrored = match entry.clone() {
            LogEntry::Odometry { stamp, odom_from_robot } => LogEntry::Odometry { stamp: -stamp, odom_from_robot },
            LogEntry::Laser(reading) => LogEntry::Laser(LaserReading { stamp: -reading.stamp, ..reading }),
            no_reading @ (LogEntry::Turn { .. } | LogEntry::Truth { .. }) => no_reading,
        };
        let Some(estimate) = estimate(&mut filter, &mirrored) else { continue };
        hidden.add(&estimate);
        if hidden.metres > HIDDEN {
            break;
        }
        let is_explained = estimate.confidence.is_some_and(|found| found.explained >= config.located_explained);
        let (true, Some(pose), LogEntry::Laser(_)) = (is_explained, estimate.world_from_robot, entry) else { continue };
        let off = world_from_odom.map_or(Pose::IDENTITY, |odom: Pose| pose.seen_from(odom * estimate.odom_from_robot));
        if off.x.hypot(off.y) < OFF[0] && off.heading.abs() < OFF[1] {
            beginning = Beginning { reading, world_from_robot: pose };
            world_from_odom = Some(pose * estimate.odom_from_robot.inverse());
            hidden.metres = 0.0;
        }
    }
    Ok(beginning)
}
