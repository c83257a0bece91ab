//! One photograph: emit, expose at each time, store. Busy devices are asked again with growing pauses.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use relume_core::image::Image;

use super::Step;
use crate::devices::{Camera, Trouble};
use crate::progress;
use crate::rigs::Rig;
use crate::session::{Exposure, PhotoFolder};

/// The first pause; each is twice the one before.
const FIRST_PAUSE: Duration = Duration::from_millis(20);
const LONGEST_PAUSE: Duration = Duration::from_secs(2);
/// Times that read back this far from what was asked for are another setting: a sixth of a stop, half the step of cameras that
/// know thirds.
const SAME_SETTING_STOPS: f64 = 1.0 / 6.0;

/// What drives a photograph.
pub struct Set<'a> {
    /// The rig.
    pub rig: &'a mut dyn Rig,
    /// The camera.
    pub camera: &'a mut dyn Camera,
    /// How long busy devices are waited for.
    pub patience: Duration,
    /// How often a device was busy: for the log.
    pub waited: u32,
}

/// A frame.
pub struct Shot {
    /// The file that counts.
    pub file: PathBuf,
    /// Others of the same exposure.
    pub beside: Vec<PathBuf>,
    /// As read back.
    pub exposure: Exposure,
    /// Codes, small.
    pub thumbnail: Option<Arc<Image>>,
}

impl Set<'_> {
    /// Photographs a step into a folder, a frame a setting.
    ///
    /// # Errors
    /// What the devices cannot do, in a sentence.
    pub fn photograph(
        &mut self,
        step: &Step,
        settings: &[Exposure],
        folder: &PhotoFolder,
    ) -> Result<Vec<Shot>, Trouble> {
        self.patiently(|set| set.rig.emit(step))?;
        let mut shots = Vec::new();
        for (n, wanted) in settings.iter().enumerate() {
            // A second request to stop does not wait for a long bracket.
            progress::check_urgent()?;
            let exposure = self.set(wanted)?;
            self.patiently(|set| set.camera.expose())?;
            // A dial that was turned between setting and exposing is seen here.
            let after = self.patiently(|set| set.camera.setting())?;
            let stem = format!("{:06}-{}", folder.number(), n + 1);
            let delivered = self.patiently(|set| set.camera.download(folder.path(), &stem))?;
            for (said, who) in [(after, "the camera"), (delivered.exposure, "its file")] {
                if let Some(other) = said.filter(|said| !same(wanted, said)) {
                    return Err(Trouble::stop(
                        format!(
                            "the camera was set to {}, and after the exposure {who} says {}",
                            words(wanted),
                            words(&other)
                        ),
                        "nobody may touch its dials during a capture; put it back in manual mode",
                    ));
                }
            }
            let exposure = delivered.exposure.unwrap_or(exposure);
            let mut files = delivered.files.into_iter();
            let Some(file) = files.next() else {
                return Err(Trouble::stop(
                    "the camera delivered no file",
                    "check that it stores pictures and that its card has room",
                ));
            };
            let thumbnail = delivered.thumbnail.map(Arc::new);
            shots.push(Shot { file, beside: files.collect(), exposure, thumbnail });
        }
        self.patiently(|set| set.rig.confirm())?;
        Ok(shots)
    }

    /// Sets the camera and believes what it reads back; asks twice when that is something else.
    fn set(&mut self, wanted: &Exposure) -> Result<Exposure, Trouble> {
        let mut took = self.patiently(|set| set.camera.set(wanted))?;
        if !same(wanted, &took) {
            took = self.patiently(|set| set.camera.set(wanted))?;
        }
        if same(wanted, &took) {
            return Ok(took);
        }
        Err(Trouble::Stop {
            what: format!("the camera was set to {} and reads back {}", words(wanted), words(&took)),
            advice: "put it in manual mode, without automatic ISO, or correct the times in the rig file".to_owned(),
        })
    }

    /// Asks until the device is no longer busy, patience ends, or somebody asks to stop.
    fn patiently<T>(&mut self, mut ask: impl FnMut(&mut Self) -> Result<T, Trouble>) -> Result<T, Trouble> {
        let (begun, mut pause) = (Instant::now(), FIRST_PAUSE);
        loop {
            match ask(self) {
                Err(Trouble::Busy(what)) if begun.elapsed() >= self.patience => {
                    return Err(Trouble::Stop {
                        what: format!("{what}, for {} seconds now", self.patience.as_secs_f64()),
                        advice: "wait until it rests, or switch it off and on".to_owned(),
                    });
                }
                Err(Trouble::Busy(_)) => {
                    progress::check_urgent()?;
                    self.waited += 1;
                    std::thread::sleep(pause.min(self.patience.saturating_sub(begun.elapsed())));
                    pause = (pause * 2).min(LONGEST_PAUSE);
                }
                other => return other,
            }
        }
    }
}

fn same(wanted: &Exposure, took: &Exposure) -> bool {
    let close = |a: f64, b: f64| (a / b).log2().abs() <= SAME_SETTING_STOPS;
    let known = |a: Option<f64>, b: Option<f64>| a.zip(b).is_none_or(|(a, b)| close(a, b));
    close(wanted.time_s, took.time_s) && known(wanted.iso, took.iso) && known(wanted.f_number, took.f_number)
}

/// As in "1/60 s, ISO 100, f/8".
pub fn words(exposure: &Exposure) -> String {
    let mut text = seconds(exposure.time_s);
    if let Some(iso) = exposure.iso {
        text += &format!(", ISO {iso}");
    }
    if let Some(f_number) = exposure.f_number {
        text += &format!(", f/{f_number}");
    }
    text
}

/// As photographers write times.
pub fn seconds(time_s: f64) -> String {
    if time_s < 0.4 { format!("1/{:.0} s", 1.0 / time_s) } else { format!("{} s", (time_s * 10.0).round() / 10.0) }
}
