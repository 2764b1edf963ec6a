//! Drawing a floor plan: partitions with thickness and doors, pillars, furniture, and the robot's tour through them.

use super::objects::Object;
use super::world::Wall;
use nalgebra::{Point2, Rotation2, Vector2};

/// Thickness of a partition \[m\].
const THICKNESS: f64 = 0.15;
/// Width of a door \[m\].
const DOOR: f64 = 0.96;
/// Length of one straight piece of a curved partition \[m\].
const PIECE: f64 = 0.3;

/// The walls of a building and a way through it. Metres, in the world's frame.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    /// Every surface that the laser can see.
    pub walls: Vec<Wall>,
    /// Way-points of one tour, which ends where it begins, so that it can be driven again.
    pub tour: Vec<Point2<f64>>,
    /// Names of the classes of objects.
    pub classes: Vec<String>,
    /// Objects that a detector can see.
    pub objects: Vec<Object>,
}

/// A gap in a partition.
#[derive(Clone, Copy, Debug)]
pub(super) struct Door {
    /// Distance of the gap's middle from the partition's start \[m\].
    pub at: f64,
    /// Width of the gap \[m\].
    pub width: f64,
    /// Angle of the leaf \[rad\]: 0 closes the gap, positive swings to the left of the partition; `None` without leaf.
    pub leaf: Option<f64>,
}

impl Door {
    /// A door whose leaf stands at an angle, given in degrees.
    pub fn leaf(at: f64, degrees: f64) -> Self {
        Self { at, width: DOOR, leaf: Some(degrees.to_radians()) }
    }

    /// A gap without leaf.
    pub fn opening(at: f64, width: f64) -> Self {
        Self { at, width, leaf: None }
    }
}

impl Plan {
    fn surface(&mut self, a: Point2<f64>, b: Point2<f64>) {
        self.walls.push(Wall { a, b });
    }

    fn outline(&mut self, corners: &[Point2<f64>]) {
        for (index, &corner) in corners.iter().enumerate() {
            self.surface(corner, corners[(index + 1) % corners.len()]);
        }
    }

    /// A partition between two points of its middle line, with doors in the order of their distance from the start.
    ///
    /// It reaches half its thickness beyond both points, so that two that share a point close the corner.
    pub(super) fn partition(&mut self, from: [f64; 2], to: [f64; 2], doors: &[Door]) {
        let (from, to) = (Point2::from(from), Point2::from(to));
        let along = (to - from).normalize();
        let mut start = -THICKNESS / 2.0;
        for door in doors {
            let (left, right) = (door.at - door.width / 2.0, door.at + door.width / 2.0);
            self.solid(from + along * start, from + along * left);
            if let Some(angle) = door.leaf {
                let hinge = from + along * left;
                self.surface(hinge, hinge + Rotation2::new(angle) * along * door.width);
            }
            start = right;
        }
        self.solid(from + along * start, to + along * (THICKNESS / 2.0));
    }

    fn solid(&mut self, from: Point2<f64>, to: Point2<f64>) {
        let along = (to - from).normalize();
        let across = Vector2::new(-along.y, along.x) * (THICKNESS / 2.0);
        self.outline(&[from - across, to - across, to + across, from + across]);
    }

    /// A partition bent along a circle, from one angle to another \[rad\], both faces.
    pub(super) fn bent_partition(&mut self, centre: [f64; 2], radius: f64, from: f64, to: f64) {
        for radius in [radius - THICKNESS / 2.0, radius + THICKNESS / 2.0] {
            self.arc(centre, radius, from, to);
        }
    }

    /// A round pillar, plant or table.
    pub(super) fn round(&mut self, centre: [f64; 2], radius: f64) {
        self.arc(centre, radius, 0.0, std::f64::consts::TAU);
    }

    fn arc(&mut self, centre: [f64; 2], radius: f64, from: f64, to: f64) {
        let pieces = ((to - from).abs() * radius / PIECE).ceil().max(((to - from).abs() * 3.0).ceil());
        let point = |piece: f64| {
            let angle = from + (to - from) * piece / pieces;
            Point2::new(centre[0] + radius * angle.cos(), centre[1] + radius * angle.sin())
        };
        for piece in 0..pieces as usize {
            self.surface(point(piece as f64), point(piece as f64 + 1.0));
        }
    }

    /// A piece of furniture, a rectangle from its lower to its upper corner.
    pub(super) fn furniture(&mut self, lower: [f64; 2], upper: [f64; 2]) {
        self.outline(&[lower.into(), [upper[0], lower[1]].into(), upper.into(), [lower[0], upper[1]].into()]);
    }

    /// Four partitions around a rectangle, without doors.
    pub(super) fn shaft(&mut self, lower: [f64; 2], upper: [f64; 2]) {
        let corners = [lower, [upper[0], lower[1]], upper, [lower[0], upper[1]]];
        for (index, &corner) in corners.iter().enumerate() {
            self.partition(corner, corners[(index + 1) % 4], &[]);
        }
    }

    /// Adds way-points to the tour.
    pub(super) fn go(&mut self, points: &[[f64; 2]]) {
        self.tour.extend(points.iter().map(|&point| Point2::from(point)));
    }
}
