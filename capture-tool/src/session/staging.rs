//! Imports: a session written beside its place and renamed at the end, so that it appears whole or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Write};
use std::path::Path;

use relume_core::acquire::{Checked, ImportLp};
use relume_core::domain::lp;
use relume_core::files::write_whole;
use relume_core::{Error, Result};
use serde::Serialize;

use super::{Description, Frame, ImportDescription, Line, Photograph, Role, Source};
use crate::new_folder::NewFolder;
use crate::rigs::Condition;

/// The photographs of a session with their directions, for `pack` and for any tool that reads `.lp`.
pub const LIGHTS: &str = "lights.lp";

/// What an import from a `.lp` file has of its own; paths inside the session.
#[derive(Debug, Default, Serialize)]
struct LpSettings {
    irradiance: f32,
    /// The .lp file as it was given.
    lp: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    black: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    alpha: Option<String>,
    /// The lamps' table.
    #[serde(skip_serializing_if = "Option::is_none")]
    lamps: Option<String>,
    /// The folder of photographs of a flat white card, one a lamp.
    #[serde(skip_serializing_if = "Option::is_none")]
    flat_field: Option<String>,
}

/// Copies the photographs of an import, hashing each; `progress(photographs done, all)` may stop it.
///
/// # Errors
/// A file that cannot be read, or no room. Nothing is left behind.
pub fn stage(
    target: &Path,
    import: &ImportLp,
    checked: &Checked,
    progress: &mut dyn FnMut(u64, u64) -> Result<()>,
) -> Result<NewFolder> {
    let folder = NewFolder::begin(target)?;
    let root = folder.path();
    let copy = |from: &Path| copy_into(root, "calibration", from).map(|copied| copied.file);
    let cards = import.measured.cards(&checked.lp.photographs);
    for card in cards.iter().flatten() {
        copy_into(root, "calibration/flat-field", card)?;
    }
    let settings = LpSettings {
        irradiance: import.irradiance,
        lp: copy(&import.lp)?,
        black: import.black.as_deref().map(copy).transpose()?,
        alpha: import.alpha.as_deref().map(copy).transpose()?,
        lamps: import.measured.lamps.as_deref().map(copy).transpose()?,
        flat_field: cards.is_some().then(|| "calibration/flat-field".to_owned()),
    };
    write_photographs(root, checked, progress)?;
    let failed = |error: toml::ser::Error| Error::io("write", root, io::Error::other(error));
    let description = Description::new(Source::Import(ImportDescription {
        kind: "lp".to_owned(),
        width: checked.width,
        height: checked.height,
        encoding: format!("{:?}", import.encoding).to_lowercase(),
        colour_space: import.colour_space.id().to_owned(),
        settings: toml::Table::try_from(settings).map_err(failed)?,
    }));
    description.write(root)?;
    Ok(folder)
}

/// The photographs, the journal, and [`LIGHTS`].
fn write_photographs(root: &Path, checked: &Checked, progress: &mut dyn FnMut(u64, u64) -> Result<()>) -> Result<()> {
    let path = root.join("journal.jsonl");
    let fail = |source| Error::io("write", &path, source);
    let mut journal = BufWriter::new(File::create(&path).map_err(fail)?);
    let all = checked.lp.photographs.len() as u64;
    let mut names = Vec::new();
    for (photograph, number) in checked.lp.photographs.iter().zip(1..) {
        let frame = copy_into(root, &format!("photos/{number:06}"), photograph)?;
        names.push(frame.file.clone().into());
        serde_json::to_writer(&mut journal, &imported(number, frame)).map_err(|error| fail(error.into()))?;
        journal.write_all(b"\n").map_err(fail)?;
        progress(number, all)?;
    }
    let file = journal.into_inner().map_err(|error| fail(error.into_error()))?;
    file.sync_all().map_err(fail)?;
    let lights = root.join(LIGHTS);
    let text = lp::text(&lp::Lp { photographs: names, directions: checked.lp.directions.clone() });
    write_whole(&lights, |out| out.write_all(text.as_bytes()).map_err(|source| Error::io("write", &lights, source)))
}

/// The line of an imported photograph.
fn imported(number: u64, frame: Frame) -> Line {
    let step = number - 1;
    Line::Photograph(Photograph {
        number,
        step,
        condition: Condition::Lamp(step as usize),
        role: Role::Sample,
        redo_of: None,
        frames: vec![frame],
        beside: Vec::new(),
        time: jiff::Timestamp::now().to_string(),
        seconds: 0.0,
        remarks: Vec::new(),
    })
}

/// Copies a file into `root/folder` under its own name, hashing it.
///
/// # Errors
/// A file that cannot be read, no room, a name that is taken.
pub fn copy_into(root: &Path, folder: &str, from: &Path) -> Result<Frame> {
    let name = from.file_name().unwrap_or_default();
    let into = root.join(folder);
    fs::create_dir_all(&into).map_err(|source| Error::io("create", &into, source))?;
    let to = into.join(name);
    if to.exists() {
        let place = format!("{}, to be copied into the session", from.display());
        return Err(Error::invalid(place, "a name that another of its files has", "different names"));
    }
    let (bytes, blake3) = copy_and_hash(from, &to)?;
    Ok(Frame { file: format!("{folder}/{}", name.to_string_lossy()), exposure: None, bytes, blake3 })
}

/// One pass: what is hashed is what was written. Gives the number of bytes and their BLAKE3, hexadecimal.
fn copy_and_hash(from: &Path, to: &Path) -> Result<(u64, String)> {
    let mut source = File::open(from).map_err(|error| Error::io("read", from, error))?;
    let mut copy = File::create(to).map_err(|error| Error::io("write", to, error))?;
    let (mut hasher, mut buffer, mut bytes) = (blake3::Hasher::new(), vec![0; 1 << 20], 0);
    loop {
        let length = source.read(&mut buffer).map_err(|error| Error::io("read", from, error))?;
        if length == 0 {
            return Ok((bytes, hasher.finalize().to_hex().to_string()));
        }
        hasher.update(&buffer[..length]);
        copy.write_all(&buffer[..length]).map_err(|error| Error::io("write", to, error))?;
        bytes += length as u64;
    }
}

#[cfg(test)]
mod tests {
    use relume_core::acquire::Measured;
    use relume_core::domain::lp;
    use relume_core::field::Precision;
    use relume_core::image::{ColourSpace, Encoding};

    use super::super::Journal;
    use super::*;

    fn import(folder: &Path) -> ImportLp {
        fs::write(folder.join("a.png"), b"first").unwrap();
        fs::write(folder.join("b.png"), b"second").unwrap();
        fs::write(folder.join("l.lp"), "2\na.png 0 0 1\nb.png 1 0 0\n").unwrap();
        ImportLp {
            lp: folder.join("l.lp"),
            encoding: Encoding::Auto,
            colour_space: ColourSpace::default(),
            black: None,
            alpha: None,
            irradiance: 2.0,
            measured: Measured::default(),
            precision: Precision::Half,
            lengths: lp::Lengths::Unit,
            exclude: Vec::new(),
            correction: None,
        }
    }

    fn checked(import: &ImportLp) -> Checked {
        Checked { lp: lp::read(&import.lp, import.lengths).unwrap(), width: 3, height: 2 }
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_session_holds_the_files_and_their_hashes() {
        let folder = tempfile::tempdir().unwrap();
        let import = import(folder.path());
        let target = folder.path().join("session");
        let staged = stage(&target, &import, &checked(&import), &mut |_, _| Ok(())).unwrap();
        assert!(!target.exists());
        staged.commit().unwrap();
        assert_eq!(names(&target), ["calibration", "journal.jsonl", "lights.lp", "photos", "session.toml"]);
        assert_eq!(fs::read(target.join("photos/000002/b.png")).unwrap(), b"second");
        let journal = Journal::read(&target).unwrap();
        let [_, Line::Photograph(second)] = &journal[..] else { panic!("{journal:?}") };
        assert_eq!((second.number, &second.condition), (2, &Condition::Lamp(1)));
        assert_eq!(second.frames[0].file, "photos/000002/b.png");
        assert_eq!(second.frames[0].blake3, blake3::hash(b"second").to_hex().to_string());
        let description = Description::read(&target).unwrap();
        let Source::Import(found) = description.source else { panic!("a capture") };
        assert_eq!((found.kind.as_str(), found.width, found.height), ("lp", 3, 2));
        assert_eq!(found.settings["lp"].as_str(), Some("calibration/l.lp"));
        let lights = lp::read(&target.join(LIGHTS), lp::Lengths::Unit).unwrap();
        assert_eq!(lights.photographs[1], target.join("photos/000002/b.png"));
        assert_eq!(lights.directions, checked(&import).lp.directions);
        assert_eq!(names(folder.path()), ["a.png", "b.png", "l.lp", "session"]);
    }

    #[test]
    fn a_stopped_session_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let import = import(folder.path());
        let mut stop = |done, _| if done == 1 { Err(Error::Cancelled) } else { Ok(()) };
        let target = folder.path().join("session");
        assert!(matches!(stage(&target, &import, &checked(&import), &mut stop), Err(Error::Cancelled)));
        assert_eq!(names(folder.path()), ["a.png", "b.png", "l.lp"]);
    }
}
