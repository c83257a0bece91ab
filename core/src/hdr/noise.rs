//! How far a sensor's numbers stray from the light.

/// Noise of a sensor: photons and read-out. Quantisation is known from the file and added where codes become light.
///
/// The linear camera model of EMVA 1288 (release 4.0, section 2.2), in shares of white: a signal `y` (1 = white) is
/// `y F` electrons with `F = full_well_e * 100 / ISO`; photons arrive as a Poisson process and reading adds Gaussian noise,
/// so `var(y) = y / F + (read_e / F)^2`.
///
/// Of the weights of a merge only the ratio of the two matters: photon and read noise are equal at
/// `y = read_e^2 / F`, 0.3 % of white by default.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Electrons at white, at ISO 100.
    pub full_well_e: f64,
    /// Standard deviation of reading one pixel, electrons.
    pub read_e: f64,
}

impl Default for Noise {
    /// 20 000 and 8 electrons: a camera between a phone's (some 5 000 and 2) and a full frame's (some 60 000 and 10).
    fn default() -> Self {
        Self { full_well_e: 20_000.0, read_e: 8.0 }
    }
}

impl Noise {
    /// Electrons at white.
    pub fn electrons(&self, iso: f64) -> f64 {
        self.full_well_e * 100.0 / iso
    }

    /// Variance of a signal `y` in shares of white; negative signals count as zero.
    pub fn variance(&self, y: f64, iso: f64) -> f64 {
        let full = self.electrons(iso);
        y.max(0.0) / full + (self.read_e / full).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_model_counts_electrons() {
        let noise = Noise { full_well_e: 10_000.0, read_e: 5.0 };
        // 2500 electrons, sd sqrt(2500 + 25), of 10 000.
        assert!((noise.variance(0.25, 100.0).sqrt() - 2525f64.sqrt() / 1e4).abs() < 1e-12);
        assert!((noise.variance(0.25, 400.0).sqrt() - 650f64.sqrt() / 2500.0).abs() < 1e-12);
        assert_eq!(noise.variance(-1.0, 100.0), noise.variance(0.0, 100.0));
    }
}
