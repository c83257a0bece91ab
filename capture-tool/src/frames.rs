//! Frame ranges and the names of frames, as render farms write them.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// More frames than this in one call are a slip of the pen: eleven hours at 25 a second.
const MOST: i64 = 1_000_000;
/// Digits at most in a name, so that it stays a name.
const MOST_DIGITS: usize = 12;

/// A set of frames: `5`, `1-48`, `1-48x2` (every second, from the first), `1-10,20`. Each frame once, ascending.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frames(Vec<i64>);

impl Frames {
    /// The frames, ascending.
    pub fn numbers(&self) -> &[i64] {
        &self.0
    }
}

impl FromStr for Frames {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut frames = BTreeSet::new();
        for part in text.split(',') {
            let (first, last, step) = range(part.trim())?;
            let count = (last - first) / step + 1;
            if count + frames.len() as i64 > MOST {
                return Err(format!("`{part}` makes more than {MOST} frames"));
            }
            frames.extend((0..count).map(|n| first + n * step));
        }
        Ok(Self(frames.into_iter().collect()))
    }
}

/// First, last and step of `5`, `1-48` or `1-48x2`.
fn range(part: &str) -> Result<(i64, i64, i64), String> {
    let form = || format!("`{part}` is no frame or range; write 5, 1-48, 1-48x2 or 1-10,20");
    let number = |text: &str| match text.parse::<i32>() {
        // A plus sign parses, but no farm writes it.
        Ok(frame) if !text.starts_with('+') => Ok(i64::from(frame)),
        _ => Err(form()),
    };
    let (span, step) = match part.split_once('x') {
        Some((span, step)) => (span, number(step)?),
        None => (part, 1),
    };
    // The first character may be a sign: -5--1.
    let dash = span.char_indices().skip(1).find(|(_, c)| *c == '-').map(|(at, _)| at);
    let (first, last) = match dash {
        Some(at) => (number(&span[..at])?, number(&span[at + 1..])?),
        None if span.len() < part.len() => return Err(form()),
        None => (number(span)?, number(span)?),
    };
    if step < 1 {
        return Err(format!("`{part}`: the step after x is a whole number from 1"));
    }
    if last < first {
        return Err(format!("`{part}` runs backwards; write {last}-{first}"));
    }
    Ok((first, last, step))
}

/// A path with a place for the frame number: `out.####.exr` or `out.%04d.exr`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    folder: PathBuf,
    before: String,
    digits: usize,
    after: String,
}

impl FromStr for Pattern {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let path = Path::new(text);
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        let found: Vec<_> = places(name);
        let [(start, end, digits)] = found[..] else {
            let what = if found.is_empty() { "has no place" } else { "has more than one place" };
            return Err(format!(
                "the name `{name}` {what} for the frame number; write #### or %04d once, as in out.####.exr"
            ));
        };
        if digits > MOST_DIGITS {
            return Err(format!("frame numbers of {digits} digits; {MOST_DIGITS} at most"));
        }
        Ok(Self { folder, before: name[..start].to_owned(), digits, after: name[end..].to_owned() })
    }
}

/// (start, end, digits) of each place for a number in a name.
fn places(name: &str) -> Vec<(usize, usize, usize)> {
    let bytes = name.as_bytes();
    let (mut places, mut at) = (Vec::new(), 0);
    while at < bytes.len() {
        let run = |from: usize, is: fn(&u8) -> bool| bytes[from..].iter().take_while(|b| is(b)).count();
        if bytes[at] == b'#' {
            let digits = run(at, |b| *b == b'#');
            places.push((at, at + digits, digits));
            at += digits;
        } else if bytes[at] == b'%' {
            let width = run(at + 1, u8::is_ascii_digit);
            let end = at + 1 + width;
            if bytes.get(end) == Some(&b'd') {
                places.push((at, end + 1, name[at + 1..end].parse().unwrap_or(if width > 0 { usize::MAX } else { 1 })));
            }
            at = end;
        } else {
            at += 1;
        }
    }
    places
}

impl Pattern {
    /// The path of a frame, its number padded with zeros (a sign counts as a digit, as in C's `%04d`).
    pub fn path(&self, frame: i64) -> PathBuf {
        let digits = self.digits;
        self.folder.join(OsString::from(format!("{}{frame:0digits$}{}", self.before, self.after)))
    }

    /// As it was written, with `#`.
    pub fn shown(&self) -> String {
        self.folder.join(format!("{}{}{}", self.before, "#".repeat(self.digits), self.after)).display().to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_exact() {
        for (text, frames) in [
            ("5", vec![5]),
            ("1-4", vec![1, 2, 3, 4]),
            ("1-8x3", vec![1, 4, 7]),
            ("3-3x9", vec![3]),
            ("1-3,20, 2-4", vec![1, 2, 3, 4, 20]),
            ("-2-1", vec![-2, -1, 0, 1]),
            ("-5--3", vec![-5, -4, -3]),
            ("0010-0011", vec![10, 11]),
        ] {
            assert_eq!(Frames::from_str(text).unwrap().numbers(), frames, "{text}");
        }
        for (text, word) in [
            ("", "``"),
            ("a", "`a`"),
            ("1-", "`1-`"),
            ("1-48y2", "`1-48y2`"),
            ("1.5", "`1.5`"),
            ("1-48x", "`1-48x`"),
            ("5x2", "`5x2`"),
            ("1-48x0", "from 1"),
            ("1-48x-1", "from 1"),
            ("48-1", "1-48"),
            ("1,,2", "``"),
            ("1-2000000", "more than 1000000"),
            ("1-99999999999", "`1-99999999999`"),
            ("+1", "`+1`"),
        ] {
            let message = Frames::from_str(text).unwrap_err();
            assert!(message.contains(word), "{text}: {message}");
        }
    }

    #[test]
    fn names_have_one_place_for_the_number() {
        for (text, frame, path) in [
            ("out.####.exr", 7, "out.0007.exr"),
            ("a b/out.%04d.exr", 7, "a b/out.0007.exr"),
            ("a#b/out%d.png", 123, "a#b/out123.png"),
            ("#.exr", 12345, "12345.exr"),
            ("o_###.100%.tif", -7, "o_-07.100%.tif"),
        ] {
            assert_eq!(Pattern::from_str(text).unwrap().path(frame), Path::new(path), "{text}");
        }
        assert_eq!(Pattern::from_str("a/out.%04d.exr").unwrap().shown(), "a/out.####.exr");
        for (text, word) in [
            ("out.exr", "no place"),
            ("##/out.exr", "no place"),
            ("out.##.#.exr", "more than one"),
            ("out.%4f.exr", "no place"),
            ("out.%099999999999999999999d.exr", "digits"),
        ] {
            let message = Pattern::from_str(text).unwrap_err();
            assert!(message.contains(word), "{text}: {message}");
        }
    }
}
