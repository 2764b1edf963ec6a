//! `odometry.csv`: speeds, or poses of the odometry's frame; recognised by the header.

use crate::detections::{Odometry, Velocity};
use crate::geometry::{Pose, StampedPose};
use crate::io::table::{Layout, read_table};
use crate::log::LogError;
use std::io::Write;
use std::path::Path;

const LAYOUTS: [Layout; 2] = [
    Layout { required: &["t", "v", "omega"], optional: &[] },
    Layout { required: &["t", "x", "y", "heading"], optional: &[] },
];
const EXPECTED: &str = "odometry has the columns t,v,omega (s, m/s, rad/s) or t,x,y,heading (s, m, m, rad)";

/// Odometry, and the names of columns that were left out.
pub(super) fn read(path: &Path) -> Result<(Odometry, Vec<String>), LogError> {
    let (mut speeds, mut poses) = (Vec::new(), Vec::new());
    let mut last = f64::NEG_INFINITY;
    let unknown = read_table(path, &LAYOUTS, EXPECTED, |layout, row| {
        let stamp = row.number(0)?;
        if stamp < last {
            return Err(format!("its stamp, {stamp}, lies before that of the row above, {last}; sort the rows by t"));
        }
        last = stamp;
        match layout {
            0 => speeds.push(Velocity { stamp, forward: row.number(1)?, turn: row.number(2)? }),
            _ => poses.push(StampedPose { stamp, pose: Pose::new(row.number(1)?, row.number(2)?, row.number(3)?) }),
        }
        Ok(())
    })?;
    if speeds.is_empty() && poses.is_empty() {
        let reason = "it holds no row besides the header".to_owned();
        return Err(LogError::NotThisFormat { path: path.to_owned(), reason, expected: EXPECTED });
    }
    let odometry = if poses.is_empty() { Odometry::Velocities(speeds) } else { Odometry::Poses(poses) };
    Ok((odometry, unknown))
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
