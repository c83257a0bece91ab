//! Paths from the camera, and the trait through which they hand over the light they find.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use super::V3;
use super::camera::Camera;
use super::material::{Material, Rgb, Scatter, fresnel, reflect, refract};
use super::sampling::{Spread, Steps, cone};
use super::scene::{Hit, Scene};
use super::shape::Ray;

/// What collects the light of a pixel: lamp cells, a map, or (for other rigs) a screen.
pub(super) trait Collector {
    /// Light that reaches `vertex` unhindered from the surroundings, scattered to the viewer, times `weight`.
    /// `first`: the camera sees this vertex, itself or through mirrors and glass, so it is worth every effort.
    fn direct(&mut self, scene: &Scene, vertex: &Vertex, weight: &Rgb, first: bool, rng: &mut Pcg32);

    /// A path leaves the scene along `ray` after a mirror or glass, with `weight`. `first`: the camera looks along it, by
    /// mirrors and glass alone.
    fn leave(&mut self, ray: &Ray, weight: &Rgb, first: bool);
}

/// A point of a surface that scatters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vertex {
    pub point: V3,
    pub object: usize,
    pub scatter: Scatter,
}

/// How much work a path does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Effort {
    /// Camera rays a pixel.
    pub samples: usize,
    /// Bounces towards other surfaces at each vertex that the camera sees; one at the others.
    pub bounces: usize,
    /// Directions per steradian of a mirror's or glass's cone, a pixel, at the vertices the camera sees.
    pub cone_density: f32,
    /// Scattering events at most.
    pub depth: usize,
}

/// Paths weaker than this share of a bounce's go on with a probability in proportion (Russian roulette).
const ROULETTE: f32 = 0.5;
/// The same at the second and later bounces, which matter little and look alike.
const LATER_ROULETTE: f32 = 1.5;
/// Directions towards each mirror or glass after the first bounce; one later on.
const SECOND_CONES: usize = 6;
/// Glass splits into both branches while the weaker one carries more than this.
const SPLIT: f32 = 0.02;
/// Surfaces behind mirrors and glass count as seen by the camera above this weight.
const SEEN: f32 = 0.1;
/// Mirror and glass events of one chain; light caught in total reflection for longer is lost (below 1e-6 in a ball).
const CHAIN: usize = 64;

/// Paths through one scene.
#[derive(Debug)]
pub(super) struct Tracer<'a> {
    scene: &'a Scene,
    speculars: Vec<(usize, V3, f32)>,
    effort: Effort,
}

/// The random state of a pixel.
struct State {
    rng: Pcg32,
    bounce: Spread,
    lobe: Steps,
    cones: Vec<Spread>,
}

/// A ray that has met a mirror or a glass.
#[derive(Clone, Copy)]
struct Link {
    flight: V3,
    hit: Hit,
    weight: Rgb,
    events: usize,
}

/// Where a path stands.
#[derive(Clone, Copy)]
struct Stand {
    depth: usize,
    first: bool,
}

impl<'a> Tracer<'a> {
    pub fn new(scene: &'a Scene, effort: Effort) -> Self {
        Self { scene, speculars: scene.speculars(), effort }
    }

    /// Traces a pixel. What the collector gets is the sum over the camera rays: divide by their number. The result
    /// depends on `seed` and the pixel alone.
    pub fn pixel(&self, camera: &Camera, x: usize, y: usize, seed: u64, out: &mut dyn Collector) {
        let start = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (y * camera.width + x) as u64;
        self.rays(&|u, v| camera.ray(u, v), (x, y), start, out);
    }

    /// The same for any eye, by the ray through continuous picture coordinates; `start` of the random numbers is the pixel's own.
    pub fn rays(&self, ray: &dyn Fn(f32, f32) -> Ray, (x, y): (usize, usize), start: u64, out: &mut dyn Collector) {
        let mut rng = Pcg32::seed_from_u64(start);
        let mut film = Spread::new(rng.random());
        let (bounce, lobe) = (Spread::new(rng.random()), Steps::new(rng.random()));
        let cones = self.speculars.iter().map(|_| Spread::new(rng.random())).collect();
        let mut state = State { rng, bounce, lobe, cones };
        for _ in 0..self.effort.samples {
            let [u, v] = film.next();
            let ray = ray(x as f32 + u, y as f32 + v);
            if let Some(hit) = self.scene.hit(&ray) {
                self.arrive(&ray.direction, hit, [1.0; 3], Stand { depth: 0, first: true }, &mut state, out);
            }
        }
    }

    /// A ray has met something.
    fn arrive(&self, flight: &V3, hit: Hit, weight: Rgb, stand: Stand, state: &mut State, out: &mut dyn Collector) {
        if self.scene.objects[hit.object].material.is_specular() {
            self.chain(Link { flight: *flight, hit, weight, events: 0 }, stand, state, out);
        } else {
            self.surface(flight, hit, weight, stand, state, out);
        }
    }

    /// Light that a rough surface sends back along a ray: direct, over mirrors and glass, over other surfaces.
    fn surface(&self, flight: &V3, hit: Hit, weight: Rgb, stand: Stand, state: &mut State, out: &mut dyn Collector) {
        let normal = if hit.normal.dot(flight) > 0.0 { -hit.normal } else { hit.normal };
        let Some(scatter) = Scatter::new(&self.scene.objects[hit.object].material, normal, -flight) else { return };
        let vertex = Vertex { point: hit.point, object: hit.object, scatter };
        out.direct(self.scene, &vertex, &weight, stand.first, &mut state.rng);
        if stand.depth + 1 < self.effort.depth {
            self.cones(&vertex, weight, stand, state, out);
            let count = if stand.first { self.effort.bounces } else { 1 };
            let share = weight.map(|w| w / count as f32);
            (0..count).for_each(|_| self.bounce(&vertex, share, stand, state, out));
        }
    }

    /// Light from mirrors and glass: directions in the cone of each, where it is what they meet first.
    fn cones(&self, vertex: &Vertex, weight: Rgb, stand: Stand, state: &mut State, out: &mut dyn Collector) {
        for (i, &(object, centre, radius)) in self.speculars.iter().enumerate() {
            let to = centre - vertex.point;
            if vertex.scatter.normal().dot(&to) < -radius {
                continue;
            }
            let sin2 = radius * radius / to.norm_squared();
            let one_minus_cos = if sin2 < 1.0 { sin2 / (1.0 + (1.0 - sin2).sqrt()) } else { 2.0 };
            let solid_angle = std::f32::consts::TAU * one_minus_cos;
            let wanted = self.effort.cone_density * solid_angle * peak(&weight) / self.effort.samples as f32;
            let count = match (stand.first, stand.depth) {
                (true, _) => wanted.ceil().max(1.0) as usize,
                (false, 1) => SECOND_CONES,
                _ => 1,
            };
            let axis = to.normalize();
            for _ in 0..count {
                let u = if stand.first { state.cones[i].next() } else { state.rng.random() };
                let ray = Ray { origin: vertex.point, direction: cone(&axis, one_minus_cos, u) };
                let weight = times(&weight, &vertex.scatter.towards(&ray.direction), solid_angle / count as f32);
                if peak(&weight) > 0.0
                    && let Some(hit) = self.scene.hit(&ray).filter(|h| h.object == object)
                {
                    let link = Link { flight: ray.direction, hit, weight, events: 0 };
                    self.chain(link, Stand { first: false, ..stand }, state, out);
                }
            }
        }
    }

    /// Light from other rough surfaces.
    fn bounce(&self, vertex: &Vertex, weight: Rgb, stand: Stand, state: &mut State, out: &mut dyn Collector) {
        let (lobe, u) = if stand.first {
            (state.lobe.next(), state.bounce.next())
        } else {
            (state.rng.random(), state.rng.random())
        };
        let direction = vertex.scatter.draw(lobe, u);
        let scattered = vertex.scatter.towards(&direction);
        if peak(&scattered) <= 0.0 {
            return;
        }
        let weight = times(&weight, &scattered, 1.0 / vertex.scatter.density(&direction));
        let Some(weight) = self.roulette(weight, stand, &mut state.rng) else { return };
        let ray = Ray { origin: vertex.point, direction };
        if let Some(hit) = self.scene.hit(&ray)
            && !self.scene.objects[hit.object].material.is_specular()
        {
            let next = Stand { depth: stand.depth + 1, first: false };
            self.surface(&direction, hit, weight, next, state, out);
        }
    }

    /// Follows mirrors and glass to where the light comes from.
    fn chain(&self, start: Link, stand: Stand, state: &mut State, out: &mut dyn Collector) {
        let mut open = vec![start];
        while let Some(link) = open.pop() {
            for (direction, weight) in self.branches(&link, &mut state.rng).into_iter().flatten() {
                let ray = Ray { origin: link.hit.point, direction };
                let Some(hit) = self.scene.hit(&ray) else {
                    out.leave(&ray, &weight, stand.first);
                    continue;
                };
                if self.scene.objects[hit.object].material.is_specular() {
                    if link.events + 1 < CHAIN {
                        open.push(Link { flight: direction, hit, weight, events: link.events + 1 });
                    }
                } else if stand.first && peak(&weight) > SEEN {
                    self.surface(&direction, hit, weight, stand, state, out);
                } else if let Some(weight) = self.roulette(weight, stand, &mut state.rng) {
                    let next = Stand { depth: stand.depth + 1, first: false };
                    self.surface(&direction, hit, weight, next, state, out);
                }
            }
        }
    }

    /// Ends weak paths by chance and makes up for it in the others.
    fn roulette(&self, weight: Rgb, stand: Stand, rng: &mut Pcg32) -> Option<Rgb> {
        let floor = if stand.depth == 0 { ROULETTE } else { LATER_ROULETTE };
        let strength = peak(&weight) * self.effort.bounces as f32 / floor;
        if strength >= 1.0 {
            return Some(weight);
        }
        (rng.random::<f32>() < strength).then(|| weight.map(|w| w / strength))
    }

    /// Where light goes on at a mirror or a glass: both ways while the weaker is worth it, then one of them by chance.
    fn branches(&self, link: &Link, rng: &mut Pcg32) -> [Option<(V3, Rgb)>; 2] {
        let entering = link.flight.dot(&link.hit.normal) < 0.0;
        let normal = if entering { link.hit.normal } else { -link.hit.normal };
        let mirrored = reflect(&link.flight, &normal);
        match self.scene.objects[link.hit.object].material {
            Material::Mirror { reflectance } => [Some((mirrored, times(&link.weight, &reflectance, 1.0))), None],
            Material::Glass { index } => {
                let index = if entering { index } else { 1.0 / index };
                let r = fresnel(-link.flight.dot(&normal), index);
                let bent = refract(&link.flight, &normal, index);
                if r < 1.0 && peak(&link.weight) * r.min(1.0 - r) > SPLIT {
                    [Some((bent, link.weight.map(|w| w * (1.0 - r)))), Some((mirrored, link.weight.map(|w| w * r)))]
                } else {
                    [Some((if rng.random::<f32>() < r { mirrored } else { bent }, link.weight)), None]
                }
            }
            _ => [None, None],
        }
    }
}

/// Product by channel, times a number.
pub(super) fn times(a: &Rgb, b: &Rgb, scale: f32) -> Rgb {
    std::array::from_fn(|c| a[c] * b[c] * scale)
}

/// The largest channel.
pub(super) fn peak(rgb: &Rgb) -> f32 {
    rgb[0].max(rgb[1]).max(rgb[2])
}
