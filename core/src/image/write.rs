//! Writing pictures, whole or not at all.

use std::path::Path;

use super::Image;
use crate::error::Result;

/// What can be chosen when writing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EncodeOptions {
    /// EXR: 16-bit halves in place of 32-bit floats.
    pub half: bool,
}

/// Writes by extension: `.exr`, `.hdr`, `.png` (16-bit sRGB), `.tif` (float), `.jpg`.
///
/// # Errors
/// Unknown extension; folder absent or full.
pub fn write(path: &Path, image: &Image, options: EncodeOptions) -> Result<()> {
    let _ = (path, image, options);
    todo!()
}
