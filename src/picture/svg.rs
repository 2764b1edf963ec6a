//! The SVG document of a picture.
//!
//! Page coordinates are pixels, x right, y down; the world's y points up, and the one place that turns it over is
//! [`Page::place`]. From top to bottom: title, note, legend, map with metres along its left and lower side, scale bar. Groups
//! carry ids (`grid`, `points`, `clusters`, `trajectory-0`, `axes`, `scale-bar`), so that a reader can find and restyle them.

use super::{Line, Picture, Stroke, View, is_drawable};
use crate::geometry::StampedPose;
use crate::ppca::Cluster;
use base64::Engine as _;
use nalgebra::{Point2, Vector2};
use std::fmt::Write as _;

/// White to the right of the map, and to its left, where numbers stand, in pixels.
const BORDER: f64 = 40.0;
const AXIS: f64 = 74.0;
/// Longest and shortest sides of the map, in pixels.
const MOST: Vector2<f64> = Vector2::new(1520.0, 1400.0);
const LEAST: Vector2<f64> = Vector2::new(1020.0, 300.0);
/// Room below the map for numbers and scale bar, in pixels.
const FOOTER: f64 = 96.0;

const AXIS_TEXT: f64 = 18.0;
const TEXT: &str = "#1d2430";
const FAINT_TEXT: &str = "#667080";
const FRAME: &str = "#cfd5dc";
const GRID: &str = "#eceff2";
const CLUSTER: &str = "#c8312b";
const DEVIATION: &str = "#3a0d0b";
/// Points alone, and points as the ground for clusters.
const POINTS: [u8; 3] = [32, 74, 122];
const POINTS_BELOW: [u8; 3] = [125, 160, 196];

/// Size of a page and where the world lies on it.
pub(super) struct Page {
    width: f64,
    height: f64,
    /// Upper left corner and size of the map, in pixels.
    corner: Point2<f64>,
    size: Vector2<f64>,
    view: View,
    /// Pixels per metre.
    pub(super) scale: f64,
}

impl Page {
    fn new(wanted: View, header: f64) -> Self {
        let scale = MOST.component_div(&wanted.size()).min();
        let size = (wanted.size() * scale).sup(&LEAST);
        Self {
            width: AXIS + size.x + BORDER,
            height: header + size.y + FOOTER,
            corner: Point2::new(AXIS, header),
            size,
            view: wanted.widened(size / scale),
            scale,
        }
    }

    /// A point of the world on the page.
    pub(super) fn place(&self, point: Point2<f64>) -> Point2<f64> {
        self.corner + Vector2::new(point.x - self.view.min.x, self.view.max.y - point.y) * self.scale
    }

    /// Multiples of the step that the map shows in x, or in y.
    fn multiples(&self, axis: usize) -> impl Iterator<Item = f64> + use<> {
        let step = self.scale_step();
        let (from, to) = (self.view.min[axis] / step, self.view.max[axis] / step);
        (from.ceil() as i64..=to.floor() as i64).map(move |i| i as f64 * step)
    }

    /// A multiple of the step, with as many digits as the step has.
    fn number(&self, metres: f64) -> String {
        let digits = (-self.scale_step().log10().floor()).max(0.0) as usize;
        format!("{metres:.digits$}")
    }

    /// The longest of 1, 2, 5, 10, .. metres that is at most a fifth of the map's width.
    fn scale_step(&self) -> f64 {
        let most = self.view.size().x / 5.0;
        let decade = 10f64.powf(most.log10().floor());
        [5.0, 2.0].into_iter().map(|v| v * decade).find(|&step| step <= most).unwrap_or(decade)
    }
}

/// Text and swatch of one line of the legend.
pub(super) struct LegendEntry {
    pub(super) label: String,
    /// SVG elements between (0, 0) and (30, 0).
    pub(super) swatch: String,
}

pub(super) fn write(picture: &Picture<'_>) -> String {
    let mut header = 62.0;
    let note = (!picture.note.is_empty()).then(|| {
        header += 32.0;
        header
    });
    // The legend's rows depend on the width, which depends on the view alone.
    let rows = legend_rows(legend(picture), Page::new(picture.visible(), 0.0).size.x);
    let legend_top = header + 34.0;
    header += 34.0 * rows.len() as f64 + 22.0;
    let page = Page::new(picture.visible(), header);

    let mut svg = String::new();
    let (width, height) = (page.width, page.height);
    svg += &format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.1} {height:.1}\" width=\"{width:.1}\" \
         height=\"{height:.1}\" font-family=\"Ubuntu, Helvetica, Arial, sans-serif\">\n"
    );
    let (x, y, w, h) = (page.corner.x, page.corner.y, page.size.x, page.size.y);
    let rectangle = format!("x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\"");
    svg += &format!("<defs><clipPath id=\"map\"><rect {rectangle}/></clipPath></defs>\n");
    svg += &format!("<rect width=\"{width:.1}\" height=\"{height:.1}\" fill=\"#ffffff\"/>\n");
    svg += &text(x, 58.0, 32.0, TEXT, &picture.title);
    if let Some(y) = note {
        svg += &text(x, y, 21.0, FAINT_TEXT, &picture.note);
    }
    for (i, row) in rows.iter().enumerate() {
        svg += &legend_row(row, x, legend_top + 34.0 * i as f64);
    }
    svg += "<g clip-path=\"url(#map)\">\n";
    svg += &grid(&page);
    svg += &points(picture, &page);
    svg += &clusters(picture, &page);
    // The first trajectory is the one the picture is about: it lies on top.
    for (i, (_, line, poses)) in picture.trajectories.iter().enumerate().rev() {
        svg += &trajectory(i, *line, poses, &page);
    }
    svg += &picture.objects.as_ref().map_or_else(String::new, |objects| objects.draw(&page));
    svg += "</g>\n";
    svg += &format!("<rect {rectangle} fill=\"none\" stroke=\"{FRAME}\" stroke-width=\"1.5\"/>\n");
    svg += &axes(&page);
    svg += &scale_bar(&page);
    svg += "</svg>\n";
    svg
}

fn grid(page: &Page) -> String {
    let mut svg = format!("<g id=\"grid\" stroke=\"{GRID}\" stroke-width=\"1.2\">\n");
    for x in page.multiples(0) {
        let x = page.place(Point2::new(x, 0.0)).x;
        let (top, bottom) = (page.corner.y, page.corner.y + page.size.y);
        svg += &format!("<line x1=\"{x:.1}\" y1=\"{top:.1}\" x2=\"{x:.1}\" y2=\"{bottom:.1}\"/>\n");
    }
    for y in page.multiples(1) {
        let y = page.place(Point2::new(0.0, y)).y;
        let (left, right) = (page.corner.x, page.corner.x + page.size.x);
        svg += &format!("<line x1=\"{left:.1}\" y1=\"{y:.1}\" x2=\"{right:.1}\" y2=\"{y:.1}\"/>\n");
    }
    svg + "</g>\n"
}

/// Metres at the lines of the grid, x below the map and y to its left.
fn axes(page: &Page) -> String {
    let (left, bottom) = (page.corner.x, page.corner.y + page.size.y);
    let mut svg = "<g id=\"axes\" text-anchor=\"middle\">\n".to_owned();
    for x in page.multiples(0) {
        let place = page.place(Point2::new(x, 0.0)).x;
        // A number at the edge would be cut.
        if place < left + page.size.x - 60.0 {
            svg += &text(place, bottom + 24.0, AXIS_TEXT, FAINT_TEXT, &page.number(x));
        }
    }
    svg += &text(left + page.size.x - 24.0, bottom + 24.0, AXIS_TEXT, FAINT_TEXT, "x [m]");
    svg += "</g>\n<g text-anchor=\"end\">\n";
    for y in page.multiples(1) {
        let place = page.place(Point2::new(0.0, y)).y;
        if place > page.corner.y + 36.0 {
            svg += &text(left - 8.0, place + 6.0, AXIS_TEXT, FAINT_TEXT, &page.number(y));
        }
    }
    svg += &text(left - 8.0, page.corner.y + 16.0, AXIS_TEXT, FAINT_TEXT, "y [m]");
    svg + "</g>\n"
}

fn points_colour(picture: &Picture<'_>) -> [u8; 3] {
    if picture.clusters.is_some() { POINTS_BELOW } else { POINTS }
}

fn points(picture: &Picture<'_>, page: &Page) -> String {
    let image = picture.points.as_ref().and_then(|(_, raster)| raster.image(&page.view, points_colour(picture)));
    let Some(image) = image else { return String::new() };
    let corner = page.place(Point2::new(image.view.min.x, image.view.max.y));
    let size = image.view.size() * page.scale;
    format!(
        "<image id=\"points\" x=\"{:.2}\" y=\"{:.2}\" width=\"{:.2}\" height=\"{:.2}\" preserveAspectRatio=\"none\" \
         href=\"data:image/png;base64,{}\"/>\n",
        corner.x,
        corner.y,
        size.x,
        size.y,
        base64::engine::general_purpose::STANDARD.encode(image.png)
    )
}

pub(super) fn is_drawable_cluster(cluster: &Cluster) -> bool {
    is_drawable(cluster.mean)
        && is_drawable(cluster.direction.into())
        && [cluster.along_variance, cluster.across_variance]
            .iter()
            .all(|&variance| (0.0..super::FARTHEST).contains(&variance))
}

fn clusters(picture: &Picture<'_>, page: &Page) -> String {
    let clusters = picture.clusters.unwrap_or_default();
    let drawable = || clusters.iter().filter(|cluster| is_drawable_cluster(cluster));
    let mut svg = format!("<g id=\"clusters\" stroke=\"{CLUSTER}\" stroke-linecap=\"round\" stroke-width=\"3\">\n");
    for cluster in drawable() {
        let [a, b] = cluster.endpoints().map(|end| page.place(end));
        svg += &format!("<line x1=\"{:.2}\" y1=\"{:.2}\" x2=\"{:.2}\" y2=\"{:.2}\"/>\n", a.x, a.y, b.x, b.y);
    }
    svg += "</g>\n";
    if !picture.deviations {
        return svg;
    }
    svg += &format!("<g id=\"deviations\" stroke=\"{DEVIATION}\" stroke-width=\"1.2\" fill=\"none\">\n");
    for cluster in drawable() {
        let centre = page.place(cluster.mean);
        let (x, y) = (centre.x, centre.y);
        let (along, across) = (cluster.along_variance.sqrt() * page.scale, cluster.across_variance.sqrt() * page.scale);
        let degrees = -cluster.direction.y.atan2(cluster.direction.x).to_degrees();
        svg += &format!(
            "<ellipse cx=\"{x:.2}\" cy=\"{y:.2}\" rx=\"{along:.2}\" ry=\"{across:.2}\" \
             transform=\"rotate({degrees:.2} {x:.2} {y:.2})\"/>\n"
        );
    }
    svg + "</g>\n"
}

fn trajectory(index: usize, line: Line, poses: &[StampedPose], page: &Page) -> String {
    let placed: Vec<Option<Point2<f64>>> = poses
        .iter()
        .map(|stamped| stamped.pose.position())
        .map(|position| is_drawable(position).then(|| page.place(position)))
        .collect();
    let mut path = String::new();
    for run in placed.split(Option::is_none) {
        let run: Vec<Point2<f64>> = run.iter().flatten().copied().collect();
        for (i, point) in simplified(&run, 0.35).into_iter().enumerate() {
            // Writing to a string does not fail.
            let _ = write!(path, "{}{:.1} {:.1}", if i == 0 { "M" } else { "L" }, point.x, point.y);
        }
    }
    let colour = hex(line.colour);
    let mut svg = format!("<g id=\"trajectory-{index}\" stroke=\"{colour}\" stroke-width=\"2.4\" fill=\"none\">\n");
    svg += &format!("<path d=\"{path}\" stroke-linejoin=\"round\"{}/>\n", dashes(line));
    // What lies between has its ends where the estimate has them.
    let mut ends = placed.iter().flatten().filter(|_| line.stroke != Stroke::Dotted);
    if let Some(start) = ends.next() {
        svg += &format!(
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"7\" fill=\"#ffffff\" stroke-width=\"3\"/>\n",
            start.x, start.y
        );
    }
    if let Some(end) = ends.next_back() {
        svg += &format!(
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"6.5\" fill=\"{colour}\" stroke=\"#ffffff\" stroke-width=\"1.5\"/>\n",
            end.x, end.y
        );
    }
    svg + "</g>\n"
}

/// A line with fewer points that is nowhere farther than `tolerance` from the given one (Ramer, Douglas and Peucker).
fn simplified(points: &[Point2<f64>], tolerance: f64) -> Vec<Point2<f64>> {
    let Some(last) = points.len().checked_sub(1) else { return Vec::new() };
    let mut keep = vec![false; points.len()];
    (keep[0], keep[last]) = (true, true);
    let mut open = vec![(0, last)];
    while let Some((from, to)) = open.pop() {
        let distance = |i: usize| distance_to_segment(points[i], points[from], points[to]);
        let farthest = (from + 1..to).max_by(|&a, &b| distance(a).total_cmp(&distance(b)));
        if let Some(middle) = farthest.filter(|&middle| distance(middle) > tolerance) {
            keep[middle] = true;
            open.extend([(from, middle), (middle, to)]);
        }
    }
    points.iter().zip(keep).filter_map(|(point, keep)| keep.then_some(*point)).collect()
}

fn distance_to_segment(point: Point2<f64>, a: Point2<f64>, b: Point2<f64>) -> f64 {
    let (along, offset) = (b - a, point - a);
    let share = if along == Vector2::zeros() { 0.0 } else { offset.dot(&along) / along.norm_squared() };
    (offset - along * share.clamp(0.0, 1.0)).norm()
}

fn scale_bar(page: &Page) -> String {
    let step = page.scale_step();
    let (left, y) = (page.corner.x, page.corner.y + page.size.y + 60.0);
    let right = left + step * page.scale;
    let path = format!(
        "M{left:.2} {:.1}V{:.1}M{left:.2} {y:.1}H{right:.2}M{right:.2} {:.1}V{:.1}",
        y - 7.0,
        y + 7.0,
        y - 7.0,
        y + 7.0
    );
    format!(
        "<g id=\"scale-bar\">\n<path d=\"{path}\" stroke=\"{TEXT}\" stroke-width=\"2.4\" fill=\"none\"/>\n{}</g>\n",
        text(right + 16.0, y + 7.0, 21.0, TEXT, &format!("{step} m"))
    )
}

fn legend(picture: &Picture<'_>) -> Vec<LegendEntry> {
    let stroke = |line: Line| {
        let colour = hex(line.colour);
        format!("<path d=\"M0 0H30\" stroke=\"{colour}\" stroke-width=\"2.6\"{}/>", dashes(line))
    };
    let mut entries: Vec<LegendEntry> = picture
        .trajectories
        .iter()
        .map(|(label, line, _)| LegendEntry { label: label.clone(), swatch: stroke(*line) })
        .collect();
    if picture.clusters.is_some() {
        let wall = format!("<path d=\"M0 0H30\" stroke=\"{CLUSTER}\" stroke-width=\"3\" stroke-linecap=\"round\"/>");
        entries.push(LegendEntry { label: "walls (clusters)".to_owned(), swatch: wall });
    }
    if picture.deviations {
        let ellipse = format!(
            "<ellipse cx=\"15\" cy=\"0\" rx=\"12\" ry=\"3\" stroke=\"{DEVIATION}\" stroke-width=\"1.2\" fill=\"none\"/>"
        );
        entries.push(LegendEntry { label: "one standard deviation".to_owned(), swatch: ellipse });
    }
    if let Some((label, _)) = &picture.points {
        let colour = hex(points_colour(picture));
        let dots = [(3, -3), (9, 3), (14, -1), (19, 4), (24, -4), (28, 1)]
            .map(|(x, y)| format!("<rect x=\"{x}\" y=\"{y}\" width=\"3.5\" height=\"3.5\" fill=\"{colour}\"/>"));
        entries.push(LegendEntry { label: label.clone(), swatch: dots.concat() });
    }
    entries.extend(picture.objects.iter().flat_map(|objects| objects.legend()));
    if !picture.trajectories.is_empty() {
        let ring =
            format!("<circle cx=\"22\" cy=\"0\" r=\"6\" fill=\"#ffffff\" stroke=\"{TEXT}\" stroke-width=\"2.6\"/>");
        let disc = format!("<circle cx=\"22\" cy=\"0\" r=\"6.5\" fill=\"{TEXT}\"/>");
        entries.push(LegendEntry { label: "start".to_owned(), swatch: ring });
        entries.push(LegendEntry { label: "end".to_owned(), swatch: disc });
    }
    entries
}

/// Width that a legend entry takes, in pixels, from the mean width of the font's letters.
fn entry_width(entry: &LegendEntry) -> f64 {
    40.0 + 9.7 * entry.label.chars().count() as f64 + 28.0
}

fn legend_rows(entries: Vec<LegendEntry>, width: f64) -> Vec<Vec<LegendEntry>> {
    let mut rows: Vec<Vec<LegendEntry>> = Vec::new();
    let mut left = 0.0;
    for entry in entries {
        left -= entry_width(&entry);
        match rows.last_mut().filter(|_| left >= 0.0) {
            Some(row) => row.push(entry),
            None => {
                left = width - entry_width(&entry);
                rows.push(vec![entry]);
            }
        }
    }
    rows
}

fn legend_row(row: &[LegendEntry], mut x: f64, y: f64) -> String {
    let mut svg = String::new();
    for entry in row {
        svg += &format!("<g transform=\"translate({x:.1} {:.1})\" fill=\"none\">{}</g>\n", y - 7.0, entry.swatch);
        svg += &text(x + 40.0, y, 20.0, TEXT, &entry.label);
        x += entry_width(entry);
    }
    svg
}

pub(super) fn text(x: f64, y: f64, size: f64, colour: &str, content: &str) -> String {
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" fill=\"{colour}\">{}</text>\n", escaped(content))
}

/// Text as XML allows it; control characters have no place there.
fn escaped(content: &str) -> String {
    let mut escaped = String::new();
    for character in content.chars().filter(|c| !c.is_control() && !matches!(c, '\u{fffe}' | '\u{ffff}')) {
        match character {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            other => escaped.push(other),
        }
    }
    escaped
}

pub(super) fn hex([red, green, blue]: [u8; 3]) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn dashes(line: Line) -> &'static str {
    match line.stroke {
        Stroke::Solid => "",
        Stroke::Dashed => " stroke-dasharray=\"9 6\"",
        Stroke::Dotted => " stroke-dasharray=\"0 7\" stroke-linecap=\"round\"",
    }
}
