//! Imports of patterns that an emitter showed, and the photograph under each.
//!
//! The session gets the photographs as conditions `pattern N`, and the patterns in a folder of their own:
//!
//! ```text
//! patterns/       the pictures that were shown, as they were given, in their order; patterns.toml if they came with one
//! calibration/    the emitter's measured curve, if it has one
//! ```
//!
//! What a pattern emitted is what its codes become by the emitter's curve, less what code 0 becomes; photographs have the
//! black one subtracted to match.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use relume_core::{Error, Result};
use serde::Serialize;

use super::staging::copy_into;
use super::{Description, Frame, ImportDescription, Line, Photograph, Role, Source};
use crate::new_folder::NewFolder;
use crate::rigs::Condition;

/// Where the shown pictures lie.
const PATTERNS: &str = "patterns";

/// What is imported; everything was checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Pairs {
    /// Pictures that were shown, in order.
    pub patterns: Vec<PathBuf>,
    /// Photographs, in the same order.
    pub photographs: Vec<PathBuf>,
    /// The photograph under code 0.
    pub black: Option<PathBuf>,
    /// The photograph under the largest code.
    pub white: Option<PathBuf>,
    /// What the patterns' folder says of them.
    pub description: Option<PathBuf>,
    /// Kind of the set, as in `patterns.toml`, or `pairs`.
    pub set: String,
    /// How codes became light.
    pub emitted: Emitted,
    /// Pixels along each side of a texel.
    pub texel: usize,
    /// Texels of a pattern.
    pub plane: (usize, usize),
    /// Size of the photographs.
    pub size: (usize, usize),
    /// How the photographs' codes become light: `auto`, `srgb` or `linear`.
    pub encoding: String,
    /// Id of their colours.
    pub colour_space: String,
}

/// The curve of the emitter.
#[derive(Debug, Clone, PartialEq)]
pub enum Emitted {
    /// By its name: `linear` or `srgb`.
    Known(String),
    /// The file of a measured one.
    Table(PathBuf),
}

/// What this kind of import has of its own; paths inside the session.
#[derive(Debug, Serialize)]
struct Settings {
    set: String,
    /// Files of the patterns, in order; photograph N + 1 is the answer to pattern N.
    patterns: Vec<String>,
    columns: usize,
    rows: usize,
    texel: usize,
    /// `linear`, `srgb`, or the file of a measured curve.
    emitted: String,
}

/// Copies patterns and photographs, hashing each; `progress(pairs done, all)` may stop it.
///
/// # Errors
/// A file that cannot be read, or no room. Nothing is left behind.
pub fn stage(target: &Path, pairs: &Pairs, progress: &mut dyn FnMut(u64, u64) -> Result<()>) -> Result<NewFolder> {
    let folder = NewFolder::begin(target)?;
    let root = folder.path();
    let all = pairs.patterns.len() as u64;
    let (mut lines, mut patterns) = (Vec::new(), Vec::new());
    for ((pattern, photograph), number) in pairs.patterns.iter().zip(&pairs.photographs).zip(0..) {
        patterns.push(copy_into(root, PATTERNS, pattern)?.file);
        let condition = Condition::Pattern { set: pairs.set.clone(), number, stop: 0 };
        lines.push(line(root, lines.len(), photograph, condition, Role::Sample)?);
        progress(number as u64 + 1, all)?;
    }
    let others = [
        (&pairs.black, Condition::Black { stop: 0 }, Role::Black),
        (&pairs.white, Condition::White { stop: 0 }, Role::AllLit),
    ];
    for (photograph, condition, role) in others {
        if let Some(photograph) = photograph {
            lines.push(line(root, lines.len(), photograph, condition, role)?);
        }
    }
    if let Some(description) = &pairs.description {
        copy_into(root, PATTERNS, description)?;
    }
    write_journal(root, &lines)?;
    describe(root, pairs, patterns)?;
    Ok(folder)
}

/// Copies a photograph; its line.
fn line(root: &Path, before: usize, photograph: &Path, condition: Condition, role: Role) -> Result<Line> {
    let number = before as u64 + 1;
    let frame: Frame = copy_into(root, &format!("photos/{number:06}"), photograph)?;
    Ok(Line::Photograph(Photograph {
        number,
        step: number - 1,
        condition,
        role,
        redo_of: None,
        frames: vec![frame],
        beside: Vec::new(),
        time: jiff::Timestamp::now().to_string(),
        seconds: 0.0,
        remarks: Vec::new(),
    }))
}

fn write_journal(root: &Path, lines: &[Line]) -> Result<()> {
    let path = root.join("journal.jsonl");
    let fail = |source| Error::io("write", &path, source);
    let mut journal = BufWriter::new(File::create(&path).map_err(fail)?);
    for line in lines {
        serde_json::to_writer(&mut journal, line).map_err(|error| fail(error.into()))?;
        journal.write_all(b"\n").map_err(fail)?;
    }
    let file = journal.into_inner().map_err(|error| fail(error.into_error()))?;
    file.sync_all().map_err(fail)
}

fn describe(root: &Path, pairs: &Pairs, patterns: Vec<String>) -> Result<()> {
    let emitted = match &pairs.emitted {
        Emitted::Known(name) => name.clone(),
        Emitted::Table(table) => copy_into(root, "calibration", table)?.file,
    };
    let (columns, rows) = pairs.plane;
    let settings = Settings { set: pairs.set.clone(), patterns, columns, rows, texel: pairs.texel, emitted };
    let failed = |error: toml::ser::Error| Error::io("write", root, io::Error::other(error));
    let description = Description::new(Source::Import(ImportDescription {
        kind: "pairs".to_owned(),
        width: pairs.size.0,
        height: pairs.size.1,
        encoding: pairs.encoding.clone(),
        colour_space: pairs.colour_space.clone(),
        settings: toml::Table::try_from(settings).map_err(failed)?,
    }));
    description.write(root)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::Journal;
    use super::*;

    fn pairs(folder: &Path) -> Pairs {
        let write = |name: &str| {
            let path = folder.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(&path, name).unwrap();
            path
        };
        Pairs {
            patterns: vec![write("p/0.png"), write("p/1.png")],
            photographs: vec![write("q/a.png"), write("q/b.png")],
            black: Some(write("black.png")),
            white: Some(write("white.png")),
            description: Some(write("p/patterns.toml")),
            set: "noise".to_owned(),
            emitted: Emitted::Table(write("gamma.txt")),
            texel: 2,
            plane: (8, 4),
            size: (3, 2),
            encoding: "linear".to_owned(),
            colour_space: "lin_rec709".to_owned(),
        }
    }

    #[test]
    fn a_session_pairs_photographs_with_patterns() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("s");
        stage(&target, &pairs(folder.path()), &mut |_, _| Ok(())).unwrap().commit().unwrap();
        let journal = Journal::read(&target).unwrap();
        let shown: Vec<(u64, Condition, Role, String)> = journal
            .iter()
            .map(|line| {
                let Line::Photograph(p) = line else { panic!("{line:?}") };
                (p.number, p.condition.clone(), p.role, fs::read_to_string(target.join(&p.frames[0].file)).unwrap())
            })
            .collect();
        let pattern = |number| Condition::Pattern { set: "noise".to_owned(), number, stop: 0 };
        let expected = [
            (1, pattern(0), Role::Sample, "q/a.png".to_owned()),
            (2, pattern(1), Role::Sample, "q/b.png".to_owned()),
            (3, Condition::Black { stop: 0 }, Role::Black, "black.png".to_owned()),
            (4, Condition::White { stop: 0 }, Role::AllLit, "white.png".to_owned()),
        ];
        assert_eq!(shown, expected);
        let Source::Import(found) = Description::read(&target).unwrap().source else { panic!("a capture") };
        assert_eq!((found.kind.as_str(), found.width, found.height), ("pairs", 3, 2));
        let settings = &found.settings;
        assert_eq!(settings["emitted"].as_str(), Some("calibration/gamma.txt"));
        assert_eq!(settings["patterns"][1].as_str(), Some("patterns/1.png"));
        assert_eq!((settings["columns"].as_integer(), settings["texel"].as_integer()), (Some(8), Some(2)));
        assert_eq!(fs::read_to_string(target.join("patterns/patterns.toml")).unwrap(), "p/patterns.toml");
        assert_eq!(fs::read_to_string(target.join("calibration/gamma.txt")).unwrap(), "gamma.txt");
    }

    #[test]
    fn a_stopped_import_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let pairs = pairs(folder.path());
        let before = fs::read_dir(folder.path()).unwrap().count();
        let mut stop = |done, _| if done == 2 { Err(Error::Cancelled) } else { Ok(()) };
        assert!(matches!(stage(&folder.path().join("s"), &pairs, &mut stop), Err(Error::Cancelled)));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), before);
    }
}
