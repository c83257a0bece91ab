//! What charts are drawn on: codes of 8 bits.

use std::convert::Infallible;

use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::text::{Alignment, Baseline, Text, TextStyleBuilder};

use super::super::Texels;

/// Black.
pub const BLACK: Rgb888 = Rgb888::BLACK;
/// White.
pub const WHITE: Rgb888 = Rgb888::WHITE;
/// Half of the codes.
pub const GREY: Rgb888 = Rgb888::new(128, 128, 128);

/// A picture of codes.
pub struct Sheet {
    size: (usize, usize),
    codes: Vec<Rgb888>,
}

impl Sheet {
    /// All black.
    pub fn new(size: (usize, usize)) -> Self {
        Self { size, codes: vec![BLACK; size.0 * size.1] }
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// A pixel; what is outside is left out.
    pub fn put(&mut self, (x, y): (i64, i64), colour: Rgb888) {
        if let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y))
            && x < self.size.0
            && y < self.size.1
        {
            self.codes[y * self.size.0 + x] = colour;
        }
    }

    /// A rectangle, filled: left, top, columns, rows.
    pub fn fill(&mut self, [x, y, width, height]: [i64; 4], colour: Rgb888) {
        for at in (y..y + height).flat_map(|y| (x..x + width).map(move |x| (x, y))) {
            self.put(at, colour);
        }
    }

    /// Words about a place.
    pub fn text(&mut self, (x, y): (i64, i64), words: &str, font: &MonoFont<'_>, colour: Rgb888) {
        let style = TextStyleBuilder::new().alignment(Alignment::Center).baseline(Baseline::Middle).build();
        let at = Point::new(i32::try_from(x).unwrap_or(0), i32::try_from(y).unwrap_or(0));
        let Ok(_) = Text::with_text_style(words, at, MonoTextStyle::new(font, colour), style).draw(self);
    }

    /// Codes up to `white`.
    pub fn into_texels(self, white: u16) -> Texels {
        let code = |code: u8| ((u32::from(code) * u32::from(white) + 127) / 255) as u16;
        let codes = self.codes.iter().map(|c| [code(c.r()), code(c.g()), code(c.b())]).collect();
        Texels { columns: self.size.0, rows: self.size.1, white, codes }
    }
}

impl OriginDimensions for Sheet {
    fn size(&self) -> Size {
        let side = |v: usize| u32::try_from(v).unwrap_or(u32::MAX);
        Size::new(side(self.size.0), side(self.size.1))
    }
}

impl DrawTarget for Sheet {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        pixels.into_iter().for_each(|Pixel(at, colour)| self.put((at.x.into(), at.y.into()), colour));
        Ok(())
    }
}
