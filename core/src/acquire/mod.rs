//! From photographs to a field.
//!
//! | part | what it holds |
//! |---|---|
//! | `photographs` | pictures of `T`, one a lamp, turned into the container's blocks in bounded memory |
//! | `import_lp` | a folder of one-light-at-a-time photographs with its `.lp` file -> a container |

mod import_lp;
mod photographs;

pub use import_lp::{Checked, ImportLp, Imported};
pub use photographs::Photographs;
