//! What the camera sees of the screen itself, past the object and through its soft edges.
//!
//! A photograph under light L is `T L + (1 - alpha) g L_seen + S`: `L_seen` what the screen shows where the pixel looks, g what
//! the camera makes of the white screen there. The middle term is taken out before solving, so that a soft edge does not
//! count the plate twice (design: composite = T L + g S + (1 - alpha) plate).

use rayon::prelude::*;

use crate::domain::{Correspondence, Plane};
use crate::error::{Error, Result};
use crate::image::Image;

/// Places across and down a pixel at which it is asked which texel is seen.
const ACROSS: usize = 8;
/// Coverage below which a pixel is taken for the bare screen, to see how bright that is.
const BARE: f32 = 0.02;
/// So many pixels that see the bare screen make a white.
const FEWEST_BARE: usize = 16;

/// Pixels that see the screen past an object, and which texels each sees.
#[derive(Debug, Clone)]
pub struct Behind {
    size: (usize, usize),
    pixels: Vec<Seen>,
}

#[derive(Debug, Clone)]
struct Seen {
    pixel: usize,
    /// 1 - alpha.
    through: f32,
    /// Texels with their shares of what the pixel sees of the screen, together one (what looks past the screen counts as
    /// covered); none beside it.
    texels: Vec<(u32, f32)>,
}

impl Behind {
    /// From coverage (width x height, row 0 at the top) and where pixels look.
    ///
    /// # Panics
    /// When there is not one coverage a pixel.
    pub fn new(alpha: &[f32], size: (usize, usize), correspondence: &Correspondence, plane: Plane) -> Self {
        assert_eq!(alpha.len(), size.0 * size.1, "one coverage a pixel");
        let seen = |pixel: usize| {
            let through = 1.0 - alpha[pixel];
            let corner = [(pixel % size.0) as f64, (pixel / size.0) as f64];
            (through > 0.0).then(|| Seen { pixel, through, texels: texels(corner, correspondence, plane) })
        };
        Self { size, pixels: (0..alpha.len()).into_par_iter().filter_map(seen).collect() }
    }

    /// Takes the screen out of a photograph, black subtracted, under `emitted` light of the texels; `white` is what the camera
    /// makes of the white screen at each pixel, black subtracted. Pixels that see nothing else become black.
    ///
    /// # Panics
    /// For pictures of another size.
    pub fn take_out(&self, photograph: &mut Image, emitted: &[f32], white: &Image) {
        assert!(photograph.size() == self.size && white.size() == self.size, "pictures of one size");
        for seen in &self.pixels {
            let at = 3 * seen.pixel..3 * seen.pixel + 3;
            let pixel = &mut photograph.data_mut()[at.clone()];
            if seen.through >= 1.0 {
                pixel.fill(0.0);
                continue;
            }
            let light: f32 = seen.texels.iter().map(|(texel, share)| share * emitted[*texel as usize]).sum();
            pixel.iter_mut().zip(&white.data()[at]).for_each(|(v, white)| *v -= seen.through * white * light);
        }
    }

    /// Pixels that see some of the screen and some of the object: each with the texels, and how much of them it sees.
    pub fn edges(&self) -> impl Iterator<Item = (usize, Vec<(u32, f32)>)> + '_ {
        let edge = |seen: &Seen| seen.texels.iter().map(|(texel, share)| (*texel, seen.through * share)).collect();
        self.pixels.iter().filter(|seen| seen.through < 1.0).map(move |seen| (seen.pixel, edge(seen)))
    }

    /// How bright the white screen is to the camera, RGB: the median over pixels that see nothing else, of a photograph under
    /// white, black subtracted.
    ///
    /// # Errors
    /// Too few such pixels, or a dark screen.
    pub fn white(&self, photograph: &Image) -> Result<[f32; 3]> {
        let whole = |seen: &&Seen| {
            let share: f32 = seen.texels.iter().map(|(_, share)| share).sum();
            seen.through > 1.0 - BARE && share > 0.999
        };
        let bare: Vec<usize> = self.pixels.iter().filter(whole).map(|seen| seen.pixel).collect();
        if bare.len() < FEWEST_BARE {
            return Err(Error::invalid(
                "the white screen",
                format!("{} pixels that see it past the object", bare.len()),
                format!("{FEWEST_BARE} at least, or a session of the bare screen (--bare)"),
            ));
        }
        let median = |c: usize| {
            let mut values: Vec<f32> = bare.iter().map(|pixel| photograph.data()[3 * pixel + c]).collect();
            let middle = values.len() / 2;
            *values.select_nth_unstable_by(middle, f32::total_cmp).1
        };
        let white = [0, 1, 2].map(median);
        if white.iter().any(|v| !(v.is_finite() && *v > 0.0)) {
            return Err(Error::invalid("the white screen", format!("light of {white:?}"), "a screen that shines"));
        }
        Ok(white)
    }
}

/// The texels that a pixel sees, with their shares of what it sees of the screen.
fn texels(corner: [f64; 2], correspondence: &Correspondence, plane: Plane) -> Vec<(u32, f32)> {
    let mut found: Vec<u32> = (0..ACROSS * ACROSS)
        .filter_map(|n| {
            let inside = |k: usize| (k as f64 + 0.5) / ACROSS as f64;
            let seen = correspondence.screen_of([corner[0] + inside(n % ACROSS), corner[1] + inside(n / ACROSS)]);
            if !seen.iter().all(|s| (0.0..1.0).contains(s)) {
                return None;
            }
            let column = (seen[0] * plane.columns() as f64) as usize;
            let row = (seen[1] * plane.rows() as f64) as usize;
            Some(plane.element(column.min(plane.columns() - 1), row.min(plane.rows() - 1)) as u32)
        })
        .collect();
    found.sort_unstable();
    let share = 1.0 / found.len().max(1) as f32;
    found.chunk_by(|a, b| a == b).map(|same| (same[0], share * same.len() as f32)).collect()
}
