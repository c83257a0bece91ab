//! Reading pictures into linear f32.

use std::path::Path;

use super::Image;
use crate::error::Result;

/// How stored numbers become light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Encoding {
    /// By file type: 8- and 16-bit integer files are sRGB, float files linear.
    #[default]
    Auto,
    /// The sRGB curve (IEC 61966-2-1), whatever the file type.
    Srgb,
    /// Proportional to light, whatever the file type.
    Linear,
}

/// Reads EXR, Radiance HDR, PNG, TIFF or JPEG.
///
/// # Errors
/// Sentences that name file, pixel and channel.
pub fn read(path: &Path, encoding: Encoding) -> Result<Image> {
    let _ = (path, encoding);
    todo!()
}
