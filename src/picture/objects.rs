//! A map of objects: classed landmarks with their uncertainty, and what the detector saw of them.
//!
//! Each class has a colour and a shape. Dots are detections, where the path puts them, in the colour of the class that the
//! detector named; a thin line leads from each to the landmark that it shows, the stronger the larger its weight. So a dot
//! of another colour is a wrong label, and a dot without a line is clutter.

use super::files::{Files, drawn, path_length};
use super::svg::{LegendEntry, Page, hex, text};
use super::{Line, Picture, PictureError, View, is_drawable};
use crate::geometry::StampedPose;
use crate::objects::ObjectMap;
use crate::semantic::{Landmark, SemanticMap, World};
use nalgebra::{Point2, Vector2};
use std::collections::HashMap;
use std::fmt::Write as _;

/// Colours of classes that are distinguishable for readers who see red and green alike (M. Okabe, K. Ito, "Color Universal
/// Design", 2008). Further classes have these again, with the next shape.
const COLOURS: [[u8; 3]; 7] =
    [[0, 114, 178], [230, 159, 0], [0, 158, 115], [204, 121, 167], [213, 94, 0], [86, 180, 233], [110, 96, 60]];
/// Half of a marker's size, in pixels.
const MARKER: f64 = 5.5;
/// An ellipse holds the landmark with 95 %: χ² with two degrees of freedom is below 5.99.
const CONFIDENCE: f64 = 5.99;
/// Links are drawn in this number of levels of opacity.
const STRENGTHS: usize = 4;
const LABEL: &str = "#3c4656";

/// What a picture shows of objects.
#[derive(Clone, Debug, Default)]
pub(super) struct Objects<'a> {
    classes: &'a [String],
    landmarks: Vec<Landmark>,
    detections: Vec<Seen>,
    links: Vec<Link>,
}

/// A detection in the world, by the class that the detector named.
#[derive(Clone, Debug)]
struct Seen {
    class: usize,
    at: Point2<f64>,
}

#[derive(Clone, Debug)]
struct Link {
    from: Point2<f64>,
    to: Point2<f64>,
    weight: f64,
}

impl<'a> Objects<'a> {
    fn new<W: World>(recording: &'a W::Recording, map: &SemanticMap<W>) -> Self {
        let sensors = W::sensors(recording);
        let frames = W::frames(recording);
        let mut places: HashMap<(usize, usize), Point2<f64>> = HashMap::new();
        let mut detections = Vec::new();
        for keyframe in &map.keyframes {
            let Some(number) = keyframe.frame else { continue };
            for (detection, seen) in frames.get(number).into_iter().flat_map(|(_, seen)| seen) {
                let position: W::Numbers = W::position(sensors, keyframe.pose, seen).into();
                let at = Point2::from_slice(&position.as_ref()[..2]);
                places.insert((number, *detection), at);
                detections.push(Seen { class: W::label(seen), at });
            }
        }
        let landmarks: Vec<Landmark> = map.landmarks.iter().map(Landmark::from_above).collect();
        let mut links = Vec::new();
        for weight in &map.weights {
            let from = places.get(&(weight.frame, weight.detection));
            if let (Some(from), Some(landmark)) = (from, landmarks.get(weight.landmark)) {
                links.push(Link { from: *from, to: landmark.position, weight: weight.weight });
            }
        }
        Self { classes: W::labels(sensors).0, landmarks, detections, links }
    }

    /// Those of a run of the filter.
    pub(super) fn on_map(map: &'a ObjectMap) -> Self {
        let landmarks = map.landmarks.iter().map(Landmark::from).collect();
        Self { classes: &map.classes, landmarks, ..Self::default() }
    }

    /// Classes of which there is a landmark or a detection.
    fn shown(&self) -> impl Iterator<Item = (usize, &'a String)> {
        let is_shown = |class: usize| {
            self.landmarks.iter().any(|landmark| landmark.class() == class)
                || self.detections.iter().any(|seen| seen.class == class)
        };
        self.classes.iter().enumerate().filter(move |(class, _)| is_shown(*class))
    }

    /// Lines of the legend.
    pub(super) fn legend(&self) -> Vec<LegendEntry> {
        let count = |class| self.landmarks.iter().filter(|landmark| landmark.class() == class).count();
        let entry = |(class, name): (usize, &String)| LegendEntry {
            label: format!("{name} ({})", count(class)),
            swatch: marker(class, Point2::new(22.0, 0.0)),
        };
        let mut entries: Vec<LegendEntry> = self.shown().map(entry).collect();
        let colour = hex(COLOURS[0]);
        let ellipse = format!(
            "<ellipse cx=\"15\" cy=\"0\" rx=\"14\" ry=\"7\" fill=\"{colour}\" fill-opacity=\"0.2\" stroke=\"{colour}\"/>"
        );
        entries.push(LegendEntry { label: "95 % of the position".to_owned(), swatch: ellipse });
        if self.detections.is_empty() {
            return entries;
        }
        let link = format!(
            "<path d=\"M4 0H28\" stroke=\"{LABEL}\" stroke-width=\"1\"/><circle cx=\"4\" cy=\"0\" r=\"2.6\" fill=\"{colour}\"/>"
        );
        entries.push(LegendEntry { label: "detection, by its label, and weight".to_owned(), swatch: link });
        entries
    }

    /// Everything that is seen through the frame of the map.
    pub(super) fn draw(&self, page: &Page) -> String {
        self.draw_links(page) + &self.draw_detections(page) + &self.draw_landmarks(page)
    }

    fn draw_links(&self, page: &Page) -> String {
        let mut svg = format!("<g id=\"weights\" stroke=\"{LABEL}\" stroke-width=\"0.8\" fill=\"none\">\n");
        for strength in 0..STRENGTHS {
            let is_of = |link: &&Link| ((link.weight * STRENGTHS as f64) as usize).min(STRENGTHS - 1) == strength;
            let mut path = String::new();
            let drawable = self.links.iter().filter(|link| is_drawable(link.from) && is_drawable(link.to));
            for link in drawable.filter(is_of) {
                let (from, to) = (page.place(link.from), page.place(link.to));
                // Writing to a string does not fail.
                let _ = write!(path, "M{:.1} {:.1}L{:.1} {:.1}", from.x, from.y, to.x, to.y);
            }
            let opacity = 0.45 * (strength + 1) as f64 / STRENGTHS as f64;
            let _ = writeln!(svg, "<path d=\"{path}\" stroke-opacity=\"{opacity:.2}\"/>");
        }
        svg + "</g>\n"
    }

    fn draw_detections(&self, page: &Page) -> String {
        let mut svg =
            "<g id=\"detections\" stroke-width=\"2.6\" stroke-linecap=\"round\" stroke-opacity=\"0.55\">\n".to_owned();
        for (class, _) in self.shown() {
            let mut path = String::new();
            for seen in self.detections.iter().filter(|seen| seen.class == class && is_drawable(seen.at)) {
                let at = page.place(seen.at);
                let _ = write!(path, "M{:.1} {:.1}h0", at.x, at.y);
            }
            let _ = writeln!(svg, "<path d=\"{path}\" stroke=\"{}\"/>", hex(class_colour(class)));
        }
        svg + "</g>\n"
    }

    fn draw_landmarks(&self, page: &Page) -> String {
        let mut svg = "<g id=\"landmarks\">\n".to_owned();
        for (number, landmark) in
            self.landmarks.iter().enumerate().filter(|(_, landmark)| is_drawable(landmark.position))
        {
            let at = page.place(landmark.position);
            let colour = hex(class_colour(landmark.class()));
            if let Some((radii, degrees)) = ellipse(landmark) {
                let (rx, ry) = (radii.x * page.scale, radii.y * page.scale);
                let _ = writeln!(
                    svg,
                    "<ellipse cx=\"{x:.2}\" cy=\"{y:.2}\" rx=\"{rx:.2}\" ry=\"{ry:.2}\" fill=\"{colour}\" fill-opacity=\"0.2\" \
                     stroke=\"{colour}\" stroke-width=\"1.2\" transform=\"rotate({degrees:.2} {x:.2} {y:.2})\"/>",
                    x = at.x,
                    y = at.y,
                );
            }
            svg += &marker(landmark.class(), at);
            svg += &text(at.x + 9.0, at.y - 8.0, 17.0, LABEL, &number.to_string());
        }
        svg + "</g>\n"
    }

    fn positions(&self) -> impl Iterator<Item = Point2<f64>> {
        self.landmarks.iter().map(|landmark| landmark.position)
    }
}

/// The colour of a class, by its number.
pub fn class_colour(class: usize) -> [u8; 3] {
    COLOURS[class % COLOURS.len()]
}

/// A circle, a square, a triangle or a diamond.
fn marker(class: usize, at: Point2<f64>) -> String {
    let (Point2 { coords }, r) = (at, MARKER);
    let corners: &[[f64; 2]] = match class / COLOURS.len() % 4 {
        0 => &[],
        1 => &[[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]],
        2 => &[[0.0, -1.2], [1.1, 0.8], [-1.1, 0.8]],
        _ => &[[0.0, -1.3], [1.3, 0.0], [0.0, 1.3], [-1.3, 0.0]],
    };
    let style = format!("fill=\"{}\" stroke=\"#ffffff\" stroke-width=\"1.5\"", hex(class_colour(class)));
    if corners.is_empty() {
        return format!("<circle cx=\"{:.2}\" cy=\"{:.2}\" r=\"{r}\" {style}/>\n", coords.x, coords.y);
    }
    let corner = |[x, y]: &[f64; 2]| format!("{:.2},{:.2}", coords.x + r * x, coords.y + r * y);
    let points: Vec<String> = corners.iter().map(corner).collect();
    format!("<polygon points=\"{}\" {style}/>\n", points.join(" "))
}

/// Half axes \[m\] of the ellipse, and the angle of the first one on the page \[degrees\].
fn ellipse(landmark: &Landmark) -> Option<(Vector2<f64>, f64)> {
    // What is not finite has no eigenvalues, and the search for them no end.
    if !landmark.covariance.iter().all(|entry| entry.is_finite()) {
        return None;
    }
    let eigen = landmark.covariance.symmetric_eigen();
    let radii = eigen.eigenvalues.map(|variance| (CONFIDENCE * variance).sqrt());
    let axis = eigen.eigenvectors.column(0);
    let degrees = -axis.y.atan2(axis.x).to_degrees();
    (radii.iter().all(|radius| *radius < super::FARTHEST) && degrees.is_finite()).then_some((radii, degrees))
}

/// `map.svg` and `map.png`: path, landmarks, detections and weights, seen along the axis z; `path` and `reference` are the path
/// and the true one seen so, in the frame of the map, the latter empty where nobody knows.
///
/// # Errors
/// The picture cannot be rendered.
pub fn object_map<W: World>(
    name: &str,
    recording: &W::Recording,
    map: &SemanticMap<W>,
    path: &[StampedPose],
    reference: &[StampedPose],
) -> Result<Files, PictureError> {
    let objects = Objects::new(recording, map);
    let length = path_length(path);
    let note = format!("{} objects from {} detections; path {length:.0} m", map.landmarks.len(), map.detections);
    let on_paths = path.iter().chain(reference).map(|stamped| stamped.pose.position());
    let view = View::of(on_paths.chain(objects.positions()));
    let mut picture = Picture::new(name).note(note).view(view).trajectory("trajectory", Line::ESTIMATE, path);
    if !reference.is_empty() {
        picture = picture.trajectory("true path", Line::REFERENCE, reference);
    }
    picture.objects = Some(objects);
    drawn(("map.png", Some("map.svg"), picture))
}
