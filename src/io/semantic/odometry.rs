//! `odometry.csv`: speeds, or poses of the odometry's frame; recognised by the header.

use crate::detections::{Odometry, Odometry3, Velocity, Velocity3};
use crate::geometry::{Pose, Pose3, StampedPose, StampedPose3};
use crate::io::table::{Layout, Row, read_table};
use crate::log::LogError;
use nalgebra::{Point3, Quaternion, Unit, Vector3};
use std::io::Write;
use std::path::Path;

const LAYOUTS: [Layout; 2] = [
    Layout { required: &["t", "v", "omega"], optional: &[] },
    Layout { required: &["t", "x", "y", "heading"], optional: &[] },
];
const LAYOUTS3: [Layout; 2] = [
    Layout { required: &["t", "vx", "vy", "vz", "wx", "wy", "wz"], optional: &[] },
    Layout { required: &["t", "x", "y", "z", "qx", "qy", "qz", "qw"], optional: &[] },
];
const EXPECTED3: &str =
    "odometry of space has the columns t,vx,vy,vz,wx,wy,wz (s, m/s, rad/s) or t,x,y,z,qx,qy,qz,qw (s, m)";
const EXPECTED: &str = "odometry has the columns t,v,omega (s, m/s, rad/s) or t,x,y,heading (s, m, m, rad)";

/// Odometry, and the names of columns that were left out.
pub(super) fn read(path: &Path) -> Result<(Odometry, Vec<String>), LogError> {
    let (mut speeds, mut poses) = (Vec::new(), Vec::new());
    let unknown = read_rows(path, &LAYOUTS, EXPECTED, |layout, stamp, row| {
        match layout {
            0 => speeds.push(Velocity { stamp, forward: row.number(1)?, turn: row.number(2)? }),
            _ => poses.push(StampedPose { stamp, pose: Pose::new(row.number(1)?, row.number(2)?, row.number(3)?) }),
        }
        Ok(())
    })?;
    let odometry = if poses.is_empty() { Odometry::Velocities(speeds) } else { Odometry::Poses(poses) };
    Ok((odometry, unknown))
}

/// The same of a robot of space.
pub(super) fn read3(path: &Path) -> Result<(Odometry3, Vec<String>), LogError> {
    let (mut speeds, mut poses) = (Vec::new(), Vec::new());
    let unknown = read_rows(path, &LAYOUTS3, EXPECTED3, |layout, stamp, row| {
        let vector = |first| Ok::<_, String>([row.number(first)?, row.number(first + 1)?, row.number(first + 2)?]);
        if layout == 0 {
            let (linear, angular) = (Vector3::from(vector(1)?), Vector3::from(vector(4)?));
            speeds.push(Velocity3 { stamp, linear, angular });
        } else {
            let [x, y, z] = vector(4)?;
            let rotation = Unit::try_new(Quaternion::new(row.number(7)?, x, y, z), 1e-3)
                .ok_or_else(|| "the quaternion has no length".to_owned())?;
            poses.push(StampedPose3 { stamp, pose: Pose3::new(Point3::from(vector(1)?), rotation) });
        }
        Ok(())
    })?;
    let odometry = if poses.is_empty() { Odometry3::Velocities(speeds) } else { Odometry3::Poses(poses) };
    Ok((odometry, unknown))
}

/// Rows whose stamps do not fall; one at least.
fn read_rows(
    path: &Path,
    layouts: &[Layout],
    expected: &'static str,
    mut take_row: impl FnMut(usize, f64, &Row) -> Result<(), String>,
) -> Result<Vec<String>, LogError> {
    let mut last = None;
    let unknown = read_table(path, layouts, expected, |layout, row| {
        let stamp = row.number(0)?;
        if let Some(last) = last.replace(stamp).filter(|last| stamp < *last) {
            return Err(format!("its stamp, {stamp}, lies before that of the row above, {last}; sort the rows by t"));
        }
        take_row(layout, stamp, row)
    })?;
    if last.is_none() {
        let reason = "it holds no row besides the header".to_owned();
        return Err(LogError::NotThisFormat { path: path.to_owned(), reason, expected });
    }
    Ok(unknown)
}

pub(super) fn write(odometry: &Odometry, mut out: impl Write) -> std::io::Result<()> {
    match odometry {
        Odometry::Velocities(rows) => {
            writeln!(out, "t,v,omega")?;
            rows.iter().try_for_each(|row| writeln!(out, "{},{},{}", row.stamp, row.forward, row.turn))
        }
        Odometry::Poses(rows) => {
            writeln!(out, "t,x,y,heading")?;
            let mut write = |StampedPose { stamp, pose }: &StampedPose| {
                writeln!(out, "{stamp},{},{},{}", pose.x, pose.y, pose.heading)
            };
            rows.iter().try_for_each(&mut write)
        }
    }
}

/// The same of a robot of space.
pub(super) fn write3(odometry: &Odometry3, mut out: impl Write) -> std::io::Result<()> {
    match odometry {
        Odometry3::Velocities(rows) => {
            writeln!(out, "t,vx,vy,vz,wx,wy,wz")?;
            rows.iter().try_for_each(|Velocity3 { stamp, linear: v, angular: w }| {
                writeln!(out, "{stamp},{},{},{},{},{},{}", v.x, v.y, v.z, w.x, w.y, w.z)
            })
        }
        Odometry3::Poses(rows) => {
            writeln!(out, "t,x,y,z,qx,qy,qz,qw")?;
            rows.iter().try_for_each(|StampedPose3 { stamp, pose: Pose3 { position: p, rotation } }| {
                let q = rotation.coords;
                writeln!(out, "{stamp},{},{},{},{},{},{},{}", p.x, p.y, p.z, q.x, q.y, q.z, q.w)
            })
        }
    }
}
