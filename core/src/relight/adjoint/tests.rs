//! `<T l, c> = <l, T^T c>` for every representation of every rig, against plain loops, and whatever the threads.

use std::ops::Range;
use std::path::{Path, PathBuf};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::super::{Look, Weights, element};
use super::*;
use crate::domain::{Directions, Domain, Filter, Gantry, Plane};
use crate::field::compress::{Scheme, compress};
use crate::field::{
    Access, BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Bands, BlockTerms, Contents, Precision, TermBands, TermBasis,
    write, write_explicit, write_terms,
};
use crate::image::Window;
use crate::math::Vec3;
use crate::reconstruct::Method;
use crate::wavelet::Wavelet;

/// Of the pictures: neither side is whole blocks, and there are several tiles.
const SIZE: (usize, usize) = (70, 37);

/// Some `T`, smooth with a little noise, a different number everywhere.
fn transport(x: usize, y: usize, c: usize, element: usize) -> f32 {
    let (x, y, j) = (x as f32 * 0.13, y as f32 * 0.21, element as f32 * 0.7 + c as f32);
    let noise = ((x * 91.7 + y * 37.3 + j * 17.1).sin() * 4375.85).fract().abs();
    1.0 + (x + 0.3 * j).sin() * (y - 0.4 * j).cos() + 0.05 * noise
}

/// A source of [`transport`] for so many elements.
struct Formula(usize);

impl Bands for Formula {
    fn fill(&mut self, by: usize, columns: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        for (n, out) in blocks.iter_mut().enumerate() {
            let (k, rest) = (n % BLOCK_PIXELS, n / BLOCK_PIXELS);
            let (element, rest) = (rest % self.0, rest / self.0);
            let (x, y) =
                ((columns.start + rest / 3) * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
            if x < SIZE.0 && y < SIZE.1 {
                *out = transport(x, y, rest % 3, element);
            }
        }
        Ok(())
    }
}

/// Some terms, of this many locations: up to nine a pixel.
struct Chance(usize, Pcg64Mcg);

impl TermBands for Chance {
    fn fill(&mut self, bx: usize, by: usize, block: &mut BlockTerms) -> Result<()> {
        let Self(locations, rng) = self;
        for (k, count) in block.counts.iter_mut().enumerate() {
            let (x, y) = (bx * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
            if x < SIZE.0 && y < SIZE.1 {
                *count = rng.random_range(0..10);
                for _ in 0..*count {
                    block.locations.push(rng.random_range(0..*locations as u32));
                    block.coefficients.push(std::array::from_fn(|_| rng.random_range(-0.5..2.0)));
                }
            }
        }
        Ok(())
    }
}

fn contents(domain: impl Into<Domain>, precision: Precision) -> Contents {
    let domain: Domain = domain.into();
    let strengths = match &domain {
        Domain::Directions(lamps) => lamps.len(),
        Domain::Plane(..) => 0,
        Domain::Gantry(gantry) => gantry.poses().len(),
    };
    Contents {
        irradiance: vec![1.0; strengths],
        domain,
        width: SIZE.0,
        height: SIZE.1,
        colour_space: Default::default(),
        precision,
        largest: 4.0,
        ambient: None,
        alpha: None,
        reliability: None,
        provenance: serde_json::Value::Null,
    }
}

fn lamps() -> Directions {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let lamp = |k: usize| {
        let y = 1.0 - (2 * k + 1) as f64 / 26.0;
        let (r, (s, c)) = ((1.0 - y * y).sqrt(), (golden * k as f64).sin_cos());
        Vec3::new(r * c, y, r * s)
    };
    Directions::new((0..26).map(lamp).collect()).unwrap()
}

fn gantry() -> Gantry {
    let places = [Vec3::new(0.0, 0.5, 4.0), Vec3::new(3.0, 3.0, 1.0), Vec3::new(-3.0, 2.0, 2.0)];
    Gantry::looking_at_origin(&places, 4, 0.6, Filter::Box).unwrap()
}

fn screen() -> Domain {
    Domain::Plane(Plane::new(8, 4).unwrap(), None)
}

/// Every representation of every rig, opened either way.
fn fields(folder: &Path) -> Vec<(Asset, Kind)> {
    let path = |name: &str| folder.join(format!("{name}.rfield"));
    let mut made: Vec<(PathBuf, Kind)> = Vec::new();
    let mut samples = |name: &str, domain: Domain, precision: Precision| {
        let elements = domain.len();
        write(&path(name), &contents(domain, precision), &mut Formula(elements)).unwrap();
        made.push((path(name), Kind::Dense));
        path(name)
    };
    let stage = samples("stage", lamps().into(), Precision::Half);
    samples("stage-float", lamps().into(), Precision::Float);
    let plane = samples("plane", screen(), Precision::Float);
    let rig = samples("rig", gantry().into(), Precision::Half);
    let mut compressed = |from: &Path, name: &str, scheme: Scheme, kind: Kind| {
        let asset = Asset::open(from, Access::Mapped).unwrap();
        compress(&asset, &path(name), &scheme, &[], &mut |_, _, _| Ok(())).unwrap();
        made.push((path(name), kind));
    };
    let wavelets = |wavelet| Scheme::Wavelet {
        wavelet,
        grid: (16, 8),
        reconstruction: Method::ZeroOrder,
        error: None,
        terms: Some(12),
    };
    compressed(&stage, "stage-tiles", Scheme::Factored { error: 0.03 }, Kind::Factored);
    compressed(&stage, "stage-wavelet", wavelets(Wavelet::Daubechies97), Kind::Wavelet);
    compressed(&stage, "stage-harmonics", Scheme::Harmonics { functions: 16 }, Kind::Harmonics);
    compressed(&plane, "plane-tiles", Scheme::Factored { error: 0.03 }, Kind::Factored);
    compressed(&rig, "rig-tiles", Scheme::Factored { error: 0.03 }, Kind::Factored);
    for (name, domain, basis) in [
        ("plane-texels", screen(), TermBasis::Texels),
        ("plane-wavelet", screen(), TermBasis::Wavelet(Wavelet::LeGall53)),
        ("rig-wavelet", gantry().into(), TermBasis::Wavelet(Wavelet::Haar)),
    ] {
        let mut chance = Chance(domain.len(), Pcg64Mcg::seed_from_u64(5));
        write_terms(&path(name), &contents(domain, Precision::Half), (basis, None), &mut chance).unwrap();
        made.push((path(name), Kind::Wavelet));
    }
    let shown = [0, 1, 2, 3, 9, 17, 30];
    let explicit = (Wavelet::Daubechies97, &shown[..]);
    write_explicit(&path("explicit"), &contents(screen(), Precision::Half), explicit, &mut Formula(7)).unwrap();
    made.push((path("explicit"), Kind::Explicit));
    let access = |n: usize| if n.is_multiple_of(3) { Access::Read } else { Access::Mapped };
    made.iter().enumerate().map(|(n, (path, kind))| (Asset::open(path, access(n)).unwrap(), *kind)).collect()
}

/// `T l`, RGB.
fn forward(asset: &Asset, kind: Kind, rgb: &[[f32; 3]]) -> Image {
    let coefficients = match kind {
        Kind::Wavelet => Some(asset.sparse().unwrap().transformed(rgb)),
        Kind::Harmonics => Some(asset.harmonics().unwrap().moments(rgb)),
        Kind::Explicit => Some(asset.explicit().unwrap().expanded(rgb)),
        Kind::Dense | Kind::Factored => None,
    };
    let weights = Weights { rgb: rgb.to_vec(), kind, coefficients };
    let look = Look { ambient: 0.0, ..Look::default() };
    let window = Window::full(asset.width(), asset.height());
    element::many(asset, &[(&weights, &look)], window).unwrap().pop().unwrap().into_rgb()
}

fn backward(asset: &Asset, kind: Kind, lit: &Image) -> Vec<[f32; 3]> {
    let all = 0..elements_of(asset, kind).unwrap();
    adjoint(asset, kind, &[lit], all, &mut |_, _| Ok(())).unwrap().pop().unwrap()
}

fn picture(rng: &mut Pcg64Mcg, from: f32) -> Image {
    Image::from_fn(SIZE.0, SIZE.1, |_, _| std::array::from_fn(|_| rng.random_range(from..1.0)))
}

fn light(rng: &mut Pcg64Mcg, elements: usize, from: f32) -> Vec<[f32; 3]> {
    (0..elements).map(|_| std::array::from_fn(|_| rng.random_range(from..1.0))).collect()
}

/// Inner product and the product of the norms.
fn inner(a: &[f32], b: &[f32]) -> (f64, f64) {
    let product = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    (product(a, b), (product(a, a) * product(b, b)).sqrt())
}

/// Of light and pictures without negative numbers the difference is held against the value itself; of random signs, which cancel,
/// against the product of the norms, as single precision allows no more there.
#[test]
fn it_is_the_adjoint_of_relighting() {
    let folder = tempfile::tempdir().unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    for (asset, kind) in fields(folder.path()) {
        let elements = elements_of(&asset, kind).unwrap();
        for from in [0.0, -1.0] {
            let (l, c) = (light(&mut rng, elements, from), picture(&mut rng, from));
            let (tl, ttc) = (forward(&asset, kind, &l), backward(&asset, kind, &c));
            let (there, norms) = inner(tl.data(), c.data());
            let (back, _) = inner(l.as_flattened(), ttc.as_flattened());
            let against = if from < 0.0 { norms } else { there.abs() };
            let off = (there - back).abs() / against;
            assert!(off < 1e-5, "{} from {from}: {there} and {back}, off by {off}", asset.path().display());
        }
    }
}

/// Every element against `sum over pixels of T_j c` in double precision, `T_j` as relighting by that element alone shows it; white
/// pictures give the sums of rows.
#[test]
fn each_element_is_the_sum_over_its_photograph() {
    let folder = tempfile::tempdir().unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let white = Image::from_fn(SIZE.0, SIZE.1, |_, _| [1.0; 3]);
    for (asset, kind) in fields(folder.path()) {
        let elements = elements_of(&asset, kind).unwrap();
        let c = picture(&mut rng, -1.0);
        let found = [backward(&asset, kind, &c), backward(&asset, kind, &white)];
        for j in (0..elements).step_by(3) {
            let mut one = vec![[0.0; 3]; elements];
            one[j] = [1.0; 3];
            let column = forward(&asset, kind, &one);
            for (lit, found) in [&c, &white].into_iter().zip(&found) {
                let (mut sum, mut size) = ([0.0f64; 3], [0.0f64; 3]);
                for (t, c) in column.data().chunks(3).zip(lit.data().chunks(3)) {
                    for k in 0..3 {
                        let product = f64::from(t[k]) * f64::from(c[k]);
                        (sum[k], size[k]) = (sum[k] + product, size[k] + product.abs());
                    }
                }
                for k in 0..3 {
                    let off = (f64::from(found[j][k]) - sum[k]).abs();
                    let place = asset.path().display();
                    assert!(off <= 1e-5 * size[k] + 1e-6, "{place}, {j}: {} is not {}", found[j][k], sum[k]);
                }
            }
        }
    }
}

#[test]
fn threads_and_parts_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    for (asset, kind) in fields(folder.path()) {
        let elements = elements_of(&asset, kind).unwrap();
        let (a, b) = (picture(&mut rng, 0.0), picture(&mut rng, 0.0));
        let all = backward(&asset, kind, &a);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert_eq!(pool.install(|| backward(&asset, kind, &a)), all, "{}", asset.path().display());
        let some = adjoint(&asset, kind, &[&b, &a], 3..elements - 2, &mut |_, _| Ok(())).unwrap();
        for (found, wanted) in some[1].iter().zip(&all[3..elements - 2]) {
            // Of several pictures, terms are added up in another order.
            (0..3).for_each(|c| assert!((found[c] - wanted[c]).abs() <= 1e-5 * wanted[c].abs() + 1e-6));
        }
        assert_eq!((some.len(), some[0].len()), (2, elements - 5));
        assert!(adjoint(&asset, kind, &[&a], 4..4, &mut |_, _| Ok(())).unwrap()[0].is_empty());
        assert!(adjoint(&asset, kind, &[], 0..4, &mut |_, _| Ok(())).unwrap().is_empty());
    }
}

/// A pixel alone gives its row: what is read of the others does not matter.
#[test]
fn one_pixel_gives_its_row() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rfield");
    write(&path, &contents(gantry(), Precision::Float), &mut Formula(48)).unwrap();
    let asset = Asset::open(&path, Access::Mapped).unwrap();
    let mut lit = Image::new(SIZE.0, SIZE.1, 3);
    lit.pixel_mut(69, 36).copy_from_slice(&[1.0, 2.0, 4.0]);
    for (j, rgb) in backward(&asset, Kind::Dense, &lit).iter().enumerate() {
        (0..3).for_each(|c| assert_eq!(rgb[c], transport(69, 36, c, j) * [1.0, 2.0, 4.0][c]));
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rfield");
    write(&path, &contents(gantry(), Precision::Float), &mut Formula(48)).unwrap();
    let asset = Asset::open(&path, Access::Mapped).unwrap();
    let good = Image::new(SIZE.0, SIZE.1, 3);
    let mut bad = good.clone();
    bad.pixel_mut(2, 1)[1] = f32::NAN;
    for (kind, lit, elements, words) in [
        (Kind::Dense, Image::new(37, 70, 3), 0..48, "37 x 70"),
        (Kind::Dense, Image::new(37, 70, 3), 0..48, "70 x 37"),
        (Kind::Dense, bad, 0..48, "pixel (2, 1)"),
        (Kind::Dense, good.clone(), 0..49, "0..48"),
        (Kind::Wavelet, good.clone(), 0..48, "no `wavelet` representation"),
    ] {
        let message = adjoint(&asset, kind, &[&lit], elements, &mut |_, _| Ok(())).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    }
    let stopped = adjoint(&asset, Kind::Dense, &[&good], 0..48, &mut |_, _| Err(Error::Cancelled));
    assert!(matches!(stopped, Err(Error::Cancelled)));
}

/// NaN in a file that somebody changed is found, and named.
#[test]
fn damage_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rfield");
    write(&path, &contents(gantry(), Precision::Float), &mut Formula(48)).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let number = transport(5, 3, 0, 7).to_le_bytes();
    let at = bytes.windows(4).position(|four| four == number).unwrap();
    bytes[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(&path, bytes).unwrap();
    let asset = Asset::open(&path, Access::Mapped).unwrap();
    let white = Image::from_fn(SIZE.0, SIZE.1, |_, _| [1.0; 3]);
    let message = adjoint(&asset, Kind::Dense, &[&white], 0..48, &mut |_, _| Ok(())).unwrap_err().to_string();
    assert!(message.contains("element 8") && message.contains("verify"), "{message}");
}
