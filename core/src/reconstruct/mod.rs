//! Reconstruction of sampled reflectance functions (4.3), used as downsampling of the illumination (4.4.2).
//!
//! A method gives kernels `U_j(w)` that sum to one over the lamps. Upsampling a reflectance function and relighting with
//! the full map equals downsampling the map and relighting with the samples: `(T U) L' = T (U L')` (eq. 4.7).

/// How the reflectance function is filled in between the lamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Method {
    /// Each direction takes the sample of the nearest lamp (spherical Voronoi cells, 4.3.1).
    ZeroOrder,
    /// Barycentric in the spherical Delaunay triangle (4.3.2).
    #[default]
    Linear,
}

/// What becomes of light from outside the coverage of the lamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Outside {
    /// It is dropped.
    #[default]
    Drop,
    /// It is given to the nearest lamp.
    Nearest,
}
