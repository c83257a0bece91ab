//! What the files of all cameras have in common: what they are, whether they are whole, which one counts.

use std::path::{Path, PathBuf};

use relume_core::hdr;

use crate::devices::Trouble;
use crate::rigs::Counts;
use crate::session::Exposure;

/// What a file of a camera is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// A picture as cameras make them.
    Jpeg,
    /// A picture of another kind that `relume` reads.
    Picture,
    /// What the sensor saw.
    Raw,
}

/// By its name; none for sound, films, notes and what is still being written under another name.
pub fn file_kind(path: &Path) -> Option<FileKind> {
    let name = path.file_name()?.to_string_lossy().into_owned();
    if name.starts_with('.') {
        return None;
    }
    if hdr::is_raw(path) {
        return Some(FileKind::Raw);
    }
    match path.extension()?.to_string_lossy().to_lowercase().as_str() {
        "jpg" | "jpeg" => Some(FileKind::Jpeg),
        "tif" | "tiff" | "png" | "exr" => Some(FileKind::Picture),
        _ => None,
    }
}

/// Does a JPEG reach its end? Its segments are gone through up to the picture's data, in which 0xFF is followed by zero or a
/// restart's number until the end comes (ITU T.81, B.1.1): pictures of the preview before it have ends of their own. What follows the
/// end, some cameras append, does not matter.
pub fn jpeg_is_whole(bytes: &[u8]) -> bool {
    let (start, end, scan) = (0xd8, 0xd9, 0xda);
    if !bytes.starts_with(&[0xff, start]) {
        return false;
    }
    let mut at = 2;
    while let [0xff, marker, high, low, ..] = bytes[at.min(bytes.len())..] {
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
        if marker == scan {
            let data = bytes.get(at..).unwrap_or_default();
            return data.windows(2).any(|pair| pair == [0xff, end]);
        }
    }
    false
}

/// Puts the file that counts first.
///
/// # Errors
/// It is not there.
pub fn counted_first(mut files: Vec<PathBuf>, counts: Counts, camera: &str) -> Result<Vec<PathBuf>, Trouble> {
    let raw = |file: &PathBuf| file_kind(file) == Some(FileKind::Raw);
    let counted = |file: &PathBuf| raw(file) == (counts == Counts::Raw);
    files.sort_by_key(|file| (!counted(file), file.clone()));
    if files.first().is_some_and(counted) {
        return Ok(files);
    }
    let names: Vec<_> = files.iter().map(|file| file.extension().unwrap_or_default().to_string_lossy()).collect();
    let made = names.join(" and ");
    Err(match counts {
        Counts::Raw => Trouble::stop(
            format!("{camera} made no raw file but {made}"),
            "set its format to RAW, or counts = \"picture\" in the rig file",
        ),
        Counts::Picture => Trouble::stop(
            format!("{camera} made no picture but {made}"),
            "set its format to RAW + JPEG or JPEG, or counts = \"raw\" in the rig file",
        ),
    })
}

/// What a file says of its exposure.
pub fn exif(file: &Path) -> Option<Exposure> {
    let hdr::Exposure { time_s, iso, f_number } = hdr::Exposure::read(file).ok()?;
    Some(Exposure { time_s, iso, f_number })
}

#[cfg(test)]
mod tests {
    use relume_core::image::{EncodeOptions, Image, write};

    use super::*;

    #[test]
    fn files_are_known_by_their_names() {
        for (name, kind) in [
            ("a.JPG", Some(FileKind::Jpeg)),
            ("a.jpeg", Some(FileKind::Jpeg)),
            ("a.TIF", Some(FileKind::Picture)),
            ("a.NEF", Some(FileKind::Raw)),
            ("a.mov", None),
            ("a.xmp", None),
            ("a.jpg.part", None),
            (".a.jpg", None),
            ("jpg", None),
        ] {
            assert_eq!(file_kind(Path::new(name)), kind, "{name}");
        }
    }

    /// Cut anywhere before its end, a JPEG is not whole; padded after it, it is.
    #[test]
    fn jpegs_are_whole_when_they_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jpg");
        let image = Image::from_fn(20, 10, |x, y| [x as f32 / 20.0, y as f32 / 10.0, 0.5]);
        write(&path, &image, EncodeOptions::default()).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        assert!(jpeg_is_whole(&bytes));
        for length in 0..bytes.len() {
            assert!(!jpeg_is_whole(&bytes[..length]), "{length} of {}", bytes.len());
        }
        // A preview inside, in a segment of its own, ends before the picture does.
        let mut with_preview = bytes[..2].to_vec();
        with_preview.extend([0xff, 0xe1]);
        with_preview.extend((bytes.len() as u16 + 2).to_be_bytes());
        with_preview.extend(&bytes);
        with_preview.extend(&bytes[2..]);
        assert!(jpeg_is_whole(&with_preview));
        assert!(!jpeg_is_whole(&with_preview[..with_preview.len() - 2]));
        bytes.extend([0; 100]);
        assert!(jpeg_is_whole(&bytes));
        assert!(!jpeg_is_whole(&[0; 50]));
    }

    #[test]
    fn the_file_that_counts_comes_first() {
        let files = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        let pair = files(&["a.NEF", "a.JPG"]);
        assert_eq!(counted_first(pair.clone(), Counts::Picture, "it").unwrap(), files(&["a.JPG", "a.NEF"]));
        assert_eq!(counted_first(pair, Counts::Raw, "it").unwrap(), files(&["a.NEF", "a.JPG"]));
        let said = counted_first(files(&["a.JPG"]), Counts::Raw, "it").unwrap_err().to_string();
        assert!(said.contains("it made no raw file but JPG"), "{said}");
        let said = counted_first(files(&["a.NEF"]), Counts::Picture, "it").unwrap_err().to_string();
        assert!(said.contains("no picture but NEF") && said.contains("RAW + JPEG"), "{said}");
    }
}
