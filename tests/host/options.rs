//! What a test's host is like.

use std::ffi::CStr;

use super::pixels::Depth;

/// Properties of the host and its project. Start from [`Options::default`].
#[derive(Debug, Clone)]
pub struct Options {
    /// Name the host gives itself.
    pub name: String,
    /// Project size, canonical units.
    pub project_size: (f64, f64),
    /// Project offset, canonical units.
    pub project_offset: (f64, f64),
    /// Project extent, canonical units.
    pub project_extent: (f64, f64),
    /// Pixel aspect ratio of the project.
    pub pixel_aspect: f64,
    /// Whether clips tell their regions in pixels of the render scale, as MLT's do, and not in canonical units.
    pub regions_in_pixels: bool,
    /// Frames per second.
    pub frame_rate: f64,
    /// First and last frame.
    pub frame_range: (f64, f64),
    /// Depth of the project.
    pub depth: Depth,
    /// Suites (by name, any version) that this host lacks.
    pub missing_suites: Vec<&'static CStr>,
    /// Whether there is a message suite v2 (persistent messages).
    pub persistent_messages: bool,
    /// Whether the multithread suite really makes threads.
    pub real_threads: bool,
    /// Whether setting a value from a test calls InstanceChanged, as a user's edit does.
    pub notify: bool,
    /// Value of the property "is background".
    pub background: bool,
    /// Whether a violation fails the test when the host is dropped.
    pub fail_on_drop: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            name: "org.relume.testhost".into(),
            project_size: (64.0, 48.0),
            project_offset: (0.0, 0.0),
            project_extent: (64.0, 48.0),
            pixel_aspect: 1.0,
            regions_in_pixels: false,
            frame_rate: 24.0,
            frame_range: (1.0, 100.0),
            depth: Depth::Float,
            missing_suites: Vec::new(),
            persistent_messages: true,
            real_threads: true,
            notify: true,
            background: false,
            fail_on_drop: true,
        }
    }
}
