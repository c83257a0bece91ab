//! Images: memory of the host, with everything about its layout checked before a byte is touched.

use openfx::sys::generic::core::{
    OfxPropertySetHandle, OfxStatus, kOfxBitDepthByte, kOfxBitDepthFloat, kOfxBitDepthNone,
};
use openfx::sys::image_effect_v1::image_effect::{
    kOfxImageComponentAlpha, kOfxImageComponentRGB, kOfxImageComponentRGBA, kOfxImageEffectPropComponents,
    kOfxImageEffectPropPixelDepth, kOfxImageEffectPropPreMultiplication, kOfxImageOpaque, kOfxImagePropBounds,
    kOfxImagePropData, kOfxImagePropPixelAspectRatio, kOfxImagePropRegionOfDefinition, kOfxImagePropRowBytes,
    kOfxImageUnPreMultiplied,
};

use super::Properties;
use crate::error::{Error, Result};

/// Gives an image back.
type Release = unsafe extern "C" fn(OfxPropertySetHandle) -> OfxStatus;

/// A half-open rectangle, y upwards as in all of OpenFX.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rect<T> {
    /// Left, inside.
    pub x1: T,
    /// Bottom, inside.
    pub y1: T,
    /// Right, outside.
    pub x2: T,
    /// Top, outside.
    pub y2: T,
}

impl Rect<i32> {
    /// Columns.
    pub fn width(&self) -> usize {
        usize::try_from(i64::from(self.x2) - i64::from(self.x1)).unwrap_or(0)
    }

    /// Rows.
    pub fn height(&self) -> usize {
        usize::try_from(i64::from(self.y2) - i64::from(self.y1)).unwrap_or(0)
    }

    /// The part common to both, possibly empty.
    pub fn clipped(&self, other: &Self) -> Self {
        let (x1, y1) = (self.x1.max(other.x1), self.y1.max(other.y1));
        Self { x1, y1, x2: self.x2.min(other.x2).max(x1), y2: self.y2.min(other.y2).max(y1) }
    }

    /// Does all of `other` lie inside?
    pub fn covers(&self, other: &Self) -> bool {
        self.x1 <= other.x1 && self.y1 <= other.y1 && self.x2 >= other.x2 && self.y2 >= other.y2
    }
}

/// How a sample is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// 0 to 255.
    Byte,
    /// f32.
    Float,
}

/// What a pixel holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Components {
    /// Red, green, blue, alpha.
    Rgba,
    /// Red, green, blue.
    Rgb,
    /// Alpha alone.
    Alpha,
}

/// What colour means where alpha is below one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlphaState {
    /// Alpha is one everywhere, whatever is stored.
    Opaque,
    /// Colour has been multiplied by alpha.
    Premultiplied,
    /// Colour has not been multiplied.
    Unpremultiplied,
}

/// How an image lies in memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    /// Pixels in memory, in pixel coordinates at the render scale.
    pub bounds: Rect<i32>,
    /// Pixels that exist at all; the bounds where the host does not say.
    pub region: Rect<i32>,
    /// Does the host say which pixels exist?
    pub region_told: bool,
    /// Bytes from a row to the one above; negative when memory runs downwards.
    pub row_bytes: isize,
    /// Sample depth.
    pub depth: Depth,
    /// Samples of a pixel.
    pub components: Components,
    /// Meaning of colour.
    pub alpha: AlphaState,
    /// Width of a pixel over its height.
    pub aspect: f64,
}

impl Layout {
    /// Bytes of one pixel.
    pub fn pixel_bytes(&self) -> usize {
        let sample = match self.depth {
            Depth::Byte => 1,
            Depth::Float => 4,
        };
        let samples = match self.components {
            Components::Rgba => 4,
            Components::Rgb => 3,
            Components::Alpha => 1,
        };
        sample * samples
    }

    fn read(properties: &Properties<'_>) -> Result<Self> {
        let rect = |name| properties.ints::<4>(name).map(|[x1, y1, x2, y2]| Rect { x1, y1, x2, y2 });
        let bounds = rect(kOfxImagePropBounds).ok_or_else(|| Error::host("gave an image without bounds"))?;
        let row_bytes = properties
            .int(kOfxImagePropRowBytes, 0)
            .ok_or_else(|| Error::host("gave an image without the length of a row"))?;
        let region = rect(kOfxImagePropRegionOfDefinition).filter(|r| r.width() > 0 && r.height() > 0);
        let layout = Self {
            bounds,
            region: region.unwrap_or(bounds),
            region_told: region.is_some(),
            row_bytes: row_bytes as isize,
            depth: depth(properties.string(kOfxImageEffectPropPixelDepth, 0))?,
            components: components(properties.string(kOfxImageEffectPropComponents, 0))?,
            alpha: alpha_state(properties.string(kOfxImageEffectPropPreMultiplication, 0)),
            aspect: properties.double(kOfxImagePropPixelAspectRatio, 0).filter(|a| *a > 0.0).unwrap_or(1.0),
        };
        layout.checked()
    }

    /// Rows must not overlap, and the whole must be addressable.
    fn checked(self) -> Result<Self> {
        let row = self.bounds.width().checked_mul(self.pixel_bytes());
        let fits = row.is_some_and(|row| self.bounds.height() <= 1 || self.row_bytes.unsigned_abs() >= row);
        let addressable = self.row_bytes.checked_mul(self.bounds.height() as isize).is_some();
        if fits && addressable {
            return Ok(self);
        }
        let Rect { x1, y1, x2, y2 } = self.bounds;
        let what =
            format!("gave an image of bounds ({x1}, {y1}) to ({x2}, {y2}) with rows of {} bytes", self.row_bytes);
        Err(Error::host(what))
    }
}

fn depth(name: Option<String>) -> Result<Depth> {
    let name = name.unwrap_or_else(|| kOfxBitDepthNone.to_string_lossy().into_owned());
    match name.as_bytes() {
        n if n == kOfxBitDepthByte.to_bytes() => Ok(Depth::Byte),
        n if n == kOfxBitDepthFloat.to_bytes() => Ok(Depth::Float),
        _ => Err(Error::Host {
            what: format!("gave pixels of depth {name}, which this effect does not read"),
            advice: "use 8-bit or 32-bit float",
        }),
    }
}

fn components(name: Option<String>) -> Result<Components> {
    let name = name.unwrap_or_default();
    match name.as_bytes() {
        n if n == kOfxImageComponentRGBA.to_bytes() => Ok(Components::Rgba),
        n if n == kOfxImageComponentRGB.to_bytes() => Ok(Components::Rgb),
        n if n == kOfxImageComponentAlpha.to_bytes() => Ok(Components::Alpha),
        _ => Err(Error::Host {
            what: format!("gave pixels of components '{name}', which this effect does not read"),
            advice: "use RGBA",
        }),
    }
}

fn alpha_state(name: Option<String>) -> AlphaState {
    match name.as_deref().unwrap_or_default().as_bytes() {
        n if n == kOfxImageOpaque.to_bytes() => AlphaState::Opaque,
        n if n == kOfxImageUnPreMultiplied.to_bytes() => AlphaState::Unpremultiplied,
        _ => AlphaState::Premultiplied,
    }
}

/// An image of the host; dropping it gives it back.
pub struct Image<'a> {
    properties: Properties<'a>,
    release: Release,
    layout: Layout,
    data: *mut u8,
}

/// Gives the handle back even when reading its layout fails.
struct Releaser {
    handle: OfxPropertySetHandle,
    release: Release,
}

impl Drop for Releaser {
    fn drop(&mut self) {
        // SAFETY: the handle came from clipGetImage in this call of the host and is given back exactly once.
        unsafe { (self.release)(self.handle) };
    }
}

impl<'a> Image<'a> {
    /// Takes an image that clipGetImage just gave; `None` when it has no memory.
    pub(super) fn new(properties: Properties<'a>, release: Release) -> Result<Option<Self>> {
        let guard = Releaser { handle: properties.handle(), release };
        let Some(data) = properties.pointer(kOfxImagePropData) else { return Ok(None) };
        let layout = Layout::read(&properties)?;
        std::mem::forget(guard);
        Ok(Some(Self { properties, release, layout, data: data.cast() }))
    }

    /// How it lies in memory.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Start and length in bytes of the pixels `x1 <= x < x2` of row `y`; `None` unless all lie in the bounds.
    fn span(&self, y: i32, x1: i32, x2: i32) -> Option<(*mut u8, usize)> {
        let bounds = &self.layout.bounds;
        if y < bounds.y1 || y >= bounds.y2 || x1 < bounds.x1 || x2 > bounds.x2 || x1 > x2 {
            return None;
        }
        let pixel = self.layout.pixel_bytes();
        let row = (i64::from(y) - i64::from(bounds.y1)) as isize;
        let column = (i64::from(x1) - i64::from(bounds.x1)) as usize;
        let offset = row * self.layout.row_bytes + (column * pixel) as isize;
        let length = (i64::from(x2) - i64::from(x1)) as usize * pixel;
        // SAFETY: the host vouches for every row of the bounds, each `row_bytes` from the next, starting at `data`; the
        // pixel lies in the bounds and `Layout::checked` made sure that the product does not overflow.
        Some((unsafe { self.data.offset(offset) }, length))
    }

    /// Bytes of the pixels `x1 <= x < x2` of row `y` (upwards); `None` unless all lie in the bounds.
    pub fn row(&self, y: i32, x1: i32, x2: i32) -> Option<&[u8]> {
        let (start, length) = self.span(y, x1, x2)?;
        // SAFETY: `span` lies in memory that the host keeps until release, any byte is a valid u8, and nobody writes to
        // it while the borrow lasts: `row_mut` of this image needs it exclusively, and rows are copied out before any
        // other image is written.
        Some(unsafe { std::slice::from_raw_parts(start, length) })
    }

    /// The same bytes, for writing.
    pub fn row_mut(&mut self, y: i32, x1: i32, x2: i32) -> Option<&mut [u8]> {
        let (start, length) = self.span(y, x1, x2)?;
        // SAFETY: as in `row`; the host gave the output image for us alone to write in the render window.
        Some(unsafe { std::slice::from_raw_parts_mut(start, length) })
    }
}

impl Drop for Image<'_> {
    fn drop(&mut self) {
        drop(Releaser { handle: self.properties.handle(), release: self.release });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(bounds: [i32; 4], row_bytes: isize) -> Layout {
        let [x1, y1, x2, y2] = bounds;
        let bounds = Rect { x1, y1, x2, y2 };
        let (depth, components, alpha) = (Depth::Float, Components::Rgba, AlphaState::Premultiplied);
        Layout { bounds, region: bounds, region_told: true, row_bytes, depth, components, alpha, aspect: 1.0 }
    }

    #[test]
    fn rows_that_overlap_are_refused_and_negative_or_padded_ones_are_not() {
        assert!(layout([-5, -5, 5, 5], 160).checked().is_ok());
        assert!(layout([-5, -5, 5, 5], -160).checked().is_ok());
        assert!(layout([0, 0, 10, 10], 176).checked().is_ok());
        assert!(layout([0, 0, 10, 1], 0).checked().is_ok(), "one row needs no stride");
        assert!(layout([0, 0, 10, 10], 159).checked().is_err());
        assert!(layout([0, 0, 10, 10], 0).checked().is_err());
        assert!(layout([i32::MIN, 0, i32::MAX, 2], 16).checked().is_err());
        assert!(layout([10, 10, 0, 0], 16).checked().is_ok(), "an empty image has no rows to overlap");
    }

    #[test]
    fn rectangles_meet() {
        let rect = |x1, y1, x2, y2| Rect { x1, y1, x2, y2 };
        assert_eq!(rect(0, 0, 10, 10).clipped(&rect(-5, 3, 4, 20)), rect(0, 3, 4, 10));
        let apart = rect(0, 0, 4, 4).clipped(&rect(8, 8, 9, 9));
        assert_eq!((apart.width(), apart.height()), (0, 0));
        assert!(rect(0, 0, 4, 4).covers(&rect(1, 1, 4, 4)) && !rect(0, 0, 4, 4).covers(&rect(1, 1, 5, 4)));
        assert_eq!(rect(i32::MIN, 0, i32::MAX, 1).width(), u32::MAX as usize);
    }

    #[test]
    fn depths_and_components_are_named_when_refused() {
        assert!(depth(Some("OfxBitDepthShort".into())).unwrap_err().to_string().contains("OfxBitDepthShort"));
        assert!(components(Some("uk.co.thefoundry.OfxImageComponentMotionVectors".into())).is_err());
        assert!(depth(None).is_err() && components(None).is_err());
    }
}
