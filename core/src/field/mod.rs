//! The reflectance field `T` and its container.
//!
//! A `.rfield` is one ZIP (Zip64) whose entries are stored, not deflated, and 64-byte aligned, so that it can be
//! memory-mapped, listed with `unzip -l`, and its arrays opened by `numpy.load`:
//!
//! ```text
//! transport/dense.npy   T, [block y, block x, channel, element, 8, 16], `<f2` or `<f4`
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
//! | `writer` | a container from bands of `T`, in bounded memory |
//! | `asset` | an open container |
//! | `rewrite` | a container with layers added |

mod archive;
mod asset;
mod dense;
mod manifest;
mod mapping;
mod npy;
mod rewrite;
mod store;
mod writer;

pub use asset::Asset;
pub use dense::{BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, Block, BlockBuffer, Dense, Layout};
pub use manifest::{FORMAT, Manifest, Precision, VERSION};
pub use rewrite::{NewLayer, add_layers};
pub use store::Access;
pub use writer::{Bands, Contents, write};

#[cfg(test)]
mod tests;
