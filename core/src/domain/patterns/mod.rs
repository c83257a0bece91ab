//! Patterns: what a screen or a projector shows while the camera looks, set by set.
//!
//! A set is known by its kind and its grid of texels alone (and, for noise, its seed): the same in every run, on every machine.
//! A pattern is linear light, 0 to 1, grey: all three channels are measured at once, and only relighting brings colour in (6.3).
//! [`Emitter`] turns light into codes, by the inverse of the emitter's curve.
//!
//! | kind | for | section |
//! |---|---|---|
//! | `wavelets` | the columns of S, positive and negative parts apart, or shifted to mid-grey: explicit sampling | 6.6 |
//! | `noise` | wavelet noise: implicit sampling | 6.7 |
//! | `stripes` | ever finer stripes: the matte; 64 of them: the screen in the camera's pixels | 6.6.4, 6.3 |
//! | `gray_code` | the place on the screen that a pixel sees | 6.3 |
//! | `ramp` | every code once: the curve of the emitter | 6.3 |
//! | `squares` | one square of a projector after another, filtered | 7.3 |
//! | `shown` | back from a picture that was shown to its light | |
//! | `crossed` | horizontal and vertical sets of squares | 7.5 |

mod crossed;
mod gray_code;
mod noise;
mod ramp;
mod shown;
mod squares;
mod stripes;
mod wavelets;

use std::fmt;
use std::sync::Arc;

use serde::Serialize;

use super::{Emitter, Filter, Plane};
use crate::error::{Error, Result};
use crate::wavelet::{Orientation, Place, Wavelet};

pub use noise::Noise;
pub use shown::emitted;
pub use wavelets::Wavelets;

/// A kind of pattern set, with what it needs to know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// Columns of S of a wavelet, coarsest first, each scaled to the range; positive parts, then negative ones.
    Wavelet(Wavelet),
    /// The same, each function shifted and scaled to the range in place of split in two: `(psi / scale + 1) / 2`. Scaling
    /// functions that are nowhere negative are shown as they are.
    Shifted(Wavelet),
    /// Wavelet noise.
    Noise(Noise),
    /// Stripes, 2, 4, 8... until they are a texel wide, or one number of them.
    Stripes(Option<usize>),
    /// The bits of column and row in Gray code, finest last.
    GrayCode,
    /// All codes of an 8-bit emitter.
    Ramp,
    /// One square of `side` x `side` after another.
    Squares {
        /// Squares along each side of the picture.
        side: usize,
        /// How each falls off.
        filter: Filter,
    },
    /// Every `influence`-th square of a column, then of a row.
    Crossed {
        /// Squares along each side of the picture.
        side: usize,
        /// d: squares from one that is lit to the next.
        influence: usize,
        /// How each falls off.
        filter: Filter,
    },
}

impl Kind {
    /// The permanent name for command lines and files.
    pub fn id(&self) -> &'static str {
        match self {
            Self::Wavelet(_) => "wavelet",
            Self::Shifted(_) => "wavelet-shifted",
            Self::Noise(_) => "noise",
            Self::Stripes(_) => "stripes",
            Self::GrayCode => "gray-code",
            Self::Ramp => "ramp",
            Self::Squares { .. } => "squares",
            Self::Crossed { .. } => "hv",
        }
    }
}

/// What a pattern changes along.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// Horizontal stripes: rows differ.
    Horizontal,
    /// Vertical stripes: columns differ.
    Vertical,
}

/// Which pattern of its set one is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(untagged)]
pub enum Element {
    /// A part of a column of S.
    Wavelet {
        /// Where its coefficient lies among all of them: row x columns + column.
        location: u32,
        /// 0 is the coarsest.
        level: u32,
        /// lh, hl, hh, or none for a scaling function.
        #[serde(skip_serializing_if = "Option::is_none")]
        orientation: Option<&'static str>,
        /// Column in its band.
        x: u32,
        /// Row in its band.
        y: u32,
        /// Whether it is the negative part.
        negative: bool,
    },
    /// A column of S about mid-grey.
    Shifted {
        /// Where its coefficient lies among all of them: row x columns + column.
        location: u32,
        /// 0 is the coarsest.
        level: u32,
        /// lh, hl, hh, or none for a scaling function.
        #[serde(skip_serializing_if = "Option::is_none")]
        orientation: Option<&'static str>,
        /// Column in its band.
        x: u32,
        /// Row in its band.
        y: u32,
    },
    /// The `number`-th pattern of noise, from 0.
    Noise {
        /// From 0.
        number: usize,
    },
    /// Stripes, the first one lit.
    Stripes {
        /// How they lie.
        stripes: Direction,
        /// How many.
        count: usize,
        /// The first one dark.
        inverse: bool,
    },
    /// A bit of the Gray code of the column (vertical stripes) or row.
    GrayCode {
        /// How its stripes lie.
        stripes: Direction,
        /// 0 is the finest.
        bit: u32,
        /// Zeros lit.
        inverse: bool,
    },
    /// A code of 0 to 255, everywhere.
    Ramp {
        /// The code.
        code: u8,
    },
    /// A square.
    Square {
        /// Column of the square.
        column: usize,
        /// Row of the square.
        row: usize,
    },
    /// H: squares of a column, every d-th of them.
    Horizontal {
        /// Column of the squares.
        column: usize,
        /// The row of the first.
        offset: usize,
    },
    /// V: squares of a row, every d-th of them.
    Vertical {
        /// Row of the squares.
        row: usize,
        /// The column of the first.
        offset: usize,
    },
}

impl Element {
    /// A part of the basis function at a place.
    fn wavelet(location: u32, Place { level, orientation, x, y }: Place, negative: bool) -> Self {
        Self::Wavelet { location, level, orientation: orientation.map(letters), x, y, negative }
    }

    /// The basis function at a place, shifted.
    fn shifted(location: u32, Place { level, orientation, x, y }: Place) -> Self {
        Self::Shifted { location, level, orientation: orientation.map(letters), x, y }
    }
}

fn letters(orientation: Orientation) -> &'static str {
    match orientation {
        Orientation::LowHigh => "lh",
        Orientation::HighLow => "hl",
        Orientation::HighHigh => "hh",
    }
}

impl fmt::Display for Element {
    /// Lower-case letters, digits and hyphens, fit for the name of a file.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let inverted = |inverse: bool| if inverse { "-inverse" } else { "" };
        let letter = |stripes: Direction| if stripes == Direction::Horizontal { 'h' } else { 'v' };
        match *self {
            Self::Wavelet { level, orientation, x, y, negative, .. } => {
                let sign = if negative { "negative" } else { "positive" };
                write!(f, "level{level}-{}-x{x}-y{y}-{sign}", orientation.unwrap_or("scaling"))
            }
            Self::Shifted { level, orientation, x, y, .. } => {
                write!(f, "level{level}-{}-x{x}-y{y}-shifted", orientation.unwrap_or("scaling"))
            }
            Self::Noise { .. } => write!(f, "noise"),
            Self::Stripes { stripes, count, inverse } => {
                write!(f, "{}{count}{}", letter(stripes), inverted(inverse))
            }
            Self::GrayCode { stripes, bit, inverse } => {
                write!(f, "{}-bit{bit}{}", letter(stripes), inverted(inverse))
            }
            Self::Ramp { code } => write!(f, "code{code:03}"),
            Self::Square { column, row } => write!(f, "x{column}-y{row}"),
            Self::Horizontal { column, offset } => write!(f, "h-x{column}-from{offset}"),
            Self::Vertical { row, offset } => write!(f, "v-y{row}-from{offset}"),
        }
    }
}

/// What one pattern emits: linear light of each texel, 0 to 1, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Pattern {
    /// Texels in a row.
    pub columns: usize,
    /// Texels in a column.
    pub rows: usize,
    /// `values[row * columns + column]`.
    pub values: Vec<f32>,
}

impl Pattern {
    /// The codes that make an emitter show it.
    pub fn codes(&self, emitter: &Emitter) -> Vec<u16> {
        self.values.iter().map(|light| emitter.code(*light)).collect()
    }
}

/// One kind of set, on a grid.
trait Series: fmt::Debug + Send + Sync {
    fn len(&self) -> usize;
    fn element(&self, n: usize) -> Element;
    /// Light of all texels.
    fn values(&self, n: usize) -> Vec<f32>;
    /// See [`PatternSet::scale`].
    fn scale(&self, _n: usize) -> f32 {
        1.0
    }
}

/// A set of patterns; cheap to clone.
///
/// ```
/// use relume_core::domain::{Plane, patterns::{Kind, PatternSet}};
/// let set = PatternSet::new(Kind::GrayCode, Plane::new(4, 2)?)?;
/// assert_eq!((set.len(), set.name(1)), (6, "0001-v-bit1-inverse".to_owned()));
/// assert_eq!(set.pattern(0).values, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0]);
/// # Ok::<(), relume_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct PatternSet {
    kind: Kind,
    plane: Plane,
    series: Arc<dyn Series>,
}

impl PatternSet {
    /// The set of a kind on a grid.
    ///
    /// # Errors
    /// A wavelet that is not symmetric (a screen does not go round); more stripes or squares than texels; numbers that make
    /// no set.
    pub fn new(kind: Kind, plane: Plane) -> Result<Self> {
        let series: Arc<dyn Series> = match kind {
            Kind::Wavelet(wavelet) => Arc::new(Wavelets::new(wavelet, plane)?),
            Kind::Shifted(wavelet) => Arc::new(wavelets::Shifted::new(wavelet, plane)?),
            Kind::Noise(noise) => Arc::new(noise::Patterns::new(noise, plane)?),
            Kind::Stripes(count) => Arc::new(stripes::Stripes::new(count, plane)?),
            Kind::GrayCode => Arc::new(gray_code::GrayCode::new(plane)),
            Kind::Ramp => Arc::new(ramp::Ramp::new(plane)),
            Kind::Squares { side, filter } => Arc::new(squares::Squares::new(side, filter, plane)?),
            Kind::Crossed { side, influence, filter } => {
                Arc::new(crossed::Crossed::new(side, influence, filter, plane)?)
            }
        };
        if series.len() == 0 {
            let found = format!("{} x {} texels", plane.columns(), plane.rows());
            return Err(Error::invalid(format!("patterns of {}", kind.id()), found, "a grid that has some"));
        }
        Ok(Self { kind, plane, series })
    }

    /// The kind.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The grid.
    pub fn plane(&self) -> Plane {
        self.plane
    }

    /// How many patterns.
    #[allow(clippy::len_without_is_empty, reason = "never empty")]
    pub fn len(&self) -> usize {
        self.series.len()
    }

    /// Whether values are shares of the largest *code* in place of light: of what measures the curve that is not known yet.
    pub fn is_codes(&self) -> bool {
        self.kind == Kind::Ramp
    }

    /// Which pattern the `n`-th is.
    ///
    /// # Panics
    /// From `len` on, as do the others.
    pub fn element(&self, n: usize) -> Element {
        assert!(n < self.len(), "pattern {n} of {}", self.len());
        self.series.element(n)
    }

    /// A name whose alphabetical order is the order of the set, fit for a file: its number, then what it shows.
    pub fn name(&self, n: usize) -> String {
        let digits = (self.len() - 1).to_string().len().max(4);
        format!("{n:0digits$}-{}", self.element(n))
    }

    /// The light of the `n`-th pattern.
    pub fn pattern(&self, n: usize) -> Pattern {
        assert!(n < self.len(), "pattern {n} of {}", self.len());
        Pattern { columns: self.plane.columns(), rows: self.plane.rows(), values: self.series.values(n) }
    }

    /// What turns the emitted light back into functions of the constant-energy normalisation: a wavelet is scale times the
    /// difference of its parts (shifted: scale times the pattern twice less white), noise is scale times the difference from its mean. One for all other kinds.
    pub fn scale(&self, n: usize) -> f32 {
        assert!(n < self.len(), "pattern {n} of {}", self.len());
        self.series.scale(n)
    }
}

/// The texels of the `n`-th of `count` equal parts of a side.
fn part(n: usize, count: usize, side: usize) -> std::ops::Range<usize> {
    n * side / count..(n + 1) * side / count
}

/// Refuses a number of parts that a side of either direction does not have.
fn check_parts(what: &str, count: usize, plane: Plane) -> Result<()> {
    let most = plane.columns().min(plane.rows());
    if (1..=most).contains(&count) {
        return Ok(());
    }
    let place = format!("{what} of {} x {} texels", plane.columns(), plane.rows());
    Err(Error::invalid(place, count.to_string(), format!("1 to {most}, the shorter side")))
}

#[cfg(test)]
mod tests;
