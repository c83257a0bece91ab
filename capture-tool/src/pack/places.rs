//! Which place of a screen each pixel sees, and what covers it, from the photographs of its patterns; and the file that keeps
//! the first.

use std::io::Write;
use std::path::Path;

use relume_core::calibrate::screen::{Decoded, Fit, HeldOut, Shown, Sighting, Spread, decode, fit, held_out, lines};
use relume_core::domain::Correspondence;
use relume_core::files::write_whole;
use relume_core::matte::alpha::{self, Alpha};
use relume_core::{Error, Result};
use serde::{Deserialize, Serialize};

use super::shots::Shots;

/// Sightings that are fitted to, at most; more would only take longer.
const MOST: usize = 300_000;
/// Without stripes that were held out, every so many-th block of places is.
const HELD_OUT: usize = 5;
/// Its side, pixels: wider than what neighbouring pixels share.
const BLOCK: usize = 16;
/// A pixel sees the screen directly that is off by no more texels and pixels.
const DIRECT: f64 = 1.5;

/// What the photographs of patterns say.
#[derive(Debug)]
pub struct Found {
    /// Where pixels look.
    pub decoded: Decoded,
    /// The fit to those that look at it directly.
    pub fit: Fit,
    /// Of each pixel, whether it sees the screen directly, as far as its place tells.
    pub direct: Vec<bool>,
    /// Errors of what was not fitted to.
    pub held_out: Spread,
    /// What that was: `stripes` or `places`.
    pub held_out_kind: &'static str,
}

/// Photographs read so far, of about so many; may stop the work.
pub type Told<'a> = &'a mut dyn FnMut(u64, u64) -> Result<()>;

/// Finds the correspondence of a screen.
///
/// # Errors
/// As `decode` and `fit` of the core.
pub fn correspondence(shots: &Shots<'_>, told: Told<'_>) -> Result<Found> {
    let (best, other) = (shots.best_set(), shots.other_set());
    let (mut done, all) = (0, 2 * shots.len() as u64);
    let mut picture = |n: usize| {
        done += 1;
        told(done.min(all), all)?;
        shots.picture(n)
    };
    let decoded = decode(&shots.shown(best), &mut picture)?;
    let sightings = sightings(&decoded);
    let fit = fit(&sightings, decoded.size, decoded.texels)?;
    let direct = direct(&decoded, &fit);
    let by_stripes = match other {
        Some(other) => by_stripes(&shots.shown(Some(other)), &mut picture, &decoded, &direct, &fit.correspondence)?,
        None => None,
    };
    let (held_out, held_out_kind) = match by_stripes {
        Some(spread) => (spread, "stripes"),
        None => (by_places(&sightings, &decoded)?, "places"),
    };
    Ok(Found { decoded, fit, direct, held_out, held_out_kind })
}

/// Finds what covers the screen, from all patterns there are.
///
/// # Errors
/// As the core's; an alpha that covers everything or nothing.
pub fn alpha(shots: &Shots<'_>, correspondence: &Correspondence, told: Told<'_>) -> Result<Alpha> {
    let (mut done, all) = (0, shots.len() as u64);
    let mut picture = |n: usize| {
        done += 1;
        told(done.min(all), all)?;
        shots.picture(n)
    };
    let alpha = alpha::from_stripes(&shots.shown(None), &mut picture, correspondence)?;
    alpha::check(&alpha.alpha, alpha.size, "alpha from stripes")?;
    Ok(alpha)
}

fn sightings(decoded: &Decoded) -> Vec<Sighting> {
    let width = decoded.size.0;
    let all = decoded.places.iter().enumerate().filter(|(_, place)| place.is_some()).map(|(n, _)| n);
    let all: Vec<usize> = all.collect();
    let sighting = |n: &usize| {
        let (x, y) = (n % width, n / width);
        Some(Sighting { pixel: [x as f64 + 0.5, y as f64 + 0.5], screen: decoded.screen(x, y)? })
    };
    all.iter().step_by(all.len().div_ceil(MOST).max(1)).filter_map(sighting).collect()
}

/// Pixels whose places agree with the correspondence.
fn direct(decoded: &Decoded, fit: &Fit) -> Vec<bool> {
    let width = decoded.size.0;
    let bound = DIRECT * (1.0 + fit.texel_px * decoded.resolution[0].max(decoded.resolution[1]) as f64);
    let agrees = |n: usize| {
        let (x, y) = (n % width, n / width);
        let pixel = decoded.screen(x, y).and_then(|screen| fit.correspondence.pixel_of(screen));
        pixel.is_some_and(|[a, b]| (a - x as f64 - 0.5).hypot(b - y as f64 - 0.5) <= bound)
    };
    (0..decoded.places.len()).map(agrees).collect()
}

/// Errors at the edges of stripes that were not fitted to; none where no stripe is wide enough.
fn by_stripes(
    shown: &[Shown],
    picture: &mut dyn FnMut(usize) -> Result<relume_core::image::Image>,
    decoded: &Decoded,
    direct: &[bool],
    correspondence: &Correspondence,
) -> Result<Option<Spread>> {
    let mut errors = HeldOut::default();
    lines(shown, picture, &mut |_, line| {
        held_out(&mut errors, &line, decoded.size.0, direct, correspondence);
        Ok(())
    })?;
    Ok(errors.spread())
}

/// Errors of places that another fit was not made to; rounding to texels is in them.
fn by_places(sightings: &[Sighting], decoded: &Decoded) -> Result<Spread> {
    let block =
        |s: &Sighting| (s.pixel[0] as usize / BLOCK + 2 * (s.pixel[1] as usize / BLOCK)).is_multiple_of(HELD_OUT);
    let (held, kept): (Vec<Sighting>, Vec<Sighting>) = sightings.iter().partition(|s| block(s));
    let fit = fit(&kept, decoded.size, decoded.texels)?;
    let bound = DIRECT * (1.0 + fit.texel_px * decoded.resolution[0].max(decoded.resolution[1]) as f64);
    let error = |s: &Sighting| {
        let [x, y] = fit.correspondence.pixel_of(s.screen)?;
        Some((x - s.pixel[0]).hypot(y - s.pixel[1])).filter(|off| *off <= bound)
    };
    let spread = Spread::of(held.iter().filter_map(error).collect());
    spread.ok_or_else(|| {
        Error::invalid(
            "the correspondence of the screen",
            "a fit that places beside it do not agree with",
            "one screen",
        )
    })
}

const VERSION: u32 = 1;

/// `screen.json`: a correspondence, and what it is good for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScreenFile {
    /// Of the layout; 1.
    version: u32,
    /// What wrote it.
    tool: String,
    /// Columns and rows of the photographs.
    pub picture: [usize; 2],
    /// Columns and rows of the patterns.
    pub texels: [usize; 2],
    /// Half of the edges (or places) that were held out of the fit are off by less, pixels.
    pub median_error_px: f64,
    /// The correspondence.
    pub correspondence: Correspondence,
}

impl ScreenFile {
    /// Of what was found.
    pub fn new(found: &Found) -> Self {
        Self {
            version: VERSION,
            tool: concat!("relume ", env!("CARGO_PKG_VERSION")).to_owned(),
            picture: found.decoded.size.into(),
            texels: found.decoded.texels.into(),
            median_error_px: found.held_out.median_px,
            correspondence: found.fit.correspondence.clone(),
        }
    }

    /// Writes it, whole or not at all.
    ///
    /// # Errors
    /// The disk's.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_whole(path, |out| {
            let failed = |source| Error::io("write", path, source);
            serde_json::to_writer_pretty(&mut *out, self).map_err(|error| failed(error.into()))?;
            out.write_all(b"\n").map_err(failed)
        })
    }

    /// Reads it; `size` is that of the photographs it is for.
    ///
    /// # Errors
    /// As [`ScreenFile::open`]; a camera of another size.
    pub fn read(path: &Path, size: (usize, usize)) -> Result<Self> {
        let file = Self::open(path)?;
        if file.picture != <[usize; 2]>::from(size) {
            let found = format!("a camera of {} x {} pixels", file.picture[0], file.picture[1]);
            let expected = format!("one of {} x {}, as the photographs", size.0, size.1);
            return Err(Error::invalid(path.display().to_string(), found, expected));
        }
        Ok(file)
    }

    /// Reads it for photographs of any size.
    ///
    /// # Errors
    /// No such file; numbers that make no correspondence; another version.
    pub fn open(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::io("read", path, source))?;
        let place = path.display().to_string();
        let file: Self = serde_json::from_str(&text).map_err(|error| {
            Error::invalid(&place, error.to_string(), "a file as `relume calibrate screen -o` writes it")
        })?;
        if file.version != VERSION {
            return Err(Error::invalid(place, format!("version {}", file.version), format!("version {VERSION}")));
        }
        Ok(file)
    }
}
