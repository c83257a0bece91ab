//! Reading pictures into linear f32.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use ::image::ImageFormat;

use super::stored::{Samples, check_size};
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

/// How a file holds its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SampleType {
    /// Codes of 8 bits after lossy compression: JPEG.
    Jpeg,
    /// Codes of 8 bits.
    U8,
    /// Codes of 16 bits.
    U16,
    /// Floats, and what becomes floats: EXR, HDR, float TIFF.
    Float,
}

impl SampleType {
    /// The largest code; `None` for floats.
    pub fn largest_code(self) -> Option<u16> {
        match self {
            Self::Jpeg | Self::U8 => Some(u16::from(u8::MAX)),
            Self::U16 => Some(u16::MAX),
            Self::Float => None,
        }
    }
}

/// Reads as [`read`] does, but leaves codes alone: integer codes divided by the largest one, floats as they are, and how
/// the file holds them. For what has a transfer curve of its own, such as a camera.
///
/// # Errors
/// As [`read`].
pub fn read_codes(path: &Path) -> Result<(Image, SampleType)> {
    let (file, file_type) = open(path)?;
    let stored = match file_type {
        FileType::Exr => exr::read(path, file)?,
        FileType::Raster(format) => raster::read(path, file, format)?,
        FileType::Tiff => tiff::read(path, file)?,
    };
    let sample_type = match (&stored.samples, file_type) {
        (Samples::U8(_), FileType::Raster(ImageFormat::Jpeg)) => SampleType::Jpeg,
        (Samples::U8(_), _) => SampleType::U8,
        (Samples::U16(_), _) => SampleType::U16,
        (Samples::F32(_), _) => SampleType::Float,
    };
    Ok((stored.into_linear(path, Encoding::Linear)?, sample_type))
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

#[cfg(test)]
mod tests {
    use std::panic::catch_unwind;
    use std::path::PathBuf;

    use rand::RngExt;
    use rand_pcg::Pcg32;

    use super::super::{EncodeOptions, write};
    use super::*;

    fn picture() -> Image {
        Image::from_fn(24, 20, |x, y| [x as f32 / 24.0, y as f32 / 20.0, ((x * 7 + y * 13) % 11) as f32 / 11.0])
    }

    #[test]
    fn the_type_is_told_by_content() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.exr", "a.hdr", "a.png", "a.tif", "a.jpg"] {
            let path = folder.path().join(name);
            write(&path, &picture(), EncodeOptions::default()).unwrap();
            let plain = read(&path, Encoding::Auto).unwrap();
            assert_eq!(probe_size(&path).unwrap(), (24, 20));
            let renamed = folder.path().join("picture.bin");
            std::fs::rename(&path, &renamed).unwrap();
            assert_eq!(read(&renamed, Encoding::Auto).unwrap(), plain, "{name}");
        }
    }

    #[test]
    fn what_is_no_picture_says_what_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let message = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let message = read(&path, Encoding::Auto).unwrap_err().to_string();
            assert!(message.contains("a.png") && message.contains("expected OpenEXR"), "{message}");
            message
        };
        assert!(message(b"").contains("an empty file"));
        assert!(message(b"<html>\n").contains("<html>"));
        assert!(message(&[0, 1, 2, 250]).contains("00, 01, 02, fa"));
        assert!(matches!(read(&folder.path().join("none.exr"), Encoding::Auto), Err(Error::Io { .. })));
        assert!(read(folder.path(), Encoding::Auto).is_err());
    }

    /// A variant of a file: cut, or with a few bytes changed, more often near the start, where the lengths stand.
    fn mutated(bytes: &[u8], rng: &mut Pcg32) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        if rng.random_range(0..4) == 0 {
            bytes.truncate(rng.random_range(0..bytes.len()));
            return bytes;
        }
        for _ in 0..rng.random_range(1..5) {
            let end = if rng.random_range(0..2) == 0 { bytes.len().min(400) } else { bytes.len() };
            let at = rng.random_range(4.min(end - 1)..end);
            bytes[at] = match rng.random_range(0..4) {
                0 => bytes[at] ^ 1 << rng.random_range(0..8),
                1 => 0xff,
                2 => 0x7f,
                _ => rng.random_range(0..=255),
            };
        }
        bytes
    }

    fn originals(folder: &Path) -> Vec<PathBuf> {
        let mut paths = Vec::new();
        let mut add = |name: &str, image: &Image, options| {
            let path = folder.join(name);
            write(&path, image, options).unwrap();
            paths.push(path);
        };
        let mut alpha = Image::new(24, 20, 4);
        for (i, pixel) in alpha.data_mut().chunks_exact_mut(4).enumerate() {
            pixel.copy_from_slice(&[0.1, 0.2, i as f32 / 480.0, 0.5]);
        }
        for name in ["a.exr", "a.hdr", "a.png", "a.tif", "a.jpg"] {
            add(name, &picture(), EncodeOptions::default());
        }
        add("half.exr", &alpha, EncodeOptions { half: true, ..Default::default() });
        add("narrow.png", &alpha, EncodeOptions { png8: true, ..Default::default() });
        add("alpha.tif", &alpha, EncodeOptions::default());
        paths.extend(foreign_exrs(folder));
        paths
    }

    /// The compressions and layouts we read but do not write.
    fn foreign_exrs(folder: &Path) -> Vec<PathBuf> {
        use ::exr::prelude::{
            Compression::{B44, DWAA, DWAB, PIZ, PXR24, RLE, Uncompressed},
            *,
        };
        let write = |(i, compression): (usize, Compression)| {
            let blocks = if i.is_multiple_of(2) { Blocks::Tiles(Vec2(16, 8)) } else { Blocks::ScanLines };
            let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
            let channels = SpecificChannels::rgb(|at: Vec2<usize>| {
                let of = |s: usize| f16::from_f32((s % 17) as f32 / 17.0);
                (of(at.0 * 3), of(at.1 * 5), of(at.0 + at.1))
            });
            let path = folder.join(format!("{i}.exr"));
            Image::from_encoded_channels((24, 20), encoding, channels).write().to_file(&path).unwrap();
            path
        };
        let all = [PIZ, PIZ, DWAA(Some(45.0)), DWAB(Some(45.0)), B44, B44, PXR24, PXR24, RLE, RLE, Uncompressed];
        all.into_iter().enumerate().map(write).collect()
    }

    #[test]
    fn hostile_files_never_panic() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("variant");
        let mut rng = Pcg32::new(0x72_65_6c_75_6d_65, 1);
        for original in originals(folder.path()) {
            let bytes = std::fs::read(&original).unwrap();
            let mut refused = 0;
            for variant in 0..250 {
                std::fs::write(&target, mutated(&bytes, &mut rng)).unwrap();
                let outcome = catch_unwind(|| (read(&target, Encoding::Auto), probe_size(&target)));
                let Ok((read, _)) = outcome else {
                    let kept = std::env::temp_dir().join("relume-panicking-variant");
                    std::fs::copy(&target, &kept).unwrap();
                    panic!("variant {variant} of {} panicked; it is kept in {}", original.display(), kept.display());
                };
                if let Err(error) = read {
                    refused += 1;
                    assert!(error.to_string().contains("variant"), "{error}");
                }
            }
            assert!(refused >= 60, "{}: only {refused} of 250 variants were refused", original.display());
        }
    }
}
