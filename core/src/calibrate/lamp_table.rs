//! What a `.lp` file cannot hold: each lamp's irradiance and, of near lamps, its place.
//!
//! Text, a photograph a line, columns parted by tabs; the first line is `photograph`, `irradiance`, `x_m`, `y_m`, `z_m`,
//! and the last three columns may be left out where places are not known.

use std::collections::HashMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::math::Vec3;

/// The first line.
const HEADER: &str = "photograph\tirradiance\tx_m\ty_m\tz_m";

/// One lamp.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Name of its photograph, without folders.
    pub photograph: String,
    /// On a patch facing the lamp, in the photographs' own unit: pi makes a white diffuser facing the lamp photograph
    /// as 1.
    pub irradiance: f64,
    /// In the stage frame, metres.
    pub position_m: Option<Vec3>,
}

/// The text of a table.
pub fn text(rows: &[Row]) -> String {
    let mut text = format!("{HEADER}\n");
    for row in rows {
        // Seven digits that count, whatever the unit.
        let decimals = (6.0 - row.irradiance.log10().floor()).clamp(6.0, 40.0) as usize;
        let _ = write!(text, "{}\t{:.decimals$}", row.photograph, row.irradiance);
        if let Some(p) = row.position_m {
            let _ = write!(text, "\t{:.5}\t{:.5}\t{:.5}", p.x, p.y, p.z);
        }
        text.push('\n');
    }
    text
}

/// Reads a table and puts it into the order of `photographs`; rows of other photographs are passed over.
///
/// # Errors
/// Each names file and line: no header, words for numbers, an irradiance that is not positive, a photograph twice or
/// not at all.
pub fn read(path: &Path, photographs: &[PathBuf]) -> Result<Vec<Row>> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::io("read", path, source))?;
    ordered(parse(&text, path)?, photographs, path)
}

fn parse(text: &str, path: &Path) -> Result<Vec<Row>> {
    let place = |line: usize| format!("{}, line {line}", path.display());
    let mut lines = (1..).zip(text.trim_start_matches('\u{feff}').lines()).filter(|(_, line)| !line.trim().is_empty());
    let first = lines.next().map_or("nothing", |(_, line)| line);
    if !first.starts_with("photograph\tirradiance") {
        let found = format!("`{}`", first.chars().take(60).collect::<String>());
        return Err(Error::invalid(
            place(1),
            found,
            "columns parted by tabs, headed `photograph`, `irradiance`, `x_m`, `y_m`, `z_m`",
        ));
    }
    lines
        .map(|(n, line)| {
            parse_row(line).map_err(|found| {
                Error::invalid(
                    place(n),
                    found,
                    "`photograph`, a positive irradiance and, where the place is known, three metres",
                )
            })
        })
        .collect()
}

/// One row; the error is what was found.
fn parse_row(line: &str) -> std::result::Result<Row, String> {
    let mut columns = line.trim_end().split('\t');
    let photograph = columns.next().unwrap_or_default().trim().to_owned();
    let numbers: Vec<f64> = columns
        .map(|word| {
            let number = word.trim().parse::<f64>().ok().filter(|v| v.is_finite());
            number.ok_or_else(|| format!("`{}` for a number", word.trim().chars().take(60).collect::<String>()))
        })
        .collect::<std::result::Result<_, String>>()?;
    let (irradiance, position_m) = match numbers[..] {
        [e] => (e, None),
        [e, x, y, z] => (e, Some(Vec3::new(x, y, z))),
        _ => return Err(format!("{} numbers", numbers.len())),
    };
    if irradiance <= 0.0 {
        return Err(format!("an irradiance of {irradiance}"));
    }
    Ok(Row { photograph, irradiance, position_m })
}

fn ordered(rows: Vec<Row>, photographs: &[PathBuf], path: &Path) -> Result<Vec<Row>> {
    let mut by_name = HashMap::new();
    for row in rows {
        if let Some(twice) = by_name.insert(row.photograph.clone(), row) {
            let found = format!("`{}` twice", twice.photograph);
            return Err(Error::invalid(path.display().to_string(), found, "each photograph once"));
        }
    }
    let row = |photograph: &PathBuf| {
        let name = photograph.file_name().unwrap_or_default().to_string_lossy();
        by_name.get(name.as_ref()).cloned().ok_or_else(|| {
            let found = format!("no line for the photograph `{name}`");
            Error::invalid(path.display().to_string(), found, "a line for every photograph of the .lp file")
        })
    };
    photographs.iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_return_in_the_order_of_the_photographs() {
        let rows = [
            Row { photograph: "a 1.jpg".into(), irradiance: 2.5, position_m: Some(Vec3::new(0.1, -0.2, 1.5)) },
            Row { photograph: "b.jpg".into(), irradiance: 3.0, position_m: None },
        ];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lamps.tsv");
        std::fs::write(&path, text(&rows)).unwrap();
        let found = read(&path, &["x/b.jpg".into(), "x/a 1.jpg".into()]).unwrap();
        assert_eq!(found, [rows[1].clone(), rows[0].clone()]);
        let message = read(&path, &["c.jpg".into()]).unwrap_err().to_string();
        assert!(message.contains("lamps.tsv") && message.contains("c.jpg"), "{message}");
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        for (body, word) in [
            ("a\tbright", "bright"),
            ("a\t0", "0"),
            ("a\t-2", "-2"),
            ("a\t1\t2", "2 numbers"),
            ("a", "0 numbers"),
            ("a\tnan", "nan"),
        ] {
            let message = parse(&format!("{HEADER}\n\n{body}\n"), Path::new("l.tsv")).unwrap_err().to_string();
            assert!(message.contains("l.tsv, line 3") && message.contains(word), "{body:?}: {message}");
        }
        assert!(parse("a 1\n", Path::new("l.tsv")).unwrap_err().to_string().contains("headed"));
    }
}
