//! Values of options, parsed against the one table of settings: NaN, infinities and what lies beyond the hard bounds are
//! wrong usage.

use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use relume_core::image::ColourSpace;
use relume_core::settings::{Kind, Setting};

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

fn finite(text: &str) -> Result<f64, String> {
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
        for setting in settings::RELIGHT {
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
    fn irradiances_are_positive() {
        assert_eq!(positive("2"), Ok(2.0));
        for bad in ["0", "-1", "1e60", "1e-60", "nan", "inf"] {
            assert!(positive(bad).is_err(), "{bad}");
        }
    }
}
