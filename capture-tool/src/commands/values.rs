//! Values of options, parsed against the one table of settings: NaN, infinities and what lies beyond the hard bounds are
//! wrong usage.

use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use relume_core::evaluate::{FEWEST_KEPT, Keep};
use relume_core::illumination::probe::Circle;
use relume_core::image::ColourSpace;
use relume_core::settings::{Kind, Setting};
use relume_core::wavelet::Wavelet;

/// A parser for a number of the table.
pub fn number(setting: &'static Setting) -> impl Fn(&str) -> Result<f64, String> + Clone {
    let (low, high) = match setting.kind {
        Kind::Number { hard, .. } => hard,
        Kind::Integer { hard, .. } => (f64::from(hard.0), f64::from(hard.1)),
        Kind::Colour { hard, .. } => hard,
        Kind::Choice { .. } | Kind::File => (f64::NEG_INFINITY, f64::INFINITY),
    };
    move |text| {
        let value = finite(text)?;
        if (low..=high).contains(&value) { Ok(value) } else { Err(format!("not between {low} and {high}")) }
    }
}

/// A parser for a colour of the table: three numbers with commas between them.
pub fn colour(setting: &'static Setting) -> impl Fn(&str) -> Result<[f64; 3], String> + Clone {
    let channel = number(setting);
    move |text| {
        let parts: Vec<&str> = text.split(',').map(str::trim).collect();
        let [r, g, b] = parts[..] else {
            let count = if parts.len() == 1 { "one number".to_owned() } else { format!("{} numbers", parts.len()) };
            return Err(format!("{count}; write red, green and blue, as in 1,0.9,0.8"));
        };
        let read = |part: &str| channel(part).map_err(|error| format!("`{part}` is {error}"));
        Ok([read(r)?, read(g)?, read(b)?])
    }
}

/// A parser for a colour space, by its id. An unknown one is refused with the nearest known.
pub fn colour_space(text: &str) -> Result<ColourSpace, String> {
    text.parse().map_err(|error| match error {
        relume_core::Error::Invalid { expected, .. } => format!("no known colour space; it must be {expected}"),
        other => other.to_string(),
    })
}

/// The neutral value of a number of the table.
pub fn neutral(setting: &Setting) -> f64 {
    match setting.kind {
        Kind::Number { default, .. } => default,
        Kind::Integer { default, .. } => f64::from(default),
        Kind::Choice { .. } | Kind::Colour { .. } | Kind::File => 0.0,
    }
}

/// A parser for a choice of the table; gives the index of the option.
pub fn choice(setting: &'static Setting) -> impl TypedValueParser<Value = usize> {
    let options = options(setting);
    PossibleValuesParser::new(options.iter().map(|(id, label)| PossibleValue::new(*id).help(*label)))
        .map(move |given| options.iter().position(|(id, _)| *id == given).unwrap_or_default())
}

/// The id of the neutral option of a choice.
pub fn neutral_option(setting: &'static Setting) -> &'static str {
    match setting.kind {
        Kind::Choice { default, options } => options.get(default).map_or("", |option| option.0),
        _ => "",
    }
}

fn options(setting: &'static Setting) -> &'static [(&'static str, &'static str)] {
    match setting.kind {
        Kind::Choice { options, .. } => options,
        _ => &[],
    }
}

/// A positive number that an f32 holds.
pub fn positive(text: &str) -> Result<f32, String> {
    let value = finite(text)? as f32;
    if value.is_normal() && value > 0.0 { Ok(value) } else { Err("not a positive number".to_owned()) }
}

/// Three positive numbers with commas between.
pub fn three_positive(text: &str) -> Result<[f64; 3], String> {
    let numbers: [f64; 3] = listed(text, finite)?;
    if numbers.iter().all(|v| *v > 0.0) { Ok(numbers) } else { Err("not three positive numbers".to_owned()) }
}

/// Eight numbers with commas between.
pub fn eight_numbers(text: &str) -> Result<[f64; 8], String> {
    listed(text, finite)
}

/// A place and a size: left, top, and a width and height that are not zero.
pub fn four_counts(text: &str) -> Result<[usize; 4], String> {
    let counts: [usize; 4] = listed(text, count)?;
    if counts[2] > 0 && counts[3] > 0 { Ok(counts) } else { Err("a width or height of zero".to_owned()) }
}

/// A pixel: column and row from the top left, from 0.
pub fn pixel(text: &str) -> Result<[usize; 2], String> {
    listed(text, count)
}

/// Columns x rows of a grid.
pub fn grid(text: &str) -> Result<(usize, usize), String> {
    let parts = text.split_once(['x', 'X']).and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    parts.ok_or_else(|| "not two whole numbers with an x between, as in 64x20 or 256x64".to_owned())
}

fn count(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| format!("`{text}` is not a whole number from 0 on"))
}

fn listed<T, const N: usize>(text: &str, parse: impl Fn(&str) -> Result<T, String>) -> Result<[T; N], String> {
    let parts: Vec<T> = text.split(',').map(|part| parse(part.trim())).collect::<Result<_, _>>()?;
    let found = parts.len();
    parts.try_into().map_err(|_| format!("{found} numbers in place of {N}, with commas between and decimal dots"))
}

/// A time as people write it: 90s, 45m, 1h30m.
pub fn duration(text: &str) -> Result<std::time::Duration, String> {
    let parsed: Option<jiff::SignedDuration> = text.parse().ok();
    let positive = parsed.filter(|d| d.is_positive()).and_then(|d| std::time::Duration::try_from(d).ok());
    positive.ok_or_else(|| "not a time such as 90s, 45m, 2h or 1h30m".to_owned())
}

/// The most numbers that a list of ranges may name.
const MOST_NUMBERS: u64 = 1_000_000;

/// Codes of an 8-bit emitter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Codes(pub Vec<u8>);

/// Codes of 0 to 255 with commas between, none twice.
pub fn codes(text: &str) -> Result<Codes, String> {
    let code = |part: &str| part.trim().parse().map_err(|_| format!("`{}` is no code from 0 to 255", part.trim()));
    let codes: Vec<u8> = text.split(',').map(code).collect::<Result<_, _>>()?;
    match (1..codes.len()).find(|n| codes[..*n].contains(&codes[*n])) {
        Some(again) => Err(format!("code {} comes twice", codes[again])),
        None => Ok(Codes(codes)),
    }
}

/// A list of numbers.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Numbers(pub Vec<u64>);

/// Numbers from 1 on and ranges of them, with commas between: 37,52-60. Sorted, none twice.
pub fn numbers(text: &str) -> Result<Numbers, String> {
    let range = |part: &str| {
        let (from, to) = part.split_once('-').unwrap_or((part, part));
        let number = |text: &str| text.trim().parse::<u64>().ok().filter(|n| *n > 0);
        match (number(from), number(to)) {
            (Some(from), Some(to)) if from <= to && to - from < MOST_NUMBERS => Ok(from..=to),
            _ => Err(format!("`{part}` is no number from 1 on, nor a range such as 52-60")),
        }
    };
    let ranges: Vec<_> = text.split(',').map(range).collect::<Result<_, _>>()?;
    let mut numbers: Vec<u64> = ranges.into_iter().flatten().collect();
    numbers.sort_unstable();
    numbers.dedup();
    Ok(Numbers(numbers))
}

/// How many lamps to keep: a part below one, as 1/4 or 0.25, or a whole number.
pub fn keep(text: &str) -> Result<Keep, String> {
    const WANTED: &str = "not a part such as 1/4 or 0.25, nor a whole number of lamps";
    let part = |share: f64| {
        if share > 0.0 && share < 1.0 {
            Ok(Keep::Share(share))
        } else {
            Err("not a part more than zero and less than one".to_owned())
        }
    };
    if let Some((above, below)) = text.split_once('/') {
        let number = |text: &str| u32::from_str(text.trim()).map_err(|_| WANTED.to_owned());
        let (above, below) = (number(above)?, number(below)?);
        return if below == 0 {
            Err("divided by nothing".to_owned())
        } else {
            part(f64::from(above) / f64::from(below))
        };
    }
    match usize::from_str(text) {
        Ok(count) if count < FEWEST_KEPT => Err(format!("at least {FEWEST_KEPT} lamps are needed")),
        Ok(count) => Ok(Keep::Count(count)),
        Err(_) if text.contains('.') || text.contains(',') => part(finite(text)?),
        Err(_) => Err(WANTED.to_owned()),
    }
}

/// A wavelet that can be mirrored at the edges of a screen.
pub fn wavelet(text: &str) -> Result<Wavelet, String> {
    let known = text.parse().ok().filter(|wavelet: &Wavelet| wavelet.is_symmetric());
    known.ok_or_else(|| format!("`{text}` is no wavelet for a screen; it must be haar, 5/3 or 9/7"))
}

/// A number of things, at least one.
pub fn at_least_one(text: &str) -> Result<usize, String> {
    match usize::from_str(text) {
        Ok(0) => Err("none; at least 1 is needed".to_owned()),
        Ok(count) => Ok(count),
        Err(_) => Err("not a whole number from 1 on".to_owned()),
    }
}

/// `N` finite numbers with commas between them.
pub fn list<const N: usize>(text: &str) -> Result<[f64; N], String> {
    listed(text, finite)
}

/// A circle `X,Y,R` in pixels.
pub fn circle(text: &str) -> Result<Circle, String> {
    let [x, y, radius] = list(text).map_err(|why| format!("{why}: X,Y,R in pixels"))?;
    if radius > 0.0 { Ok(Circle { x, y, radius }) } else { Err("the radius is not positive".to_owned()) }
}

/// A share, 0 to 1.
pub fn share(text: &str) -> Result<f64, String> {
    let share = finite(text)?;
    if (0.0..=1.0).contains(&share) { Ok(share) } else { Err("not a share, 0 to 1".to_owned()) }
}

/// An exposure time as photographers write it: 1/60, 0.5, 30; seconds.
pub fn exposure_time(text: &str) -> Result<f64, String> {
    let time = match text.split_once('/') {
        Some((over, under)) => finite(over.trim())? / finite(under.trim())?,
        None => finite(text)?,
    };
    if time > 0.0 && time.is_finite() { Ok(time) } else { Err("not a time such as 1/60 or 0.5".to_owned()) }
}

/// A short time, seconds.
pub fn seconds(text: &str) -> Result<f64, String> {
    let seconds = finite(text)?;
    if (0.0..=60.0).contains(&seconds) { Ok(seconds) } else { Err("not a time from 0 to 60 seconds".to_owned()) }
}

/// A finite number.
pub fn finite(text: &str) -> Result<f64, String> {
    match f64::from_str(text) {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err("not a finite number".to_owned()),
        Err(_) if text.contains(',') => Err("not a number; write a decimal dot, as in 0.5".to_owned()),
        Err(_) => {
            let unit = text.trim_start_matches(|c: char| c.is_ascii_digit() || "+-.".contains(c));
            match f64::from_str(&text[..text.len() - unit.len()]) {
                Ok(number) => Err(format!("not a number; write it without a unit, as in {number}")),
                Err(_) => Err("not a number".to_owned()),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use relume_core::settings;

    use super::*;

    #[test]
    fn numbers_keep_to_the_table() {
        let parse = number(&settings::AMBIENT);
        assert_eq!(parse("0.5"), Ok(0.5));
        for bad in ["-0.1", "1001", "NaN", "inf", "-inf", "0,5", "half", ""] {
            assert!(parse(bad).is_err(), "{bad}");
        }
        assert_eq!(number(&settings::ROTATION)("-90"), Ok(-90.0));
        let said = number(&settings::ROTATION)("-45deg").unwrap_err();
        assert!(said.contains("without a unit, as in -45"), "{said}");
    }

    #[test]
    fn neutral_values_are_within_their_bounds() {
        for setting in settings::RELIGHT.iter().chain(settings::matte::MATTE) {
            match setting.kind {
                Kind::Number { default, hard, .. } => {
                    assert_eq!(neutral(setting), default);
                    assert!((hard.0..=hard.1).contains(&default), "{}", setting.id);
                }
                Kind::Choice { default, options } => assert_eq!(neutral_option(setting), options[default].0),
                Kind::Colour { default, hard, .. } => {
                    assert!(default.iter().all(|v| (hard.0..=hard.1).contains(v)), "{}", setting.id);
                }
                Kind::Integer { .. } | Kind::File => {}
            }
        }
    }

    #[test]
    fn colours_are_three_numbers_and_spaces_have_names() {
        let parse = colour(&settings::TINT);
        assert_eq!(parse("1, 0.5,2"), Ok([1.0, 0.5, 2.0]));
        for (bad, said) in [
            ("1,2", "2 numbers"),
            ("1", "one number"),
            ("1,2,3,4", "4 numbers"),
            ("1,nan,1", "finite"),
            ("1,-1,1", "between"),
        ] {
            let message = parse(bad).unwrap_err();
            assert!(message.contains(said), "{bad}: {message}");
        }
        assert_eq!(colour_space("acescg"), Ok(ColourSpace::AcesCg));
        let message = colour_space("acescgg").unwrap_err();
        assert!(message.contains("`acescg` is near") && message.contains("lin_p3d65"), "{message}");
    }

    #[test]
    fn lists_have_their_length() {
        assert_eq!(list::<3>("1, -2.5,3"), Ok([1.0, -2.5, 3.0]));
        for bad in ["", "1,2", "1,2,3,4", "1,2,x", "1,2,nan"] {
            assert!(list::<3>(bad).is_err(), "{bad}");
        }
        assert!(circle("5,5,0").is_err());
    }

    #[test]
    fn irradiances_are_positive() {
        assert_eq!(positive("2"), Ok(2.0));
        for bad in ["0", "-1", "1e60", "1e-60", "nan", "inf"] {
            assert!(positive(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn parts_of_a_set() {
        assert_eq!(keep("1/4"), Ok(Keep::Share(0.25)));
        assert_eq!(keep("0.25"), Ok(Keep::Share(0.25)));
        assert_eq!(keep("320"), Ok(Keep::Count(320)));
        for bad in
            ["0", "3", "1/0", "0/4", "4/4", "5/4", "-1/4", "1/4/2", "1.5", "0.0", "-4", "nan", "", "quarter", "0,25"]
        {
            assert!(keep(bad).is_err(), "{bad}");
        }
    }
}
