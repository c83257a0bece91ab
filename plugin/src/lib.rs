//! OpenFX effects that relight captured reflectance fields.
//!
//! A host finds the effects through the two exported functions of `exports`, and talks to each through one entry
//! point. Data flows down this list; a module uses only modules above it.
//!
//! | module | what it holds |
//! |---|---|
//! | `error` | what can go wrong, as sentences for the artist |
//! | `host` | the border: every raw pointer and every call into the host lives there |
//! | `pool` | our threads, which end with Unload |
//! | `registry` | open files, shared between instances |
//! | `paths` | typed paths: `${VAR}`, relative, quoted |
//! | `pixels` | depths and components of hosts <-> linear premultiplied RGBA |
//! | `area` | scaling by area, and the one flip of rows |
//! | `effects` | Relume Relight, Relume Environment Matte |
//! | `exports` | what the library exports |

#![deny(unsafe_code)]

mod area;
mod effects;
mod error;
#[allow(unsafe_code, reason = "two exported symbols")]
mod exports;
#[allow(unsafe_code, reason = "the border to the host")]
mod host;
mod paths;
mod pixels;
mod pool;
mod registry;
