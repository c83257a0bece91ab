//! Pixels as hosts hold them: any depth, components, row stride (padded, negative) and origin, inside guard bands.
//!
//! Bounds are in pixels, x to the right and y *up* (row 0 at the bottom), as OpenFX has it; [`TestImage`] is top-down.

use std::alloc::{Layout as Alloc, alloc_zeroed, dealloc, handle_alloc_error};
use std::ffi::CStr;
use std::ptr::NonNull;

use half::f16;

use super::image::TestImage;
use super::ofx::*;

/// How a component of a pixel is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// 8 bits, 255 = 1.
    Byte,
    /// 16 bits, 65535 = 1.
    Short,
    /// IEEE half.
    Half,
    /// IEEE single.
    Float,
}

impl Depth {
    /// The standard's name.
    pub fn name(self) -> &'static CStr {
        match self {
            Self::Byte => kOfxBitDepthByte,
            Self::Short => kOfxBitDepthShort,
            Self::Half => kOfxBitDepthHalf,
            Self::Float => kOfxBitDepthFloat,
        }
    }

    /// Bytes of a component.
    pub fn bytes(self) -> usize {
        match self {
            Self::Byte => 1,
            Self::Short | Self::Half => 2,
            Self::Float => 4,
        }
    }
}

/// What a pixel is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Components {
    /// Red, green, blue, alpha.
    Rgba,
    /// Red, green, blue.
    Rgb,
    /// Alpha alone.
    Alpha,
}

impl Components {
    /// The standard's name.
    pub fn name(self) -> &'static CStr {
        match self {
            Self::Rgba => kOfxImageComponentRGBA,
            Self::Rgb => kOfxImageComponentRGB,
            Self::Alpha => kOfxImageComponentAlpha,
        }
    }

    /// How many.
    pub fn count(self) -> usize {
        match self {
            Self::Rgba => 4,
            Self::Rgb => 3,
            Self::Alpha => 1,
        }
    }
}

/// A rectangle of pixels, half-open, y up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rect {
    /// Left, inside.
    pub x1: i32,
    /// Bottom, inside.
    pub y1: i32,
    /// Right, outside.
    pub x2: i32,
    /// Top, outside.
    pub y2: i32,
}

impl Rect {
    /// From its edges.
    pub fn new(x1: i32, y1: i32, x2: i32, y2: i32) -> Self {
        Self { x1, y1, x2, y2 }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        usize::try_from(self.x2 - self.x1).unwrap_or(0)
    }

    /// Rows.
    pub fn height(&self) -> usize {
        usize::try_from(self.y2 - self.y1).unwrap_or(0)
    }

    /// Is the pixel inside?
    pub fn contains(&self, x: i32, y: i32) -> bool {
        (self.x1..self.x2).contains(&x) && (self.y1..self.y2).contains(&y)
    }

    /// The part common to both; possibly empty.
    pub fn intersect(&self, other: &Self) -> Self {
        let (x1, y1) = (self.x1.max(other.x1), self.y1.max(other.y1));
        Self { x1, y1, x2: self.x2.min(other.x2).max(x1), y2: self.y2.min(other.y2).max(y1) }
    }

    /// Left, bottom, right, top.
    pub fn edges(&self) -> [i32; 4] {
        [self.x1, self.y1, self.x2, self.y2]
    }

    /// Tiles of at most `size` x `size` pixels that cover it.
    pub fn tiles(&self, size: i32) -> Vec<Self> {
        let starts = |from: i32, to: i32| (from..to).step_by(usize::try_from(size.max(1)).unwrap_or(1));
        let tile = |x, y| Self::new(x, y, (x + size).min(self.x2), (y + size).min(self.y2));
        starts(self.y1, self.y2).flat_map(|y| starts(self.x1, self.x2).map(move |x| tile(x, y))).collect()
    }
}

/// How the pixels of a buffer lie in memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    /// Where they are.
    pub bounds: Rect,
    /// Their depth.
    pub depth: Depth,
    /// Their components.
    pub components: Components,
    /// Bytes between the end of a row and the start of the next.
    pub padding: usize,
    /// The top row first in memory.
    pub negative_rows: bool,
}

impl Layout {
    fn pixel_bytes(&self) -> usize {
        self.depth.bytes() * self.components.count()
    }

    fn stride(&self) -> usize {
        self.bounds.width() * self.pixel_bytes() + self.padding
    }
}

/// Bytes before and after the rows that nobody may touch.
const GUARD: usize = 512;

/// A block of pixels whose every byte starts as a canary. Plugins write to it through a raw pointer, from any thread, so
/// it is only ever read through one, too.
pub struct Buffer {
    memory: NonNull<u8>,
    alloc: Alloc,
    /// How the pixels lie.
    pub layout: Layout,
}

// SAFETY: the memory is owned, and accessed through raw pointers only; plugins write while the host waits for them.
unsafe impl Send for Buffer {}
// SAFETY: as above.
unsafe impl Sync for Buffer {}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: allocated in `new` with this layout.
        unsafe { dealloc(self.memory.as_ptr(), self.alloc) };
    }
}

/// What a plugin did to a buffer that it must not do, and what it left undone.
#[derive(Debug, Default)]
pub struct Damage {
    /// Pixels outside the window that changed, and the first of them.
    pub outside: Option<(usize, (i32, i32))>,
    /// Rows whose padding changed.
    pub padding: usize,
    /// Whether the guard bands changed.
    pub overrun: bool,
    /// Pixels in the window still as they were.
    pub unwritten: usize,
}

impl Buffer {
    /// A buffer full of canaries.
    pub fn new(layout: Layout) -> Self {
        let size = 2 * GUARD + layout.stride() * layout.bounds.height();
        let alloc = Alloc::from_size_align(size, 64).expect("test images are small");
        // SAFETY: the size is not zero, for the guards are not.
        let Some(memory) = NonNull::new(unsafe { alloc_zeroed(alloc) }) else { handle_alloc_error(alloc) };
        let buffer = Self { memory, alloc, layout };
        for at in 0..size {
            buffer.write(at, canary(at));
        }
        buffer
    }

    fn write(&self, at: usize, byte: u8) {
        assert!(at < self.alloc.size());
        // SAFETY: inside the allocation; volatile, for a plugin may look on.
        unsafe { self.memory.as_ptr().add(at).write_volatile(byte) };
    }

    fn read(&self, at: usize) -> u8 {
        assert!(at < self.alloc.size());
        // SAFETY: inside the allocation; volatile, for a plugin may have written through its own pointer.
        unsafe { self.memory.as_ptr().add(at).read_volatile() }
    }

    /// A copy of all bytes.
    pub fn snapshot(&self) -> Vec<u8> {
        (0..self.alloc.size()).map(|at| self.read(at)).collect()
    }

    /// Overwrites the rows, so that what reads them after their release shows.
    pub fn poison(&self) {
        (GUARD..self.alloc.size() - GUARD).for_each(|at| self.write(at, 0xff));
    }

    /// Start of the row `up` rows above the bottom.
    fn row(&self, up: usize) -> usize {
        let height = self.layout.bounds.height();
        GUARD + self.layout.stride() * if self.layout.negative_rows { height - 1 - up } else { up }
    }

    /// Address of the pixel (x1, y1), for the property Data.
    pub fn data(&self) -> usize {
        self.memory.as_ptr() as usize + if self.layout.bounds.height() == 0 { GUARD } else { self.row(0) }
    }

    /// The property RowBytes.
    pub fn row_bytes(&self) -> i32 {
        let stride = i32::try_from(self.layout.stride()).unwrap_or(i32::MAX);
        if self.layout.negative_rows { -stride } else { stride }
    }

    fn pixel_at(&self, x: i32, y: i32) -> usize {
        let offset = |value: i32, from: i32| usize::try_from(value - from).expect("inside the bounds");
        self.row(offset(y, self.layout.bounds.y1)) + offset(x, self.layout.bounds.x1) * self.layout.pixel_bytes()
    }

    /// The pixel as RGBA; absent colour is 0, absent alpha 1.
    pub fn pixel(&self, x: i32, y: i32) -> [f32; 4] {
        let start = self.pixel_at(x, y);
        let component = |c: usize| {
            let bytes = |at: usize| self.read(start + c * self.layout.depth.bytes() + at);
            match self.layout.depth {
                Depth::Byte => f32::from(bytes(0)) / 255.0,
                Depth::Short => f32::from(u16::from_ne_bytes([bytes(0), bytes(1)])) / 65535.0,
                Depth::Half => f16::from_ne_bytes([bytes(0), bytes(1)]).to_f32(),
                Depth::Float => f32::from_ne_bytes([bytes(0), bytes(1), bytes(2), bytes(3)]),
            }
        };
        match self.layout.components {
            Components::Rgba => std::array::from_fn(component),
            Components::Rgb => [component(0), component(1), component(2), 1.0],
            Components::Alpha => [0.0, 0.0, 0.0, component(0)],
        }
    }

    /// Stores an RGBA pixel; integers are clamped and rounded.
    pub fn set_pixel(&self, x: i32, y: i32, rgba: [f32; 4]) {
        let start = self.pixel_at(x, y);
        let values = match self.layout.components {
            Components::Rgba => &rgba[..],
            Components::Rgb => &rgba[..3],
            Components::Alpha => &rgba[3..],
        };
        for (c, &value) in values.iter().enumerate() {
            let scaled = |top: f32| (value.clamp(0.0, 1.0) * top).round();
            let bytes = match self.layout.depth {
                Depth::Byte => vec![scaled(255.0) as u8],
                Depth::Short => (scaled(65535.0) as u16).to_ne_bytes().to_vec(),
                Depth::Half => f16::from_f32(value).to_ne_bytes().to_vec(),
                Depth::Float => value.to_ne_bytes().to_vec(),
            };
            let from = start + c * self.layout.depth.bytes();
            bytes.into_iter().enumerate().for_each(|(at, byte)| self.write(from + at, byte));
        }
    }

    /// The pixels of a window as a picture.
    pub fn picture(&self, window: Rect) -> TestImage {
        let mut image = TestImage::new(window.width(), window.height()).at(window.x1, window.y1);
        for y in window.y1..window.y2 {
            for x in window.x1..window.x2 {
                image.set_canonical(x, y, self.pixel(x, y));
            }
        }
        image
    }

    /// What a plugin that was to write `window` did to the canaries.
    pub fn damage(&self, window: Rect) -> Damage {
        let mut damage = Damage::default();
        let bytes = self.layout.pixel_bytes();
        let whole = |from: usize, to: usize| (from..to).all(|at| self.read(at) == canary(at));
        let Rect { x1, y1, x2, y2 } = self.layout.bounds;
        for y in y1..y2 {
            for x in x1..x2 {
                let at = self.pixel_at(x, y);
                match (window.contains(x, y), whole(at, at + bytes)) {
                    (true, true) => damage.unwritten += 1,
                    (false, false) => damage.outside.get_or_insert((0, (x, y))).0 += 1,
                    _ => {}
                }
            }
            let end = self.pixel_at(x1, y) + self.layout.bounds.width() * bytes;
            damage.padding += usize::from(!whole(end, end + self.layout.padding));
        }
        damage.overrun = !whole(0, GUARD) || !whole(self.alloc.size() - GUARD, self.alloc.size());
        damage
    }
}

/// A byte that depends on its place, so that copying pixels about does not look like leaving them alone.
fn canary(at: usize) -> u8 {
    let mixed = (at as u64 ^ 0x5bd1_e995).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed >> 56) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_layout_returns_what_was_stored() {
        for depth in [Depth::Byte, Depth::Short, Depth::Half, Depth::Float] {
            for negative_rows in [false, true] {
                let bounds = Rect::new(-3, 5, 4, 9);
                let layout = Layout { bounds, depth, components: Components::Rgba, padding: 12, negative_rows };
                let buffer = Buffer::new(layout);
                let window = Rect::new(-2, 6, 2, 8);
                assert_eq!(buffer.damage(window).unwritten, 8);
                for (x, y) in [(-2, 6), (1, 7)] {
                    buffer.set_pixel(x, y, [0.0, 1.0, 0.0, 1.0]);
                    assert_eq!(buffer.pixel(x, y), [0.0, 1.0, 0.0, 1.0]);
                }
                let damage = buffer.damage(window);
                assert_eq!((damage.unwritten, damage.outside, damage.padding), (6, None, 0));
                buffer.set_pixel(-3, 5, [0.5; 4]);
                assert_eq!(buffer.damage(window).outside, Some((1, (-3, 5))));
            }
        }
    }
}
