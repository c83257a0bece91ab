//! Colour temperature -> linear Rec.709.
//!
//! Below 4000 K the light of a black body (Planck's law, integrated with the CIE 1931 observer), above 5000 K daylight of
//! that temperature (CIE 15:2004, section 3.1), between them a blend that is linear in 1 / T. So 6504 K is D65, the white of the
//! pictures, and lamps below are as warm as tungsten.

/// Temperatures that [`rgb`] takes, in kelvin. The CIE states its daylight formula to 25000 K; it stays smooth beyond.
pub const RANGE: (f64, f64) = (1000.0, 40_000.0);

/// The second radiation constant, m K, of the International Temperature Scale of 1990.
const C2: f64 = 1.4388e-2;
/// A black body below, daylight above.
const BLEND: (f64, f64) = (4000.0, 5000.0);

/// CIE 1931 standard observer, x-bar y-bar z-bar every 10 nm from 380 to 780 nm (CIE 15:2004, table T.4).
const OBSERVER: [[f64; 3]; 41] = [
    [0.001368, 0.000039, 0.006450],
    [0.004243, 0.000120, 0.020050],
    [0.014310, 0.000396, 0.067850],
    [0.043510, 0.001210, 0.207400],
    [0.134380, 0.004000, 0.645600],
    [0.283900, 0.011600, 1.385600],
    [0.348280, 0.023000, 1.747060],
    [0.336200, 0.038000, 1.772110],
    [0.290800, 0.060000, 1.669200],
    [0.195360, 0.090980, 1.287640],
    [0.095640, 0.139020, 0.812950],
    [0.032010, 0.208020, 0.465180],
    [0.004900, 0.323000, 0.272000],
    [0.009300, 0.503000, 0.158200],
    [0.063270, 0.710000, 0.078250],
    [0.165500, 0.862000, 0.042160],
    [0.290400, 0.954000, 0.020300],
    [0.433450, 0.994950, 0.008750],
    [0.594500, 0.995000, 0.003900],
    [0.762100, 0.952000, 0.002100],
    [0.916300, 0.870000, 0.001650],
    [1.026300, 0.757000, 0.001100],
    [1.062200, 0.631000, 0.000800],
    [1.002600, 0.503000, 0.000340],
    [0.854450, 0.381000, 0.000190],
    [0.642400, 0.265000, 0.000050],
    [0.447900, 0.175000, 0.000020],
    [0.283500, 0.107000, 0.000000],
    [0.164900, 0.061000, 0.000000],
    [0.087400, 0.032000, 0.000000],
    [0.046770, 0.017000, 0.000000],
    [0.022700, 0.008210, 0.000000],
    [0.011359, 0.004102, 0.000000],
    [0.005790, 0.002091, 0.000000],
    [0.002899, 0.001047, 0.000000],
    [0.001440, 0.000520, 0.000000],
    [0.000690, 0.000249, 0.000000],
    [0.000332, 0.000120, 0.000000],
    [0.000166, 0.000060, 0.000000],
    [0.000083, 0.000030, 0.000000],
    [0.000042, 0.000015, 0.000000],
];

/// XYZ (white Y = 1) to linear Rec.709, from its primaries and D65 (0.3127, 0.3290) (ITU-R BT.709-6, 3.2 and 3.3).
const FROM_XYZ: [[f64; 3]; 3] = [
    [3.240_969_942, -1.537_383_178, -0.498_610_760],
    [-0.969_243_636, 1.875_967_502, 0.041_555_057],
    [0.055_630_080, -0.203_976_959, 1.056_971_514],
];

/// The colour of a temperature (held to [`RANGE`]) in linear Rec.709, of luminance 1. What lies outside the gamut (blue
/// below 1900 K) is cut to zero, the luminance kept.
pub fn rgb(kelvin: f64) -> [f64; 3] {
    let [x, y] = chromaticity(kelvin);
    let xyz = [x / y, 1.0, (1.0 - x - y) / y];
    let inside = FROM_XYZ.map(|row| row.iter().zip(xyz).map(|(m, v)| m * v).sum::<f64>().max(0.0));
    let luminance = inside.iter().zip([0.212_639_006, 0.715_168_679, 0.072_192_315]).map(|(v, k)| v * k).sum::<f64>();
    inside.map(|v| v / luminance)
}

/// CIE 1931 (x, y) of a temperature, held to [`RANGE`].
pub fn chromaticity(kelvin: f64) -> [f64; 2] {
    let t = kelvin.clamp(RANGE.0, RANGE.1);
    let amount = ((1.0 / BLEND.0 - 1.0 / t) / (1.0 / BLEND.0 - 1.0 / BLEND.1)).clamp(0.0, 1.0);
    let (warm, cool) = (black_body(t.min(BLEND.1)), daylight(t.max(BLEND.0)));
    [0, 1].map(|i| warm[i] + (cool[i] - warm[i]) * amount)
}

/// `integral of cmf(lambda) lambda^-5 / (exp(c2 / (lambda T)) - 1)`, as a sum every 10 nm.
fn black_body(t: f64) -> [f64; 2] {
    let mut xyz = [0.0; 3];
    for (n, observer) in OBSERVER.iter().enumerate() {
        let lambda = (380.0 + 10.0 * n as f64) * 1e-9;
        // Relative to 560 nm, so that nothing under- or overflows.
        let power = (lambda / 560e-9).powi(-5) / (C2 / (lambda * t)).exp_m1();
        (0..3).for_each(|i| xyz[i] += power * observer[i]);
    }
    let sum: f64 = xyz.iter().sum();
    [xyz[0] / sum, xyz[1] / sum]
}

/// The daylight locus (CIE 15:2004, section 3.1).
fn daylight(t: f64) -> [f64; 2] {
    let x = if t <= 7000.0 {
        -4.6070e9 / t.powi(3) + 2.9678e6 / t.powi(2) + 0.09911e3 / t + 0.244063
    } else {
        -2.0064e9 / t.powi(3) + 1.9018e6 / t.powi(2) + 0.24748e3 / t + 0.237040
    };
    [x, -3.0 * x * x + 2.870 * x - 0.275]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_bodies_and_daylight_have_their_published_chromaticities() {
        // CIE illuminant A is a black body of 2855.5 K with this c2 (CIE 15:2004); black bodies as Wyszecki and Stiles
        // (1982) tabulate them; D50, D55, D65 and D75 at 1.4388 / 1.4380 of their names (CIE 15:2004, table T.3).
        let ratio = 1.4388 / 1.4380;
        for (kelvin, x, y) in [
            (2855.5, 0.44758, 0.40745),
            (2000.0, 0.5267, 0.4133),
            (1000.0, 0.6528, 0.3445),
            (3000.0, 0.4369, 0.4041),
            (5000.0 * ratio, 0.3457, 0.3585),
            (5500.0 * ratio, 0.3324, 0.3474),
            (6500.0 * ratio, 0.3127, 0.3290),
            (7500.0 * ratio, 0.2990, 0.3149),
        ] {
            let [a, b] = chromaticity(kelvin);
            assert!((a - x).abs() < 2e-4 && (b - y).abs() < 2e-4, "{kelvin} K is at ({a:.5}, {b:.5}), not ({x}, {y})");
        }
        // The black body itself where the blend hides it.
        let [x, y] = black_body(5000.0);
        assert!((x - 0.3451).abs() < 2e-4 && (y - 0.3516).abs() < 2e-4, "({x}, {y})");
    }

    /// Krystek's approximation of the locus (1985), an independent way: 8e-5 in u, v between 1000 and 15000 K.
    #[test]
    fn the_black_body_agrees_with_krystek() {
        for t in [1200.0f64, 1600.0, 2000.0, 2700.0, 3200.0, 4000.0, 5000.0] {
            let u = (0.860117757 + 1.54118254e-4 * t + 1.28641212e-7 * t * t)
                / (1.0 + 8.42420235e-4 * t + 7.08145163e-7 * t * t);
            let v = (0.317398726 + 4.22806245e-5 * t + 4.20481691e-8 * t * t)
                / (1.0 - 2.89741816e-5 * t + 1.61456053e-7 * t * t);
            let [x, y] = black_body(t);
            let d = -2.0 * x + 12.0 * y + 3.0;
            assert!((4.0 * x / d - u).abs() < 2e-4 && (6.0 * y / d - v).abs() < 2e-4, "{t} K");
        }
    }

    #[test]
    fn colours_are_of_luminance_one_and_go_from_red_to_blue() {
        let mut last = f64::INFINITY;
        for step in 0..=390 {
            let c = rgb(1000.0 + 100.0 * f64::from(step));
            assert!(c.iter().all(|v| v.is_finite() && *v >= 0.0), "{c:?}");
            assert!((0.212_639 * c[0] + 0.715_169 * c[1] + 0.072_192 * c[2] - 1.0).abs() < 1e-5, "{c:?}");
            assert!(c[0] < last, "red falls all the way");
            last = c[0];
        }
        assert!(rgb(6504.0).iter().all(|v| (v - 1.0).abs() < 2e-3), "{:?}", rgb(6504.0));
    }
}
