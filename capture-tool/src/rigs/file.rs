//! Rig files: what stands on set, in TOML. Every key is explained in `presets/rigs/virtual-stage.toml`.

use relume_core::domain::{Bits, Filter};
use relume_core::math::Vec3;
use relume_core::{Error, Result};
use serde::{Deserialize, Serialize};

use super::devices::{CameraDevice, Devices};
use super::lamps::Lamps;

/// The three rigs (design: stage 2.3, monitor 6.3, gantry 7.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Lamps around the object.
    Stage,
    /// A screen behind or beside it.
    Monitor,
    /// A projector on an arm over a turntable.
    Gantry,
}

/// A rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigFile {
    /// Of the format; 1.
    pub version: u32,
    /// For people.
    pub name: String,
    /// Which of the tables below counts.
    pub kind: Kind,
    /// The camera.
    pub camera: CameraRig,
    /// What is measured beside the object.
    #[serde(default)]
    pub calibration: CalibrationRig,
    /// Of a stage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stage: Option<StageRig>,
    /// Of a monitor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub monitor: Option<MonitorRig>,
    /// Of a gantry.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gantry: Option<GantryRig>,
    /// Real devices; left out, all is virtual.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub devices: Option<Devices>,
    /// What virtual devices show.
    #[serde(rename = "virtual", default, skip_serializing_if = "Simulation::is_left_out")]
    pub simulation: Simulation,
}

/// A stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageRig {
    /// Photograph all lamps of each stop together: the check of linearity (3.2.1).
    #[serde(default)]
    pub all_lit: bool,
    /// Repeat a reference (all lamps of the first stop) every so many samples; 0 never.
    #[serde(default)]
    pub reference_every: usize,
    /// From a stop of the turntable to the next one, settled, seconds.
    #[serde(default)]
    pub move_s: f64,
    /// From a lamp to the next one, seconds.
    #[serde(default)]
    pub lamp_s: f64,
    /// Where lamps stand.
    pub lamps: Lamps,
}

/// A screen behind or beside the object (6.3).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MonitorRig {
    /// Texels of the patterns.
    pub columns: usize,
    /// Texels of the patterns.
    pub rows: usize,
    /// From a pattern to the next one, panel lag included, seconds.
    #[serde(default)]
    pub settle_s: f64,
    /// What the screen makes of codes.
    #[serde(default)]
    pub curve: EmitterChoice,
    /// Patterns of wavelet noise (sampler `noise`).
    #[serde(default = "noise_count")]
    pub noise: usize,
    /// Wavelet of the patterns: haar, 5/3 or 9/7.
    #[serde(default = "haar")]
    pub wavelet: String,
    /// Squares along each side of the screen (sampler `scan`).
    #[serde(default = "sixteen")]
    pub squares: usize,
    /// Basis functions at most (sampler `explicit`).
    #[serde(default = "functions")]
    pub functions: usize,
    /// Places that weigh less than this share of the white screen get no finer functions (sampler `explicit`); 0: all that are
    /// more than noise do.
    #[serde(default)]
    pub threshold: f64,
    /// c_s of equation 6.6: how smooth the light will be (sampler `explicit`).
    #[serde(default = "any_light")]
    pub smoothness: f64,
    /// How functions that swing below zero are shown (sampler `explicit`).
    #[serde(default)]
    pub parts: PartsChoice,
    /// Pictures a second that the screen makes: no exposure is shorter than one of them.
    #[serde(default = "sixty")]
    pub refresh_hz: f64,
}

/// How light below zero is shown (6.6.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PartsChoice {
    /// Two photographs: the positive part and the negative one.
    #[default]
    Split,
    /// One, about mid-grey.
    Shifted,
}

/// A projector on an arm over a turntable (7.3).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GantryRig {
    /// Squares along each side of the projector's picture.
    pub squares: usize,
    /// Of the separable scheme: every so many squares of a row or column are lit together.
    #[serde(default = "four")]
    pub influence: usize,
    /// How each square falls off: box, tent or gaussian (7.3).
    #[serde(default)]
    pub filter: Filter,
    /// Pixels of the projector along each side of a square, as patterns are drawn.
    #[serde(default = "one_texel")]
    pub texels: usize,
    /// From the object to the projector, scene units.
    pub distance: f64,
    /// So far the axis of the turntable leans towards the camera, degrees: how far the camera looks down on the table. Positions
    /// are about that axis.
    #[serde(default)]
    pub lean_deg: f64,
    /// Width of the projector's picture, degrees.
    pub view_deg: f64,
    /// From a position to the next one, settled, seconds.
    #[serde(default)]
    pub move_s: f64,
    /// From a pattern to the next one, seconds.
    #[serde(default)]
    pub settle_s: f64,
    /// What the projector makes of codes.
    #[serde(default)]
    pub curve: EmitterChoice,
    /// Where the projector goes.
    pub positions: Lamps,
}

impl GantryRig {
    /// Where the projector comes to stand, in the stage frame and scene units.
    pub fn places(&self) -> Vec<Vec3> {
        let (sin, cos) = self.lean_deg.to_radians().sin_cos();
        let (up, near) = (Vec3::new(0.0, cos, sin), Vec3::new(0.0, -sin, cos));
        let place = |d: Vec3| (Vec3::x() * d.x + up * d.y + near * d.z) * self.distance;
        self.positions.directions().into_iter().map(place).collect()
    }

    /// Pixels along each side of the patterns.
    pub fn pixels(&self) -> usize {
        self.squares * self.texels
    }
}

/// What an emitter makes of codes: it is inverted before patterns are shown (6.3).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EmitterChoice {
    /// Light in proportion.
    Linear,
    /// The sRGB curve.
    #[default]
    Srgb,
    /// Measured: a file as `relume calibrate gamma` writes it, in a rig file beside it.
    File(String),
    /// Measured: light of each code, as sessions keep it.
    Measured(Vec<f64>),
}

/// A camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraRig {
    /// The exposure times of every photograph, seconds. Left out, they are chosen from previews.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub times_s: Option<Vec<f64>>,
    /// The shortest and the longest time the camera can do.
    pub limits_s: [f64; 2],
    /// Chosen times are at most so many stops apart.
    #[serde(default = "two")]
    pub step_stops: f64,
    /// ISO speed.
    #[serde(default = "hundred")]
    pub iso: f64,
    /// F-number.
    #[serde(default = "eight")]
    pub f_number: f64,
    /// What an exposure takes beyond its time: mirror, transfer, storing; seconds.
    #[serde(default = "second")]
    pub overhead_s: f64,
    /// Size of a file, megabytes (for the plan).
    #[serde(default = "thirty")]
    pub megabytes: f64,
    /// How long a busy camera is waited for, seconds.
    #[serde(default = "thirty")]
    pub patience_s: f64,
    /// How codes become light.
    #[serde(default)]
    pub response: ResponseChoice,
}

/// How codes become light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ResponseChoice {
    /// In proportion.
    #[default]
    Linear,
    /// By the sRGB curve.
    Srgb,
    /// By a curve recovered from the session's own series of exposures.
    Recover,
}

/// What is measured beside the object.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationRig {
    /// Exposure times of the series that tells the camera's response; none: no series.
    #[serde(default)]
    pub response_times_s: Vec<f64>,
    /// Exposure times of black photographs that tell the camera's black level; none: it is taken as zero.
    #[serde(default)]
    pub dark_times_s: Vec<f64>,
    /// Pattern sets of a screen or projector: `ramp` (its curve), `gray-code` and `stripes` (which texel a pixel sees, the
    /// matte).
    #[serde(default)]
    pub patterns: Vec<String>,
    /// Photograph a flat white card in the object's place under every lamp: evens out near lamps, which light some pixels more
    /// than others.
    #[serde(default)]
    pub flat_field: bool,
    /// Photograph a colour chart in the object's place under all lamps of the first stop.
    #[serde(default)]
    pub chart: bool,
    /// Photograph a white ball under every lamp of the first stop: the lamps' irradiances.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub white_ball: Option<WhiteBall>,
}

/// A white ball in the object's place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WhiteBall {
    /// Its reflectance.
    pub albedo: f64,
    /// Its middle and radius in the picture, pixels; left out, its outline is found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub circle_px: Option<[f64; 3]>,
    /// Focal length of the lens, pixels; left out, the camera is taken as far away.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focal_px: Option<f64>,
}

/// What virtual devices show.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Simulation {
    /// Columns of the camera.
    pub width: usize,
    /// Rows of the camera.
    pub height: usize,
    /// Camera rays a pixel.
    #[serde(default = "sixteen")]
    pub samples: usize,
    /// Start of all random numbers.
    #[serde(default = "one")]
    pub seed: u64,
    /// What stands before a virtual screen.
    #[serde(default, skip_serializing_if = "SceneChoice::is_mixed")]
    pub scene: SceneChoice,
    /// Irradiance of a lamp on a patch that faces it, in the camera's unit: code white is `irradiance / pi * albedo * time * ISO / 100 / N^2 = 1`.
    pub irradiance: f64,
    /// Lamps differ by so much, standard deviation, as a share.
    #[serde(default)]
    pub spread: f64,
    /// All lamps change by this share from the first photograph of the scan to the last.
    #[serde(default)]
    pub drift: f64,
    /// Radiance of the surroundings with every lamp off, as a share of `irradiance`.
    #[serde(default)]
    pub ambient: f64,
    /// The sensor.
    pub sensor: SensorSettings,
}

impl Default for Simulation {
    /// Of a rig of real devices that leaves the table out; `seed` is that of its patterns.
    fn default() -> Self {
        Self {
            width: 640,
            height: 480,
            samples: sixteen(),
            seed: one(),
            scene: SceneChoice::Mixed,
            irradiance: 800.0,
            spread: 0.0,
            drift: 0.0,
            ambient: 0.0,
            sensor: SensorSettings {
                full_well_e: 30_000.0,
                read_e: 6.0,
                bits: 12,
                dark: 0.0,
                response: SensorResponseChoice::Linear,
            },
        }
    }
}

impl Simulation {
    /// Is it as if the table had been left out?
    pub fn is_left_out(&self) -> bool {
        *self == Self::default()
    }
}

impl RigFile {
    /// Is the light computed? So it is too where real lamps and axes are driven before a virtual camera.
    pub fn is_virtual(&self) -> bool {
        self.devices.as_ref().is_none_or(|devices| devices.camera == CameraDevice::Virtual)
    }

    /// Do the devices of two rigs make the same light of a condition, whatever ports they are plugged into?
    pub fn same_light(&self, other: &Self) -> bool {
        let level = |rig: &Self| {
            let lamps = rig.devices.as_ref().and_then(|devices| devices.lamps.as_ref());
            lamps.map(|lamps| lamps.wiring().level)
        };
        (self.is_virtual(), self.bits(), level(self)) == (other.is_virtual(), other.bits(), level(other))
    }

    /// Columns and rows of the patterns that the screen or projector shows.
    ///
    /// # Errors
    /// A rig without either.
    pub fn texels(&self) -> Result<(usize, usize)> {
        match (&self.monitor, &self.gantry) {
            (Some(monitor), _) => Ok((monitor.columns, monitor.rows)),
            (None, Some(gantry)) => Ok((gantry.pixels(), gantry.pixels())),
            (None, None) => Err(Error::invalid("rig", "no screen and no projector", "one")),
        }
    }

    /// How deep the codes of its screen or projector are.
    pub fn bits(&self) -> Bits {
        match self.devices.as_ref().and_then(|devices| devices.screen.as_ref()).map(|screen| screen.look().bits) {
            Some(10) => Bits::Ten,
            _ => Bits::Eight,
        }
    }
}

/// Bodies before a virtual screen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SceneChoice {
    /// Glass, mirror, glossy and diffuse bodies.
    #[default]
    Mixed,
    /// Coloured cubes on a pale floor before a screen, all diffuse: soft shadows (figure 6.14).
    Diffuse,
    /// A diffuse ball alone under a projector: no light goes over other surfaces (7.5).
    Convex,
    /// A diffuse bowl and a ball under a projector: much does (7.5).
    Bowl,
}

impl SceneChoice {
    /// Is it the usual one?
    pub fn is_mixed(&self) -> bool {
        *self == Self::Mixed
    }

    /// Does it stand where rigs of a kind look?
    pub fn is_for(&self, kind: Kind) -> bool {
        match self {
            Self::Mixed => true,
            Self::Diffuse => kind == Kind::Monitor,
            Self::Convex | Self::Bowl => kind == Kind::Gantry,
        }
    }

    /// As rig files say it.
    pub fn id(&self) -> &'static str {
        match self {
            Self::Mixed => "mixed",
            Self::Diffuse => "diffuse",
            Self::Convex => "convex",
            Self::Bowl => "bowl",
        }
    }
}

/// The curve of a virtual sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SensorResponseChoice {
    /// Codes in proportion to light.
    #[default]
    Linear,
    /// A gamma and an S-curve, as cameras make pictures.
    Film,
}

/// A virtual sensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorSettings {
    /// Electrons at white, ISO 100.
    pub full_well_e: f64,
    /// Noise of reading, electrons.
    pub read_e: f64,
    /// Bits of a code.
    pub bits: u32,
    /// Level of black, as a share of white.
    pub dark: f64,
    /// Its curve.
    #[serde(default)]
    pub response: SensorResponseChoice,
}

fn one_texel() -> usize {
    1
}

fn one() -> u64 {
    1
}

fn sixteen() -> usize {
    16
}

fn four() -> usize {
    4
}

fn noise_count() -> usize {
    256
}

fn functions() -> usize {
    400
}

fn any_light() -> f64 {
    1.0
}

fn sixty() -> f64 {
    60.0
}

fn haar() -> String {
    "haar".to_owned()
}

fn two() -> f64 {
    2.0
}

fn hundred() -> f64 {
    100.0
}

fn eight() -> f64 {
    8.0
}

fn second() -> f64 {
    1.0
}

fn thirty() -> f64 {
    30.0
}
