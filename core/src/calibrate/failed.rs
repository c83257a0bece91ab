//! Lamps that failed: dark, dim, or hidden by the camera or an arm (Peers 2006, figures 2.11 and 2.14).
//!
//! Photographs change smoothly from lamp to lamp. Each lamp's photograph, as a coarse thumbnail, is predicted from its
//! neighbours' by a local plane in the tangent space of its direction, so that lamps at the rim, which have neighbours on one
//! side only, are extrapolated and not taken for dark. The figure is the median over the thumbnail's cells of
//! (seen - predicted) / max(predicted, the cell's mean over the lamps): highlights and cast shadows move in a few cells, a lamp that fails does so in all.
//! Outliers by the set's own spread (median absolute deviation) are reported, the worst first; a lamp that is found no longer
//! predicts its neighbours, so that one dark lamp does not make them seem too bright.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use crate::domain::Directions;
use crate::error::{Error, Result};
use crate::field::{Asset, BLOCK_HEIGHT, BLOCK_PIXELS, BLOCK_WIDTH, BlockBuffer, Samples};
use crate::math::{Vec3, angle_between};

/// Fewest lamps that can tell one of them from the rest.
const FEWEST: usize = 12;
/// Neighbours that predict a lamp: twice what a plane has unknowns, and two that may be wrong.
const NEIGHBOURS: usize = 8;
/// Cells of a thumbnail, about: fine enough that a shadow's edge is in few of them, coarse enough that noise is not seen.
const CELLS: usize = 256;
/// Deviations from which on a lamp has failed. Of intact sets of 40 to 120 lamps over the demonstration's still life the worst
/// lamp has 2.4; a dark one has 6 to 24.
const DEVIATIONS: f64 = 5.0;
/// Differences below this are not worth a word whatever the spread: a sixth of a stop and more is ordinary between lamps.
const LEAST: f64 = 0.15;
/// No more than this share of the lamps can be outliers.
const MOST: f64 = 0.25;

/// A lamp that differs from what its neighbours predict.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Failed {
    /// Its number, from 1.
    pub lamp: usize,
    /// Its direction.
    pub direction: [f64; 3],
    /// How far it is off, as a share of the prediction, or of the mean over the lamps where less was predicted: -1 is dark, -0.5
    /// half as bright, +1 twice as bright.
    pub off: f64,
    /// The same in robust deviations of the set.
    pub deviations: f64,
}

/// What a look at all lamps found.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct LampCheck {
    /// How many lamps were looked at.
    pub lamps: usize,
    /// How far an ordinary lamp is from its prediction: the robust deviation, as a share.
    pub spread: f64,
    /// Those that failed, the worst first.
    pub failed: Vec<Failed>,
}

/// Looks at every lamp of an asset; `progress(rows of blocks done, all)` may stop it. One pass over the field; memory: a
/// few hundred numbers a lamp.
///
/// # Errors
/// Fewer than 12 lamps in different directions; bytes that cannot be read; what `progress` returns.
pub fn check_lamps(asset: &Asset, progress: &mut dyn FnMut(u64, u64) -> Result<()>) -> Result<LampCheck> {
    let sites = asset.directions()?.sites().len();
    if sites < FEWEST {
        return Err(Error::Unsupported {
            place: asset.path().display().to_string(),
            what: format!("looking for failed lamps among {sites} directions"),
            advice: format!("it takes {FEWEST} to tell one from the rest; look at them with `relume relight --lamp N`"),
        });
    }
    Ok(outliers(asset.directions()?, &thumbnails(asset, progress)?))
}

/// Sums over the pixels and channels of square cells, `[lamp][cell]`.
fn thumbnails(asset: &Asset, progress: &mut dyn FnMut(u64, u64) -> Result<()>) -> Result<Vec<Vec<f32>>> {
    let samples = asset.samples()?;
    let layout = samples.layout();
    let side = (((layout.width * layout.height) as f64 / CELLS as f64).sqrt().ceil() as usize).max(1);
    let across = layout.width.div_ceil(side);
    let mut lamps = vec![vec![0.0f32; across * layout.height.div_ceil(side)]; layout.elements];
    for by in 0..layout.rows() {
        let blocks: Vec<BlockSums> = (0..layout.columns() * 3)
            .into_par_iter()
            .map_init(Default::default, |room, n| block_sums(samples, (n / 3, by, n % 3), (side, across), room))
            .collect::<Result<_>>()?;
        for BlockSums { cells, sums } in &blocks {
            for (lamp, sums) in lamps.iter_mut().zip(sums.chunks_exact(cells.len())) {
                cells.iter().zip(sums).for_each(|(cell, sum)| lamp[*cell] += sum);
            }
        }
        progress((by + 1) as u64, layout.rows() as u64)?;
    }
    Ok(lamps)
}

/// What a block adds to the cells that it touches.
struct BlockSums {
    cells: Vec<usize>,
    /// `[lamp][cell]`, cells as listed.
    sums: Vec<f32>,
}

fn block_sums(
    samples: Samples<'_>,
    (bx, by, c): (usize, usize, usize),
    (side, across): (usize, usize),
    (buffer, floats): &mut (BlockBuffer, Vec<f32>),
) -> Result<BlockSums> {
    let layout = samples.layout();
    samples.read(bx, by, c, buffer, floats)?;
    let mut cells: Vec<usize> = Vec::new();
    // For each pixel its place in the list; pixels past the edges of the picture have none.
    let place = |k: usize| {
        let (x, y) = (bx * BLOCK_WIDTH + k % BLOCK_WIDTH, by * BLOCK_HEIGHT + k / BLOCK_WIDTH);
        (x < layout.width && y < layout.height).then(|| {
            let cell = y / side * across + x / side;
            cells.iter().position(|c| *c == cell).unwrap_or_else(|| {
                cells.push(cell);
                cells.len() - 1
            })
        })
    };
    let places: Vec<Option<usize>> = (0..BLOCK_PIXELS).map(place).collect();
    let mut sums = vec![0.0; layout.elements * cells.len()];
    for (element, sums) in floats.chunks_exact(BLOCK_PIXELS).zip(sums.chunks_exact_mut(cells.len())) {
        places
            .iter()
            .zip(element)
            .filter_map(|(place, t)| Some(((*place)?, t)))
            .for_each(|(place, t)| sums[place] += t);
    }
    Ok(BlockSums { cells, sums })
}

/// The outliers among thumbnails `[lamp][cell]`.
fn outliers(domain: &Directions, thumbnails: &[Vec<f32>]) -> LampCheck {
    let lamps = domain.len();
    let cells = thumbnails.first().map_or(0, Vec::len);
    let means: Vec<f64> =
        (0..cells).map(|c| thumbnails.iter().map(|t| f64::from(t[c])).sum::<f64>() / lamps as f64).collect();
    let order: Vec<Vec<u32>> = domain.lamps().par_iter().map(|lamp| by_distance(domain.lamps(), lamp)).collect();
    let deviation = |lamp: usize, alive: &[bool]| {
        let neighbours: Vec<u32> = order[lamp]
            .iter()
            .copied()
            .filter(|j| *j as usize != lamp && alive[*j as usize])
            .take(NEIGHBOURS)
            .collect();
        let shares = plane(domain.lamps(), lamp, &neighbours);
        // Errors of the neighbours add up to this times an error of their own.
        let reach = (1.0 + shares.iter().map(|s| s * s).sum::<f64>()).sqrt();
        (difference(thumbnails, &means, lamp, &neighbours, &shares), reach)
    };
    let mut alive = vec![true; lamps];
    let mut spread = 0.0;
    for round in 0..=(MOST * lamps as f64) as usize {
        let found: Vec<(f64, f64)> = (0..lamps).into_par_iter().map(|lamp| deviation(lamp, &alive)).collect();
        let scaled = |lamp: &usize| found[*lamp].0 / found[*lamp].1;
        let mut sizes: Vec<f64> = (0..lamps).filter(|l| alive[*l]).map(|l| scaled(&l).abs()).collect();
        let middle = sizes.len() / 2;
        // 1.4826 times the median absolute deviation is the deviation of normal numbers.
        spread = (1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1).max(LEAST / DEVIATIONS / 4.0);
        let worst = (0..lamps).filter(|l| alive[*l]).max_by(|a, b| scaled(a).abs().total_cmp(&scaled(b).abs()));
        let fails = |l: usize| scaled(&l).abs() > DEVIATIONS * spread && found[l].0.abs() > LEAST;
        match worst.filter(|l| fails(*l)) {
            Some(lamp) if round < (MOST * lamps as f64) as usize => alive[lamp] = false,
            _ => break,
        }
    }
    // With all that failed out of the way, each is looked at once more.
    let mut failed: Vec<Failed> = (0..lamps)
        .filter(|lamp| !alive[*lamp])
        .map(|lamp| {
            let (off, reach) = deviation(lamp, &alive);
            Failed { lamp: lamp + 1, direction: domain.lamps()[lamp].into(), off, deviations: off / reach / spread }
        })
        .filter(|failed| failed.deviations.abs() > DEVIATIONS && failed.off.abs() > LEAST)
        .collect();
    failed.sort_by(|a, b| b.deviations.abs().total_cmp(&a.deviations.abs()));
    LampCheck { lamps, spread, failed }
}

/// Lamp numbers, the nearest first, as many as could be wanted.
fn by_distance(lamps: &[Vec3], from: &Vec3) -> Vec<u32> {
    let kept = (NEIGHBOURS + 1 + (MOST * lamps.len() as f64) as usize).min(lamps.len());
    let mut order: Vec<(f64, u32)> = lamps.iter().zip(0..).map(|(l, n)| (angle_between(l, from), n)).collect();
    let nearer = |a: &(f64, u32), b: &(f64, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    if kept < order.len() {
        order.select_nth_unstable_by(kept, nearer);
        order.truncate(kept);
    }
    order.sort_unstable_by(nearer);
    order.into_iter().map(|(_, n)| n).collect()
}

/// Shares of the neighbours in the value at a lamp of the plane fitted to them in its tangent space, nearer ones counting
/// more. They sum to one.
fn plane(lamps: &[Vec3], lamp: usize, neighbours: &[u32]) -> Vec<f64> {
    let at = &lamps[lamp];
    let side = if at.x.abs() < 0.8 { Vec3::x() } else { Vec3::y() };
    let u = at.cross(&side).normalize();
    let v = at.cross(&u);
    let mut rows: Vec<Vector3<f64>> = Vec::with_capacity(neighbours.len());
    let mut widest: f64 = 0.0;
    for j in neighbours {
        let other = &lamps[*j as usize];
        // The direction in which the other lamp lies, as long as the angle to it.
        let flat = other - at * at.dot(other);
        let angle = angle_between(at, other);
        let scale = if flat.norm() > 0.0 { angle / flat.norm() } else { 0.0 };
        rows.push(Vector3::new(1.0, flat.dot(&u) * scale, flat.dot(&v) * scale));
        widest = widest.max(angle);
    }
    let near = |row: &Vector3<f64>| (-(row.y * row.y + row.z * row.z) / (0.5 * widest * widest)).exp();
    let weights: Vec<f64> = rows.iter().map(near).collect();
    let mut normal: Matrix3<f64> = rows.iter().zip(&weights).map(|(row, w)| *w * row * row.transpose()).sum();
    // A ridge on the slopes: neighbours on one great circle say nothing across it.
    let ridge = 0.02 * widest * widest * normal[(0, 0)];
    normal[(1, 1)] += ridge;
    normal[(2, 2)] += ridge;
    let Some(inverse) = normal.try_inverse() else { return vec![1.0 / rows.len() as f64; rows.len()] };
    let shares: Vec<f64> = rows.iter().zip(&weights).map(|(row, w)| (inverse * row).x * w).collect();
    let sum: f64 = shares.iter().sum();
    shares.iter().map(|share| share / sum).collect()
}

/// The median over the cells of the relative difference from what was predicted, each cell counted by what it should show.
fn difference(thumbnails: &[Vec<f32>], means: &[f64], lamp: usize, neighbours: &[u32], shares: &[f64]) -> f64 {
    let mut cells: Vec<(f64, f64)> = means
        .iter()
        .enumerate()
        .filter(|(_, mean)| **mean > 0.0)
        .map(|(c, mean)| {
            let predicted: f64 =
                neighbours.iter().zip(shares).map(|(j, s)| s * f64::from(thumbnails[*j as usize][c])).sum();
            // Where little is expected a small difference is a large ratio: at grazing angles whole surfaces go dark from one
            // lamp to the next. So a cell is held against its mean over the lamps at least.
            let against = predicted.max(*mean);
            ((f64::from(thumbnails[lamp][c]) - predicted) / against, against)
        })
        .collect();
    cells.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * cells.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut so_far = 0.0;
    let at_half = |(value, weight): &(f64, f64)| {
        so_far += weight;
        (so_far >= half).then_some(*value)
    };
    cells.iter().find_map(at_half).unwrap_or(0.0)
}
