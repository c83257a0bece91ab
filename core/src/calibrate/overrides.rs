//! What a person says about highlights, in a text file: one photograph a line.
//!
//! ```text
//! # comments and empty lines are passed over
//! photo 12.jpg 1034.5 220        the highlight stands at this pixel
//! photo 13.jpg dir 0.1 0.7 0.7   the light comes from this direction
//! photo 14.jpg skip              leave this photograph out
//! ```

use std::collections::BTreeMap;
use std::path::Path;

use crate::error::{Error, Result};
use crate::math::Vec3;

/// What to do with one photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Override {
    /// The highlight stands at this pixel.
    Pixel {
        /// To the right.
        x: f64,
        /// Downwards.
        y: f64,
    },
    /// The light comes from this unit direction.
    Direction(Vec3),
    /// The photograph is left out.
    Skip,
}

/// Overrides by the photograph's name.
pub type Overrides = BTreeMap<String, Override>;

/// Reads an override file; every name must be one of `photographs` (file names without their folders).
///
/// # Errors
/// Each names the line: a photograph that is not there or is named twice, words for numbers, a direction without
/// length.
pub fn read(path: &Path, photographs: &[String]) -> Result<Overrides> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::io("read", path, source))?;
    parse(&text, &path.display().to_string(), photographs)
}

/// Parses the text of an override file; `place` names it in messages.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, place: &str, photographs: &[String]) -> Result<Overrides> {
    let mut overrides = Overrides::new();
    let lines = (1..).zip(text.trim_start_matches('\u{feff}').lines()).map(|(n, line)| (n, line.trim()));
    for (number, line) in lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#')) {
        let refuse =
            |found: String, expected: &str| Err(Error::invalid(format!("{place}, line {number}"), found, expected));
        let (name, said) = match parse_line(line) {
            Ok(parts) => parts,
            Err(word) => {
                return refuse(word, "`photo.jpg x y` in pixels, `photo.jpg dir x y z`, or `photo.jpg skip`");
            }
        };
        if !photographs.iter().any(|photograph| photograph == name) {
            return refuse(format!("the photograph `{name}`"), "one of the photographs given");
        }
        if overrides.insert(name.to_owned(), said).is_some() {
            return refuse(format!("`{name}` again"), "one line for each photograph");
        }
    }
    Ok(overrides)
}

/// Name and order of one line; names may hold blanks, so it is read from its end. The error is what was found.
fn parse_line(line: &str) -> std::result::Result<(&str, Override), String> {
    if let Some((name, "skip")) = last_word(line) {
        return Ok((name, Override::Skip));
    }
    let number = |text: Option<&str>| {
        let text = text.ok_or_else(|| format!("`{line}`"))?;
        let value = text.parse::<f64>().ok().filter(|v| v.is_finite());
        value.ok_or_else(|| format!("`{}` for a number", text.chars().take(60).collect::<String>()))
    };
    let mut rest = line;
    let mut pull = || {
        let (before, word) = last_word(rest)?;
        rest = before;
        Some(word)
    };
    let (last, middle) = (pull(), pull());
    let (b, a) = (number(last)?, number(middle)?);
    let before = rest;
    if let Some((head, word)) = last_word(before)
        && let Some((name, "dir")) = last_word(head)
    {
        let direction = Vec3::new(number(Some(word))?, a, b);
        let unit = direction.try_normalize(1e-9).ok_or("a direction without length")?;
        return Ok((name, Override::Direction(unit)));
    }
    if before.is_empty() {
        return Err(format!("`{line}`"));
    }
    Ok((before, Override::Pixel { x: a, y: b }))
}

/// A line without its last word, and the word; `None` where there is one word only.
fn last_word(line: &str) -> Option<(&str, &str)> {
    let (before, word) = line.trim_end().rsplit_once(char::is_whitespace)?;
    Some((before.trim_end(), word))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names() -> Vec<String> {
        ["photo 1.jpg", "b.jpg", "c.jpg"].map(str::to_owned).to_vec()
    }

    #[test]
    fn each_kind_of_line_is_understood() {
        let text = "# by hand\r\nphoto 1.jpg 10.5 20\r\n\nb.jpg\tdir 0 3 4\nc.jpg skip\n";
        let found = parse(text, "o.txt", &names()).unwrap();
        assert_eq!(found["photo 1.jpg"], Override::Pixel { x: 10.5, y: 20.0 });
        assert_eq!(found["b.jpg"], Override::Direction(Vec3::new(0.0, 0.6, 0.8)));
        assert_eq!(found["c.jpg"], Override::Skip);
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        for (text, word) in [
            ("b.jpg left up", "up"),
            ("\nb.jpg dir 0 0 0", "line 2"),
            ("b.jpg dir zero 0 1", "zero"),
            ("b.jpg 1", "b.jpg"),
            ("b.jpg 1,5 2", "1,5"),
            ("b.jpg 1 nan", "nan"),
            ("d.jpg skip", "d.jpg"),
            ("b.jpg skip\nb.jpg 1 2", "again"),
        ] {
            let message = parse(text, "o.txt", &names()).unwrap_err().to_string();
            assert!(message.contains("o.txt, line") && message.contains(word), "{text:?}: {message}");
        }
    }
}
