//! `ipslam run --continue`: the map of an earlier run, and where in it a drive begins.

use super::convert::read_grid;
use super::known_map::{known_map, pose};
use super::say::say;
use anyhow::Context as _;
use ipslam::config::{LocalizationConfig, SlamConfig};
use ipslam::geometry::Pose;
use ipslam::grid::{OccupancyGrid, drawn};
use ipslam::localization::{Beginning, InitialPose, find_beginning};
use ipslam::log::{LogEntry, LogError, LogReader, LogSource, LogStats};
use ipslam::map::LineMap;
use ipslam::pipeline::Continued;
use std::path::{Path, PathBuf};

/// Which map a run goes on with.
#[derive(Clone, Debug, clap::Args)]
pub struct ContinueArgs {
    /// Go on with the map of an earlier run, its folder or map.json: the robot is found in it first, then both drives are one map
    #[arg(long = "continue", value_name = "RUN")]
    earlier: Option<PathBuf>,
    /// Where the robot is at its first scan, about, in the frame of that map; without it, it may be anywhere
    #[arg(long, value_name = "X,Y,HEADING", allow_hyphen_values = true, value_parser = pose, requires = "earlier")]
    start: Option<Pose>,
}

/// Standard deviations of `--start` \[m, rad\], as for `localize`.
const START: [f64; 2] = [0.5, 0.26];

/// An earlier drive, and where the new one begins in it.
pub struct Earlier {
    pub continued: Continued,
    /// Its grid if there is one, else one drawn from its map.
    pub grid: OccupancyGrid,
}

impl From<PathBuf> for ContinueArgs {
    /// Goes on with this run, the robot anywhere in it.
    fn from(run: PathBuf) -> Self {
        Self { earlier: Some(run), start: None }
    }
}

impl ContinueArgs {
    /// Reads the earlier map and finds the robot in it; `None` where nothing is to be continued.
    pub fn find(&self, source: &dyn LogSource, config: &SlamConfig, cell_size: f64) -> anyhow::Result<Option<Earlier>> {
        let Some(named) = &self.earlier else { return Ok(None) };
        let path = if named.is_dir() { named.join("map.json") } else { named.clone() };
        let map = known_map(&path)?;
        let grid = grid_of(&path, &map, cell_size)?;
        say!("finding {} in {}", source.name(), path.display());
        let [position_sigma, heading_sigma] = START;
        let initial =
            self.start.map(|world_from_robot| InitialPose { world_from_robot, position_sigma, heading_sigma });
        let SlamConfig { seed, scan, motion, tracking, .. } = *config;
        let localization = LocalizationConfig { seed, scan, motion, tracking, ..LocalizationConfig::default() };
        let Beginning { reading: first_scan, world_from_robot } = find_beginning(&map, source, initial, &localization)
            .with_context(|| format!("{}: {} cannot be continued in it", path.display(), source.name()))?;
        let name = path.display().to_string();
        Ok(Some(Earlier { continued: Continued { name, map, first_scan, world_from_robot }, grid }))
    }
}

/// The grid beside a map of this path, or else one that is drawn of it.
pub fn grid_of(path: &Path, map: &LineMap, cell_size: f64) -> anyhow::Result<OccupancyGrid> {
    let yaml = path.with_extension("yaml");
    if path.extension().is_some_and(|ending| ending == "json") && yaml.is_file() {
        return read_grid(&yaml);
    }
    Ok(drawn(&map.clusters, map.free.as_ref(), cell_size)?)
}

/// A log whose scans before one of its readings are no more than odometry.
pub struct ScansFrom<'a> {
    pub source: &'a dyn LogSource,
    pub reading: usize,
}

impl LogSource for ScansFrom<'_> {
    fn name(&self) -> String {
        self.source.name()
    }

    fn open(&self) -> Result<Box<dyn LogReader>, LogError> {
        Ok(Box::new(Later { reader: self.source.open()?, left_out: self.reading }))
    }

    fn is_live(&self) -> bool {
        self.source.is_live()
    }
}

struct Later {
    reader: Box<dyn LogReader>,
    /// Readings before the first scan that counts.
    left_out: usize,
}

impl Iterator for Later {
    type Item = Result<LogEntry, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        let entry = self.reader.next()?;
        Some(match entry {
            Ok(LogEntry::Laser(reading)) if self.left_out > 0 => {
                self.left_out -= 1;
                Ok(LogEntry::Odometry { stamp: reading.stamp, odom_from_robot: reading.odom_from_robot })
            }
            Ok(odometry @ LogEntry::Odometry { .. }) => {
                self.left_out = self.left_out.saturating_sub(1);
                Ok(odometry)
            }
            other => other,
        })
    }
}

impl LogReader for Later {
    fn stats(&self) -> &LogStats {
        self.reader.stats()
    }

    fn progress(&self) -> Option<(u64, u64)> {
        self.reader.progress()
    }
}
