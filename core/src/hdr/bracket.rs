//! The photographs of a bracket, loaded when they are wanted.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::image::{Image, SampleType, probe_size, read_codes};

/// Decoded photographs are kept while all of them fit into this; beyond, each is read anew when it is wanted.
const BUDGET_BYTES: usize = 1 << 30;
/// Raw files look like TIFF from inside, and some hold a small picture where a reader of TIFF finds it: names decide.
const RAW: [&str; 18] = [
    "3fr", "arw", "cr2", "cr3", "crw", "dcr", "dng", "erf", "iiq", "mrw", "nef", "nrw", "orf", "pef", "raf", "rw2",
    "sr2", "srw",
];

/// Is this a camera's raw file, by its name?
pub fn is_raw(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    RAW.contains(&extension.as_str())
}

/// Camera colours to linear Rec. 709, white balance included; row-major, for column vectors.
pub type ToRec709 = [[f32; 3]; 3];

/// Photographs of one scene, of one size and one type of sample.
#[derive(Debug)]
pub struct Bracket {
    paths: Vec<PathBuf>,
    size: (usize, usize),
    sample_type: SampleType,
    to_rec709: Option<ToRec709>,
    kept: Vec<Option<Arc<Image>>>,
    keep: bool,
}

impl Bracket {
    /// Looks at the files: headers of all, pixels of the first.
    ///
    /// # Errors
    /// Files that cannot be read, of different sizes, or of different types of sample; each named. For raw files
    /// [`Error::Unsupported`] where the feature `raw` is not built in.
    pub fn open(paths: &[PathBuf]) -> Result<Self> {
        let Some(first) = paths.first() else {
            return Err(Error::invalid("the bracket", "no photograph", "at least one"));
        };
        let photograph = read_photograph(first)?;
        let size = photograph.codes.size();
        for path in paths.iter().filter(|path| !is_raw(path)) {
            same_size(path, probe_size(path)?, first, size)?;
        }
        let bytes = size.0 * size.1 * 3 * size_of::<f32>();
        let mut kept = vec![None; paths.len()];
        let keep = bytes.saturating_mul(paths.len()) <= BUDGET_BYTES;
        if keep {
            kept[0] = Some(Arc::new(photograph.codes));
        }
        let (sample_type, to_rec709) = (photograph.sample_type, photograph.to_rec709);
        Ok(Self { paths: paths.to_vec(), size, sample_type, to_rec709, kept, keep })
    }

    /// Width and height.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// How all of them hold their samples; raw files count as floats.
    pub fn sample_type(&self) -> SampleType {
        self.sample_type
    }

    /// The matrix of the first photograph, of raw files: for the merged picture, since clipping shows in the camera's own
    /// colours only.
    pub fn to_rec709(&self) -> Option<ToRec709> {
        self.to_rec709
    }

    /// Photograph `index` as codes, RGB, white at 1; alpha is dropped.
    ///
    /// # Errors
    /// A damaged file, or one of another size or type than the first.
    ///
    /// # Panics
    /// When there is no such photograph.
    pub fn load(&mut self, index: usize) -> Result<Arc<Image>> {
        if let Some(image) = &self.kept[index] {
            return Ok(image.clone());
        }
        let (path, first) = (&self.paths[index], &self.paths[0]);
        let photograph = read_photograph(path)?;
        same_size(path, photograph.codes.size(), first, self.size)?;
        if photograph.sample_type != self.sample_type || photograph.to_rec709.is_some() != self.to_rec709.is_some() {
            let found = describe(photograph.sample_type, photograph.to_rec709.is_some());
            let expected = describe(self.sample_type, self.to_rec709.is_some());
            let expected = format!("{expected}, as {} holds: one bracket is of one type", first.display());
            return Err(Error::invalid(path.display().to_string(), found, expected));
        }
        let image = Arc::new(photograph.codes);
        if self.keep {
            self.kept[index] = Some(image.clone());
        }
        Ok(image)
    }
}

fn same_size(path: &Path, (w, h): (usize, usize), first: &Path, (width, height): (usize, usize)) -> Result<()> {
    if (w, h) == (width, height) {
        return Ok(());
    }
    let expected = format!("{width} x {height}, as {} has", first.display());
    Err(Error::invalid(path.display().to_string(), format!("{w} x {h} pixels"), expected))
}

fn describe(sample_type: SampleType, raw: bool) -> &'static str {
    match sample_type {
        _ if raw => "raw samples",
        SampleType::Jpeg => "JPEG samples of 8 bits",
        SampleType::U8 => "samples of 8 bits",
        SampleType::U16 => "samples of 16 bits",
        SampleType::Float => "float samples",
    }
}

/// A photograph as its file holds it.
#[derive(Debug)]
pub(super) struct Photograph {
    pub codes: Image,
    pub sample_type: SampleType,
    pub to_rec709: Option<ToRec709>,
}

fn read_photograph(path: &Path) -> Result<Photograph> {
    if is_raw(path) {
        return read_raw(path);
    }
    let (codes, sample_type) = read_codes(path)?;
    Ok(Photograph { codes: codes.into_rgb(), sample_type, to_rec709: None })
}

#[cfg(feature = "raw")]
use super::raw::read as read_raw;

#[cfg(not(feature = "raw"))]
fn read_raw(path: &Path) -> Result<Photograph> {
    // A path that is wrong is wrong in any build.
    std::fs::metadata(path).map_err(|source| Error::io("read", path, source))?;
    Err(Error::Unsupported {
        place: path.display().to_string(),
        what: "a camera raw file".to_owned(),
        advice:
            "use a relume built with the feature `raw` (cargo build --features raw), or develop the file to a linear \
                 16-bit TIFF"
                .to_owned(),
    })
}

/// Applies a colour matrix to every pixel of an RGB picture.
pub fn apply_matrix(image: &mut Image, m: &ToRec709) {
    image.data_mut().par_chunks_exact_mut(3).for_each(|p| {
        let [r, g, b] = [p[0], p[1], p[2]];
        p.iter_mut().zip(m).for_each(|(out, row)| *out = row[0] * r + row[1] * g + row[2] * b);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{EncodeOptions, write};

    #[test]
    fn photographs_that_do_not_belong_together_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let save = |name: &str, w: usize, png8: bool| {
            let path = folder.path().join(name);
            write(&path, &Image::new(w, 4, 3), EncodeOptions { png8, ..Default::default() }).unwrap();
            path
        };
        let (a, b) = (save("a.png", 6, true), save("b.png", 7, true));
        let message = Bracket::open(&[a.clone(), b]).unwrap_err().to_string();
        assert!(message.contains("b.png: found 7 x 4") && message.contains("a.png"), "{message}");
        let wide = save("wide.png", 6, false);
        let mut bracket = Bracket::open(&[a.clone(), wide]).unwrap();
        assert_eq!((bracket.size(), bracket.sample_type()), ((6, 4), SampleType::U8));
        assert!(bracket.load(0).is_ok());
        let message = bracket.load(1).unwrap_err().to_string();
        assert!(message.contains("wide.png: found samples of 16 bits"), "{message}");
        let float = save("c.exr", 6, false);
        assert_eq!(Bracket::open(&[float]).unwrap().sample_type(), SampleType::Float);
        let message = Bracket::open(&[folder.path().join("absent.dng")]).unwrap_err().to_string();
        assert!(message.contains("absent.dng"), "{message}");
    }

    #[cfg(not(feature = "raw"))]
    #[test]
    fn a_raw_file_names_the_feature() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.DNG");
        std::fs::write(&path, b"II*\0").unwrap();
        let message = Bracket::open(&[path]).unwrap_err().to_string();
        assert!(message.contains("a.DNG") && message.contains("--features raw"), "{message}");
    }
}
