//! The one integration test binary.

mod cli;
mod cli_sets;
mod evaluate;
mod host_self;
mod layers;
mod lights;
mod look;
mod photographs;
mod plugin;
mod relight_effect;
