//! Materials: what a surface does with light.
//!
//! Symbols: n normal, l to the light, v to the viewer, h halfway; `alpha` the GGX width (not its square root). All
//! scattering functions here include the cosine: `f(l, v) * cos(n, l)`, per steradian.

use std::f32::consts::PI;

use super::V3;
use super::sampling;

/// RGB, linear.
pub(super) type Rgb = [f32; 3];

/// What a body is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Material {
    /// Lambert.
    Diffuse {
        /// Share of light sent back, RGB.
        albedo: [f32; 3],
    },
    /// A Lambert base under a GGX coat of index 1.5.
    Glossy {
        /// Of the base, RGB.
        albedo: [f32; 3],
        /// GGX width of the coat.
        alpha: f32,
    },
    /// GGX metal (Walter et al. 2007) with Schlick's Fresnel term.
    RoughMetal {
        /// Reflectance face on, RGB.
        f0: [f32; 3],
        /// GGX width.
        alpha: f32,
    },
    /// A perfect mirror.
    Mirror {
        /// Reflectance at all angles, RGB.
        reflectance: [f32; 3],
    },
    /// A smooth clear dielectric.
    Glass {
        /// Index of refraction against air.
        index: f32,
    },
}

impl Material {
    /// Does light leave in single directions only?
    pub(super) fn is_specular(&self) -> bool {
        matches!(self, Self::Mirror { .. } | Self::Glass { .. })
    }
}

/// Reflectance of a smooth dielectric for unpolarised light; `cos` on the side of the light, `index` = that of the far
/// side over that of the near side. 1 at total reflection.
pub(super) fn fresnel(cos: f32, index: f32) -> f32 {
    let sin2 = (1.0 - cos * cos) / (index * index);
    if sin2 >= 1.0 {
        return 1.0;
    }
    let inner = (1.0 - sin2).sqrt();
    let parallel = (index * cos - inner) / (index * cos + inner);
    let perpendicular = (cos - index * inner) / (cos + index * inner);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// Mirrors the direction of flight.
pub(super) fn reflect(flight: &V3, normal: &V3) -> V3 {
    (flight - normal * (2.0 * flight.dot(normal))).normalize()
}

/// Bends the direction of flight into the far side; `normal` against the flight, `index` as in [`fresnel`], not beyond
/// total reflection.
pub(super) fn refract(flight: &V3, normal: &V3, index: f32) -> V3 {
    let cos = -flight.dot(normal);
    let inner = (1.0 - (1.0 - cos * cos) / (index * index)).max(0.0).sqrt();
    (flight / index + normal * (cos / index - inner)).normalize()
}

#[inline(always)]
fn schlick(cos: f32) -> f32 {
    let m = (1.0 - cos).max(0.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// Reflectance of index 1.5 face on.
const COAT: f32 = 0.04;
/// Share of samples that go to the coat of a glossy surface; any share is right, a half is near the best here.
const COAT_SHARE: f32 = 0.5;

/// A scattering function with the viewer held fixed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scatter {
    normal: V3,
    view: V3,
    cos_view: f32,
    /// Albedo / pi, times what the coat lets in from the viewer's side.
    base: Rgb,
    /// What the coat takes from the base on the light's side, in units of its Fresnel term: 0 or 1.
    coat: f32,
    f0: Rgb,
    alpha2: f32,
}

impl Scatter {
    /// The scattering of a rough material; `None` of a specular one. `normal` is on the viewer's side.
    pub fn new(material: &Material, normal: V3, view: V3) -> Option<Self> {
        let cos_view = normal.dot(&view).max(1e-4);
        let none = Self { normal, view, cos_view, base: [0.0; 3], coat: 0.0, f0: [0.0; 3], alpha2: 0.0 };
        match *material {
            Material::Diffuse { albedo } => Some(Self { base: albedo.map(|a| a / PI), ..none }),
            Material::Glossy { albedo, alpha } => {
                let through = 1.0 - (COAT + (1.0 - COAT) * schlick(cos_view));
                let base = albedo.map(|a| a / PI * through);
                Some(Self { base, coat: 1.0, f0: [COAT; 3], alpha2: alpha * alpha, ..none })
            }
            Material::RoughMetal { f0, alpha } => Some(Self { f0, alpha2: alpha * alpha, ..none }),
            Material::Mirror { .. } | Material::Glass { .. } => None,
        }
    }

    /// Only a Lambert lobe?
    pub fn is_diffuse(&self) -> bool {
        self.alpha2 == 0.0
    }

    /// Albedo / pi of the Lambert lobe.
    pub fn base(&self) -> Rgb {
        self.base
    }

    /// The normal, on the viewer's side.
    pub fn normal(&self) -> &V3 {
        &self.normal
    }

    /// To the viewer.
    pub fn view(&self) -> &V3 {
        &self.view
    }

    /// `f cos` from `cos_light` = n.l and `between` = l.v, zero below the horizon. Without branches, so that loops over
    /// lamps vectorise.
    #[inline(always)]
    pub fn lobes(&self, cos_light: f32, between: f32) -> Rgb {
        let cos = cos_light.max(0.0);
        // |l + v|: h = (l + v) / |l + v|.
        let sum = (2.0 + 2.0 * between).max(1e-6).sqrt();
        let cos_h = (cos + self.cos_view) / sum;
        let fresnel = schlick(0.5 * sum);
        let d = self.alpha2 / (PI * (cos_h * cos_h * (self.alpha2 - 1.0) + 1.0).powi(2)).max(1e-12);
        let smith = |c: f32| (self.alpha2 + (1.0 - self.alpha2) * c * c).sqrt();
        // Height-correlated Smith shadowing over 4 cos cos (Heitz 2014, eq. 99).
        let g = 0.5 / (cos * smith(self.cos_view) + self.cos_view * smith(cos)).max(1e-12);
        let gloss = d * g * cos;
        let through = 1.0 - self.coat * (COAT + (1.0 - COAT) * schlick(cos));
        std::array::from_fn(|c| self.base[c] * through * cos + gloss * (self.f0[c] + (1.0 - self.f0[c]) * fresnel))
    }

    /// `f cos` towards one light.
    pub fn towards(&self, light: &V3) -> Rgb {
        let cos = self.normal.dot(light);
        if self.is_diffuse() { self.base.map(|b| b * cos.max(0.0)) } else { self.lobes(cos, self.view.dot(light)) }
    }

    /// Draws a light direction; it may lie below the horizon, where [`Self::towards`] is zero.
    pub fn draw(&self, choice: f32, u: [f32; 2]) -> V3 {
        if choice < self.gloss_share() {
            reflect(&-self.view, &self.draw_normal(u))
        } else {
            sampling::cosine(&self.normal, u)
        }
    }

    /// Density of [`Self::draw`], per steradian.
    pub fn density(&self, light: &V3) -> f32 {
        let cos = self.normal.dot(light).max(0.0);
        let share = self.gloss_share();
        if share == 0.0 {
            return cos / PI;
        }
        let h = (light + self.view).normalize();
        let cos_h = self.normal.dot(&h).max(0.0);
        let d = self.alpha2 / (PI * (cos_h * cos_h * (self.alpha2 - 1.0) + 1.0).powi(2)).max(1e-12);
        // Density of visible normals over 4 (h.v), in which h.v cancels (Heitz 2018, eq. 3 and 17).
        let root = (self.alpha2 + (1.0 - self.alpha2) * self.cos_view * self.cos_view).sqrt();
        let gloss = if cos_h > 0.0 { d / (2.0 * (self.cos_view + root)) } else { 0.0 };
        share * gloss + (1.0 - share) * cos / PI
    }

    fn gloss_share(&self) -> f32 {
        if self.is_diffuse() {
            0.0
        } else if self.coat > 0.0 {
            COAT_SHARE
        } else {
            1.0
        }
    }

    /// A microfacet normal as the viewer sees them (E. Heitz, "Sampling the GGX Distribution of Visible Normals", JCGT
    /// 2018, listing 1, isotropic).
    fn draw_normal(&self, u: [f32; 2]) -> V3 {
        let alpha = self.alpha2.sqrt();
        let (s, t) = sampling::frame(&self.normal);
        let local = V3::new(self.view.dot(&s), self.view.dot(&t), self.cos_view);
        let stretched = V3::new(alpha * local.x, alpha * local.y, local.z).normalize();
        let across = stretched.x * stretched.x + stretched.y * stretched.y;
        let t1 = if across > 0.0 { V3::new(-stretched.y, stretched.x, 0.0) / across.sqrt() } else { V3::x() };
        let t2 = stretched.cross(&t1);
        let (radius, phi) = (u[0].sqrt(), 2.0 * PI * u[1]);
        let p1 = radius * phi.cos();
        let lift = 0.5 * (1.0 + stretched.z);
        let p2 = (1.0 - lift) * (1.0 - p1 * p1).max(0.0).sqrt() + lift * radius * phi.sin();
        let up = (1.0 - p1 * p1 - p2 * p2).max(0.0).sqrt();
        let n = t1 * p1 + t2 * p2 + stretched * up;
        let facet = V3::new(alpha * n.x, alpha * n.y, n.z.max(1e-6)).normalize();
        s * facet.x + t * facet.y + self.normal * facet.z
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;

    fn rough() -> [Material; 3] {
        [
            Material::Diffuse { albedo: [1.0; 3] },
            Material::Glossy { albedo: [1.0; 3], alpha: 0.3 },
            Material::RoughMetal { f0: [1.0; 3], alpha: 0.3 },
        ]
    }

    fn view(cos: f32) -> V3 {
        V3::new((1.0 - cos * cos).sqrt(), 0.0, cos)
    }

    #[test]
    fn fresnel_meets_its_known_values_and_is_the_same_from_both_sides() {
        assert!((fresnel(1.0, 1.5) - 0.04).abs() < 1e-6);
        assert!((fresnel(1e-4, 1.5) - 1.0).abs() < 1e-2);
        // Brewster's angle, tan = 1.5: only the perpendicular part is left, ((n^2 - 1) / (n^2 + 1))^2 / 2.
        let brewster = 1.0 / (1.0f32 + 2.25).sqrt();
        assert!((fresnel(brewster, 1.5) - 0.5 * (1.25f32 / 3.25).powi(2)).abs() < 1e-6);
        for cos in [0.9f32, 0.5, 0.2] {
            let inner = (1.0 - (1.0 - cos * cos) / 2.25).sqrt();
            assert!((fresnel(cos, 1.5) - fresnel(inner, 1.0 / 1.5)).abs() < 1e-5);
        }
        assert_eq!(fresnel(0.5, 1.0 / 1.5), 1.0);
    }

    #[test]
    fn refraction_obeys_snell_and_turns_back() {
        let (flight, normal) = (V3::new(0.6, 0.0, -0.8), V3::z());
        let bent = refract(&flight, &normal, 1.5);
        assert!((bent.x - 0.6 / 1.5).abs() < 1e-6 && bent.z < 0.0);
        assert!((refract(&-bent, &-normal, 1.0 / 1.5) + flight).norm() < 1e-5);
    }

    #[test]
    fn scattering_is_reciprocal() {
        let (a, b) = (V3::new(0.3, -0.4, 0.866).normalize(), V3::new(-0.7, 0.1, 0.4).normalize());
        for material in rough() {
            let there = Scatter::new(&material, V3::z(), a).unwrap().towards(&b).map(|f| f / b.z);
            let back = Scatter::new(&material, V3::z(), b).unwrap().towards(&a).map(|f| f / a.z);
            (0..3).for_each(|c| assert!((there[c] / back[c] - 1.0).abs() < 1e-4, "{material:?}"));
        }
    }

    #[test]
    fn no_material_makes_energy_and_lambert_keeps_all() {
        for material in rough() {
            for cos in [1.0, 0.7, 0.4, 0.15] {
                let scatter = Scatter::new(&material, V3::z(), view(cos)).unwrap();
                let n = 200;
                let sum: f64 = (0..n * n)
                    .map(|k| {
                        let u = [((k % n) as f32 + 0.5) / n as f32, ((k / n) as f32 + 0.5) / n as f32];
                        f64::from(scatter.towards(&sampling::cone(&V3::z(), 1.0, u))[0])
                    })
                    .sum();
                let albedo = sum * std::f64::consts::TAU / f64::from(n * n);
                assert!(albedo < 1.001, "{material:?} at cos {cos}: {albedo}");
                assert!(albedo > if matches!(material, Material::Diffuse { .. }) { 0.999 } else { 0.6 });
            }
        }
    }

    /// The density integrates to one over the sphere, and its draws estimate the same albedo as plain integration.
    #[test]
    fn draws_follow_their_density() {
        let mut rng = Pcg32::seed_from_u64(3);
        for material in rough() {
            for cos in [0.95, 0.5, 0.2] {
                let scatter = Scatter::new(&material, V3::z(), view(cos)).unwrap();
                let n = 400;
                let (mut total, mut plain) = (0.0, 0.0);
                for k in 0..n * n {
                    let u = [((k % n) as f32 + 0.5) / n as f32, ((k / n) as f32 + 0.5) / n as f32];
                    let d = sampling::cone(&V3::z(), 2.0, u);
                    total += f64::from(scatter.density(&d));
                    plain += f64::from(scatter.towards(&d)[0]);
                }
                let area = 2.0 * std::f64::consts::TAU / f64::from(n * n);
                let draws = 40_000;
                let drawn: f64 = (0..draws)
                    .map(|_| {
                        let d = scatter.draw(rng.random(), rng.random());
                        f64::from(scatter.towards(&d)[0] / scatter.density(&d))
                    })
                    .sum();
                let (total, plain, drawn) = (total * area, plain * area, drawn / f64::from(draws));
                assert!((total - 1.0).abs() < 5e-3, "{material:?} at {cos}: density sums to {total}");
                assert!((drawn / plain - 1.0).abs() < 1e-2, "{material:?} at {cos}: {drawn} is not {plain}");
            }
        }
    }
}
