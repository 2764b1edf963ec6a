//! Which topics of a bag make the log, and how its lasers are mounted.

use super::clock::Clock;
use super::frames::{Frames, Mounting};
use super::messages::{IMU, LASER_SCAN, ODOMETRY, TRANSFORMS};
use super::survey::Survey;
use super::topics::{SeenTopics, Topic};
use super::transforms::Repeated;
use super::{FrameNames, ImuTopic, Topics};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Where the entries of a log are to be found in a bag.
#[derive(Debug)]
pub(super) struct Plan {
    /// One of each laser.
    pub(super) scan_topics: Vec<String>,
    pub(super) odometry: OdometrySource,
    pub(super) imu: Option<ImuSource>,
    pub(super) frames: FrameNames,
    /// Of each frame that scans come from; `None` if it is not in the bag.
    pub(super) mountings: BTreeMap<String, Option<Mounting>>,
    /// Stamps of scans and odometry are those of clocks that differ by so much \[ns\], or of none: the times at which messages
    /// were received count in their place.
    pub(super) clocks_differ: Option<i64>,
}

#[derive(Debug)]
pub(super) enum OdometrySource {
    /// Messages of type [`ODOMETRY`].
    Messages { topic: String },
    /// Transforms between two frames, on any topic that is not static; this is one of them.
    Transforms { topic: String, odom: String, robot: String },
    /// The bag has none.
    Nowhere,
}

/// The inertial sensor.
#[derive(Debug)]
pub(super) struct ImuSource {
    pub(super) topic: String,
    /// The axis about which the robot turns, in the frame of the sensor.
    pub(super) up: Vector3<f64>,
    pub(super) is_mounted: bool,
    /// Its clock is not that of the scans: a stamp is the time of receipt, less this \[ns\], by which scans are received late.
    pub(super) late: Option<i64>,
}

impl OdometrySource {
    fn topic(&self) -> Option<&str> {
        match self {
            Self::Messages { topic } | Self::Transforms { topic, .. } => Some(topic),
            Self::Nowhere => None,
        }
    }
}

/// Chooses among the topics of a bag; `Err` holds why they cannot be chosen.
pub(super) fn plan(seen: &Survey, wanted: &Topics) -> Result<Plan, String> {
    let scan_topics = scan_topics(&seen.topics, &wanted.scan)?;
    let fixed = seen.transforms.fixed();
    let scans = || scan_topics.iter().filter_map(|topic| seen.topics.get(topic));
    let laser = scans().next().map_or("", Topic::frame);
    let odometry = odometry(seen, wanted.odometry.as_deref(), laser, &fixed)?;
    if let OdometrySource::Messages { topic } = &odometry
        && (wanted.scan.is_empty() || wanted.odometry.is_none())
    {
        scan_topics.iter().try_for_each(|scan_topic| of_one_robot(&seen.topics, scan_topic, topic))?;
    }
    let odometry_topic = odometry.topic().and_then(|topic| seen.topics.get(topic));
    // Odometry that does not name its robot is of the one that carries the laser.
    let root = fixed.root(laser).map_or(laser, |(root, _)| root);
    let robot = match &odometry {
        OdometrySource::Messages { .. } => odometry_topic.map(Topic::frame).filter(|frame| !frame.is_empty()),
        OdometrySource::Transforms { robot, .. } => Some(robot.as_str()),
        OdometrySource::Nowhere => None,
    };
    let odom = match &odometry {
        OdometrySource::Messages { .. } => {
            odometry_topic.map(|topic| topic.parent.clone()).filter(|odom| !odom.is_empty())
        }
        OdometrySource::Transforms { odom, .. } => Some(odom.clone()),
        OdometrySource::Nowhere => None,
    };
    let frames = FrameNames { odom, robot: robot.unwrap_or(root).to_owned() };
    let mut mountings = BTreeMap::new();
    for laser in scans().flat_map(|topic| &topic.frames) {
        mountings.insert(laser.clone(), fixed.mounting(&frames.robot, laser)?);
    }
    let clocks_differ =
        odometry_topic.and_then(|odometry| scans().find_map(|scans| scans.clock.differs_from(&odometry.clock)));
    let scan_clock = scans().next().map(|scans| scans.clock);
    let imu = imu(seen, &wanted.imu, scan_clock.unwrap_or_default(), &frames.robot, &fixed)?;
    Ok(Plan { scan_topics, odometry, imu, frames, mountings, clocks_differ })
}

/// The inertial sensor; of several the first whose mounting on the robot is in the transforms.
fn imu(
    seen: &Survey,
    wanted: &ImuTopic,
    scan_clock: Clock,
    robot: &str,
    fixed: &Frames,
) -> Result<Option<ImuSource>, String> {
    let source = |name: &str, topic: &Topic| {
        let mounting = fixed.robot_from_sensor(robot, topic.frame()).ok().flatten();
        ImuSource {
            topic: name.to_owned(),
            up: mounting.map_or_else(Vector3::z, |robot_from_imu| robot_from_imu.rotation.inverse() * Vector3::z()),
            is_mounted: mounting.is_some(),
            late: scan_clock.differs_from(&topic.clock).map(|_| scan_clock.delay()),
        }
    };
    Ok(match wanted {
        ImuTopic::None => None,
        ImuTopic::Named(named) => {
            let named = seen.topics.named(named, &[IMU], "--imu")?;
            seen.topics.get(named).map(|topic| source(named, topic))
        }
        ImuTopic::Any => {
            let mut all: Vec<_> = seen.topics.of_type(IMU).map(|(name, topic)| source(name, topic)).collect();
            let mounted = all.iter().position(|imu| imu.is_mounted).unwrap_or(0);
            (!all.is_empty()).then(|| all.swap_remove(mounted))
        }
    })
}

fn scan_topics(topics: &SeenTopics, named: &[String]) -> Result<Vec<String>, String> {
    const OPTION: &str = "--scan-topic";
    if !named.is_empty() {
        return named.iter().map(|named| topics.named(named, &[LASER_SCAN], OPTION).map(str::to_owned)).collect();
    }
    let only = topics.only(LASER_SCAN, "scans of several lasers", OPTION)?;
    let only = only.ok_or_else(|| format!("no message of type {LASER_SCAN} in this bag; {}", topics.all()))?;
    Ok(vec![only.to_owned()])
}

fn odometry(seen: &Survey, named: Option<&str>, laser: &str, fixed: &Frames) -> Result<OdometrySource, String> {
    const OPTION: &str = "--odom-topic";
    let topic = match named {
        Some(named) => Some(seen.topics.named(named, &[ODOMETRY, TRANSFORMS], OPTION)?),
        None => seen.topics.only(ODOMETRY, "odometry from several sources", OPTION)?,
    };
    if let Some(topic) = topic
        && seen.topics.get(topic).is_some_and(|found| found.schema == ODOMETRY)
    {
        return Ok(OdometrySource::Messages { topic: topic.to_owned() });
    }
    Ok(match seen.transforms.odometry(topic, laser, fixed)?.cloned() {
        Some(Repeated { topic, parent: odom, child: robot }) => OdometrySource::Transforms { topic, odom, robot },
        None => OdometrySource::Nowhere,
    })
}

/// Scans and odometry of two name spaces may be of two robots.
fn of_one_robot(topics: &SeenTopics, scan: &str, odometry: &str) -> Result<(), String> {
    let space = |topic: &str| topic.trim_start_matches('/').split_once('/').map(|(space, _)| space.to_owned());
    match (space(scan), space(odometry)) {
        (Some(of_scan), Some(of_odometry)) if of_scan != of_odometry => Err(format!(
            "the scans on {scan:.100} and the odometry on {odometry:.100} may be of two robots: name both by --scan-topic and \
             --odom-topic; {}",
            topics.all()
        )),
        _ => Ok(()),
    }
}
