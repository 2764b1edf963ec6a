//! Objects in pictures, by a detector that the user brings: a single-shot network (SSD; W. Liu et al., ECCV 2016) as ONNX.
//!
//! Its input is 1 x 3 x N x N, red, green, blue from -1 to 1. Its outputs are boxes, 1 x A x 4, and logits of classes, 1 x A x C,
//! of which the first is the background. A box (y, x, height, width) is relative to its anchor, in units of a tenth of the
//! anchor's size (position) and as logarithm of the ratio in units of a fifth (size). The A anchors are those of SSD's six layers,
//! the coarsest one cell.

use image::RgbImage;
use image::imageops::{FilterType, crop_imm, resize};
use rten::{Dimension, Model, ValueView};
use rten_tensor::NdTensor;
use rten_tensor::prelude::*;
use std::path::{Path, PathBuf};

/// Two boxes whose intersection is this share of their union show one object.
const SAME_OBJECT: f64 = 0.5;
/// A box that comes so near to the edge of what the network saw may be cut off there \[share of the side\].
const EDGE: f64 = 0.01;

/// Why there is no detector, or no detections.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DetectorError {
    /// The network cannot be loaded.
    #[error("{path}: no network as ONNX that can be loaded: {reason}")]
    Load {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The network is no single-shot detector.
    #[error(
        "{path}: {reason}; a detector has one input 1 x 3 x N x N and two outputs, boxes 1 x A x 4 and logits 1 x A x C, of the \
         anchors of SSD (docs/formats.md)"
    )]
    Shape {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The names of the classes cannot be read.
    #[error("{path}: the names of classes cannot be read, a line each, the background first: {reason}")]
    Labels {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The network fails on a picture.
    #[error("the detector fails: {0}")]
    Run(String),
}

/// An object in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectBox {
    /// Number of the class in [`Detector::labels`].
    pub class: usize,
    /// Probability of the class, by the detector.
    pub score: f64,
    /// Left, top, right, bottom \[pixels\]; (0, 0) is the corner of the picture.
    pub edges: [f64; 4],
}

impl ObjectBox {
    /// The middle: u, v \[pixels\].
    pub fn centre(&self) -> [f64; 2] {
        let [left, top, right, bottom] = self.edges;
        [(left + right) / 2.0, (top + bottom) / 2.0]
    }

    /// Its height \[pixels\].
    pub fn height(&self) -> f64 {
        self.edges[3] - self.edges[1]
    }

    /// The intersection with another box, as a share of their union.
    pub fn overlap(&self, other: &Self) -> f64 {
        let area = |[left, top, right, bottom]: [f64; 4]| (right - left).max(0.0) * (bottom - top).max(0.0);
        let ([l, t, r, b], [ol, ot, or, ob]) = (self.edges, other.edges);
        let both = area([l.max(ol), t.max(ot), r.min(or), b.min(ob)]);
        both / (area(self.edges) + area(other.edges) - both).max(f64::MIN_POSITIVE)
    }

    /// Whether it reaches an edge of a picture, so that a part of the object may be outside.
    pub fn is_cut(&self, width: u32, height: u32) -> bool {
        let margin = EDGE * f64::from(width.min(height));
        let [left, top, right, bottom] = self.edges;
        left < margin || top < margin || right > f64::from(width) - margin || bottom > f64::from(height) - margin
    }
}

/// A network and the names of its classes.
pub struct Detector {
    path: PathBuf,
    model: Model,
    labels: Vec<String>,
    /// Of its square input \[pixels\].
    side: u32,
    anchors: Vec<Anchor>,
}

impl Detector {
    /// Loads a network, and the names of its classes, a line each, the background first.
    ///
    /// # Errors
    /// A file cannot be read, or the network is no single-shot detector.
    pub fn load(model: &Path, labels: &Path) -> Result<Self, DetectorError> {
        let path = model.to_owned();
        let load =
            |error: &dyn std::fmt::Display| DetectorError::Load { path: path.clone(), reason: error.to_string() };
        let names = |reason: String| DetectorError::Labels { path: labels.to_owned(), reason };
        let text = std::fs::read_to_string(labels).map_err(|error| names(error.to_string()))?;
        let labels: Vec<String> = text.lines().map(|line| line.trim().to_owned()).collect();
        let bytes = std::fs::read(&path).map_err(|error| load(&error))?;
        let model = Model::load(bytes).map_err(|error| load(&error))?;
        let side = match model.input_shape(0).as_deref() {
            Some(
                &[
                    Dimension::Fixed(1) | Dimension::Symbolic(_),
                    Dimension::Fixed(3),
                    Dimension::Fixed(height),
                    Dimension::Fixed(width),
                ],
            ) if height == width && (32..=4096).contains(&width) => width as u32,
            other => {
                let reason = format!("its input is {other:?}");
                return Err(DetectorError::Shape { path, reason });
            }
        };
        let detector = Self { path, model, labels, side, anchors: anchors(side) };
        // What does not fit shows now, and not after the first picture.
        detector.look(&RgbImage::new(side, side))?;
        Ok(detector)
    }

    /// Names of the classes; the first is the background.
    pub fn labels(&self) -> &[String] {
        &self.labels
    }

    /// All objects of these classes with at least this score. A picture that is not square is cut into squares of which neighbours share
    /// at least half; what is cut off at the edge of a square is left out, as its neighbour sees it whole.
    ///
    /// # Errors
    /// The network fails.
    pub fn detect(&self, picture: &RgbImage, classes: &[usize], least: f64) -> Result<Vec<ObjectBox>, DetectorError> {
        let (width, height) = picture.dimensions();
        let side = width.min(height);
        let mut found = Vec::new();
        for [left, top] in squares(width, height) {
            let square = crop_imm(picture, left, top, side, side).to_image();
            for mut seen in self.look(&square)? {
                if seen.score < least || !classes.contains(&seen.class) {
                    continue;
                }
                let scale = f64::from(side);
                let [x, y] = [left, top].map(f64::from);
                let [l, t, r, b] = seen.edges.map(|edge| edge.clamp(0.0, 1.0));
                let inner = [
                    l < EDGE && left > 0,
                    t < EDGE && top > 0,
                    r > 1.0 - EDGE && left + side < width,
                    b > 1.0 - EDGE && top + side < height,
                ];
                if inner.contains(&true) || r <= l || b <= t {
                    continue;
                }
                seen.edges = [x + scale * l, y + scale * t, x + scale * r, y + scale * b];
                found.push(seen);
            }
        }
        Ok(without_doubles(found))
    }

    /// All boxes of a square picture, each with its likeliest class; edges are shares of the side.
    fn look(&self, square: &RgbImage) -> Result<Vec<ObjectBox>, DetectorError> {
        let side = self.side as usize;
        let picture = resize(square, self.side, self.side, FilterType::Triangle);
        let value = |[_, channel, row, column]: [usize; 4]| {
            f32::from(picture.get_pixel(column as u32, row as u32)[channel]) / 127.5 - 1.0
        };
        let input = NdTensor::<f32, 4>::from_fn([1, 3, side, side], value);
        let (Some(&into), outputs) = (self.model.input_ids().first(), self.model.output_ids()) else {
            return Err(self.shape("it has no input".to_owned()));
        };
        let inputs = vec![(into, ValueView::from(input.view().as_dyn()).into())];
        let found = self.model.run(inputs, outputs, None).map_err(|error| DetectorError::Run(error.to_string()))?;
        let tensors: Vec<NdTensor<f32, 3>> =
            found.into_iter().filter_map(|value| value.into_tensor::<f32>()?.try_into().ok()).collect();
        let (boxes, logits) = match &tensors[..] {
            [boxes, logits] if boxes.shape()[2] == 4 => (boxes, logits),
            [logits, boxes] if boxes.shape()[2] == 4 => (boxes, logits),
            _ => return Err(self.shape("its outputs are others".to_owned())),
        };
        let (count, classes) = (boxes.shape()[1], logits.shape()[2]);
        if count != self.anchors.len() || logits.shape()[1] != count {
            return Err(self.shape(format!("it has {count} boxes where SSD has {}", self.anchors.len())));
        }
        if classes != self.labels.len() {
            let reason = format!("there are {} names for {classes} classes", self.labels.len());
            return Err(self.shape(reason));
        }
        let read = |(place, anchor): (usize, &Anchor)| {
            let logit = |class: &usize| logits[[0, place, *class]];
            let class = (1..classes).max_by(|one, other| logit(one).total_cmp(&logit(other)))?;
            let score = 1.0 / (1.0 + f64::from(-logit(&class)).exp());
            let code = [0, 1, 2, 3].map(|number| f64::from(boxes[[0, place, number]]));
            Some(ObjectBox { class, score, edges: anchor.decode(code) })
                .filter(|seen| seen.edges.iter().all(|edge| edge.is_finite()))
        };
        Ok(self.anchors.iter().enumerate().filter_map(read).collect())
    }

    fn shape(&self, reason: String) -> DetectorError {
        DetectorError::Shape { path: self.path.clone(), reason }
    }
}

/// A box that boxes are relative to; shares of the side.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Anchor {
    centre: [f64; 2],
    size: [f64; 2],
}

impl Anchor {
    /// Left, top, right, bottom of (y, x, height, width) in the network's units.
    fn decode(&self, [y, x, height, width]: [f64; 4]) -> [f64; 4] {
        let centre = [self.centre[0] + x / 10.0 * self.size[0], self.centre[1] + y / 10.0 * self.size[1]];
        let half = [self.size[0] * (width / 5.0).exp() / 2.0, self.size[1] * (height / 5.0).exp() / 2.0];
        [centre[0] - half[0], centre[1] - half[1], centre[0] + half[0], centre[1] + half[1]]
    }
}

/// The anchors of SSD with MobileNet: six layers, the first of cells of 16 pixels, each next of twice as large ones.
fn anchors(side: u32) -> Vec<Anchor> {
    const LAYERS: i32 = 6;
    let scale = |layer: i32| if layer < LAYERS { 0.2 + 0.15 * f64::from(layer) } else { 1.0 };
    let mut anchors = Vec::new();
    let mut cells = side.div_ceil(16);
    for layer in 0..LAYERS {
        let shapes: Vec<(f64, f64)> = match layer {
            0 => vec![(0.1, 1.0), (0.2, 2.0), (0.2, 0.5)],
            _ => {
                let ratios = [1.0, 2.0, 0.5, 3.0, 1.0 / 3.0].map(|ratio| (scale(layer), ratio));
                ratios.into_iter().chain([((scale(layer) * scale(layer + 1)).sqrt(), 1.0)]).collect()
            }
        };
        for (row, column) in (0..cells).flat_map(|row| (0..cells).map(move |column| (row, column))) {
            let centre = [column, row].map(|cell| (f64::from(cell) + 0.5) / f64::from(cells));
            let of_shape =
                |&(scale, ratio): &(f64, f64)| Anchor { centre, size: [scale * ratio.sqrt(), scale / ratio.sqrt()] };
            anchors.extend(shapes.iter().map(of_shape));
        }
        cells = cells.div_ceil(2);
    }
    anchors
}

/// Left and top of squares as high as a picture (or as wide), spread evenly, so that neighbours share at least half.
fn squares(width: u32, height: u32) -> Vec<[u32; 2]> {
    let (side, rest) = (width.min(height), width.abs_diff(height));
    let steps = (2 * rest).div_ceil(side.max(1));
    let start = |step: u32| (u64::from(rest) * u64::from(step) / u64::from(steps.max(1))) as u32;
    (0..=steps).map(|step| if width > height { [start(step), 0] } else { [0, start(step)] }).collect()
}

/// Of boxes that show one object the one with the best score: non-maximum suppression, over all classes, as an object has one.
fn without_doubles(mut found: Vec<ObjectBox>) -> Vec<ObjectBox> {
    found.sort_by(|one, other| other.score.total_cmp(&one.score));
    let mut kept: Vec<ObjectBox> = Vec::new();
    for seen in found {
        if kept.iter().all(|other| other.overlap(&seen) < SAME_OBJECT) {
            kept.push(seen);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(class: usize, score: f64, edges: [f64; 4]) -> ObjectBox {
        ObjectBox { class, score, edges }
    }

    /// SSD with MobileNet has 1917 anchors at 300 pixels: 19² · 3 + (10² + 5² + 3² + 2² + 1) · 6. The first layer's first is a
    /// tenth of the picture in its first cell.
    #[test]
    fn anchors_are_those_of_ssd() {
        let anchors = anchors(300);
        assert_eq!(anchors.len(), 1917);
        assert_eq!(anchors[0], Anchor { centre: [0.5 / 19.0; 2], size: [0.1; 2] });
        let last = anchors[1916];
        assert!(last.centre == [0.5; 2] && (last.size[0] - 0.95_f64.sqrt()).abs() < 1e-12, "{last:?}");
        // Half its size to the right and down, twice as wide, as high.
        let moved = anchors[0].decode([5.0, 5.0, 0.0, 5.0 * 2.0_f64.ln()]);
        let wanted = [0.5 / 19.0 - 0.05, 0.5 / 19.0, 0.5 / 19.0 + 0.15, 0.5 / 19.0 + 0.1];
        assert!(moved.iter().zip(wanted).all(|(edge, wanted)| (edge - wanted).abs() < 1e-12), "{moved:?}");
    }

    #[test]
    fn squares_cover_the_picture_and_share_halves() {
        for (width, height) in [(1226, 370), (640, 480), (300, 300), (480, 1000)] {
            let (side, squares) = (width.min(height), squares(width, height));
            assert_eq!(squares[0], [0, 0]);
            assert_eq!(squares.last().copied(), Some([width - side, height - side]));
            let is_near = |pair: &[[u32; 2]]| (0..2).all(|axis| 2 * (pair[1][axis] - pair[0][axis]) <= side);
            assert!(squares.windows(2).all(is_near), "{squares:?}");
        }
    }

    #[test]
    fn an_object_is_seen_once() {
        let (car, bus) = (seen(1, 0.6, [0.0, 0.0, 10.0, 10.0]), seen(2, 0.9, [1.0, 0.0, 11.0, 10.0]));
        let beside = seen(1, 0.5, [8.0, 0.0, 18.0, 10.0]);
        assert!((car.overlap(&bus) - 90.0 / 110.0).abs() < 1e-12);
        assert_eq!(without_doubles(vec![car, beside, bus]), [bus, beside]);
        assert!(car.is_cut(100, 50) && !seen(1, 0.6, [5.0, 5.0, 60.0, 40.0]).is_cut(100, 50));
    }
}
