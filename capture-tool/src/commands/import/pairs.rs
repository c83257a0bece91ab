//! `relume import pairs`: patterns and the photographs under them -> a session.

use std::path::{Path, PathBuf};

use clap::Args;
use relume_core::Error;
use relume_core::domain::patterns;
use relume_core::image::layers::natural;
use relume_core::image::{ColourSpace, probe_size};

use super::EncodingChoice;
use crate::commands::patterns::{DESCRIPTION, Description, Encode};
use crate::commands::{note, values};
use crate::new_folder;
use crate::progress::{Progress, Unit};
use crate::session::pairs::{Emitted, Pairs, stage};

const EXAMPLES: &str = "\
Examples:
  relume patterns noise -o noise --size 128x128 --count 512
  relume import pairs --patterns noise --photos photographs --black black.exr --session vase-session
  relume import pairs --patterns shown --photos photographs --emitted gamma.txt --texel 8 --session vase-session

Pictures of both folders are paired in the order of their names, numbers in them by value; brackets
are merged to one picture a pattern first (see `relume hdr --help`). A pattern stands for the light
that its codes became, less that of code 0, averaged over each texel; so photograph the object under
a black picture as well (--black). Folders that `relume patterns` wrote tell how their codes become
light; for others say so with --emitted.";

/// Files that are pictures, by extension.
const PICTURES: [&str; 7] = ["exr", "hdr", "png", "tif", "tiff", "jpg", "jpeg"];

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct PairsArguments {
    /// The folder of the pictures that were shown.
    #[arg(long, value_name = "DIR")]
    patterns: PathBuf,
    /// The folder of the photographs, one a pattern.
    #[arg(long, value_name = "DIR")]
    photos: PathBuf,
    /// The session folder to make.
    #[arg(long, value_name = "DIR")]
    session: PathBuf,
    /// What the emitter made of the patterns' codes: linear, srgb, or a table of measured light [default: as the folder of
    /// the patterns tells, or srgb].
    #[arg(long, value_name = "linear|srgb|TABLE")]
    emitted: Option<String>,
    /// Pixels of the patterns along each side of a texel [default: as the folder of the patterns tells, or 1].
    #[arg(long, value_name = "PIXELS", value_parser = values::at_least_one)]
    texel: Option<usize>,
    /// The photograph under a black picture; it is subtracted from the others.
    #[arg(long, value_name = "IMG")]
    black: Option<PathBuf>,
    /// The photograph under a white picture.
    #[arg(long, value_name = "IMG")]
    white: Option<PathBuf>,
    /// How the photographs' numbers become light [default: sRGB for 8 and 16 bits, linear for floats].
    #[arg(long, value_enum)]
    encoding: Option<EncodingChoice>,
    /// The colour space of the photographs, once decoded to light: lin_rec709, lin_rec2020, acescg, aces2065_1 or lin_p3d65.
    #[arg(long, value_name = "SPACE", value_parser = values::colour_space, default_value_t = ColourSpace::default())]
    colour_space: ColourSpace,
}

/// Checked flags.
#[derive(Debug)]
struct Plan {
    pairs: Pairs,
    encode: Encode,
    session: PathBuf,
}

impl PairsArguments {
    /// Imports.
    pub fn run(self) -> anyhow::Result<String> {
        self.plan()?.carry_out()
    }

    /// Refuses what headers and names show to fail.
    fn plan(self) -> anyhow::Result<Plan> {
        new_folder::check(&self.session)?;
        let (shown, photographs) = (pictures(&self.patterns)?, pictures(&self.photos)?);
        if shown.len() != photographs.len() {
            let found = format!(
                "{} photographs for the {} patterns in {}",
                photographs.len(),
                shown.len(),
                self.patterns.display()
            );
            let expected = "one a pattern (black and white photographs lie elsewhere: --black, --white)";
            return Err(Error::invalid(self.photos.display().to_string(), found, expected).into());
        }
        let told = Description::of_folder(&self.patterns)?;
        let encode = self.emitted(told.as_ref())?;
        let texel = self.texel.or(told.as_ref().map(|told| told.texel)).unwrap_or(1);
        let pixels = one_size(shown.iter())?;
        if texel == 0 || !pixels.0.is_multiple_of(texel) || !pixels.1.is_multiple_of(texel) {
            let expected = format!("sides that are multiples of a texel's {texel} pixels");
            let found = format!("{} x {} pixels", pixels.0, pixels.1);
            return Err(Error::invalid(self.patterns.display().to_string(), found, expected).into());
        }
        let size = one_size(photographs.iter().chain(&self.black).chain(&self.white))?;
        let emitted = match &encode.table {
            Some(table) => Emitted::Table(table.clone()),
            None => Emitted::Known(encode.id().to_owned()),
        };
        let description = told.is_some().then(|| self.patterns.join(DESCRIPTION));
        let pairs = Pairs {
            patterns: shown,
            photographs,
            black: self.black,
            white: self.white,
            description,
            set: told.map_or_else(|| "pairs".to_owned(), |told| told.kind),
            emitted,
            texel,
            plane: (pixels.0 / texel, pixels.1 / texel),
            size,
            encoding: format!("{:?}", EncodingChoice::of(self.encoding)).to_lowercase(),
            colour_space: self.colour_space.id().to_owned(),
        };
        Ok(Plan { pairs, encode, session: self.session })
    }

    /// The emitter's curve: as said, as the patterns' folder tells, or sRGB.
    fn emitted(&self, told: Option<&Description>) -> anyhow::Result<Encode> {
        if let Some(said) = &self.emitted {
            return Encode::parse(said);
        }
        let Some(told) = told else { return Encode::parse("srgb") };
        match told.encode.as_str() {
            "linear" | "srgb" => Encode::parse(&told.encode),
            "codes" => anyhow::bail!(
                "{}: these patterns measure the emitter's curve, so their light is not known; say what it is with --emitted",
                self.patterns.display()
            ),
            table => Encode::parse(&self.patterns.join(table).to_string_lossy()),
        }
    }
}

impl Plan {
    /// Reads every pattern, as who solves will, then copies.
    fn carry_out(&self) -> anyhow::Result<String> {
        let (pairs, count) = (&self.pairs, self.pairs.patterns.len());
        let mut progress = Progress::new("reading patterns", Unit::Steps);
        for (path, done) in pairs.patterns.iter().zip(1..) {
            patterns::emitted(path, &self.encode.curve, pairs.texel)?;
            progress.step(done, count as u64)?;
        }
        drop(progress);
        if pairs.black.is_none() {
            note("no --black: what the emitter gives where it shows black stays in the photographs");
        }
        let mut progress = Progress::new("copying", Unit::Steps);
        let staged = stage(&self.session, pairs, &mut |done, all| progress.step(done, all))?;
        drop(progress);
        let folder = staged.commit()?;
        let ((columns, rows), (width, height)) = (pairs.plane, pairs.size);
        Ok(format!(
            "{}: {count} photographs of {width} x {height} pixels under {count} patterns of {columns} x {rows} texels\n",
            folder.display()
        ))
    }
}

/// The pictures of a folder, in the natural order of their names.
pub(in crate::commands) fn pictures(folder: &Path) -> relume_core::Result<Vec<PathBuf>> {
    let failed = |source| Error::io("read", folder, source);
    let mut named = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        if !name.starts_with('.') && PICTURES.contains(&extension.as_str()) && path.is_file() {
            named.push((name, path));
        }
    }
    if named.is_empty() {
        let expected = format!("files that end in .{}", PICTURES.join(", ."));
        return Err(Error::invalid(folder.display().to_string(), "no pictures", expected));
    }
    named.sort_by(|a, b| natural(&a.0, &b.0));
    Ok(named.into_iter().map(|(_, path)| path).collect())
}

/// The size that all pictures share.
pub(in crate::commands) fn one_size<'a>(
    mut paths: impl Iterator<Item = &'a PathBuf>,
) -> relume_core::Result<(usize, usize)> {
    let Some(first) = paths.next() else { return Ok((0, 0)) };
    let size = probe_size(first)?;
    for path in paths {
        let other = probe_size(path)?;
        if other != size {
            let expected = format!("{} x {} pixels, as {} has", size.0, size.1, first.display());
            return Err(Error::invalid(
                path.display().to_string(),
                format!("{} x {} pixels", other.0, other.1),
                expected,
            ));
        }
    }
    Ok(size)
}
