//! Traced rows in a file, so that tracing is done once.
//!
//! `RLMROWS` and version 1 (8 bytes); width, height, columns, rows, layers (u32); number of entries (u64); entries of each
//! pixel (u32); scales (f32); nodes (u32); answers (three halves an entry); BLAKE3 of all that comes before. Little-endian.

use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::path::Path;

use half::f16;

use crate::error::{Error, Result};
use crate::files::write_whole;

use super::grids::Grids;
use super::rows::Rows;

const MAGIC: &[u8; 8] = b"RLMROWS\x01";
/// Magic, five u32 and a u64.
const HEADER: usize = 8 + 5 * 4 + 8;
const HASH: usize = 32;
/// Bytes written or read at once: a multiple of what any number takes.
const CHUNK: usize = 1 << 16;
/// As the largest picture that is read.
const MOST_PIXELS: u64 = 1 << 28;

impl Rows {
    /// Writes the rows; the file appears whole or not at all.
    ///
    /// # Errors
    /// [`Error::Io`] when the folder is absent or full.
    pub fn save(&self, path: &Path) -> Result<()> {
        write_whole(path, |writer| {
            let mut out = Hashing { inner: writer, hash: blake3::Hasher::new() };
            self.write(&mut out).map_err(|source| Error::io("write", path, source))?;
            let hash = out.hash.finalize();
            writer.write_all(hash.as_bytes()).map_err(|source| Error::io("write", path, source))
        })
    }

    fn write(&self, out: &mut impl Write) -> std::io::Result<()> {
        out.write_all(MAGIC)?;
        let Grids { columns, rows, layers } = self.grids;
        write_all(out, [self.width, self.height, columns, rows, layers].into_iter().map(|n| (n as u32).to_le_bytes()))?;
        out.write_all(&(self.nodes.len() as u64).to_le_bytes())?;
        write_all(out, self.starts.windows(2).map(|w| ((w[1] - w[0]) as u32).to_le_bytes()))?;
        write_all(out, self.scales.iter().map(|s| s.to_le_bytes()))?;
        write_all(out, self.nodes.iter().map(|n| n.to_le_bytes()))?;
        write_all(out, self.values.iter().map(|v| v.to_le_bytes()))
    }

    /// Reads rows that [`Self::save`] wrote. Nothing is allocated that the file is not long enough for.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be read; [`Error::Invalid`] for anything that such a file does not hold: another type or
    /// version, a wrong length, entries out of order or of no element, numbers that are not finite, a wrong hash.
    pub fn load(path: &Path) -> Result<Self> {
        let failed = |source| Error::io("read", path, source);
        let file = File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        let mut input = Hashed { inner: BufReader::new(file), hash: blake3::Hasher::new() };
        let refuse = |found: String, expected: &str| Error::invalid(path.display().to_string(), found, expected);
        if length < (HEADER + HASH) as u64 {
            return Err(refuse(format!("{length} bytes"), "a file of traced rows"));
        }
        let header: [u8; HEADER] = input.array().map_err(failed)?;
        let shape = Shape::read(&header, path)?;
        if shape.length() != Some(length) {
            let found = format!("{length} bytes");
            return Err(refuse(found, "as many as its header tells: the file is cut short or changed; trace it again"));
        }
        let rows = shape.read_rows(&mut input).map_err(failed)?;
        let wanted = input.hash.finalize();
        let mut hash = [0; HASH];
        input.inner.read_exact(&mut hash).map_err(failed)?;
        if hash != *wanted.as_bytes() {
            return Err(refuse("contents that do not fit their hash".to_owned(), "an unchanged file; trace it again"));
        }
        rows.check(path)?;
        Ok(rows)
    }

    /// Checks what the hash of a file made by somebody else does not.
    fn check(&self, path: &Path) -> Result<()> {
        let place = || path.display().to_string();
        if self.starts.last() != Some(&(self.nodes.len() as u64)) {
            let found = format!("{} entries in its pixels", self.starts.last().copied().unwrap_or_default());
            return Err(Error::invalid(place(), found, format!("{}, as its header tells", self.nodes.len())));
        }
        let count = self.grids.nodes();
        for (pixel, (range, scale)) in self.starts.windows(2).zip(&self.scales).enumerate() {
            let at = || format!("{}, pixel ({}, {})", place(), pixel % self.width, pixel / self.width);
            if !(scale.is_finite() && *scale >= 0.0) {
                return Err(Error::invalid(at(), format!("a scale of {scale}"), "a finite number, not negative"));
            }
            let (from, to) = (range[0] as usize, range[1] as usize);
            let nodes = &self.nodes[from..to];
            if !nodes.is_sorted_by(|a, b| a < b) || nodes.last().is_some_and(|n| *n as usize >= count) {
                return Err(Error::invalid(at(), "elements out of order or range", format!("rising, below {count}")));
            }
            if let Some(bad) = self.values[3 * from..3 * to].iter().find(|v| !(v.is_finite() && **v >= f16::ZERO)) {
                return Err(Error::invalid(at(), format!("an answer of {bad}"), "a finite number, not negative"));
            }
        }
        Ok(())
    }
}

/// What a header says.
struct Shape {
    width: usize,
    height: usize,
    grids: Grids,
    entries: u64,
}

impl Shape {
    fn read(header: &[u8; HEADER], path: &Path) -> Result<Self> {
        let place = path.display().to_string();
        if &header[..8] != MAGIC {
            return Err(Error::invalid(place, "another type of file or another version", "traced rows, version 1"));
        }
        let number = |n: usize| u32::from_le_bytes(std::array::from_fn(|k| header[8 + 4 * n + k])) as usize;
        let grids = Grids { columns: number(2), rows: number(3), layers: number(4) };
        grids.check(&place)?;
        let entries = u64::from_le_bytes(std::array::from_fn(|k| header[28 + k]));
        let shape = Self { width: number(0), height: number(1), grids, entries };
        let pixels = shape.width as u64 * shape.height as u64;
        if !(1..=MOST_PIXELS).contains(&pixels) {
            let found = format!("a picture of {} x {} pixels", shape.width, shape.height);
            return Err(Error::invalid(place, found, format!("1 to {MOST_PIXELS} pixels")));
        }
        Ok(shape)
    }

    /// Bytes of the file; `None` when no file could be so long.
    fn length(&self) -> Option<u64> {
        let pixels = 8 * self.width as u64 * self.height as u64;
        self.entries.checked_mul(10)?.checked_add(pixels + (HEADER + HASH) as u64)
    }

    fn read_rows(&self, input: &mut impl Read) -> std::io::Result<Rows> {
        let (pixels, entries) = (self.width * self.height, self.entries as usize);
        let mut starts = Vec::with_capacity(pixels + 1);
        starts.push(0);
        let mut sum = 0u64;
        read_each(input, pixels, |bytes| {
            sum += u64::from(u32::from_le_bytes(bytes));
            // Beyond the entries there is nothing to point at; `check` tells the person.
            starts.push(sum.min(self.entries));
        })?;
        if let Some(last) = starts.last_mut() {
            *last = sum;
        }
        let mut rows = Rows { starts, ..Rows::new(self.width, self.height, self.grids) };
        rows.scales.reserve_exact(pixels);
        read_each(input, pixels, |bytes| rows.scales.push(f32::from_le_bytes(bytes)))?;
        rows.nodes.reserve_exact(entries);
        read_each(input, entries, |bytes| rows.nodes.push(u32::from_le_bytes(bytes)))?;
        rows.values.reserve_exact(3 * entries);
        read_each(input, 3 * entries, |bytes| rows.values.push(f16::from_le_bytes(bytes)))?;
        Ok(rows)
    }
}

/// Writes numbers, a chunk at a time.
fn write_all<const N: usize>(out: &mut impl Write, numbers: impl Iterator<Item = [u8; N]>) -> std::io::Result<()> {
    let mut chunk = Vec::with_capacity(CHUNK);
    for bytes in numbers {
        chunk.extend_from_slice(&bytes);
        if chunk.len() >= CHUNK {
            out.write_all(&chunk)?;
            chunk.clear();
        }
    }
    out.write_all(&chunk)
}

/// Reads `count` numbers, a chunk at a time.
fn read_each<const N: usize>(
    input: &mut impl Read,
    count: usize,
    mut each: impl FnMut([u8; N]),
) -> std::io::Result<()> {
    let mut chunk = vec![0; CHUNK / N * N];
    let mut left = count * N;
    while left > 0 {
        let part = left.min(chunk.len());
        input.read_exact(&mut chunk[..part])?;
        chunk[..part].as_chunks::<N>().0.iter().for_each(|bytes| each(*bytes));
        left -= part;
    }
    Ok(())
}

struct Hashing<'a, W> {
    inner: &'a mut W,
    hash: blake3::Hasher,
}

impl<W: Write> Write for Hashing<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.inner.write(bytes)?;
        self.hash.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.inner.flush()
    }
}

struct Hashed<R> {
    inner: R,
    hash: blake3::Hasher,
}

impl<R: Read> Hashed<R> {
    fn array<const N: usize>(&mut self) -> std::io::Result<[u8; N]> {
        let mut bytes = [0; N];
        self.read_exact(&mut bytes)?;
        Ok(bytes)
    }
}

impl<R: Read> Read for Hashed<R> {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        let read = self.inner.read(bytes)?;
        self.hash.update(&bytes[..read]);
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::rows::tests::random;

    /// The bytes of a file, changed and hashed anew.
    fn changed(bytes: &[u8], change: impl Fn(&mut Vec<u8>)) -> Vec<u8> {
        let mut body = bytes[..bytes.len() - HASH].to_vec();
        change(&mut body);
        let hash = blake3::hash(&body);
        body.extend_from_slice(hash.as_bytes());
        body
    }

    #[test]
    fn rows_come_back_from_their_file_and_damage_is_told() {
        let (rows, _) = random(Grids { columns: 7, rows: 5, layers: 2 }, 9, 4);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.rows");
        rows.save(&path).unwrap();
        assert_eq!(Rows::load(&path).unwrap(), rows);
        let good = std::fs::read(&path).unwrap();
        let set = |at: usize, to: &[u8]| {
            let to = to.to_vec();
            move |b: &mut Vec<u8>| b[at..at + to.len()].copy_from_slice(&to)
        };
        let (lengths, scales, nodes) = (HEADER, HEADER + 36 * 4, HEADER + 36 * 8);
        let values = nodes + 4 * rows.entries();
        for (bytes, words) in [
            (good[..good.len() - 1].to_vec(), "cut short"),
            (good[..20].to_vec(), "20 bytes"),
            (changed(&good, set(0, b"RLMROWS\x02")), "version"),
            (changed(&good, set(8, &[0xff; 8])), "pixels"),
            (changed(&good, set(16, &[0xff; 12])), "elements"),
            (changed(&good, set(28, &[0xff; 8])), "cut short"),
            (changed(&good, set(lengths, &[0xff; 12])), "entries in its pixels"),
            (changed(&good, set(scales, &f32::NAN.to_le_bytes())), "scale"),
            (changed(&good, set(nodes, &[0xff; 4])), "order or range"),
            (changed(&good, set(values, &[0xff; 2])), "an answer"),
            ([&good[..nodes], &[good[nodes] ^ 1], &good[nodes + 1..]].concat(), "hash"),
        ] {
            std::fs::write(&path, bytes).unwrap();
            let message = Rows::load(&path).unwrap_err().to_string();
            assert!(message.contains(words) && message.contains("a.rows"), "`{words}`: {message}");
        }
        assert!(Rows::load(folder.path()).is_err());
    }

    /// Files changed anywhere, and hashed anew so that the hash hides nothing, are read or refused, never more.
    #[test]
    fn mutated_files_never_panic() {
        use rand::{RngExt, SeedableRng};
        let (rows, _) = random(Grids { columns: 7, rows: 5, layers: 2 }, 9, 4);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.rows");
        rows.save(&path).unwrap();
        let good = std::fs::read(&path).unwrap();
        let mut rng = rand_pcg::Pcg32::seed_from_u64(6);
        let (mut read, mut refused) = (0, 0);
        for _ in 0..400 {
            let (at, value) = (rng.random_range(8..good.len() - HASH), rng.random::<u8>());
            let cut =
                if rng.random_range(0..10) == 0 { rng.random_range(8..good.len() - HASH) } else { good.len() - HASH };
            let bytes = changed(&good, |body| {
                body[at] = value;
                body.truncate(cut);
            });
            std::fs::write(&path, bytes).unwrap();
            match Rows::load(&path) {
                Ok(rows) => {
                    read += 1;
                    rows.element(0).unwrap();
                }
                Err(_) => refused += 1,
            }
        }
        assert!(read > 20 && refused > 20, "{read} read, {refused} refused");
    }
}
