//! The files of a run. One that cannot be written does not keep the others from being written.

use super::UsageError;
use super::progress::Bar;
use super::say::say;
use anyhow::{Context as _, bail, ensure};
use ipslam::geometry::StampedPose;
use ipslam::grid::{FreeArea, GridBuilder, OccupancyGrid};
use ipslam::io::semantic::results;
use ipslam::io::{geojson, map_json, map_server, poses, tum, write_whole};
use ipslam::log::{LogEntry, LogSource, readings};
use ipslam::map::LineMap;
use ipslam::objects::ObjectMap;
use ipslam::picture::Figures;
use ipslam::pipeline::Outcome;
use ipslam::report::RunResult;
use ipslam::scan::{Scan, ScanConfig};
use ipslam::semantic::Plane;
use std::fs::{File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Where results go. A finished run is replaced only by `--force`: hours of work are not lost to an arrow key. Where no folder is
/// named, the next one that is free is taken.
#[derive(Debug, clap::Args)]
pub struct OutArgs {
    /// Folder for the outputs, made where it is missing [default: ipslam-out/NAME of the input, with -2, -3, ... where a run is
    /// there already]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace the finished run in that folder
    #[arg(long)]
    force: bool,
}

impl OutArgs {
    /// A folder for what is made of an input of this name.
    pub fn open(&self, input: &str) -> anyhow::Result<Outputs> {
        if let Some(folder) = &self.out {
            let is_free = self.force || !holds_run(folder);
            let remedy = "it holds a finished run: name another folder with --out, or replace that run with --force";
            ensure!(is_free, UsageError(format!("{}: {remedy}", folder.display())));
            return Outputs::new(folder.clone());
        }
        self.numbered(Path::new("ipslam-out"), input)
    }

    /// The same for one of several inputs: below the folder that was named.
    pub fn open_below(&self, input: &str) -> anyhow::Result<Outputs> {
        self.numbered(self.out.as_deref().unwrap_or(Path::new("ipslam-out")), input)
    }

    fn numbered(&self, above: &Path, input: &str) -> anyhow::Result<Outputs> {
        // A name of dots alone is another folder's.
        let name = if input.trim_matches('.').is_empty() { "log" } else { input };
        let mut folder = above.join(name);
        let mut number = 2;
        while !self.force && (holds_run(&folder) || is_locked(&folder)) {
            folder.set_file_name(format!("{name}-{number}"));
            number += 1;
        }
        Outputs::new(folder)
    }
}

fn holds_run(folder: &Path) -> bool {
    folder.join(SUMMARY).exists()
}

/// Whether a run is writing there.
fn is_locked(folder: &Path) -> bool {
    let lock = File::open(folder.join(LOCK));
    lock.is_ok_and(|lock| matches!(lock.try_lock(), Err(TryLockError::WouldBlock)))
}

/// A folder for outputs, and what went wrong with them.
///
/// Files are written to a folder beside the results and moved in together at the end, `summary.json` last: where it is, all
/// others are of the same run. A lock keeps two runs from one folder.
pub struct Outputs {
    folder: PathBuf,
    /// Of the folder and those above it, the ones that were made for it, the innermost first.
    made: Vec<PathBuf>,
    staging: PathBuf,
    /// Held as long as the run writes; the system lets go of it however the run ends.
    _lock: File,
    staged: Vec<String>,
    pub errors: Vec<anyhow::Error>,
}

/// Written last.
const SUMMARY: &str = "summary.json";
const LOCK: &str = ".lock";
/// Folders that begin with this are of runs under way, or of ones that were killed.
const STAGING: &str = ".ipslam-";

impl Outputs {
    /// Makes the folder and tries it, so that a long run does not end without a place for its results.
    fn new(folder: PathBuf) -> anyhow::Result<Self> {
        let remedy = || format!("{}: no folder for outputs; name another one with --out", folder.display());
        let is_missing = |above: &&Path| !above.as_os_str().is_empty() && !above.exists();
        let made = folder.ancestors().take_while(is_missing).map(Path::to_owned).collect();
        std::fs::create_dir_all(&folder).with_context(remedy)?;
        let lock = File::create(folder.join(LOCK)).with_context(remedy)?;
        if let Err(TryLockError::WouldBlock) = lock.try_lock() {
            bail!("{}: another run is writing to this folder; name another one with --out", folder.display());
        }
        // Nobody else writes here, so whatever was begun is of a run that was killed.
        for entry in std::fs::read_dir(&folder).with_context(remedy)?.flatten() {
            if entry.file_name().to_string_lossy().starts_with(STAGING) {
                std::fs::remove_dir_all(entry.path()).with_context(remedy)?;
            }
        }
        let staging = folder.join(format!("{STAGING}{}", std::process::id()));
        std::fs::create_dir(&staging).with_context(remedy)?;
        let probe = staging.join("probe");
        write_whole(&probe, |file| file.write_all(b"can this be written?")).with_context(remedy)?;
        std::fs::remove_file(&probe).with_context(remedy)?;
        Ok(Self { folder, made, staging, _lock: lock, staged: Vec::new(), errors: Vec::new() })
    }

    /// Where a file of this name will be.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Where a file of this name is written to.
    pub fn stage(&mut self, name: &str) -> PathBuf {
        self.staged.push(name.to_owned());
        self.staging.join(name)
    }

    /// Writes a file.
    pub fn write(&mut self, name: &str, bytes: &[u8]) {
        let path = self.stage(name);
        self.note(write_whole(&path, |file| file.write_all(bytes)));
    }

    /// Moves all files to where they belong. Where one of them could not be written and the folder holds the results of an
    /// earlier run, those stay, and the new ones go to the subfolder `incomplete`.
    pub fn finish(&mut self) {
        let is_whole = self.staged.iter().all(|name| self.staging.join(name).is_file());
        let target =
            if is_whole || !holds_run(&self.folder) { self.folder.clone() } else { self.folder.join("incomplete") };
        let moved = self.move_to(&target);
        self.note(moved.with_context(|| format!("{}: outputs cannot be moved there", target.display())));
        if target == self.folder {
            say!("outputs are in {}", target.display());
        } else {
            say!("not all outputs could be written; those that could are in {}", target.display());
        }
    }

    fn move_to(&mut self, target: &Path) -> std::io::Result<()> {
        std::fs::create_dir_all(target)?;
        if let Err(error) = std::fs::remove_file(target.join(SUMMARY))
            && error.kind() != ErrorKind::NotFound
        {
            return Err(error);
        }
        let is_last = |name: &&String| *name == SUMMARY;
        for name in self.staged.iter().filter(|name| !is_last(name)).chain(self.staged.iter().filter(is_last)) {
            let staged = self.staging.join(name);
            if staged.is_file() {
                std::fs::rename(staged, target.join(name))?;
            }
        }
        self.staged.clear();
        std::fs::remove_dir_all(&self.staging)
    }

    /// Writes the poses that can be relied on as a trajectory, and all of them with what is known of each.
    pub fn write_poses(&mut self, result: &RunResult) {
        let path = self.stage("trajectory.tum");
        self.note(tum::write(&path, &result.trajectory()));
        let path = self.stage("poses.csv");
        self.note(poses::write(&path, &result.poses));
    }

    fn write_landmarks(&mut self, objects: &ObjectMap) {
        let landmarks: Vec<_> = objects.landmarks.iter().map(Into::into).collect();
        for (name, text) in results::landmark_files::<Plane>(&objects.classes, &landmarks) {
            self.write(name, text.as_bytes());
        }
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
    /// `reference` is in the world's frame, `cell_size` the side of a cell of the grid [m]. With the grid of an earlier
    /// drive, the grid written covers both.
    pub fn look_again(
        &mut self,
        source: &dyn LogSource,
        scan_config: &ScanConfig,
        mapped: &Outcome,
        reference: &[StampedPose],
        cell_size: f64,
        earlier: Option<&OccupancyGrid>,
    ) -> usize {
        let result = &mapped.result;
        let mut figures = Figures::new(source.name(), result, reference);
        let mut builder = GridBuilder::new(cell_size);
        let added = add_scans(&mut figures, &mut builder, source, scan_config, mapped);
        self.note(added.context("the log cannot be read again for the grid and the pictures"));
        let driven = result.relied_on().map(|(_, pose)| pose.position());
        let grid = builder.finish().map_err(anyhow::Error::from);
        let grid = match earlier {
            Some(earlier) => grid.and_then(|grid| Ok(grid.over(earlier)?)),
            None => grid,
        };
        let free = match grid {
            Ok(grid) => {
                self.stage("map.pgm");
                let path = self.stage("map.yaml");
                self.note(map_server::write(&path, &grid));
                FreeArea::from_grid(&grid, driven)
            }
            Err(error) => {
                self.note(Err(error));
                None
            }
        };
        let map = LineMap { free, ..result.map.clone() };
        let map_bytes = self.write_map(&map);
        let path = self.stage("walls.geojson");
        self.note(write_whole(&path, |file| geojson::write_walls(&map.clusters, file)));
        self.draw(&figures);
        result.objects.iter().for_each(|objects| self.write_landmarks(objects));
        map_bytes
    }

    fn draw(&mut self, figures: &Figures<'_>) {
        let bar = Bar::busy("drawing the pictures");
        let drawn = figures.finish();
        bar.finish();
        match drawn {
            Ok(files) => files.iter().for_each(|(name, bytes)| self.write(name, bytes)),
            Err(error) => self.note(Err(error)),
        }
    }
}

impl Drop for Outputs {
    /// A run that failed leaves nothing behind, and no empty folder that it made.
    fn drop(&mut self) {
        // What is not there, or not empty, is as it should be.
        let _ = std::fs::remove_dir_all(&self.staging);
        let _ = std::fs::remove_file(self.folder.join(LOCK));
        self.made.iter().for_each(|folder| _ = std::fs::remove_dir(folder));
    }
}

/// Writes a result so far with its grid to a folder.
#[cfg(feature = "live")]
pub fn write_map(folder: &Path, result: RunResult, grid: &OccupancyGrid) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)?;
    let driven = result.relied_on().map(|(_, pose)| pose.position());
    let map = LineMap { free: FreeArea::from_grid(grid, driven), ..result.map.clone() };
    let mut bytes = Vec::new();
    map_json::write_map(&map, &mut bytes)?;
    write_whole(&folder.join("map.json"), |file| file.write_all(&bytes))?;
    map_server::write(&folder.join("map.yaml"), grid)?;
    tum::write(&folder.join("trajectory.tum"), &result.trajectory())?;
    Ok(())
}

fn add_scans(
    figures: &mut Figures<'_>,
    builder: &mut GridBuilder,
    source: &dyn LogSource,
    scan_config: &ScanConfig,
    mapped: &Outcome,
) -> anyhow::Result<()> {
    let mut bar = Bar::new(Some(mapped.result.poses.len() as u64));
    for (done, (reading, estimate)) in (0..).zip(readings(source)?.zip(&mapped.result.poses)) {
        bar.update(done, |_| "grid and pictures".to_owned());
        if let ((_, LogEntry::Laser(reading)), Some(pose)) = (reading?, estimate.relied_on()) {
            let scan = Scan::from_reading(&reading, scan_config);
            figures.add_scan(&scan, estimate.odom_from_robot, pose);
            builder.add_scan(&scan, reading.robot_from_laser, pose);
        }
    }
    bar.finish();
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(folder: &Path, name: &str) -> Option<String> {
        std::fs::read_to_string(folder.join(name)).ok()
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// Writes two files; where `fails`, the map cannot be written.
    fn run(folder: &Path, text: &str, fails: bool) -> Outputs {
        let mut outputs = Outputs::new(folder.to_owned()).unwrap();
        if fails {
            std::fs::create_dir(outputs.staging.join("map.json")).unwrap();
        }
        outputs.write("map.json", text.as_bytes());
        outputs.write(SUMMARY, text.as_bytes());
        assert_eq!(outputs.errors.len(), usize::from(fails));
        outputs
    }

    #[test]
    fn results_of_two_runs_never_mix() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        run(&folder, "first", false).finish();
        assert_eq!(names(&folder), ["map.json", SUMMARY]);
        // Killed before its end: nothing of it is seen, and what it left is gone after the next run.
        let killed = folder.join(format!("{STAGING}1"));
        std::fs::create_dir(&killed).unwrap();
        std::fs::write(killed.join("map.json"), "killed").unwrap();
        assert_eq!(read(&folder, "map.json").unwrap(), "first");
        run(&folder, "second", true).finish();
        assert_eq!([read(&folder, "map.json"), read(&folder, SUMMARY)].map(Option::unwrap), ["first", "first"]);
        assert_eq!(names(&folder.join("incomplete")), [SUMMARY]);
        run(&folder, "third", false).finish();
        assert_eq!([read(&folder, "map.json"), read(&folder, SUMMARY)].map(Option::unwrap), ["third", "third"]);
        assert!(!names(&folder).iter().any(|name| name.starts_with('.')), "{:?}", names(&folder));
    }

    #[test]
    fn what_could_be_written_of_a_first_run_is_there() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        run(&folder, "first", true).finish();
        assert_eq!(names(&folder), [SUMMARY]);
    }

    #[test]
    fn two_runs_do_not_write_to_one_folder() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        let first = run(&folder, "first", false);
        let error = Outputs::new(folder.clone()).err().unwrap().to_string();
        assert!(error.contains("another run is writing"), "{error}");
        drop(first);
        assert!(!folder.exists(), "a run that failed leaves an empty folder");
    }
}
