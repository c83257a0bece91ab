//! From photographs to a field.
//!
//! | part | what it holds |
//! |---|---|
//! | `photographs` | pictures of `T`, one a lamp, turned into the container's blocks in bounded memory |
//! | `positions` | squares of a projector to terms, position after position, in bounded memory |
//! | `measured` | irradiances of lamps one by one, and flat fields of near lamps |
//! | `import_lp` | a folder of one-light-at-a-time photographs with its `.lp` file -> a container |
//! | `import_exr` | the parts or layers of an OpenEXR file -> a container |
//! | `refraction` | codes seen through clear glass -> a place of the screen a pixel |
//! | [`explicit`] | explicit sampling on a screen: which function next, and what it is worth (6.6) |
//! | [`separable`] | squares of a projector one by one, from photographs of many (7.5) |
//! | `surface` | normals and albedo from the reflectance functions |
//! | `stereo` | photometric stereo for one pixel, shadows and highlights rejected |

pub mod explicit;
pub mod implicit;
mod import_exr;
mod import_lp;
mod measured;
mod photographs;
mod positions;
mod refraction;
pub mod separable;
mod stereo;
mod surface;

pub use import_exr::{CheckedExr, ImportExr};
pub use import_lp::{Checked, ImportLp, Imported, coverage};
pub use measured::{FlatField, Measured};
pub use photographs::{Photographs, Reporting};
pub use positions::PositionTerms;
pub use refraction::Refraction;
pub use surface::{Surface, surface};
