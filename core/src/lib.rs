//! Reflectance fields: how a real object answers to light, and what it looks like under another light.
//!
//! The model is `C = T L + S` (P. Peers, "Sampling Reflectance Functions for Image-based Relighting",
//! 2006, eq. 3.1): `C` the photograph or relit picture (k pixels), `L` the illumination (l elements),
//! `T` the light transport (k x l: a row is the reflectance function of a pixel, a column the photograph
//! under one element), `S` what is seen with every controlled light off.
//!
//! Data flows down this list; a module uses only modules above it (a test enforces it).
//!
//! | module | what it holds |
//! |---|---|
//! | [`error`] | typed errors that say place, found, expected |
//! | [`files`] | outputs that appear whole or not at all |
//! | [`image`] | pictures in linear f32, windows, reading and writing |
//! | [`math`] | directions, lat-long maps |
//! | [`hdr`] | camera response, brackets merged to radiance |
//! | [`wavelet`] | wavelets: transforms, the tree of coefficients, which to keep (5, 6.4, A) |
//! | [`illumination`] | what a user calls "the light" |
//! | [`domain`] | what a rig could emit |
//! | [`reconstruct`] | reconstructions as downsampling operators (4.3, 4.4) |
//! | [`field`] | the reflectance field and its container |
//! | [`relight`] | weights x field -> picture |
//! | [`calibrate`] | lamp directions and intensities, white balance |
//! | [`matte`] | an object before a screen, put before another picture |
//! | [`acquire`] | from photographs to a field |
//! | [`simulate`] | a virtual stage |
//! | [`evaluate`] | errors and figures |
//! | [`settings`] | the one table of user settings |

#![deny(unsafe_code)]

pub mod error;
pub mod files;
pub mod image;
pub mod math;

pub mod hdr;

pub mod wavelet;

pub mod illumination;

pub mod domain;

pub mod reconstruct;

pub mod field;

pub mod relight;

pub mod calibrate;

pub mod matte;

pub mod acquire;

pub mod simulate;

pub mod evaluate;

pub mod settings;

pub use error::{Error, Result};
