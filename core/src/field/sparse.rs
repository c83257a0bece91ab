//! For each pixel its own set of wavelet coefficients (chapter 5).
//!
//! The reflectance function t of a pixel, rebuilt on a grid about the axis of the lamps or found on the texels of a screen, is
//! `t ~ sum_k c_k s_k`: `s_k` the synthesis functions at the kept locations, `c_k` one RGB triple each, so the three channels
//! share the set. Lit by w on the grid it shows `<t, w> = sum_k c_k (S^T w)_k`: the light is transformed once
//! ([`Sparse::transformed`]), and every pixel gathers from it. On a screen the functions can be the texels themselves: a
//! pixel of clear glass sees only a few. They can be functions and texels together, two descriptions of one space: a pixel under a
//! projector sees one square brightly and all others a little. Of a projector, functions live on the squares of one position each.
//!
//! Pixels come block by block, as in a dense field (rows of 16 x 8 pixels, those beyond the edges of the picture without
//! terms), so that the terms of a block lie together: compressing appends them as it reads the samples, and a window reads
//! those of its blocks alone. `offsets` holds the first term of each pixel and, last, their number.

use std::ops::Range;
use std::sync::Arc;

use half::f16;

use super::asset::Opening;
use super::dense::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, CHANNELS, Layout};
use super::manifest::Representation;
use super::store::{Scratch, Store};
use super::writer::TermBasis;
use crate::domain::{Domain, Plane, StageGrid};
use crate::error::{Error, Result};
use crate::wavelet::Transform;

/// In place of a wavelet's id: terms are texels.
pub(super) const TEXELS: &str = "texel";

/// Locations over some texels.
pub(super) fn places(texels: usize, with_texels: bool) -> usize {
    if with_texels { 2 * texels } else { texels }
}

/// Bytes of a location: the fewest that do.
pub(super) fn location_bytes(texels: usize) -> usize {
    match texels {
        0..=0x100 => 1,
        0x101..=0x1_0000 => 2,
        _ => 4,
    }
}

/// numpy's name of unsigned numbers of some bytes.
pub(super) fn unsigned(bytes: usize) -> &'static str {
    match bytes {
        1 => "<u1",
        2 => "<u2",
        4 => "<u4",
        _ => "<u8",
    }
}

/// Wavelet coefficients in an open container.
#[derive(Debug)]
pub struct Sparse {
    store: Arc<Store>,
    /// Columns, rows, texels of the grid.
    layout: Layout,
    /// None on a screen or of a projector.
    grid: Option<StageGrid>,
    /// None where terms are texels.
    transform: Option<Transform>,
    /// Locations from the texels' number on are single texels.
    with_texels: bool,
    /// How many terms there are.
    terms: u64,
    /// Where the numbers of the arrays start.
    offsets: u64,
    locations: u64,
    coefficients: u64,
    scale: f32,
}

/// Room for the terms of a block where the file is read, not mapped.
#[derive(Debug, Default)]
pub struct TermBuffer([Scratch; 3]);

/// Locations of some terms.
#[derive(Debug, Clone, Copy)]
enum Locations<'a> {
    One(&'a [u8]),
    Two(&'a [u16]),
    Four(&'a [u32]),
}

/// The terms of the 128 pixels of a block.
#[derive(Debug, Clone, Copy)]
pub struct Terms<'a> {
    /// From the first term of the file; checked.
    offsets: &'a [u64],
    locations: Locations<'a>,
    coefficients: &'a [f16],
}

impl<'a> Terms<'a> {
    /// The coefficients of pixel k of the block, as stored, RGB after RGB; their locations are copied out.
    pub fn of_pixel(&self, k: usize, locations: &mut Vec<u32>) -> &'a [f16] {
        let first = self.offsets[0];
        let own = (self.offsets[k] - first) as usize..(self.offsets[k + 1] - first) as usize;
        locations.clear();
        let halves = &self.coefficients[CHANNELS * own.start..CHANNELS * own.end];
        match self.locations {
            Locations::One(all) => locations.extend(all[own].iter().map(|&l| u32::from(l))),
            Locations::Two(all) => locations.extend(all[own].iter().map(|&l| u32::from(l))),
            Locations::Four(all) => locations.extend_from_slice(&all[own]),
        }
        halves
    }

    /// Does no pixel of the block have a term?
    pub fn is_empty(&self) -> bool {
        self.coefficients.is_empty()
    }
}

impl Sparse {
    /// Opens the arrays: sizes are checked here, offsets and locations where they are used.
    pub(super) fn open(
        open: &Opening<'_>,
        domain: &Domain,
        (width, height): (usize, usize),
        representation: &Representation,
    ) -> Result<Option<Self>> {
        let Representation::Wavelet { wavelet, with_texels, grid, offsets, locations, coefficients, scale, .. } =
            representation
        else {
            return Ok(None);
        };
        let named = |error: Error| Error::invalid(open.place, error.to_string(), "a usable wavelet representation");
        let (grid, transform, texels) = match domain {
            Domain::Directions(lamps) => {
                let grid = StageGrid::new(lamps, (grid[0], grid[1])).map_err(named)?;
                let transform = grid.transform(wavelet.parse().map_err(named)?).map_err(named)?;
                let texels = grid.texels();
                (Some(grid), Some(transform), texels)
            }
            Domain::Plane(..) | Domain::Gantry(_) => {
                let texels = domain.len();
                let picture = domain.picture().map_or((texels, 1), |picture| picture.size());
                let expected = [picture.0, texels / picture.0];
                if *grid != expected {
                    let expected = format!("{} x {}, as the {}", expected[0], expected[1], domain.elements());
                    return Err(Error::invalid(open.place, format!("a grid of {} x {}", grid[0], grid[1]), expected));
                }
                let basis = |wavelet: &str| Plane::new(picture.0, picture.1)?.transform(wavelet.parse()?);
                let transform = (wavelet != TEXELS).then(|| basis(wavelet)).transpose().map_err(named)?;
                (None, transform, texels)
            }
        };
        let layout = Layout { width, height, elements: texels };
        let pixels = layout.rows() * layout.columns() * BLOCK_PIXELS;
        let range = open.array(offsets, unsigned(8), &[pixels + 1], 8)?;
        let mut scratch = Scratch::default();
        let last = open.store.get(range.end - 8, 8, &mut scratch)?;
        let terms = u64::from_le_bytes(std::array::from_fn(|n| last[n]));
        let count = usize::try_from(terms).unwrap_or(usize::MAX);
        let bytes = location_bytes(places(texels, *with_texels));
        Ok(Some(Self {
            store: Arc::clone(open.store),
            layout,
            transform,
            with_texels: *with_texels,
            terms,
            offsets: range.start,
            locations: open.array(locations, unsigned(bytes), &[count], bytes)?.start,
            coefficients: open.array(coefficients, "<f2", &[count, CHANNELS], 2)?.start,
            scale: *scale,
            grid,
        }))
    }

    /// Sizes: the picture's, and as elements the texels of the grid.
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// The file it lies in.
    pub fn path(&self) -> &std::path::Path {
        self.store.path()
    }

    /// The grid that light is projected onto, by linear interpolation; none on a screen, whose texels are the grid.
    pub fn grid(&self) -> Option<&StageGrid> {
        self.grid.as_ref()
    }

    /// The transform of functions on the grid; none where terms are texels.
    pub fn transform(&self) -> Option<&Transform> {
        self.transform.as_ref()
    }

    /// Terms of all pixels together.
    pub fn terms(&self) -> u64 {
        self.terms
    }

    /// A power of two: coefficient = stored x scale.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// How many locations there are: functions, then, where they have places of their own, texels.
    pub fn places(&self) -> usize {
        places(self.layout.elements, self.with_texels)
    }

    /// What the terms are of.
    pub fn basis(&self) -> TermBasis {
        match &self.transform {
            None => TermBasis::Texels,
            Some(transform) if self.with_texels => TermBasis::Both(transform.wavelet()),
            Some(transform) => TermBasis::Wavelet(transform.wavelet()),
        }
    }

    /// `S^T w`, and w itself where texels have places of their own: what the coefficients are multiplied by, by location, from RGB weights
    /// of the texels.
    ///
    /// # Panics
    /// When there is not one weight a texel.
    pub fn transformed(&self, weights: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mut table = weights.to_vec();
        if let Some(transform) = &self.transform {
            of_pictures(transform, &mut table, |picture| transform.inverse_adjoint(picture, CHANNELS));
        }
        if self.with_texels {
            table.extend_from_slice(weights);
        }
        table
    }

    /// `S m`, the adjoint of [`Sparse::transformed`]: one RGB triple a texel from one a location.
    ///
    /// # Panics
    /// When there is not one triple a location.
    pub fn transformed_adjoint(&self, sums: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mut texels = sums.to_vec();
        if let Some(transform) = &self.transform {
            of_pictures(transform, &mut texels, |picture| transform.inverse(picture, CHANNELS));
        }
        texels
    }

    /// The terms of the block in column `bx`, row `by`.
    ///
    /// # Errors
    /// Bytes that cannot be read; offsets that do not ascend, or leave the arrays; locations outside of the grid.
    pub fn block<'a>(&'a self, bx: usize, by: usize, buffer: &'a mut TermBuffer) -> Result<Terms<'a>> {
        let [of_offsets, of_locations, of_coefficients] = &mut buffer.0;
        let first = ((by * self.layout.columns() + bx) * BLOCK_PIXELS) as u64;
        let bytes = self.store.get(self.offsets + 8 * first, 8 * (BLOCK_PIXELS + 1), of_offsets)?;
        // Numbers are aligned: arrays start at multiples of 64 bytes, and each number at a multiple of its own size.
        let offsets: &[u64] = bytemuck::cast_slice(bytes);
        let own = self.checked(offsets, bx, by)?;
        let count = (own.end - own.start) as usize;
        let size = location_bytes(self.places());
        let bytes = self.store.get(self.locations + size as u64 * own.start, size * count, of_locations)?;
        let locations = match size {
            1 => Locations::One(bytes),
            2 => Locations::Two(bytemuck::cast_slice(bytes)),
            _ => Locations::Four(bytemuck::cast_slice(bytes)),
        };
        // Without an early end the loops vectorise.
        let texels = self.places() as u32;
        let outside = match locations {
            Locations::One(all) => all.iter().fold(false, |bad, &l| bad | (u32::from(l) >= texels)),
            Locations::Two(all) => all.iter().fold(false, |bad, &l| bad | (u32::from(l) >= texels)),
            Locations::Four(all) => all.iter().fold(false, |bad, &l| bad | (l >= texels)),
        };
        if outside {
            let expected = format!("locations below {}", self.places());
            return Err(self.damaged(bx, by, "a location outside of the grid", &expected));
        }
        let step = (2 * CHANNELS) as u64;
        let bytes = self.store.get(self.coefficients + step * own.start, step as usize * count, of_coefficients)?;
        Ok(Terms { offsets, locations, coefficients: bytemuck::cast_slice(bytes) })
    }

    /// The terms of a block, if its offsets are what they must be.
    fn checked(&self, offsets: &[u64], bx: usize, by: usize) -> Result<Range<u64>> {
        let fits = |pair: &[u64]| pair[0] <= pair[1] && pair[1] - pair[0] <= self.places() as u64;
        let own = offsets[0]..offsets[BLOCK_PIXELS];
        if !offsets.windows(2).all(fits) || own.end > self.terms {
            let expected = format!("ascending ones, at most {} terms a pixel and {} in all", self.places(), self.terms);
            return Err(self.damaged(bx, by, "offsets of terms that cannot be", &expected));
        }
        Ok(own)
    }

    fn damaged(&self, bx: usize, by: usize, found: &str, expected: &str) -> Error {
        let place = format!("{}, pixels from ({}, {})", self.path().display(), bx * BLOCK_WIDTH, by * BLOCK_HEIGHT);
        Error::invalid(place, found, format!("{expected} (`relume verify` tells whether the file was damaged)"))
    }

    /// The decoded reflectance function of a pixel: one RGB triple a texel of the grid.
    ///
    /// # Errors
    /// A pixel outside the picture; as [`Sparse::block`].
    pub fn reflectance(&self, x: usize, y: usize) -> Result<Vec<[f32; 3]>> {
        let Layout { width, height, elements } = self.layout;
        if x >= width || y >= height {
            let expected = format!("0,0 to {},{}, from the top left", width - 1, height - 1);
            return Err(Error::invalid(self.path().display().to_string(), format!("pixel {x},{y}"), expected));
        }
        let mut buffer = TermBuffer::default();
        let terms = self.block(x / BLOCK_WIDTH, y / BLOCK_HEIGHT, &mut buffer)?;
        let mut locations = Vec::new();
        let coefficients = terms.of_pixel(y % BLOCK_HEIGHT * BLOCK_WIDTH + x % BLOCK_WIDTH, &mut locations);
        let mut function = vec![[0.0; CHANNELS]; self.places()];
        for (location, rgb) in locations.iter().zip(coefficients.chunks_exact(CHANNELS)) {
            let place = &mut function[*location as usize];
            place.iter_mut().zip(rgb).for_each(|(value, c)| *value += c.to_f32() * self.scale);
        }
        if let Some(transform) = &self.transform {
            of_pictures(transform, &mut function[..elements], |picture| transform.inverse(picture, CHANNELS));
        }
        let single = function.split_off(elements);
        function.iter_mut().zip(single).for_each(|(value, own)| (0..CHANNELS).for_each(|c| value[c] += own[c]));
        Ok(function)
    }
}

/// Each of the pictures that functions are made of: one, or one a position of a projector.
fn of_pictures(transform: &Transform, values: &mut [[f32; CHANNELS]], mut change: impl FnMut(&mut [f32])) {
    let (width, height) = transform.size();
    values.chunks_exact_mut(width * height).for_each(|picture| change(picture.as_flattened_mut()));
}
