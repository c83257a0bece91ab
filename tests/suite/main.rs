//! The one integration test binary.

mod cameras;
mod capture;
mod cli;
mod cli_sets;
mod compact;
mod compression;
#[cfg(unix)]
mod devices;
mod dual;
mod evaluate;
mod exchange;
mod explicit;
mod gantry;
mod hdr;
mod host_self;
mod lamp_peers;
mod lamps;
mod layers;
mod lights;
mod look;
mod matte_effect;
mod monitor;
mod near_effect;
mod patterns;
mod photographs;
mod plugin;
mod probe;
mod real_stage;
mod relight_effect;
mod screen;
mod screens;
#[cfg(unix)]
mod simulated;
