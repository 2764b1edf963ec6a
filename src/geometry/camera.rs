//! How a camera sees points.

use nalgebra::{Matrix2x3, Point2, Point3, Vector3};

/// A camera without distortion. Its frame has x to the right, y down and z ahead, its picture u to the right and v down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// Focal lengths \[pixels\].
    pub focal: [f64; 2],
    /// Where the axis z meets the picture \[pixels\].
    pub centre: [f64; 2],
}

impl Pinhole {
    /// The camera whose picture is the plane z = 1: coordinates in it are tangents of angles.
    pub const NORMALISED: Self = Self { focal: [1.0; 2], centre: [0.0; 2] };

    /// π(q) = (fᵤ x/z + cᵤ, fᵥ y/z + cᵥ), the pixel where a point of the camera's frame is seen, and its derivative by the
    /// point; none where the point is not ahead.
    pub fn project(&self, point: Vector3<f64>) -> Option<(Point2<f64>, Matrix2x3<f64>)> {
        let (x, y, z) = (point.x, point.y, point.z);
        if z > 0.0 {
            let [fu, fv] = self.focal.map(|focal| focal / z);
            let pixel = Point2::new(fu * x + self.centre[0], fv * y + self.centre[1]);
            Some((pixel, Matrix2x3::new(fu, 0.0, -fu * x / z, 0.0, fv, -fv * y / z)))
        } else {
            None
        }
    }

    /// The point of the plane z = 1 that is seen at a pixel.
    pub fn ray(&self, pixel: Point2<f64>) -> Point3<f64> {
        let [x, y] = [0, 1].map(|axis| (pixel[axis] - self.centre[axis]) / self.focal[axis]);
        Point3::new(x, y, 1.0)
    }
}
