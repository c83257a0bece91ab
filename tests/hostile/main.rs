//! Seeded mutations of a container: opening, verifying and relighting any of them never panics, never allocates beyond a
//! bound and never reads out of bounds (a fault would end the process). A binary of its own, because its allocator counts.

use std::alloc::{GlobalAlloc, Layout, System};
use std::ops::Range;
use std::panic::catch_unwind;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use rand::{RngExt, SeedableRng};
use relume_core::Result;
use relume_core::domain::{Directions, Domain, Filter, Gantry};
use relume_core::field::compress::{Scheme, compress};
use relume_core::field::{
    Access, Asset, Bands, BlockTerms, Contents, Kind, Precision, TermBands, TermBasis, write, write_terms,
};
use relume_core::image::{Image, Window};
use relume_core::math::Vec3;
use relume_core::reconstruct::Method;
use relume_core::relight::{Dual, Light, Look, Relighter};
use relume_core::wavelet::Wavelet;

/// Counts what is allocated, and the most that ever was.
struct Counting;

static HELD: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is handed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let held = HELD.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        PEAK.fetch_max(held, Ordering::Relaxed);
        // SAFETY: the caller's promises are ours.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promises are ours.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Variants tried.
const VARIANTS: u64 = 3000;
/// What one may allocate: the container is 60 kB, its pictures are smaller.
const MOST_BYTES: usize = 64 << 20;

/// T = 1 / (1 + lamp).
struct Ramp;

impl Bands for Ramp {
    fn fill(&mut self, _: usize, _: Range<usize>, blocks: &mut [f32]) -> Result<()> {
        blocks.chunks_mut(128).enumerate().for_each(|(n, element)| element.fill(1.0 / (1 + n % 4) as f32));
        Ok(())
    }
}

/// A term in every pixel that there is, at locations 0 to 7 in turn.
struct Scattered;

impl TermBands for Scattered {
    fn fill(&mut self, bx: usize, by: usize, block: &mut BlockTerms) -> Result<()> {
        for (k, count) in block.counts.iter_mut().enumerate() {
            if bx * 16 + k % 16 < 40 && by * 8 + k / 16 < 30 {
                *count = 1;
                block.locations.push(k as u32 % 8);
                block.coefficients.push([0.5, 0.25, 1.0]);
            }
        }
        Ok(())
    }
}

fn contents(domain: Domain, strengths: usize) -> Contents {
    Contents {
        colour_space: Default::default(),
        domain,
        irradiance: vec![1.0; strengths],
        width: 40,
        height: 30,
        precision: Precision::Half,
        largest: 1.0,
        ambient: Some(Image::new(40, 30, 3)),
        alpha: Some(vec![1.0; 1200]),
        reliability: None,
        provenance: serde_json::json!({"source": "test"}),
    }
}

fn container(path: &Path) {
    let lamps = Directions::new(vec![Vec3::z(), Vec3::x(), Vec3::y(), -Vec3::x()]).unwrap();
    write(path, &contents(lamps.into(), 4), &mut Ramp).unwrap();
}

/// A projector's field: samples and tiles of low rank at `path`, terms at `terms`.
fn projector(path: &Path, terms: &Path) {
    let gantry = || {
        let places = [Vec3::new(0.0, 0.5, 4.0), Vec3::new(3.0, 3.0, 1.0)];
        contents(Gantry::looking_at_origin(&places, 2, 0.6, Filter::Box).unwrap().into(), 2)
    };
    write(path, &gantry(), &mut Ramp).unwrap();
    let asset = Asset::open(path, Access::Read).unwrap();
    compress(&asset, path, &Scheme::Factored { error: 0.01 }, &Kind::ALL, &mut |_, _, _| Ok(())).unwrap();
    write_terms(terms, &gantry(), (TermBasis::Wavelet(Wavelet::Haar), None), &mut Scattered).unwrap();
}

/// Every compact representation of a container, beside the samples.
fn compact(samples: &Path, path: &Path) {
    let wavelets = Scheme::Wavelet {
        wavelet: Wavelet::LeGall53,
        grid: (16, 8),
        reconstruction: Method::Linear,
        error: None,
        terms: Some(9),
    };
    std::fs::copy(samples, path).unwrap();
    for scheme in [Scheme::Factored { error: 0.01 }, Scheme::Harmonics { functions: 4 }, wavelets] {
        let asset = Asset::open(path, Access::Read).unwrap();
        compress(&asset, path, &scheme, &Kind::ALL, &mut |_, _, _| Ok(())).unwrap();
    }
}

/// One to four changes: flipped bits, runs overwritten, pieces cut out, doubled or truncated, numbers made huge; half of them
/// aimed at the directory and the manifest at the end, where the structure is.
fn mutated(original: &[u8], rng: &mut impl rand::Rng) -> Vec<u8> {
    let mut bytes = original.to_vec();
    for _ in 0..rng.random_range(1..=4) {
        if bytes.len() < 16 {
            break;
        }
        let tail = rng.random_bool(0.5);
        let first = if tail { bytes.len().saturating_sub(4000) } else { 0 };
        let at = rng.random_range(first..bytes.len() - 8);
        let length = rng.random_range(1..64).min(bytes.len() - at);
        match rng.random_range(0..8) {
            0 | 1 => bytes[at] ^= 1 << rng.random_range(0..8),
            2 => bytes[at..at + length].fill_with(|| rng.random()),
            3 => bytes[at..at + 8].fill(0xff),
            4 => bytes[at..at + 8].copy_from_slice(&(1u64 << rng.random_range(20..63)).to_le_bytes()),
            5 => bytes.truncate(at),
            6 => drop(bytes.drain(at..at + length)),
            _ => {
                let copy = bytes[at..at + length].to_vec();
                bytes.splice(at..at, copy);
            }
        }
    }
    bytes
}

/// All that a user does with a container.
fn used(path: &Path, access: Access) -> Result<()> {
    let asset = Asset::open(path, access)?;
    let verified = asset.verify(&mut |_, _| Ok(()));
    let (w, h) = (asset.width(), asset.height());
    let relighter = Relighter::new(asset).unwrap();
    for kind in Kind::ALL.into_iter().filter(|kind| relighter.asset().manifest().representation(*kind).is_some()) {
        let look = Look { representation: Some(kind), ambient: 1.0, ..Look::default() };
        let weights = relighter.weights(Light::Lamp(1), &look)?;
        relighter.render(&weights, &look, Window::full(w, h))?;
        relighter.asset().errors(kind)?;
        if relighter.gantry().is_some() {
            let white = Image::from_fn(w, h, |_, _| [1.0; 3]);
            let dual = Dual::new(relighter.asset(), true)?;
            dual.pictures(&white, kind, 0..dual.views(), &mut |_, _| Ok(()))?;
        }
    }
    verified
}

#[test]
fn mutated_containers_never_panic_or_over_allocate() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rfield");
    container(&path);
    let several = folder.path().join("b.rfield");
    compact(&path, &several);
    let (projected, terms) = (folder.path().join("c.rfield"), folder.path().join("d.rfield"));
    projector(&projected, &terms);
    let originals = [&path, &several, &projected, &terms].map(|path| {
        used(path, Access::Mapped).unwrap();
        std::fs::read(path).unwrap()
    });
    let (mut refused, mut accepted) = (0, 0);
    for seed in 0..VARIANTS {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        // A new file each time: a mapped one is never changed in place.
        let variant = folder.path().join(format!("{seed}.rfield"));
        std::fs::write(&variant, mutated(&originals[seed as usize / 2 % originals.len()], &mut rng)).unwrap();
        let access = if seed % 2 == 0 { Access::Mapped } else { Access::Read };
        let before = HELD.load(Ordering::Relaxed);
        PEAK.store(before, Ordering::Relaxed);
        let outcome = catch_unwind(|| used(&variant, access));
        let taken = PEAK.load(Ordering::Relaxed) - before;
        assert!(taken < MOST_BYTES, "variant {seed} allocated {taken} bytes");
        match outcome {
            Err(_) => panic!("variant {seed} panicked"),
            Ok(Err(error)) => {
                let sentence = error.to_string();
                assert!(
                    sentence.contains(&format!("{seed}.rfield")),
                    "variant {seed}: `{sentence}` does not name the file"
                );
                refused += 1;
            }
            Ok(Ok(())) => accepted += 1,
        }
        std::fs::remove_file(&variant).unwrap();
    }
    // Some changes cannot matter (padding, the ZIP's dates); nearly all must be noticed.
    assert!(refused > accepted * 4, "{refused} refused, {accepted} accepted");
}
