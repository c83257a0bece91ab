//! Session folders: the photographs as the camera gave them, and how they came to be.
//!
//! ```text
//! session.toml      what captures here: rig, sampler, seed, tool version ([`Description`]); never changed
//! journal.jsonl     append-only, a line a finished photograph ([`Line`]), synced before the next condition is emitted
//! photos/NNNNNN/    photograph N, counted from 1: one file an exposure, as the camera gave them
//! calibration/      imports: the .lp file, black photograph, tables; captures: what `pack` found, for people to read
//! patterns/         imports of pairs: the pictures that were shown, and what is known of them
//! lights.lp         imports of one lamp a photograph: the photographs with their directions
//! references/       pictures shown on a screen to be photographed
//! contact-sheets/   small pictures with their numbers, a page a hundred photographs
//! capture.log       a line a photograph, for people
//! session.lock      who captures here now
//! ```
//!
//! **What survives.** A photograph is downloaded into `photos/.NNNNNN.part/`, its files are synced, the folder is renamed and
//! the parent synced; then the journal gets its line, with the BLAKE3 of every file, and is synced. So whatever instant a
//! process dies at, the journal names only photographs that are whole, and at most the one in flight is lost. A line that
//! was cut off, and a photograph whose line was never written, are cleared away when the session is opened again.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Description`] | `session.toml` |
//! | `journal` | lines, and what a torn end means |
//! | `lock` | one process at a time |
//! | [`Session`] | the open folder: photographs begun, finished, found again |
//! | [`staging`] | imports: a session written beside its place and renamed whole |
//! | [`pairs`] | imports of patterns with their photographs |

mod description;
mod folder;
mod journal;
mod lock;
pub mod pairs;
pub mod staging;
#[cfg(test)]
mod tests;

pub use description::{CaptureDescription, Description, ImportDescription, Source, one_line};
pub use folder::{PhotoFolder, Session, file_hash, photographs};
pub use journal::{Exposure, Frame, Journal, Line, Photograph, Role};
