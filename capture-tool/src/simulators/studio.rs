//! The photograph that a camera would take now of a virtual stage under what the boards do, kept in a file as a camera's card has it.
//!
//! The file has one length throughout (JPEG decoders stop at its end marker; zeros follow), since the virtual PTP camera of
//! libgphoto2 (`vusb`) looks up the length once and reads the bytes anew for each exposure. It is renamed into place, so that no
//! camera delivers a torn one. There is no noise of a sensor in it: what differs from the virtual camera's picture is the JPEG.

use std::fs;
use std::path::{Path, PathBuf};

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use relume_core::image::{Image, srgb};
use relume_core::{Error, Result};

use super::world::Seen;
use crate::rigs::virtual_stage::VirtualStage;
use crate::rigs::{AxesDevice, Axis, Lamps, RigFile};

/// Where a camera keeps its photographs, below its root.
const CARD: &str = "DCIM/100/0001.JPG";
/// Errors of a code or two in smooth parts; the encoder keeps the full resolution of colour.
const QUALITY: u8 = 98;
/// A table this close to a stop is there, degrees: half the error that shows as a pixel at the edge of a picture of 640.
const THERE_DEG: f64 = 0.1;
/// Room for the header beside 3 bytes a pixel, more than any picture takes at this quality.
const HEADER: usize = 1 << 16;

/// The stage, and the file.
pub struct Studio {
    stage: VirtualStage,
    lamps: Lamps,
    table: Option<Axis>,
    channels: Vec<usize>,
    /// The level of a lamp that is on.
    full: f32,
    exposure: f64,
    file: PathBuf,
    /// Being written.
    draft: PathBuf,
    length: usize,
    shown: Option<Shown>,
}

/// What the file shows.
#[derive(Debug, Clone, PartialEq)]
struct Shown {
    levels: Vec<u8>,
    /// Shares of stops.
    stops: Vec<(usize, f32)>,
}

impl Studio {
    /// Of a rig with a stage; the card is in the folder `camera`.
    ///
    /// # Errors
    /// No stage, no exposure time, a folder that cannot be made.
    pub fn new(rig: &RigFile, stage: VirtualStage, camera: &Path) -> Result<Self> {
        let lamps = rig.stage.as_ref().map(|stage| stage.lamps.clone());
        let lamps = lamps.ok_or_else(|| Error::invalid("rig", "no [stage] table", "a stage"))?;
        let time_s = rig.camera.times_s.as_ref().and_then(|times| times.first());
        let time_s = time_s.ok_or_else(|| Error::invalid("rig, times_s", "none", "the time of the photograph"))?;
        let devices = rig.devices.as_ref();
        let wiring = devices.and_then(|devices| devices.lamps.as_ref()).map(|lamps| lamps.wiring().clone());
        let channels = wiring.as_ref().map_or_else(Vec::new, |wiring| wiring.channels(lamps.per_stop()));
        let table = match devices.and_then(|devices| devices.axes.as_ref()) {
            Some(AxesDevice::Grbl { turntable, .. }) => turntable.clone(),
            _ => None,
        };
        let file = camera.join(CARD);
        let folder = relume_core::files::folder_of(&file);
        fs::create_dir_all(folder).map_err(|source| Error::io("create", folder, source))?;
        let (width, height) = (rig.simulation.width, rig.simulation.height);
        Ok(Self {
            stage,
            lamps,
            table,
            channels: channels.iter().map(|channel| usize::from(*channel)).collect(),
            full: f32::from(wiring.map_or(u8::MAX, |wiring| wiring.level).max(1)),
            exposure: time_s * rig.camera.iso / 100.0 / rig.camera.f_number.powi(2),
            draft: camera.join(".next"),
            file,
            length: width * height * 3 + HEADER,
            shown: None,
        })
    }

    /// The channel of this number is the world's first one.
    pub fn counted_from(mut self, first: i64) -> Self {
        let shifted = |channel: usize| usize::try_from(channel as i64 - first).unwrap_or(usize::MAX);
        self.channels.iter_mut().for_each(|channel| *channel = shifted(*channel));
        self
    }

    /// Where the file is.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// Writes the photograph of what is to be seen, unless the file shows it already.
    ///
    /// # Errors
    /// The disk's.
    pub fn photograph(&mut self, seen: &Seen) -> Result<()> {
        let levels =
            self.channels.iter().map(|channel| seen.levels.get(*channel).copied().unwrap_or_default()).collect();
        let shown = Shown { levels, stops: self.stops(seen) };
        if self.shown.as_ref() == Some(&shown) {
            return Ok(());
        }
        let shares: Vec<f32> = shown.levels.iter().map(|level| f32::from(*level) / self.full).collect();
        let mut light: Option<Image> = None;
        for (stop, share) in &shown.stops {
            let part = self.stage.under(&shares, *stop)?;
            let sum = light.get_or_insert_with(|| Image::new(part.width(), part.height(), 3));
            sum.data_mut().iter_mut().zip(part.data()).for_each(|(sum, v)| *sum += share * v);
        }
        if let Some(light) = light {
            self.write(&light)?;
        }
        self.shown = Some(shown);
        Ok(())
    }

    /// Where the table is, in stops. Between two of them both show, as in a photograph of a table that moves.
    fn stops(&self, seen: &Seen) -> Vec<(usize, f32)> {
        let (Some(axis), Lamps::Arc { longitudes, first_deg, span_deg, .. }) = (&self.table, &self.lamps) else {
            return vec![(0, 1.0)];
        };
        let letter = axis.letter.to_ascii_uppercase();
        let at = ['X', 'Y', 'Z', 'A'].iter().position(|known| *known == letter).unwrap_or_default();
        let deg = (seen.at[at] - axis.zero) / axis.per_deg;
        let apart = span_deg / *longitudes as f64;
        let place = (deg - first_deg) / apart;
        let near = place.round();
        let stop = |place: f64| {
            let whole = (*longitudes as f64 * 360.0 / span_deg).round().max(1.0);
            (place.rem_euclid(whole) as usize).min(longitudes - 1)
        };
        if !seen.moving && (place - near).abs() * apart <= THERE_DEG {
            return vec![(stop(near), 1.0)];
        }
        // A table that has just begun to move is seen on its way.
        let share = if seen.moving { 0.5 } else { (place - place.floor()) as f32 };
        vec![(stop(place.floor()), 1.0 - share), (stop(place.floor() + 1.0), share)]
    }

    fn write(&self, light: &Image) -> Result<()> {
        let code =
            |v: &f32| (srgb::encode((f64::from(*v) * self.exposure).clamp(0.0, 1.0) as f32) * 255.0).round() as u8;
        let codes: Vec<u8> = light.data().iter().map(code).collect();
        let mut bytes = Vec::with_capacity(self.length);
        let fail = |source| Error::io("write", &self.file, source);
        JpegEncoder::new_with_quality(&mut bytes, QUALITY)
            .encode(&codes, light.width() as u32, light.height() as u32, ExtendedColorType::Rgb8)
            .map_err(|error| fail(std::io::Error::other(error)))?;
        if bytes.len() > self.length {
            return Err(fail(std::io::Error::other("a JPEG longer than its pixels")));
        }
        bytes.resize(self.length, 0);
        fs::write(&self.draft, &bytes).and_then(|()| fs::rename(&self.draft, &self.file)).map_err(fail)
    }
}
