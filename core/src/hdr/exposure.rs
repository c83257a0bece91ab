//! How much light a photograph was given: time, sensitivity, aperture.

use std::fs::File;
use std::io::BufReader;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use ::exif::{DateTime, Exif, In, Reader, Tag, Value};

use crate::error::{Error, Result};

/// The longest and shortest times that can be meant, seconds: ten nanoseconds and about four months.
const TIMES_S: std::ops::RangeInclusive<f64> = 1e-8..=1e7;

/// What is known of a photograph's exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposure {
    /// Exposure time in seconds.
    pub time_s: f64,
    /// ISO speed, where it is known.
    pub iso: Option<f64>,
    /// F-number, where it is known. A lens without contacts is recorded as 0, which counts as not known.
    pub f_number: Option<f64>,
}

impl Exposure {
    /// A time alone, in seconds. `place` names it in the message.
    ///
    /// # Errors
    /// [`Error::Invalid`] for NaN, zero, negative and absurd times.
    pub fn of_time(place: &str, time_s: f64) -> Result<Self> {
        if TIMES_S.contains(&time_s) {
            return Ok(Self { time_s, iso: None, f_number: None });
        }
        let expected = format!("an exposure time between {:e} and {:e} seconds", TIMES_S.start(), TIMES_S.end());
        Err(Error::invalid(place, format!("{time_s} s"), expected))
    }

    /// From the EXIF data of a JPEG, PNG, TIFF, DNG or HEIF file (`ExposureTime`, else `ShutterSpeedValue`;
    /// `PhotographicSensitivity`, `FNumber`), or the standard attributes `expTime`, `isoSpeed` and `aperture` of OpenEXR.
    ///
    /// # Errors
    /// [`Error::Invalid`] when there is no exposure time, or it is zero; [`Error::Io`] when the file cannot be read.
    pub fn read(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|source| Error::io("read", path, source))?;
        // Tags come from outside, and a parser that panics on them must not take a batch down.
        let found = catch_unwind(AssertUnwindSafe(|| read_exif(file).or_else(|| read_exr(path)))).unwrap_or_default();
        let place = path.display().to_string();
        let Some((time_s, iso, f_number)) = found else {
            return Err(Error::invalid(
                place,
                "no exposure time (EXIF) in the file",
                "one; give a list of times if the camera recorded none",
            ));
        };
        let known = |value: Option<f64>| value.filter(|v| v.is_finite() && *v > 0.0);
        let exposure = Self::of_time(&format!("{place}, exposure time (EXIF)"), time_s)?;
        Ok(Self { iso: known(iso), f_number: known(f_number), ..exposure })
    }
}

type Tags = (f64, Option<f64>, Option<f64>);

/// When a photograph was taken by its camera's clock (EXIF `DateTimeOriginal`), in seconds from the beginning of 1970 there; to the
/// second, or as `SubSecTimeOriginal` has it. Of a file that does not say, none.
pub fn taken_s(path: &Path) -> Option<f64> {
    let read = || {
        let exif = exif_of(File::open(path).ok()?)?;
        let text = |tag| match &exif.get_field(tag, In::PRIMARY)?.value {
            Value::Ascii(lines) => lines.first().cloned(),
            _ => None,
        };
        let at = DateTime::from_ascii(&text(Tag::DateTimeOriginal)?).ok()?;
        let fraction = text(Tag::SubSecTimeOriginal).and_then(|digits| String::from_utf8(digits).ok());
        let fraction = fraction.and_then(|digits| format!("0.{}", digits.trim()).parse::<f64>().ok());
        Some(seconds_of(&at) + fraction.unwrap_or(0.0))
    };
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_default()
}

/// Seconds from the beginning of 1970, as if every day had as many: days by the formula for the Gregorian calendar of Fliegel and Van
/// Flandern (Communications of the ACM 11, 1968), which counts from a leap day by putting January and February behind their year.
fn seconds_of(at: &DateTime) -> f64 {
    let (year, month, day) = (i64::from(at.year), i64::from(at.month), i64::from(at.day));
    let late = (month - 14) / 12;
    let julian = day - 32075 + 1461 * (year + 4800 + late) / 4 + 367 * (month - 2 - late * 12) / 12
        - 3 * ((year + 4900 + late) / 100) / 4;
    let day_1970 = 2_440_588;
    let seconds = i64::from(at.hour) * 3600 + i64::from(at.minute) * 60 + i64::from(at.second);
    ((julian - day_1970) * 86_400 + seconds) as f64
}

fn exif_of(file: File) -> Option<Exif> {
    // A broken maker note must not hide the exposure time.
    Reader::new()
        .continue_on_error(true)
        .read_from_container(&mut BufReader::new(file))
        .or_else(|error| error.distill_partial_result(|_| {}))
        .ok()
}

fn read_exif(file: File) -> Option<Tags> {
    let exif = exif_of(file)?;
    let number = |tag: Tag| match &exif.get_field(tag, In::PRIMARY)?.value {
        Value::Rational(v) => v.first().map(|r| r.to_f64()),
        Value::SRational(v) => v.first().map(|r| r.to_f64()),
        value => value.get_uint(0).map(f64::from),
    };
    // APEX: Tv = -log2(t) (EXIF 2.32, annex C).
    let time_s = number(Tag::ExposureTime).or_else(|| number(Tag::ShutterSpeedValue).map(|tv| (-tv).exp2()))?;
    Some((time_s, number(Tag::PhotographicSensitivity), number(Tag::FNumber)))
}

fn read_exr(path: &Path) -> Option<Tags> {
    let meta = ::exr::meta::MetaData::read_from_file(path, false).ok()?;
    let attributes = &meta.headers.first()?.own_attributes;
    let known = |value: Option<f32>| value.map(f64::from);
    Some((known(attributes.exposure)?, known(attributes.iso_speed), known(attributes.aperture)))
}

/// Exposures of a bracket as numbers: `s = t * (ISO / 100) / N^2`, the factors that are not known left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Relative {
    /// `s` of each photograph.
    pub values: Vec<f64>,
    /// Is the ISO speed in it?
    pub with_iso: bool,
    /// Is the F-number in it?
    pub with_f_number: bool,
}

/// `s` of each photograph of a bracket. ISO speed and F-number count when every photograph has them; when only some have
/// them, and those agree, they are left out for all.
///
/// # Errors
/// [`Error::Invalid`] when some photographs lack a number that differs between the others; `names` says which.
pub fn relative(exposures: &[Exposure], names: &[String]) -> Result<Relative> {
    let iso: Vec<Option<f64>> = exposures.iter().map(|e| e.iso).collect();
    let f_number: Vec<Option<f64>> = exposures.iter().map(|e| e.f_number).collect();
    let with_iso = known_of_all(&iso, names, "ISO speed")?;
    let with_f_number = known_of_all(&f_number, names, "F-number")?;
    let value = |e: &Exposure| {
        let gain = e.iso.filter(|_| with_iso).map_or(1.0, |iso| iso / 100.0);
        let stop = e.f_number.filter(|_| with_f_number).unwrap_or(1.0);
        e.time_s * gain / (stop * stop)
    };
    Ok(Relative { values: exposures.iter().map(value).collect(), with_iso, with_f_number })
}

fn known_of_all(values: &[Option<f64>], names: &[String], what: &str) -> Result<bool> {
    let Some(unknown) = values.iter().position(Option::is_none) else { return Ok(true) };
    let mut known = values.iter().flatten();
    let first = known.next();
    if known.all(|v| Some(v) == first) {
        return Ok(false);
    }
    let place = names.get(unknown).cloned().unwrap_or_else(|| format!("photograph {}", unknown + 1));
    let expected = "one, since it differs between the other photographs; give a list of times instead";
    Err(Error::invalid(place, format!("no {what} in its EXIF data"), expected))
}

/// An exposure time as people write it: seconds (`0.25`, `2`, `2s`) or a fraction (`1/60`).
///
/// # Errors
/// A sentence about the text.
pub fn parse_time(text: &str) -> Result<f64, String> {
    let bare = text.trim().trim_end_matches(['s', '"']).trim_end();
    let number =
        |part: &str| part.trim().parse::<f64>().map_err(|_| format!("`{text}` is not a time; write 1/60 or 0.25"));
    let time_s = match bare.split_once('/') {
        Some((above, below)) => number(above)? / number(below)?,
        None => number(bare)?,
    };
    if TIMES_S.contains(&time_s) { Ok(time_s) } else { Err(format!("`{text}` is not a positive time in seconds")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{EncodeOptions, Image, write};

    #[test]
    fn times_as_people_write_them() {
        for (text, expected) in [("1/60", 1.0 / 60.0), ("0.25", 0.25), (" 2s", 2.0), ("2\"", 2.0), ("3/2", 1.5)] {
            assert_eq!(parse_time(text), Ok(expected), "{text}");
        }
        for bad in ["", "0", "-1", "1/0", "0/1", "nan", "inf", "1/60/2", "fast", "1e9", "-1/60"] {
            let message = parse_time(bad).unwrap_err();
            assert!(message.contains(bad), "{message}");
        }
    }

    #[test]
    fn factors_count_when_all_have_them() {
        let exposure = |time_s, iso, f_number| Exposure { time_s, iso, f_number };
        let names: Vec<String> = ["a", "b"].map(str::to_owned).into();
        let of = |a, b| relative(&[a, b], &names);
        let both = of(exposure(0.5, Some(200.0), Some(2.0)), exposure(1.0, Some(100.0), Some(4.0))).unwrap();
        assert_eq!((both.values, both.with_iso, both.with_f_number), (vec![0.25, 0.0625], true, true));
        let some = of(exposure(0.5, Some(200.0), None), exposure(1.0, None, None)).unwrap();
        assert_eq!((some.values, some.with_iso, some.with_f_number), (vec![0.5, 1.0], false, false));
        let three = [exposure(1.0, Some(1.0), None), exposure(1.0, None, None), exposure(1.0, Some(2.0), None)];
        let message = relative(&three, &names).unwrap_err().to_string();
        assert!(message.starts_with("b: ") && message.contains("ISO"), "{message}");
    }

    #[test]
    fn times_that_cannot_be_are_refused() {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-9, 1e8] {
            assert!(Exposure::of_time("a.jpg", bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn files_without_a_time_say_so() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.jpg", "a.exr", "a.png", "a.tif", "a.hdr"] {
            let path = folder.path().join(name);
            write(&path, &Image::new(4, 4, 3), EncodeOptions::default()).unwrap();
            let message = Exposure::read(&path).unwrap_err().to_string();
            assert!(message.contains(name) && message.contains("no exposure time"), "{message}");
        }
        assert!(matches!(Exposure::read(&folder.path().join("absent.jpg")), Err(Error::Io { .. })));
    }

    /// A little-endian EXIF block of three tags in the EXIF folder, as a TIFF file holds it.
    fn exif_block(time: (u32, u32), iso: u16, f_number: (u32, u32)) -> Vec<u8> {
        let entry = |tag: u16, kind: u16, value: u32| {
            [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &1u32.to_le_bytes(), &value.to_le_bytes()].concat()
        };
        // 8 header, 2 + 12 + 4 first folder, 2 + 3 * 12 + 4 second folder, then the two rationals.
        let (second, rationals) = (26, 26 + 42);
        let mut bytes = b"II*\0\x08\0\0\0\x01\0".to_vec();
        bytes.extend(entry(0x8769, 4, second));
        bytes.extend([0; 4]);
        bytes.extend(3u16.to_le_bytes());
        bytes.extend(entry(0x829a, 5, rationals));
        bytes.extend(entry(0x829d, 5, rationals + 8));
        bytes.extend(entry(0x8827, 3, u32::from(iso)));
        bytes.extend([0; 4]);
        bytes.extend([time.0, time.1, f_number.0, f_number.1].iter().flat_map(|v| v.to_le_bytes()));
        bytes
    }

    #[test]
    fn days_are_counted_as_calendars_do() {
        let at = |text: &[u8]| seconds_of(&DateTime::from_ascii(text).unwrap());
        assert_eq!(at(b"1970:01:01 00:00:00"), 0.0);
        // As `date -u -d ... +%s` has them.
        assert_eq!(at(b"2000:02:29 12:34:56"), 951_827_696.0);
        assert_eq!(at(b"2026:11:22 19:31:39"), 1_795_375_899.0);
        assert_eq!(at(b"2100:03:01 00:00:00") - at(b"2100:02:28 00:00:00"), 86_400.0, "no leap year");
    }

    #[test]
    fn the_time_of_taking_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tif");
        // A folder of one entry that leads to one of one entry, whose text follows.
        let mut bytes = b"II*\0\x08\0\0\0\x01\0".to_vec();
        let entry = |tag: u16, kind: u16, count: u32, value: u32| {
            [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &count.to_le_bytes(), &value.to_le_bytes()].concat()
        };
        bytes.extend(entry(0x8769, 4, 1, 26));
        bytes.extend([0; 4]);
        bytes.extend(1u16.to_le_bytes());
        bytes.extend(entry(0x9003, 2, 20, 44));
        bytes.extend([0; 4]);
        bytes.extend(b"2000:02:29 12:34:56\0");
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(taken_s(&path), Some(951_827_696.0));
        std::fs::write(&path, exif_block((1, 60), 400, (28, 10))).unwrap();
        assert_eq!(taken_s(&path), None);
        assert_eq!(taken_s(&folder.path().join("absent.jpg")), None);
    }

    #[test]
    fn exif_and_exr_attributes_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tif");
        std::fs::write(&path, exif_block((1, 60), 400, (28, 10))).unwrap();
        let expected = Exposure { time_s: 1.0 / 60.0, iso: Some(400.0), f_number: Some(2.8) };
        assert_eq!(Exposure::read(&path).unwrap(), expected);
        std::fs::write(&path, exif_block((1, 8), 0, (0, 1))).unwrap();
        assert_eq!(Exposure::read(&path).unwrap(), Exposure { time_s: 0.125, iso: None, f_number: None });
        for zero in [(0, 1), (0, 0), (1, 0)] {
            std::fs::write(&path, exif_block(zero, 100, (8, 1))).unwrap();
            let message = Exposure::read(&path).unwrap_err().to_string();
            assert!(message.contains("a.tif, exposure time (EXIF)"), "{message}");
        }

        use ::exr::prelude::*;
        let exr = folder.path().join("a.exr");
        let mut layer = Layer::new(
            (4, 4),
            LayerAttributes::default(),
            Encoding::UNCOMPRESSED,
            SpecificChannels::rgb(|_| (0.5f32, 0.5f32, 0.5f32)),
        );
        layer.attributes.exposure = Some(0.5);
        layer.attributes.iso_speed = Some(200.0);
        ::exr::prelude::Image::from_layer(layer).write().to_file(&exr).unwrap();
        assert_eq!(Exposure::read(&exr).unwrap(), Exposure { time_s: 0.5, iso: Some(200.0), f_number: None });
    }
}
