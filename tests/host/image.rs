//! Pictures of tests: what a clip is fed, and what a render returned.

use relume_core::image::Image;

use super::pixels::{Buffer, Components, Depth, Layout, Rect};

/// A picture, RGBA f32, row 0 at the *top*, and how the host is to offer it to the plugin.
#[derive(Debug, Clone, PartialEq)]
pub struct TestImage {
    width: usize,
    height: usize,
    data: Vec<f32>,
    /// Pixel coordinates of its bottom left corner.
    pub origin: (i32, i32),
    /// Offered at this depth.
    pub depth: Depth,
    /// Offered with these components.
    pub components: Components,
    /// Bytes after each row.
    pub padding: usize,
    /// Offered with negative row bytes.
    pub negative_rows: bool,
}

impl TestImage {
    /// A transparent picture; offered as RGBA float, unpadded, at the origin.
    pub fn new(width: usize, height: usize) -> Self {
        Self::from_rgba(width, height, vec![0.0; width * height * 4])
    }

    /// From RGBA samples, `data[(y * width + x) * 4 + c]`, row 0 at the top.
    ///
    /// # Panics
    /// When the number of samples does not fit.
    pub fn from_rgba(width: usize, height: usize, data: Vec<f32>) -> Self {
        assert_eq!(data.len(), width * height * 4, "RGBA samples of a {width} x {height} picture");
        let (depth, components) = (Depth::Float, Components::Rgba);
        Self { width, height, data, origin: (0, 0), depth, components, padding: 0, negative_rows: false }
    }

    /// Each pixel from its column and its row counted from the top.
    pub fn from_fn(width: usize, height: usize, pixel: impl Fn(usize, usize) -> [f32; 4]) -> Self {
        let data = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| pixel(x, y)).collect();
        Self::from_rgba(width, height, data)
    }

    /// A picture of one colour.
    pub fn constant(width: usize, height: usize, rgba: [f32; 4]) -> Self {
        Self::from_fn(width, height, |_, _| rgba)
    }

    /// With its bottom left corner there.
    pub fn at(self, x: i32, y: i32) -> Self {
        Self { origin: (x, y), ..self }
    }

    /// Offered at another depth.
    pub fn depth(self, depth: Depth) -> Self {
        Self { depth, ..self }
    }

    /// Offered with other components.
    pub fn components(self, components: Components) -> Self {
        Self { components, ..self }
    }

    /// Offered with padded rows, the top one first in memory if `negative`.
    pub fn rows(self, padding: usize, negative: bool) -> Self {
        Self { padding, negative_rows: negative, ..self }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The samples, as in [`Self::from_rgba`].
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// A pixel; row 0 at the top.
    ///
    /// # Panics
    /// When outside.
    pub fn pixel(&self, x: usize, y: usize) -> [f32; 4] {
        let at = (y * self.width + x) * 4;
        std::array::from_fn(|c| self.data[at + c])
    }

    /// Where it is, in pixels, y up.
    pub fn bounds(&self) -> Rect {
        let size = |pixels: usize| i32::try_from(pixels).unwrap_or(i32::MAX);
        let (x, y) = self.origin;
        Rect::new(x, y, x + size(self.width), y + size(self.height))
    }

    fn top_down(&self, x: i32, y: i32) -> Option<(usize, usize)> {
        let bounds = self.bounds();
        let inside = bounds.contains(x, y);
        inside.then(|| (usize::try_from(x - bounds.x1).unwrap_or(0), usize::try_from(bounds.y2 - 1 - y).unwrap_or(0)))
    }

    /// The pixel at pixel coordinates (y up); `None` outside.
    pub fn canonical(&self, x: i32, y: i32) -> Option<[f32; 4]> {
        self.top_down(x, y).map(|(x, y)| self.pixel(x, y))
    }

    /// Sets the pixel at pixel coordinates (y up); nothing outside.
    pub fn set_canonical(&mut self, x: i32, y: i32, rgba: [f32; 4]) {
        if let Some((x, y)) = self.top_down(x, y) {
            let at = (y * self.width + x) * 4;
            self.data[at..at + 4].copy_from_slice(&rgba);
        }
    }

    /// Copies another picture in where it belongs, as a host assembles tiles.
    pub fn paste(&mut self, tile: &Self) {
        let Rect { x1, y1, x2, y2 } = tile.bounds();
        for (x, y) in (y1..y2).flat_map(|y| (x1..x2).map(move |x| (x, y))) {
            self.set_canonical(x, y, tile.canonical(x, y).unwrap_or_default());
        }
    }

    /// Largest absolute difference of any sample; infinite when sizes differ or a sample is not a number.
    pub fn largest_difference(&self, other: &Self) -> f32 {
        if (self.width, self.height) != (other.width, other.height) {
            return f32::INFINITY;
        }
        let pairs = self.data.iter().zip(&other.data);
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, |most, d| if d.is_nan() { f32::INFINITY } else { most.max(d) })
    }

    /// Whether every sample is zero.
    pub fn is_clear(&self) -> bool {
        self.data.iter().all(|&sample| sample == 0.0)
    }

    /// The picture at a render scale, by the mean of the pixels whose centres fall into each scaled pixel.
    pub fn scaled(&self, (sx, sy): (f64, f64)) -> Self {
        if (sx, sy) == (1.0, 1.0) {
            return self.clone();
        }
        let from = self.bounds();
        let to = scale_rect([from.x1, from.y1, from.x2, from.y2].map(f64::from), (sx, sy));
        let mut small = Self { data: Vec::new(), ..self.clone() };
        (small.width, small.height, small.origin) = (to.width(), to.height(), (to.x1, to.y1));
        small.data = vec![0.0; small.width * small.height * 4];
        for (x, y) in (to.y1..to.y2).flat_map(|y| (to.x1..to.x2).map(move |x| (x, y))) {
            small.set_canonical(x, y, self.mean_under(x, y, (sx, sy)));
        }
        small
    }

    fn mean_under(&self, x: i32, y: i32, (sx, sy): (f64, f64)) -> [f32; 4] {
        let span = |at: i32, scale: f64, low: i32, high: i32| {
            let first = (f64::from(at) / scale - 0.5).ceil() as i32;
            let last = ((f64::from(at) + 1.0) / scale - 0.5).ceil() as i32;
            let first = first.clamp(low, high - 1);
            first..last.clamp(first + 1, high)
        };
        let bounds = self.bounds();
        let (columns, rows) = (span(x, sx, bounds.x1, bounds.x2), span(y, sy, bounds.y1, bounds.y2));
        let mut sum = [0.0; 4];
        let count = (columns.len() * rows.len()) as f32;
        for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
            let pixel = self.canonical(x, y).unwrap_or_default();
            sum.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += value / count);
        }
        sum
    }

    /// The picture in memory, as a clip offers it.
    pub fn buffer(&self) -> Buffer {
        let (depth, components) = (self.depth, self.components);
        let (padding, negative_rows) = (self.padding, self.negative_rows);
        let buffer = Buffer::new(Layout { bounds: self.bounds(), depth, components, padding, negative_rows });
        let Rect { x1, y1, x2, y2 } = self.bounds();
        for (x, y) in (y1..y2).flat_map(|y| (x1..x2).map(move |x| (x, y))) {
            buffer.set_pixel(x, y, self.canonical(x, y).unwrap_or_default());
        }
        buffer
    }
}

/// A picture of the core, as what a clip is fed; RGB becomes opaque.
impl From<&Image> for TestImage {
    fn from(image: &Image) -> Self {
        let pixels = image.data().chunks_exact(image.channels());
        let rgba = pixels.flat_map(|pixel| [pixel[0], pixel[1], pixel[2], pixel.get(3).copied().unwrap_or(1.0)]);
        Self::from_rgba(image.width(), image.height(), rgba.collect())
    }
}

/// The pixels that a canonical rectangle covers at a render scale, rounded outwards.
pub fn scale_rect([x1, y1, x2, y2]: [f64; 4], (sx, sy): (f64, f64)) -> Rect {
    let (low, high) = (|v: f64| (v + 1e-6).floor() as i32, |v: f64| (v - 1e-6).ceil() as i32);
    Rect::new(low(x1 * sx), low(y1 * sy), high(x2 * sx), high(y2 * sy))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_scale_is_the_mean_of_four() {
        let image = TestImage::from_fn(4, 2, |x, y| [x as f32, y as f32, 1.0, 1.0]).at(2, -2);
        let small = image.scaled((0.5, 0.5));
        assert_eq!((small.width(), small.height(), small.origin), (2, 1, (1, -1)));
        assert_eq!(small.pixel(0, 0), [0.5, 0.5, 1.0, 1.0]);
        assert_eq!(small.pixel(1, 0), [2.5, 0.5, 1.0, 1.0]);
    }
}
