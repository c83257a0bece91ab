//! Photometric stereo for one pixel, with shadows and highlights rejected.
//!
//! Woodham 1980: under lamps `l_j` a Lambert surface of normal `n` and albedo `a` answers `T_j = a / pi max(0, n . l_j)`, so
//! that `m = a n / pi` is the least-squares solution of `l_j . m = T_j` over the lamps that light it. Real answers also hold
//! cast shadows (too low), highlights and light from neighbours (too high). They are rejected by a redescending M-estimator
//! (Tukey's biweight, solved by reweighting), which needs a start that is not ruled by them:
//!
//! - few lamps: the solution of every three lamps is tried;
//! - many lamps: the solutions of several bands of the sorted answers. The darkest lamps are in shadow, the brightest show
//!   highlights; any part of the rest determines a Lambert surface (cf. Wenger et al. 2005).
//!
//! Each start is refined on a sample of the lamps, and the one with the lowest biweight cost, attached shadows included, is
//! refined on all of them.

use nalgebra::{Matrix3, Vector3};

/// Lanes of the sums: two AVX or one AVX-512 register. Fixed, so that results are the same on every machine.
const LANES: usize = 8;
/// Up to this many lamps every triple is a start (84 of them).
const EVERY_TRIPLE: usize = 9;
/// Bands of the sorted answers that are starts, as shares of the lamps. Between them they survive half of the lamps in shadow
/// with a quarter in highlights, and three quarters in shadow with none.
const BANDS: [(f64, f64); 6] = [(0.5, 0.9), (0.35, 0.75), (0.65, 0.85), (0.25, 0.95), (0.75, 0.95), (0.85, 1.0)];
/// Where the biweight reaches zero in the search, as a share of the pixel's level: materials that people call diffuse leave
/// Lambert's law by about 10 %, and a lamp beyond twice that tells nothing of the normal.
const SEARCH_CUT: f32 = 0.25;
/// Highlights and light from neighbours only ever add: an answer that is too high is given up at this share of the cut. The skirt of a
/// highlight pulls the normal towards it long before it stands out.
const ABOVE: f32 = 0.4;
/// Lamps count in full from this cosine on, and in proportion to it below: towards grazing light materials depart from Lambert's law
/// (a coat reflects more and lets less in), and neighbours shadow.
const GRAZING: f32 = 0.6;
/// A pixel's level is this quantile of its answers: 0.8 of the brightest that Lambert's law has under an even hemisphere of lamps,
/// whatever a fifth of them show as highlights. Where fewer than a fifth light the pixel, it is the second quantile; then the first holds
/// only light from neighbours, below this share of the second. Highlights that are 20 times as bright as the rest are as rare.
const LEVEL: (f64, f64) = (0.8, 0.95);
const FEW_LIT: f32 = 0.05;
/// Reweightings of each start, and of the best one.
const SEARCH_STEPS: usize = 4;
const FINAL_STEPS: usize = 10;
/// Final cut in deviations: Tukey's constant for 95 % efficiency under normal noise.
const TUKEY: f32 = 4.685;
/// Deviation of a normal distribution over its median absolute deviation.
const MAD_TO_SIGMA: f32 = 1.4826;
/// Least and largest final cut, as shares of the level: below 2 % is the rounding of 8-bit photographs.
const FINAL_CUT: (f32, f32) = (0.02, SEARCH_CUT);
/// Least `det(A) / (tr(A) / 3)^3` of the normal equations: lamps within a cone of half-angle 5 degrees reach it, where an error of 1 %
/// in the answers already turns the normal by 13 degrees.
const LEAST_CONDITION: f64 = 1e-4;
/// A lamp counts as an inlier from this weight on: within 0.7 of the cut.
const INLIER_WEIGHT: f32 = 0.25;
/// Of the lamps that the normal says light the surface, this share must agree.
const LEAST_SUPPORT: f32 = 0.3;
/// A lamp that answers with less than this share of what it should was in shadow, which is no contradiction.
const DARK: f32 = 0.1;
/// Visible surfaces face the camera; the most oblique ray of a wide lens (40 degrees off the axis) can still see a normal that leans this far
/// away: -sin 40.
const LEAST_FACING: f64 = -0.64;

/// The lamps as the estimator wants them: component by component, padded to whole lanes with lamps of no weight.
#[derive(Debug)]
pub(super) struct Lamps {
    count: usize,
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    /// Share of the covered solid angle; sums to one.
    share: Vec<f32>,
}

impl Lamps {
    /// Unit directions, and the share of the covered solid angle that each stands for.
    pub fn new(directions: impl ExactSizeIterator<Item = Vector3<f32>>, shares: &[f32]) -> Self {
        let count = directions.len();
        let padded = count.next_multiple_of(LANES);
        let mut lamps =
            Self { count, x: vec![0.0; padded], y: vec![0.0; padded], z: vec![0.0; padded], share: vec![0.0; padded] };
        let total: f32 = shares.iter().sum();
        for (j, (d, share)) in directions.zip(shares).enumerate() {
            (lamps.x[j], lamps.y[j], lamps.z[j], lamps.share[j]) = (d.x, d.y, d.z, share / total);
        }
        lamps
    }

    /// Lamps, without the padding.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Numbers in an array of answers: lamps and padding.
    pub fn padded(&self) -> usize {
        self.x.len()
    }

    /// Some of the lamps, in the given order.
    pub fn chosen(&self, which: &[u32]) -> Self {
        let at = |j: &u32| Vector3::new(self.x[*j as usize], self.y[*j as usize], self.z[*j as usize]);
        let shares: Vec<f32> = which.iter().map(|j| self.share[*j as usize]).collect();
        Self::new(which.iter().map(at), &shares)
    }

    fn cosine(&self, j: usize, n: &Vector3<f32>) -> f32 {
        self.x[j] * n.x + self.y[j] * n.y + self.z[j] * n.z
    }
}

/// A set of lamps and the sample of it that the search uses.
#[derive(Debug)]
pub(super) struct Estimator {
    all: Lamps,
    sample: Lamps,
    /// Lamp numbers of the sample.
    chosen: Vec<u32>,
}

/// What a pixel's answers say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Facet {
    /// Unit normal.
    pub normal: [f32; 3],
    /// Diffuse albedo, RGB.
    pub albedo: [f32; 3],
}

/// Room for one pixel's numbers.
#[derive(Debug, Default)]
pub(super) struct Room {
    grey: Vec<f32>,
    sampled: Vec<f32>,
    order: Vec<u32>,
    residuals: Vec<f32>,
}

/// The normal equations `A m = b` of a weighted fit.
#[derive(Debug, Clone, Copy)]
struct Normal {
    a: Matrix3<f64>,
    b: Vector3<f64>,
}

impl Normal {
    fn solve(&self) -> Option<Vector3<f32>> {
        let third = self.a.trace() / 3.0;
        let conditioned = third > 0.0 && self.a.determinant() > LEAST_CONDITION * third.powi(3);
        conditioned.then(|| self.a.cholesky()).flatten().map(|factor| factor.solve(&self.b).cast())
    }
}

impl Estimator {
    /// `sample` holds the numbers of the lamps that the search looks at.
    pub fn new(all: Lamps, sample: Vec<u32>) -> Self {
        Self { sample: all.chosen(&sample), all, chosen: sample }
    }

    /// Numbers of each channel that [`Estimator::facet`] wants.
    pub fn padded(&self) -> usize {
        self.all.padded()
    }

    /// Normal and albedo from a pixel's answers, channel by channel, padded with zeros; `None` where they do not determine
    /// them: dark, too few lamps in agreement, or no surface that could be seen.
    pub fn facet(&self, rgb: [&[f32]; 3], room: &mut Room) -> Option<Facet> {
        let Room { grey, sampled, order, residuals } = room;
        self.project(rgb, grey);
        sampled.clear();
        sampled.extend(self.chosen.iter().map(|&j| grey[j as usize]));
        sampled.resize(self.sample.padded(), 0.0);
        let level = level(&sampled[..self.sample.len()], residuals)?;
        let start = self.search(sampled, level, order)?;
        let (m, cut) = self.polish(grey, start, level, residuals)?;
        self.judge(grey, &m, cut)?;
        let normal = m.normalize();
        (f64::from(normal.z) > LEAST_FACING)
            .then(|| Facet { normal: normal.into(), albedo: self.albedo(rgb, grey, &m, cut) })
    }

    /// Projects the three channels onto the pixel's mean colour: the best single number under equal noise.
    fn project(&self, rgb: [&[f32]; 3], grey: &mut Vec<f32>) {
        let mean = |t: &[f32]| self.all.share.iter().zip(t).map(|(s, t)| s * t.max(0.0)).sum::<f32>();
        let colour = Vector3::from(rgb.map(mean));
        let u = colour.try_normalize(f32::MIN_POSITIVE).unwrap_or_else(Vector3::zeros);
        grey.clear();
        grey.extend((0..self.all.padded()).map(|j| u.x * rgb[0][j] + u.y * rgb[1][j] + u.z * rgb[2][j]));
    }

    /// The best of the starts, each refined a little.
    fn search(&self, t: &[f32], level: f32, order: &mut Vec<u32>) -> Option<Vector3<f32>> {
        let lamps = &self.sample;
        let cut = SEARCH_CUT * level;
        let mut best: Option<(f32, Vector3<f32>)> = None;
        let mut consider = |normal: Normal| {
            let Some(mut m) = normal.solve() else { return };
            for _ in 0..SEARCH_STEPS {
                let Some(better) = reweighted(lamps, t, &m, cut).solve() else { return };
                m = better;
            }
            let cost = cost(lamps, t, &m, cut);
            if best.is_none_or(|(lowest, _)| cost < lowest) {
                best = Some((cost, m));
            }
        };
        let n = lamps.len();
        if n <= EVERY_TRIPLE {
            for (i, j, k) in (0..n).flat_map(|i| (i + 1..n).flat_map(move |j| (j + 1..n).map(move |k| (i, j, k)))) {
                consider(plain(lamps, t, [i, j, k].into_iter()));
            }
            return best.map(|(_, m)| m);
        }
        order.clear();
        order.extend(0..n as u32);
        order.sort_unstable_by(|a, b| t[*a as usize].total_cmp(&t[*b as usize]));
        for (low, high) in BANDS {
            let (from, to) = ((low * n as f64) as usize, (high * n as f64).ceil() as usize);
            consider(plain(lamps, t, order[from..to].iter().map(|j| *j as usize)));
        }
        best.map(|(_, m)| m)
    }

    /// Reweights on all lamps, with the cut following the deviation of those that should be lit.
    fn polish(
        &self,
        t: &[f32],
        start: Vector3<f32>,
        level: f32,
        residuals: &mut Vec<f32>,
    ) -> Option<(Vector3<f32>, f32)> {
        let (mut m, mut cut) = (start, SEARCH_CUT * level);
        for _ in 0..FINAL_STEPS {
            residuals.clear();
            residuals.extend((0..self.all.len()).filter_map(|j| {
                let p = self.all.cosine(j, &m);
                // What the search already gave up says nothing of the noise.
                let r = (t[j] - p).abs();
                (p > 0.0 && r < SEARCH_CUT * level).then_some(r)
            }));
            if residuals.len() < 3 {
                return None;
            }
            let middle = residuals.len() / 2;
            let mad = *residuals.select_nth_unstable_by(middle, f32::total_cmp).1;
            cut = (TUKEY * MAD_TO_SIGMA * mad).clamp(FINAL_CUT.0 * level, FINAL_CUT.1 * level);
            let before = m;
            m = reweighted(&self.all, t, &m, cut).solve()?;
            if (m - before).norm() < 1e-4 * m.norm() {
                break;
            }
        }
        Some((m, cut))
    }

    /// Do enough of the lamps agree? Three determine the normal, a fourth confirms it; three alone count where all others were
    /// dark, as in shadow.
    fn judge(&self, t: &[f32], m: &Vector3<f32>, cut: f32) -> Option<()> {
        let (mut lit, mut agree, mut inliers, mut contradictions) = (0.0f32, 0.0f32, 0, 0);
        for (j, t) in t.iter().enumerate().take(self.all.len()) {
            let p = self.all.cosine(j, m);
            if p <= 0.0 {
                continue;
            }
            let weight = biweight(t - p, cut);
            lit += self.all.share[j];
            agree += weight * self.all.share[j];
            inliers += usize::from(weight > INLIER_WEIGHT);
            contradictions += usize::from(weight <= INLIER_WEIGHT && *t > DARK * p);
        }
        let enough = inliers >= 4 || (inliers == 3 && contradictions == 0);
        (enough && agree >= LEAST_SUPPORT * lit).then_some(())
    }

    /// `pi` times the slope of each channel against the cosine, over the lamps in agreement.
    fn albedo(&self, rgb: [&[f32]; 3], grey: &[f32], m: &Vector3<f32>, cut: f32) -> [f32; 3] {
        let length = m.norm();
        let (mut above, mut below) = ([0.0f32; 3], 0.0f32);
        for j in 0..self.all.len() {
            let p = self.all.cosine(j, m);
            if p <= 0.0 {
                continue;
            }
            let (weight, cosine) = (self.all.share[j] * biweight(grey[j] - p, cut), p / length);
            below += weight * cosine * cosine;
            above.iter_mut().zip(rgb).for_each(|(sum, t)| *sum += weight * cosine * t[j]);
        }
        above.map(|sum| (std::f32::consts::PI * sum / below).max(0.0))
    }
}

/// A residual in cuts: 1 where the answer is given up.
#[inline(always)]
fn in_cuts(residual: f32, cut: f32) -> f32 {
    if residual > 0.0 { residual / (ABOVE * cut) } else { residual / cut }
}

/// The scale of a pixel's answers; `None` for darkness.
fn level(t: &[f32], room: &mut Vec<f32>) -> Option<f32> {
    room.clear();
    room.extend_from_slice(t);
    let mut quantile = |share: f64| {
        let at = ((t.len() - 1) as f64 * share) as usize;
        *room.select_nth_unstable_by(at, f32::total_cmp).1
    };
    let (usual, few) = (quantile(LEVEL.0), quantile(LEVEL.1));
    let level = if usual > FEW_LIT * few { usual } else { few };
    (level > 0.0 && level.is_finite()).then_some(level)
}

/// Tukey's biweight `(1 - u^2)^2`, zero beyond the cut.
#[inline(always)]
fn biweight(residual: f32, cut: f32) -> f32 {
    let u = in_cuts(residual, cut);
    let v = (1.0 - u * u).max(0.0);
    v * v
}

/// Least squares over some lamps, without weights.
fn plain(lamps: &Lamps, t: &[f32], which: impl Iterator<Item = usize>) -> Normal {
    let mut normal = Normal { a: Matrix3::zeros(), b: Vector3::zeros() };
    for j in which {
        let l = Vector3::new(lamps.x[j], lamps.y[j], lamps.z[j]).cast::<f64>();
        let weight = f64::from(lamps.share[j]);
        normal.a += weight * l * l.transpose();
        normal.b += weight * f64::from(t[j]) * l;
    }
    normal
}

/// One step of reweighting: the lamps that light a surface `m`, each by its share and the biweight of its residual.
fn reweighted(lamps: &Lamps, t: &[f32], m: &Vector3<f32>, cut: f32) -> Normal {
    let mut sums = [[0.0f32; LANES]; 9];
    let full = 1.0 / (GRAZING * m.norm());
    for at in (0..lamps.padded()).step_by(LANES) {
        let lanes = |v: &[f32]| -> [f32; LANES] { std::array::from_fn(|k| v[at + k]) };
        let (x, y, z, share, t) = (lanes(&lamps.x), lanes(&lamps.y), lanes(&lamps.z), lanes(&lamps.share), lanes(t));
        for k in 0..LANES {
            let p = x[k] * m.x + y[k] * m.y + z[k] * m.z;
            let w = if p > 0.0 { share[k] * (p * full).min(1.0) * biweight(t[k] - p, cut) } else { 0.0 };
            let (wx, wy, wz) = (w * x[k], w * y[k], w * z[k]);
            let terms =
                [wx * x[k], wx * y[k], wx * z[k], wy * y[k], wy * z[k], wz * z[k], wx * t[k], wy * t[k], wz * t[k]];
            for (sum, term) in sums.iter_mut().zip(terms) {
                sum[k] += term;
            }
        }
    }
    let [xx, xy, xz, yy, yz, zz, bx, by, bz] = sums.map(|lane| lane.iter().map(|v| f64::from(*v)).sum::<f64>());
    Normal { a: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz), b: Vector3::new(bx, by, bz) }
}

/// The biweight's cost over all lamps, those that should be dark included; 0 to 1.
fn cost(lamps: &Lamps, t: &[f32], m: &Vector3<f32>, cut: f32) -> f32 {
    let rho = |j: usize| {
        let u = in_cuts(t[j] - lamps.cosine(j, m).max(0.0), cut);
        1.0 - (1.0 - u * u).max(0.0).powi(3)
    };
    (0..lamps.len()).map(|j| lamps.share[j] * rho(j)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ring of lamps 40 degrees off the axis, and one on it.
    fn estimator(count: usize) -> Estimator {
        let (s, c) = 40f32.to_radians().sin_cos();
        let lamp = |i: usize| match i {
            0 => Vector3::z(),
            i => {
                let turn = std::f32::consts::TAU * i as f32 / (count - 1) as f32;
                Vector3::new(s * turn.cos(), s * turn.sin(), c)
            }
        };
        let lamps = Lamps::new((0..count).map(lamp), &vec![1.0; count]);
        Estimator::new(lamps, (0..count as u32).collect())
    }

    /// What a Lambert surface answers.
    fn answers(estimator: &Estimator, normal: &Vector3<f32>, albedo: [f32; 3]) -> [Vec<f32>; 3] {
        let lambert = |a: f32| {
            (0..estimator.padded())
                .map(|j| a / std::f32::consts::PI * estimator.all.cosine(j, normal).max(0.0))
                .collect()
        };
        albedo.map(lambert)
    }

    fn facet(estimator: &Estimator, answers: &[Vec<f32>; 3]) -> Option<Facet> {
        estimator.facet(std::array::from_fn(|c| &answers[c][..]), &mut Room::default())
    }

    fn error_deg(facet: &Facet, normal: &Vector3<f32>) -> f32 {
        Vector3::from(facet.normal).angle(normal).to_degrees()
    }

    #[test]
    fn lambert_is_met_exactly_from_four_lamps_up() {
        let albedo = [0.6, 0.3, 0.9];
        for count in [4, 5, 9, 12, 40, 203] {
            let estimator = estimator(count);
            for normal in [Vector3::z(), Vector3::new(0.2, -0.3, 0.9).normalize()] {
                let found = facet(&estimator, &answers(&estimator, &normal, albedo)).unwrap();
                assert!(error_deg(&found, &normal) < 0.05, "{count} lamps: {found:?}");
                assert!(found.albedo.iter().zip(albedo).all(|(a, b)| (a - b).abs() < 1e-3), "{count} lamps: {found:?}");
            }
        }
    }

    #[test]
    fn shadows_and_highlights_change_nothing() {
        let normal = Vector3::new(0.2, -0.3, 0.9).normalize();
        for (count, dark, bright) in [(6, 1, 0), (9, 1, 1), (24, 8, 3), (100, 45, 10)] {
            // Scattered over the ring: 7 shares no factor with any of its lengths.
            let estimator = estimator(count);
            let mut t = answers(&estimator, &normal, [0.5; 3]);
            for channel in &mut t {
                let place = |k: usize| 1 + k * 7 % (count - 1);
                (0..dark).for_each(|k| channel[place(k)] = 0.0);
                (dark..dark + bright).for_each(|k| channel[place(k)] += 2.0);
            }
            let found = facet(&estimator, &t).unwrap();
            assert!(error_deg(&found, &normal) < 0.5, "{count} lamps: {} degrees", error_deg(&found, &normal));
            assert!((found.albedo[1] - 0.5).abs() < 0.01, "{count} lamps: {found:?}");
        }
    }

    #[test]
    fn what_determines_no_surface_has_none() {
        let estimator = estimator(12);
        let dark = [vec![0.0; 16], vec![0.0; 16], vec![0.0; 16]];
        assert_eq!(facet(&estimator, &dark), None);
        // A mirror: one lamp alone.
        let mut mirror = dark.clone();
        mirror.iter_mut().for_each(|channel| channel[3] = 9.0);
        assert_eq!(facet(&estimator, &mirror), None);
        // Two lit lamps.
        mirror.iter_mut().for_each(|channel| channel[7] = 9.0);
        assert_eq!(facet(&estimator, &mirror), None);
        let negative = dark.map(|channel| channel.iter().map(|_| -0.1).collect());
        assert_eq!(facet(&estimator, &negative), None);
    }
}
