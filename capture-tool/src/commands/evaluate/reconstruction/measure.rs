//! The measuring: one pass over the field for the errors, one for what kind each pixel is, and pictures under a turning
//! sliver of light and under maps.

use std::sync::Arc;

use relume_core::evaluate::pixel_sets::{self, PixelSet, Traits};
use relume_core::evaluate::reconstruction::{Summary, Thinned, build, relative_errors};
use relume_core::evaluate::relit_errors;
use relume_core::evaluate::sliver::{Column, SLIVER_MAP, headings, sliver_weights, spread_weights};
use relume_core::field::Asset;
use relume_core::illumination::EnvMap;
use relume_core::image::{ColourSpace, Conversion, Image, Window};
use relume_core::reconstruct::{Method, Operator, Outside, Reconstruction};
use relume_core::relight::{Weights, apply};

use super::super::pictures::for_display;
use super::report::{Measured, Refused, Report, Set};
use crate::progress::{Progress, Unit};

/// Headings of the sliver over time: 2 degrees each, less than half of its width.
const FRAMES: usize = 180;
/// Headings of the sliver for relit errors: 30 degrees apart.
const POSITIONS: usize = 12;
/// The heading of the stills among them, 45 degrees to the right of the camera: -165 + 7 x 30.
const STILL: usize = 7;
/// What relit pictures are compared with: all lamps by this method. At the full number of lamps methods differ far less than
/// from a part of them.
const REFERENCE: Method = Method::Linear;

/// What to measure; checked.
#[derive(Debug)]
pub struct Task {
    pub asset: Asset,
    pub thinned: Thinned,
    pub column: usize,
    pub masks: Vec<PixelSet>,
    /// Names and maps.
    pub environments: Vec<(String, EnvMap)>,
}

/// What was measured, and the pictures of it.
#[derive(Debug)]
pub struct Lit {
    pub report: Report,
    pub sets: Vec<PixelSet>,
    pub traits: Vec<Traits>,
    /// `e_i`, a plane a method.
    pub errors: Vec<Vec<f32>>,
    /// Of all lamps by the reference: the column over time, and the still of each light.
    pub reference: Shown,
    /// Of the kept lamps by each method.
    pub methods: Vec<Shown>,
    /// The column over time, of all lamps by each method that they allow (figure 4.18).
    pub over_time_of_all: Vec<(Method, Image)>,
}

/// Pictures of one method.
#[derive(Debug)]
pub struct Shown {
    pub over_time: Image,
    /// The sliver at one heading, then the maps.
    pub stills: Vec<Image>,
}

/// Weights of one method, of its own lamps.
struct Projected {
    frames: Vec<Vec<f32>>,
    /// At [`POSITIONS`] headings.
    positions: Vec<Weights>,
    maps: Vec<Weights>,
}

impl Projected {
    /// The light of each still.
    fn stills(&self, still: usize) -> Vec<&Weights> {
        std::iter::once(&self.positions[still]).chain(&self.maps).collect()
    }

    /// The lights of relit errors: headings that light anything, then maps.
    fn lights(&self, lit: &[usize]) -> Vec<Weights> {
        lit.iter().map(|&n| self.positions[n].clone()).chain(self.maps.iter().cloned()).collect()
    }
}

impl Task {
    /// Measures.
    ///
    /// # Errors
    /// A damaged field; Ctrl-C.
    pub fn carry_out(&self) -> anyhow::Result<Lit> {
        let (asset, thinned) = (&self.asset, &self.thinned);
        let mut progress = Progress::new("rebuilding reflectance functions", Unit::Steps);
        let errors =
            relative_errors(asset.samples()?, asset.directions()?, thinned, &mut |done, all| progress.step(done, all))?;
        let mut progress = Progress::new("telling kinds of pixels apart", Unit::Steps);
        let traits =
            pixel_sets::traits(asset.samples()?, asset.directions()?, &mut |done, all| progress.step(done, all))?;
        let found = pixel_sets::find(&traits, asset.alpha());
        let sets = pixel_sets::with_masks(found, self.masks.clone())?;
        anyhow::ensure!(
            !sets.is_empty(),
            "{} is black under every lamp: there is nothing to measure",
            asset.path().display()
        );

        let (whole, _) = build(asset.directions()?, &self.methods_of_all())?;
        let total = (thinned.methods.len() + whole.len()) as u64;
        let (mut progress, mut done) = (Progress::new("projecting lights", Unit::Steps), 0);
        let mut project = |reconstruction: &Arc<Reconstruction>, kept: Option<&[u32]>| {
            done += 1;
            progress.step(done, total)?;
            Ok::<_, relume_core::Error>(self.project(reconstruction, kept))
        };
        let kept = Some(&thinned.subset.kept[..]);
        let own = thinned.methods.iter().map(|method| project(method, kept)).collect::<Result<Vec<_>, _>>()?;
        let all = whole.iter().map(|method| project(method, None)).collect::<Result<Vec<_>, _>>()?;
        drop(progress);
        let reference = whole.iter().position(|method| method.method() == REFERENCE).unwrap_or(0);

        let column = Column::read(asset.samples()?, self.column)?;
        let over_time_of_all = whole
            .iter()
            .zip(&all)
            .filter(|(method, _)| thinned.methods.iter().any(|chosen| chosen.method() == method.method()))
            .map(|(method, projected)| (method.method(), for_display(asset, column.over_time(&projected.frames, None))))
            .collect();
        let (lit, still) = self.lit_positions(&all[reference]);
        let relit = self.relit(&all[reference], &own, &sets, &lit)?;
        let stills = self.stills(&all[reference], &own, still)?;
        let shown = |projected: &Projected, kept, stills| Shown {
            over_time: column.over_time(&projected.frames, kept),
            stills,
        };
        let mut stills = stills.into_iter();
        let reference = shown(&all[reference], None, stills.next().unwrap_or_default());
        let methods = own.iter().zip(stills).map(|(projected, stills)| shown(projected, kept, stills)).collect();
        let report = self.report(&errors, &sets, relit, lit.len());
        Ok(Lit { report, sets, traits, errors, reference, methods, over_time_of_all })
    }

    /// The methods to measure and the reference, each once.
    fn methods_of_all(&self) -> Vec<Method> {
        let chosen: Vec<Method> = self.thinned.methods.iter().map(|method| method.method()).collect();
        Method::ALL.iter().copied().filter(|method| *method == REFERENCE || chosen.contains(method)).collect()
    }

    /// All lights by one method. Maps are averaged down to the sliver's: 0.7 degrees, below any rig's cell.
    fn project(&self, reconstruction: &Arc<Reconstruction>, kept: Option<&[u32]>) -> Projected {
        let lamps = self.asset.domain().len();
        let operator = |(w, h)| Operator::new(reconstruction.clone(), Outside::Drop, w, h);
        let of_sliver = operator(SLIVER_MAP);
        let positions = sliver_weights(&of_sliver, &headings(POSITIONS));
        let of_map = |map: &EnvMap| {
            // Maps are in linear Rec. 709; the field has its own colours.
            let to_field = Conversion::between(ColourSpace::LinRec709, self.asset.colour_space());
            let map = map.reduced(SLIVER_MAP.0).into_owned().converted(&to_field);
            let size = map.image().size();
            let rgb = if size == SLIVER_MAP { of_sliver.downsample(&map) } else { operator(size).downsample(&map) };
            let mut weights = Weights::of_lamps(rgb);
            if let Some(kept) = kept {
                let own = std::mem::replace(&mut weights, Weights::dark(lamps));
                kept.iter().zip(own.rgb).for_each(|(&n, rgb)| weights.rgb[n as usize] = rgb);
            }
            weights
        };
        Projected {
            frames: sliver_weights(&of_sliver, &headings(FRAMES)),
            positions: positions.iter().map(|own| spread_weights(own, kept, lamps)).collect(),
            maps: self.environments.iter().map(|(_, map)| of_map(map)).collect(),
        }
    }

    /// The headings under which the lamps give light at all (a dome before the object has no light from behind), and the one of the stills.
    fn lit_positions(&self, reference: &Projected) -> (Vec<usize>, usize) {
        let light = |n: usize| reference.positions[n].rgb.iter().map(|rgb| f64::from(rgb[0])).sum::<f64>();
        let most = (0..POSITIONS).map(light).fold(0.0, f64::max);
        let lit: Vec<usize> = (0..POSITIONS).filter(|&n| light(n) > 0.01 * most).collect();
        let still = if lit.contains(&STILL) { STILL } else { lit.first().copied().unwrap_or(STILL) };
        (lit, still)
    }

    /// For each method, for each light (the sliver, then maps), for each set.
    fn relit(
        &self,
        reference: &Projected,
        own: &[Projected],
        sets: &[PixelSet],
        lit: &[usize],
    ) -> anyhow::Result<Vec<Vec<Vec<Summary>>>> {
        let rivals: Vec<Vec<Weights>> = own.iter().map(|projected| projected.lights(lit)).collect();
        let mut progress = Progress::new("relighting", Unit::Steps);
        let errors = relit_errors(self.asset.samples()?, &reference.lights(lit), &rivals, sets, &mut |done, all| {
            progress.step(done, all)
        })?;
        let of_method = |sets: &Vec<Vec<f64>>| {
            let over = |range: std::ops::Range<usize>| {
                sets.iter().map(|lights| Summary::of(lights[range.clone()].iter().copied())).collect::<Vec<_>>()
            };
            let maps = (lit.len()..lit.len() + self.environments.len()).map(|n| over(n..n + 1));
            std::iter::once(over(0..lit.len())).chain(maps).collect()
        };
        Ok(errors.iter().map(of_method).collect())
    }

    /// The stills of the reference, then of each method. One pass over the field a light, to bound memory.
    fn stills(&self, reference: &Projected, own: &[Projected], still: usize) -> anyhow::Result<Vec<Vec<Image>>> {
        let weights: Vec<Vec<&Weights>> =
            std::iter::once(reference).chain(own).map(|projected| projected.stills(still)).collect();
        let window = Window::full(self.asset.width(), self.asset.height());
        let mut stills = vec![Vec::new(); weights.len()];
        for light in 0..=self.environments.len() {
            let lights: Vec<&Weights> = weights.iter().map(|lights| lights[light]).collect();
            let pictures = apply(self.asset.samples()?, &lights, window)?;
            stills
                .iter_mut()
                .zip(pictures)
                .for_each(|(stills, picture)| stills.push(for_display(&self.asset, picture)));
            crate::progress::check()?;
        }
        Ok(stills)
    }

    fn report(&self, errors: &[Vec<f32>], sets: &[PixelSet], relit: Vec<Vec<Vec<Summary>>>, lit: usize) -> Report {
        let thinned = &self.thinned;
        let measured = |reconstruction: &Reconstruction, errors: &[f32], relit: Vec<Vec<Summary>>| Measured {
            id: reconstruction.method().id(),
            label: reconstruction.method().label(),
            errors: sets.iter().map(|set| Summary::over(errors, &set.pixels)).collect(),
            relit,
        };
        let methods = thinned.methods.iter().zip(errors).zip(relit);
        let sliver = format!("a sliver of light at {lit} headings");
        Report {
            tool: concat!("relume ", env!("CARGO_PKG_VERSION")),
            asset: self.asset.path().display().to_string(),
            lamps: self.asset.domain().len(),
            kept: thinned.subset.kept.len(),
            subset: thinned.subset.rule,
            reference: REFERENCE.id(),
            sets: sets.iter().map(|set| Set { set: set.clone(), count: set.pixels.len() }).collect(),
            lights: std::iter::once(sliver).chain(self.environments.iter().map(|(name, _)| name.clone())).collect(),
            methods: methods.map(|((method, errors), relit)| measured(method, errors, relit)).collect(),
            refused: thinned
                .refused
                .iter()
                .map(|(method, reason)| Refused { id: method.id(), label: method.label(), reason: reason.clone() })
                .collect(),
        }
    }
}
