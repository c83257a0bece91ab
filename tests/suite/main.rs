//! The one integration test binary.

mod cli;
mod host_self;
mod photographs;
mod plugin;
mod relight_effect;
mod sets;
