//! The border to the host application.
//!
//! The host hands out handles and tables of functions (suites); everything it gives can be missing, so every read is an
//! `Option`. The rest of the plug-in sees only the safe types here: a raw pointer never leaves this folder. Each lives
//! as long as the call that the host made, and what must be given back (an image) is given back on drop.
//!
//! | file | what it wraps |
//! |---|---|
//! | `suites` | the host itself and its tables |
//! | `property` | property sets |
//! | `effect` | descriptors and instances, messages, abort |
//! | `clip` | clips |
//! | `image` | images, with their layout checked |
//! | `param` | parameters |
//! | `entry` | one call of the host: action, handle, arguments; panics end here |
//!
//! Source: the OpenFX Image Effect Plug-in API 1.5, through the `sys` layer of crate `openfx`.

mod clip;
mod effect;
mod entry;
mod image;
mod param;
mod property;
mod suites;

pub use clip::Clip;
pub use effect::Effect;
pub use entry::{Action, Call, Exported, Handler, Reply, plugin};
pub use image::{AlphaState, Components, Depth, Image, Layout, Rect};
pub use param::Params;
pub use property::Properties;
pub use suites::Suites;
use suites::forget_suites;

/// The standard's names, so that nothing else imports the binding.
pub mod names {
    pub use openfx::sys::generic::core::*;
    pub use openfx::sys::image_effect_v1::image_effect::*;
    pub use openfx::sys::image_effect_v1::param::*;
}

/// Text as the host wants it; a NUL inside cannot be expressed and is left out.
fn c_text(text: &str) -> std::ffi::CString {
    let bytes: Vec<u8> = text.bytes().filter(|&b| b != 0).collect();
    std::ffi::CString::new(bytes).unwrap_or_default()
}
