//! How much of a pixel the object covers: alpha, 1 where nothing of the screen is seen directly, beside the object.
//!
//! | part | what it holds |
//! |---|---|
//! | `stripes` | from stripes that the camera sees where the bare screen would show them: right for glass too |
//! | `seen` | what a pixel would see of a pattern on the bare screen |
//! | `bare` | the light of the bare white screen, from where it is seen |
//! | `triangulation` | from photographs before two or more backdrops: opaque objects alone |

mod bare;
mod seen;
mod stripes;
mod triangulation;

pub use bare::BareWhite;
pub use stripes::{Alpha, from_stripes};
pub use triangulation::Triangulation;

use crate::error::{Error, Result};

/// Of all pixels, so many at least must be mostly object, and so many mostly screen: a hundred of a megapixel.
const LEAST_SHARE: f64 = 1e-4;

/// Refuses an alpha that is no matte: of another size, beyond 0 to 1, or covering everything or nothing.
///
/// # Errors
/// What is wrong with it, at `place`.
pub fn check(alpha: &[f32], size: (usize, usize), place: &str) -> Result<()> {
    let refuse = |found: String, expected: &str| Err(Error::invalid(place, found, expected));
    if alpha.len() != size.0 * size.1 {
        let expected = format!("{} x {}, as the photographs", size.0, size.1);
        return refuse(format!("{} values", alpha.len()), &expected);
    }
    if let Some(beyond) = alpha.iter().find(|a| !(-1e-3..=1.001).contains(*a)) {
        return refuse(format!("a coverage of {beyond}"), "0 (screen) to 1 (object)");
    }
    let object = alpha.iter().filter(|a| **a > 0.5).count() as f64 / alpha.len().max(1) as f64;
    if object > 1.0 - LEAST_SHARE {
        return refuse(
            "an alpha that covers everything".into(),
            "some of the screen seen past the object (leave alpha away if the screen stands beside the object)",
        );
    }
    if object < LEAST_SHARE {
        return refuse("an alpha that covers nothing".into(), "an object in front of the screen");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_matte_is_refused() {
        let refused = |alpha: &[f32], words: &str| {
            let message = check(alpha, (4, 4), "alpha.exr").unwrap_err().to_string();
            assert!(message.contains(words) && message.contains("alpha.exr"), "{message}");
        };
        refused(&[1.0; 15], "4 x 4");
        refused(&[1.0; 16], "everything");
        refused(&[0.0; 16], "nothing");
        let mut half = [0.0; 16];
        half[..8].fill(1.0);
        assert!(check(&half, (4, 4), "a").is_ok());
        half[3] = f32::NAN;
        refused(&half, "NaN");
    }
}
