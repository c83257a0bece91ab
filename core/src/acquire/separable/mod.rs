//! One photograph a square from 2 d n photographs of many squares (7.5).
//!
//! The horizontal set lights in column x every d-th square from row o on, `H(x, o)`; the vertical one in row y every d-th from column o
//! on, `V(y, o)` (see [`Kind::Crossed`](crate::domain::patterns::Kind::Crossed)). Square (x, y) is the one that both
//! `H(x, y mod d)` and `V(y, x mod d)` light, and where each of the others lights only what none of the other set does,
//!
//! ```text
//! T L(x, y) = min(T H(x, y mod d), T V(y, x mod d))                              (7.1)
//! ```
//!
//! pixel by pixel and channel by channel. That holds where light goes from a square to a pixel at once. Light that goes over
//! other surfaces comes from many squares, the two photographs share it though they do not share the squares, and the minimum
//! keeps it: what is recovered is too bright, never too dark.
//!
//! **Reliability.** So the squares recovered are summed and held against the photograph of all squares, which is the sum of the
//! horizontal set and of the vertical one. A pixel with direct light `a` and even light `e` a square over other surfaces answers `a + n^2 e`
//! in truth and `a + n^2 (n / d) e` recovered. See [`Reliability`].
//!
//! **Noise.** The smaller of two numbers of the same expectation and deviation `s` is too small by `s / sqrt(pi)`, 0.56 s. Most of the
//! n^2 photographs of a pixel are dark, and what is missing in each adds up under light of many squares. So where both differ
//! by no more than the noise does, the mean is taken, which has no such bias; the noise is measured from the photographs
//! themselves.
//!
//! Cost: a pass over 2 d n photographs for each sum, over two for a square. Memory: the 2 d n photographs of a position.

mod noise;
mod reliability;
#[cfg(test)]
mod tests;

use std::f64::consts::SQRT_2;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::image::Image;

pub use reliability::Reliability;

/// Values of both sets that differ by less, in deviations of their difference, are taken as the same: one pair in 400 of those that are
/// the same differs by more.
const SAME: f64 = 3.0;
/// Sums of both sets may differ by so much: what the scheme itself may be wrong by where it holds.
const AGREE: f64 = 0.02;
/// Side of the blocks whose means are compared, pixels: noise is down to an eighth, and what moved still shows.
const BLOCK: usize = 8;

/// The scheme for n x n squares of which every d-th of a line is lit.
///
/// ```
/// use relume_core::acquire::separable::Separable;
/// use relume_core::image::Image;
///
/// let scheme = Separable::new(4, 2)?;
/// assert_eq!((scheme.photographs(), scheme.pair(3, 2)), (16, [6, 8 + 5]));
/// // A pixel that only square (3, 2) lights.
/// let photograph = |n| Image::from_fn(1, 1, |_, _| if scheme.pair(3, 2).contains(&n) { [1.0; 3] } else { [0.0; 3] });
/// let position = scheme.position("position 1", (0..16).map(photograph).collect())?;
/// assert_eq!(position.square(3, 2).pixel(0, 0), [1.0; 3]);
/// assert_eq!(position.square(1, 2).pixel(0, 0), [0.0; 3]);
/// # Ok::<(), relume_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Separable {
    side: usize,
    influence: usize,
}

impl Separable {
    /// For `side` x `side` squares, `influence` from one that is lit to the next.
    ///
    /// # Errors
    /// An influence below 1 or above `side`.
    pub fn new(side: usize, influence: usize) -> Result<Self> {
        if !(1..=side).contains(&influence) {
            let expected = format!("1 to {side}, the number of squares along a side");
            return Err(Error::invalid("the influence of a square", influence.to_string(), expected));
        }
        Ok(Self { side, influence })
    }

    /// Squares along a side.
    pub fn side(&self) -> usize {
        self.side
    }

    /// d.
    pub fn influence(&self) -> usize {
        self.influence
    }

    /// Photographs of a position, without the black one: the horizontal set, then the vertical one, as
    /// [`Kind::Crossed`](crate::domain::patterns::Kind::Crossed) has them.
    pub fn photographs(&self) -> usize {
        2 * self.set()
    }

    /// Photographs of one set.
    fn set(&self) -> usize {
        self.side * self.influence
    }

    /// Numbers of the two photographs that have a square in common.
    pub fn pair(&self, column: usize, row: usize) -> [usize; 2] {
        let d = self.influence;
        [column * d + row % d, self.set() + row * d + column % d]
    }

    /// A position whose photographs come one by one; `name` is what messages call it.
    pub fn gather(&self, name: impl Into<String>) -> Gathering {
        Gathering { scheme: *self, name: name.into(), black: None, photographs: vec![None; self.photographs()] }
    }

    /// A position whose photographs have black subtracted already, in the order of the patterns.
    ///
    /// # Errors
    /// Another number of them; sizes that differ; numbers that are not finite.
    pub fn position(&self, name: impl Into<String>, photographs: Vec<Image>) -> Result<Position> {
        Position::new(*self, name.into(), photographs)
    }
}

/// Photographs of a position as they come.
#[derive(Debug)]
pub struct Gathering {
    scheme: Separable,
    name: String,
    black: Option<Image>,
    photographs: Vec<Option<Image>>,
}

impl Gathering {
    /// The black photograph, in the unit of the others.
    pub fn black(&mut self, photograph: Image) {
        self.black = Some(photograph);
    }

    /// The photograph of a pattern; a later one of the same pattern takes its place.
    ///
    /// # Errors
    /// A number that no pattern has.
    pub fn photograph(&mut self, number: usize, photograph: Image) -> Result<()> {
        let count = self.photographs.len();
        let Some(place) = self.photographs.get_mut(number) else {
            let expected = format!("{count} of them, 2 d n");
            return Err(Error::invalid(&self.name, format!("pattern {}", number + 1), expected));
        };
        *place = Some(photograph);
        Ok(())
    }

    /// Subtracts black.
    ///
    /// # Errors
    /// No black photograph, or none of a pattern; as [`Separable::position`].
    pub fn complete(self) -> Result<Position> {
        let again = "photograph what is missing with --resume";
        let Some(black) = self.black else {
            let expected =
                format!("one: a projector's black is light, and is subtracted from every photograph (7.3); {again}");
            return Err(Error::invalid(self.name, "no black photograph", expected));
        };
        if let Some(number) = self.photographs.iter().position(Option::is_none) {
            let missing = self.photographs.iter().filter(|p| p.is_none()).count();
            let found = format!("no photograph of hv {} ({missing} are missing)", number + 1);
            return Err(Error::invalid(self.name, found, format!("all {}; {again}", self.photographs.len())));
        }
        let mut photographs: Vec<Image> = self.photographs.into_iter().flatten().collect();
        check_sizes(&self.name, black.size(), &photographs)?;
        photographs.par_iter_mut().for_each(|photograph| {
            photograph.data_mut().iter_mut().zip(black.data()).for_each(|(value, black)| *value -= black);
        });
        self.scheme.position(self.name, photographs)
    }
}

fn check_sizes(name: &str, (width, height): (usize, usize), photographs: &[Image]) -> Result<()> {
    match photographs.iter().find(|p| p.size() != (width, height) || p.channels() != 3) {
        None => Ok(()),
        Some(odd) => {
            let found = format!("a photograph of {} x {} with {} channels", odd.width(), odd.height(), odd.channels());
            Err(Error::invalid(name, found, format!("{width} x {height}, red, green and blue, as the others")))
        }
    }
}

/// All photographs of one position, black subtracted.
#[derive(Debug)]
pub struct Position {
    scheme: Separable,
    name: String,
    photographs: Vec<Image>,
    /// Sums of the horizontal set and of the vertical one.
    sums: [Image; 2],
    /// Deviation of a dark photograph.
    noise: f64,
}

/// How far the photographs of all squares differ that the two sets give.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Root mean square of the difference of blocks of pixels, as a share of that of the blocks.
    pub difference: f64,
    /// What noise alone makes of it.
    pub noise: f64,
}

impl Agreement {
    /// Whether neither light nor object changed between the sets.
    pub fn holds(&self) -> bool {
        self.difference <= AGREE + SAME * self.noise
    }
}

impl Position {
    fn new(scheme: Separable, name: String, photographs: Vec<Image>) -> Result<Self> {
        if photographs.len() != scheme.photographs() {
            let found = format!("{} photographs", photographs.len());
            return Err(Error::invalid(name, found, format!("{}, 2 d n", scheme.photographs())));
        }
        check_sizes(&name, photographs[0].size(), &photographs)?;
        let odd = photographs.par_iter().position_first(|p| p.data().iter().any(|v| !v.is_finite()));
        if let Some(number) = odd {
            let found = format!("a photograph of hv {} with numbers that are not finite", number + 1);
            return Err(Error::invalid(name, found, "light"));
        }
        let (horizontal, vertical) = photographs.split_at(scheme.set());
        let sums = [sum(horizontal), sum(vertical)];
        let noise = noise::of_dark(&photographs, scheme.influence);
        Ok(Self { scheme, name, photographs, sums, noise })
    }

    /// The scheme.
    pub fn scheme(&self) -> Separable {
        self.scheme
    }

    /// Deviation of what is dark in a photograph, measured.
    pub fn noise(&self) -> f64 {
        self.noise
    }

    /// Does not look at noise: the plain minimum everywhere, as the thesis has it.
    #[must_use]
    pub fn plain(self) -> Self {
        Self { noise: 0.0, ..self }
    }

    /// The photograph that one square would have made.
    ///
    /// # Panics
    /// Squares beyond the side.
    pub fn square(&self, column: usize, row: usize) -> Image {
        assert!(column < self.scheme.side && row < self.scheme.side, "square ({column}, {row})");
        let [h, v] = self.scheme.pair(column, row).map(|n| &self.photographs[n]);
        let (mut image, same) = (h.clone(), self.same());
        let chunk = 3 * h.width().max(1);
        image.data_mut().par_chunks_mut(chunk).zip(v.data().par_chunks(chunk)).for_each(|(line, v)| {
            line.iter_mut().zip(v).for_each(|(h, v)| *h = common(*h, *v, same));
        });
        image
    }

    /// The photograph of all squares: the mean of both sets' sums.
    pub fn white(&self) -> Image {
        let mut white = self.sums[0].clone();
        white.data_mut().iter_mut().zip(self.sums[1].data()).for_each(|(h, v)| *h = 0.5 * (*h + v));
        white
    }

    /// Whether the horizontal set adds up to what the vertical one does.
    pub fn agreement(&self) -> Agreement {
        let (width, height) = self.sums[0].size();
        let [horizontal, vertical] = &self.sums;
        let (mut differences, mut energy, mut blocks) = (0.0, 0.0, 0.0);
        for y0 in (0..height).step_by(BLOCK) {
            for x0 in (0..width).step_by(BLOCK) {
                let (across, down) = (x0..(x0 + BLOCK).min(width), y0..(y0 + BLOCK).min(height));
                let mut sums = [[0.0f64; 3]; 2];
                for (x, y) in down.clone().flat_map(|y| across.clone().map(move |x| (x, y))) {
                    for (sum, image) in sums.iter_mut().zip([horizontal, vertical]) {
                        sum.iter_mut().zip(image.pixel(x, y)).for_each(|(s, v)| *s += f64::from(*v));
                    }
                }
                let pixels = (across.len() * down.len()) as f64;
                for (h, v) in sums[0].iter().zip(sums[1]) {
                    differences += ((h - v) / pixels).powi(2);
                    energy += (0.5 * (h + v) / pixels).powi(2);
                    blocks += 1.0;
                }
            }
        }
        // Each block's difference has the noise of 2 d n photographs over its pixels; black is the same in both.
        let noise = self.noise * (self.scheme.photographs() as f64).sqrt() / BLOCK as f64;
        let share = |sum: f64| if energy > 0.0 { (sum / energy).sqrt() } else { 0.0 };
        Agreement { difference: share(differences), noise: share(blocks * noise * noise) }
    }

    /// Where the recovered squares cannot be right.
    pub fn reliability(&self) -> Reliability {
        Reliability::of(self)
    }

    /// What the person should know, a sentence each: nothing where all is well. Pixels that get more than `threshold` too much are
    /// counted; [`Reliability::THRESHOLD`] is a good one.
    pub fn remarks(&self, threshold: f64) -> Vec<String> {
        let agreement = self.agreement();
        let moved = (!agreement.holds()).then(|| {
            format!(
                "{}: the sums of its horizontal and of its vertical patterns differ by {:.1} %, and they are the same light: lamp or \
                 object changed in between; photograph the position again",
                self.name,
                100.0 * agreement.difference
            )
        });
        moved.into_iter().chain(self.reliability().remark(&self.name, threshold)).collect()
    }

    /// Largest difference of two values of one expectation.
    fn same(&self) -> f32 {
        (SAME * SQRT_2 * self.noise) as f32
    }
}

/// What two photographs have in common at a pixel.
fn common(h: f32, v: f32, same: f32) -> f32 {
    if (h - v).abs() <= same { 0.5 * (h + v) } else { h.min(v) }
}

/// The sum of pictures, in f64 for each pixel.
fn sum(photographs: &[Image]) -> Image {
    let (width, height) = photographs[0].size();
    let mut sum = Image::new(width, height, 3);
    let across = 3 * width.max(1);
    sum.data_mut().par_chunks_mut(across).enumerate().for_each_init(
        || vec![0.0f64; across],
        |line, (y, out)| {
            line.fill(0.0);
            for photograph in photographs {
                line.iter_mut().zip(photograph.row(y)).for_each(|(sum, v)| *sum += f64::from(*v));
            }
            out.iter_mut().zip(line).for_each(|(out, sum)| *out = *sum as f32);
        },
    );
    sum
}
