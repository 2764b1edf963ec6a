//! Which log to read, as the commands that read one let the user choose it.

use super::{UsageError, interrupt};
use anyhow::{Context as _, ensure};
use ipslam::io::carmen::CarmenLog;
use ipslam::io::mcap::{ImuTopic, Topics};
use ipslam::io::{Stream, open_log, open_stream};
use ipslam::log::LogSource;
use std::io::{IsTerminal as _, stdin};
use std::path::{Path, PathBuf};

/// A log and, where it is a bag, which of its topics.
#[derive(Debug, clap::Args)]
pub struct LogArgs {
    /// CARMEN log, plain or gzip, or ROS bag: an MCAP, SQLite (.db3) or ROS 1 (.bag) file, or the folder of one; - for
    /// a CARMEN log or MCAP from standard input, as it comes
    pub log: Option<PathBuf>,
    /// Topic of the laser scans in a bag; again for each further laser of the robot [default: the only one]
    #[arg(long, value_name = "TOPIC", requires = "log")]
    scan_topic: Vec<String>,
    /// Topic of the odometry in a bag: odometry messages or transforms [default: the only odometry, or else /tf]
    #[arg(long, value_name = "TOPIC", requires = "log")]
    odom_topic: Option<String>,
    /// Topic of the inertial sensor in a bag, whose gyroscope measures turns; or none [default: the first whose mounting is known]
    #[arg(long, value_name = "TOPIC|none", requires = "log")]
    imu: Option<String>,
    /// Field of view of a laser whose sweeps hold only ranges (FLASER) [degrees; default: from the log or the number of
    /// beams]
    #[arg(long, value_name = "DEGREES", requires = "log", value_parser = degrees)]
    fov: Option<f64>,
}

fn degrees(text: &str) -> Result<f64, String> {
    let degrees: f64 = text.parse().map_err(|error| format!("{error}"))?;
    if degrees > 0.0 && degrees <= 360.0 { Ok(degrees) } else { Err("above 0 and at most 360 degrees".to_owned()) }
}

impl LogArgs {
    /// The log; `None` where none was named.
    pub fn source(&self) -> anyhow::Result<Option<Box<dyn LogSource>>> {
        self.log.as_deref().map(|path| self.source_of(path)).transpose()
    }

    /// A log that is read as this one is.
    pub fn source_of(&self, path: &Path) -> anyhow::Result<Box<dyn LogSource>> {
        let imu = self.imu.as_deref().map_or(ImuTopic::Any, ImuTopic::named);
        let topics = Topics { scan: self.scan_topic.clone(), odometry: self.odom_topic.clone(), imu };
        let field_of_view = self.fov.map(f64::to_radians);
        if is_standard_input(path) {
            return open_standard_input(&topics, field_of_view);
        }
        let readable_twice = std::fs::metadata(path).map_or(true, |found| found.is_file() || found.is_dir());
        ensure!(
            readable_twice,
            "{}: no file: a log is read twice; `-` keeps what comes on standard input",
            path.display()
        );
        if let Some(field_of_view) = field_of_view {
            return Ok(Box::new(CarmenLog::new(path).with_field_of_view(field_of_view)));
        }
        Ok(open_log(path, &topics)?)
    }
}

/// Whether `-` is named in place of a file.
pub fn is_standard_input(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// The log that comes on standard input, which a signal ends.
pub fn open_standard_input(topics: &Topics, field_of_view: Option<f64>) -> anyhow::Result<Box<dyn LogSource>> {
    let nobody_writes = || UsageError("-: standard input is a terminal; let a program write to it".to_owned());
    ensure!(!stdin().is_terminal(), nobody_writes());
    let stream = Stream::new("stdin", stdin(), interrupt::happened).context("standard input cannot be kept")?;
    Ok(open_stream(stream, topics, field_of_view)?)
}
