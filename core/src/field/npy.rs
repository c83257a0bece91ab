//! Headers of `.npy` arrays (numpy's NEP 1): C order, little-endian, padded so that data after an aligned start is aligned.

use crate::error::{Error, Result};

/// Data starts at a multiple of this within the entry, as the format recommends.
pub(super) const ALIGNMENT: usize = 64;
/// No header of ours comes near; a longer one is refused before it is read.
pub(super) const LONGEST_HEADER: usize = 4096;

/// The header of an array: magic, version 1.0, length, dictionary padded with blanks, newline.
pub(super) fn header(descr: &str, shape: &[usize]) -> Vec<u8> {
    let tuple: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({}), }}", tuple.trim_end());
    const PREAMBLE: usize = 10;
    let length = (PREAMBLE + text.len() + 1).next_multiple_of(ALIGNMENT) - PREAMBLE;
    text.extend(std::iter::repeat_n(' ', length - 1 - text.len()));
    text.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(text.into_bytes());
    bytes
}

/// Checks the header at the start of an entry and returns its length: the array must be `descr`, C order, of `shape`.
///
/// # Errors
/// Anything else, named with what was found.
pub(super) fn check_header(start: &[u8], descr: &str, shape: &[usize], place: &str) -> Result<usize> {
    let expected = format!("a `{descr}` array of shape {shape:?} in C order");
    // A header that announces more text than there is must not be believed.
    let mut rest = &start[..start.len().min(LONGEST_HEADER)];
    let found = npyz::NpyHeader::from_reader(&mut rest)
        .map_err(|error| Error::invalid(place, format!("no readable array header ({error})"), &expected))?;
    let length = start.len().min(LONGEST_HEADER) - rest.len();
    let same_shape = found.shape().iter().copied().eq(shape.iter().map(|&n| n as u64));
    let same_type = matches!(found.dtype(), npyz::DType::Plain(ref t) if t.to_string() == descr);
    if !same_shape || !same_type || found.order() != npyz::Order::C {
        let found = format!("a `{}` array of shape {:?}", found.dtype().descr(), found.shape());
        return Err(Error::invalid(place, found, expected));
    }
    Ok(length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_aligned_and_read_back() {
        for shape in [vec![1], vec![135, 120, 3, 253, 8, 16], vec![usize::MAX; 6]] {
            let bytes = header("<f2", &shape);
            assert_eq!(bytes.len() % ALIGNMENT, 0);
            assert_eq!(check_header(&bytes, "<f2", &shape, "x").unwrap(), bytes.len());
            assert!(check_header(&bytes, "<f4", &shape, "x").is_err());
            assert!(check_header(&bytes, "<f2", &[2], "x").is_err());
            for cut in 0..bytes.len() {
                assert!(check_header(&bytes[..cut], "<f2", &shape, "x").is_err());
            }
        }
    }
}
