//! A keyframe with its features, tracks and objects: figure 1 of semantic SLAM.

use super::png::PictureError;
use super::{class_colour, svg_to_png};
use crate::images::Shown;
use base64::Engine as _;
use image::{ImageFormat, RgbImage};
use std::fmt::Write as _;
use std::io::Cursor;

/// Height of letters, as a share of the picture's height.
const LETTERS: f64 = 0.045;

/// Draws features (green points), their motion since the last keyframe (lines), and objects with class and score (boxes), and
/// returns the bytes of a PNG file as large as the picture. `labels` are the names of the detector's classes.
///
/// # Errors
/// The picture cannot be rendered.
pub fn keyframe_picture(picture: &RgbImage, shown: &Shown, labels: &[String]) -> Result<Vec<u8>, PictureError> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png).map_err(|error| PictureError::Png(error.to_string()))?;
    let data = base64::engine::general_purpose::STANDARD.encode(bytes.into_inner());
    let (width, height) = picture.dimensions();
    let letters = LETTERS * f64::from(height);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         font-family=\"Ubuntu, Helvetica, Arial, sans-serif\">\n\
         <image width=\"{width}\" height=\"{height}\" href=\"data:image/png;base64,{data}\"/>\n"
    );
    // The first pixel's middle is (0.5, 0.5) on the page.
    for (at, before) in &shown.features {
        let (u, v) = (at.x + 0.5, at.y + 0.5);
        let _ = match before {
            Some(before) => writeln!(
                svg,
                "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{u:.1}\" y2=\"{v:.1}\" stroke=\"#ffd23f\"/>\
                 <circle cx=\"{u:.1}\" cy=\"{v:.1}\" r=\"2\" fill=\"#2ad14e\"/>",
                before.x + 0.5,
                before.y + 0.5
            ),
            None => writeln!(svg, "<circle cx=\"{u:.1}\" cy=\"{v:.1}\" r=\"1.5\" fill=\"none\" stroke=\"#2ad14e\"/>"),
        };
    }
    for seen in &shown.boxes {
        let [left, top, right, bottom] = seen.edges;
        let [red, green, blue] = class_colour(seen.class);
        let label = labels.get(seen.class).map_or("", String::as_str);
        let label = label.replace('&', "&amp;").replace('<', "&lt;");
        let _ = writeln!(
            svg,
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"none\" stroke=\"rgb({red},{green},{blue})\" \
             stroke-width=\"3\"/>\
             <text x=\"{left:.1}\" y=\"{:.1}\" font-size=\"{letters:.1}\" fill=\"#ffffff\" stroke=\"#000000\" stroke-width=\"0.4\">{label} \
             {:.2}</text>",
            right - left,
            bottom - top,
            (top - 0.3 * letters).max(letters),
            seen.score
        );
    }
    svg.push_str("</svg>\n");
    svg_to_png(&svg, width.max(height))
}
