//! An asset and its cached projections.

use std::sync::{Arc, Mutex, OnceLock};

use super::choice::choose;
use super::projections::{Kept, Projections, kept};
use super::{Look, Weights, element, prepared};
use crate::domain::{Directions, Domain, Gantry};
use crate::error::{Error, Result};
use crate::field::{Asset, Kind};
use crate::illumination::{Beam, Distant, EnvMap, Incident, Turned, flattened};
use crate::image::{ColourSpace, Conversion, Image, Window};
use crate::reconstruct::{Method, Outside, Squares};
use crate::wavelet::Wavelet;

/// Maps wider than this are averaged down before projection: 0.18 degrees a texel is far below any rig's cell, and the
/// operator of a larger map would take hundreds of megabytes. Whoever keeps a map for many pictures may [reduce](EnvMap::reduced) it
/// to this once.
pub const WIDEST_MAP: usize = 2048;

/// The light of a picture.
#[derive(Debug, Clone, Copy)]
pub enum Light<'a> {
    /// A lat-long map.
    Map(&'a EnvMap),
    /// Beams in the stage frame and linear Rec.709. A look turns them as it turns a map; what it does to maps beside that
    /// (middle column, colours, blur, clamp) leaves them alone.
    Beams(&'a [Beam]),
    /// Light that differs from point to point, in the stage frame, linear Rec.709, and the units of a projector's positions. A look turns it;
    /// what else it does to maps leaves it alone.
    Field(&'a dyn Incident),
    /// The same, taken everywhere as it is at the origin: the 2D approximation. Lamps can do no other.
    Flat(&'a dyn Incident),
    /// Captured lamp N, counted from 1, at the intensity of the capture; of a projector, element N (position after position, row after
    /// row).
    Lamp(usize),
}

/// An asset of lamps, or of a projector at many positions, with what relighting keeps between frames. Share it behind an `Arc`; all methods take `&self`.
#[derive(Debug)]
pub struct Relighter {
    asset: Asset,
    /// The lamps, or where the projector stood.
    lamps: Arc<Directions>,
    projections: Projections,
    /// Onto the squares of a projector, by method.
    squares: Mutex<Kept<(Method, Outside), Squares>>,
    /// Onto the texels of the grid that wavelets live on, built when they light.
    on_grid: OnceLock<Projections>,
}

/// Methods over a projector's positions that are kept: some megabytes each.
const KEPT_METHODS: usize = 3;
/// A light of which less than this share comes from where the projector stood is taken for one behind it.
const BEHIND: f64 = 1e-9;

/// Light is projected onto the grid of wavelets by linear interpolation between its texels.
const ON_GRID: Method = Method::Wavelet(Wavelet::LeGall53);

impl Relighter {
    /// Takes an open asset.
    ///
    /// # Errors
    /// A field of a screen; see [`ScreenRelighter`](super::ScreenRelighter).
    pub fn new(asset: Asset) -> Result<Self> {
        let lamps = match asset.domain() {
            Domain::Gantry(gantry) => gantry.directions().clone(),
            _ => asset.directions()?.clone(),
        };
        let projections = Projections::new(lamps.clone());
        Ok(Self { asset, projections, lamps, squares: Mutex::default(), on_grid: OnceLock::new() })
    }

    /// Takes an open asset and leaves some lamps (numbers from 1) out: the reconstruction works around them. A left-out
    /// lamp can still be lit by itself.
    ///
    /// # Errors
    /// A number that no lamp has; no lamp left; a field of a screen or a projector.
    pub fn without(asset: Asset, excluded: &[usize]) -> Result<Self> {
        let projections = Projections::without(asset.directions()?, excluded)?;
        Ok(Self { projections, ..Self::new(asset)? })
    }

    /// The positions and squares of a projector's asset.
    pub fn gantry(&self) -> Option<&Arc<Gantry>> {
        self.asset.domain().gantry()
    }

    /// The asset.
    pub fn asset(&self) -> &Asset {
        &self.asset
    }

    /// Projects a light onto the lamps: `w_j = 2^EV tint * integral of U_j(w) L(w) dw`, in units of radiance times
    /// steradian and the asset's colours, or 2^EV tint E_N for a lamp. L is the map [as the look has it](prepared). Once a picture, not per window. The first call for a method and map size builds the projection
    /// (about a second); later ones take milliseconds.
    ///
    /// # Errors
    /// A lamp that is not in the set; a method that the set of lamps does not allow.
    pub fn weights(&self, light: Light<'_>, look: &Look) -> Result<Weights> {
        let kind = self.choose(look.representation, matches!(light, Light::Lamp(_)))?;
        if let Domain::Gantry(gantry) = self.asset.domain() {
            let mut weights = self.of_squares(gantry, light, look)?;
            weights.scale(look.gain());
            return Ok(self.multiplying(kind, weights.rgb));
        }
        let mut weights = match light {
            Light::Field(_) => return Err(self.too_far()),
            Light::Flat(field) => {
                let turned = Turned { light: field, rotation: look.orientation().matrix() };
                let (beams, map) = flattened(&turned);
                let (projections, method) = self.projected_by(kind, look)?;
                let mut weights = projections.beams(&beams, method, look.outside)?;
                if let Some(map) = map {
                    weights.add(1.0, &projections.map(&map, method, look.outside)?);
                }
                weights.convert(&Conversion::between(ColourSpace::default(), self.asset.colour_space()));
                weights
            }
            Light::Map(map) => {
                let (projections, method) = self.projected_by(kind, look)?;
                let mut weights = projections.map(&prepared(map, look), method, look.outside)?;
                // Colours of the sums in place of those of all texels: projection treats channels alike.
                weights.convert(&Conversion::between(look.map_space, self.asset.colour_space()));
                weights
            }
            Light::Beams(beams) => {
                let (projections, method) = self.projected_by(kind, look)?;
                let mut weights = projections.beams(&turned(beams, look), method, look.outside)?;
                weights.convert(&Conversion::between(ColourSpace::default(), self.asset.colour_space()));
                weights
            }
            // On the grid, a beam from where the lamp stood.
            Light::Lamp(number) if kind == Kind::Wavelet => {
                let irradiance = self.lamp(number)?.rgb[number - 1].map(f64::from);
                let beam = Beam { direction: self.lamps.lamps()[number - 1], irradiance };
                self.projected_by(kind, look)?.0.beams(&[beam], ON_GRID, Outside::Nearest)?
            }
            Light::Lamp(number) => self.lamp(number)?,
        };
        weights.scale(look.gain());
        Ok(self.multiplying(kind, weights.rgb))
    }

    /// Weights of a projector's squares, RGB, in the colours of the asset.
    fn of_squares(&self, gantry: &Gantry, light: Light<'_>, look: &Look) -> Result<Weights> {
        let rotation = look.orientation().matrix();
        let default = ColourSpace::default();
        let (rgb, space) = match light {
            Light::Map(map) => {
                let map = prepared(map, look).reduced(Squares::COLUMNS).into_owned();
                (self.squares(look)?.project(&map), look.map_space)
            }
            Light::Beams(beams) => (self.squares(look)?.project(&Distant(turned(beams, look))), default),
            Light::Field(field) => {
                let squares = self.squares(look)?;
                if look.outside == Outside::Drop {
                    self.refuse_behind(&squares, field, rotation)?;
                }
                (squares.project(&Turned { light: field, rotation }), default)
            }
            Light::Flat(field) => {
                let (beams, map) = flattened(&Turned { light: field, rotation });
                let squares = self.squares(look)?;
                let mut weights = Weights::of_lamps(squares.project(&Distant(beams)));
                if let Some(map) = map {
                    weights.add(1.0, &Weights::of_lamps(squares.project(&*map.reduced(Squares::COLUMNS))));
                }
                (weights.rgb, default)
            }
            Light::Lamp(number) => {
                let Some(element) = number.checked_sub(1).filter(|element| *element < gantry.len()) else {
                    let place = self.asset.path().display().to_string();
                    return Err(Error::invalid(place, format!("square {number}"), format!("1 to {}", gantry.len())));
                };
                let mut rgb = vec![[0.0; 3]; gantry.len()];
                rgb[element] = [self.asset.manifest().intensity()[gantry.place(element).0]; 3];
                (rgb, self.asset.colour_space())
            }
        };
        let mut weights = Weights::of_lamps(rgb);
        weights.convert(&Conversion::between(space, self.asset.colour_space()));
        Ok(weights)
    }

    /// The projection onto the squares that a look wants, built on first use.
    fn squares(&self, look: &Look) -> Result<Arc<Squares>> {
        let Some(gantry) = self.gantry() else { return Err(self.too_far()) };
        let (method, outside) = (look.method, look.outside);
        let build = || Squares::new(gantry.clone(), method, outside);
        kept(&self.squares, (method, outside), KEPT_METHODS, build)
    }

    /// Refuses a light of which nothing comes from where the projector stood.
    fn refuse_behind(&self, squares: &Squares, field: &dyn Incident, rotation: crate::math::Mat3) -> Result<()> {
        for (name, light) in field.parts() {
            if squares.covered(&Turned { light, rotation }).is_some_and(|share| share < BEHIND) {
                return Err(Error::Unsupported {
                    place: self.asset.path().display().to_string(),
                    what: format!("{name}, which comes from where the projector never stood,"),
                    advice: "move it, turn the light, or give it to the nearest position (outside: nearest, or --outside nearest)"
                        .to_owned(),
                });
            }
        }
        Ok(())
    }

    /// What is said of near light on lamps at infinity.
    fn too_far(&self) -> Error {
        Error::Unsupported {
            place: self.asset.path().display().to_string(),
            what: "light that differs from point to point on a field of lamps, which are far away,".to_owned(),
            advice: "take it as it is in the middle of the object (--flat), or capture with a projector".to_owned(),
        }
    }

    /// No light, for one of the representations that the asset holds.
    pub fn dark(&self, kind: Kind) -> Weights {
        let sparse = self.asset.sparse().filter(|_| kind == Kind::Wavelet);
        let count = sparse.map_or(self.asset.domain().len(), |sparse| sparse.layout().elements);
        self.multiplying(kind, vec![[0.0; 3]; count])
    }

    /// What projects light for a representation, and by which method.
    fn projected_by(&self, kind: Kind, look: &Look) -> Result<(&Projections, Method)> {
        let sparse = self.asset.sparse().filter(|_| kind == Kind::Wavelet);
        let Some(grid) = sparse.and_then(|sparse| sparse.grid()) else {
            return Ok((&self.projections, look.method));
        };
        let texels = grid.directions()?;
        Ok((self.on_grid.get_or_init(|| Projections::new(texels.clone())), ON_GRID))
    }

    /// Weights with what the coefficients of a representation are multiplied by.
    fn multiplying(&self, kind: Kind, rgb: Vec<[f32; 3]>) -> Weights {
        let coefficients = match kind {
            Kind::Harmonics => self.asset.harmonics().map(|harmonics| harmonics.moments(&rgb)),
            Kind::Wavelet => self.asset.sparse().map(|sparse| sparse.transformed(&rgb)),
            Kind::Dense | Kind::Factored | Kind::Explicit => None,
        };
        Weights { rgb, kind, coefficients }
    }

    /// The representation that lights this asset: the one `wanted`, or, for `None`, the best that the light allows: for one
    /// captured lamp the samples, else a factored field (of an error up to 5 %), the samples, wavelets, harmonics, the first
    /// that there is. It never depends on what a map shows, so it cannot change in the course of an animation.
    ///
    /// # Errors
    /// A representation that the asset does not hold, or that cannot do without the lamps that are left out.
    pub fn choose(&self, wanted: Option<Kind>, captured_lamp: bool) -> Result<Kind> {
        let kind = choose(&self.asset, wanted, captured_lamp)?;
        if self.projections.leaves_out() && matches!(kind, Kind::Wavelet | Kind::Harmonics) {
            return Err(Error::Unsupported {
                place: self.asset.path().display().to_string(),
                what: format!("leaving lamps out of `{}`, which all lamps have gone into,", kind.id()),
                advice: "use an asset with samples, or one compressed without these lamps".to_owned(),
            });
        }
        Ok(kind)
    }

    fn lamp(&self, number: usize) -> Result<Weights> {
        let irradiance = self.asset.manifest().irradiance();
        let Some(&e) = number.checked_sub(1).and_then(|n| irradiance.get(n)) else {
            let expected = format!("1 to {}", irradiance.len());
            return Err(Error::invalid(self.asset.path().display().to_string(), format!("lamp {number}"), expected));
        };
        let mut weights = Weights::dark(irradiance.len());
        weights.rgb[number - 1] = [e; 3];
        Ok(weights)
    }

    /// The element `T L + g S`, RGBA premultiplied (alpha 1 where the asset has none), of the window alone: the picture
    /// has the window's size.
    ///
    /// # Errors
    /// As [`apply`](super::apply).
    pub fn render(&self, weights: &Weights, look: &Look, window: Window) -> Result<Image> {
        let mut pictures = self.render_many(&[(weights, look)], window)?;
        pictures.pop().ok_or_else(|| Error::invalid("illumination", "none", "one"))
    }

    /// [`Relighter::render`] for several lights in one pass over the field.
    ///
    /// # Errors
    /// As [`apply`](super::apply).
    pub fn render_many(&self, lights: &[(&Weights, &Look)], window: Window) -> Result<Vec<Image>> {
        element::many(&self.asset, lights, window)
    }
}

/// Beams as a look turns them.
fn turned(beams: &[Beam], look: &Look) -> Vec<Beam> {
    let rotation = look.orientation().matrix();
    beams.iter().map(|beam| Beam { direction: rotation * beam.direction, ..*beam }).collect()
}
