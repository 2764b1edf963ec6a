//! The files of a picture, and what all pictures of a path say of it.

use super::{PNG_SIDE, Picture, PictureError, svg_to_png};
use crate::geometry::StampedPose;

/// Names of files and what is in them.
pub type Files = Vec<(&'static str, Vec<u8>)>;

/// The files of a picture.
pub(super) fn drawn(
    (png_name, svg_name, picture): (&'static str, Option<&'static str>, Picture<'_>),
) -> Result<Files, PictureError> {
    let svg = picture.to_svg();
    let png = svg_to_png(&svg, PNG_SIDE)?;
    let svg = svg_name.map(|name| (name, svg.into_bytes()));
    Ok(svg.into_iter().chain([(png_name, png)]).collect())
}

/// Length of the way from pose to pose, in metres; pairs that are not finite are left out.
pub(super) fn path_length(poses: &[StampedPose]) -> f64 {
    let steps = poses.windows(2).map(|pair| (pair[1].pose.position() - pair[0].pose.position()).norm());
    steps.filter(|step| step.is_finite()).sum()
}
