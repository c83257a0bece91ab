//! Values of options, parsed against the one table of settings: NaN, infinities and what lies beyond the hard bounds are
//! wrong usage.

use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use relume_core::illumination::probe::Circle;
use relume_core::settings::{Kind, Setting};

/// A parser for a number of the table.
pub fn number(setting: &'static Setting) -> impl Fn(&str) -> Result<f64, String> + Clone {
    let (low, high) = match setting.kind {
        Kind::Number { hard, .. } => hard,
        Kind::Integer { hard, .. } => (f64::from(hard.0), f64::from(hard.1)),
        Kind::Choice { .. } | Kind::File => (f64::NEG_INFINITY, f64::INFINITY),
    };
    move |text| {
        let value = finite(text)?;
        if (low..=high).contains(&value) { Ok(value) } else { Err(format!("not between {low} and {high}")) }
    }
}

/// The neutral value of a number of the table.
pub fn neutral(setting: &Setting) -> f64 {
    match setting.kind {
        Kind::Number { default, .. } => default,
        Kind::Integer { default, .. } => f64::from(default),
        Kind::Choice { .. } | Kind::File => 0.0,
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

/// `N` finite numbers with commas between them.
pub fn list<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let parts = text.split(',').map(|part| finite(part.trim())).collect::<Result<Vec<f64>, String>>();
    let parts = parts.map_err(|why| format!("{why} (write {N} numbers with commas between them)"))?;
    let count = parts.len();
    parts.try_into().map_err(|_| format!("{count} numbers where {N} are expected, with commas between them"))
}

/// A circle `X,Y,R` in pixels.
pub fn circle(text: &str) -> Result<Circle, String> {
    let [x, y, radius] = list(text).map_err(|why| format!("{why}: X,Y,R in pixels"))?;
    if radius > 0.0 { Ok(Circle { x, y, radius }) } else { Err("the radius is not positive".to_owned()) }
}

/// A finite number.
pub fn finite(text: &str) -> Result<f64, String> {
    match f64::from_str(text) {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err("not a finite number".to_owned()),
        Err(_) if text.contains(',') => Err("not a number; write a decimal dot, as in 0.5".to_owned()),
        Err(_) => Err("not a number".to_owned()),
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
                Kind::Integer { .. } | Kind::File => {}
            }
        }
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
}
