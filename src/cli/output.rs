//! The files of a run. One that cannot be written does not keep the others from being written.

use anyhow::Context as _;
use ipslam::geometry::StampedPose;
use ipslam::grid::{FreeArea, GridBuilder, RESOLUTION};
use ipslam::io::{geojson, map_json, map_server, tum, write_whole};
use ipslam::log::{LogEntry, LogSource, readings};
use ipslam::map::LineMap;
use ipslam::picture::Figures;
use ipslam::pipeline::Outcome;
use ipslam::scan::{Scan, ScanConfig};
use std::path::{Path, PathBuf};

/// A folder for outputs, and what went wrong with them.
pub struct Outputs {
    folder: PathBuf,
    pub errors: Vec<anyhow::Error>,
}

impl Outputs {
    /// A folder for what is made of a log: the one that was named, or one of the log's own.
    pub fn for_log(named: Option<&Path>, log: &str) -> anyhow::Result<Self> {
        Self::new(named.map_or_else(|| Path::new("ipslam-out").join(log), Path::to_owned))
    }

    /// Makes the folder and tries it, so that a long run does not end without a place for its results.
    fn new(folder: PathBuf) -> anyhow::Result<Self> {
        let remedy = || format!("{}: no folder for outputs; name another one with --out", folder.display());
        std::fs::create_dir_all(&folder).with_context(remedy)?;
        let probe = folder.join(".ipslam-probe");
        write_whole(&probe, |file| file.write_all(b"can this be written?")).with_context(remedy)?;
        std::fs::remove_file(&probe).with_context(remedy)?;
        Ok(Self { folder, errors: Vec::new() })
    }

    /// Where a file of this name is.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Writes a file.
    pub fn write(&mut self, name: &str, bytes: &[u8]) {
        let written = write_whole(&self.path(name), |file| file.write_all(bytes));
        self.note(written);
    }

    /// Writes the trajectory.
    pub fn write_trajectory(&mut self, name: &str, trajectory: &[StampedPose]) {
        let written = tum::write(&self.path(name), trajectory);
        self.note(written);
    }

    /// Keeps an error for the end.
    pub fn note<E: Into<anyhow::Error>>(&mut self, result: Result<(), E>) {
        self.errors.extend(result.err().map(Into::into));
    }

    /// Writes `map.json`; returns its size in bytes.
    fn write_map(&mut self, map: &LineMap) -> usize {
        let mut bytes = Vec::new();
        match map_json::write_map(map, &mut bytes) {
            Ok(()) => self.write("map.json", &bytes),
            Err(error) => self.note(Err(anyhow::Error::new(error).context("map.json"))),
        }
        bytes.len()
    }

    /// Reads the log again for its points, as far as it was mapped; writes the map with its free area, the grid and the
    /// walls, and draws the pictures. Returns the size of `map.json` in bytes.
    ///
    /// `reference` is in the world's frame.
    pub fn look_again(
        &mut self,
        source: &dyn LogSource,
        scan_config: &ScanConfig,
        mapped: &Outcome,
        reference: &[StampedPose],
    ) -> usize {
        let result = &mapped.result;
        let mut figures = Figures::new(source.name(), result, reference);
        let mut builder = GridBuilder::new(RESOLUTION);
        let added = add_scans(&mut figures, &mut builder, source, scan_config, mapped);
        self.note(added.context("the log cannot be read again for the grid and the pictures"));
        let driven = result.relied_on().map(|(_, pose)| pose.position());
        let free = match builder.finish() {
            Ok(grid) => {
                let written = map_server::write(&self.path("map.yaml"), &grid);
                self.note(written);
                FreeArea::from_grid(&grid, driven)
            }
            Err(error) => {
                self.note(Err(error));
                None
            }
        };
        let map = LineMap { free, ..result.map.clone() };
        let map_bytes = self.write_map(&map);
        let walls = write_whole(&self.path("walls.geojson"), |file| geojson::write_walls(&map.clusters, file));
        self.note(walls);
        self.draw(&figures);
        map_bytes
    }

    fn draw(&mut self, figures: &Figures<'_>) {
        match figures.finish() {
            Ok(files) => files.iter().for_each(|(name, bytes)| self.write(name, bytes)),
            Err(error) => self.note(Err(error)),
        }
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }
}

fn add_scans(
    figures: &mut Figures<'_>,
    builder: &mut GridBuilder,
    source: &dyn LogSource,
    scan_config: &ScanConfig,
    mapped: &Outcome,
) -> anyhow::Result<()> {
    for (reading, estimate) in readings(source)?.zip(&mapped.result.poses) {
        if let ((_, LogEntry::Laser(reading)), Some(pose)) = (reading?, estimate.relied_on()) {
            let scan = Scan::from_reading(&reading, scan_config);
            figures.add_scan(&scan, estimate.odom_from_robot, pose);
            builder.add_scan(&scan, reading.robot_from_laser, pose);
        }
    }
    Ok(())
}
