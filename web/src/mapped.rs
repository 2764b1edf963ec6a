//! The result of a run: what is shown of it, and the files that can be saved.

use crate::live::{poses, walls};
use ipslam::geometry::StampedPose;
use ipslam::grid::{FreeArea, GridBuilder, OccupancyGrid, RESOLUTION};
use ipslam::io::{map_json, tum};
use ipslam::log::{LogEntry, LogError, LogSource, readings};
use ipslam::map::LineMap;
use ipslam::picture::{Line, Picture, PointRaster};
use ipslam::pipeline::Outcome;
use ipslam::scan::{Scan, ScanConfig};
use serde_json::json;
use wasm_bindgen::prelude::*;

/// A log that was mapped.
#[wasm_bindgen]
pub struct Mapped {
    name: String,
    outcome: Outcome,
    /// What evaluated the particles, at least at first.
    evaluated_on: String,
    map: LineMap,
    trajectory: Vec<StampedPose>,
    points: PointRaster,
    grid: Option<OccupancyGrid>,
    warnings: Vec<String>,
}

impl Mapped {
    /// Reads the log again for its points.
    pub fn new(
        log: &dyn LogSource,
        scan_config: &ScanConfig,
        outcome: Outcome,
        evaluated_on: String,
    ) -> Result<Self, String> {
        if outcome.counts.scans == 0 {
            let mut reasons = vec![format!("{}: no laser reading in this log, so there is nothing to map", log.name())];
            reasons.extend(outcome.warnings());
            return Err(reasons.join("; "));
        }
        let mut warnings = outcome.warnings();
        warnings.extend(outcome.smoothing.as_ref().err().map(ToString::to_string));
        let (mut points, mut builder) = (PointRaster::new(), GridBuilder::new(RESOLUTION));
        let added = add_scans(&mut points, &mut builder, log, scan_config, &outcome);
        warnings.extend(added.err().map(|error| error.to_string()));
        let grid = builder.finish().map_err(|error| warnings.push(error.to_string())).ok();
        let driven = outcome.result.relied_on().map(|(_, pose)| pose.position());
        let free = grid.as_ref().and_then(|grid| FreeArea::from_grid(grid, driven));
        let map = LineMap { free, ..outcome.result.map.clone() };
        let trajectory = outcome.result.trajectory();
        Ok(Self { name: log.name(), outcome, evaluated_on, map, trajectory, points, grid, warnings })
    }
}

fn add_scans(
    points: &mut PointRaster,
    builder: &mut GridBuilder,
    log: &dyn LogSource,
    scan_config: &ScanConfig,
    outcome: &Outcome,
) -> Result<(), LogError> {
    for (reading, estimate) in readings(log)?.zip(&outcome.result.poses) {
        if let ((_, LogEntry::Laser(reading)), Some(pose)) = (reading?, estimate.relied_on()) {
            let scan = Scan::from_reading(&reading, scan_config);
            scan.points.iter().for_each(|&point| points.add(pose * point));
            builder.add_scan(&scan, reading.robot_from_laser, pose);
        }
    }
    Ok(())
}

#[wasm_bindgen]
impl Mapped {
    /// Rows of `x1 y1 x2 y2`.
    pub fn walls(&self) -> Vec<f32> {
        walls(&self.map.clusters)
    }

    /// Rows of `x y heading`, one a reading.
    pub fn path(&self) -> Vec<f32> {
        poses(self.trajectory.iter().map(|stamped| stamped.pose))
    }

    /// Cells row by row from the lower left: 0 unknown, 1 free, 2 occupied. Empty where there is no grid.
    pub fn cells(&self) -> Vec<u8> {
        self.grid.iter().flat_map(OccupancyGrid::cells).map(|&cell| cell as u8).collect()
    }

    /// Counts, the place of the grid, the verdict, its reasons and warnings, as JSON.
    pub fn summary(&self) -> String {
        let Outcome { result, counts, .. } = &self.outcome;
        let doubts = self.outcome.doubts();
        let steps = self.trajectory.windows(2);
        let length: f64 = steps.map(|pair| (pair[1].pose.position() - pair[0].pose.position()).norm()).sum();
        let grid = self.grid.as_ref().map(|grid| {
            let corner = grid.world_from_grid();
            json!({
                "x": corner.x, "y": corner.y, "width": grid.width(), "height": grid.height(), "resolution": grid.resolution(),
            })
        });
        let summary = json!({
            "name": self.name,
            "evaluated_on": self.evaluated_on,
            "verdict": if doubts.is_empty() { "consistent" } else { "doubtful" },
            "doubts": doubts,
            "warnings": self.warnings,
            "walls": self.map.clusters.len(),
            "scans": counts.scans,
            "points": counts.points,
            "steps": counts.steps,
            "seconds": counts.log_seconds(),
            "metres": length,
            "loops": result.loops.iter().filter(|found| found.is_closed).count(),
            "effective_sample_size": counts.effective_sum / counts.steps.max(1) as f64,
            "run_seconds": self.outcome.filter_seconds + self.outcome.smoothing_seconds,
            "grid": grid,
        });
        summary.to_string()
    }

    /// The file `map.json`.
    ///
    /// # Errors
    /// A cluster cannot be written.
    pub fn map_json(&self) -> Result<Vec<u8>, String> {
        let mut bytes = Vec::new();
        map_json::write_map(&self.map, &mut bytes).map_err(|error| error.to_string())?;
        Ok(bytes)
    }

    /// The file `trajectory.tum`.
    ///
    /// # Errors
    /// None that is known.
    pub fn trajectory(&self) -> Result<Vec<u8>, String> {
        let mut bytes = Vec::new();
        tum::write_poses(&self.trajectory, &mut bytes).map_err(|error| error.to_string())?;
        Ok(bytes)
    }

    /// The file `map.svg`.
    pub fn svg(&self) -> String {
        let (walls, scans) = (self.map.clusters.len(), self.outcome.counts.scans);
        Picture::new(&self.name)
            .note(format!("{walls} walls, {} points of {scans} scans", self.points.count()))
            .points("laser points", &self.points)
            .clusters(&self.map.clusters)
            .trajectory("path of the robot", Line::ESTIMATE, &self.trajectory)
            .to_svg()
    }
}
