//! RTI `.lp` files: a count, then `file x y z` a line, x right, y up, z to the camera; dots, never decimal commas.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::files::folder_of;
use crate::math::Vec3;

/// A parsed `.lp` file.
#[derive(Debug, Clone, PartialEq)]
pub struct Lp {
    /// Photographs, in the file's order; relative names are taken from the folder of the `.lp` file.
    pub photographs: Vec<PathBuf>,
    /// Unit directions from the object to the light, in the same order.
    pub directions: Vec<Vec3>,
}

/// What to do with vectors that are not of unit length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Lengths {
    /// Refuse them beyond 1 %, and say how to accept them.
    #[default]
    Unit,
    /// Scale each to unit length.
    Normalise,
}

/// Reads and checks a `.lp` file.
///
/// # Errors
/// Each names the file and the line: a count that is missing or wrong, a line that is not a name and three numbers,
/// decimal commas, zero, NaN or (with [`Lengths::Unit`]) non-unit vectors.
pub fn read(path: &Path, lengths: Lengths) -> Result<Lp> {
    let bytes = std::fs::read(path).map_err(|source| Error::io("read", path, source))?;
    let text = String::from_utf8(bytes).map_err(|error| {
        let place = format!("{}, byte {}", path.display(), error.utf8_error().valid_up_to());
        Error::invalid(place, "bytes that are not UTF-8 text", "a .lp text file")
    })?;
    parse(&text, path, lengths)
}

/// The text of a `.lp` file; photographs are written as they are, so they should be relative to its folder.
pub fn text(lamps: &Lp) -> String {
    let line = |(name, d): (&PathBuf, &Vec3)| format!("{} {:.7} {:.7} {:.7}\n", name.display(), d.x, d.y, d.z);
    let lines: String = lamps.photographs.iter().zip(&lamps.directions).map(line).collect();
    format!("{}\n{lines}", lamps.photographs.len())
}

/// Parses the text of a `.lp` file; `path` names it in messages and gives the folder of the photographs.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, path: &Path, lengths: Lengths) -> Result<Lp> {
    let text = text.trim_start_matches('\u{feff}');
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
    let place = |line: usize| format!("{}, line {line}", path.display());
    let (number, first) = lines.next().ok_or_else(|| {
        Error::invalid(path.display().to_string(), "an empty file", "the number of lights, then `file x y z` a line")
    })?;
    let count: usize = first.trim().parse().map_err(|_| {
        Error::invalid(place(number), format!("`{}`", excerpt(first)), "the number of lights, alone on the first line")
    })?;
    let (mut photographs, mut directions) = (Vec::new(), Vec::new());
    for (number, line) in lines {
        let (name, vector) =
            parse_line(line).map_err(|(found, expected)| Error::invalid(place(number), found, expected))?;
        directions
            .push(unit(vector, lengths).map_err(|(found, expected)| Error::invalid(place(number), found, expected))?);
        photographs.push(folder_of(path).join(name.replace('\\', "/")));
    }
    if photographs.len() != count || count == 0 {
        let expected = format!("{} lines `file x y z`, as the count on line {number} says", count.max(1));
        return Err(Error::invalid(path.display().to_string(), format!("{} of them", photographs.len()), expected));
    }
    Ok(Lp { photographs, directions })
}

/// What was found and what was expected.
type Complaint = (String, String);

/// Splits `file x y z`; the name may hold blanks.
fn parse_line(line: &str) -> std::result::Result<(&str, Vec3), Complaint> {
    let expected = || "`file x y z`".to_owned();
    let mut rest = line.trim_end();
    let mut last_field = || {
        let field = rest.rsplit(char::is_whitespace).next().unwrap_or_default();
        let before = &rest[..rest.len() - field.len()];
        rest = before.trim_end();
        field
    };
    let mut number = |axis: &str| {
        let field = last_field();
        field.parse::<f64>().map_err(|_| {
            if field.contains(',') {
                (format!("`{}` with a decimal comma", excerpt(field)), "a decimal dot, as in 0.5".to_owned())
            } else {
                (format!("`{}` for {axis}", excerpt(field)), format!("{}, with a number for {axis}", expected()))
            }
        })
    };
    let (z, y, x) = (number("z")?, number("y")?, number("x")?);
    let name = rest.trim();
    if name.is_empty() { Err((format!("`{}`", excerpt(line)), expected())) } else { Ok((name, Vec3::new(x, y, z))) }
}

fn unit(vector: Vec3, lengths: Lengths) -> std::result::Result<Vec3, Complaint> {
    let length = vector.norm();
    let shown = format!("the vector ({}, {}, {})", vector.x, vector.y, vector.z);
    if !length.is_finite() {
        return Err((shown, "finite numbers".to_owned()));
    }
    if length < 1e-9 {
        return Err((shown, "a direction; a zero vector has none".to_owned()));
    }
    // Three decimals are common: rounding alone moves a length by up to 0.1 %.
    if lengths == Lengths::Unit && (length - 1.0).abs() > 0.01 {
        return Err((
            format!("{shown} of length {length:.4}"),
            "length 1 (or ask for --normalise-directions)".to_owned(),
        ));
    }
    Ok(vector / length)
}

/// At most 60 characters of a hostile line.
fn excerpt(text: &str) -> String {
    let text = text.trim();
    if text.chars().count() <= 60 {
        text.to_owned()
    } else {
        format!("{}...", text.chars().take(60).collect::<String>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Lp> {
        parse(text, Path::new("set/dirs.lp"), Lengths::Unit)
    }

    #[test]
    fn reads_names_with_blanks_tabs_and_windows_line_ends() {
        let lp = parsed("\u{feff}2\r\nphoto 1.jpg 0   0 1\r\n\r\nsub\\b.jpg\t0.6\t0\t0.8\r\n").unwrap();
        assert_eq!(lp.photographs, [PathBuf::from("set/photo 1.jpg"), PathBuf::from("set/sub/b.jpg")]);
        assert!((lp.directions[1] - Vec3::new(0.6, 0.0, 0.8)).norm() < 1e-12);
    }

    #[test]
    fn what_is_written_is_read() {
        let directions = vec![Vec3::new(0.6, 0.0, 0.8), Vec3::new(-1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0)];
        let lamps = Lp { photographs: vec!["photo 1.jpg".into(), "sub/b.jpg".into()], directions };
        let back = parsed(&text(&lamps)).unwrap();
        assert_eq!(back.photographs, [PathBuf::from("set/photo 1.jpg"), PathBuf::from("set/sub/b.jpg")]);
        assert!(back.directions.iter().zip(&lamps.directions).all(|(a, b)| (a - b).norm() < 2e-7));
    }

    #[test]
    fn each_mistake_is_named_with_its_line() {
        for (text, parts) in [
            ("", vec!["empty"]),
            ("a.jpg 0 0 1\n", vec!["line 1", "number of lights"]),
            ("3\na.jpg 0 0 1\nb.jpg 0 0 1\n", vec!["2 of them", "3 lines"]),
            ("0\n", vec!["0 of them"]),
            ("1\na.jpg 0,6 0,0 0,8\n", vec!["line 2", "0,8", "decimal dot"]),
            ("1\na.jpg 0 0 0\n", vec!["line 2", "zero vector"]),
            ("1\na.jpg 0 nan 1\n", vec!["line 2", "NaN", "finite"]),
            ("1\na.jpg 0 0 2\n", vec!["line 2", "length 2", "--normalise-directions"]),
            ("1\n0 0 1\n", vec!["line 2", "file x y z"]),
            ("1\na.jpg 0 0\n", vec!["line 2", "a.jpg", "x"]),
        ] {
            let message = parsed(text).unwrap_err().to_string();
            for part in parts {
                assert!(message.contains(part), "{text:?} gave `{message}`, without `{part}`");
            }
        }
    }

    #[test]
    fn lengths_are_mended_on_request() {
        let lp = parse("1\na.jpg 0 3 4\n", Path::new("x.lp"), Lengths::Normalise).unwrap();
        assert!((lp.directions[0] - Vec3::new(0.0, 0.6, 0.8)).norm() < 1e-12);
    }
}
