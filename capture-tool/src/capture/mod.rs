//! The capture loop: one for all rigs, real or virtual.
//!
//! ```text
//! Sampler (what next?) -> Rig.emit -> Camera: set, expose, download, a frame an exposure time -> journal -> Sampler.observe
//! ```
//!
//! Resuming is not a second way through: the sampler is asked from the start, and what the journal has an answer for is told to
//! it instead of photographed.
//!
//! | part | what it holds |
//! |---|---|
//! | [`Step`], [`Sampler`] | what is asked for next, and for what |
//! | [`scan`] | the conditions of a stage, in order |
//! | [`patterns`] | the conditions of a screen or a projector |
//! | [`explicit`] | basis functions of a screen, chosen by what was seen (6.6) |
//! | [`plan`] | how many photographs, how long, how much disk; what is missing |
//! | [`run`] | the loop |
//! | `shoot` | one photograph: emit, expose, store; busy devices are asked again |
//! | `exposures` | times from previews, and the check of each bracket |
//! | [`contact`] | the live contact sheet |
//! | [`log`] | a line a photograph |

pub mod contact;
pub mod explicit;
mod exposures;
pub mod log;
pub mod patterns;
pub mod plan;
pub mod run;
pub mod scan;
mod shoot;

use relume_core::Result;
pub use shoot::{seconds, words};

use crate::rigs::Condition;
use crate::session::{Photograph, Role};

/// A photograph to be taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Its place among the sampler's steps, from 0: what a resumed capture knows it by.
    pub index: u64,
    /// What to emit.
    pub condition: Condition,
    /// What it is for.
    pub role: Role,
    /// How long to expose.
    pub times: Times,
    /// Samples before this one in the scan; lamps drift along it.
    pub scanned: u64,
}

impl Step {
    /// Part of what is taken once a session, apart from the object's own samples; previews that it needs included.
    pub fn is_calibration(&self) -> bool {
        let needed = !matches!(self.condition, Condition::Lamp(_) | Condition::AllLamps { .. });
        self.role.is_calibration() || (self.role == Role::Preview && needed)
    }
}

/// Exposure times of a step.
#[derive(Debug, Clone, PartialEq)]
pub enum Times {
    /// These, seconds, short to long.
    Fixed(Vec<f64>),
    /// Those chosen for photographs of this role (or given in the rig file), multiplied.
    Series {
        /// `sample` or `white-ball`.
        of: Role,
        /// All lamps together want less than one.
        factor: f64,
    },
}

/// Says which condition comes next.
///
/// What it says may depend only on what it was told through [`Sampler::observe`]: a resumed capture tells it the same.
pub trait Sampler {
    /// The next step; `None` when all is done.
    ///
    /// # Errors
    /// What the sampler cannot go on from.
    fn next(&mut self) -> Result<Option<Step>>;

    /// The step was photographed.
    ///
    /// # Errors
    /// A photograph that the sampler cannot read.
    fn observe(&mut self, step: &Step, photograph: &Photograph) -> Result<()>;

    /// Steps in all, as far as is known.
    fn expected(&self) -> u64;

    /// What it makes of what it was told, in a few words, for the progress line and the log.
    fn said(&self) -> Option<String> {
        None
    }
}

/// A sampler that ignores what is seen: a list.
#[derive(Debug)]
pub struct Listed {
    steps: std::vec::IntoIter<Step>,
    count: u64,
}

impl Listed {
    /// Asks for these, in order.
    pub fn new(steps: Vec<Step>) -> Self {
        Self { count: steps.len() as u64, steps: steps.into_iter() }
    }
}

impl Sampler for Listed {
    fn next(&mut self) -> Result<Option<Step>> {
        Ok(self.steps.next())
    }

    fn observe(&mut self, _: &Step, _: &Photograph) -> Result<()> {
        Ok(())
    }

    fn expected(&self) -> u64 {
        self.count
    }
}
