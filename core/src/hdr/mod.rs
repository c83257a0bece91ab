//! High dynamic range photographs: camera response, and brackets merged to light (2.2.1).
//!
//! A scene photographed several times, each time longer, becomes one picture of linear light: `E = x / s`, with `x` the light
//! that a photograph's codes stand for (white code = 1) and `s` its relative exposure, `t * (ISO / 100) / N^2` as far as these
//! are known. So the pixel value is 1 where a photograph with `s = 1` would just be white; brackets of one camera
//! share that scale. Pictures stay in the camera's colours.
//!
//! ```text
//! files -> Bracket -> align::shift -> Survey -> recover -> merge -> Merged { image, report }
//!          Exposure -> relative         clip    Response   Noise
//! ```
//!
//! | file | what it does |
//! |---|---|
//! | `exposure` | times, ISO speeds and F-numbers, from EXIF or as people write them |
//! | `bracket` | photographs of one size and type, loaded when wanted |
//! | [`align`] | how far photographs are shifted against each other (Ward 2003) |
//! | `survey` | where they clip; pixels to recover a response from |
//! | `recover` | the response from photographs (Debevec and Malik 1997) |
//! | `patches`, `recover_deep` | the same of codes deeper than 8 bits, with a dark level and the sensor's noise |
//! | `response` | a camera's response, and its file |
//! | `curve` | codes to light above the dark level, and what rounding costs |
//! | `noise` | how far a sensor strays |
//! | `merge` | the weighted mean of least variance |
//! | `report` | what was clipped, dark and used |
//! | [`series`] | which exposures to take; is a bracket complete? |
//! | `raw` | camera raw files, where the feature `raw` is built in |

pub mod align;
mod bracket;
mod curve;
mod exposure;
mod merge;
mod noise;
mod patches;
#[cfg(feature = "raw")]
mod raw;
mod recover;
mod recover_deep;
mod report;
mod response;
pub mod series;
mod survey;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;

pub use bracket::{Bracket, ToRec709, apply_matrix, is_raw};
pub use curve::{Curve, Decoder};
pub use exposure::{Exposure, Relative, parse_time, relative, taken_s};
pub use merge::{Merged, Merger, Options, Shot, merge};
pub use noise::Noise;
pub use patches::{Codes, Patch, Patches};
pub use recover::{LAMBDA, Recovered, RecoveryReport, recover};
pub use recover_deep::{Known, recover_deep};
pub use report::{Report, Shares, Use};
pub use response::{ANCHOR, CODES, Response};
pub use survey::{Sample, Survey};
