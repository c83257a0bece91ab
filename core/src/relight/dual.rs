//! Pictures from the side of the light: `C'' = T^T L''` (dual light transport, 3.3.3).
//!
//! A row of T is what arrives at each place of the rig when one pixel of the camera throws light. From one position of a projector,
//! whose squares have an apex in common, that is the scene as the projector would see it, lit by the camera's rays; of a screen,
//! which has none, it is the light that arrives at each texel, and no picture from a viewpoint. Lamps are at infinity, each alone.
//!
//! **Reciprocity (Helmholtz).** Let `K(u, w)` be the radiance towards the camera along u for radiant intensity 1 a steradian thrown along w;
//! the other way round it is the same. Pixel i, of solid angle `O_i`, and square j, of `O_j`, have
//! `T_ij = 1 / O_i * double integral of K`, and a camera at the projector would see `D_ji = 1 / O_j * double integral of K` of a pixel that
//! throws intensity 1. So `T_ij O_i = D_ji O_j`, and with the picture c as the *flux* that each pixel throws, intensity `c_i / O_i`,
//!
//! ```text
//! (T^T c)_j = sum_i T_ij c_i = O_j sum_i D_ji c_i / O_i:
//! ```
//!
//! divided by the solid angles of the squares ([`Dual::as_radiance`]) it is that camera's picture. Squares are equal on a plane, so the
//! difference is cos^3 from the middle to the corners.
//!
//! **Ambient.** Photographs that still hold what was seen with all lights off, S, are no answer to the projector, and turning them round
//! would turn S round too. So an asset must have its black photograph subtracted, or come from where it was dark.

use std::ops::Range;

use super::adjoint::{Progress, adjoint};
use super::choice::absent;
use crate::domain::{Domain, Plane};
use crate::error::{Error, Result};
use crate::field::{Asset, Kind};
use crate::image::Image;

/// An asset seen from the side of its light.
#[derive(Debug, Clone, Copy)]
pub struct Dual<'a> {
    asset: &'a Asset,
    picture: Plane,
}

impl<'a> Dual<'a> {
    /// Takes an open asset; `dark_room` states that nothing was seen with all lights off, where the asset has no black photograph
    /// that would say so.
    ///
    /// # Errors
    /// A field of lamps; one whose ambient light was not removed.
    pub fn new(asset: &'a Asset, dark_room: bool) -> Result<Self> {
        let unsupported = |what: &str, advice: &str| {
            let place = asset.path().display().to_string();
            Err(Error::Unsupported { place, what: what.to_owned(), advice: advice.to_owned() })
        };
        let Some(picture) = asset.domain().picture() else {
            return unsupported(
                "a picture from the side of lamps at infinity, which have no point to look from,",
                "use a field of a projector (a gantry) or of a screen",
            );
        };
        if asset.ambient().is_none() && !dark_room {
            return unsupported(
                "turning light round that holds what was seen with all lights off (the asset has no black photograph)",
                "capture or import it with a black photograph, or say --dark-room if nothing was to be seen without the light",
            );
        }
        Ok(Self { asset, picture })
    }

    /// How many pictures there are: positions of a projector, or one.
    pub fn views(&self) -> usize {
        self.asset.domain().len() / self.picture.len()
    }

    /// Their columns and rows.
    pub fn size(&self) -> (usize, usize) {
        self.picture.size()
    }

    /// The representation that is used: the one `wanted`, or the first there is of samples, factored, wavelets of each pixel, explicit
    /// wavelets.
    ///
    /// # Errors
    /// One that the asset does not hold.
    pub fn choose(&self, wanted: Option<Kind>) -> Result<Kind> {
        let held = |kind: &Kind| self.asset.manifest().representation(*kind).is_some();
        match wanted {
            Some(kind) if held(&kind) => Ok(kind),
            Some(kind) => Err(absent(self.asset, kind)),
            // A manifest holds one at least.
            None => Ok(Kind::ALL.into_iter().find(held).unwrap_or(Kind::Dense)),
        }
    }

    /// `T^T c` of some views, a picture each: columns to the right and row 0 at the top, as the projector sees the scene, or as the camera
    /// sees the bare screen. `lit` is c, linear RGB in the asset's colours and of its size: what each pixel throws. All ones give the sum of
    /// the rows of T.
    ///
    /// # Errors
    /// As [`adjoint`]; views that there are not.
    pub fn pictures(
        &self,
        lit: &Image,
        kind: Kind,
        views: Range<usize>,
        progress: &mut Progress<'_>,
    ) -> Result<Vec<Image>> {
        let of_one = self.picture.len();
        if views.end > self.views() {
            let found = format!("position {}", views.end);
            return Err(Error::invalid(
                self.asset.path().display().to_string(),
                found,
                format!("1 to {}", self.views()),
            ));
        }
        let elements = views.start * of_one..views.end * of_one;
        let answers = adjoint(self.asset, kind, &[lit], elements, progress)?.pop().unwrap_or_default();
        let (columns, rows) = self.picture.size();
        let picture = |of: &[[f32; 3]]| Image::from_fn(columns, rows, |x, y| of[self.picture.element(x, y)]);
        Ok(answers.chunks_exact(of_one).map(picture).collect())
    }

    /// Divides each square of a picture by its solid angle, relative to those in the middle: what a camera in place of the projector
    /// would see.
    ///
    /// # Errors
    /// A field of a screen.
    pub fn as_radiance(&self, picture: &Image) -> Result<Image> {
        let Domain::Gantry(gantry) = self.asset.domain() else {
            return Err(Error::Unsupported {
                place: self.asset.path().display().to_string(),
                what: "radiance towards a screen, which has no point to look from,".to_owned(),
                advice: "take what arrives at its texels as it is".to_owned(),
            });
        };
        let middle = gantry.side() / 2;
        let most = gantry.steradians(middle, middle);
        Ok(Image::from_fn(picture.width(), picture.height(), |x, y| {
            let gain = (most / gantry.steradians(y, x)) as f32;
            std::array::from_fn(|c| picture.pixel(x, y)[c] * gain)
        }))
    }
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use super::*;
    use crate::acquire::Photographs;
    use crate::domain::{Directions, Filter, Gantry};
    use crate::field::{Access, Contents, Precision, write};
    use crate::math::Vec3;

    const SIZE: (usize, usize) = (18, 11);

    /// T of a pixel is `1 + element`, times the channel's number.
    fn written(folder: &Path, domain: impl Into<Domain>, strengths: usize, black: bool) -> PathBuf {
        let domain: Domain = domain.into();
        let mut photographs = Photographs::new(SIZE.0, SIZE.1, folder);
        for e in 0..domain.len() {
            photographs
                .push(Image::from_fn(SIZE.0, SIZE.1, |_, _| [1.0, 2.0, 3.0].map(|c| c * (1 + e) as f32)))
                .unwrap();
        }
        let path = folder.join("a.rfield");
        let contents = Contents {
            irradiance: vec![1.0; strengths],
            domain,
            width: SIZE.0,
            height: SIZE.1,
            colour_space: Default::default(),
            precision: Precision::Float,
            largest: photographs.largest(),
            ambient: black.then(|| Image::new(SIZE.0, SIZE.1, 3)),
            alpha: None,
            reliability: None,
            provenance: serde_json::Value::Null,
        };
        write(&path, &contents, &mut photographs).unwrap();
        path
    }

    fn gantry() -> Gantry {
        let places = [Vec3::new(0.0, 0.5, 4.0), Vec3::new(3.0, 3.0, 1.0)];
        Gantry::looking_at_origin(&places, 4, 0.6, Filter::Box).unwrap()
    }

    #[test]
    fn white_gives_the_sums_of_rows_of_each_position() {
        let folder = tempfile::tempdir().unwrap();
        let asset = Asset::open(&written(folder.path(), gantry(), 2, true), Access::Mapped).unwrap();
        let dual = Dual::new(&asset, false).unwrap();
        assert_eq!((dual.views(), dual.size(), dual.choose(None).unwrap()), (2, (4, 4), Kind::Dense));
        let white = Image::from_fn(SIZE.0, SIZE.1, |_, _| [1.0; 3]);
        let pictures = dual.pictures(&white, Kind::Dense, 0..2, &mut |_, _| Ok(())).unwrap();
        let pixels = (SIZE.0 * SIZE.1) as f32;
        for (position, picture) in pictures.iter().enumerate() {
            for (x, y) in (0..4).flat_map(|y| (0..4).map(move |x| (x, y))) {
                let t = (1 + position * 16 + y * 4 + x) as f32 * pixels;
                assert_eq!(picture.pixel(x, y), [t, 2.0 * t, 3.0 * t]);
            }
        }
        let second = dual.pictures(&white, Kind::Dense, 1..2, &mut |_, _| Ok(())).unwrap();
        assert_eq!(second[..], pictures[1..]);
        let message = dual.pictures(&white, Kind::Dense, 1..3, &mut |_, _| Ok(())).unwrap_err().to_string();
        assert!(message.contains("position 3") && message.contains("1 to 2"), "{message}");
        assert!(dual.choose(Some(Kind::Wavelet)).unwrap_err().to_string().contains("wavelet"));
    }

    /// From the middle to a place at the tangents u and v, solid angles fall with the cube of the cosine.
    #[test]
    fn radiance_brightens_the_corners_by_the_cube_of_the_cosine() {
        let folder = tempfile::tempdir().unwrap();
        let asset = Asset::open(&written(folder.path(), gantry(), 2, true), Access::Mapped).unwrap();
        let flat = Image::from_fn(4, 4, |_, _| [1.0, 0.5, 0.0]);
        let seen = Dual::new(&asset, false).unwrap().as_radiance(&flat).unwrap();
        let cube = |x: f64, y: f64| {
            let at = |n: f64| (n - 1.5) / 2.0 * 0.3f64.tan();
            (1.0 + at(x).powi(2) + at(y).powi(2)).powf(1.5)
        };
        for (x, y) in [(0, 0), (3, 0), (1, 2), (3, 2)] {
            let expected = cube(x as f64, y as f64) / cube(1.0, 1.0);
            let pixel = seen.pixel(x, y);
            assert!((f64::from(pixel[0]) / expected - 1.0).abs() < 2e-3, "{} is not {expected}", pixel[0]);
            assert!((pixel[1] / pixel[0] - 0.5).abs() < 1e-6 && pixel[2] == 0.0);
        }
        assert_eq!(seen.pixel(2, 1)[0], 1.0);
    }

    #[test]
    fn what_has_no_dual_is_refused_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        let lamps = Directions::new(vec![Vec3::z(), Vec3::x(), Vec3::y()]).unwrap();
        let asset = Asset::open(&written(folder.path(), lamps, 3, true), Access::Mapped).unwrap();
        let message = Dual::new(&asset, true).unwrap_err().to_string();
        assert!(message.contains("lamps at infinity") && message.contains("gantry"), "{message}");
        let asset = Asset::open(&written(folder.path(), gantry(), 2, false), Access::Mapped).unwrap();
        let message = Dual::new(&asset, false).unwrap_err().to_string();
        assert!(message.contains("black photograph") && message.contains("--dark-room"), "{message}");
        assert!(Dual::new(&asset, true).is_ok());
        let screen = Domain::Plane(Plane::new(3, 2).unwrap(), None);
        let asset = Asset::open(&written(folder.path(), screen, 0, true), Access::Mapped).unwrap();
        let dual = Dual::new(&asset, false).unwrap();
        assert_eq!((dual.views(), dual.size()), (1, (3, 2)));
        assert!(dual.as_radiance(&Image::new(3, 2, 3)).unwrap_err().to_string().contains("screen"));
    }
}
