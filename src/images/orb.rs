//! ORB features of a picture (E. Rublee, V. Rabaud, K. Konolige, G. Bradski, "ORB: an efficient alternative to SIFT or
//! SURF", ICCV 2011): corners of a pyramid, each with its direction and 256 comparisons of pixels around it.

use crate::random::{Draw, normals};
use image::GrayImage;
use image::imageops::{FilterType, resize};
use imageproc::corners::{Corner, corners_fast9};
use imageproc::filter::box_filter;
use imageproc::suppress::local_maxima;
use nalgebra::{Point2, Vector2};
use std::cmp::Reverse;

/// Levels of the pyramid, and how much smaller each is than the one below it.
const LEVELS: i32 = 8;
const SCALE: f64 = 1.2;
/// A corner differs so much from nine neighbours in a row \[grey values\]: the noise of a camera stays below.
const THRESHOLD: u8 = 10;
/// Corners are spread evenly over cells of this side \[pixels of the level\].
const CELL: u32 = 32;
/// Radius of the patch that a corner is described by \[pixels of the level\], as in the paper.
const RADIUS: i32 = 15;
/// Pixels that are compared lie around the corner with this standard deviation: a fifth of the patch's side, as in BRIEF.
const SPREAD: f64 = 31.0 / 5.0;
/// What is compared are means over squares of this radius, as in the paper.
const SMOOTHING: u32 = 2;
/// A descriptor reaches no further from its corner, smoothing included \[pixels of the level\].
const MARGIN: u32 = RADIUS as u32 + SMOOTHING + 1;

/// 256 comparisons.
pub type Descriptor = [u64; 4];

/// A corner and what is around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrbFeature {
    /// Where it is \[pixels of the picture\]; (0, 0) is the middle of the first pixel.
    pub pixel: Point2<f64>,
    /// Size of its level's pixels in those of the picture: its place is as coarse.
    pub scale: f64,
    /// From the corner to the centroid of the grey values around it, from the picture's u axis towards its v axis \[rad\].
    pub direction: f64,
    /// What is compared turns with the direction.
    pub descriptor: Descriptor,
}

/// The comparisons of a descriptor.
#[derive(Clone, Debug)]
pub struct Orb {
    /// Pairs of places around the corner.
    pairs: Vec<[Vector2<f64>; 2]>,
}

impl Default for Orb {
    fn default() -> Self {
        Self::new()
    }
}

impl Orb {
    /// The pairs are the same in every run.
    pub fn new() -> Self {
        let draws = (0..).map(|number| normals(0, number, 0, Draw::Picture).map(|normal| SPREAD * f64::from(normal)));
        let pairs = draws.map(|[a, b, c, d]| [Vector2::new(a, b), Vector2::new(c, d)]);
        // Turned in any way, it stays within the patch.
        let is_inside = |pair: &[Vector2<f64>; 2]| pair.iter().all(|place| place.norm() < f64::from(RADIUS));
        Self { pairs: pairs.filter(is_inside).take(256).collect() }
    }

    /// At most `count` features, spread over the picture; of each of its parts the strongest corners.
    pub fn features(&self, picture: &GrayImage, count: usize) -> Vec<OrbFeature> {
        let areas: f64 = (0..LEVELS).map(|level| SCALE.powi(-2 * level)).sum();
        let mut features = Vec::with_capacity(count);
        for level in 0..LEVELS {
            let scale = SCALE.powi(level);
            let [width, height] =
                [picture.width(), picture.height()].map(|side| (f64::from(side) / scale).round() as u32);
            if width.min(height) <= 2 * MARGIN {
                break;
            }
            let share = (count as f64 * SCALE.powi(-2 * level) / areas).round() as usize;
            let level = resize(picture, width, height, FilterType::Triangle);
            // Pixels are squares: their edges lie on each other, not their middles.
            let scales = Vector2::new(picture.width(), picture.height())
                .cast::<f64>()
                .component_div(&Vector2::new(f64::from(width), f64::from(height)));
            let smooth = box_filter(&level, SMOOTHING, SMOOTHING);
            for corner in spread(corners(&level), share) {
                let direction = direction(&level, corner);
                let middle = Vector2::new(f64::from(corner.x) + 0.5, f64::from(corner.y) + 0.5);
                features.push(OrbFeature {
                    pixel: Point2::from(middle.component_mul(&scales) - Vector2::new(0.5, 0.5)),
                    scale,
                    direction,
                    descriptor: self.describe(&smooth, corner, direction),
                });
            }
        }
        features
    }

    /// Bit by bit, whether the first place of a pair is darker than the second.
    fn describe(&self, smooth: &GrayImage, corner: Corner, direction: f64) -> Descriptor {
        let (sin, cos) = direction.sin_cos();
        let grey = |place: Vector2<f64>| {
            let across = (cos * place.x - sin * place.y).round() as i32;
            let down = (sin * place.x + cos * place.y).round() as i32;
            smooth.get_pixel(corner.x.wrapping_add_signed(across), corner.y.wrapping_add_signed(down))[0]
        };
        let mut descriptor = [0; 4];
        for (number, &[one, other]) in self.pairs.iter().enumerate() {
            descriptor[number / 64] |= u64::from(grey(one) < grey(other)) << (number % 64);
        }
        descriptor
    }
}

/// Corners that are stronger than their neighbours and have a whole patch around them.
fn corners(level: &GrayImage) -> Vec<Corner> {
    let (width, height) = level.dimensions();
    let is_inside =
        |corner: &Corner| (MARGIN..width - MARGIN).contains(&corner.x) && (MARGIN..height - MARGIN).contains(&corner.y);
    let mut corners = corners_fast9(level, THRESHOLD);
    corners.retain(is_inside);
    local_maxima(&corners, 2)
}

/// Of each cell the strongest corner, then the second one, and so on.
fn spread(mut corners: Vec<Corner>, count: usize) -> Vec<Corner> {
    let cell = |corner: &Corner| (corner.y / CELL, corner.x / CELL);
    let strength = |corner: &Corner| Reverse(corner.score as u32);
    corners.sort_by_key(|corner| (cell(corner), strength(corner), corner.y, corner.x));
    let mut ranked = Vec::with_capacity(corners.len());
    for of_cell in corners.chunk_by(|one, other| cell(one) == cell(other)) {
        ranked.extend(of_cell.iter().copied().enumerate());
    }
    ranked.sort_by_key(|(rank, corner)| (*rank, strength(corner), corner.y, corner.x));
    ranked.into_iter().take(count).map(|(_, corner)| corner).collect()
}

/// The direction of the patch's centroid.
fn direction(level: &GrayImage, corner: Corner) -> f64 {
    let mut moments = Vector2::zeros();
    for down in -RADIUS..=RADIUS {
        for across in -RADIUS..=RADIUS {
            if across * across + down * down <= RADIUS * RADIUS {
                let place = (corner.x.wrapping_add_signed(across), corner.y.wrapping_add_signed(down));
                moments += Vector2::new(across, down) * i32::from(level.get_pixel(place.0, place.1)[0]);
            }
        }
    }
    f64::from(moments.y).atan2(f64::from(moments.x))
}

/// In how many comparisons two descriptors differ.
pub fn distance(one: &Descriptor, other: &Descriptor) -> u32 {
    one.iter().zip(other).map(|(one, other)| (one ^ other).count_ones()).sum()
}
