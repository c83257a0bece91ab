//! The one integration test binary.

mod cli;
mod cli_sets;
mod hdr;
mod host_self;
mod photographs;
mod plugin;
mod relight_effect;
