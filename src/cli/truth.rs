//! What a trajectory is scored by.

use super::eval::Report;
use ipslam::geometry::StampedPose;
use ipslam::io::relations::{self, Relation};
use ipslam::io::tum;
use ipslam::log::LogError;
use ipslam::metrics::relations::relation_errors;
use ipslam::metrics::trajectory::reference_errors;
use std::path::{Path, PathBuf};

/// Files with ground truth.
#[derive(Debug, Default, clap::Args)]
pub struct TruthArgs {
    /// Relations of the SLAM benchmark (t1 t2 x y z roll pitch yaw) to score the trajectory by
    #[arg(long, value_name = "FILE")]
    pub relations: Option<PathBuf>,
    /// Reference trajectory (TUM or t x y theta) to score by and to draw; without one, true poses in the log are used
    #[arg(long, value_name = "FILE")]
    pub reference: Option<PathBuf>,
}

/// Their contents.
pub struct Truth<'a> {
    args: &'a TruthArgs,
    relations: Option<Vec<Relation>>,
    reference: Option<Vec<StampedPose>>,
}

impl TruthArgs {
    /// Whether no file is named.
    #[cfg(feature = "record")]
    pub fn is_empty(&self) -> bool {
        self.relations.is_none() && self.reference.is_none()
    }

    /// Reads the files.
    pub fn read(&self) -> Result<Truth<'_>, LogError> {
        let relations = self.relations.as_deref().map(relations::read).transpose()?;
        let reference = self.reference.as_deref().map(tum::read).transpose()?;
        Ok(Truth { args: self, relations, reference })
    }
}

impl Truth<'_> {
    /// Scores a trajectory. Returns the reference in the trajectory's frame as well; it is `of_log` where no file has one.
    pub fn score<'a>(
        &'a self,
        trajectory_path: &'a Path,
        trajectory: &[StampedPose],
        of_log: &[StampedPose],
    ) -> (Report<'a>, Vec<StampedPose>) {
        let mut report = Report { trajectory_path, poses: trajectory.len(), relations: None, reference: None };
        if let (Some(path), Some(relations)) = (&self.args.relations, &self.relations) {
            report.relations = Some((path, relation_errors(relations, trajectory)));
        }
        let path = self.args.reference.as_deref().unwrap_or(Path::new("(true poses of the log)"));
        let mut reference = self.reference.clone().unwrap_or_else(|| of_log.to_vec());
        if !reference.is_empty() {
            let errors = reference_errors(&reference, trajectory);
            let world_from_reference = errors.reference_from_world.inverse();
            reference.iter_mut().for_each(|StampedPose { pose, .. }| *pose = world_from_reference * *pose);
            report.reference = Some((path, errors));
        }
        (report, reference)
    }
}
