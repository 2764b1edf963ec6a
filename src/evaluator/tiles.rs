//! The points of a scan in f32, packed in tiles of neighbours that share candidate lists.

use bytemuck::{Pod, Zeroable};
use nalgebra::{Point2, Vector2};

/// Points in a tile, which share a candidate list.
pub const TILE: usize = 16;

/// Consecutive points of a scan, with the circle around them.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Tile {
    /// Points in the robot's frame \[m\]; the last tile repeats its last point.
    pub x: [f32; TILE],
    /// As `x`.
    pub y: [f32; TILE],
    /// Centre of a circle around them \[m\].
    pub centre: [f32; 2],
    /// Its radius \[m\].
    pub radius: f32,
    /// How many of them count.
    pub count: u32,
}

impl Tile {
    /// The points that count, in the robot's frame \[m\].
    pub fn points(&self) -> impl Iterator<Item = Point2<f64>> + '_ {
        let point = |(&x, &y): (&f32, &f32)| Point2::new(f64::from(x), f64::from(y));
        self.x.iter().zip(&self.y).take(self.count as usize).map(point)
    }

    /// No point of it is further from the robot \[m\].
    pub fn reach(&self) -> f32 {
        self.centre[0].hypot(self.centre[1]) + self.radius
    }
}

/// No point is further from the robot \[m\].
pub fn reach(tiles: &[Tile]) -> f32 {
    tiles.iter().map(Tile::reach).fold(0.0, f32::max)
}

/// Takes at most `max_points` points at a uniform stride and packs them in tiles of [`TILE`].
pub fn tiles(points: &[Point2<f64>], max_points: usize) -> Vec<Tile> {
    let stride = points.len().div_ceil(max_points.max(1)).max(1);
    let used: Vec<Point2<f64>> = points.iter().copied().step_by(stride).collect();
    used.chunks(TILE)
        .map(|chunk| {
            let last = chunk[chunk.len() - 1];
            let at = |lane: usize| chunk.get(lane).copied().unwrap_or(last);
            let low = chunk.iter().fold(last.coords, |low, p| low.inf(&p.coords));
            let high = chunk.iter().fold(last.coords, |high, p| high.sup(&p.coords));
            let centre: Vector2<f64> = 0.5 * (low + high);
            let radius = chunk.iter().map(|p| (p.coords - centre).norm()).fold(0.0, f64::max);
            Tile {
                x: std::array::from_fn(|lane| at(lane).x as f32),
                y: std::array::from_fn(|lane| at(lane).y as f32),
                centre: [centre.x as f32, centre.y as f32],
                // Room for the rounding to f32.
                radius: (radius * (1.0 + 1e-6) + 1e-4) as f32,
                count: chunk.len() as u32,
            }
        })
        .collect()
}
