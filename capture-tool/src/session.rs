//! Session folders: the photographs as the camera gave them, and how they came to be.
//!
//! ```text
//! session.toml          rig, sampler, encoding, tool version
//! journal.jsonl         one line a photograph: number, file, lamp direction, bytes, BLAKE3
//! photos/NNNNNN/        photograph N, counted from 1, under its own name
//! calibration/          the .lp file; the black photograph, the coverage, the lamps' table and flat fields, where there are any
//! ```
//!
//! An import writes the folder beside its place and renames it at the end: it appears whole or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Write};
use std::path::Path;

use relume_core::acquire::{Checked, ImportLp};
use relume_core::{Error, Result};
use serde::Serialize;

use crate::new_folder::NewFolder;

/// Version of the layout above.
const SESSION_VERSION: u32 = 1;

/// `session.toml`.
#[derive(Debug, Serialize)]
struct Session {
    version: u32,
    tool: &'static str,
    rig: Rig,
    camera: Camera,
    sampler: Sampler,
    calibration: Calibration,
}

#[derive(Debug, Serialize)]
struct Rig {
    /// `imported`: no device was driven.
    kind: &'static str,
    lamps: usize,
    irradiance: f32,
}

#[derive(Debug, Serialize)]
struct Camera {
    width: usize,
    height: usize,
    encoding: String,
    /// Id of the colours of the photographs, once decoded.
    colour_space: &'static str,
}

#[derive(Debug, Serialize)]
struct Sampler {
    /// `scan`: one lamp after another.
    kind: &'static str,
}

/// Files in `calibration/`.
#[derive(Debug, Default, Serialize)]
struct Calibration {
    lp: Option<Copied>,
    black: Option<Copied>,
    alpha: Option<Copied>,
    lamps: Option<Copied>,
    /// One photograph of a flat white card a lamp.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    flat_field: Vec<Copied>,
}

/// A file that was copied into the session.
#[derive(Debug, Serialize)]
struct Copied {
    /// Path inside the session, with forward slashes.
    file: String,
    bytes: u64,
    blake3: String,
}

/// A line of `journal.jsonl`.
#[derive(Debug, Serialize)]
struct Entry<'a> {
    /// Counted from 1.
    number: usize,
    direction: [f64; 3],
    #[serde(flatten)]
    photograph: &'a Copied,
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
    let copy = |from: &Path| copy_into(root, "calibration", from);
    let cards = import.measured.cards(&checked.lp.photographs);
    let calibration = Calibration {
        lp: Some(copy(&import.lp)?),
        black: import.black.as_deref().map(copy).transpose()?,
        alpha: import.alpha.as_deref().map(copy).transpose()?,
        lamps: import.measured.lamps.as_deref().map(copy).transpose()?,
        flat_field: cards
            .iter()
            .flatten()
            .map(|card| copy_into(root, "calibration/flat-field", card))
            .collect::<Result<_>>()?,
    };
    write_journal(root, checked, progress)?;
    let session = Session {
        version: SESSION_VERSION,
        tool: concat!("relume ", env!("CARGO_PKG_VERSION")),
        rig: Rig { kind: "imported", lamps: checked.lp.photographs.len(), irradiance: import.irradiance },
        camera: Camera {
            width: checked.width,
            height: checked.height,
            encoding: format!("{:?}", import.encoding).to_lowercase(),
            colour_space: import.colour_space.id(),
        },
        sampler: Sampler { kind: "scan" },
        calibration,
    };
    let path = root.join("session.toml");
    let text = toml::to_string(&session).map_err(|error| Error::io("write", &path, io::Error::other(error)))?;
    relume_core::files::write_whole(&path, |file| {
        file.write_all(text.as_bytes()).map_err(|source| Error::io("write", &path, source))
    })?;
    Ok(folder)
}

fn write_journal(root: &Path, checked: &Checked, progress: &mut dyn FnMut(u64, u64) -> Result<()>) -> Result<()> {
    let path = root.join("journal.jsonl");
    let fail = |source| Error::io("write", &path, source);
    let mut journal = BufWriter::new(File::create(&path).map_err(fail)?);
    let all = checked.lp.photographs.len() as u64;
    for ((photograph, direction), number) in checked.lp.photographs.iter().zip(&checked.lp.directions).zip(1..) {
        let copied = copy_into(root, &format!("photos/{number:06}"), photograph)?;
        let entry = Entry { number, direction: (*direction).into(), photograph: &copied };
        serde_json::to_writer(&mut journal, &entry).map_err(|error| fail(error.into()))?;
        journal.write_all(b"\n").map_err(fail)?;
        progress(number as u64, all)?;
    }
    let file = journal.into_inner().map_err(|error| fail(error.into_error()))?;
    file.sync_all().map_err(fail)
}

/// Copies a file into `root/folder` under its own name.
fn copy_into(root: &Path, folder: &str, from: &Path) -> Result<Copied> {
    let name = from.file_name().unwrap_or_default();
    let into = root.join(folder);
    fs::create_dir_all(&into).map_err(|source| Error::io("create", &into, source))?;
    let to = into.join(name);
    if to.exists() {
        let place = format!("{}, to be copied into the session", from.display());
        return Err(Error::invalid(place, "a name that another of its files has", "different names"));
    }
    let (bytes, blake3) = copy_and_hash(from, &to)?;
    Ok(Copied { file: format!("{folder}/{}", name.to_string_lossy()), bytes, blake3 })
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
        assert_eq!(names(&target), ["calibration", "journal.jsonl", "photos", "session.toml"]);
        assert_eq!(fs::read(target.join("photos/000002/b.png")).unwrap(), b"second");
        let journal = fs::read_to_string(target.join("journal.jsonl")).unwrap();
        let lines: Vec<serde_json::Value> = journal.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(lines.len(), 2);
        assert_eq!(lines[1]["direction"], serde_json::json!([1.0, 0.0, 0.0]));
        assert_eq!(lines[1]["blake3"], blake3::hash(b"second").to_hex().to_string());
        let session: toml::Table = fs::read_to_string(target.join("session.toml")).unwrap().parse().unwrap();
        assert_eq!(session["rig"]["lamps"].as_integer(), Some(2));
        assert_eq!(session["calibration"]["lp"]["file"].as_str(), Some("calibration/l.lp"));
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
