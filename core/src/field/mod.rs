//! The reflectance field and its container.

use std::path::Path;

use crate::domain::Directions;
use crate::error::Result;
use crate::image::Image;

/// How numbers of `T` are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precision {
    /// 16-bit, with a power-of-two scale in the manifest.
    #[default]
    Half,
    /// 32-bit.
    Float,
}

/// How bytes of a container arrive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Access {
    /// Memory-mapped.
    #[default]
    Mapped,
    /// Read when needed, for network disks.
    Read,
}

/// What goes into a container beside `T`.
#[derive(Debug, Clone)]
pub struct Contents {
    /// The lamps.
    pub domain: Directions,
    /// E_j: the irradiance that lamp j gave a patch facing it. T_j = photo_j / E_j.
    pub irradiance: Vec<f32>,
    /// Columns of the pictures.
    pub width: usize,
    /// Rows of the pictures.
    pub height: usize,
    /// How `T` is stored.
    pub precision: Precision,
    /// The largest |T| there can be; it sets the scale of halves.
    pub largest: f32,
    /// `S`: the black photograph, 3 channels.
    pub ambient: Option<Image>,
    /// Coverage of the object, width x height, 0 to 1, row 0 at the top.
    pub alpha: Option<Vec<f32>>,
    /// Where the field came from, free form.
    pub provenance: serde_json::Value,
}

/// Rows of a block.
pub const BLOCK_HEIGHT: usize = 8;
/// Columns of a block.
pub const BLOCK_WIDTH: usize = 16;

/// A source of `T`, one band of blocks (8 rows of pixels) after another, from the top.
pub trait Bands {
    /// Fills band `by` with `T` laid out `[block x][channel][element][8][16]`; the band comes zeroed, and pixels past the
    /// edges of the picture stay zero.
    ///
    /// # Errors
    /// Whatever the source meets.
    fn fill(&mut self, by: usize, band: &mut [f32]) -> Result<()>;
}

/// Writes a container, whole or not at all.
///
/// # Errors
/// Folder absent or full; what the source returns.
pub fn write(path: &Path, contents: &Contents, bands: &mut dyn Bands) -> Result<()> {
    let _ = (path, contents, bands);
    todo!()
}

/// An open container.
#[derive(Debug)]
pub struct Asset {}

impl Asset {
    /// Opens a container and checks everything but the hashes of the arrays.
    ///
    /// # Errors
    /// A sentence that names the file and what is wrong.
    pub fn open(path: &Path, access: Access) -> Result<Self> {
        let _ = (path, access);
        todo!()
    }

    /// Columns of the picture.
    pub fn width(&self) -> usize {
        todo!()
    }

    /// Rows of the picture.
    pub fn height(&self) -> usize {
        todo!()
    }

    /// The lamps.
    pub fn domain(&self) -> &Directions {
        todo!()
    }

    /// `S`, if it was photographed.
    pub fn ambient(&self) -> Option<&Image> {
        todo!()
    }

    /// Coverage of the object, width x height, row 0 at the top.
    pub fn alpha(&self) -> Option<&[f32]> {
        todo!()
    }

    /// Checks the BLAKE3 of every entry.
    ///
    /// # Errors
    /// The first entry that differs.
    pub fn verify(&self) -> Result<()> {
        todo!()
    }
}
