//! The reflectance field `T` and its container.
//!
//! A `.rfield` is one ZIP (Zip64) whose entries are stored, not deflated, and 64-byte aligned, so that it can be
//! memory-mapped, listed with `unzip -l`, and its arrays opened by `numpy.load`:
//!
//! ```text
//! transport/dense.npy   T at lamps or texels, [block y, block x, channel, element, 8, 16], `<f2` or `<f4`
//! transport/*.npy       compact representations of it, beside it or in its place ([`Representation`]), each with its errors
//! layers/*.npy          ambient S, normals, albedo (height, width, 3), alpha (height, width), `<f4`, row 0 at the top
//! preview.png           a lit picture for file browsers
//! manifest.json         what it is, the domain with its geometry, provenance, BLAKE3 of every other entry
//! ```
//!
//! A block is 16 x 8 pixels of one channel, its elements one after another: relighting streams it once, accumulators in
//! registers, and a window of the picture reads only its blocks.
//!
//! | part | what it holds |
//! |---|---|
//! | `manifest` | the JSON, checked |
//! | `archive` | the ZIP, checked: what lies where |
//! | `npy` | array headers |
//! | `store` | how bytes arrive: mapped or read |
//! | `dense` | one coefficient picture per element |
//! | `harmonics` | coefficient pictures of spherical harmonics |
//! | `factored` | tiles of low rank |
//! | `sparse` | wavelet coefficients of each pixel |
//! | `explicit` | pictures under wavelets that a screen showed |
//! | `terms` | the arrays of `sparse` as they are made |
//! | `samples` | the samples at the lamps, as photographed or decoded |
//! | `writer` | a container from bands of `T`, in bounded memory |
//! | `asset` | an open container |
//! | `rewrite` | a container from another: layers added |
//! | `merge` | a container from parts of it |
//! | [`compress`] | a container from another: compact representations |

mod archive;
mod asset;
pub mod compress;
mod dense;
mod explicit;
mod factored;
mod harmonics;
mod manifest;
mod mapping;
mod merge;
mod npy;
mod rewrite;
mod samples;
mod sparse;
mod spool;
mod store;
mod terms;
mod writer;

pub use asset::Asset;
pub use dense::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Block, BlockBuffer, Dense, Layout};
pub use explicit::Explicit;
pub use factored::{Factored, Tiles};
pub use harmonics::Harmonics;
pub use manifest::{FORMAT, Kind, Loss, MOST_ELEMENTS, Manifest, Precision, Representation, Stand, VERSION};
pub use merge::{TILES, merge, tiles_of};
pub use rewrite::{NewLayer, add_layers};
pub use samples::Samples;
pub use sparse::{Sparse, TermBuffer, Terms};
pub use store::Access;
pub use writer::{
    Bands, BlockTerms, Contents, TermBands, TermBasis, check_elements, write, write_explicit, write_terms,
};

#[cfg(test)]
mod tests;
