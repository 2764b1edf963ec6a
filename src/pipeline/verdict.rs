//! Whether the result of a run can be relied on, by what is known without the truth.

use super::{End, Outcome};
use crate::log::ImuStats;
use crate::report::{Loop, RunResult};

/// Share of what scans saw that may be gone when they look again: in drives that came out right it is below 0.06, and where
/// three or six people walk along and mislead the robot above 0.3.
const MOVING: f64 = 0.2;
/// What is in doubt without odometry.
pub const NO_ODOMETRY: &str = "no odometry: where scans have few features, the distance driven is unknown";

impl Outcome {
    /// What is wrong with the log, or happened during the run, which went on.
    pub fn warnings(&self) -> Vec<String> {
        let (stats, counts) = (&self.stats, &self.counts);
        let mut warnings = Vec::new();
        match &self.end {
            End::Log => {}
            End::MaxScans => warnings.push(format!("ended after {} scans, as asked for", counts.scans)),
            End::Interrupted => warnings.push(format!("interrupted after {} scans", counts.scans)),
            End::BrokeOff(error) => warnings.push(format!("the log breaks off: {error}")),
        }
        if let Some(failure) = &self.evaluator_failure {
            warnings.push(format!("{failure}; the CPU did the step again and went on"));
        }
        if let Some(first) = &stats.first_malformed {
            warnings.push(format!("malformed lines left out: {}; the first one: {first}", stats.malformed));
        }
        match stats.laser_without_odometry {
            0 => {}
            _ if self.has_no_odometry() => {
                warnings.push("no odometry at all: the map is made by scan matching alone and may be wrong where scans have few features; check map.png".to_owned());
            }
            some => warnings.push(format!(
                "scans before any odometry, or in a bag more than 1 s from it: {some}; they were taken to be where it starts \
                 or is nearest"
            )),
        }
        warnings.extend(refused_odometry(&self.result));
        if self.result.objects.as_ref().is_some_and(|objects| objects.frames_used == 0) {
            warnings.push("no frame of detections lies within the log: is its clock the same?".to_owned());
        }
        if stats.laser_without_mounting > 0 {
            warnings.push(
                "the bag has no mounting of the laser (no chain of fixed transforms on /tf_static or /tf): the laser was assumed to be at the robot's \
                 origin, facing forward"
                    .to_owned(),
            );
        }
        if let Some(ImuStats { topic, is_mounted: false, messages: 1.. }) = &stats.imu {
            warnings.push(format!(
                "the bag has no mounting of the inertial sensor on {topic}: its z axis was assumed to point up (option --imu)"
            ));
        }
        if self.result.gyro.is_some_and(|gyro| gyro.believed == 0) {
            warnings.push(
                "the gyroscope was not believed: the robot has hardly turned, or not as the gyroscope has it (its                  mounting, its unit?)"
                    .to_owned(),
            );
        }
        if let Some(seconds) = stats.clocks_differ {
            warnings.push(format!(
                "scans and odometry are stamped by clocks that differ by {seconds:.1} s, or one does not run: the times at \
                 which the bag received them counted in place of the stamps"
            ));
        }
        if stats.guessed_angles > 0 {
            warnings.push(format!(
                "sweeps without the angles of their beams: {}; 180 degrees were assumed (option --fov)",
                stats.guessed_angles
            ));
        }
        if stats.backward_stamps > 0 {
            let count = stats.backward_stamps;
            warnings.push(format!("stamps that go backwards: {count}; the order of the log counted, not the stamps"));
        }
        if counts.empty_scans > 0 {
            warnings.push(format!("scans without a point: {} of {}", counts.empty_scans, counts.scans));
        }
        if counts.scans == 1 {
            warnings.push("one scan only: the map is what it saw".to_owned());
        }
        warnings
    }

    /// None in the log, or one that never changes while scan matching has the robot drive.
    fn has_no_odometry(&self) -> bool {
        let Outcome { stats, counts, result, .. } = self;
        let is_constant = || result.poses.windows(2).all(|pair| pair[0].odom_from_robot == pair[1].odom_from_robot);
        stats.laser > 0 && (stats.laser_without_odometry == stats.laser || counts.steps > 1 && is_constant())
    }

    /// Why the result may not be relied on; nothing where it is consistent.
    pub fn doubts(&self) -> Vec<String> {
        let mut doubts = Vec::new();
        let open: Vec<&Loop> = self.result.loops.iter().filter(|found| !found.is_closed).collect();
        if let Some(first) = open.first() {
            doubts.push(format!(
                "loops that were found and that the path does not close: {}, first at stamp {} ({:.1} m off a place {})",
                open.len(),
                first.stamp,
                first.correction,
                first.older_stamp.map_or("of the earlier map".to_owned(), |stamp| format!("of stamp {stamp}"))
            ));
        }
        let looked_through = self.result.looked_through;
        if looked_through > MOVING {
            doubts.push(format!(
                "{:.0} % of what the scans saw was not there when they looked again: people who walk along, or a path that is wrong",
                100.0 * looked_through
            ));
        }
        if self.has_no_odometry() {
            doubts.push(NO_ODOMETRY.to_owned());
        }
        doubts
    }
}

/// What to say of odometry that was not believed, if there is any.
pub fn refused_odometry(result: &RunResult) -> Option<String> {
    let first = result.refused_odometry.first()?;
    Some(format!(
        "odometry that no robot can have driven (a jump, a restart, no number): {}, first at stamp {first}; scan matching \
         bridged it (options tracking.max_speed, max_turn_rate, max_acceleration)",
        result.refused_odometry.len()
    ))
}
