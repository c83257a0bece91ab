//! Virtual rigs: a path tracer that returns rows of `T`, and the same scene lit directly as a truth to compare with.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Scene`], [`Shape`], [`Material`], [`Camera`] | what stands before the camera |
//! | `tracer` | paths, and the trait through which they hand over light |
//! | [`Stage`], [`StageBands`] | light collected by lamp cell: `T`, band by band |
//! | [`truth`] | light collected from maps: the picture itself |
//! | [`lit`] | the same for light that varies in space |
//! | [`lights`] | sky, window and strip as maps |
//! | [`Monitor`], [`ScreenPlane`], [`Screen`] | a screen behind the scene: where it is, and what its codes emit |
//! | [`Gantry`] | a projector carried about the scene |
//! | `reverse` | the scene from the projector's side, lit by the camera |
//! | [`Grids`], [`Rows`] | `T` of either rig: sparse, by elements and blocks of them, and its file |
//! | [`Sensor`] | the camera's codes: response, noise, quantisation |
//! | [`WhiteBall`], [`Card`] | calibration targets, in closed form |
//! | [`classes`] | what each pixel shows first, and coverage |
//!
//! Every lamp of the stage is a distant light of uniform radiance that fills its Voronoi cell, so that
//! `T_j = (1 / Omega_j) * integral over the cell of t(w) dw`, `t` the reflectance function of the pixel and `Omega_j`
//! the solid angle of the cell inside the coverage. A real `photo_j / E_j` divides by the irradiance of a patch that faces
//! the lamp, the integral of the cosine to the lamp: smaller than `Omega_j` by half the mean squared radius of the cell,
//! 0.04 % for 1500 lamps on a hemisphere.
//!
//! **What is sampled where.** At each hit that is not specular, light arrives in three disjoint ways, by what its
//! direction meets first: nothing (next-event estimation to the lamps or the map), a mirror or a glass (stratified directions in the cone of
//! each specular object, followed to where they leave), another surface (one bounce by the BSDF, dropped when it meets
//! either of the other two). The three are a partition of the hemisphere, so nothing counts twice.

mod blocks;
mod camera;
mod classes;
mod demo;
mod gantry;
#[cfg(test)]
mod gantry_tests;
mod grids;
mod lamps;
pub mod lights;
mod lit;
#[cfg(test)]
mod lit_tests;
mod material;
mod monitor;
#[cfg(test)]
mod monitor_tests;
mod reverse;
mod rig_scenes;
mod rows;
mod rows_file;
mod sampling;
mod scene;
mod screen;
mod sensor;
mod shape;
mod stage;
mod targets;
#[cfg(test)]
mod tests;
mod tracer;
mod truth;

pub use camera::Camera;
pub use classes::{Class, ClassMap, classes};
pub use demo::{demo_lamps, grid_lamps};
pub use gantry::Gantry;
pub use grids::Grids;
pub use lit::lit;
pub use material::Material;
pub use monitor::{Monitor, ScreenPlane};
pub use rows::Rows;
pub use scene::{Object, Scene};
pub use screen::{Screen, ScreenCurve};
pub use sensor::{Codes, Sensor, SensorResponse};
pub use shape::Shape;
pub use stage::{Quality, Stage, StageBands};
pub use targets::{Card, FarLamp, WhiteBall};
pub use truth::truth;

/// Positions and directions of the tracer, in the stage frame; lengths in scene units.
pub type V3 = nalgebra::Vector3<f32>;

/// Called with the rows done and the rows in all; an error (such as [`Error::Cancelled`](crate::Error::Cancelled)) stops
/// the work.
pub type Progress<'a> = dyn FnMut(u64, u64) -> crate::Result<()> + 'a;
