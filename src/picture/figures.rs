//! The paper's figures 3 and 4 and the map of a run, in one pass over its scans.
//!
//! A run is over before its pictures are made: the final map and the trajectories are known, and the scans are fed
//! one at a time from a second reading of the log, so no scan is kept.

use super::files::{Files, drawn, path_length};
use super::objects::Objects;
use super::reproject::ClusterGrid;
use super::{Line, Picture, PictureError, PointRaster, Stroke, View};
use crate::geometry::{Pose, StampedPose};
use crate::ppca::Cluster;
use crate::report::{Estimate, RunResult};
use crate::scan::Scan;
use rayon::prelude::*;

/// Gathers the points of a run and draws its pictures.
pub struct Figures<'a> {
    name: String,
    clusters: &'a [Cluster],
    /// Where the robot was located, with a pose that is not finite where it was not.
    trajectory: Vec<StampedPose>,
    /// The way between, told apart in the same way.
    between: Vec<StampedPose>,
    reference: &'a [StampedPose],
    objects: Option<Objects<'a>>,
    world_from_odom: Pose,
    odometry: Vec<StampedPose>,
    grid: ClusterGrid,
    scans: u64,
    by_odometry: PointRaster,
    registered: PointRaster,
    reprojected: PointRaster,
}

impl<'a> Figures<'a> {
    /// Starts the pictures of a run over the log `name`.
    ///
    /// Odometry is moved as a whole so that its first pose is the first pose of the trajectory. `reference` is the
    /// true trajectory in the world's frame, shifted and rotated to it by the caller; empty where there is none.
    pub fn new(name: impl Into<String>, result: &'a RunResult, reference: &'a [StampedPose]) -> Self {
        let first = |poses: &[StampedPose]| poses.first().map_or(Pose::IDENTITY, |stamped| stamped.pose);
        let odometry = result.odometry();
        let [trajectory, between] = stretches(&result.poses);
        let world_from_odom = first(&trajectory) * first(&odometry).inverse();
        let moved = |stamped: &StampedPose| StampedPose { pose: world_from_odom * stamped.pose, ..*stamped };
        Self {
            name: name.into(),
            clusters: &result.map.clusters,
            trajectory,
            between,
            reference,
            objects: result.objects.as_ref().map(Objects::on_map),
            world_from_odom,
            odometry: odometry.iter().map(moved).collect(),
            grid: ClusterGrid::new(&result.map.clusters),
            scans: 0,
            by_odometry: PointRaster::new(),
            registered: PointRaster::new(),
            reprojected: PointRaster::new(),
        }
    }

    /// Adds one scan: where odometry, as recorded, and the filter saw the robot.
    pub fn add_scan(&mut self, scan: &Scan, odom_from_robot: Pose, world_from_robot: Pose) {
        self.scans += 1;
        let drifting = self.world_from_odom * odom_from_robot;
        for &point in &scan.points {
            self.by_odometry.add(drifting * point);
            let point = world_from_robot * point;
            self.registered.add(point);
            if let Some(cluster) = self.grid.most_likely(point) {
                self.reprojected.add(cluster.reprojected(point));
            }
        }
    }

    /// Draws everything: file names and what is in the files.
    ///
    /// # Errors
    /// A picture cannot be rendered.
    pub fn finish(&self) -> Result<Files, PictureError> {
        let drawn: Vec<_> = self.pictures().into_par_iter().map(drawn).collect::<Result<_, PictureError>>()?;
        Ok(drawn.into_iter().flatten().collect())
    }

    /// Draws the map, the path and the points alone.
    ///
    /// # Errors
    /// The picture cannot be rendered.
    pub fn map(&self) -> Result<Files, PictureError> {
        drawn(("map.png", Some("map.svg"), self.map_picture()))
    }

    fn map_picture(&self) -> Picture<'_> {
        let Self { name, clusters, .. } = self;
        let path = &self.trajectory[..];
        let scans = format!("{} points of {} scans", thousands(self.registered.count()), thousands(self.scans));
        let (count, length) = (clusters.len(), path_length(path));
        let mut picture = Picture::new(name)
            .note(format!("{count} walls, {scans}; path {length:.0} m"))
            .view(View::around([path], self.clusters, Some(&self.registered)))
            .points("laser points", &self.registered)
            .clusters(self.clusters)
            .trajectory("path of the robot", Line::ESTIMATE, path);
        picture.objects = self.objects.clone();
        if self.between.is_empty() {
            return picture;
        }
        picture.trajectory("not located: odometry", Line::BETWEEN, &self.between)
    }

    /// Every picture with the name of its PNG, and of its SVG where that is written as well.
    fn pictures(&self) -> [(&'static str, Option<&'static str>, Picture<'_>); 6] {
        let name = &self.name;
        let path = &self.trajectory[..];
        let view = View::around([path], self.clusters, Some(&self.registered));
        let clusters = self.clusters.len();
        let scans = format!("{} points of {} scans", thousands(self.registered.count()), thousands(self.scans));
        let length = path_length(path);

        let figure3 = Picture::new(format!("{name}: map by raw odometry"))
            .note(format!("{scans}; path {:.0} m", path_length(&self.odometry)))
            .points("laser points", &self.by_odometry)
            .trajectory("odometry", Line::ODOMETRY, &self.odometry);
        let other = if self.reference.is_empty() {
            ("raw odometry", Line { stroke: Stroke::Dashed, ..Line::REFERENCE }, &self.odometry[..])
        } else {
            ("true path", Line::REFERENCE, self.reference)
        };
        let figure4a = Picture::new(format!("{name}: trajectory"))
            .note(format!("path {length:.0} m"))
            .view(view)
            .trajectory("path of the robot", Line::ESTIMATE, path)
            .trajectory(other.0, other.1, other.2);
        let figure4b = Picture::new(format!("{name}: map of clusters"))
            .note(format!("{clusters} clusters, {} numbers", thousands(5 * clusters as u64)))
            .view(view)
            .points("laser points", &self.registered)
            .clusters(self.clusters)
            .deviations();
        let figure4c = Picture::new(format!("{name}: registered laser points"))
            .note(&scans)
            .view(view)
            .points("laser points", &self.registered)
            .trajectory("path of the robot", Line::ESTIMATE, path);
        let shown = self.reprojected.count() as f64 / self.registered.count().max(1) as f64;
        let figure4d = Picture::new(format!("{name}: laser points projected on their clusters"))
            .note(format!("{:.1} % of {scans}; the others are far from every cluster", 100.0 * shown))
            .view(view)
            .points("projected laser points", &self.reprojected);
        [
            ("map.png", Some("map.svg"), self.map_picture()),
            ("figure3_odometry_map.png", None, figure3),
            ("figure4a_trajectory.png", None, figure4a),
            ("figure4b_clusters.png", None, figure4b),
            ("figure4c_points.png", None, figure4c),
            ("figure4d_reprojected.png", None, figure4d),
        ]
    }
}

/// The poses at which the robot was located, and the way between them: odometry, bent so that it leads from one to the next. A
/// pose that is not finite parts stretches.
fn stretches(poses: &[Estimate]) -> [Vec<StampedPose>; 2] {
    const GAP: StampedPose = StampedPose { stamp: f64::NAN, pose: Pose { x: f64::NAN, y: f64::NAN, heading: 0.0 } };
    let located: Vec<(usize, Pose)> =
        (0..).zip(poses).filter_map(|(index, estimate)| Some((index, estimate.relied_on()?))).collect();
    let (mut trajectory, mut between) = (Vec::new(), Vec::new());
    let by_odometry = |(from, pose): (usize, Pose), to: usize| {
        pose * poses[to].odom_from_robot.seen_from(poses[from].odom_from_robot)
    };
    let stamped = |index: usize, pose: Pose| StampedPose { stamp: poses[index].stamp, pose };
    if let Some(&first) = located.first().filter(|first| first.0 > 0) {
        between.extend((0..=first.0).map(|index| stamped(index, by_odometry(first, index))));
        between.push(GAP);
    }
    for (number, &(index, pose)) in located.iter().enumerate() {
        trajectory.push(stamped(index, pose));
        let Some(&next) = located.get(number + 1).filter(|next| next.0 > index + 1) else { continue };
        trajectory.push(GAP);
        let off = next.1.position() - by_odometry((index, pose), next.0).position();
        between.extend((index..=next.0).map(|reading| {
            let Pose { x, y, heading } = by_odometry((index, pose), reading);
            let share = (reading - index) as f64 / (next.0 - index) as f64;
            stamped(reading, Pose { x: x + share * off.x, y: y + share * off.y, heading })
        }));
        between.push(GAP);
    }
    if let Some(&last) = located.last().filter(|last| last.0 + 1 < poses.len()) {
        between.extend((last.0..poses.len()).map(|index| stamped(index, by_odometry(last, index))));
    }
    [trajectory, between]
}

/// A count with commas.
fn thousands(count: u64) -> String {
    let digits = count.to_string();
    let groups: Vec<&str> =
        digits.as_bytes().rchunks(3).rev().filter_map(|group| std::str::from_utf8(group).ok()).collect();
    groups.join(",")
}
