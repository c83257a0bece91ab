//! The one integration test binary.

mod host_self;
mod relight_effect;
