//! A camera that photographs a virtual rig: what the rig shows, through a [`Sensor`], as 16-bit PNG files.

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use relume_core::Error;
use relume_core::image::{Image, encode_png16};
use relume_core::simulate::{Codes, Sensor};

use crate::devices::rehearsal::Fault;
use crate::devices::{Camera, Delivered, Finding, Trouble};
use crate::session::Exposure;

/// Columns or rows of a thumbnail, at most.
const THUMBNAIL: usize = 160;
/// A slow camera delivers a file in so many pieces, with a pause after each.
const SLOW_PIECES: usize = 10;
const SLOW_PAUSE: Duration = Duration::from_millis(2);
/// Answers "busy" in a row, when that is rehearsed.
const BUSY_CALLS: u64 = 3;

/// What a virtual rig shows now.
#[derive(Debug, Clone)]
pub struct View {
    /// Light at each pixel, per relative exposure.
    pub light: Arc<Image>,
    /// Start of the noise: the same for the same step, whenever it is photographed.
    pub seed: u64,
}

/// Where the rig leaves what it shows, and the camera finds it.
pub type Window = Arc<Mutex<Option<View>>>;

/// What is before the lens.
pub fn look(window: &Window) -> Option<View> {
    window.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

/// The camera.
#[derive(Debug)]
pub struct VirtualCamera {
    sensor: Sensor,
    window: Window,
    setting: Option<Exposure>,
    /// Exposures of this run.
    count: u64,
    busy: u64,
    faults: Vec<Fault>,
    exposed: Option<Codes>,
}

impl VirtualCamera {
    /// Photographs what is left in `window`.
    pub fn new(sensor: Sensor, window: Window, faults: &[Fault]) -> Self {
        Self { sensor, window, setting: None, count: 0, busy: 0, faults: faults.to_vec(), exposed: None }
    }

    /// Does a fault strike at the exposure that comes next?
    fn strikes(&self, fault: impl Fn(&Fault, u64) -> bool) -> bool {
        self.faults.iter().any(|f| fault(f, self.count + 1))
    }

    fn answer(&mut self) -> Result<(), Trouble> {
        if self.strikes(|f, n| matches!(f, Fault::Unplug(at) if n >= *at)) {
            return Err(Trouble::Stop {
                what: "the camera does not answer".to_owned(),
                advice: "check its cable, its battery, and that no other program holds it".to_owned(),
            });
        }
        let stuck = self.strikes(|f, n| matches!(f, Fault::Stuck(at) if n >= *at));
        let busy = self.strikes(|f, n| matches!(f, Fault::Busy(at) if n == *at)) && self.busy < BUSY_CALLS;
        if stuck || busy {
            self.busy += 1;
            return Err(Trouble::Busy("the camera is busy".to_owned()));
        }
        Ok(())
    }
}

impl Camera for VirtualCamera {
    fn preflight(&mut self) -> Vec<Finding> {
        match self.answer() {
            Err(trouble @ Trouble::Stop { .. }) => vec![Finding::missing(format!("camera: {trouble}"))],
            _ => vec![Finding::fine(format!("camera: virtual, {} bits", self.sensor.bits))],
        }
    }

    fn set(&mut self, wanted: &Exposure) -> Result<Exposure, Trouble> {
        self.answer()?;
        let wrong = self.strikes(|f, n| matches!(f, Fault::Misread(at) if n >= *at));
        let took = Exposure { time_s: if wrong { wanted.time_s * 2.0 } else { wanted.time_s }, ..*wanted };
        self.setting = Some(took);
        Ok(took)
    }

    fn setting(&mut self) -> Result<Option<Exposure>, Trouble> {
        Ok(self.setting)
    }

    fn expose(&mut self) -> Result<(), Trouble> {
        self.answer()?;
        let nothing =
            |what: &str| Trouble::Stop { what: what.to_owned(), advice: "this is a mistake in relume".to_owned() };
        let setting = self.setting.ok_or_else(|| nothing("the camera was given no exposure time"))?;
        let view = look(&self.window).ok_or_else(|| nothing("the virtual rig shows nothing"))?;
        let iso = setting.iso.unwrap_or(100.0);
        let exposure = setting.time_s * iso / 100.0 / setting.f_number.unwrap_or(1.0).powi(2);
        // Different noise at different exposures, the same for the same one.
        let seed = view.seed ^ setting.time_s.to_bits().rotate_left(17);
        self.exposed = Some(self.sensor.expose(&view.light, exposure, iso, seed));
        self.count += 1;
        self.busy = 0;
        Ok(())
    }

    fn download(&mut self, folder: &Path, stem: &str) -> Result<Delivered, Trouble> {
        let Some(codes) = self.exposed.take() else {
            return Err(Trouble::Busy("the camera has no picture yet".to_owned()));
        };
        let path = folder.join(format!("{stem}.png"));
        let fail = |source| Trouble::Failed(Error::io("write", &path, source));
        if self.faults.contains(&Fault::FullDisk(self.count)) {
            return Err(fail(std::io::Error::from(std::io::ErrorKind::StorageFull)));
        }
        let bytes = encode_png16(codes.width, codes.height, &codes.data)?;
        let slow = self.faults.iter().any(|f| matches!(f, Fault::Slow(at) if self.count >= *at));
        let piece = if slow { bytes.len().div_ceil(SLOW_PIECES) } else { bytes.len() };
        let mut file = File::create(&path).map_err(fail)?;
        for piece in bytes.chunks(piece.max(1)) {
            file.write_all(piece).map_err(fail)?;
            if slow {
                std::thread::sleep(SLOW_PAUSE);
            }
        }
        Ok(Delivered { files: vec![path.clone()], thumbnail: Some(thumbnail(&codes)), exposure: None })
    }
}

/// Every k-th pixel.
fn thumbnail(codes: &Codes) -> Image {
    let step = codes.width.max(codes.height).div_ceil(THUMBNAIL).max(1);
    Image::from_fn(codes.width.div_ceil(step), codes.height.div_ceil(step), |x, y| {
        let at = (y * step * codes.width + x * step) * 3;
        std::array::from_fn(|c| f32::from(codes.data[at + c]) / 65535.0)
    })
}
