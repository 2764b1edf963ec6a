//! Many small maps on one sheet, each with text below it.

use super::svg::{hex, is_drawable_cluster, text};
use super::{Line, PictureError, View, is_drawable, svg_to_png};
use crate::geometry::StampedPose;
use crate::ppca::Cluster;
use nalgebra::{Point2, Vector2};

/// Size of a map, from one to the next, and of the sheet's largest side, in pixels.
const MAP: Vector2<f64> = Vector2::new(300.0, 240.0);
const PITCH: Vector2<f64> = Vector2::new(320.0, 320.0);
const LONGEST: f64 = 19_000.0;
const COLUMNS: usize = 6;
/// Poses of a path that lie closer together are joined, in pixels.
const NEAR: f64 = 1.0;
const TEXT: &str = "#1d2430";
const WALL: &str = "#c8312b";

/// A sheet under construction.
#[derive(Clone, Debug, Default)]
pub struct Sheet {
    svg: String,
    count: usize,
}

impl Sheet {
    /// Adds a map, its walls and the path in it, with three lines of text and a frame of this colour. It fills the frame, whatever
    /// its scale.
    pub fn add(&mut self, lines: [&str; 3], frame: [u8; 3], walls: &[Cluster], path: &[StampedPose]) {
        let corner = Vector2::new((self.count % COLUMNS) as f64, (self.count / COLUMNS) as f64).component_mul(&PITCH);
        self.count += 1;
        let view = View::around([path], walls, None);
        let scale = MAP.component_div(&view.size()).min();
        let left = (MAP - view.size() * scale) / 2.0;
        let place = |p: Point2<f64>| left + Vector2::new((p.x - view.min.x) * scale, (view.max.y - p.y) * scale);
        self.svg += &format!("<g transform=\"translate({:.0} {:.0})\">\n", corner.x + 10.0, corner.y + 10.0);
        self.svg += &format!(
            "<rect width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"3\"/>\n",
            MAP.x,
            MAP.y,
            hex(frame)
        );
        for wall in walls.iter().filter(|wall| is_drawable_cluster(wall)) {
            let [a, b] = wall.endpoints().map(place);
            self.svg += &format!(
                "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"{WALL}\"/>\n",
                a.x, a.y, b.x, b.y
            );
        }
        let mut last: Option<Vector2<f64>> = None;
        self.svg += "<polyline points=\"";
        for position in path.iter().map(|pose| pose.pose.position()).filter(|&position| is_drawable(position)) {
            let position = place(position);
            if last.is_none_or(|last| (position - last).norm() >= NEAR) {
                self.svg += &format!("{:.1},{:.1} ", position.x, position.y);
                last = Some(position);
            }
        }
        let colour = hex(Line::ESTIMATE.colour);
        self.svg += &format!("\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"0.8\"/>\n");
        for (line, below) in lines.into_iter().zip(1..) {
            self.svg += &text(0.0, MAP.y + 18.0 * f64::from(below), 15.0, TEXT, line);
        }
        self.svg += "</g>\n";
    }

    /// The sheet as a PNG file.
    ///
    /// # Errors
    /// It cannot be rendered.
    pub fn to_png(&self) -> Result<Vec<u8>, PictureError> {
        let columns = self.count.clamp(1, COLUMNS) as f64;
        let size = Vector2::new(columns, self.count.div_ceil(COLUMNS).max(1) as f64).component_mul(&PITCH);
        let svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0}\" height=\"{1}\" viewBox=\"0 0 {0} {1}\" \
             font-family=\"Ubuntu, Helvetica, Arial, sans-serif\">\n{2}</svg>\n",
            size.x, size.y, self.svg
        );
        svg_to_png(&svg, size.max().min(LONGEST) as u32)
    }
}
