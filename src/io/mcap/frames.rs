//! Where a laser is mounted, from the transforms that never change.

use super::messages::flat;
use crate::geometry::Pose;
use nalgebra::{Isometry3, Vector3};
use std::collections::BTreeMap;

/// A robot has tens of frames; chains and trees beyond this are damage.
const MAX_FRAMES: usize = 10_000;
/// Scans of a laser that is tilted further \[rad\] are no sections of the building.
const MAX_TILT: f64 = 20.0 * std::f64::consts::PI / 180.0;

/// Frames that are fixed to each other: of each the frame that it hangs from, and where.
#[derive(Debug, Default)]
pub(super) struct Frames(BTreeMap<String, (String, Isometry3<f64>)>);

/// A laser in the plane in which its robot drives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mounting {
    pub(super) robot_from_laser: Pose,
    /// Mounted upside down: counter-clockwise for the laser is clockwise for the robot.
    pub(super) upside_down: bool,
}

impl Frames {
    /// Adds a transform; it replaces an earlier one of the same child.
    pub(super) fn insert(&mut self, parent: &str, child: &str, parent_from_child: Isometry3<f64>) {
        if self.0.len() < MAX_FRAMES {
            self.0.insert(child.to_owned(), (parent.to_owned(), parent_from_child));
        }
    }

    /// Adds the transforms of another tree; they replace those of the same child.
    pub(super) fn extend(&mut self, others: &Self) {
        others.0.iter().for_each(|(child, (parent, transform))| self.insert(parent, child, *transform));
    }

    /// The frame from which a frame hangs in the end, and where; `None` where frames hang in a circle.
    pub(super) fn root<'a>(&'a self, frame: &'a str) -> Option<(&'a str, Isometry3<f64>)> {
        let (mut root, mut root_from_frame) = (frame, Isometry3::identity());
        for _ in 0..=self.0.len() {
            let Some((parent, parent_from_child)) = self.0.get(root) else { return Some((root, root_from_frame)) };
            (root, root_from_frame) = (parent, parent_from_child * root_from_frame);
        }
        None
    }

    /// Where a sensor is on the robot; `Ok(None)` where the transforms do not join their frames.
    ///
    /// # Errors
    /// Their frames hang in a circle.
    pub(super) fn robot_from_sensor(&self, robot: &str, sensor: &str) -> Result<Option<Isometry3<f64>>, String> {
        if robot.is_empty() || sensor.is_empty() {
            return Ok(None);
        }
        if robot == sensor {
            return Ok(Some(Isometry3::identity()));
        }
        let circle = || format!("the static transforms above `{robot:.50}` or `{sensor:.50}` lead in a circle");
        let (robot_root, root_from_robot) = self.root(robot).ok_or_else(circle)?;
        let (sensor_root, root_from_sensor) = self.root(sensor).ok_or_else(circle)?;
        Ok((robot_root == sensor_root).then(|| root_from_robot.inv_mul(&root_from_sensor)))
    }

    /// How the laser is mounted on the robot; `Ok(None)` where the transforms do not join their frames.
    ///
    /// # Errors
    /// The laser is tilted, too far away for a number, or its frames hang in a circle.
    pub(super) fn mounting(&self, robot: &str, laser: &str) -> Result<Option<Mounting>, String> {
        let Some(robot_from_laser) = self.robot_from_sensor(robot, laser)? else { return Ok(None) };
        let up = (robot_from_laser.rotation * Vector3::z()).z;
        let tilt = up.abs().min(1.0).acos();
        if tilt > MAX_TILT {
            return Err(format!(
                "the laser `{laser:.50}` is tilted by {:.0}° against the robot `{robot:.50}`; a level one is needed",
                tilt.to_degrees()
            ));
        }
        let mounting = Mounting { robot_from_laser: flat(&robot_from_laser), upside_down: up < 0.0 };
        if !mounting.robot_from_laser.is_finite() {
            return Err(format!("the laser `{laser:.50}` and the robot `{robot:.50}` are too far apart"));
        }
        Ok(Some(mounting))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion};
    use std::f64::consts::{FRAC_PI_2, PI};

    fn transform(position: [f64; 3], roll: f64, pitch: f64, yaw: f64) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(position), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
    }

    #[track_caller]
    fn assert_mounted(found: Result<Option<Mounting>, String>, pose: Pose, upside_down: bool) {
        let found = found.unwrap().unwrap();
        let off = found.robot_from_laser.seen_from(pose);
        assert!(off.x.hypot(off.y).max(off.heading.abs()) < 1e-12, "{found:?}, not at {pose:?}");
        assert_eq!(found.upside_down, upside_down);
    }

    #[test]
    fn transforms_chain_up_and_down() {
        let mut frames = Frames::default();
        // The mast turns the laser to the left, so that 0.2 m ahead on it is to the left of the robot.
        frames.insert("base_link", "mast", transform([0.1, 0.0, 0.5], 0.0, 0.0, FRAC_PI_2));
        frames.insert("mast", "laser", transform([0.2, 0.0, 0.1], 0.0, 0.0, -0.5));
        frames.insert("base_link", "base_footprint", transform([0.05, 0.0, -0.1], 0.0, 0.0, 0.0));
        let at = Pose::new(0.1, 0.2, FRAC_PI_2 - 0.5);
        assert_mounted(frames.mounting("base_link", "laser"), at, false);
        assert_mounted(frames.mounting("base_footprint", "laser"), Pose::new(-0.05, 0.0, 0.0) * at, false);
        assert_mounted(frames.mounting("laser", "laser"), Pose::IDENTITY, false);
        assert_eq!(frames.mounting("base_link", "camera"), Ok(None));
    }

    /// The oracle: a beam's end point, moved by matrices.
    #[test]
    fn a_laser_upside_down_is_mirrored() {
        let (roll, yaw) = (PI, 0.7);
        let mut frames = Frames::default();
        frames.insert("base", "laser", transform([0.3, -0.1, 0.2], roll, 0.0, yaw));
        let found = frames.mounting("base", "laser").unwrap().unwrap();
        assert!(found.upside_down);
        let (angle, range) = (0.4_f64, 2.0);
        let mirrored = range * nalgebra::Vector2::new((-angle).cos(), (-angle).sin());
        let found = found.robot_from_laser * nalgebra::Point2::from(mirrored);
        let turn: Matrix3<f64> = *Rotation3::from_axis_angle(&Vector3::z_axis(), yaw).matrix();
        let expected = Vector3::new(0.3, -0.1, 0.2)
            + turn
                * Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0))
                * range
                * Vector3::new(angle.cos(), angle.sin(), 0.0);
        assert!((found.x - expected.x).hypot(found.y - expected.y) < 1e-12, "{found} is not {expected}");
    }

    #[test]
    fn what_cannot_be_mapped_is_refused() {
        let mut frames = Frames::default();
        frames.insert("base", "nodding", transform([0.0; 3], 0.0, 0.2, 0.0));
        frames.insert("base", "upright", transform([0.0; 3], FRAC_PI_2, 0.0, 0.0));
        frames.insert("egg", "hen", Isometry3::identity());
        frames.insert("hen", "egg", Isometry3::identity());
        assert!(frames.mounting("base", "nodding").is_ok());
        let tilted = frames.mounting("base", "upright").unwrap_err();
        assert!(tilted.contains("`upright` is tilted by 90°"), "{tilted}");
        let circle = frames.mounting("base", "egg").unwrap_err();
        assert!(circle.contains("in a circle"), "{circle}");
    }
}
