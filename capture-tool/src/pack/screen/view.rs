//! Where each pixel looks, what covers it, and how bright the screen is.

use std::fmt::Write as _;
use std::path::Path;

use relume_core::calibrate::screen::{Shown, Sighting, decode, fit};
use relume_core::domain::patterns::{Element, PatternSet};
use relume_core::domain::{Correspondence, Domain, Plane};
use relume_core::image::Image;
use relume_core::matte::Behind;
use relume_core::matte::alpha::{self, BareWhite};
use relume_core::{Error, Result};

use crate::capture::patterns::Sets;
use crate::pack::develop::Developer;
use crate::pack::records::Records;
use crate::rigs::Condition;
use crate::session::{Photograph, Role};

/// What the camera sees of the screen itself.
#[derive(Debug, Default)]
pub struct View {
    /// Where on the screen each pixel looks, if that is known.
    pub correspondence: Option<Correspondence>,
    /// Coverage of the object; none where it was not measured: all pixels are the object's.
    pub alpha: Option<Vec<f32>>,
    /// The light of the white screen, where stripes told it.
    pub bare: Option<BareWhite>,
}

/// The view made ready for photographs of one size and patterns of one grid.
#[derive(Debug)]
pub struct Ready {
    behind: Option<Behind>,
    /// What the camera makes of the white screen at each pixel.
    white: Option<Image>,
    /// T is divided by this.
    pub unit: [f32; 3],
}

impl View {
    /// Coverage and correspondence together tell which pixels see the screen, and `white`, a photograph under the white screen
    /// (the bare screen's, if there is one) with black subtracted, how bright it is. Without them T stays in the unit of the
    /// photographs.
    ///
    /// # Errors
    /// Nothing of the screen seen.
    pub fn ready(&self, size: (usize, usize), plane: Plane, white: Option<(Image, bool)>) -> Result<Ready> {
        let (Some(correspondence), Some(alpha)) = (&self.correspondence, &self.alpha) else {
            return Ok(Ready { behind: None, white: None, unit: [1.0; 3] });
        };
        let behind = Behind::new(alpha, size, correspondence, plane);
        let Some((photograph, bare)) = white else {
            return Ok(Ready { behind: Some(behind), white: None, unit: [1.0; 3] });
        };
        let unit = match bare {
            true => Behind::new(&vec![0.0; alpha.len()], size, correspondence, plane).white(&photograph)?,
            false => behind.white(&photograph)?,
        };
        let white = match &self.bare {
            _ if bare => photograph,
            Some(smooth) => Image::from_fn(size.0, size.1, |x, y| smooth.at([x as f64 + 0.5, y as f64 + 0.5])),
            None => Image::from_fn(size.0, size.1, |_, _| unit),
        };
        Ok(Ready { behind: Some(behind), white: Some(white), unit })
    }

    /// The domain of the field.
    pub fn domain(&self, plane: Plane) -> Domain {
        Domain::Plane(plane, self.correspondence.clone())
    }

    /// Is any of a pixel the object's?
    pub fn covered(&self, pixel: usize) -> bool {
        self.alpha.as_ref().is_none_or(|alpha| alpha[pixel] > 0.0)
    }
}

impl Ready {
    /// What the object answers, in units of the white screen: the screen itself is taken out.
    pub fn of_object(&self, photograph: &mut Image, emitted: &[f32]) {
        if let (Some(behind), Some(white)) = (&self.behind, &self.white) {
            behind.take_out(photograph, emitted, white);
        }
        self.in_units(photograph);
    }

    /// Light in units of the white screen.
    pub fn in_units(&self, picture: &mut Image) {
        let [r, g, b] = self.unit.map(|unit| 1.0 / unit);
        for pixel in picture.data_mut().as_chunks_mut::<3>().0 {
            *pixel = [pixel[0] * r, pixel[1] * g, pixel[2] * b];
        }
    }
}

/// Binary patterns with their photographs.
type Codes<'a> = (Vec<Shown>, Vec<&'a Photograph>);

/// Where pixels look and what covers them: what is `given`, or else what the session's Gray codes and stripes say; and words
/// for the report.
///
/// # Errors
/// Files that are gone or changed; a coverage of everything or nothing; codes that were photographed and tell no place.
pub fn of_session(
    records: &Records,
    developer: &Developer,
    sets: &Sets,
    given: (Option<Correspondence>, Option<Vec<f32>>),
) -> Result<(View, String)> {
    let mut words = String::new();
    let picture = |codes: &Codes<'_>, n: usize| developer.picture(records, codes.1[n]);
    let places = codes(records, sets, |element| matches!(element, Element::GrayCode { .. }));
    let correspondence = match (given.0, &places) {
        (Some(given), _) => Some(given),
        (None, Some(codes)) => {
            let fit = correspondence(&codes.0, &mut |n| picture(codes, n))?;
            let _ = writeln!(
                words,
                "screen     where pixels look is known to {:.2} pixels (median of {} codes)",
                fit.inliers.median_px, fit.inliers.count
            );
            Some(fit.correspondence)
        }
        (None, None) => None,
    };
    let stripes = codes(records, sets, |element| matches!(element, Element::Stripes { .. }));
    let (alpha, bare) = match (given.1, &correspondence, &stripes) {
        (Some(given), ..) => (Some(given), None),
        (None, Some(correspondence), Some(codes)) => {
            let found = alpha::from_stripes(&codes.0, &mut |n| picture(codes, n), correspondence)?;
            alpha::check(&found.alpha, found.size, "the coverage from the session's stripes")?;
            (Some(found.alpha), Some(found.bare))
        }
        _ => (None, None),
    };
    Ok((View { correspondence, alpha, bare }, words))
}

/// Gray codes -> places -> a correspondence.
fn correspondence(
    shown: &[Shown],
    picture: &mut dyn FnMut(usize) -> Result<Image>,
) -> Result<relume_core::calibrate::screen::Fit> {
    let decoded = decode(shown, picture)?;
    let (width, height) = decoded.size;
    let sighting = |n: usize| {
        let (x, y) = (n % width, n / width);
        Some(Sighting { pixel: [x as f64 + 0.5, y as f64 + 0.5], screen: decoded.screen(x, y)? })
    };
    let sightings: Vec<Sighting> = (0..width * height).filter_map(sighting).collect();
    fit(&sightings, decoded.size, decoded.texels)
}

/// The calibration photographs under binary patterns that are `wanted`, black and white with them; none where there are none.
pub fn codes<'a>(records: &'a Records, sets: &Sets, wanted: impl Fn(Element) -> bool) -> Option<Codes<'a>> {
    let (mut shown, mut photographs) = (Vec::new(), Vec::new());
    for photograph in records.of(Role::Calibration) {
        let Condition::Pattern { set, number, .. } = &photograph.condition else { continue };
        let known = |set: &&PatternSet| *number < set.len() && wanted(set.element(*number));
        if let Some(set) = sets.get(set).filter(known) {
            shown.push(Shown::of(&set.pattern(*number)));
            photographs.push(photograph);
        }
    }
    if shown.is_empty() {
        return None;
    }
    let plain = |role: Role, what: Shown| records.of(role).next().map(|photograph| (what, photograph));
    for (what, photograph) in
        [plain(Role::Black, Shown::Black), plain(Role::AllLit, Shown::White)].into_iter().flatten()
    {
        shown.push(what);
        photographs.push(photograph);
    }
    Some((shown, photographs))
}

/// Reads a correspondence that `relume calibrate screen` wrote.
///
/// # Errors
/// No such file; numbers that are no correspondence.
pub fn read_correspondence(path: &Path) -> Result<Correspondence> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::io("read", path, source))?;
    let broken = |error: serde_json::Error| {
        Error::invalid(path.display().to_string(), error.to_string(), "a file of `relume calibrate screen`")
    };
    serde_json::from_str(&text).map_err(broken)
}
