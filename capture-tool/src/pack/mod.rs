//! From a session to a field: `relume pack`.
//!
//! ```text
//! black series -> dark level --+
//! exposure series -> response -+-> Developer: frames -> light, per photograph
//! white ball -> E_j                  |
//! references -> drift g, movement    v
//! white card -> F_j        T_j = (photo_j - S_stop) / (g E_j F_j) -> container;   sum_j (photo_j - S) against all lit
//! ```
//!
//! | part | what it holds |
//! |---|---|
//! | [`records`] | which photograph counts for what; files checked against their hashes |
//! | [`develop`] | black level, response, brackets to light |
//! | [`covered`] | which pixels see the object, and not the screen itself |
//! | [`lamps`] | irradiances from the white ball |
//! | [`checks`] | movement, drift, linearity |
//! | [`shots`] | photographs of a screen's calibration patterns |
//! | [`places`] | which place of a screen each pixel sees, and what covers it |
//! | [`stage`] | `T` of a stage |
//! | [`screen`] | `T` of a screen |

pub mod checks;
pub mod covered;
pub mod develop;
pub mod gantry;
pub mod lamps;
pub mod places;
pub mod records;
pub mod screen;
pub mod shots;
pub mod stage;
#[cfg(test)]
mod tests;
