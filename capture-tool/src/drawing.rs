//! Words and marks in pictures.

use std::convert::Infallible;

use embedded_graphics::mono_font::ascii::FONT_7X13;
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::primitives::{Circle, PrimitiveStyle};
use embedded_graphics::text::{Baseline, Text};
use relume_core::image::{Image, srgb};

/// The one font: bitmap, so that small words stay sharp.
const FONT: MonoFont<'_> = FONT_7X13;
/// Height of a line of text, with room.
pub const LINE: usize = 18;
/// Codes of words and of marks: light grey, and an orange that few objects have.
const WORDS: Rgb888 = Rgb888::new(210, 210, 210);
const MARKS: Rgb888 = Rgb888::new(255, 140, 0);

/// A picture to draw on; colours of marks are sRGB codes, the picture is linear.
pub struct Canvas {
    picture: Image,
}

impl Canvas {
    /// A picture of one linear colour.
    pub fn new(width: usize, height: usize, colour: [f32; 3]) -> Self {
        Self { picture: Image::from_fn(width, height, |_, _| colour) }
    }

    /// What was drawn so far.
    pub fn picture(&self) -> &Image {
        &self.picture
    }

    /// What was drawn.
    pub fn into_picture(self) -> Image {
        self.picture
    }

    /// Columns that a text takes.
    pub fn width_of(text: &str) -> usize {
        text.chars().count() * (FONT.character_size.width + FONT.character_spacing) as usize
    }

    /// Writes a line, its top left corner at a pixel. What the font lacks shows as a question mark.
    pub fn text(&mut self, at: (usize, usize), text: &str) {
        self.styled_text(at, text, WORDS);
    }

    /// Rings a place and numbers it.
    pub fn mark(&mut self, at: (usize, usize), label: &str) {
        let ring = Circle::with_center(point(at), 11).into_styled(PrimitiveStyle::with_stroke(MARKS, 1));
        let Ok(()) = ring.draw(self);
        // To the right, or to the left where there is no room.
        let width = Self::width_of(label);
        let right = at.0 + 8 + width < self.picture.width();
        let x = if right { at.0 + 8 } else { at.0.saturating_sub(8 + width) };
        self.styled_text((x, at.1.saturating_sub(6)), label, MARKS);
    }

    /// Puts `colour(x, y)` of a rectangle at a place; `None` leaves what is there.
    pub fn fill(
        &mut self,
        at: (usize, usize),
        size: (usize, usize),
        colour: impl Fn(usize, usize) -> Option<[f32; 3]>,
    ) {
        for (x, y) in (0..size.1).flat_map(|y| (0..size.0).map(move |x| (x, y))) {
            let (sx, sy) = (at.0 + x, at.1 + y);
            if sx < self.picture.width()
                && sy < self.picture.height()
                && let Some(rgb) = colour(x, y)
            {
                self.picture.pixel_mut(sx, sy).copy_from_slice(&rgb);
            }
        }
    }

    fn styled_text(&mut self, at: (usize, usize), text: &str, colour: Rgb888) {
        let style = MonoTextStyle::new(&FONT, colour);
        let Ok(_) = Text::with_baseline(text, point(at), style, Baseline::Top).draw(self);
    }
}

fn point(at: (usize, usize)) -> Point {
    let coordinate = |v: usize| i32::try_from(v).unwrap_or(i32::MAX / 2);
    Point::new(coordinate(at.0), coordinate(at.1))
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        let side = |v: usize| u32::try_from(v).unwrap_or(u32::MAX);
        Size::new(side(self.picture.width()), side(self.picture.height()))
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        let (width, height) = self.picture.size();
        for Pixel(at, colour) in pixels {
            if let (Ok(x), Ok(y)) = (usize::try_from(at.x), usize::try_from(at.y))
                && x < width
                && y < height
            {
                let linear = [colour.r(), colour.g(), colour.b()].map(|code| srgb::decode(f32::from(code) / 255.0));
                self.picture.pixel_mut(x, y).copy_from_slice(&linear);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_stay_inside_and_change_pixels() {
        let mut canvas = Canvas::new(40, 20, [0.0; 3]);
        canvas.text((30, 4), "ab\u{e9}");
        canvas.mark((39, 19), "12");
        let lit = canvas.into_picture();
        let count = |from: usize, to: usize| {
            (0..20).flat_map(|y| (from..to).map(move |x| (x, y))).filter(|(x, y)| lit.pixel(*x, *y)[0] > 0.1).count()
        };
        assert!(count(30, 40) > 10, "letters at the right");
        assert!(count(10, 28) > 5, "the number of the mark, left of it");
        assert_eq!(count(0, 10), 0);
    }
}
