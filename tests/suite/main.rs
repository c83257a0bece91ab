//! The one integration test binary.

mod cli;
mod cli_sets;
mod host_self;
mod lamps;
mod photographs;
mod plugin;
mod probe;
mod relight_effect;
