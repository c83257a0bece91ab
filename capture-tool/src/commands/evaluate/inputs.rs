//! Flags that several measurements take.

use std::path::Path;

use anyhow::Context;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use relume_core::Error;
use relume_core::field::Asset;
use relume_core::illumination::EnvMap;
use relume_core::reconstruct::Method;

/// A parser for the name of a method.
pub fn method() -> impl TypedValueParser<Value = Method> {
    let names = Method::ALL.iter().map(|method| PossibleValue::new(method.id()).help(method.label()));
    let of_name = |name: String| Method::ALL.iter().copied().find(|method| method.id() == name).unwrap_or_default();
    PossibleValuesParser::new(names).map(of_name)
}

/// The column that is shown over time: the one asked for, or the middle.
///
/// # Errors
/// A column outside of the picture.
pub fn column(asked: Option<usize>, asset: &Asset) -> relume_core::Result<usize> {
    let column = asked.unwrap_or(asset.width() / 2);
    if column < asset.width() {
        return Ok(column);
    }
    let expected = format!("0 to {}, the columns of {}", asset.width() - 1, asset.path().display());
    Err(Error::invalid("--column", column.to_string(), expected))
}

/// A map and the name of its file.
///
/// # Errors
/// No such file, or no lat-long map.
pub fn environment(path: &Path) -> anyhow::Result<(String, EnvMap)> {
    let map = EnvMap::load(path).context("cannot use the environment map")?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok((name, map))
}
