//! Reading pictures into linear f32.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use ::image::ImageFormat;

use super::stored::check_size;
use super::{Image, exr, raster, tiff};
use crate::error::{Error, Result};

/// How stored numbers become light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Encoding {
    /// By file type: 8- and 16-bit integer files are sRGB, float files linear.
    #[default]
    Auto,
    /// The sRGB curve (IEC 61966-2-1), whatever the file type.
    Srgb,
    /// Proportional to light, whatever the file type. Integer codes are divided by the largest one.
    Linear,
}

/// The types of file that are read, told apart by their first bytes: a wrong extension does no harm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FileType {
    Exr,
    Raster(ImageFormat),
    Tiff,
}

/// Reads OpenEXR, Radiance HDR, PNG, TIFF or JPEG into linear f32, RGB or premultiplied RGBA, row 0 at the top.
///
/// - **OpenEXR**: half, float and uint channels (uint as numbers, not divided), any compression the `exr` crate reads
///   (DWA too), tiles (the full resolution of mip maps), several parts: the first part with R, G and B, with or without
///   a layer name, else the first part's luminance `Y` or single channel as grey. The picture is the display window;
///   what the data window does not cover is zero, what lies outside is cropped. Alpha is associated, as OpenEXR says.
/// - **Radiance HDR**: RGBE, run-length encoded or flat. `EXPOSURE`, `GAMMA` and `PRIMARIES` lines are ignored, as
///   compositing packages do.
/// - **PNG**, 8 and 16 bits, with palette or alpha; **TIFF**, 8, 16 bits, half and float; **JPEG**: grey or RGB. Embedded
///   profiles and gamma chunks are ignored: `encoding` decides. Alpha is unassociated, unless a TIFF says otherwise.
///
/// Pictures are taken as stored: the orientation that EXIF or TIFF tags speak of is *not* applied, so that the pixels of
/// a camera's photographs always lie where its sensor saw them. Negative values and values above one are ordinary.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read; [`Error::Invalid`] when it is of no known type, damaged, truncated, larger
/// than 2^28 pixels, or holds NaN or infinity (with pixel and channel); [`Error::Unsupported`] for subsampled chroma,
/// deep data, CMYK and the like.
pub fn read(path: &Path, encoding: Encoding) -> Result<Image> {
    let (file, file_type) = open(path)?;
    let stored = match file_type {
        FileType::Exr => exr::read(path, file)?,
        FileType::Raster(format) => raster::read(path, file, format)?,
        FileType::Tiff => tiff::read(path, file)?,
    };
    stored.into_linear(path, encoding)
}

/// Width and height of the picture [`read`] would give, from the header alone.
///
/// # Errors
/// As [`read`], as far as the header shows it.
pub fn probe_size(path: &Path) -> Result<(usize, usize)> {
    let (file, file_type) = open(path)?;
    let (width, height) = match file_type {
        FileType::Exr => exr::probe_size(path, file)?,
        FileType::Raster(format) => raster::probe_size(path, file, format)?,
        FileType::Tiff => tiff::probe_size(path, file)?,
    };
    check_size(path, width, height)?;
    Ok((width, height))
}

fn open(path: &Path) -> Result<(BufReader<File>, FileType)> {
    let failed = |source| Error::io("read", path, source);
    let mut file = BufReader::new(File::open(path).map_err(failed)?);
    let mut first = Vec::with_capacity(16);
    file.by_ref().take(16).read_to_end(&mut first).map_err(failed)?;
    file.rewind().map_err(failed)?;
    match file_type(&first) {
        Some(file_type) => Ok((file, file_type)),
        None => Err(Error::invalid(
            path.display().to_string(),
            describe(&first),
            "OpenEXR, Radiance HDR, PNG, TIFF or JPEG",
        )),
    }
}

fn file_type(first: &[u8]) -> Option<FileType> {
    const TABLE: [(&[u8], FileType); 9] = [
        (&[0x76, 0x2f, 0x31, 0x01], FileType::Exr),
        (b"#?RADIANCE", FileType::Raster(ImageFormat::Hdr)),
        (b"#?RGBE", FileType::Raster(ImageFormat::Hdr)),
        (b"\x89PNG\r\n\x1a\n", FileType::Raster(ImageFormat::Png)),
        (&[0xff, 0xd8, 0xff], FileType::Raster(ImageFormat::Jpeg)),
        (b"II*\0", FileType::Tiff),
        (b"MM\0*", FileType::Tiff),
        (b"II+\0", FileType::Tiff),
        (b"MM\0+", FileType::Tiff),
    ];
    TABLE.iter().find(|(magic, _)| first.starts_with(magic)).map(|&(_, file_type)| file_type)
}

fn describe(first: &[u8]) -> String {
    match first {
        [] => "an empty file".to_owned(),
        _ if first.iter().all(|b| (0x20..0x7f).contains(b) || b.is_ascii_whitespace()) => {
            format!("a file that begins with the text {:?}", String::from_utf8_lossy(&first[..first.len().min(8)]))
        }
        _ => format!("a file of unknown type that begins with the bytes {:02x?}", &first[..first.len().min(8)]),
    }
}
