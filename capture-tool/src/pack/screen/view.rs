//! Where each pixel looks, what covers it, and how bright the screen is.

use std::fmt::Write as _;

use relume_core::Result;
use relume_core::acquire::implicit::Edge;
use relume_core::domain::{Correspondence, Domain, Plane};
use relume_core::image::Image;
use relume_core::matte::Behind;
use relume_core::matte::alpha::BareWhite;

use crate::pack::develop::Developer;
use crate::pack::places;
use crate::pack::records::Records;
use crate::pack::shots::Shots;
use crate::progress::{Progress, Unit};
use crate::rigs::{Condition, RigFile};
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
        Domain::Plane(plane, self.correspondence.clone().map(Box::new))
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

    /// Pixels that see some of the screen itself, beside the object.
    pub fn edges(&self) -> Vec<Edge> {
        let (Some(behind), Some(white)) = (&self.behind, &self.white) else { return Vec::new() };
        let relative = |pixel: usize| std::array::from_fn(|c| white.data()[3 * pixel + c] / self.unit[c]);
        behind.edges().map(|(pixel, texels)| Edge { pixel, texels, white: relative(pixel) }).collect()
    }

    /// Light in units of the white screen.
    pub fn in_units(&self, picture: &mut Image) {
        let [r, g, b] = self.unit.map(|unit| 1.0 / unit);
        for pixel in picture.data_mut().as_chunks_mut::<3>().0 {
            *pixel = [pixel[0] * r, pixel[1] * g, pixel[2] * b];
        }
    }
}

/// Where pixels look and what covers them: what is `given`, or else what the session's Gray codes and stripes say; and words
/// for the report. Neither, where no such patterns were photographed.
///
/// # Errors
/// Files that are gone or changed; a coverage of everything or nothing; patterns that were photographed and tell no place.
pub fn of_session(
    rig: &RigFile,
    records: &Records,
    developer: &Developer,
    given: (Option<Correspondence>, Option<Vec<f32>>),
) -> Result<(View, String)> {
    let mut words = String::new();
    let codes = |photograph: &Photograph| match &photograph.condition {
        Condition::Pattern { set, .. } => matches!(set.as_str(), "gray-code" | "stripes"),
        _ => false,
    };
    if !records.of(Role::Calibration).any(codes) {
        return Ok((View { correspondence: given.0, alpha: given.1, bare: None }, words));
    }
    let shots = Shots::of_session(rig, records, developer)?;
    let mut progress = Progress::new("reading codes", Unit::Steps);
    let correspondence = match given.0 {
        Some(given) => given,
        None => {
            let found = places::correspondence(&shots, &mut |done, all| progress.step(done, all))?;
            let (off, kind) = (found.held_out.median_px, found.held_out_kind);
            let _ =
                writeln!(words, "screen     where pixels look is known to {off:.2} pixels (median of {kind} held out)");
            found.fit.correspondence
        }
    };
    let (alpha, bare) = match given.1 {
        Some(given) => (given, None),
        None => {
            let found = places::alpha(&shots, &correspondence, &mut |done, all| progress.step(done, all))?;
            (found.alpha, Some(found.bare))
        }
    };
    Ok((View { correspondence: Some(correspondence), alpha: Some(alpha), bare }, words))
}
