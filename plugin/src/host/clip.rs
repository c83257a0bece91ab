//! Clips: where images come from and go to.

use openfx::sys::generic::core::{OfxRectD, kOfxStatOK};
use openfx::sys::image_effect_v1::image_effect::{OfxImageClipHandle, kOfxImageClipPropConnected};

use super::{Image, Properties, Rect, Suites};
use crate::error::Result;

/// A clip of an instance, for the length of one call.
#[derive(Clone, Copy)]
pub struct Clip<'a> {
    suites: &'a Suites,
    handle: OfxImageClipHandle,
    properties: Option<Properties<'a>>,
}

impl<'a> Clip<'a> {
    /// Wraps a handle; `None` for NULL.
    pub(super) fn new(
        suites: &'a Suites,
        handle: OfxImageClipHandle,
        properties: openfx::sys::generic::core::OfxPropertySetHandle,
    ) -> Option<Self> {
        let properties = Properties::new(suites, properties);
        (!handle.is_null()).then_some(Self { suites, handle, properties })
    }

    /// Does the host say that something is plugged in? Hosts exist that say so of everything, so an image can still be
    /// missing; one that says nothing has no input.
    pub fn connected(&self) -> bool {
        self.properties.and_then(|p| p.int(kOfxImageClipPropConnected, 0)).is_some_and(|connected| connected != 0)
    }

    /// The region of definition in canonical coordinates, which can be infinite; `None` when empty or unknown.
    pub fn region(&self, time: f64) -> Option<Rect<f64>> {
        let get = self.suites.effect.clipGetRegionOfDefinition?;
        let mut rect = OfxRectD { x1: 0.0, y1: 0.0, x2: 0.0, y2: 0.0 };
        // SAFETY: the handle is live for this call of the host; the out-pointer is ours.
        let status = unsafe { get(self.handle, time, &mut rect) };
        let rect = Rect { x1: rect.x1, y1: rect.y1, x2: rect.x2, y2: rect.y2 };
        (status == kOfxStatOK && rect.x1 < rect.x2 && rect.y1 < rect.y2).then_some(rect)
    }

    /// The image at a time, or `None` when there is none; it goes back to the host when dropped.
    ///
    /// # Errors
    /// A depth, components or a layout that cannot be read.
    pub fn image(&self, time: f64) -> Result<Option<Image<'a>>> {
        let (Some(get), Some(release)) = (self.suites.effect.clipGetImage, self.suites.effect.clipReleaseImage) else {
            return Ok(None);
        };
        let mut handle = std::ptr::null_mut();
        // SAFETY: as in `region`; a NULL region asks for the region of interest that we declared.
        let status = unsafe { get(self.handle, time, std::ptr::null(), &mut handle) };
        if status != kOfxStatOK {
            return Ok(None);
        }
        Properties::new(self.suites, handle).map_or(Ok(None), |properties| Image::new(properties, release))
    }
}
