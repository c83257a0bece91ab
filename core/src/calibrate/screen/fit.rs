//! From places that pixels see to a correspondence: a homography by RANSAC (Fischler and Bolles 1981), so that what is seen
//! in mirrors, through glass, or decoded wrongly does not count; then a cubic residual, for lens and screen are never quite
//! straight.
//!
//! Candidates are the homographies through four sightings; each is scored by the sightings whose error is below a bound, less
//! the better they fit (MSAC, Torr and Zisserman 2000). From the best, least squares and the choice of inliers take turns, with
//! the bound falling to what the errors themselves say. Errors are measured in the picture, in pixels.

use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::domain::{Area, Correspondence, TERMS, monomials};
use crate::error::{Error, Result};

/// Homographies that are tried: with a fifth of inliers, one of 625 picks has four of them, so three of 2000.
const TRIES: usize = 2000;
/// Sightings that score them.
const JUDGES: usize = 3000;
/// Bound of the first round, of the picture's diagonal: lenses bend by a percent or so.
const FIRST_BOUND: f64 = 0.008;
/// And pixels at least.
const LEAST_BOUND: f64 = 2.0;
/// Rounds of refinement.
const ROUNDS: usize = 8;
/// The bound is so many times the median error: of a normal error in two directions, 99.9 % lie within.
const WIDE: f64 = 3.2;
/// Inliers at least: four times what a cubic in two directions has numbers.
const FEWEST: usize = 80;
/// And of all sightings.
const LEAST_SHARE: f64 = 0.05;
/// A median error beyond so many pixels, and the share of a texel that rounding to whole texels makes of it, is no fit. Twice
/// what the eye sees in a composite.
const WORST: f64 = 1.0;
/// Of a place known to a texel, the median distance is 0.38 texels (a point in a unit square from its middle).
const OF_TEXEL: f64 = 0.4;
/// Inliers that would lie anywhere within the bound have a median of 0.71 of it; of a fit they crowd at its middle.
const CROWDED: f64 = 0.6;

/// A pixel, and the place of the screen that it sees, in shares of its sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Column and row, pixel centres at +0.5.
    pub pixel: [f64; 2],
    /// From the left and from the top, 0 to 1.
    pub screen: [f64; 2],
}

/// Errors in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// How many.
    pub count: usize,
    /// Half of them are less.
    pub median_px: f64,
    /// 95 of 100 are less.
    pub most_px: f64,
}

impl Spread {
    /// Of errors; none of none.
    pub fn of(mut errors: Vec<f64>) -> Option<Self> {
        errors.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| errors[(share * (errors.len() - 1) as f64).round() as usize];
        (!errors.is_empty()).then(|| Self { count: errors.len(), median_px: at(0.5), most_px: at(0.95) })
    }
}

/// What was fitted, and how well.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// The correspondence.
    pub correspondence: Correspondence,
    /// Errors of the sightings that fit, rounding to texels included.
    pub inliers: Spread,
    /// The same with the homography alone.
    pub homography: Spread,
    /// Which sightings fit, in the order given.
    pub fits: Vec<bool>,
    /// Pixels a texel, at the middle of the fit.
    pub texel_px: f64,
}

/// Fits; `size` is that of the picture, `texels` what the places are rounded to. The same for the same sightings.
///
/// # Errors
/// Too few sightings, or none that agree; a residual too high to be a screen's.
pub fn fit(sightings: &[Sighting], size: (usize, usize), texels: (usize, usize)) -> Result<Fit> {
    let refuse =
        |found: String, expected: &str| Err(Error::invalid("the correspondence of the screen", found, expected));
    let fewest = FEWEST.max((LEAST_SHARE * sightings.len() as f64) as usize);
    if sightings.len() < FEWEST {
        let found = format!("{} pixels that see the screen", sightings.len());
        return refuse(found, &format!("{FEWEST} at least: let the camera see more of the screen past the object"));
    }
    let diagonal = (size.0 as f64).hypot(size.1 as f64);
    // A texel, were the whole picture full of the screen: places are rounded to it.
    let rounding = diagonal / (texels.0 as f64).hypot(texels.1 as f64);
    let bound = (FIRST_BOUND * diagonal).max(LEAST_BOUND) + rounding;
    let Some(first) = ransac(sightings, bound) else {
        return refuse(
            "places that no homography ties to the pixels".into(),
            "a flat screen that is seen directly, past the object",
        );
    };
    let model = refine(sightings, first, bound);
    let Some((model, bound)) = model.filter(|(model, bound)| model.count(sightings, *bound) >= fewest) else {
        return refuse(
            format!("{} places that do not agree with one flat screen", sightings.len()),
            "more pixels that see the screen directly, past the object",
        );
    };
    let fits: Vec<bool> = sightings.iter().map(|s| model.error(s) < bound).collect();
    let errors = |model: &Model| {
        Spread::of(sightings.iter().zip(&fits).filter(|(_, fits)| **fits).map(|(s, _)| model.error(s)).collect())
    };
    let correspondence = model.correspondence()?;
    let plain = Model { residual: None, ..model.clone() };
    let (Some(inliers), Some(homography)) = (errors(&model), errors(&plain)) else {
        return refuse("no place that fits".into(), "a screen that is seen directly");
    };
    let texel_px = texel_px(&correspondence, texels);
    if inliers.median_px > WORST + OF_TEXEL * texel_px || (inliers.median_px > CROWDED * bound && bound >= LEAST_BOUND)
    {
        return refuse(
            format!("a median error of {:.2} pixels over {} pixels", inliers.median_px, inliers.count),
            "one below a pixel: was anything moved between the photographs, and are they in the order of the patterns?",
        );
    }
    Ok(Fit { correspondence, inliers, homography, fits, texel_px })
}

/// The mean side of a texel in the picture.
fn texel_px(correspondence: &Correspondence, texels: (usize, usize)) -> f64 {
    let Area { from, to } = correspondence.area();
    let [[a, b], [c, d]] = correspondence.slopes([0.5 * (from[0] + to[0]), 0.5 * (from[1] + to[1])]);
    1.0 / ((a * d - b * c).abs() * (texels.0 * texels.1) as f64).sqrt()
}

/// A candidate.
#[derive(Debug, Clone)]
struct Model {
    homography: Matrix3<f64>,
    back: Matrix3<f64>,
    area: Area,
    residual: Option<[[f64; TERMS]; 2]>,
}

impl Model {
    fn new(homography: Matrix3<f64>, area: Area) -> Option<Self> {
        let back = homography.try_inverse().filter(|m| m.iter().all(|v| v.is_finite()))?;
        Some(Self { homography, back, area, residual: None })
    }

    /// Distance in the picture between the pixel and where its place on the screen should be seen, to first order in the
    /// residual.
    fn error(&self, sighting: &Sighting) -> f64 {
        let [x, y] = sighting.pixel;
        let mut screen = sighting.screen;
        if let Some(residual) = &self.residual {
            let terms = monomials(self.area.place(sighting.pixel));
            for (at, of) in screen.iter_mut().zip(residual) {
                *at -= of.iter().zip(&terms).map(|(c, m)| c * m).sum::<f64>();
            }
        }
        let seen = self.back * Vector3::new(screen[0], screen[1], 1.0);
        let depth = self.homography.row(2).transpose().dot(&Vector3::new(x, y, 1.0));
        // Beyond the horizon nothing is seen.
        if depth <= 0.0 || seen.z * depth <= 0.0 {
            return f64::INFINITY;
        }
        (seen.x / seen.z - x).hypot(seen.y / seen.z - y)
    }

    fn count(&self, sightings: &[Sighting], bound: f64) -> usize {
        sightings.iter().filter(|s| self.error(s) < bound).count()
    }

    fn correspondence(&self) -> Result<Correspondence> {
        let rows = std::array::from_fn(|i| std::array::from_fn(|j| self.homography[(i, j)]));
        Correspondence::new(rows, self.area, self.residual)
    }
}

/// The homography that most sightings agree with.
fn ransac(sightings: &[Sighting], bound: f64) -> Option<Model> {
    let mut rng = Pcg32::seed_from_u64(1);
    let judges: Vec<Sighting> = if sightings.len() <= JUDGES {
        sightings.to_vec()
    } else {
        (0..JUDGES).map(|_| sightings[rng.random_range(0..sightings.len())]).collect()
    };
    let area = area(sightings.iter())?;
    let mut best: Option<(f64, Model)> = None;
    for _ in 0..TRIES {
        let four: [Sighting; 4] = std::array::from_fn(|_| sightings[rng.random_range(0..sightings.len())]);
        let Some(model) = through(&four).and_then(|homography| Model::new(homography, area)) else { continue };
        let cost = judges.iter().map(|s| (model.error(s) / bound).powi(2).min(1.0)).sum::<f64>();
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, model));
        }
    }
    best.map(|(_, model)| model)
}

/// The homography that takes four pixels to their places, positive where they are.
fn through(four: &[Sighting; 4]) -> Option<Matrix3<f64>> {
    let frame = |points: [[f64; 2]; 4]| -> Option<Matrix3<f64>> {
        let column = |[x, y]: [f64; 2]| Vector3::new(x, y, 1.0);
        let three = Matrix3::from_columns(&[column(points[0]), column(points[1]), column(points[2])]);
        let scale = three.lu().solve(&column(points[3]))?;
        // Three of them on a line.
        let apart = scale.iter().all(|s| s.abs() > 1e-6 && s.is_finite());
        apart.then(|| three * Matrix3::from_diagonal(&scale))
    };
    let (from, to) = (frame(four.map(|s| s.pixel))?, frame(four.map(|s| s.screen))?);
    let homography = to * from.try_inverse()?;
    facing(homography, four.iter())
}

/// The sign and scale that make the third row positive, where it is for all or for none of the pixels.
fn facing<'a>(homography: Matrix3<f64>, sightings: impl Iterator<Item = &'a Sighting>) -> Option<Matrix3<f64>> {
    let (mut least, mut most, mut sum) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
    for sighting in sightings {
        let [x, y] = sighting.pixel;
        let depth = homography[(2, 0)] * x + homography[(2, 1)] * y + homography[(2, 2)];
        (least, most, sum) = (least.min(depth), most.max(depth), sum + depth);
    }
    (least > 0.0 || most < 0.0).then(|| homography / homography[(2, 2)].abs().max(1e-300) * sum.signum())
}

/// Takes turns: least squares over the inliers, inliers of what was found, with a bound that falls. The last bound comes with
/// the model.
fn refine(sightings: &[Sighting], mut model: Model, first: f64) -> Option<(Model, f64)> {
    let mut bound = first;
    for round in 0..ROUNDS {
        let inliers: Vec<&Sighting> = sightings.iter().filter(|s| model.error(s) < bound).collect();
        if inliers.len() < FEWEST {
            return None;
        }
        let area = area(inliers.iter().copied())?;
        // A residual over a few pixels at one place would say nothing elsewhere: first the homography finds them all.
        let mut next = Model::new(least_squares(&inliers)?, area)?;
        if round > 0 {
            next.residual = residual(&inliers, &next);
        }
        model = next;
        let errors = inliers.iter().map(|s| model.error(s)).collect();
        bound = (WIDE * Spread::of(errors)?.median_px).clamp(0.5, first);
    }
    Some((model, bound))
}

/// What the sightings cover.
fn area<'a>(sightings: impl Iterator<Item = &'a Sighting>) -> Option<Area> {
    let mut area = Area { from: [f64::INFINITY; 2], to: [f64::NEG_INFINITY; 2] };
    for sighting in sightings {
        for i in 0..2 {
            area.from[i] = area.from[i].min(sighting.pixel[i] - 0.5);
            area.to[i] = area.to[i].max(sighting.pixel[i] + 0.5);
        }
    }
    (area.from[0] < area.to[0] && area.from[1] < area.to[1]).then_some(area)
}

/// The homography of least squares by the direct linear transform, both sides normalised (Hartley 1997), reweighted by the
/// depth so that errors count as they do on the screen.
fn least_squares(sightings: &[&Sighting]) -> Option<Matrix3<f64>> {
    let (from, to) = (normal(sightings.iter().map(|s| s.pixel)), normal(sightings.iter().map(|s| s.screen)));
    let mut homography: Option<Matrix3<f64>> = None;
    for _ in 0..3 {
        let mut gram = SMatrix::<f64, 9, 9>::zeros();
        for sighting in sightings {
            let at = |m: &Matrix3<f64>, p: [f64; 2]| m * Vector3::new(p[0], p[1], 1.0);
            let (p, q) = (at(&from, sighting.pixel), at(&to, sighting.screen));
            let depth = homography.as_ref().map_or(1.0, |h| (h.row(2) * p)[0]);
            for (axis, place) in [q.x, q.y].into_iter().enumerate() {
                let mut row = SVector::<f64, 9>::zeros();
                for i in 0..3 {
                    row[3 * axis + i] = p[i] / depth;
                    row[6 + i] = -place * p[i] / depth;
                }
                gram.ger(1.0, &row, &row, 1.0);
            }
        }
        let eigen = SymmetricEigen::new(gram);
        let least = eigen.eigenvalues.imin();
        let h = eigen.eigenvectors.column(least);
        homography = Some(Matrix3::from_fn(|i, j| h[3 * i + j]));
    }
    let homography = to.try_inverse()? * homography? * from;
    facing(homography, sightings.iter().copied())
}

/// Brings points to the middle 0 and the mean distance sqrt 2.
fn normal(points: impl Iterator<Item = [f64; 2]> + Clone) -> Matrix3<f64> {
    let count = points.clone().count().max(1) as f64;
    let (x, y) = points.clone().fold((0.0, 0.0), |(x, y), p| (x + p[0] / count, y + p[1] / count));
    let spread = points.map(|p| (p[0] - x).hypot(p[1] - y) / count).sum::<f64>().max(1e-300);
    let s = std::f64::consts::SQRT_2 / spread;
    Matrix3::new(s, 0.0, -s * x, 0.0, s, -s * y, 0.0, 0.0, 1.0)
}

/// The cubic of least squares through what the homography leaves.
fn residual(sightings: &[&Sighting], model: &Model) -> Option<[[f64; TERMS]; 2]> {
    let mut gram = SMatrix::<f64, TERMS, TERMS>::zeros();
    let mut right = [SVector::<f64, TERMS>::zeros(); 2];
    for sighting in sightings {
        let [x, y] = sighting.pixel;
        let seen = model.homography * Vector3::new(x, y, 1.0);
        let terms = SVector::from(monomials(model.area.place(sighting.pixel)));
        gram.ger(1.0, &terms, &terms, 1.0);
        right[0] += terms * (sighting.screen[0] - seen.x / seen.z);
        right[1] += terms * (sighting.screen[1] - seen.y / seen.z);
    }
    // So that what hardly any sighting tells (a screen seen in a narrow frame around the object) stays small.
    let ridge = 1e-6 * gram.trace();
    gram += SMatrix::identity() * ridge;
    let factor = gram.cholesky()?;
    Some(right.map(|right| factor.solve(&right).into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (320, 240);

    /// Screen at an angle, lens that bends by up to 3 pixels.
    fn truth() -> Correspondence {
        let homography = [[0.0031, 0.0002, -0.05], [-0.0001, 0.0042, -0.04], [0.0002, -0.0003, 1.0]];
        let area = Area { from: [0.0, 0.0], to: [320.0, 240.0] };
        let bend = 0.006;
        let residual = [
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, bend, 0.0, bend, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, bend, 0.0, bend],
        ];
        Correspondence::new(homography, area, Some(residual)).unwrap()
    }

    /// Every second pixel, rounded to texels; in an ellipse in the middle they see elsewhere.
    fn sightings(texels: Option<(usize, usize)>) -> Vec<Sighting> {
        let truth = truth();
        let mut all = Vec::new();
        for y in (0..SIZE.1).step_by(2) {
            for x in (0..SIZE.0).step_by(2) {
                let pixel = [x as f64 + 0.5, y as f64 + 0.5];
                let inside = ((pixel[0] - 150.0) / 110.0).hypot((pixel[1] - 130.0) / 90.0) < 1.0;
                let seen = if inside { [310.0 - 0.9 * pixel[0], 230.0 - 0.8 * pixel[1]] } else { pixel };
                let mut screen = truth.screen_of(seen);
                if let Some((columns, rows)) = texels {
                    screen = [(screen[0], columns), (screen[1], rows)]
                        .map(|(at, side)| ((at * side as f64).floor() + 0.5) / side as f64);
                }
                if screen.iter().all(|at| (0.0..1.0).contains(at)) {
                    all.push(Sighting { pixel, screen });
                }
            }
        }
        all
    }

    #[test]
    fn exact_places_give_the_truth_past_a_third_of_outliers() {
        let (found, truth) = (fit(&sightings(None), SIZE, (10_000, 10_000)).unwrap(), truth());
        assert!(found.inliers.median_px < 0.01 && found.homography.median_px > 0.1, "{found:?}");
        for (x, y) in [(20.0, 30.0), (300.0, 200.0), (160.0, 120.0), (300.0, 30.0)] {
            let (a, b) = (truth.screen_of([x, y]), found.correspondence.screen_of([x, y]));
            assert!((a[0] - b[0]).abs() < 1e-4 && (a[1] - b[1]).abs() < 1e-4, "{a:?} {b:?}");
        }
    }

    #[test]
    fn rounding_to_texels_averages_out() {
        let texels = (64, 48);
        let found = fit(&sightings(Some(texels)), SIZE, texels).unwrap();
        let truth = truth();
        // Texels of 5 pixels; the fit is far better than the rounding.
        assert!(found.texel_px > 4.0 && found.inliers.median_px > 1.0, "{:?}", found.inliers);
        let off = |x: f64, y: f64| {
            let back = found.correspondence.pixel_of(truth.screen_of([x, y])).unwrap();
            (back[0] - x).hypot(back[1] - y)
        };
        let errors = Spread::of((0..200).map(|n| off(25.0 + 1.4 * f64::from(n), 30.0)).collect()).unwrap();
        assert!(errors.median_px < 0.3 && errors.most_px < 0.6, "{errors:?}");
    }

    #[test]
    fn what_is_no_screen_is_refused() {
        let all = sightings(None);
        let refused = |sightings: &[Sighting], words: &str| {
            let message = fit(sightings, SIZE, (64, 48)).unwrap_err().to_string();
            assert!(message.contains(words), "{message}");
        };
        refused(&all[..50], "50 pixels");
        let mut rng = Pcg32::seed_from_u64(3);
        let random = |s: &Sighting, rng: &mut Pcg32| Sighting { screen: [rng.random(), rng.random()], ..*s };
        let shuffled: Vec<Sighting> = all.iter().map(|s| random(s, &mut rng)).collect();
        refused(&shuffled, "do not agree");
        let blurred: Vec<Sighting> = all
            .iter()
            .map(|s| Sighting { screen: s.screen.map(|at| at + 0.025 * (rng.random::<f64>() - 0.5)), ..*s })
            .collect();
        let message = fit(&blurred, SIZE, (10_000, 10_000)).unwrap_err().to_string();
        assert!(message.contains("median error"), "{message}");
        let one_row: Vec<Sighting> = all.iter().map(|s| Sighting { screen: [s.screen[0], 0.5], ..*s }).collect();
        assert!(fit(&one_row, SIZE, (64, 48)).is_err());
    }
}
