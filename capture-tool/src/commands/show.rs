//! `relume show`: a pattern, a picture, a grey or a chart on a screen or projector, for setting it up.

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use relume_core::files::{check_folder, write_whole};
use relume_core::image::{Encoding, encode_png16, probe_size, read};
use relume_core::{Error, Result};

use super::{note, values};
use crate::capture::patterns::{Samples, sets};
use crate::devices::displays::{self, Layout, Panel, charts};
use crate::devices::{Finding, Texels, Trouble};
use crate::progress;
use crate::rigs::{Condition, RigFile, ScreenDevice, ScreenLook, Shown};

const EXAMPLES: &str = "\
Examples:
  relume show grid --output HDMI-1
  relume show focus --rig rig.toml
  relume show gray:0.5 --rig rig.toml
  relume show noise:12 --rig rig.toml --for 30s
  relume show gray-code:3 --rig rig.toml
  relume show sunset.png --driver window
  relume show grid:64 --to grid.png --size 1920x1200

What:
  grid, grid:N  border one pixel inside the edge, a line every N pixels, cross, circles, greys;
                corners red (top left), green (top right), yellow (bottom right), blue
  focus         stars, lines 1, 2 and 3 pixels wide, single pixels, small letters
  white, black, red, green, blue
  gray:X        the code X of white, 0 to 1: gray:0.5 is 128 of 255. Codes are not light:
                through the sRGB curve this one is 0.21 of white's
  SET:N         pattern N, from 1, of the rig's noise, wavelet, squares, hv, gray-code,
                stripes or ramp
  FILE          a picture: its numbers are codes, each pixel as many of the output's as fit;
                larger pictures are thinned out

Charts and pictures have the whole output. Greys, colours and patterns of a --rig are where its
captures show them. Enter ends it, and Escape in the window.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// What to show: see below.
    #[arg(value_name = "WHAT", value_parser = what)]
    what: What,
    /// The rig whose screen shows it (`screen` under `[devices]`), and whose patterns are meant.
    #[arg(long, value_name = "RIG.toml", conflicts_with_all = ["output", "driver"])]
    rig: Option<PathBuf>,
    /// The output, or a part of its name, as `relume devices` lists it [default: the only one].
    #[arg(long, value_name = "NAME")]
    output: Option<String>,
    /// How it is driven [default: x11 under X11, else window].
    #[arg(long, value_enum)]
    driver: Option<DriverChoice>,
    /// End after this time: 10s, 5m.
    #[arg(long = "for", value_name = "TIME", value_parser = values::duration)]
    time: Option<Duration>,
    /// Write the picture in place of showing it: codes, 16 bits.
    #[arg(long, value_name = "FILE.png", conflicts_with_all = ["output", "driver", "time"])]
    to: Option<PathBuf>,
    /// With --to: pixels of the output.
    #[arg(long, value_name = "WxH", requires = "to", default_value = "1920x1080", value_parser = values::grid)]
    size: (usize, usize),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum DriverChoice {
    /// X11, each picture confirmed.
    X11,
    /// A full-screen window.
    Window,
}

/// What to show.
#[derive(Debug, Clone, PartialEq)]
enum What {
    Grid(Option<usize>),
    Focus,
    /// Shares of white's code.
    Plain([f64; 3]),
    /// From 0.
    Pattern(&'static str, usize),
    Picture(PathBuf),
}

/// Sets by their names, and which samples have them; without samples they are of the calibration.
const SETS: [(&str, Option<Samples>); 7] = [
    ("noise", Some(Samples::Noise)),
    ("wavelet", Some(Samples::Functions)),
    ("squares", Some(Samples::Squares)),
    ("hv", Some(Samples::Crossed)),
    ("gray-code", None),
    ("stripes", None),
    ("ramp", None),
];
/// Longest side of a picture, pixels.
const LONGEST_SIDE: usize = 1 << 14;
/// How often what is shown is looked after.
const LOOK: Duration = Duration::from_millis(500);

fn what(text: &str) -> std::result::Result<What, String> {
    let (name, value) = text.split_once(':').map_or((text, None), |(name, value)| (name, Some(value)));
    if let Some((set, _)) = SETS.iter().find(|(set, _)| *set == name) {
        let number = value.ok_or_else(|| format!("which one? Patterns count from 1, as in {set}:1"))?;
        return values::at_least_one(number).map(|number| What::Pattern(set, number - 1));
    }
    let plain = |colour: [f64; 3]| Ok(What::Plain(colour));
    match (name, value) {
        ("grid", None) => Ok(What::Grid(None)),
        ("grid", Some(step)) => values::at_least_one(step).map(|step| What::Grid(Some(step))),
        ("focus", None) => Ok(What::Focus),
        ("white", None) => plain([1.0; 3]),
        ("black", None) => plain([0.0; 3]),
        ("red", None) => plain([1.0, 0.0, 0.0]),
        ("green", None) => plain([0.0, 1.0, 0.0]),
        ("blue", None) => plain([0.0, 0.0, 1.0]),
        ("gray" | "grey", Some(share)) => values::share(share).map(|share| What::Plain([share; 3])),
        ("gray" | "grey", None) => Err("how much? A share of white's code, as in gray:0.5".to_owned()),
        _ => {
            let path = Path::new(text);
            if path.exists() || path.extension().is_some() {
                return Ok(What::Picture(path.to_owned()));
            }
            let known: Vec<&str> = SETS.iter().map(|(set, _)| *set).collect();
            Err(format!(
                "no such file, nor one of grid, focus, white, black, red, green, blue, gray:0.5, or a pattern such as noise:1 ({})",
                known.join(", ")
            ))
        }
    }
}

/// Checked flags.
struct Plan {
    what: What,
    rig: Option<RigFile>,
    device: ScreenDevice,
}

impl Arguments {
    /// Shows, or writes.
    ///
    /// # Errors
    /// A rig without a screen or without such a pattern; what the output cannot do; `Cancelled` after Ctrl-C.
    pub fn run(self) -> anyhow::Result<String> {
        let plan = self.plan()?;
        match &self.to {
            Some(path) => plan.write(path, self.size),
            None => plan.show(self.time),
        }
    }

    fn plan(&self) -> anyhow::Result<Plan> {
        let rig = self.rig.as_deref().map(RigFile::read).transpose()?;
        let screen = rig.as_ref().and_then(|rig| rig.devices.as_ref()).and_then(|devices| devices.screen.clone());
        let place = || self.rig.as_deref().map_or_else(String::new, |path| path.display().to_string());
        anyhow::ensure!(
            self.to.is_some() || rig.is_none() || screen.is_some(),
            "{}: no screen under [devices]; name an output in place of the rig, or write the picture with --to",
            place()
        );
        if let What::Pattern(set, _) = self.what {
            anyhow::ensure!(rig.is_some(), "{set} is a set of a rig's patterns: name its file with --rig");
        }
        if let Some(path) = &self.to {
            let named_png = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
            anyhow::ensure!(named_png, "--to {}: pictures of codes are written as .png", path.display());
            anyhow::ensure!(
                self.size.0.min(self.size.1) > 0 && self.size.0.max(self.size.1) <= LONGEST_SIDE,
                "--size {}x{}: sides of 1 to {LONGEST_SIDE} pixels",
                self.size.0,
                self.size.1
            );
            check_folder(path)?;
        }
        if let What::Picture(path) = &self.what {
            probe_size(path)?;
        }
        Ok(Plan { what: self.what.clone(), rig, device: screen.unwrap_or_else(|| self.device()) })
    }

    /// Of flags alone.
    fn device(&self) -> ScreenDevice {
        let look = ScreenLook { output: self.output.clone(), texel_px: None, bits: 8, settle_s: 0.0, any_gamma: false };
        let usual = if displays::is_x11() { DriverChoice::X11 } else { DriverChoice::Window };
        match self.driver.unwrap_or(usual) {
            DriverChoice::X11 => ScreenDevice::X11 { display: None, look },
            DriverChoice::Window => ScreenDevice::Window { look },
        }
    }
}

impl Plan {
    /// The codes, and how they lie on an output of a size.
    fn picture(&self, place: &str, output: (usize, usize)) -> anyhow::Result<(Texels, Layout)> {
        let look = self.device.look();
        let white = if look.bits > 8 { 1023 } else { 255 };
        let code = |share: f64| (share * f64::from(white)).round() as u16;
        // Where a capture of the rig shows its patterns; else all of the output.
        let (texels, texel_px) = match &self.rig {
            Some(rig) => (rig.texels()?, look.texel_px),
            None => (output, None),
        };
        let (texels, texel_px) = match &self.what {
            What::Grid(step) => {
                (charts::grid(output, step.unwrap_or_else(|| charts::usual_step(output)), white), Some(1))
            }
            What::Focus => (charts::focus(output, white), Some(1)),
            What::Plain(colour) => (Texels::plain(texels, white, colour.map(code)), texel_px),
            What::Pattern(set, number) => (self.pattern(set, *number)?, texel_px),
            What::Picture(path) => (picture(path, output, white)?, None),
        };
        let layout = Layout::new(place, (texels.columns, texels.rows), output, texel_px)?;
        Ok((texels, layout))
    }

    /// A pattern of the rig, as its captures show it.
    fn pattern(&self, set: &str, number: usize) -> anyhow::Result<Texels> {
        let Some(rig) = &self.rig else {
            anyhow::bail!("{set} is a set of a rig's patterns: name its file with --rig")
        };
        let samples = SETS.iter().find(|(name, _)| *name == set).and_then(|(_, samples)| *samples);
        let mut rig = rig.clone();
        rig.calibration.patterns = if samples.is_none() { vec![set.to_owned()] } else { Vec::new() };
        let sets = sets(&rig, samples.unwrap_or(Samples::Bare), rig.simulation.seed)?;
        let count = sets.get(set).map_or(0, |set| set.len());
        if number >= count {
            let found = format!("{set} {}", number + 1);
            let expected =
                if count == 0 { "a set that this rig shows".to_owned() } else { format!("{set} 1 to {count}") };
            return Err(Error::invalid("the pattern", found, expected).into());
        }
        let condition = Condition::Pattern { set: set.to_owned(), number, stop: 0 };
        Ok(Shown::new(&rig, sets, PathBuf::new())?.texels(&condition)?)
    }

    fn write(&self, path: &Path, size: (usize, usize)) -> anyhow::Result<String> {
        let (texels, layout) = self.picture("the picture (--size)", size)?;
        let full = |code: u16| (u32::from(code) * 65535 / u32::from(texels.white.max(1))) as u16;
        let mut codes = vec![0; 3 * size.0 * size.1];
        for (at, pixel) in codes.chunks_exact_mut(3).enumerate() {
            if let Some((x, y)) = layout.texel(at % size.0, at / size.0) {
                pixel.copy_from_slice(&texels.codes[y * texels.columns + x].map(full));
            }
        }
        let bytes = encode_png16(size.0, size.1, &codes)?;
        write_whole(path, |out| out.write_all(&bytes).map_err(|source| Error::io("write", path, source)))?;
        Ok(format!("{}: {}\n", path.display(), words(&texels, &layout)))
    }

    fn show(&self, time: Option<Duration>) -> anyhow::Result<String> {
        let mut panel = displays::panel(&for_set_up(&self.device))?;
        let (texels, layout) = self.picture(&panel.name(), panel.size())?;
        let findings: Vec<Finding> = panel.preflight();
        if let Some(missing) = findings.iter().find(|finding| !finding.fine) {
            anyhow::bail!("{}", missing.text);
        }
        findings.iter().for_each(|finding| note(&finding.text));
        panel.take_keys()?;
        let entered = time.is_none().then(line_entered);
        if time.is_none() && std::io::stdin().is_terminal() {
            note("Enter ends it");
        }
        let begun = Instant::now();
        let over = || time.is_some_and(|time| begun.elapsed() >= time);
        let closed = shown_until(&mut *panel, (&texels, &layout), || {
            over() || entered.as_ref().is_some_and(|entered| entered.try_recv().is_ok())
        })?;
        let end = if closed { ", closed" } else { "" };
        Ok(format!("{}: {}{end}\n", panel.name(), words(&texels, &layout)))
    }
}

/// Shows until somebody ends it; says whether that was in the window. What goes away by itself is waited for.
fn shown_until(
    panel: &mut dyn Panel,
    (texels, layout): (&Texels, &Layout),
    over: impl Fn() -> bool,
) -> anyhow::Result<bool> {
    let mut there = false;
    loop {
        let stepped = if there { panel.still() } else { panel.put(texels, layout) };
        there = match stepped {
            Ok(()) => true,
            Err(Trouble::Busy(_)) => false,
            Err(_) if panel.is_closed() => return Ok(true),
            Err(trouble) => return Err(trouble.into()),
        };
        let pause = Instant::now();
        while pause.elapsed() < LOOK {
            progress::check()?;
            if over() {
                return Ok(false);
            }
            match panel.rest(Duration::from_millis(20)) {
                Err(_) if panel.is_closed() => return Ok(true),
                other => other?,
            }
        }
    }
}

/// What bends codes is told and does not keep anybody from setting up.
fn for_set_up(device: &ScreenDevice) -> ScreenDevice {
    let mut device = device.clone();
    match &mut device {
        ScreenDevice::X11 { look, .. } | ScreenDevice::Window { look } => look.any_gamma = true,
    }
    device
}

/// Tells when a line is entered. The end of the input is none: who starts this from a script gives it no terminal.
fn line_entered() -> Receiver<()> {
    let (tell, entered) = channel();
    std::thread::spawn(move || {
        if std::io::stdin().read_line(&mut String::new()).is_ok_and(|count| count > 0) {
            let _ = tell.send(());
        }
    });
    entered
}

fn words(texels: &Texels, layout: &Layout) -> String {
    let (width, height) = layout.output;
    let each = layout.texel_px;
    format!("{} x {} texels of {each} x {each} pixels, of {width} x {height}", texels.columns, texels.rows)
}

/// A picture's numbers as codes; one that is larger than the output is thinned out until it fits.
fn picture(path: &Path, output: (usize, usize), white: u16) -> Result<Texels> {
    let picture = read(path, Encoding::Linear)?.into_rgb();
    let (width, height) = picture.size();
    let shrink = (output.0 as f64 / width as f64).min(output.1 as f64 / height as f64).min(1.0);
    let side = |length: usize| ((length as f64 * shrink).floor() as usize).max(1);
    let (columns, rows) = (side(width), side(height));
    let code = |v: f32| (v.clamp(0.0, 1.0) * f32::from(white)).round() as u16;
    let texel = |at: usize| {
        let (x, y) = (at % columns, at / columns);
        let pixel = picture.pixel((2 * x + 1) * width / (2 * columns), (2 * y + 1) * height / (2 * rows));
        [code(pixel[0]), code(pixel[1]), code(pixel[2])]
    };
    Ok(Texels { columns, rows, white, codes: (0..columns * rows).map(texel).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::testing;

    #[test]
    fn what_is_shown_is_understood_or_refused() {
        assert_eq!(what("gray:0.5"), Ok(What::Plain([0.5; 3])));
        assert_eq!(what("grey:1"), Ok(What::Plain([1.0; 3])));
        assert_eq!(what("noise:12"), Ok(What::Pattern("noise", 11)));
        assert_eq!(what("grid:64"), Ok(What::Grid(Some(64))));
        for (bad, words) in [
            ("gray", "gray:0.5"),
            ("gray:2", "0 to 1"),
            ("gray:0,5", "decimal dot"),
            ("noise", "noise:1"),
            ("noise:0", "at least 1"),
            ("grid:0", "at least 1"),
            ("nothing", "no such file"),
            ("white:1", "no such file"),
        ] {
            let said = what(bad).unwrap_err();
            assert!(said.contains(words), "{bad}: {said}");
        }
        for line in ["show grid --rig a.toml --output b", "show grid --size 4x4", "show grid --to a.png --for 1s"] {
            assert!(testing::parse::<Arguments>(line).is_err(), "{line}");
        }
    }

    #[test]
    fn colours_and_patterns_lie_where_captures_show_them() {
        let path = Path::new("presets/rigs/virtual-monitor.toml");
        let text = std::fs::read_to_string(Path::new("..").join(path)).unwrap();
        let screen = "[devices]\ncamera = { driver = \"virtual\" }\nscreen = { driver = \"x11\", bits = 10 }\n";
        let rig = Some(RigFile::parse(&format!("{text}\n{screen}"), path).unwrap());
        let look = ScreenLook { output: None, texel_px: Some(2), bits: 10, settle_s: 0.0, any_gamma: false };
        let device = ScreenDevice::X11 { display: None, look };
        let plan = |what: What, rig: &Option<RigFile>| Plan { what, rig: rig.clone(), device: device.clone() };
        let output = (640, 480);
        let picture = |what: What| plan(what, &rig).picture("p", output).unwrap();
        let (grey, layout) = picture(What::Plain([0.5; 3]));
        assert_eq!((layout.texel_px, layout.texels, grey.codes[7]), (2, (128, 128), [512; 3]));
        let (noise, placed) = picture(What::Pattern("noise", 3));
        assert_eq!(placed, layout);
        assert!(noise.codes.iter().any(|code| *code != noise.codes[0]));
        let (chart, whole) = picture(What::Grid(None));
        assert_eq!((whole.texel_px, whole.texels, chart.white), (1, output, 1023));
        let (whole, _) = plan(What::Plain([1.0; 3]), &None).picture("p", output).unwrap();
        assert_eq!((whole.columns, whole.rows), output);
        let said = plan(What::Pattern("noise", 256), &rig).picture("p", output).unwrap_err().to_string();
        assert!(said.contains("noise 257") && said.contains("1 to 256"), "{said}");
        let (codes, _) = picture(What::Pattern("ramp", 100));
        assert_eq!(codes.codes[0], [401; 3], "round(100 / 255 x 1023)");
    }
}
