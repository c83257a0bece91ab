//! White balance through a white patch under the projector's white (7.3): "it is not possible to directly observe the emitted white
//! from the projector", so the patch is photographed under all squares, black subtracted, and what it shows is white.
//!
//! The photograph is light of any unit, so what is dark and what is clipped is told by the rest of it.

use crate::error::{Error, Result};
use crate::image::{Image, Window};

use super::white::{Correction, patch_of_light, white};

/// A patch is dark below this share of the brightest parts: a projector has a contrast of 1:300, and black is noise.
const DARK: f32 = 0.01;
/// The brightest parts: this share of the samples are brighter.
const BRIGHTEST: f64 = 0.001;
/// Samples of a patch that are the picture's largest may be this share: more are where the camera's range ends.
const AT_THE_TOP: f64 = 0.02;
/// Cells across and down a patch.
const CELLS: usize = 3;
/// Cells may differ from the patch in brightness, and the ratio of their channels from its: light falls off over a card, but does not change
/// colour.
const BRIGHTNESS: f64 = 0.25;
const COLOUR: f64 = 0.05;

/// The gains that make a white patch neutral; green keeps its level. `region` is column and row of its top left pixel, width and
/// height; `place` names the photograph in messages.
///
/// # Errors
/// A region that is empty or reaches out of the picture; a patch that is clipped, dark or uneven.
pub fn white_patch(photograph: &Image, region: [usize; 4], place: &str) -> Result<Correction> {
    let [x, y, width, height] = region;
    let place = format!("{place}, white patch {x},{y},{width},{height}");
    let window = Window { x0: x, y0: y, x1: x.saturating_add(width), y1: y.saturating_add(height) };
    let seen = patch_of_light(photograph, window, &place)?;
    let refuse = |found: &str, expected: &str| Err(Error::invalid(&place, found, expected));
    let bright = brightest(photograph);
    if seen.iter().any(|v| *v <= f64::from(DARK * bright)) {
        let found = "a patch that is dark in at least one channel under the projector's white";
        return refuse(found, "one that the projector lights; choose another position or region");
    }
    if (0..3).any(|c| at_the_top(photograph, window, c) > AT_THE_TOP) {
        return refuse("a patch that is clipped", "shorter exposures, or a patch that is less bright");
    }
    for cell in cells(window) {
        let own = mean(photograph, cell);
        let brightness = own.iter().sum::<f64>() / seen.iter().sum::<f64>();
        let colour = (0..3).map(|c| (own[c] / seen[c] / brightness - 1.0).abs()).fold(0.0, f64::max);
        if (brightness - 1.0).abs() > BRIGHTNESS || colour > COLOUR {
            let found = format!(
                "a patch that is uneven: around ({}, {}) it has {:.0} % of its mean light, channels up to {:.0} % apart",
                (cell.x0 + cell.x1) / 2,
                (cell.y0 + cell.y1) / 2,
                100.0 * brightness,
                100.0 * colour
            );
            return refuse(&found, "the inside of one evenly lit white patch");
        }
    }
    white(seen, [1.0; 3])
}

/// A value that only few samples exceed.
fn brightest(photograph: &Image) -> f32 {
    let channels = photograph.channels();
    let mut values: Vec<f32> = photograph.data().chunks_exact(channels).flat_map(|p| [p[0], p[1], p[2]]).collect();
    let at = ((values.len() - 1) as f64 * (1.0 - BRIGHTEST)) as usize;
    *values.select_nth_unstable_by(at, f32::total_cmp).1
}

/// The share of a patch's samples that equal the largest of the picture; none where only one does.
fn at_the_top(photograph: &Image, window: Window, channel: usize) -> f64 {
    let channels = photograph.channels();
    let largest = photograph.data().chunks_exact(channels).map(|p| p[channel]).fold(f32::MIN, f32::max);
    let pixels = (window.y0..window.y1).flat_map(|y| (window.x0..window.x1).map(move |x| (x, y)));
    let count = pixels.filter(|(x, y)| photograph.pixel(*x, *y)[channel] == largest).count();
    if count < 2 { 0.0 } else { count as f64 / (window.width() * window.height()) as f64 }
}

/// Parts of a patch that are compared with all of it.
fn cells(window: Window) -> impl Iterator<Item = Window> {
    let (across, down) = (CELLS.min(window.width()), CELLS.min(window.height()));
    let part = |start: usize, size: usize, n: usize, of: usize| (start + n * size / of, start + (n + 1) * size / of);
    (0..across * down).map(move |n| {
        let (x0, x1) = part(window.x0, window.width(), n % across, across);
        let (y0, y1) = part(window.y0, window.height(), n / across, down);
        Window { x0, y0, x1, y1 }
    })
}

fn mean(photograph: &Image, window: Window) -> [f64; 3] {
    let pixels = (window.y0..window.y1).flat_map(|y| (window.x0..window.x1).map(move |x| (x, y)));
    let mut sum = [0.0; 3];
    for (x, y) in pixels {
        sum.iter_mut().zip(photograph.pixel(x, y)).for_each(|(sum, v)| *sum += f64::from(*v));
    }
    sum.map(|v| v / (window.width() * window.height()) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A card of 20 x 16 pixels from (10, 6) before grey, under bluish light that falls off by a tenth; any unit.
    fn card(unit: f32, change: impl Fn(usize, usize, [f32; 3]) -> [f32; 3]) -> Image {
        Image::from_fn(60, 40, |x, y| {
            let grain = 1.0 + 0.01 * ((x * 13 + y * 7) % 5) as f32;
            let inside = (10..30).contains(&x) && (6..22).contains(&y);
            let light = unit * grain * (1.0 - 0.1 * x as f32 / 60.0) * if inside { 0.9 } else { 0.3 };
            change(x, y, [0.5, 0.8, 1.0].map(|c| c * light))
        })
    }

    const REGION: [usize; 4] = [11, 7, 18, 14];

    #[test]
    fn a_patch_under_coloured_light_becomes_neutral_in_any_unit() {
        for unit in [1.0, 700.0, 1e-4] {
            let photograph = card(unit, |_, _, rgb| rgb);
            let correction = white_patch(&photograph, REGION, "position 1").unwrap();
            let found = correction.colour([0.5, 0.8, 1.0]);
            assert!(found.iter().all(|v| (v - 0.8).abs() < 1e-6), "{found:?}");
        }
    }

    #[test]
    fn patches_that_tell_nothing_are_refused_in_words() {
        let same = |_: usize, _: usize, rgb: [f32; 3]| rgb;
        let clipped = card(5.0, |_, _, rgb| rgb.map(|v: f32| v.min(4.0)));
        let dark = card(1.0, |x, y, rgb| if x < 31 && y < 23 { rgb.map(|v| 0.002 * v) } else { rgb });
        let stained = card(1.0, |x, _, rgb| if x < 17 { [0.8 * rgb[0], rgb[1], rgb[2]] } else { rgb });
        for (photograph, region, words) in [
            (card(1.0, same), [50, 7, 18, 14], "inside 60 x 40"),
            (card(1.0, same), [11, 7, 0, 14], "at least one pixel"),
            (card(1.0, same), [usize::MAX, 7, 18, 14], "inside 60 x 40"),
            (card(1.0, same), [20, 7, 18, 14], "uneven"),
            (stained, REGION, "uneven"),
            (clipped, REGION, "clipped"),
            (dark, REGION, "dark"),
            (card(1.0, |_, _, rgb| rgb.map(|_| 0.0)), REGION, "dark"),
        ] {
            let message = white_patch(&photograph, region, "position 4").unwrap_err().to_string();
            assert!(message.contains(words) && message.contains("position 4"), "{words} not in: {message}");
        }
    }
}
