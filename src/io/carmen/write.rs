//! Writes log entries as a CARMEN log, with all digits of their numbers.

use super::implied_angles;
use crate::geometry::Pose;
use crate::log::{LaserReading, LogEntry};
use std::io::{self, ErrorKind, Write};

/// Host name in the written lines.
const HOST: &str = "ipslam";

/// Writes log entries as lines of a CARMEN log.
///
/// Odometry becomes `ODOM`, truth `TRUEPOS`, and a laser reading `FLASER` where that says everything (angles as
/// [`implied_angles`] has them, no maximum range), else `ROBOTLASER1`. Read back, poses agree to rounding in the sum
/// of laser and robot pose (1e-9 m within 100 km of the origin), everything else is equal.
#[derive(Debug)]
pub struct CarmenWriter<W: Write> {
    out: W,
    /// The last odometry, which `TRUEPOS` repeats.
    odom_from_robot: Pose,
}

impl<W: Write> CarmenWriter<W> {
    /// Writes to `out`, which should be buffered; a gzip encoder will do.
    pub fn new(out: W) -> Self {
        Self { out, odom_from_robot: Pose::IDENTITY }
    }

    /// Writes one entry as one line.
    ///
    /// # Errors
    /// The writing fails; [`ErrorKind::InvalidInput`] where the line could not be read back: a pose, stamp or angle that is not finite,
    /// no ranges, several beams at one angle.
    pub fn write(&mut self, entry: &LogEntry) -> io::Result<()> {
        match entry {
            LogEntry::Odometry { stamp, odom_from_robot } => {
                check(stamp.is_finite() && odom_from_robot.is_finite())?;
                self.odom_from_robot = *odom_from_robot;
                write!(self.out, "ODOM")?;
                self.pose(*odom_from_robot)?;
                write!(self.out, " 0 0 0")?;
                self.tail(*stamp)
            }
            LogEntry::Truth { stamp, world_from_robot } => {
                check(stamp.is_finite() && world_from_robot.is_finite())?;
                write!(self.out, "TRUEPOS")?;
                self.pose(*world_from_robot)?;
                self.pose(self.odom_from_robot)?;
                self.tail(*stamp)
            }
            LogEntry::Laser(reading) => self.laser(reading),
            // A CARMEN log has no such message.
            LogEntry::Turn { .. } => Ok(()),
        }
    }

    /// Flushes and gives `out` back.
    ///
    /// # Errors
    /// The flushing fails.
    pub fn finish(mut self) -> io::Result<W> {
        self.out.flush()?;
        Ok(self.out)
    }

    fn laser(&mut self, reading: &LaserReading) -> io::Result<()> {
        // The format has no room for the motion during a sweep.
        let LaserReading {
            stamp, odom_from_robot, robot_from_laser, first_angle, angle_step, max_range, ranges, ..
        } = reading;
        let odom_from_laser = *odom_from_robot * *robot_from_laser;
        let beams = ranges.len();
        check(stamp.is_finite() && odom_from_robot.is_finite() && odom_from_laser.is_finite())?;
        check(first_angle.is_finite() && angle_step.is_finite() && beams > 0 && (*angle_step != 0.0 || beams == 1))?;
        self.odom_from_robot = *odom_from_robot;

        let short = (*first_angle, *angle_step) == implied_angles(beams) && *max_range == f64::INFINITY;
        if short {
            write!(self.out, "FLASER")?;
        } else {
            // A laser of unknown kind (99), accuracy unknown, no remissions.
            let field_of_view = angle_step * (beams - 1) as f64;
            write!(self.out, "ROBOTLASER1 99 {first_angle:?} {field_of_view:?} {angle_step:?} {max_range:?} 0 0")?;
        }
        write!(self.out, " {beams}")?;
        for range in ranges {
            write!(self.out, " {range:?}")?;
        }
        if !short {
            write!(self.out, " 0")?;
        }
        self.pose(odom_from_laser)?;
        self.pose(*odom_from_robot)?;
        if !short {
            write!(self.out, " 0 0 0 0 0")?;
        }
        self.tail(*stamp)
    }

    fn pose(&mut self, pose: Pose) -> io::Result<()> {
        write!(self.out, " {:?} {:?} {:?}", pose.x, pose.y, pose.heading)
    }

    fn tail(&mut self, stamp: f64) -> io::Result<()> {
        writeln!(self.out, " {stamp:?} {HOST} {stamp:?}")
    }
}

fn check(readable: bool) -> io::Result<()> {
    let problem = "an entry needs finite poses, stamp and angles, and a laser reading ranges at different angles";
    if readable { Ok(()) } else { Err(io::Error::new(ErrorKind::InvalidInput, problem)) }
}
