//! `relume rig check`: every device of a rig, tried once.

use std::fmt::Write;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use relume_core::image::{Image, read_codes};

use super::super::{jog, values};
use crate::capture::patterns::Sets;
use crate::capture::seconds;
use crate::devices::lights::PutOut;
use crate::devices::operator::{AtTerminal, Willing};
use crate::devices::{
    Axes, Camera, Display, Finding, Lights, Operator, Place, Trouble, axes, cameras, displays, lights,
};
use crate::progress::DevicesOn;
use crate::rigs::{CameraDevice, Condition, RigFile, Shown};
use crate::session::Exposure;
use crate::watchdog::Watchdog;

/// How far each axis is moved, degrees: enough to be seen.
const LITTLE_DEG: f64 = 5.0;
/// A photograph with all lamps whose mean code is not this much above the one without shows no light, shares of white.
const LIT: f32 = 0.004;
/// A device is asked again for so long while it is busy.
const PATIENCE: Duration = Duration::from_secs(10);
const PAUSE: Duration = Duration::from_millis(100);

const EXAMPLES: &str = "\
Examples:
  relume rig check stage.toml
  relume rig check stage.toml --photograph lit.jpg --time 1/60
  relume rig check stage.toml --each-lamp
  relume rig check stage.toml --yes --no-axes

Talks to every device; lights each lamp for --flash; moves each axis 5 degrees and back; shows white on a screen; photographs without light
and with all of it, and says whether the camera saw the difference. --each-lamp photographs every lamp and names those that stay dark.
Ends with lamps off and motors held, and with exit code 1 if something does not work.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The rig file.
    rig: PathBuf,
    /// Exposure of the photographs: 1/60 or 0.5, seconds [default: the rig file's first, or the middle of its limits].
    #[arg(long, value_name = "TIME", value_parser = values::exposure_time)]
    time: Option<f64>,
    /// Keep the photograph with all light here [default: in the system's folder for temporary files].
    #[arg(long, value_name = "FILE")]
    photograph: Option<PathBuf>,
    /// Do not open the photograph with the system's viewer.
    #[arg(long)]
    no_show: bool,
    /// Photograph every lamp, and name those that the camera does not see.
    #[arg(long)]
    each_lamp: bool,
    /// How long each lamp is lit, seconds.
    #[arg(long, value_name = "S", default_value_t = 0.3, value_parser = values::seconds)]
    flash: f64,
    /// Leave the axes where they are.
    #[arg(long)]
    no_axes: bool,
    /// Do not ask before axes move.
    #[arg(long)]
    yes: bool,
}

/// What was found of one thing.
struct Row {
    what: String,
    result: Result<String, String>,
}

/// The devices that could be opened.
struct Bench<'a> {
    flags: &'a Arguments,
    rig: &'a RigFile,
    operator: Arc<dyn Operator>,
    rows: Vec<Row>,
}

impl Arguments {
    /// Tries everything; the table is the report.
    ///
    /// # Errors
    /// A bad rig file; the table, if something in it does not work.
    pub fn run(self) -> anyhow::Result<String> {
        let rig = RigFile::read(&self.rig)?;
        let Some(devices) = &rig.devices else {
            anyhow::bail!("{}: no [devices], so all of it is virtual and works", self.rig.display())
        };
        anyhow::ensure!(
            self.photograph.is_none() || devices.camera != CameraDevice::Virtual,
            "--photograph: the rig's camera is virtual"
        );
        let operator: Arc<dyn Operator> = if self.yes { Arc::new(Willing::default()) } else { Arc::new(AtTerminal) };
        let (_watchdog, _on) = (Watchdog::start(&rig)?, DevicesOn::begin());
        let mut bench = Bench { flags: &self, rig: &rig, operator, rows: Vec::new() };
        bench.try_all()?;
        let table = table(&bench.rows);
        let failed = bench.rows.iter().filter(|row| row.result.is_err()).count();
        if failed == 0 {
            return Ok(format!("{}\n\n{table}\nall of it works\n", rig.name));
        }
        crate::complain(&format!("{}\n\n{table}", rig.name));
        Err(anyhow::anyhow!("{failed} of {} things do not work", bench.rows.len()))
    }

    fn exposure(&self, rig: &RigFile) -> Exposure {
        let camera = &rig.camera;
        let [fastest, slowest] = rig.exposure_limits();
        let first = camera.times_s.as_ref().and_then(|times| times.first()).copied();
        let time_s = self.time.or(first).unwrap_or_else(|| (fastest * slowest).sqrt().min(1.0));
        Exposure { time_s, iso: Some(camera.iso), f_number: Some(camera.f_number) }
    }
}

impl Bench<'_> {
    fn try_all(&mut self) -> anyhow::Result<()> {
        let Some(devices) = &self.rig.devices else { return Ok(()) };
        let camera = (devices.camera != CameraDevice::Virtual)
            .then(|| cameras::open(&devices.camera, &std::env::temp_dir(), &self.operator));
        let mut camera = self.opened("camera", camera, |camera| camera.preflight());
        let lights = devices.lamps.as_ref().map(|lamps| lights::open(lamps, self.rig.bulbs()));
        let lights = self.opened("lamps", lights, |lights| lights.preflight());
        // Out on every way from here, Ctrl-C too.
        let mut lights = lights.map(PutOut);
        let display = devices.screen.as_ref().map(|screen| displays::open(screen, self.rig.texels()?));
        let mut display = self.opened("screen", display, |display| display.preflight());
        let axes = devices.axes.as_ref().filter(|_| !self.flags.no_axes).map(|axes| axes::open(axes, &self.operator));
        let mut axes = self.opened("axes", axes, |axes| axes.preflight());
        if let Some(lights) = &mut lights {
            self.flash(&mut *lights.0)?;
        }
        if let Some(axes) = &mut axes {
            self.move_a_little(&mut **axes)?;
        }
        if let Some(camera) = &mut camera {
            self.photograph(&mut **camera, lights.as_mut().map(|lights| &mut *lights.0), display.as_deref_mut())?;
        }
        if let Some(lights) = &mut lights {
            let off = patiently(|| lights.0.dark()).map(|()| "off".to_owned());
            self.row("lamps at the end", off)?;
        }
        Ok(())
    }

    /// Notes whether a device is there, and what it says of itself.
    fn opened<D: ?Sized>(
        &mut self,
        what: &str,
        device: Option<Result<Box<D>, Trouble>>,
        preflight: impl FnOnce(&mut D) -> Vec<Finding>,
    ) -> Option<Box<D>> {
        match device? {
            Err(trouble) => {
                self.rows.push(Row { what: what.to_owned(), result: Err(trouble.to_string()) });
                None
            }
            Ok(mut device) => {
                let found = preflight(&mut device);
                self.rows.extend(found.into_iter().map(|finding| {
                    let (what, text) = finding.text.split_once(": ").unwrap_or((what, &finding.text));
                    let (what, text) = (what.to_owned(), text.to_owned());
                    Row { what, result: if finding.fine { Ok(text) } else { Err(text) } }
                }));
                Some(device)
            }
        }
    }

    /// Notes what came of something; a request to stop ends the check.
    fn row(&mut self, what: &str, result: Result<String, Trouble>) -> anyhow::Result<bool> {
        if let Err(Trouble::Failed(error @ relume_core::Error::Cancelled)) = result {
            return Err(error.into());
        }
        let result = result.map_err(|trouble| trouble.to_string());
        let fine = result.is_ok();
        self.rows.push(Row { what: what.to_owned(), result });
        Ok(fine)
    }

    fn flash(&mut self, lights: &mut dyn Lights) -> anyhow::Result<()> {
        let mut lit = 0;
        for lamp in 0..self.rig.bulbs() {
            let shown = patiently(|| lights.show(&self.levels(Some(lamp)))).and_then(|()| pause(self.flags.flash));
            if let Err(trouble) = shown {
                self.row(&format!("lamp {}", lamp + 1), Err(trouble))?;
            } else {
                lit += 1;
            }
        }
        let off = patiently(|| lights.dark());
        self.row("lamps", off.map(|()| format!("{lit} of {} took their level, then off", self.rig.bulbs())))?;
        Ok(())
    }

    /// One lamp, or all, of a stage.
    fn levels(&self, lamp: Option<usize>) -> Vec<u8> {
        let lamps = self.rig.devices.as_ref().and_then(|devices| devices.lamps.as_ref());
        let on = lamps.map_or(u8::MAX, |lamps| lamps.wiring().level);
        (0..self.rig.bulbs()).map(|n| if lamp.is_none_or(|lamp| lamp == n) { on } else { 0 }).collect()
    }

    fn move_a_little(&mut self, axes: &mut dyn Axes) -> anyhow::Result<()> {
        let begun = self.operator.ask("see that nothing stands in the way of the axes: they are about to move");
        if !self.row("way of the axes", begun.map(|()| "free".to_owned()))? {
            return Ok(());
        }
        let homed = patiently(|| axes.home()).and_then(|()| axes.place());
        let place = homed.as_ref().ok().copied();
        self.row("axes' zero", homed.map(|place| jog::words(&place)))?;
        let Some(place) = place else { return Ok(()) };
        let one = |deg| Place { turntable_deg: Some(deg), arm_deg: None };
        let other = |deg| Place { turntable_deg: None, arm_deg: Some(deg) };
        if let Some(deg) = place.turntable_deg {
            let moved = there_and_back(axes, deg, one);
            self.row("turntable", moved)?;
        }
        if let Some(deg) = place.arm_deg {
            let moved = there_and_back(axes, deg, other);
            self.row("arm", moved)?;
        }
        patiently(|| axes.hold())?;
        Ok(())
    }

    fn photograph(
        &mut self,
        camera: &mut dyn Camera,
        mut lights: Option<&mut (dyn Lights + '_)>,
        mut display: Option<&mut (dyn Display + '_)>,
    ) -> anyhow::Result<()> {
        let exposure = self.flags.exposure(self.rig);
        let folder = tempfile::tempdir()?;
        let set = patiently(|| camera.set(&exposure))
            .map(|took| format!("{} wanted, {} taken", seconds(exposure.time_s), seconds(took.time_s)));
        if !self.row("camera's settings", set)? {
            return Ok(());
        }
        let mut emit = |bench: &Self, lamp: Option<Option<usize>>| -> Result<(), Trouble> {
            if let Some(lights) = lights.as_deref_mut() {
                let levels = lamp.map_or_else(|| vec![0; bench.rig.bulbs()], |lamp| bench.levels(lamp));
                patiently(|| lights.show(&levels))?;
            }
            if let Some(display) = display.as_deref_mut() {
                let shown = Shown::new(bench.rig, Sets::new(), PathBuf::new())?;
                let condition =
                    if lamp.is_some() { Condition::White { stop: 0 } } else { Condition::Black { stop: 0 } };
                patiently(|| display.show(&shown.texels(&condition).map_err(Trouble::from)?))?;
            }
            Ok(())
        };
        let dark = emit(self, None).and_then(|()| take(camera, folder.path(), "dark"));
        let dark = self.seen("photograph without light", dark)?;
        let lit = emit(self, Some(None)).and_then(|()| take(camera, folder.path(), "lit"));
        if let Ok((file, _)) = &lit {
            self.show(file)?;
        }
        let lit = self.seen("photograph with all light", lit)?;
        if let (Some(dark), Some(lit)) = (dark, lit) {
            let said = format!("mean code {:.3} of 1 without, {:.3} with it", dark, lit);
            let stop = |what: &str| {
                Trouble::stop(format!("{said}: {what}"), "check the lamps, the lens cap and the exposure time")
            };
            let verdict = if lit < dark + LIT { Err(stop("no light seen")) } else { Ok(said.clone()) };
            self.row("light seen", verdict)?;
            for lamp in (0..self.rig.bulbs()).filter(|_| self.flags.each_lamp) {
                let shot = emit(self, Some(Some(lamp))).and_then(|()| take(camera, folder.path(), "lamp"));
                let verdict = shot.and_then(|(_, mean)| {
                    let said = format!("mean code {mean:.3}");
                    let unseen =
                        || Trouble::stop(format!("{said}, as dark as without light"), "check its bulb and its channel");
                    if mean < dark + LIT / self.rig.bulbs() as f32 { Err(unseen()) } else { Ok(said.clone()) }
                });
                self.row(&format!("lamp {}", lamp + 1), verdict)?;
            }
        }
        Ok(())
    }

    /// Keeps a photograph, and opens it where somebody sits before a terminal.
    fn show(&mut self, file: &Path) -> anyhow::Result<()> {
        let usual = || {
            let extension = file.extension().unwrap_or_default();
            std::env::temp_dir().join("relume-check").with_extension(extension)
        };
        let kept = self.flags.photograph.clone().unwrap_or_else(usual);
        std::fs::copy(file, &kept).map_err(|source| relume_core::Error::io("write", &kept, source))?;
        let watched = std::io::stdout().is_terminal() && !self.flags.no_show;
        let opened = watched && open::that_detached(&kept).is_ok();
        let said = format!("{}{}", kept.display(), if opened { ", opened" } else { "" });
        self.rows.push(Row { what: "photograph kept".to_owned(), result: Ok(said) });
        Ok(())
    }

    fn seen(&mut self, what: &str, shot: Result<(PathBuf, f32), Trouble>) -> anyhow::Result<Option<f32>> {
        let mean = shot.as_ref().ok().map(|(_, mean)| *mean);
        let name = |file: &Path| file.extension().unwrap_or_default().to_string_lossy().to_uppercase();
        self.row(what, shot.map(|(file, mean)| format!("{} file, mean code {mean:.3} of 1", name(&file))))?;
        Ok(mean)
    }
}

fn there_and_back(axes: &mut dyn Axes, deg: f64, place: impl Fn(f64) -> Place) -> Result<String, Trouble> {
    // Near the upper limit the other way is the one that is free.
    let way = patiently(|| axes.go(place(deg + LITTLE_DEG))).map(|()| LITTLE_DEG);
    let way = match way {
        Err(Trouble::Stop { .. }) => patiently(|| axes.go(place(deg - LITTLE_DEG))).map(|()| -LITTLE_DEG)?,
        other => other?,
    };
    patiently(|| axes.go(place(deg)))?;
    Ok(format!("{way:+} degrees and back"))
}

/// A photograph, and the mean of its codes.
fn take(camera: &mut dyn Camera, folder: &Path, stem: &str) -> Result<(PathBuf, f32), Trouble> {
    patiently(|| camera.expose())?;
    let delivered = patiently(|| camera.download(folder, stem))?;
    let nothing = || Trouble::stop("the camera delivered no file", "check that it stores pictures");
    let file = delivered.files.into_iter().next().ok_or_else(nothing)?;
    let codes = delivered.thumbnail.map_or_else(|| read_codes(&file).map(|(codes, _)| codes), Ok)?;
    Ok((file, mean(&codes)))
}

fn mean(picture: &Image) -> f32 {
    let sum: f64 = picture.data().iter().copied().map(f64::from).sum();
    (sum / picture.data().len().max(1) as f64) as f32
}

/// Asks again while a device is busy.
fn patiently<T>(mut ask: impl FnMut() -> Result<T, Trouble>) -> Result<T, Trouble> {
    let begun = std::time::Instant::now();
    loop {
        crate::progress::check()?;
        match ask() {
            Err(Trouble::Busy(_)) if begun.elapsed() < PATIENCE => std::thread::sleep(PAUSE),
            other => return other,
        }
    }
}

fn pause(seconds: f64) -> Result<(), Trouble> {
    crate::progress::check()?;
    std::thread::sleep(Duration::from_secs_f64(seconds));
    Ok(())
}

fn table(rows: &[Row]) -> String {
    let width = rows.iter().map(|row| row.what.chars().count()).max().unwrap_or_default();
    rows.iter().fold(String::new(), |mut text, Row { what, result }| {
        let (verdict, said) = match result {
            Ok(said) => ("ok    ", said),
            Err(said) => ("FAILED", said),
        };
        let _ = writeln!(text, "  {verdict}  {what:width$}  {said}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_line_up_and_say_what_failed() {
        let rows = [
            Row { what: "camera".to_owned(), result: Ok("Nikon D750".to_owned()) },
            Row { what: "lamp 12".to_owned(), result: Err("no answer".to_owned()) },
        ];
        assert_eq!(table(&rows), "  ok      camera   Nikon D750\n  FAILED  lamp 12  no answer\n");
    }
}
