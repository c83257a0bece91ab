//! The outline of a ball in a photograph: edge points, circles through pairs of them (RANSAC, Fischler and Bolles
//! 1981), and a least-squares circle through the outline measured along radii to parts of a pixel.
//!
//! A mirror ball is full of edges, and so may be what stands behind it. What makes an outline of a circle is that
//! strong gradients stand on it all the way round and point along its radius; that share of the way round is the score.

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::error::{Error, Result};
use crate::illumination::probe::Circle;
use crate::image::Image;

/// Edges are sought in a picture reduced to at most this many pixels a side: enough to find a circle, little to search.
const SEARCH_SIDE: usize = 400;
/// Balls narrower than this share of the picture's shorter side are not sought: noise makes many of those.
const SMALLEST: f64 = 0.04;
/// Circles tried. With a twentieth of the edge points on the outline, both of two are by 1 / 400: 6000 tries miss all
/// of them with a chance of 3e-7.
const TRIES: usize = 6000;
/// Directions round the circle that are looked at.
const BINS: usize = 72;
/// Share of them where an edge must stand for a circle to be an outline: a ball half hidden by its stand or lost in
/// shadow passes.
const SUPPORT: f64 = 0.55;
/// An edge belongs to a circle when its gradient is within about 25 degrees of the radius.
const ALONG: f64 = 0.9;
/// Rays for the measurement of the outline.
const RAYS: usize = 360;

/// Finds `count` balls, the best outline first.
///
/// # Errors
/// When fewer outlines stand out, with what to do.
pub fn find_balls(image: &Image, place: &str, count: usize) -> Result<Vec<Circle>> {
    let mut edges = Edges::of(image);
    let mut balls: Vec<Circle> = Vec::new();
    while balls.len() < count {
        let Some(circle) = edges.best_circle(balls.len() as u64) else {
            let found = match balls.len() {
                0 => "no outline of a ball that stands out".to_owned(),
                1 => "the outline of one ball only".to_owned(),
                n => format!("the outlines of {n} balls only"),
            };
            let expected = format!("{count} against a plain background; or give each as X,Y,R in pixels");
            return Err(Error::invalid(place, found, expected));
        };
        edges.remove(&circle);
        let circle = Circle { x: circle.x * edges.step, y: circle.y * edges.step, radius: circle.radius * edges.step };
        let refined = refine(image, circle);
        refined.check_inside(place, image.width(), image.height())?;
        balls.push(refined);
    }
    Ok(balls)
}

/// Finds the one ball of a picture.
///
/// # Errors
/// As [`find_balls`].
pub fn find_ball(image: &Image, place: &str) -> Result<Circle> {
    Ok(find_balls(image, place, 1)?[0])
}

/// Brightness as the eye would grade it, so that neither a sun nor a night decides alone what an edge is: the logarithm
/// over a floor at a hundredth of the mean.
fn grades(image: &Image) -> Vec<f32> {
    let luminance = |p: &[f32]| (0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2]).max(0.0);
    let values: Vec<f32> = image.data().chunks_exact(image.channels()).map(luminance).collect();
    // The mean of square roots is moved less by a few very bright pixels.
    let root = values.iter().map(|v| f64::from(v.sqrt())).sum::<f64>() / values.len().max(1) as f64;
    let floor = (0.1 * root * root).max(1e-12) as f32;
    values.iter().map(|v| (v / floor).ln_1p()).collect()
}

/// A point of strong gradient: place and unit gradient.
#[derive(Debug, Clone, Copy)]
struct Edge {
    x: f64,
    y: f64,
    gx: f64,
    gy: f64,
}

/// Edge points of a reduced picture.
struct Edges {
    points: Vec<Edge>,
    width: usize,
    height: usize,
    /// Which point stands at a pixel, if one does: its index plus one.
    map: Vec<u32>,
    /// Pixels of the picture a pixel of the reduced one.
    step: f64,
}

impl Edges {
    fn of(image: &Image) -> Self {
        let (w, h) = image.size();
        let step = w.max(h).div_ceil(SEARCH_SIDE).max(1);
        let (width, height) = (w / step, h / step);
        let fine = grades(image);
        let mean = |x: usize, y: usize| {
            let rows = (0..step).map(|j| fine[(y * step + j) * w + x * step..][..step].iter().sum::<f32>());
            f64::from(rows.sum::<f32>()) / (step * step) as f64
        };
        let coarse: Vec<f64> = (0..width * height).map(|k| mean(k % width, k / width)).collect();
        let mut edges = Self { points: Vec::new(), width, height, map: vec![0; width * height], step: step as f64 };
        edges.points = edge_points(&smoothed(&coarse, width, height), width, height);
        for (n, edge) in edges.points.iter().enumerate() {
            edges.map[edge.y as usize * width + edge.x as usize] = n as u32 + 1;
        }
        edges
    }

    /// The circle with edges all the way round, in reduced pixels.
    fn best_circle(&self, seed: u64) -> Option<Circle> {
        if self.points.len() < 12 {
            return None;
        }
        let mut rng = Pcg32::seed_from_u64(0x6261_6c6c ^ seed);
        let mut best: Option<(f64, Circle)> = None;
        for _ in 0..TRIES {
            let Some(circle) = self.draw(&mut rng) else { continue };
            let score = self.support(&circle);
            if best.is_none_or(|(highest, _)| score > highest) {
                best = Some((score, circle));
            }
        }
        best.filter(|(score, _)| *score >= SUPPORT).map(|(_, circle)| circle)
    }

    /// A circle through two points and along the gradient of the first, checked by the second's gradient. Two points
    /// are drawn right more often than three.
    fn draw(&self, rng: &mut Pcg32) -> Option<Circle> {
        let n = self.points.len();
        let (a, b) = (self.points[rng.random_range(0..n)], self.points[rng.random_range(0..n)]);
        // |a + t g - b| = |t|: t = |b - a|^2 / (2 g . (b - a)).
        let (dx, dy) = (b.x - a.x, b.y - a.y);
        let toward = a.gx * dx + a.gy * dy;
        let chord2 = dx * dx + dy * dy;
        if toward.abs() < 1e-6 || chord2 < 9.0 {
            return None;
        }
        let t = chord2 / (2.0 * toward);
        let circle = Circle { x: a.x + t * a.gx, y: a.y + t * a.gy, radius: t.abs() };
        let radial = (b.gx * (b.x - circle.x) + b.gy * (b.y - circle.y)).abs() / circle.radius;
        (radial > ALONG && self.plausible(&circle)).then_some(circle)
    }

    fn plausible(&self, c: &Circle) -> bool {
        let (w, h) = (self.width as f64, self.height as f64);
        let inside =
            c.x - c.radius > -1.0 && c.y - c.radius > -1.0 && c.x + c.radius < w + 1.0 && c.y + c.radius < h + 1.0;
        inside && c.radius >= SMALLEST * w.min(h) && c.radius >= 4.0
    }

    /// Share of the way round on which an edge stands within a pixel, pointing along the radius. The circle's own size
    /// adds a little: of two rings round a ball the outer one is the outline.
    fn support(&self, c: &Circle) -> f64 {
        let mut hits = 0.0;
        for k in 0..BINS {
            let (sin, cos) = (TAU * k as f64 / BINS as f64).sin_cos();
            let near = [0.0, -1.0, 1.0].into_iter().find(|off| {
                let (x, y) = (c.x + (c.radius + off) * cos, c.y + (c.radius + off) * sin);
                self.at(x, y).is_some_and(|e| (e.gx * cos + e.gy * sin).abs() > ALONG)
            });
            hits += match near {
                Some(0.0) => 1.0,
                Some(_) => 0.8,
                None => 0.0,
            };
        }
        hits / BINS as f64 + 0.1 * c.radius / self.width.min(self.height) as f64
    }

    fn at(&self, x: f64, y: f64) -> Option<&Edge> {
        if !(x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64) {
            return None;
        }
        let n = self.map[y as usize * self.width + x as usize];
        (n > 0).then(|| &self.points[n as usize - 1])
    }

    /// Forgets a ball: its outline and all within.
    fn remove(&mut self, c: &Circle) {
        let gone = |e: &Edge| (e.x - c.x).hypot(e.y - c.y) < c.radius + 3.0;
        self.points.retain(|e| !gone(e));
        self.map.fill(0);
        for (n, edge) in self.points.iter().enumerate() {
            self.map[edge.y as usize * self.width + edge.x as usize] = n as u32 + 1;
        }
    }
}

/// Binomial smoothing, 1 2 1 in both directions: the least that makes gradients of a pixel grid point well.
fn smoothed(values: &[f64], w: usize, h: usize) -> Vec<f64> {
    let at = |x: usize, y: usize| values[y * w + x];
    let mut out = vec![0.0; w * h];
    for y in 0..h {
        for x in 0..w {
            let (l, r, t, b) = (x.saturating_sub(1), (x + 1).min(w - 1), y.saturating_sub(1), (y + 1).min(h - 1));
            let row = |y: usize| at(l, y) + 2.0 * at(x, y) + at(r, y);
            out[y * w + x] = (row(t) + 2.0 * row(y) + row(b)) / 16.0;
        }
    }
    out
}

/// Maxima of the gradient's size along the gradient that are above its typical size. Pixel centres lie at +0.5.
fn edge_points(values: &[f64], w: usize, h: usize) -> Vec<Edge> {
    if w < 3 || h < 3 {
        return Vec::new();
    }
    let mut gradients = vec![(0.0, 0.0, 0.0); w * h];
    for y in 1..h - 1 {
        for x in 1..w - 1 {
            let at = |dx: usize, dy: usize| values[(y + dy - 1) * w + x + dx - 1];
            let gx = (at(2, 0) + 2.0 * at(2, 1) + at(2, 2) - at(0, 0) - 2.0 * at(0, 1) - at(0, 2)) / 8.0;
            let gy = (at(0, 2) + 2.0 * at(1, 2) + at(2, 2) - at(0, 0) - 2.0 * at(1, 0) - at(2, 0)) / 8.0;
            gradients[y * w + x] = (gx.hypot(gy), gx, gy);
        }
    }
    let mut sizes: Vec<f64> = gradients.iter().map(|g| g.0).collect();
    // Three quarters of a picture with a ball are no edge; twice that gradient, or 2 % of a doubling of light, is one.
    let quarter = sizes.len() * 3 / 4;
    let threshold = (2.0 * *sizes.select_nth_unstable_by(quarter, f64::total_cmp).1).max(0.014);
    let mut points = Vec::new();
    for y in 1..h - 1 {
        for x in 1..w - 1 {
            let (size, gx, gy) = gradients[y * w + x];
            if size < threshold {
                continue;
            }
            let (ux, uy) = (gx / size, gy / size);
            let beside = |side: f64| {
                let (nx, ny) = ((x as f64 + side * ux).round() as usize, (y as f64 + side * uy).round() as usize);
                gradients[ny * w + nx].0
            };
            if size >= beside(1.0) && size > beside(-1.0) {
                points.push(Edge { x: x as f64 + 0.5, y: y as f64 + 0.5, gx: ux, gy: uy });
            }
        }
    }
    points
}

/// Measures the outline along rays of the full picture and fits a circle, three times, each time nearer.
fn refine(image: &Image, start: Circle) -> Circle {
    let (w, h) = image.size();
    let values = grades(image);
    let sample = |x: f64, y: f64| {
        let (x, y) = ((x - 0.5).clamp(0.0, w as f64 - 1.001), (y - 0.5).clamp(0.0, h as f64 - 1.001));
        let (i, j) = (x as usize, y as usize);
        let (a, b) = (x - i as f64, y - j as f64);
        let at = |i: usize, j: usize| f64::from(values[j.min(h - 1) * w + i.min(w - 1)]);
        (1.0 - b) * ((1.0 - a) * at(i, j) + a * at(i + 1, j)) + b * ((1.0 - a) * at(i, j + 1) + a * at(i + 1, j + 1))
    };
    let step = w.max(h).div_ceil(SEARCH_SIDE).max(1) as f64;
    let mut circle = start;
    for reach in [2.5 * step + 1.0, 1.5 * step + 1.0, 2.5] {
        let points: Vec<[f64; 2]> = (0..RAYS).filter_map(|k| outline_point(&sample, &circle, k, reach)).collect();
        let Some(next) = fit_circle(&points, circle) else { break };
        circle = next;
    }
    circle
}

/// Edges at least this share of the steepest on a ray may be the outline: the outermost of them is. What a mirror ball
/// reflects crowds into rings inside its rim, which pull the circle inwards together; what stands behind it is no ring.
const OUTLINE: f64 = 0.4;

/// The outermost strong edge along a ray within `reach` of a circle, by a parabola through the steepest difference and
/// its neighbours.
fn outline_point(sample: &dyn Fn(f64, f64) -> f64, c: &Circle, k: usize, reach: f64) -> Option<[f64; 2]> {
    let angle = TAU * k as f64 / RAYS as f64;
    let (sin, cos) = angle.sin_cos();
    // Half a pixel apart; differences over one pixel.
    let n = (2.0 * reach).ceil() as i64;
    // A mean over five places along the arc, up to 1.5 pixels apart, quietens noise and keeps the outline sharp.
    let apart = (1.5 / c.radius).min(0.5 * TAU / RAYS as f64);
    let turns: [(f64, f64); 5] = std::array::from_fn(|m| (angle + (m as f64 - 2.0) * apart).sin_cos());
    let at = |i: i64| {
        let r = c.radius + 0.5 * i as f64;
        turns.iter().map(|(sin, cos)| sample(c.x + r * cos, c.y + r * sin)).sum::<f64>() / 5.0
    };
    let slope: Vec<f64> = (-n..=n).map(|i| (at(i + 1) - at(i - 1)).abs()).collect();
    let steepest = slope.iter().copied().fold(0.0, f64::max);
    if steepest < 0.05 {
        return None;
    }
    let strong = |&i: &usize| slope[i] >= OUTLINE * steepest && slope[i] >= slope[i - 1] && slope[i] > slope[i + 1];
    let best = (1..slope.len() - 1).rev().find(strong)?;
    let (before, here, after) = (slope[best - 1], slope[best], slope[best + 1]);
    let curve = before - 2.0 * here + after;
    let shift = if curve < 0.0 { 0.5 * (before - after) / curve } else { 0.0 };
    let r = c.radius + 0.5 * (best as f64 - n as f64 + shift);
    Some([c.x + r * cos, c.y + r * sin])
}

/// The circle with the least sum of squared distances to points (Gauss-Newton), points that lie far off weighing less
/// (Tukey's biweight at six median absolute deviations). `None` of fewer than a third of the rays.
fn fit_circle(points: &[[f64; 2]], start: Circle) -> Option<Circle> {
    if points.len() < RAYS / 3 {
        return None;
    }
    let mut c = start;
    for _ in 0..20 {
        let residual = |p: &[f64; 2]| (p[0] - c.x).hypot(p[1] - c.y) - c.radius;
        let mut sizes: Vec<f64> = points.iter().map(|p| residual(p).abs()).collect();
        let middle = sizes.len() / 2;
        let scale = 6.0 * sizes.select_nth_unstable_by(middle, f64::total_cmp).1.max(0.02);
        let (mut a, mut b) = (nalgebra::Matrix3::<f64>::zeros(), nalgebra::Vector3::<f64>::zeros());
        for p in points {
            let r = residual(p);
            let weight = (1.0 - (r / scale).powi(2)).max(0.0).powi(2);
            let (dx, dy) = (p[0] - c.x, p[1] - c.y);
            let length = dx.hypot(dy).max(1e-9);
            // d residual / d (x, y, radius)
            let row = nalgebra::Vector3::new(-dx / length, -dy / length, -1.0);
            a += weight * row * row.transpose();
            b -= weight * r * row;
        }
        let step = a.lu().solve(&b)?;
        c = Circle { x: c.x + step.x, y: c.y + step.y, radius: c.radius + step.z };
        if step.norm() < 1e-6 {
            break;
        }
    }
    (c.radius.is_finite() && c.radius > 1.0).then_some(c)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::illumination::EnvMap;
    use crate::math::Vec3;

    /// A mirror ball in lively surroundings before a background of a given brightness, with noise; pixels at the
    /// outline are mixed by coverage.
    fn picture(ball: &Circle, (w, h): (usize, usize), background: impl Fn(f64, f64) -> f32, noise: f32) -> Image {
        let map = EnvMap::from_fn(256, 128, |d| {
            let bars = if (9.0 * d.x).sin() * (7.0 * d.y + 2.0).sin() > 0.3 { 0.9 } else { 0.15 };
            let sun = if d.x > 0.55 && d.y > 0.6 { 8.0 } else { 0.0 };
            [(bars + sun) as f32; 3]
        });
        let mut rng = Pcg32::seed_from_u64(4);
        Image::from_fn(w, h, |x, y| {
            let mut sum = 0.0;
            for k in 0..16 {
                let (px, py) = (x as f64 + ((k % 4) as f64 + 0.5) / 4.0, y as f64 + ((k / 4) as f64 + 0.5) / 4.0);
                let (u, v) = ((px - ball.x) / ball.radius, (py - ball.y) / ball.radius);
                sum += if u.hypot(v) < 1.0 {
                    let n = Vec3::new(u, -v, (1.0 - u * u - v * v).sqrt());
                    map.radiance(&(n * (2.0 * n.z) - Vec3::z()))[0]
                } else {
                    background(px, py)
                };
            }
            let noisy = sum / 16.0 + noise * (rng.random::<f32>() - 0.5);
            [noisy.max(0.0); 3]
        })
    }

    #[test]
    fn outlines_are_found_to_about_a_pixel() {
        let grey = |_: f64, _: f64| 0.45f32;
        let black = |_: f64, _: f64| 0.0f32;
        // A horizon, a pole and a bright poster.
        let room = |x: f64, y: f64| {
            let poster = (40.0..130.0).contains(&x) && (30.0..90.0).contains(&y);
            (if y > 250.0 { 0.2 } else { 0.5 }) + if poster { 0.6 } else { 0.0 }
        };
        for (ball, size, noise) in [
            (Circle { x: 201.3, y: 158.8, radius: 102.6 }, (420, 330), 0.02f32),
            (Circle { x: 350.2, y: 290.6, radius: 241.4 }, (700, 600), 0.05),
            (Circle { x: 300.9, y: 120.2, radius: 40.3 }, (480, 320), 0.02),
        ] {
            let backgrounds: [&dyn Fn(f64, f64) -> f32; 3] = [&grey, &black, &room];
            for background in backgrounds {
                let found = find_ball(&picture(&ball, size, background, noise), "test").unwrap();
                let off = (found.x - ball.x).hypot(found.y - ball.y);
                // What the ball reflects next to its rim crowds into rings and moves the steepest place by up to a pixel.
                assert!(off < 1.5 && (found.radius - ball.radius).abs() < 1.5, "{found:?} is not {ball:?}");
            }
        }
    }

    #[test]
    fn several_balls_are_told_apart() {
        let balls = [Circle { x: 90.4, y: 100.7, radius: 60.2 }, Circle { x: 300.1, y: 150.3, radius: 50.8 }];
        let first = picture(&balls[0], (400, 240), |_, _| 0.4, 0.02);
        let second = picture(&balls[1], (400, 240), |_, _| 0.4, 0.02);
        let both = Image::from_fn(400, 240, |x, y| {
            let from = if x < 200 { &first } else { &second };
            std::array::from_fn(|c| from.pixel(x, y)[c])
        });
        let mut found = find_balls(&both, "test", 2).unwrap();
        found.sort_by(|a, b| a.x.total_cmp(&b.x));
        for (found, ball) in found.iter().zip(&balls) {
            assert!((found.x - ball.x).abs() < 0.4 && (found.radius - ball.radius).abs() < 0.5, "{found:?}");
        }
        let message = find_balls(&both, "balls.jpg", 3).unwrap_err().to_string();
        assert!(
            message.contains("balls.jpg") && message.contains("2 balls only") && message.contains("X,Y,R"),
            "{message}"
        );
    }

    #[test]
    fn pictures_without_a_ball_say_so() {
        let mut rng = Pcg32::seed_from_u64(9);
        let noise = Image::from_fn(200, 150, |_, _| [rng.random(); 3]);
        let flat = Image::from_fn(200, 150, |_, _| [0.5; 3]);
        let bars = Image::from_fn(200, 150, |x, _| [if x % 40 < 20 { 0.1 } else { 0.9 }; 3]);
        for (name, image) in [("noise", noise), ("flat", flat), ("bars", bars), ("dot", Image::new(1, 1, 3))] {
            let message = find_ball(&image, name).unwrap_err().to_string();
            assert!(message.contains(name) && message.contains("X,Y,R"), "{message}");
        }
    }
}
