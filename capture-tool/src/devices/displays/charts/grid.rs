//! A grid with a border, a cross, circles, corners of four colours and steps of grey.

use embedded_graphics::mono_font::ascii::{FONT_6X10, FONT_10X20};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::primitives::{Circle, PrimitiveStyle};

use super::super::Texels;
use super::sheet::{BLACK, Sheet, WHITE};

const LINES: Rgb888 = Rgb888::new(90, 90, 90);
const CIRCLES: Rgb888 = Rgb888::new(200, 200, 200);
const CROSS: Rgb888 = Rgb888::new(255, 220, 0);
/// Corners, clockwise from the top left: a picture that is mirrored or turned shows them in another order.
const CORNERS: [(&str, Rgb888); 4] = [
    ("TOP LEFT", Rgb888::new(255, 0, 0)),
    ("TOP RIGHT", Rgb888::new(0, 255, 0)),
    ("BOTTOM RIGHT", Rgb888::new(255, 255, 0)),
    ("BOTTOM LEFT", Rgb888::new(0, 90, 255)),
];
/// Steps of grey, black and white among them.
const STEPS: i64 = 11;
/// Words need this much of the shorter side.
const FOR_WORDS: i64 = 400;

/// A line each tenth of the shorter side or so, in steps that are easy to count.
pub fn usual_step(size: (usize, usize)) -> usize {
    let tenth = size.0.min(size.1) / 10;
    [4, 5, 10, 20, 25, 50, 100, 200, 250, 500].into_iter().rev().find(|step| *step <= tenth).unwrap_or(4)
}

/// The chart of an output, a line every so many pixels from the left and the top.
pub fn grid(size: (usize, usize), step: usize, white: u16) -> Texels {
    let mut sheet = Sheet::new(size);
    let (width, height) = (size.0 as i64, size.1 as i64);
    let (step, shorter) = (step.max(1) as i64, width.min(height));
    let wordy = shorter >= FOR_WORDS;
    for x in (0..width).step_by(step as usize) {
        sheet.fill([x, 0, 1, height], LINES);
    }
    for y in (0..height).step_by(step as usize) {
        sheet.fill([0, y, width, 1], LINES);
    }
    circles(&mut sheet);
    greys(&mut sheet, wordy);
    corners(&mut sheet, wordy);
    // The outermost pixels stay black: the border is whole only where nothing is cut off.
    for ring in [[0, 0, width, 1], [0, height - 1, width, 1], [0, 0, 1, height], [width - 1, 0, 1, height]] {
        sheet.fill(ring, BLACK);
    }
    let (across, down) = (width - 2, height - 2);
    for side in [[1, 1, across, 1], [1, height - 2, across, 1], [1, 1, 1, down], [width - 2, 1, 1, down]] {
        sheet.fill(side, WHITE);
    }
    // An even number of pixels has two in the middle.
    let middle = |length: i64| ((length - 1) / 2, 2 - length % 2);
    let ((x, wide), (y, high)) = (middle(width), middle(height));
    let arm = shorter / 12 + 1;
    sheet.fill([x - arm, y, 2 * arm + wide, high], CROSS);
    sheet.fill([x, y - arm, wide, 2 * arm + high], CROSS);
    if wordy {
        numbers(&mut sheet, step);
        label(&mut sheet, y - shorter / 5, &format!("{width} x {height} pixels, a line every {step}"));
    }
    sheet.into_texels(white)
}

/// Words in the middle of a row, on black.
fn label(sheet: &mut Sheet, y: i64, words: &str) {
    let (x, half) = (sheet.size().0 as i64 / 2, words.len() as i64 * 5);
    sheet.fill([x - half - 6, y - 13, 2 * half + 12, 26], BLACK);
    sheet.text((x, y), words, &FONT_10X20, WHITE);
}

/// A large circle about the middle and small ones near the corners: are pixels square all over?
fn circles(sheet: &mut Sheet) {
    let (width, height) = (sheet.size().0 as i32, sheet.size().1 as i32);
    let shorter = width.min(height);
    let (middle, small) = (Point::new((width - 1) / 2, (height - 1) / 2), shorter / 5);
    let (right, bottom) = (width - small / 2 - shorter / 14, height - small / 2 - shorter / 14);
    let (left, top) = (width - 1 - right, height - 1 - bottom);
    let corners = [(left, top), (right, top), (right, bottom), (left, bottom)].map(|(x, y)| (Point::new(x, y), small));
    for (at, across) in [(middle, shorter * 9 / 10)].into_iter().chain(corners) {
        let ring = Circle::with_center(at, across.unsigned_abs()).into_styled(PrimitiveStyle::with_stroke(CIRCLES, 1));
        let Ok(()) = ring.draw(sheet);
    }
}

/// Four colours, each with its name where there is room.
fn corners(sheet: &mut Sheet, wordy: bool) {
    let (width, height) = (sheet.size().0 as i64, sheet.size().1 as i64);
    let side = (width.min(height) / 14).max(4);
    let (right, bottom) = (width - side, height - side);
    for ((words, colour), (x, y)) in CORNERS.into_iter().zip([(0, 0), (right, 0), (right, bottom), (0, bottom)]) {
        sheet.fill([x, y, side, side], colour);
        if wordy {
            let half = words.len() as i64 * 3 + 4;
            let at = (if x == 0 { side + half } else { x - half }, if y == 0 { side / 2 } else { y + side / 2 });
            sheet.fill([at.0 - half, at.1 - 7, 2 * half, 14], BLACK);
            sheet.text(at, words, &FONT_6X10, colour);
        }
    }
}

/// Steps of code from black to white: all of them have to be told apart.
fn greys(sheet: &mut Sheet, wordy: bool) {
    let (width, height) = (sheet.size().0 as i64, sheet.size().1 as i64);
    let (each, high) = (width / 2 / STEPS, height / 12);
    let (left, top) = ((width - each * STEPS) / 2, height * 7 / 10);
    for step in 0..STEPS {
        let code = (step * 255 / (STEPS - 1)) as u8;
        sheet.fill([left + step * each, top, each, high], Rgb888::new(code, code, code));
        if wordy {
            let ink = if step < STEPS / 2 { WHITE } else { BLACK };
            sheet.text((left + step * each + each / 2, top + high / 2), &code.to_string(), &FONT_6X10, ink);
        }
    }
}

/// The pixel of each second line, along the top and the left.
fn numbers(sheet: &mut Sheet, step: i64) {
    let (width, height) = (sheet.size().0 as i64, sheet.size().1 as i64);
    let free = width.min(height) / 14 + 90;
    // Numbers of five figures are 30 pixels wide.
    let each = step * (40 / step + 1);
    let mut number = |at: (i64, i64), value: i64| {
        let words = value.to_string();
        let half = words.len() as i64 * 3 + 2;
        sheet.fill([at.0 - half, at.1 - 6, 2 * half, 12], BLACK);
        sheet.text(at, &words, &FONT_6X10, CIRCLES);
    };
    (1..).map(|n| n * each).take_while(|x| *x < width - free).filter(|x| *x > free).for_each(|x| number((x, 12), x));
    (1..).map(|n| n * each).take_while(|y| *y < height - free).filter(|y| *y > free).for_each(|y| number((20, y), y));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_border_and_corners_are_where_they_belong() {
        for size in [(640, 480), (641, 479), (128, 128), (24, 16)] {
            let step = usual_step(size);
            let chart = grid(size, step, 1023);
            assert_eq!((chart.columns, chart.rows, chart.codes.len()), (size.0, size.1, size.0 * size.1));
            let at = |x: usize, y: usize| chart.codes[y * size.0 + x];
            let (right, bottom) = (size.0 - 1, size.1 - 1);
            for n in 0..size.0.min(size.1) {
                assert_eq!([at(n, 0), at(n, bottom), at(0, n), at(right, n)], [[0; 3]; 4], "the outermost pixels");
            }
            for n in 1..size.0.min(size.1) - 1 {
                assert_eq!([at(n, 1), at(1, n), at(right - 1, n), at(n, bottom - 1)], [[1023; 3]; 4], "the border");
            }
            let white = 1023;
            assert_eq!(at(2, 2), [white, 0, 0], "top left is red");
            assert_eq!(at(right - 2, 2), [0, white, 0], "top right is green");
            assert_eq!(at(right - 2, bottom - 2), [white, white, 0], "bottom right is yellow");
            assert_eq!(at(2, bottom - 2), [0, 361, white], "bottom left is blue");
            // The cross is as far from the left as from the right.
            let yellow: Vec<usize> = (0..size.0).filter(|x| at(*x, (size.1 - 1) / 2) == [white, 883, 0]).collect();
            assert_eq!(yellow[0], right - yellow[yellow.len() - 1], "{size:?}");
        }
        // Lines lie between what lies over them.
        let chart = grid((300, 200), 20, 255);
        let lines = |pixels: &mut dyn Iterator<Item = usize>| pixels.filter(|at| chart.codes[*at] == [90; 3]).count();
        assert!(lines(&mut (20 * 300..21 * 300)) > 150 && lines(&mut (21 * 300..22 * 300)) < 20, "row 20, not 21");
        assert!(lines(&mut (100..60000).step_by(300)) > 100 && lines(&mut (101..60000).step_by(300)) < 20);
        assert_eq!((usual_step((1920, 1080)), usual_step((3, 3))), (100, 4));
    }
}
