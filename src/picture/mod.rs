//! Pictures of a run: laser points, clusters and trajectories seen from above, as SVG and as PNG.
//!
//! A [`Picture`] is a list of layers in the world's frame, in metres, x to the right and y up. [`Picture::to_svg`]
//! writes the one document; [`svg_to_png`] renders that same document, with a font of its own, so that both formats
//! show the same on any machine. Points are far too many for a vector picture and are counted in a [`PointRaster`]
//! first. [`Figures`] makes the paper's figures 3 and 4 and the map of a run in one pass over its scans, [`object_map`] the map of
//! objects.
//!
//! What is not finite is left out.

mod figures;
mod files;
#[cfg(feature = "images")]
mod keyframe;
mod objects;
mod png;
mod raster;
mod reproject;
mod sheet;
mod svg;

pub use figures::Figures;
pub use files::Files;
#[cfg(feature = "images")]
pub use keyframe::keyframe_picture;
pub use objects::{class_colour, object_map};
pub use png::{PictureError, svg_to_png};
pub use raster::PointRaster;
pub use sheet::Sheet;

use crate::geometry::StampedPose;
use crate::ppca::Cluster;
use nalgebra::{Point2, Vector2};

/// Longer side, in pixels, of the pictures that are written as PNG.
pub const PNG_SIDE: u32 = 1600;

/// Nothing is drawn farther from the origin than this, in metres; it keeps every number of a picture in range.
pub(crate) const FARTHEST: f64 = 1e7;

/// How a trajectory is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    /// Red, green and blue.
    pub colour: [u8; 3],
    /// How the colour is put down.
    pub stroke: Stroke,
}

/// How a line is put down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stroke {
    /// In one.
    Solid,
    /// For what is not the estimate.
    Dashed,
    /// For what lies between stretches that are known.
    Dotted,
}

impl Line {
    /// What the filter found: black, as in Fig. 4a.
    pub const ESTIMATE: Self = Self { colour: [20, 24, 31], stroke: Stroke::Solid };
    /// The true trajectory, or the best that is known of it: grey, as in Fig. 4a.
    pub const REFERENCE: Self = Self { colour: [150, 156, 164], stroke: Stroke::Solid };
    /// Raw odometry.
    pub const ODOMETRY: Self = Self { colour: [214, 120, 40], stroke: Stroke::Dashed };
    /// Where the robot was not located: odometry from one place where it was to the next.
    pub const BETWEEN: Self = Self { stroke: Stroke::Dotted, ..Self::ESTIMATE };
}

/// A picture under construction; layers lie on each other as points, clusters, trajectories, objects.
#[derive(Clone, Debug, Default)]
pub struct Picture<'a> {
    title: String,
    note: String,
    view: Option<View>,
    points: Option<(String, &'a PointRaster)>,
    clusters: Option<&'a [Cluster]>,
    deviations: bool,
    trajectories: Vec<(String, Line, &'a [StampedPose])>,
    objects: Option<objects::Objects<'a>>,
}

impl<'a> Picture<'a> {
    /// An empty picture.
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), ..Self::default() }
    }

    /// A smaller line of text below the title.
    pub fn note(mut self, note: impl Into<String>) -> Self {
        self.note = note.into();
        self
    }

    /// The part of the world to show, in place of the one that [`View::around`] finds.
    pub fn view(mut self, view: View) -> Self {
        self.view = Some(view);
        self
    }

    /// Laser points, darker where there are more.
    pub fn points(mut self, label: impl Into<String>, points: &'a PointRaster) -> Self {
        self.points = Some((label.into(), points));
        self
    }

    /// Clusters of the world's frame, each as the wall that it stands for, to its ends.
    pub fn clusters(mut self, clusters: &'a [Cluster]) -> Self {
        self.clusters = Some(clusters);
        self
    }

    /// Every cluster also as the ellipse of one standard deviation, which is what the paper's Fig. 4b shows.
    pub fn deviations(mut self) -> Self {
        self.deviations = true;
        self
    }

    /// One more trajectory: poses of the robot in the world's frame, in the order in which they are joined.
    pub fn trajectory(mut self, label: impl Into<String>, line: Line, poses: &'a [StampedPose]) -> Self {
        self.trajectories.push((label.into(), line, poses));
        self
    }

    /// The document as SVG text.
    pub fn to_svg(&self) -> String {
        svg::write(self)
    }

    /// The part of the world that the document shows, before it is widened to fill the page.
    fn visible(&self) -> View {
        self.view.unwrap_or_else(|| {
            View::around(
                self.trajectories.iter().map(|(_, _, poses)| *poses),
                self.clusters.unwrap_or_default(),
                self.points.as_ref().map(|(_, points)| *points),
            )
        })
    }
}

/// A rectangle of the world, axis-parallel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Lower left corner, in metres.
    pub min: Point2<f64>,
    /// Upper right corner, in metres.
    pub max: Point2<f64>,
}

impl View {
    /// Least width and height of a view, in metres: a run that has not moved yet still shows a place.
    const LEAST: f64 = 4.0;
    /// Margin, as a share of the longer side.
    const MARGIN: f64 = 0.04;

    /// What holds some trajectories and clusters, with a margin. Without clusters it also holds all points but
    /// the outermost of each side, which are rays that left the building; with clusters the points have no say.
    pub fn around<'a>(
        trajectories: impl IntoIterator<Item = &'a [StampedPose]>,
        clusters: &[Cluster],
        points: Option<&PointRaster>,
    ) -> Self {
        let mut corners: Vec<Point2<f64>> = Vec::new();
        corners.extend(trajectories.into_iter().flatten().map(|stamped| stamped.pose.position()));
        corners.extend(clusters.iter().flat_map(Cluster::endpoints));
        if clusters.is_empty() {
            corners.extend(points.and_then(PointRaster::extent).into_iter().flat_map(|view| [view.min, view.max]));
        }
        Self::of(corners)
    }

    /// What holds some points, with a margin.
    fn of(corners: impl IntoIterator<Item = Point2<f64>>) -> Self {
        let mut corners = corners.into_iter().filter(|&point| is_drawable(point));
        let first = corners.next().unwrap_or_default();
        let tight = corners.fold(Self { min: first, max: first }, |view, corner| Self {
            min: view.min.inf(&corner),
            max: view.max.sup(&corner),
        });
        let size = tight.size();
        let margin = Self::MARGIN * size.x.max(size.y);
        tight.widened(Vector2::new(size.x + 2.0 * margin, size.y + 2.0 * margin).sup(&Vector2::repeat(Self::LEAST)))
    }

    /// Width and height, in metres.
    pub fn size(&self) -> Vector2<f64> {
        self.max - self.min
    }

    /// The view of another size about the same centre.
    fn widened(&self, size: Vector2<f64>) -> Self {
        let centre = nalgebra::center(&self.min, &self.max);
        Self { min: centre - size * 0.5, max: centre + size * 0.5 }
    }
}

/// Whether a point has a place in a picture.
fn is_drawable(point: Point2<f64>) -> bool {
    point.coords.amax() < FARTHEST && point.iter().all(|v| v.is_finite())
}
