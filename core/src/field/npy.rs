//! Headers of `.npy` arrays (numpy's NEP 1): C order, little-endian, padded so that data after an aligned start is aligned.
//!
//! What an array must be is known from the manifest before it is opened, so a header is not parsed but compared, blanks
//! aside, with the one that numpy and we write for it: there is nothing for a hostile header to lie about.

use crate::error::{Error, Result};

/// Data starts at a multiple of this within the entry, as the format recommends.
pub(super) const ALIGNMENT: usize = 64;
/// No header of ours comes near; a longer one is refused before it is read.
pub(super) const LONGEST_HEADER: usize = 4096;
/// Magic, version, and a length of 2 bytes.
const PREAMBLE: usize = 10;
const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";

fn dictionary(descr: &str, shape: &[usize]) -> String {
    let tuple: Vec<String> = shape.iter().map(usize::to_string).collect();
    let comma = if shape.len() == 1 { "," } else { "" };
    format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({}{comma}), }}", tuple.join(", "))
}

/// The header of an array: magic, version 1.0, length, dictionary padded with blanks, newline.
pub(super) fn header(descr: &str, shape: &[usize]) -> Vec<u8> {
    let mut text = dictionary(descr, shape);
    let length = (PREAMBLE + text.len() + 1).next_multiple_of(ALIGNMENT) - PREAMBLE;
    text.extend(std::iter::repeat_n(' ', length - 1 - text.len()));
    text.push('\n');
    let mut bytes = MAGIC.to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(text.into_bytes());
    bytes
}

/// Checks the header at the start of an entry and returns its length: the array must be `descr`, C order, of `shape`.
///
/// # Errors
/// Anything else, named with what was found.
pub(super) fn check_header(start: &[u8], descr: &str, shape: &[usize], place: &str) -> Result<usize> {
    let wanted = dictionary(descr, shape);
    let refuse = |found: String| Err(Error::invalid(place, found, format!("a numpy array with the header {wanted}")));
    if !start.starts_with(MAGIC) || start.len() < PREAMBLE {
        return refuse("no header of a .npy array, version 1.0".to_owned());
    }
    let length = PREAMBLE + usize::from(u16::from_le_bytes([start[8], start[9]]));
    let Some(text) = start.get(PREAMBLE..length) else {
        return refuse(format!("a header cut short of its {length} bytes"));
    };
    let without_blanks = |text: &[u8]| text.iter().copied().filter(|b| !b.is_ascii_whitespace()).collect::<Vec<u8>>();
    if without_blanks(text) != without_blanks(wanted.as_bytes()) {
        return refuse(text.iter().take(160).flat_map(|b| b.escape_ascii()).map(char::from).collect());
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

    #[test]
    fn numpy_s_own_header_is_accepted() {
        // From numpy 2.3: np.save of zeros((2, 3), '<f4').
        let mut bytes = b"\x93NUMPY\x01\x00v\x00{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }".to_vec();
        bytes.resize(127, b' ');
        bytes.push(b'\n');
        assert_eq!(check_header(&bytes, "<f4", &[2, 3], "x").unwrap(), 128);
    }
}
