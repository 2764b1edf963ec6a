//! Rendering of an SVG document to PNG, with the font that travels in the library.

use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg;

/// Why a picture could not be rendered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PictureError {
    /// The text is no SVG document.
    #[error("the picture cannot be rendered: {0}")]
    Svg(#[from] usvg::Error),
    /// No picture of this size can be held in memory.
    #[error("the picture cannot be rendered {side} pixels long; ask for at least one and fewer than 20,000")]
    Size {
        /// Longer side asked for, in pixels.
        side: u32,
    },
    /// The pixels cannot be written as PNG.
    #[error("the picture cannot be written as PNG: {0}")]
    Png(String),
}

/// Longer sides, in pixels, stay below this, within memory and the renderer's arithmetic.
const MOST_PIXELS: u32 = 20_000;

/// Renders an SVG document on white, its longer side `side` pixels, and returns the bytes of a PNG file.
///
/// # Errors
/// The text is no SVG document, or its picture is too large.
pub fn svg_to_png(svg: &str, side: u32) -> Result<Vec<u8>, PictureError> {
    let mut options = usvg::Options::default();
    // The fallback for whatever family a text asks for: no font of the machine is loaded.
    options.fontdb_mut().load_font_data(epaint_default_fonts::UBUNTU_LIGHT.to_vec());
    let tree = usvg::Tree::from_str(svg, &options)?;
    let size = tree.size();
    let scale = side as f32 / size.width().max(size.height());
    let pixels = |length: f32| (length * scale).round().max(1.0) as u32;
    let mut pixmap = (1..MOST_PIXELS)
        .contains(&side)
        .then(|| Pixmap::new(pixels(size.width()), pixels(size.height())))
        .flatten()
        .ok_or(PictureError::Size { side })?;
    pixmap.fill(Color::WHITE);
    resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixmap.as_mut());
    pixmap.encode_png().map_err(|error| PictureError::Png(error.to_string()))
}
