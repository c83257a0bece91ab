//! The effects of the library, and what they share.
//!
//! An effect is a folder: what it promises (`describe`), what the artist set (`controls`), its files and what is made of them
//! once (`library`), where its pictures lie and what they need (`regions`), the picture (`render`), the line that says what is
//! loaded (`status`). What is the same for all is here.
//!
//! | file | what it does |
//! |---|---|
//! | `instances` | instances by the host's handle |
//! | `files` | files by typed path, held open by the instances that use them |
//! | `recent` | what is made once a picture and kept for its tiles |
//! | `values` | values of the settings, at a time |
//! | `parameters` | the settings table as parameters of a host |
//! | `regions` | the plate's region; clip preferences |
//! | `placement` | where a picture lies that is centred on a plate |
//! | `request` | what the host wants to see |
//! | `canvas` | the output: bands of rows, each made, scaled, composited and stored |
//! | `status` | the line of text that says what is loaded |

mod canvas;
mod files;
mod instances;
pub mod matte;
mod parameters;
mod placement;
mod recent;
mod regions;
pub mod relight;
mod request;
mod status;
mod values;

use std::ffi::CStr;

/// The clip of the plate.
const SOURCE: &CStr = c"Source";
/// The clip of the picture.
const OUTPUT: &CStr = c"Output";
