//! Terms of each pixel from patterns of noise (6.7), part by part.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use relume_core::acquire::implicit::{Dictionary, Edges, Options, Solver, Solving, Stop, TILE_ROWS};
use relume_core::field::{self, Access, Asset, Contents, Precision, TILES, TermBasis};
use relume_core::image::Image;
use relume_core::wavelet::Wavelet;
use relume_core::{Error, Result, acquire};

use super::emitted::Emitted;
use super::photographs::Photographs;
use super::view::{Ready, View};
use crate::progress::{Progress, Unit};
use crate::session::Photograph;

/// Pixels that are solved before they are put by: a minute or so.
const PART_PIXELS: usize = 1 << 18;
/// No coefficient of a function that is not negative is larger than its answer to white; halves are scaled for so many times
/// the largest photograph, noise and filters that overshoot included.
const HEADROOM: f32 = 16.0;

/// What is wanted.
#[derive(Debug, Clone, Copy)]
pub struct Wanted {
    /// Terms a pixel, at most.
    pub terms: usize,
    /// Whether a pixel gets fewer where more would model noise.
    pub stop: Stop,
    /// The wavelet of the terms; if nothing is said, that of the patterns.
    pub basis: Option<Wavelet>,
}

/// Everything that goes into the field.
pub struct ImplicitPack<'a> {
    /// The photographs.
    pub photographs: &'a Photographs<'a>,
    /// Those under the patterns, in their order.
    pub list: &'a [&'a Photograph],
    /// The patterns.
    pub emitted: &'a Emitted,
    /// Where pixels look.
    pub view: &'a View,
    /// The same, ready.
    pub ready: &'a Ready,
    /// What is wanted.
    pub wanted: Wanted,
}

impl ImplicitPack<'_> {
    /// Refuses what cannot be solved, before photographs are read.
    ///
    /// # Errors
    /// Photographs and patterns that do not pair; too few patterns; patterns without contrast.
    pub fn solver(&self) -> Result<Solver> {
        let (photographs, patterns) = (self.list.len(), self.emitted.patterns.len());
        if photographs != patterns {
            let found = format!("{photographs} photographs for {patterns} patterns");
            return Err(Error::invalid("the session", found, "one a pattern"));
        }
        field::check_elements(&self.view.domain(self.emitted.plane))?;
        let wavelet = self.wanted.basis.or(self.emitted.wavelet).unwrap_or(Wavelet::Haar);
        let dictionary = Dictionary::new(&self.emitted.plane.transform(wavelet)?, &self.emitted.patterns)?;
        Solver::new(Arc::new(dictionary), Options { terms: self.wanted.terms, stop: self.wanted.stop })
    }

    /// Writes the field, or the `tiles` of it (from 0) as a part beside it; returns what was written. Parts of a large field
    /// that an earlier run has finished are not solved again.
    ///
    /// # Errors
    /// Files that are gone or changed; tiles that there are not; no room.
    pub fn write(
        &self,
        output: &Path,
        tiles: Option<Range<usize>>,
        mut provenance: serde_json::Map<String, serde_json::Value>,
    ) -> Result<PathBuf> {
        let solver = self.solver()?;
        let size = self.photographs.size();
        let all = size.1.div_ceil(TILE_ROWS);
        let parts = match &tiles {
            Some(tiles) if tiles.is_empty() || tiles.end > all => {
                let found = format!("{}-{}", tiles.start + 1, tiles.end);
                let expected = format!("some of 1-{all}: the picture has {all} tiles, rows of {TILE_ROWS} pixels");
                return Err(Error::invalid("--tiles", found, expected));
            }
            Some(tiles) => vec![tiles.clone()],
            None => parts_of(size, all),
        };
        let mut progress = Progress::new("reading photographs", Unit::Steps);
        let take_out = |n: usize, picture: &mut Image| {
            self.ready.of_object(picture, &self.emitted.patterns[n].values);
        };
        let step = &mut |done, all| progress.step(done, all);
        let mut gathered = self.photographs.gathered(self.list, output, &take_out, step)?;
        drop(progress);
        let mut progress = Progress::new("soft edges", Unit::Steps);
        let of_edges = (self.ready.edges(), &self.emitted.patterns[..]);
        let step = &mut |done, all| progress.step(done, all);
        let edges = Edges::measured(&solver, &mut gathered, size, of_edges, step)?;
        drop(progress);
        provenance.insert("terms".to_owned(), self.wanted.terms.into());
        provenance.insert("stop".to_owned(), (self.wanted.stop == Stop::On).into());
        provenance.insert("basis".to_owned(), solver.dictionary().transform().wavelet().id().into());
        provenance.insert("white".to_owned(), serde_json::json!(self.ready.unit));
        let mut ambient = self.photographs.black().cloned();
        ambient.iter_mut().for_each(|ambient| self.ready.in_units(ambient));
        let contents = Contents {
            domain: self.view.domain(self.emitted.plane),
            irradiance: Vec::new(),
            width: size.0,
            height: size.1,
            colour_space: self.photographs.colour_space(),
            precision: Precision::Half,
            largest: HEADROOM * gathered.largest().max(f32::MIN_POSITIVE),
            ambient,
            alpha: self.coverage(&edges),
            reliability: None,
            provenance: serde_json::Value::Object(provenance),
        };
        let job = Job { pack: self, solver: &solver, edges: &edges, contents };
        match (&parts[..], tiles) {
            ([only], None) => job.solve(output, only.clone(), &mut gathered, None).map(|()| output.to_owned()),
            ([only], Some(_)) => {
                let path = part_path(output, only);
                job.solve(&path, only.clone(), &mut gathered, Some(all)).map(|()| path)
            }
            (parts, _) => job.in_parts(output, parts, all, &mut gathered).map(|()| output.to_owned()),
        }
    }

    /// Alpha less what more is seen of the screen.
    fn coverage(&self, edges: &Edges) -> Option<Vec<f32>> {
        let more = |pixel: usize| edges.more(pixel).iter().map(|(_, share)| share).sum::<f32>();
        let alpha = self.view.alpha.as_ref()?;
        Some(alpha.iter().enumerate().map(|(pixel, alpha)| (alpha - more(pixel)).clamp(0.0, 1.0)).collect())
    }
}

/// A field being solved.
struct Job<'a> {
    pack: &'a ImplicitPack<'a>,
    solver: &'a Solver,
    edges: &'a Edges,
    contents: Contents,
}

impl Job<'_> {
    /// Solves some tiles into a container: a part of `all`, or the whole.
    fn solve(
        &self,
        path: &Path,
        tiles: Range<usize>,
        gathered: &mut acquire::Photographs,
        all: Option<usize>,
    ) -> Result<()> {
        let mut contents = self.contents.clone();
        if let (Some(all), serde_json::Value::Object(provenance)) = (all, &mut contents.provenance) {
            provenance.insert(TILES.to_owned(), serde_json::json!([tiles.start + 1, tiles.end, all]));
        }
        let mut progress = Progress::new("solving tiles", Unit::Steps);
        let (width, size) = (contents.width, self.pack.photographs.size());
        let wanted = |x: usize, y: usize| self.pack.view.covered(y * width + x);
        let step = &mut |done, all| progress.step(done, all);
        let mut bands = Solving::new(self.solver, gathered, (size, tiles), (&wanted, self.edges), step)?;
        let wavelet = self.solver.dictionary().transform().wavelet();
        field::write_terms(path, &contents, (TermBasis::Wavelet(wavelet), Some(self.pack.wanted.terms)), &mut bands)
    }

    /// Solves one part after another, and merges them.
    fn in_parts(
        &self,
        output: &Path,
        parts: &[Range<usize>],
        all: usize,
        gathered: &mut acquire::Photographs,
    ) -> Result<()> {
        let paths: Vec<PathBuf> = parts.iter().map(|tiles| part_path(output, tiles)).collect();
        for (tiles, path) in parts.iter().zip(&paths) {
            if !self.is_done(path, tiles, all) {
                self.solve(path, tiles.clone(), gathered, Some(all))?;
            }
        }
        let open: Vec<Asset> = paths.iter().map(|path| Asset::open(path, Access::Read)).collect::<Result<_>>()?;
        let mut progress = Progress::new("merging", Unit::Steps);
        field::merge(&open, output, &mut |done, all| progress.step(done, all))?;
        drop(open);
        for path in paths {
            fs::remove_file(&path).map_err(|source| Error::io("remove", &path, source))?;
        }
        Ok(())
    }

    /// Has an earlier run solved this part, from the same photographs and in the same way?
    fn is_done(&self, path: &Path, tiles: &Range<usize>, all: usize) -> bool {
        let Ok(asset) = Asset::open(path, Access::Read) else { return false };
        let (manifest, own) = (asset.manifest(), &self.contents.provenance);
        let same = |(name, value): (&String, &serde_json::Value)| manifest.provenance.get(name) == Some(value);
        field::tiles_of(&asset).is_ok_and(|told| told == Some((tiles.clone(), all)))
            && own.as_object().is_some_and(|own| own.iter().all(same))
            && manifest.tool == concat!("relume ", env!("CARGO_PKG_VERSION"))
            && asset.verify(&mut |_, _| Ok(())).is_ok()
    }
}

/// `A.rfield.part-A-B`, tiles from 1.
pub fn part_path(output: &Path, tiles: &Range<usize>) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(format!(".part-{}-{}", tiles.start + 1, tiles.end));
    name.into()
}

/// All tiles in parts of about [`PART_PIXELS`].
fn parts_of((width, _): (usize, usize), all: usize) -> Vec<Range<usize>> {
    let together = (PART_PIXELS / (width * TILE_ROWS)).max(1);
    (0..all).step_by(together).map(|first| first..(first + together).min(all)).collect()
}
