//! The window over an output: its pixels, and what lies over it.

use x11rb::connection::{Connection, RequestConnection};
use x11rb::protocol::composite::ConnectionExt as _;
use x11rb::protocol::xproto::{
    AtomEnum, ChangeWindowAttributesAux, ConfigureWindowAux, ConnectionExt as _, CreateGCAux, CreateWindowAux,
    EventMask, ImageFormat, ImageOrder, MapState, PropMode, Rectangle, StackMode, VisualClass, WindowClass,
};
use x11rb::wrapper::ConnectionExt as _;

use super::super::PixelFormat;
use super::link::Link;
use super::outputs::Place;
use crate::devices::Trouble;

/// The bytes of a request before its picture.
const HEAD: usize = 64;

/// A window.
#[derive(Debug)]
pub struct Surface {
    /// Its number.
    pub window: u32,
    /// How its pixels are stored.
    pub format: PixelFormat,
    depth: u8,
    gc: u32,
    place: Place,
    /// The window that compositors draw into, above all others.
    overlay: Option<u32>,
}

impl Surface {
    /// Makes it, and shows nothing yet.
    ///
    /// # Errors
    /// A server whose pixels have fewer bits.
    pub fn new(link: &Link, place: Place, bits: u8) -> Result<Self, Trouble> {
        let (depth, format) = format(link, bits)?;
        let server = &link.server;
        let (window, gc) = (link.told(server.generate_id())?, link.told(server.generate_id())?);
        let root = link.screen().root;
        let events = EventMask::STRUCTURE_NOTIFY | EventMask::KEY_PRESS;
        let looks = CreateWindowAux::new().background_pixel(0).override_redirect(1).event_mask(events);
        let Place { x, y, width, height } = place;
        let class = WindowClass::INPUT_OUTPUT;
        // Depth and visual are the root's own.
        let made = server.create_window(0, window, root, x, y, width, height, 0, class, 0, &looks);
        link.told(link.told(made)?.check())?;
        link.told(server.create_gc(gc, window, &CreateGCAux::new().graphics_exposures(0)))?;
        let mut surface = Self { window, format, depth, gc, place, overlay: None };
        surface.hide_cursor(link)?;
        surface.describe(link)?;
        surface.overlay = overlay(link)?;
        Ok(surface)
    }

    /// Does a compositor draw what windows hold?
    pub fn is_composited(&self) -> bool {
        self.overlay.is_some()
    }

    /// A cursor of one pixel that is not drawn.
    fn hide_cursor(&self, link: &Link) -> Result<(), Trouble> {
        let server = &link.server;
        let id = || link.told(server.generate_id());
        let (dot, pen, cursor) = (id()?, id()?, id()?);
        link.told(server.create_pixmap(1, dot, self.window, 1, 1))?;
        link.told(server.create_gc(pen, dot, &CreateGCAux::new().foreground(0)))?;
        link.told(server.poly_fill_rectangle(dot, pen, &[Rectangle { x: 0, y: 0, width: 1, height: 1 }]))?;
        link.told(server.create_cursor(cursor, dot, dot, 0, 0, 0, 0, 0, 0, 0, 0))?;
        let with = ChangeWindowAttributesAux::new().cursor(cursor);
        link.told(server.change_window_attributes(self.window, &with))?;
        link.told(server.free_gc(pen))?;
        link.told(server.free_pixmap(dot))?;
        Ok(())
    }

    /// Its name, and that compositors should leave it alone.
    fn describe(&self, link: &Link) -> Result<(), Trouble> {
        let (window, mode) = (self.window, PropMode::REPLACE);
        let name = link.server.change_property8(mode, window, AtomEnum::WM_NAME, AtomEnum::STRING, b"relume");
        link.told(name)?;
        let bypass = atom(link, "_NET_WM_BYPASS_COMPOSITOR")?;
        link.told(link.server.change_property32(mode, window, bypass, AtomEnum::CARDINAL, &[1]))?;
        Ok(())
    }

    /// Above all others.
    pub fn raise(&self, link: &Link) -> Result<(), Trouble> {
        let above = ConfigureWindowAux::new().stack_mode(StackMode::ABOVE);
        link.told(link.server.configure_window(self.window, &above))?;
        Ok(())
    }

    /// A picture of the window's size in the server's memory, from its bytes, in requests that the server takes.
    pub fn upload(&self, link: &Link, bytes: &[u8]) -> Result<u32, Trouble> {
        let server = &link.server;
        let Place { width, height, .. } = self.place;
        let pixmap = link.told(server.generate_id())?;
        link.told(server.create_pixmap(self.depth, pixmap, self.window, width, height))?;
        let row_bytes = self.format.row_bytes(usize::from(width)).max(1);
        let rows = (server.maximum_request_bytes().saturating_sub(HEAD) / row_bytes).max(1);
        let mut top = 0;
        for piece in bytes.chunks(rows * row_bytes) {
            let count = (piece.len() / row_bytes) as u16;
            let format = ImageFormat::Z_PIXMAP;
            link.told(server.put_image(format, pixmap, self.gc, width, count, 0, top, 0, self.depth, piece))?;
            top += count as i16;
        }
        Ok(pixmap)
    }

    /// What lies over it, by its name.
    ///
    /// # Errors
    /// A lost connection.
    pub fn cover(&self, link: &Link) -> Result<Option<String>, Trouble> {
        let server = &link.server;
        // Lowest first.
        let tree = link.told(link.told(server.query_tree(link.screen().root))?.reply())?;
        let above = tree.children.iter().skip_while(|child| **child != self.window).skip(1);
        let asked = above.filter(|child| Some(**child) != self.overlay).map(|child| {
            let attributes = link.told(server.get_window_attributes(*child))?;
            Ok((*child, attributes, link.told(server.get_geometry(*child))?))
        });
        for (child, attributes, geometry) in asked.collect::<Result<Vec<_>, Trouble>>()? {
            // Who is gone meanwhile covers nothing.
            let (Ok(attributes), Ok(at)) = (attributes.reply(), geometry.reply()) else { continue };
            let (width, height) = (at.width + 2 * at.border_width, at.height + 2 * at.border_width);
            let seen = attributes.map_state == MapState::VIEWABLE && attributes.class == WindowClass::INPUT_OUTPUT;
            if seen && self.place.meets(&Place { x: at.x, y: at.y, width, height }) {
                return Ok(Some(title(link, child)));
            }
        }
        Ok(None)
    }
}

/// The root window's depth, where it has the bits.
pub(super) fn format(link: &Link, bits: u8) -> Result<(u8, PixelFormat), Trouble> {
    let (setup, screen) = (link.server.setup(), link.screen());
    let depth = screen.root_depth;
    let visuals = screen.allowed_depths.iter().flat_map(|depth| &depth.visuals);
    let visual = visuals.into_iter().find(|visual| visual.visual_id == screen.root_visual);
    let stored = setup.pixmap_formats.iter().find(|format| format.depth == depth);
    let known = visual.filter(|visual| visual.class == VisualClass::TRUE_COLOR).zip(stored);
    let format = known.map(|(visual, stored)| PixelFormat {
        masks: [visual.red_mask, visual.green_mask, visual.blue_mask],
        bits_per_pixel: stored.bits_per_pixel,
        row_bits: stored.scanline_pad,
        big_endian: setup.image_byte_order == ImageOrder::MSB_FIRST,
    });
    let has = format.map_or(0, |format| format.depth());
    match format.filter(|format| format.depth() >= u32::from(bits) && matches!(format.bits_per_pixel, 16 | 24 | 32)) {
        Some(format) => Ok((depth, format)),
        None => Err(Trouble::stop(
            format!(
                "the X server {} runs at depth {depth}, {has} bits a channel, and patterns of {bits} bits were asked for",
                link.name
            ),
            if bits > 8 {
                "start it at depth 30 (DefaultDepth 30 in the Screen section of xorg.conf), or set bits = 8 under [devices] screen"
            } else {
                "start it at depth 24 (DefaultDepth 24 in the Screen section of xorg.conf)"
            },
        )),
    }
}

fn atom(link: &Link, name: &str) -> Result<u32, Trouble> {
    Ok(link.told(link.told(link.server.intern_atom(false, name.as_bytes()))?.reply())?.atom)
}

/// Where a compositor runs, the window that it draws into.
fn overlay(link: &Link) -> Result<Option<u32>, Trouble> {
    let manager = atom(link, "_NET_WM_CM_S0")?;
    let owner = link.told(link.told(link.server.get_selection_owner(manager))?.reply())?.owner;
    if owner == 0 {
        return Ok(None);
    }
    let root = link.screen().root;
    // Without version 0.3 there is none, and then none covers ours.
    let version = link.server.composite_query_version(0, 4).map_err(Into::into).and_then(|cookie| cookie.reply());
    if !version.is_ok_and(|version| (version.major_version, version.minor_version) >= (0, 3)) {
        return Ok(Some(0));
    }
    let overlay = link.told(link.told(link.server.composite_get_overlay_window(root))?.reply())?.overlay_win;
    link.told(link.server.composite_release_overlay_window(root))?;
    Ok(Some(overlay))
}

/// What a window calls itself.
fn title(link: &Link, window: u32) -> String {
    let asked = link.server.get_property(false, window, AtomEnum::WM_NAME, AtomEnum::ANY, 0, 64);
    let name = asked.map_err(Into::into).and_then(|cookie| cookie.reply());
    match name.map(|name| String::from_utf8_lossy(&name.value).trim().to_owned()) {
        Ok(name) if !name.is_empty() => format!("the window \"{name}\""),
        _ => format!("a window without a name ({window:#x})"),
    }
}
