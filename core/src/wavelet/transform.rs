//! All levels of the non-standard transform in two dimensions (A.5), over many functions at once.

use super::Wavelet;
use super::extension::Edge;
use super::lifting::Side;
use super::line::{Axis, Filter, Room};
use super::tree::Tree;
use crate::error::{Error, Result};

/// How coefficients are scaled from level to level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Normalisation {
    /// Constant energy: `||A t|| = ||t||` for Haar, D4 and D8, and nearly so for the others. Gains of sqrt 2 a level and
    /// axis.
    Energy,
    /// Constant amplitude: the functions of all levels are equally high, and a constant keeps its value. Gains of one, so
    /// coefficients are 2^(-1/2) of the above for each level and axis. (A.4 prints the high-pass filters of the 5/3 and
    /// the 9/7 with a gain of 2, JPEG 2000's; ours follow the example of A.2, where it is one.)
    Amplitude,
}

/// The transform of functions on a grid: A, its inverse S, and the adjoints of both.
///
/// Functions lie row by row, column by column, lane by lane: value (x, y) of function n at `(y * width + x) * lanes + n`.
/// Coefficients take the same places as Mallat's pyramid, coarse at the top left; a coefficient's *location* is
/// `y * width + x`, and [`Transform::tree`] tells what lies there. 16 lanes are a cache line; that many, or multiples,
/// are fastest. Lanes never mix, and a lane's result does not depend on the others. NaN and infinities spread as far as
/// filters reach.
///
/// There are as many levels as both sides can be halved exactly, and at least one; a side of length one is left alone, so
/// that (n, 1) is the transform of a line.
///
/// ```
/// use relume_core::wavelet::{Edge, Normalisation, Transform, Wavelet};
///
/// // Thesis, A.2.
/// let haar = Transform::new(Wavelet::Haar, (4, 1), (Edge::Cyclic, Edge::Cyclic), Normalisation::Amplitude)?;
/// let mut line = [8.0, 2.0, 1.0, 5.0];
/// haar.forward(&mut line, 1);
/// assert_eq!(line, [4.0, 1.0, 3.0, -2.0]);
/// haar.inverse(&mut line, 1);
/// assert_eq!(line, [8.0, 2.0, 1.0, 5.0]);
/// # Ok::<(), relume_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Transform {
    wavelet: Wavelet,
    edges: (Edge, Edge),
    normalisation: Normalisation,
    filter: Filter,
    tree: Tree,
}

impl Transform {
    /// A transform of functions of a size, width and height. Edges are those of x and of y.
    ///
    /// # Errors
    /// Mirrored edges with a wavelet that is not symmetric; a size of zero, or of 2^32 values or more.
    pub fn new(
        wavelet: Wavelet,
        size: (usize, usize),
        edges: (Edge, Edge),
        normalisation: Normalisation,
    ) -> Result<Self> {
        if !wavelet.is_symmetric() && (edges.0 == Edge::Mirrored || edges.1 == Edge::Mirrored) {
            return Err(Error::Unsupported {
                place: "the wavelet transform".to_owned(),
                what: format!("mirroring at the edges with `{}`, which is not symmetric,", wavelet.id()),
                advice: "use cyclic edges, or haar, 5/3 or 9/7".to_owned(),
            });
        }
        Ok(Self { wavelet, edges, normalisation, filter: Filter::new(wavelet, normalisation), tree: Tree::new(size)? })
    }

    /// The wavelet.
    pub fn wavelet(&self) -> Wavelet {
        self.wavelet
    }

    /// Width and height.
    pub fn size(&self) -> (usize, usize) {
        self.tree.size()
    }

    /// How the functions go on beyond their edges, in x and in y.
    pub fn edges(&self) -> (Edge, Edge) {
        self.edges
    }

    /// How coefficients are scaled.
    pub fn normalisation(&self) -> Normalisation {
        self.normalisation
    }

    /// What lies where among the coefficients.
    pub fn tree(&self) -> Tree {
        self.tree.clone()
    }

    /// `c = A t`, in place.
    ///
    /// # Panics
    /// When `data` does not hold width x height x `lanes` numbers; so do the other three.
    pub fn forward(&self, data: &mut [f32], lanes: usize) {
        self.analyse(data, lanes, Side::Primal);
    }

    /// `t = S c`, in place.
    pub fn inverse(&self, data: &mut [f32], lanes: usize) {
        self.synthesise(data, lanes, Side::Primal);
    }

    /// `A^T c`, in place: `<A t, c> = <t, A^T c>`.
    pub fn forward_adjoint(&self, data: &mut [f32], lanes: usize) {
        self.synthesise(data, lanes, Side::Dual);
    }

    /// `S^T t`, in place: `<S c, t> = <c, S^T t>`.
    pub fn inverse_adjoint(&self, data: &mut [f32], lanes: usize) {
        self.analyse(data, lanes, Side::Dual);
    }

    /// The length of each basis function, `||s_j||_2` of column j of S, by location: one everywhere in the constant-energy
    /// normalisation of an orthonormal wavelet. A coefficient's share in the error when it is dropped is about
    /// `|c_j| ||s_j||`, and exactly so for orthogonal wavelets.
    pub fn synthesis_norms(&self) -> Vec<f32> {
        let (width, height) = self.size();
        // Basis functions are products of a function of x and one of y, both of the same level.
        let along_x = self.line_norms(width, self.edges.0, self.tree.scales().map(|scale| scale.0));
        let along_y = self.line_norms(height, self.edges.1, self.tree.scales().map(|scale| scale.1));
        let norm = |location: usize| {
            let level = self.tree.level(location as u32) as usize;
            (along_x[level][location % width] * along_y[level][location / width]) as f32
        };
        (0..width * height).map(norm).collect()
    }

    fn analyse(&self, data: &mut [f32], lanes: usize, side: Side) {
        let mut room = Room::default();
        for axis in self.axes(data, lanes).iter().rev() {
            self.filter.analyse(data, axis, side, &mut room);
        }
    }

    fn synthesise(&self, data: &mut [f32], lanes: usize, side: Side) {
        let mut room = Room::default();
        for axis in &self.axes(data, lanes) {
            self.filter.synthesise(data, axis, side, &mut room);
        }
    }

    /// Every level's axes, coarsest first.
    fn axes(&self, data: &[f32], lanes: usize) -> Vec<Axis> {
        let (width, height) = self.size();
        assert_eq!(data.len(), width * height * lanes, "{width} x {height} values of {lanes} functions");
        let row = width * lanes;
        let axes = |(columns, rows): (usize, usize)| {
            let y = Axis {
                length: rows,
                stride: row,
                width: columns * lanes,
                repeats: 1,
                repeat_stride: 0,
                edge: self.edges.1,
            };
            let x = Axis {
                length: columns,
                stride: lanes,
                width: lanes,
                repeats: rows,
                repeat_stride: row,
                edge: self.edges.0,
            };
            [y, x]
        };
        self.tree.scales().skip(1).flat_map(axes).collect()
    }

    /// Norms of the functions of one axis, level by level (coarsest first): scaling functions, then details.
    fn line_norms(&self, length: usize, edge: Edge, scales: impl Iterator<Item = usize>) -> Vec<Vec<f64>> {
        // As many functions at once.
        const LANES: usize = 64;
        let lines: Vec<Axis> = scales
            .skip(1)
            .map(|length| Axis { length, stride: LANES, width: LANES, repeats: 1, repeat_stride: 0, edge })
            .collect();
        let (mut room, mut functions) = (Room::default(), vec![0.0; length * LANES]);
        let mut block = |level: usize, first: usize, norms: &mut [f64]| {
            functions.fill(0.0);
            (0..norms.len()).for_each(|n| functions[(first + n) * LANES + n] = 1.0);
            lines[level..]
                .iter()
                .for_each(|line| self.filter.synthesise(&mut functions, line, Side::Primal, &mut room));
            for values in functions.chunks_exact(LANES) {
                norms.iter_mut().zip(values).for_each(|(sum, value)| *sum += f64::from(*value).powi(2));
            }
            norms.iter_mut().for_each(|norm| *norm = norm.sqrt());
        };
        let level = |level: usize| {
            let mut norms = vec![0.0; lines[level].length];
            norms.chunks_mut(LANES).enumerate().for_each(|(n, part)| block(level, n * LANES, part));
            norms
        };
        (0..lines.len()).map(level).collect()
    }
}
