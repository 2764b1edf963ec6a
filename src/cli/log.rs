//! Which log to read, as the commands that read one let the user choose it.

use anyhow::ensure;
use ipslam::io::carmen::CarmenLog;
use ipslam::io::mcap::Topics;
use ipslam::io::open_log;
use ipslam::log::LogSource;
use std::path::PathBuf;

/// A log and, where it is a bag, which of its topics.
#[derive(Debug, clap::Args)]
pub struct LogArgs {
    /// CARMEN log, plain or gzip, or ROS bag: an MCAP, SQLite (.db3) or ROS 1 (.bag) file, or the folder of one
    pub log: Option<PathBuf>,
    /// Topic of the laser scans in a bag [default: the only one]
    #[arg(long, value_name = "TOPIC", requires = "log")]
    scan_topic: Option<String>,
    /// Topic of the odometry in a bag: odometry messages or transforms [default: the only odometry, or else /tf]
    #[arg(long, value_name = "TOPIC", requires = "log")]
    odom_topic: Option<String>,
    /// Field of view of a laser whose sweeps hold only ranges (FLASER) [degrees; default: what the log or the number of
    /// beams tells]
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
        let Some(path) = &self.log else { return Ok(None) };
        let readable_twice = std::fs::metadata(path).map_or(true, |found| found.is_file() || found.is_dir());
        ensure!(readable_twice, "{}: no file; a log is read twice, so save it to a file first", path.display());
        let topics = Topics { scan: self.scan_topic.clone(), odometry: self.odom_topic.clone() };
        if let Some(degrees) = self.fov {
            return Ok(Some(Box::new(CarmenLog::new(path).with_field_of_view(degrees.to_radians()))));
        }
        Ok(Some(open_log(path, &topics)?))
    }
}
