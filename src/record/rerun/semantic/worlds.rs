//! What differs between recordings of the plane and of space: the rows of numbers that repeat a mapping.

use super::super::blueprint as shared;
use super::super::rows::exactly;
use super::blueprint;
use crate::detections::{
    Detection, Detection3, Frame, Odometry, Odometry3, Recording, Recording3, Velocity, Velocity3,
};
use crate::geometry::{Pose, Pose3, StampedPose, StampedPose3};
use crate::io::semantic::sensors;
use crate::semantic::{Plane, SemanticMap, Space, World};
use nalgebra::{Point2, Point3, Quaternion, Unit, Vector3};
use std::borrow::Cow;

/// Rows of numbers, and the path where they lie.
pub type PathRows = (&'static str, Vec<Vec<f64>>);

/// A world whose mappings are recorded.
pub trait Recorded: World {
    /// The text of `sensors.toml`; empty for sensors that cannot be.
    fn sensors_text(sensors: &Self::Sensors) -> String;
    /// Odometry.
    fn odometry(recording: &Self::Recording) -> PathRows;
    /// A row for each frame: its stamp, and all numbers of each detection.
    fn detections(recording: &Self::Recording) -> Vec<Vec<f64>>;
    /// A recording of these; none where they cannot be.
    fn recording<'a>(
        sensors: &str,
        speeds: impl Iterator<Item = &'a [f64]>,
        poses: impl Iterator<Item = &'a [f64]>,
        detections: impl Iterator<Item = &'a [f64]>,
    ) -> Option<Self::Recording>;
    /// The pose that has these [`World::coordinates`].
    fn pose(coordinates: &[f64]) -> Option<Self::Pose>;
    /// The map as it is drawn, with z up.
    fn upright<'a>(recording: &Self::Recording, map: &'a SemanticMap<Self>) -> Cow<'a, SemanticMap<Self>>;
    /// A pose from above.
    fn from_above(pose: Self::Pose) -> Pose;
    /// Where a detection is in the picture \[pixels\]; none where there is no picture.
    fn pixel(seen: &Self::Detection) -> Option<[f32; 2]>;
    /// Where a landmark would be in the picture \[pixels\].
    fn pixel_of(sensors: &Self::Sensors, pose: Self::Pose, landmark: Self::Point) -> Option<[f32; 2]>;
}

/// Frames of stamp, class, score and `N` numbers a detection.
fn frames<'a, const N: usize, D>(
    rows: impl Iterator<Item = &'a [f64]>,
    classes: usize,
    detection: impl Fn(usize, &[f64; N]) -> D,
) -> Option<Vec<Frame<D>>> {
    let frame = |row: &[f64]| {
        let (stamp, numbers) = row.split_first()?;
        let (detections, rest) = numbers.as_chunks::<N>();
        let one = |numbers: &[f64; N]| {
            let class = numbers[0] as usize;
            (class < classes).then(|| detection(class, numbers))
        };
        let detections = detections.iter().map(one).collect::<Option<_>>()?;
        rest.is_empty().then_some(Frame { stamp: *stamp, detections })
    };
    rows.map(frame).collect()
}

/// The row of a frame.
fn row<D, const N: usize>(Frame { stamp, detections }: &Frame<D>, numbers: impl Fn(&D) -> [f64; N]) -> Vec<f64> {
    std::iter::once(*stamp).chain(detections.iter().flat_map(numbers)).collect()
}

impl Recorded for Plane {
    fn sensors_text(sensors: &Self::Sensors) -> String {
        sensors::to_toml(sensors).unwrap_or_default()
    }

    fn odometry(recording: &Recording) -> PathRows {
        match &recording.odometry {
            Odometry::Velocities(rows) => {
                let row = |&Velocity { stamp, forward, turn }: &Velocity| vec![forward, turn, stamp];
                (blueprint::SPEEDS, rows.iter().map(row).collect())
            }
            Odometry::Poses(rows) => {
                let row =
                    |&StampedPose { stamp, pose: Pose { x, y, heading } }: &StampedPose| vec![x, y, heading, stamp];
                (shared::ODOMETRY_READING, rows.iter().map(row).collect())
            }
        }
    }

    fn detections(recording: &Recording) -> Vec<Vec<f64>> {
        let numbers = |seen: &Detection| [seen.class as f64, seen.score, seen.range, seen.bearing];
        recording.frames.iter().map(|frame| row(frame, numbers)).collect()
    }

    fn recording<'a>(
        sensors: &str,
        speeds: impl Iterator<Item = &'a [f64]>,
        poses: impl Iterator<Item = &'a [f64]>,
        detections: impl Iterator<Item = &'a [f64]>,
    ) -> Option<Recording> {
        let sensors = sensors::from_toml(sensors).ok()?;
        let speed = |row: &[f64]| {
            let &[forward, turn, stamp] = row.as_array()?;
            Some(Velocity { stamp, forward, turn })
        };
        let pose = |row: &[f64]| {
            let (stamp, coordinates) = row.split_last()?;
            Some(StampedPose { stamp: *stamp, pose: Self::pose(coordinates)? })
        };
        let (speeds, poses) = (speeds.map(speed).collect::<Option<Vec<_>>>()?, poses.map(pose).collect::<Option<_>>()?);
        let odometry = if speeds.is_empty() { Odometry::Poses(poses) } else { Odometry::Velocities(speeds) };
        let frames = frames(detections, sensors.classes.len(), |class, &[_, score, range, bearing]: &[f64; 4]| {
            Detection { class, score, range, bearing }
        })?;
        Some(Recording { sensors, odometry, frames })
    }

    fn pose(coordinates: &[f64]) -> Option<Pose> {
        let &[x, y, heading] = coordinates.as_array()?;
        Some(exactly(x, y, heading))
    }

    fn upright<'a>(_: &Recording, map: &'a SemanticMap) -> Cow<'a, SemanticMap> {
        Cow::Borrowed(map)
    }

    fn from_above(pose: Pose) -> Pose {
        pose
    }

    fn pixel(_: &Detection) -> Option<[f32; 2]> {
        None
    }

    fn pixel_of(_: &Self::Sensors, _: Pose, _: Point2<f64>) -> Option<[f32; 2]> {
        None
    }
}

impl Recorded for Space {
    fn sensors_text(sensors: &Self::Sensors) -> String {
        sensors::to_toml3(sensors).unwrap_or_default()
    }

    fn odometry(recording: &Recording3) -> PathRows {
        match &recording.odometry {
            Odometry3::Velocities(rows) => {
                let row = |&Velocity3 { stamp, linear, angular }: &Velocity3| {
                    linear.iter().chain(angular.iter()).copied().chain([stamp]).collect()
                };
                (blueprint::SPEEDS, rows.iter().map(row).collect())
            }
            Odometry3::Poses(rows) => {
                let row = |&StampedPose3 { stamp, pose }: &StampedPose3| {
                    let mut row = Self::coordinates(pose);
                    row.push(stamp);
                    row
                };
                (shared::ODOMETRY_READING, rows.iter().map(row).collect())
            }
        }
    }

    fn detections(recording: &Recording3) -> Vec<Vec<f64>> {
        let numbers = |&Detection3 { class, score, pixel: [u, v], disparity }: &Detection3| {
            [class as f64, score, u, v, disparity]
        };
        recording.frames.iter().map(|frame| row(frame, numbers)).collect()
    }

    fn recording<'a>(
        sensors: &str,
        speeds: impl Iterator<Item = &'a [f64]>,
        poses: impl Iterator<Item = &'a [f64]>,
        detections: impl Iterator<Item = &'a [f64]>,
    ) -> Option<Recording3> {
        let sensors = sensors::from_toml3(sensors).ok()?;
        let speed = |row: &[f64]| {
            let &[a, b, c, d, e, f, stamp] = row.as_array()?;
            Some(Velocity3 { stamp, linear: Vector3::new(a, b, c), angular: Vector3::new(d, e, f) })
        };
        let pose = |row: &[f64]| {
            let (stamp, coordinates) = row.split_last()?;
            Some(StampedPose3 { stamp: *stamp, pose: Self::pose(coordinates)? })
        };
        let (speeds, poses) = (speeds.map(speed).collect::<Option<Vec<_>>>()?, poses.map(pose).collect::<Option<_>>()?);
        let odometry = if speeds.is_empty() { Odometry3::Poses(poses) } else { Odometry3::Velocities(speeds) };
        let frames = frames(detections, sensors.classes.len(), |class, &[_, score, u, v, disparity]: &[f64; 5]| {
            Detection3 { class, score, pixel: [u, v], disparity }
        })?;
        Some(Recording3 { sensors, odometry, frames })
    }

    fn pose(coordinates: &[f64]) -> Option<Pose3> {
        let &[x, y, z, i, j, k, w] = coordinates.as_array()?;
        // As it was, to the last bit.
        Some(Pose3::new(Point3::new(x, y, z), Unit::new_unchecked(Quaternion::new(w, i, j, k))))
    }

    fn upright<'a>(recording: &Recording3, map: &'a SemanticMap<Self>) -> Cow<'a, SemanticMap<Self>> {
        Cow::Owned(map.upright(&recording.sensors))
    }

    fn from_above(pose: Pose3) -> Pose {
        StampedPose3 { stamp: 0.0, pose }.from_above().pose
    }

    fn pixel(seen: &Detection3) -> Option<[f32; 2]> {
        Some(seen.pixel.map(|number| number as f32))
    }

    fn pixel_of(sensors: &Self::Sensors, pose: Pose3, landmark: Point3<f64>) -> Option<[f32; 2]> {
        let mean = Self::predict(sensors, pose, landmark)?.mean;
        Some([mean.x as f32, mean.y as f32])
    }
}
