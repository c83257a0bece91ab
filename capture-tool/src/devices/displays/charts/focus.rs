//! Stars and pairs of lines: sharpness, pixel by pixel.

use embedded_graphics::mono_font::ascii::{FONT_5X8, FONT_6X10, FONT_10X20};

use super::super::Texels;
use super::sheet::{BLACK, GREY, Sheet, WHITE};

/// Black and white wedges of a Siemens star, pairs.
const PAIRS: f64 = 36.0;
/// Where a wedge is narrower than this, pixels, the star ends: finer ones would be of the grid of pixels.
const NARROWEST: f64 = 1.0;
/// Widths of lines, pixels.
const WIDTHS: [i64; 3] = [1, 2, 3];
/// Words need this much of the shorter side.
const FOR_WORDS: i64 = 400;

/// The chart of an output.
pub fn focus(size: (usize, usize), white: u16) -> Texels {
    let mut sheet = Sheet::new(size);
    let (width, height) = (size.0 as i64, size.1 as i64);
    sheet.fill([0, 0, width, height], GREY);
    let shorter = width.min(height);
    let (large, small) = (shorter / 4, shorter / 9);
    let edge = small + shorter / 50 + 1;
    let middle = (width / 2, height / 2);
    star(&mut sheet, middle, large);
    for (x, y) in [(edge, edge), (width - edge, edge), (width - edge, height - edge), (edge, height - edge)] {
        star(&mut sheet, (x, y), small);
    }
    // Between the stars: along the sides, and beside the middle.
    // Each third of it holds lines of 1, 2 and 3 pixels in whole pairs.
    let block = (shorter / 7 / 36 * 36).max(36);
    let places = [(middle.0, edge), (middle.0, height - edge), (edge, middle.1), (width - edge, middle.1)];
    for place in places {
        lines(&mut sheet, place, block);
    }
    if shorter >= FOR_WORDS {
        words(&mut sheet, middle, large);
    }
    sheet.into_texels(white)
}

/// A Siemens star: sharp as far in as its wedges can be told apart.
fn star(sheet: &mut Sheet, (x, y): (i64, i64), radius: i64) {
    let inner = PAIRS * 2.0 * NARROWEST / std::f64::consts::TAU;
    for (dx, dy) in (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dx, dy))) {
        // Middles of pixels, so that the star is the same on all sides.
        let (u, v) = (dx as f64 + 0.5, dy as f64 + 0.5);
        let (distance, turn) = (u.hypot(v), v.atan2(u) / std::f64::consts::TAU);
        if distance > radius as f64 || distance < inner {
            continue;
        }
        let lit = (turn * PAIRS).rem_euclid(1.0) < 0.5;
        sheet.put((x + dx, y + dy), if lit { WHITE } else { BLACK });
    }
}

/// Pairs of lines of each width, upright ones and lying ones below, and a board of single pixels.
fn lines(sheet: &mut Sheet, (x, y): (i64, i64), side: i64) {
    let each = side / 3;
    let (left, top) = (x - (each * 4) / 2, y - each);
    for (n, width) in WIDTHS.into_iter().enumerate() {
        let from = left + n as i64 * each;
        for (dx, dy) in (0..each).flat_map(|dy| (0..each).map(move |dx| (dx, dy))) {
            let ink = |along: i64| if along / width % 2 == 0 { WHITE } else { BLACK };
            sheet.put((from + dx, top + dy), ink(dx));
            sheet.put((from + dx, top + each + dy), ink(dy));
        }
    }
    for (dx, dy) in (0..2 * each).flat_map(|dy| (0..each).map(move |dx| (dx, dy))) {
        sheet.put((left + 3 * each + dx, top + dy), if (dx + dy) % 2 == 0 { WHITE } else { BLACK });
    }
}

/// Small letters.
fn words(sheet: &mut Sheet, (x, y): (i64, i64), radius: i64) {
    const WORDS: &str = "The quick brown fox jumps over the lazy dog 0123456789";
    let room = sheet.size().0 as i64;
    let below = y + radius;
    for (n, (font, letter)) in [(&FONT_5X8, 5), (&FONT_6X10, 6), (&FONT_10X20, 10)].into_iter().enumerate() {
        let count = (room * 2 / 3 / letter) as usize;
        let words: String = WORDS.chars().take(count).collect();
        sheet.text((x, below + 14 + 16 * n as i64), words.trim_end(), font, BLACK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stars_are_half_lit_and_lines_as_wide_as_they_say() {
        let size = (900, 700);
        let chart = focus(size, 255);
        let at = |x: i64, y: i64| chart.codes[(y * size.0 as i64 + x) as usize][0];
        assert!(chart.codes.iter().all(|c| c[0] == c[1] && c[1] == c[2]));
        // A ring of the middle star: 72 changes, as many pixels lit as not.
        let ring: Vec<u16> = (0..7200)
            .map(|n| f64::from(n) / 7200.0 * std::f64::consts::TAU)
            .map(|a| at((450.0 + 160.0 * a.cos()).floor() as i64, (350.0 + 160.0 * a.sin()).floor() as i64))
            .collect();
        let lit = ring.iter().filter(|code| **code == 255).count() as f64 / 7200.0;
        assert!((lit - 0.5).abs() < 0.02, "{lit}");
        assert!(ring.iter().all(|code| *code == 0 || *code == 255));
        // Above the middle: lines of 1, 2 and 3 pixels.
        let (edge, each) = (700 / 9 + 700 / 50 + 1, 700 / 7 / 36 * 36 / 3);
        let (left, top) = (450 - each * 2, edge - each);
        for (n, width) in WIDTHS.into_iter().enumerate() {
            let from = left + n as i64 * each;
            let lengths = |code: &dyn Fn(i64) -> u16| {
                let codes: Vec<u16> = (0..each).map(code).collect();
                codes.chunk_by(|a, b| a == b).map(<[u16]>::len).collect::<Vec<_>>()
            };
            assert!(
                lengths(&|d| at(from + d, top + 3)).iter().all(|length| *length as i64 == width),
                "upright {width}"
            );
            assert!(lengths(&|d| at(from + 3, top + each + d)).iter().all(|length| *length as i64 == width), "{width}");
        }
        assert_ne!(at(left + 3 * each, top), at(left + 3 * each + 1, top), "single pixels");
    }

    #[test]
    fn small_outputs_get_a_chart_as_well() {
        for size in [(1, 1), (7, 5), (64, 48)] {
            assert_eq!(focus(size, 255).codes.len(), size.0 * size.1);
        }
    }
}
