//! From a session of a screen to a field.
//!
//! ```text
//! patterns, codes -> the screen's curve -> light L_k of the texels --------------------------+
//! photographs -> light, black S subtracted -> the screen itself taken out -> answers P_k --> solve -> T
//! Gray codes -> correspondence -+-> what is seen of the screen past the object --^
//! stripes -> alpha -------------+-> how bright the white screen is: the unit of T
//! ```
//!
//! | part | what it holds |
//! |---|---|
//! | [`photographs`] | photographs as light, captured or imported |
//! | [`emitted`] | what the screen showed |
//! | [`view`] | where each pixel looks, what covers it, how bright the screen is |
//! | [`implicit`] | terms of each pixel from patterns of noise (6.7) |
//! | [`explicit`] | a picture a basis function (6.6) |
//! | [`scan`] | a picture a square |

pub mod emitted;
pub mod explicit;
pub mod implicit;
pub mod photographs;
pub mod scan;
pub mod view;
