//! The one integration test binary.

mod host_self;
mod plugin;
mod relight_effect;
