//! The ZIP around the arrays: where each entry lies, with nothing a hostile file says taken on trust.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::ops::Range;
use std::path::Path;

use zip::read::{ArchiveOffset, Config};
use zip::{CompressionMethod, ZipArchive};

use crate::error::{Error, Result};

/// A container has a handful of entries.
const MOST_ENTRIES: usize = 4096;
/// A manifest of a million lamps is smaller.
const LARGEST_MANIFEST: u64 = 256 << 20;

/// Entry name -> bytes of its data in the file. All lie inside it, apart from one another, stored and aligned.
pub(super) type Entries = BTreeMap<String, Range<u64>>;

/// Lists a container.
///
/// # Errors
/// Not a ZIP; entries that are compressed, encrypted, misaligned, overlapping, outside the file or badly named.
pub(super) fn list(path: &Path) -> Result<Entries> {
    let place = path.display().to_string();
    let refuse = |found: String, expected: &str| Err(Error::invalid(&place, found, expected));
    let file = File::open(path).map_err(|source| Error::io("open", path, source))?;
    let config = Config { archive_offset: ArchiveOffset::Known(0) };
    let mut zip = match ZipArchive::with_config(config, BufReader::new(file)) {
        Ok(zip) => zip,
        Err(zip::result::ZipError::Io(source)) => return Err(Error::io("read", path, source)),
        Err(error) => {
            return refuse(
                format!("no readable ZIP directory ({error})"),
                "a .rfield file (a whole one: was the copy cut short?)",
            );
        }
    };
    if zip.len() > MOST_ENTRIES {
        return refuse(format!("{} entries", zip.len()), "at most 4096");
    }
    let directory_start = zip.central_directory_start();
    let mut entries = Entries::new();
    let mut taken: Vec<Range<u64>> = Vec::new();
    for n in 0..zip.len() {
        let entry = zip
            .by_index_raw(n)
            .map_err(|error| Error::invalid(&place, format!("entry {n} unreadable ({error})"), "a ZIP entry"))?;
        let name = String::from_utf8_lossy(entry.name_raw()).into_owned();
        let shown: String = name.chars().take(80).flat_map(char::escape_default).collect();
        if !is_plain_name(&name) {
            return refuse(
                format!("an entry called `{shown}`"),
                "names of letters, digits, `_`, `-`, `.` between single `/`",
            );
        }
        if entry.compression() != CompressionMethod::Stored
            || entry.encrypted()
            || entry.size() != entry.compressed_size()
        {
            return refuse(format!("entry `{shown}` compressed or encrypted"), "entries stored as they are");
        }
        let Some(start) = entry.data_start() else { return refuse(format!("entry `{shown}` without data"), "data") };
        let end = start.checked_add(entry.size()).filter(|&end| end <= directory_start);
        let Some(end) = end else {
            return refuse(
                format!("entry `{shown}` of {} bytes at byte {start}", entry.size()),
                "entries that end before the ZIP directory",
            );
        };
        taken.push(entry.header_start()..end);
        if entries.insert(name, start..end).is_some() {
            return refuse(format!("two entries called `{shown}`"), "one");
        }
    }
    taken.sort_unstable_by_key(|range| range.start);
    if let Some(pair) = taken.windows(2).find(|pair| pair[0].end > pair[1].start) {
        return refuse(format!("two entries that overlap at byte {}", pair[1].start), "entries apart from one another");
    }
    Ok(entries)
}

/// Reads the manifest's bytes.
///
/// # Errors
/// Absent or larger than any manifest.
pub(super) fn manifest_bytes(path: &Path, entries: &Entries) -> Result<Vec<u8>> {
    let place = path.display().to_string();
    let range =
        entries.get("manifest.json").ok_or_else(|| Error::invalid(&place, "no manifest.json", "a .rfield file"))?;
    let length = range.end - range.start;
    if length > LARGEST_MANIFEST {
        return Err(Error::invalid(place, format!("a manifest of {length} bytes"), "at most 256 MiB"));
    }
    let fail = |source| Error::io("read", path, source);
    let mut file = File::open(path).map_err(fail)?;
    std::io::Seek::seek(&mut file, std::io::SeekFrom::Start(range.start)).map_err(fail)?;
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes).map_err(fail)?;
    Ok(bytes)
}

/// Relative, forward slashes, no `..`, nothing that any system reads specially.
fn is_plain_name(name: &str) -> bool {
    let plain_part = |part: &str| {
        !part.is_empty()
            && !part.starts_with('.')
            && part.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'_' | b'-' | b'.'))
    };
    name.len() <= 200 && name.split('/').all(plain_part)
}
