//! `relume rig new`: questions, and a rig file that explains itself.

use std::fmt::{Display, Write as _};
use std::io::{BufRead, IsTerminal, Write as _};
use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use relume_core::files::write_whole;
use relume_core::{Error, Result};

use crate::progress;
use crate::rigs::RigFile;

const EXAMPLES: &str = "\
Examples:
  relume rig new stage.toml
  relume rig new stage.toml --force

Enter takes the answer in brackets. `relume devices` lists the names of ports, cameras and screens. Then: relume rig check stage.toml.
Questions are asked on the standard error and answers read from the standard input, a line each, so that they can come from a file.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The file to write.
    file: PathBuf,
    /// Replace a file that is there.
    #[arg(long)]
    force: bool,
}

impl Arguments {
    /// Asks, writes, and reads back what was written.
    ///
    /// # Errors
    /// A file that is there already; answers that end; the disk's.
    pub fn run(self) -> anyhow::Result<String> {
        anyhow::ensure!(
            self.force || !self.file.exists(),
            "{}: there already; --force replaces it",
            self.file.display()
        );
        let stdin = std::io::stdin();
        let shown = stdin.is_terminal();
        let mut questions = Questions { answers: &mut stdin.lock(), screen: &mut std::io::stderr(), asked: 0, shown };
        let text = questions.rig()?;
        RigFile::parse(&text, &self.file)?;
        write_whole(&self.file, |out| {
            out.write_all(text.as_bytes()).map_err(|source| Error::io("write", &self.file, source))
        })?;
        let file = self.file.display();
        Ok(format!("{file}: written; it explains its keys\nnext: relume rig check {file}\n"))
    }
}

/// Questions that were asked, and where answers come from.
struct Questions<'a> {
    answers: &'a mut dyn BufRead,
    screen: &'a mut dyn std::io::Write,
    asked: usize,
    /// A person reads along: a wrong answer is asked for again.
    shown: bool,
}

/// More wrong answers than this are no person.
const PATIENCE: usize = 5;

impl Questions<'_> {
    /// An answer that `accept` takes; Enter is `usual`.
    fn ask<T>(
        &mut self,
        question: &str,
        usual: &str,
        accept: impl Fn(&str) -> std::result::Result<T, String>,
    ) -> Result<T> {
        let mut said = String::new();
        for _ in 0..PATIENCE {
            progress::check()?;
            let brackets = if usual.is_empty() { String::new() } else { format!(" [{usual}]") };
            let _ = write!(self.screen, "{question}{brackets}: ").and_then(|()| self.screen.flush());
            self.asked += 1;
            let mut line = String::new();
            let read = self.answers.read_line(&mut line).map_err(|source| Error::io("read", "the answers", source))?;
            if read == 0 {
                let found = format!("no answer to question {} ({question})", self.asked);
                return Err(Error::invalid("the answers", found, "a line for each question"));
            }
            let answer = if line.trim().is_empty() { usual } else { line.trim() };
            match accept(answer) {
                Ok(value) => return Ok(value),
                Err(wrong) => {
                    let _ = writeln!(self.screen, "  {answer}: {wrong}");
                    said = wrong;
                }
            }
            if !self.shown {
                break;
            }
        }
        Err(Error::invalid("the answers", format!("a wrong one to `{question}`"), said))
    }

    fn text(&mut self, question: &str, usual: &str) -> Result<String> {
        self.ask(question, usual, |answer| {
            if answer.is_empty() { Err("an answer is needed".to_owned()) } else { Ok(answer.to_owned()) }
        })
    }

    fn number<T: FromStr + PartialOrd + Display>(&mut self, question: &str, usual: T, range: [T; 2]) -> Result<T> {
        let [low, high] = &range;
        self.ask(question, &usual.to_string(), |answer| match answer.parse::<T>() {
            Ok(value) if value >= *low && value <= *high => Ok(value),
            _ => Err(format!("a number from {low} to {high}")),
        })
    }

    fn choice(&mut self, question: &str, options: &[&'static str]) -> Result<&'static str> {
        let listed = format!("{question} ({})", options.join(", "));
        self.ask(&listed, options[0], |answer| {
            let found = options.iter().find(|option| option.eq_ignore_ascii_case(answer));
            found.copied().ok_or_else(|| format!("one of {}", options.join(", ")))
        })
    }

    fn yes(&mut self, question: &str) -> Result<bool> {
        Ok(self.choice(question, &["yes", "no"])? == "yes")
    }

    /// The whole file.
    fn rig(&mut self) -> Result<String> {
        let name = self.text("What is the rig called", "Our rig")?;
        let kind = self.choice("What gives light", &["stage", "monitor", "gantry"])?;
        let mut text = String::new();
        let _ = writeln!(
            text,
            "# Written by `relume rig new`. Keys that are left out, and what the others mean: presets/rigs/virtual-{kind}.toml,"
        );
        let _ = writeln!(text, "# and presets/rigs/stage-devices.toml for [devices].\n\nversion = 1");
        let _ = writeln!(text, "name = {}\nkind = \"{kind}\"\n", quoted(&name));
        let (tables, devices) = match kind {
            "stage" => self.stage()?,
            "monitor" => self.monitor()?,
            _ => self.gantry()?,
        };
        text += &tables;
        text += &self.camera_table()?;
        text += "\n[devices]\n";
        text += &self.camera_device()?;
        text += &devices;
        Ok(text)
    }

    fn stage(&mut self) -> Result<(String, String)> {
        let mut text = "[stage]\nall_lit = true                  # photograph all lamps of each stop together: tells whether light adds up\n".to_owned();
        let turns = self.yes("Does a turntable turn the object and the camera under an arc of lamps")?;
        let lamps: usize;
        if turns {
            lamps = self.number("How many lamps are on the arc", 12, [1, 512])?;
            let stops = self.number("At how many stops of the turntable are they lit", 24, [1, 3600])?;
            text += "reference_every = 100           # repeat a reference every so many samples: shows drift and movement\n\n[stage.lamps]\nlayout = \"arc\"                  # each lamp in the middle of its part of 90 degrees, from the horizon up\n";
            let _ = writeln!(
                text,
                "latitudes = {lamps:<20}# lamps on the arc\nlongitudes = {stops:<19}# stops of the turntable\n"
            );
        } else {
            let file = self.text("Which .lp file says where the lamps stand (beside the rig file)", "lamps.lp")?;
            lamps = self.number("How many lamps does it hold", 48, [1, 100_000])?;
            let _ = writeln!(text, "\n[stage.lamps]\nlayout = \"file\"\nfile = {}\n", quoted(&file));
        }
        let mut devices = if turns { self.axes(false)? } else { String::new() };
        devices += &self.lamps(lamps)?;
        Ok((text, devices))
    }

    fn monitor(&mut self) -> Result<(String, String)> {
        let columns = self.number("How many texels wide are the patterns", 128, [2, 4096])?;
        let rows = self.number("How many texels high", 128, [2, 4096])?;
        let noise = self.number("How many patterns of wavelet noise", 256, [1, 100_000])?;
        let refresh: f64 = self.number("How many pictures a second does the screen make", 60.0, [1.0, 10_000.0])?;
        let mut text = format!(
            "[monitor]\ncolumns = {columns}\nrows = {rows}\nnoise = {noise:<24}# patterns, for --sampler noise\n"
        );
        let _ = writeln!(
            text,
            "refresh_hz = {refresh:<19}# shorter exposures, which show a part of a picture, are refused"
        );
        text += "curve = \"srgb\"                  # once it was measured by `relume calibrate gamma`: { file = \"screen.txt\" }\n\n";
        text += "[calibration]\npatterns = [\"ramp\", \"gray-code\", \"stripes\"]     # the screen's curve, which texel a pixel sees, the matte\n\n";
        Ok((text, self.screen()?))
    }

    fn gantry(&mut self) -> Result<(String, String)> {
        let squares =
            self.number("Into how many squares along a side is the projector's picture divided", 32, [1, 256])?;
        let distance: f64 = self.number("How far from the object is the projector, scene units", 4.0, [0.1, 1e4])?;
        let view: f64 = self.number("How wide is its picture, degrees", 34.0, [0.1, 160.0])?;
        let lean: f64 = self.number("How far does the camera look down on the table, degrees", 0.0, [-90.0, 90.0])?;
        let latitudes = self.number("At how many heights does the projector stand", 7, [1, 1000])?;
        let longitudes = self.number("At how many stops of the turntable", 8, [1, 3600])?;
        let mut text = format!(
            "[gantry]\nsquares = {squares}\ninfluence = 4                   # of --sampler separable: every so many squares of a line are lit together\n"
        );
        let _ = writeln!(text, "distance = {distance}\nview_deg = {view}\nlean_deg = {lean}\ncurve = \"srgb\"\n");
        let _ = writeln!(
            text,
            "[gantry.positions]\nlayout = \"arc\"\nlatitudes = {latitudes}\nlongitudes = {longitudes}\n"
        );
        let devices = self.axes(true)? + &self.screen()?;
        Ok((text, devices))
    }

    fn camera_table(&mut self) -> Result<String> {
        let iso: f64 = self.number("ISO speed", 100.0, [1.0, 1e7])?;
        let f_number: f64 = self.number("F-number", 8.0, [0.1, 1000.0])?;
        let fastest = self.number("The shortest exposure, as in 4000 for 1/4000 s", 4000.0, [1.0, 1e6])?;
        let slowest: f64 = self.number("The longest exposure, seconds", 30.0, [0.001, 3600.0])?;
        let raw = self.choice("How do its files hold light", &["recover", "linear", "srgb"])?;
        let mut text =
            "[camera]                        # exposure times are chosen from previews; times_s = [...] fixes them\n"
                .to_owned();
        let _ = writeln!(text, "limits_s = [{:?}, {slowest:?}]\niso = {iso:?}\nf_number = {f_number:?}", 1.0 / fastest);
        let _ = writeln!(
            text,
            "response = \"{raw}\"            # \"recover\" finds the curve of JPEGs from a series of exposures, \"linear\" is raw"
        );
        Ok(text)
    }

    fn camera_device(&mut self) -> Result<String> {
        Ok(match self.choice("How is the camera driven", &["gphoto2", "folder", "virtual"])? {
            "gphoto2" => {
                "camera = { driver = \"gphoto2\" }        # model = \"D750\" where several are connected\n".to_owned()
            }
            "folder" => {
                let path = self.text("Into which folder does your tethering software put photographs", "incoming")?;
                format!(
                    "camera = {{ driver = \"folder\", path = {} }}      # trigger = [\"command\", \"{{time_s}}\"] takes one by itself\n",
                    quoted(&path)
                )
            }
            _ => {
                "camera = { driver = \"virtual\" }        # a rehearsal: real lamps and axes before a computed scene\n"
                    .to_owned()
            }
        })
    }

    fn axes(&mut self, arm: bool) -> Result<String> {
        if self.choice("How are the axes driven", &["grbl", "hand"])? == "hand" {
            return Ok("axes = { driver = \"hand\" }             # the operator is asked to turn\n".to_owned());
        }
        let port = self.text("On which port is the GRBL board", "/dev/ttyUSB0")?;
        let home = self.yes("Does it have limit switches to find zero with")?;
        let backlash: f64 = self.number("How much play do the gears have, degrees", 0.0, [0.0, 90.0])?;
        let axis = |name: &str, letter: char| {
            format!("{name} = {{ letter = \"{letter}\", per_deg = 1, backlash_deg = {backlash:?} }}\n")
        };
        let mut text = format!(
            "\n[devices.axes]                  # the board's steps are set per degree, or per_deg says how many of its units one is\ndriver = \"grbl\"\nport = {}\nhome = {home}\n",
            quoted(&port)
        );
        text += &axis("turntable", 'X');
        if arm {
            text += &axis("arm", 'Y');
        }
        text += "settle_s = 1.0                  # until nothing trembles after a move\n";
        Ok(text)
    }

    fn lamps(&mut self, lamps: usize) -> Result<String> {
        let driver = self.choice("How are the lamps driven", &["dmx-usb-pro", "art-net", "sacn", "text"])?;
        let mut text = format!("\n[devices.lamps]\ndriver = \"{driver}\"\n");
        match driver {
            "art-net" => {
                let host = self.text("Address of the Art-Net node", "10.0.0.20")?;
                let universe: u16 = self.number("Its port address (universe)", 0, [0, 32_767])?;
                let _ = writeln!(text, "host = {}\nuniverse = {universe}", quoted(&host));
            }
            "sacn" => {
                let universe: u16 = self.number("Universe", 1, [1, 63_999])?;
                let _ = writeln!(text, "universe = {universe}");
            }
            other => {
                let port = self.text("On which port are the lamps", "/dev/ttyUSB1")?;
                let _ = writeln!(text, "port = {}", quoted(&port));
                if other == "text" {
                    let on = self.text("The line that lights lamp {lamp}", "<{lamp},1>")?;
                    let off = self.text("The line that puts all lamps out", "<0>")?;
                    let _ = writeln!(text, "on = {}\nall_off = {}", quoted(&on), quoted(&off));
                    text += "# reply = \"ok\"                   # how the board answers each line; without, it is not waited for\n";
                }
            }
        }
        if driver != "text" && lamps <= 512 {
            let first: usize = self.number("The channel of the first lamp; the others follow", 1, [1, 513 - lamps])?;
            let channels: Vec<String> = (first..first + lamps).map(|channel| channel.to_string()).collect();
            let _ = writeln!(text, "channel_of = [{}]", channels.join(", "));
        }
        text += "settle_s = 0.1                  # from the command until a lamp shines steadily\n";
        Ok(text)
    }

    fn screen(&mut self) -> Result<String> {
        let driver = self.choice("How are patterns shown", &["x11", "window"])?;
        let output = self.text("On which output (a part of its name)", "HDMI")?;
        Ok(format!(
            "\n[devices.screen]\ndriver = \"{driver}\"\noutput = {}\nsettle_s = 0.1                  # panel lag\n",
            quoted(&output)
        ))
    }
}

/// A string as TOML writes it.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn written(answers: &str) -> Result<String> {
        let mut screen = Vec::new();
        Questions { answers: &mut answers.as_bytes(), screen: &mut screen, asked: 0, shown: false }.rig()
    }

    #[test]
    fn every_rig_that_can_be_answered_loads() {
        let enter = |count: usize| "\n".repeat(count);
        for (answers, words) in [
            (enter(40), "driver = \"dmx-usb-pro\""),
            (format!("Dome \"7\"\nstage\nyes\n6\n1\nhand\nsacn\n7\n{}", enter(20)), "universe = 7"),
            (format!("\nstage\n\n4\n8\n\n/dev/ttyACM0\nno\n0.5\ntext\n{}", enter(20)), "on = \"<{lamp},1>\""),
            (format!("\nstage\n\n4\n8\n\n\n\n\nart-net\n{}", enter(20)), "host = \"10.0.0.20\""),
            (format!("\nmonitor\n{}", enter(20)), "[devices.screen]"),
            (format!("\nmonitor\n{}window\n{}folder\nin \\ out\n", enter(4), enter(6)), "driver = \"folder\""),
            (format!("\ngantry\n{}", enter(30)), "arm = { letter"),
        ] {
            let text = written(&answers).unwrap_or_else(|error| panic!("{answers:?}: {error}"));
            let rig = RigFile::parse(&text, Path::new("new.toml")).unwrap_or_else(|error| panic!("{error}\n{text}"));
            assert!(rig.devices.is_some() && text.contains(words), "{words}: {text}");
        }
    }

    #[test]
    fn answers_that_end_or_are_wrong_name_the_question() {
        assert!(written("Our rig\n").unwrap_err().to_string().contains("question 2"));
        let wrong = written("Our rig\nspaceship\n").unwrap_err().to_string();
        assert!(wrong.contains("What gives light") && wrong.contains("gantry"), "{wrong}");
    }
}
