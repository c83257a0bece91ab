//! The one door for TOML files that people write: lighting presets, animation scripts.
//!
//! A table is first asked whether it holds [`Table::only`] known keys, so that a slip of the pen is named with the key
//! that was meant, then for each value within its bounds. Every error says file and line.

use std::path::Path;

use toml::de::{DeTable, DeValue};

use crate::error::{Error, Result};

/// No file that a person writes is larger.
const LARGEST_FILE: u64 = 1 << 20;
/// Words this much alike (0 to 1, Damerau-Levenshtein) may be a slip of the pen.
const ALIKE: f64 = 0.55;

/// Reads a text file of reasonable size.
///
/// # Errors
/// [`Error::Io`]; a file that is not text, or far too large to be a script.
pub fn read_text(path: &Path) -> Result<String> {
    let refuse = |found: String| Err(Error::invalid(path.display().to_string(), found, "a small TOML text file"));
    let bytes = std::fs::metadata(path).map_err(|source| Error::io("read", path, source))?.len();
    if bytes > LARGEST_FILE {
        return refuse(format!("{bytes} bytes"));
    }
    let data = std::fs::read(path).map_err(|source| Error::io("read", path, source))?;
    String::from_utf8(data).or_else(|_| refuse("bytes that are not UTF-8 text".to_owned()))
}

/// Where a text comes from, for messages.
#[derive(Clone, Copy)]
pub struct Place<'a> {
    file: &'a str,
    text: &'a str,
}

impl<'a> Place<'a> {
    /// `file` is how messages call the text.
    pub fn new(file: &'a str, text: &'a str) -> Self {
        Self { file, text }
    }

    /// "file, line n" of a byte.
    fn at(&self, byte: usize) -> String {
        let line = self.text.bytes().take(byte).filter(|b| *b == b'\n').count() + 1;
        format!("{}, line {line}", self.file)
    }

    /// The text as TOML.
    ///
    /// # Errors
    /// What breaks the syntax, with its line.
    pub fn parse(&self) -> Result<DeTable<'a>> {
        DeTable::parse(self.text).map(toml::Spanned::into_inner).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start);
            let line = self.text[..at.min(self.text.len())].lines().count().max(1);
            let line = self.text.lines().nth(line - 1).unwrap_or_default().trim();
            let what = error.message().lines().next().unwrap_or_default().to_owned();
            Error::invalid(
                self.at(at),
                format!("`{line}`"),
                format!("TOML, with numbers bare and text in quotes, such as `azimuth = 45` ({what})"),
            )
        })
    }
}

/// Bounds of a number.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    /// Smallest.
    pub low: f64,
    /// Largest.
    pub high: f64,
    /// "degrees", "stops"; empty where numbers stand for themselves.
    pub unit: &'static str,
}

impl Bounds {
    /// `low` to `high`, both allowed.
    pub const fn new(low: f64, high: f64, unit: &'static str) -> Self {
        Self { low, high, unit }
    }

    fn say(&self) -> String {
        let blank = if self.unit.is_empty() { "" } else { " " };
        format!("a number from {} to {}{blank}{}", self.low, self.high, self.unit)
    }
}

/// A value with its place.
#[derive(Clone, Copy)]
pub struct Value<'a> {
    place: Place<'a>,
    start: usize,
    key: &'a str,
    value: &'a DeValue<'a>,
}

impl<'a> Value<'a> {
    /// An error here: found, expected.
    pub fn refuse(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::invalid(self.place.at(self.start), format!("{} in `{}`", found.into(), self.key), expected)
    }

    /// Its key.
    pub fn key(&self) -> &'a str {
        self.key
    }

    fn shown(&self) -> String {
        match self.value {
            DeValue::String(text) => format!("the text \"{text}\""),
            DeValue::Integer(number) => number.to_string(),
            DeValue::Float(number) => number.to_string(),
            DeValue::Boolean(truth) => truth.to_string(),
            DeValue::Array(items) => format!("a list of {}", items.len()),
            DeValue::Table(_) => "a table".to_owned(),
            DeValue::Datetime(_) => "a date".to_owned(),
        }
    }

    /// A finite number within bounds.
    pub fn number(&self, bounds: Bounds) -> Result<f64> {
        let value = match self.value {
            DeValue::Integer(n) => i64::from_str_radix(n.as_str(), n.radix()).ok().map(|n| n as f64),
            DeValue::Float(n) => n.as_str().parse().ok(),
            _ => None,
        };
        if let Some(value) = value.filter(|v| (bounds.low..=bounds.high).contains(v)) {
            return Ok(value);
        }
        let hint = match self.value {
            DeValue::String(text) => leading_number(text).map_or_else(
                || ", without quotes".to_owned(),
                |n| format!(", without unit and quotes: {} = {n}", self.key),
            ),
            _ => String::new(),
        };
        Err(self.refuse(self.shown(), format!("{}{hint}", bounds.say())))
    }

    /// A whole number within bounds.
    pub fn whole(&self, bounds: Bounds) -> Result<f64> {
        let value = self.number(bounds)?;
        if value.fract() == 0.0 { Ok(value) } else { Err(self.refuse(self.shown(), "a whole number")) }
    }

    /// Text.
    pub fn text(&self) -> Result<&'a str> {
        self.value.as_str().ok_or_else(|| self.refuse(self.shown(), "text in quotes"))
    }

    /// One of several words.
    pub fn choice(&self, words: &[&str]) -> Result<usize> {
        let given = self.text()?;
        words.iter().position(|word| *word == given).ok_or_else(|| {
            let expected = one_of(words, given);
            self.refuse(format!("\"{given}\""), expected)
        })
    }

    /// `N` numbers in a list.
    pub fn numbers<const N: usize>(&self, bounds: Bounds) -> Result<[f64; N]> {
        let items = self.list().filter(|items| items.len() == N);
        let items = items.ok_or_else(|| self.refuse(self.shown(), format!("a list of {N} numbers")))?;
        let mut out = [0.0; N];
        for (out, item) in out.iter_mut().zip(items) {
            *out = item.number(bounds)?;
        }
        Ok(out)
    }

    /// The items of a list; `None` for anything else.
    pub fn list(&self) -> Option<Vec<Value<'a>>> {
        let items = self.value.as_array()?;
        let item = |i: &'a toml::Spanned<DeValue<'a>>| Value { start: i.span().start, value: i.get_ref(), ..*self };
        Some(items.iter().map(item).collect())
    }

    /// The table here; `None` for anything else.
    pub fn table(&self) -> Option<Table<'a>> {
        self.value.as_table().map(|table| Table { place: self.place, start: self.start, what: self.key, table })
    }
}

/// The number a text begins with: 45 of "45deg".
fn leading_number(text: &str) -> Option<f64> {
    let text = text.trim();
    let end = text.find(|c: char| !(c.is_ascii_digit() || "+-.".contains(c))).unwrap_or(text.len());
    text[..end].parse().ok().filter(|n: &f64| n.is_finite())
}

/// "`a` (one of `a`, `b`)" where one is alike, else "one of ...".
pub fn one_of(words: &[&str], given: &str) -> String {
    let list = words.iter().map(|word| format!("`{word}`")).collect::<Vec<_>>().join(", ");
    nearest(words, given).map_or(format!("one of {list}"), |word| format!("`{word}`, the nearest of {list}"))
}

/// The word that was meant, if one is alike.
pub fn nearest<'w>(words: &[&'w str], given: &str) -> Option<&'w str> {
    let given = given.to_lowercase();
    let alike = |word: &str| strsim::normalized_damerau_levenshtein(&word.to_lowercase(), &given);
    let best = words.iter().map(|word| (alike(word), *word)).max_by(|a, b| a.0.total_cmp(&b.0));
    best.filter(|(score, _)| *score >= ALIKE).map(|(_, word)| word)
}

/// A table with its place.
#[derive(Clone, Copy)]
pub struct Table<'a> {
    place: Place<'a>,
    start: usize,
    what: &'a str,
    table: &'a DeTable<'a>,
}

impl<'a> Table<'a> {
    /// The whole of a file; `what` is how messages call it.
    pub fn root(place: Place<'a>, table: &'a DeTable<'a>, what: &'a str) -> Self {
        Self { place, start: 0, what, table }
    }

    /// Under another name in messages.
    pub fn called(self, what: &'a str) -> Self {
        Self { what, ..self }
    }

    /// Refuses keys that are none of `known`.
    ///
    /// # Errors
    /// The first unknown key in the file, with the nearest known one.
    pub fn only(&self, known: &[&str]) -> Result<()> {
        let stray = self.table.iter().filter(|(key, _)| !known.contains(&&**key.get_ref()));
        let Some((key, _)) = stray.min_by_key(|(key, _)| key.span().start) else { return Ok(()) };
        let expected = match nearest(known, key.get_ref()) {
            Some(meant) => format!("`{meant}`; {} takes {}", self.what, known.join(", ")),
            None => format!("one of {}, which {} takes", known.join(", "), self.what),
        };
        Err(Error::invalid(self.place.at(key.span().start), format!("the unknown key `{}`", key.get_ref()), expected))
    }

    /// A value.
    pub fn get(&self, key: &'static str) -> Option<Value<'a>> {
        let value = self.table.get(key)?;
        Some(Value { place: self.place, start: value.span().start, key, value: value.get_ref() })
    }

    /// A value that must be there.
    pub fn need(&self, key: &'static str) -> Result<Value<'a>> {
        self.get(key).ok_or_else(|| self.refuse(format!("no `{key}` in {}", self.what), format!("`{key} = ...`")))
    }

    /// An error about the whole table.
    pub fn refuse(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::invalid(self.place.at(self.start), found, expected)
    }

    /// A number, or its default.
    pub fn number_or(&self, key: &'static str, bounds: Bounds, default: f64) -> Result<f64> {
        self.get(key).map_or(Ok(default), |value| value.number(bounds))
    }

    /// Text, or nothing.
    pub fn text_or_empty(&self, key: &'static str) -> Result<&'a str> {
        self.get(key).map_or(Ok(""), |value| value.text())
    }

    /// The tables of `[[key]]`, in order.
    pub fn tables(&self, key: &'static str) -> Result<Vec<Table<'a>>> {
        let Some(value) = self.get(key) else { return Ok(Vec::new()) };
        let wrong = || value.refuse(value.shown(), format!("tables that begin with `[[{key}]]`"));
        let items = value.list().ok_or_else(wrong)?;
        items.iter().map(|item| item.table().ok_or_else(wrong)).collect()
    }
}
