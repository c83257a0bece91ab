//! `relume rig simulate`: the boards of a rig file, on pseudo-terminals, and the photograph that its camera would take.

use std::fs;
use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use relume_core::Error;
use relume_core::files::write_whole;

use crate::devices::cameras::virtual_camera::Window;
use crate::progress::{self, Progress, Unit};
use crate::rigs::virtual_stage::VirtualStage;
use crate::rigs::{AxesDevice, Axis, Kind, LampsDevice, RigFile};
use crate::simulators::studio::Studio;
use crate::simulators::{Mischief, Planned, Seen, Served, World, dmx_widget, grbl, serve, text_board};

/// A request to stop is looked for so often.
const LOOK: Duration = Duration::from_millis(50);

const EXAMPLES: &str = "\
Example:
  relume rig simulate dome.toml --at /tmp/dome
  relume capture dome.toml --session rehearsal
  relume rig simulate dome.toml --at /tmp/dome --rehearse axes:reset@90 --rehearse lamps:garbage@5

Boards on serial ports (grbl, text, dmx-usb-pro) are stood in for by programs that speak the same bytes; the ports that the rig
file names inside DIR lead to them, so write port = \"/tmp/dome/axes\" and port = \"/tmp/dome/lamps\". Of a stage, the file
DIR/camera/DCIM/100/0001.JPG is always the photograph that the camera would take now, at the first of times_s, of the object of the
[virtual] table: under the lamps that are lit, at the table's stop, and blurred while the table turns. DIR/state.json tells which
channels are lit and where the axes stand. With camera = {driver =
\"virtual\"} boards are rehearsed without a camera. Ctrl-C ends it.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The rig file, with a table `[devices]`.
    rig: PathBuf,
    /// The folder of the ports and of the camera's card; it may be there already.
    #[arg(long, value_name = "DIR")]
    at: PathBuf,
    /// Rehearse a bad day of a board, as in axes:reset@40: behind its 40th answer the board of the axes restarts. Kinds: garbage,
    /// half-line, late, lost-reply, lost-command, reset, alarm (axes), hang-up (its cable is pulled). May be given several times.
    #[arg(long, value_name = "BOARD:KIND@N")]
    rehearse: Vec<Planned>,
}

/// The boards, and what is said of them.
#[derive(Default)]
struct Boards {
    served: Vec<Served>,
    told: Vec<String>,
}

/// What the world is like, in the folder of the ports.
const STATE: &str = "state.json";

impl Arguments {
    /// Serves until Ctrl-C.
    ///
    /// # Errors
    /// A bad rig file, one without serial devices, a folder that cannot be written to.
    pub fn run(self) -> anyhow::Result<String> {
        let rig = RigFile::read(&self.rig)?;
        fs::create_dir_all(&self.at).map_err(|source| Error::io("create", &self.at, source))?;
        let world = World::default();
        let boards = self.boards(&rig, &world)?;
        anyhow::ensure!(
            !boards.served.is_empty(),
            "{}: no device on a serial port to stand in for",
            self.rig.display()
        );
        let mut told = boards.told.join(", ");
        let mut studio = None;
        if rig.kind == Kind::Stage && rig.camera.times_s.is_some() {
            let found = self.studio(&rig)?;
            told += &format!(", photograph at {}", found.file().display());
            studio = Some(found);
        }
        self.watch(&rig, &world, studio)?;
        let mut out = std::io::stdout().lock();
        let said = writeln!(out, "ready: {told}").and_then(|()| out.flush());
        said.map_err(|source| Error::io("write to", "the standard output", source))?;
        drop(out);
        while progress::check().is_ok() {
            std::thread::sleep(LOOK);
        }
        let struck: Vec<String> =
            boards.served.iter().flat_map(Served::struck).map(|strike| format!("{strike:?}")).collect();
        Ok(if self.rehearse.is_empty() { String::new() } else { format!("went wrong: {}\n", struck.join(", ")) })
    }

    /// What is to go wrong with a board.
    fn mischief(&self, board: &str) -> Mischief {
        let planned = self.rehearse.iter().filter(|planned| planned.board == board);
        Mischief::new(planned.map(|planned| (planned.after, planned.strike)).collect(), 1)
    }

    fn boards(&self, rig: &RigFile, world: &World) -> anyhow::Result<Boards> {
        let mut boards = Boards::default();
        let Some(devices) = &rig.devices else { return Ok(boards) };
        if let Some(AxesDevice::Grbl { port, home, .. }) = &devices.axes {
            let settings = grbl::Settings { homing: *home, ..grbl::Settings::default() };
            self.link(
                &mut boards,
                "axes",
                port,
                serve(grbl::Grbl::new(settings, world.clone()), self.mischief("axes"))?,
            )?;
        }
        match &devices.lamps {
            Some(LampsDevice::DmxUsbPro { port, .. }) => {
                let widget = dmx_widget::DmxWidget::new(world.clone());
                self.link(&mut boards, "lamps", port, serve(widget, self.mischief("lamps"))?)?;
            }
            Some(LampsDevice::Text { port, on, off, all_off, reply, ends, .. }) => {
                let templates = text_board::Templates {
                    on: on.clone(),
                    off: off.clone(),
                    all_off: all_off.clone(),
                    reply: reply.clone(),
                    ends: ends.clone(),
                };
                let board = text_board::TextBoard::new(templates, world.clone());
                self.link(&mut boards, "lamps", port, serve(board, self.mischief("lamps"))?)?;
            }
            Some(LampsDevice::ArtNet { .. } | LampsDevice::Sacn { .. }) => {
                crate::complain("note: lamps on a network are not stood in for; the photograph shows them dark");
            }
            None => {}
        }
        Ok(boards)
    }

    /// Makes a board's port be where the rig file says, or else in the folder, and says so.
    fn link(&self, boards: &mut Boards, what: &str, port: &str, board: Served) -> anyhow::Result<()> {
        let (wanted, folder) = (std::path::absolute(port)?, std::path::absolute(&self.at)?);
        let inside = wanted.starts_with(&folder);
        let place = if inside { wanted } else { folder.join(what) };
        if !inside {
            crate::complain(&format!("note: for a rehearsal write port = \"{}\" of the {what}", place.display()));
        }
        let board = board.link_at(&place).map_err(|source| Error::io("create", &place, source))?;
        boards.told.push(format!("{what} at {}", place.display()));
        boards.served.push(board);
        Ok(())
    }

    /// Keeps what is told of the world, and the photograph if there is one, up to date.
    fn watch(&self, rig: &RigFile, world: &World, mut studio: Option<Studio>) -> anyhow::Result<()> {
        let state = self.at.join(STATE);
        let axes = rig.devices.as_ref().and_then(|devices| devices.axes.clone());
        let mut tell = move |seen: &Seen| -> relume_core::Result<()> {
            write_whole(&state, |out| {
                writeln!(out, "{}", told(seen, axes.as_ref())).map_err(|source| Error::io("write", &state, source))
            })?;
            studio.as_mut().map_or(Ok(()), |studio| studio.photograph(seen))
        };
        tell(&world.seen())?;
        world.watch(move |seen| {
            if let Err(error) = tell(seen) {
                crate::complain(&format!("warning: {error}"));
            }
        });
        Ok(())
    }

    /// The photograph that the rig's camera would take.
    fn studio(&self, rig: &RigFile) -> anyhow::Result<Studio> {
        let mut bar = Progress::new("tracing the virtual scene", Unit::Steps);
        let mut progress = |done, all| bar.step(done, all);
        let stage = VirtualStage::new(rig, 1, Window::default(), &[], &mut progress)?;
        drop(bar);
        let lamps = rig.devices.as_ref().and_then(|devices| devices.lamps.as_ref());
        // Of DMX channel 1 is the first; of a board of text it is called as the file says, and so is every lamp that it lists.
        let first = match lamps {
            Some(LampsDevice::Text { wiring, first, .. }) if wiring.channel_of.is_empty() => 1 - first,
            Some(LampsDevice::Text { .. }) => 0,
            _ => 1,
        };
        Ok(Studio::new(rig, stage, &self.at.join("camera"))?.counted_from(first))
    }
}

/// The world in a line of JSON: lamps that are lit by their channels (from 1), where the axes stand, whether they move.
fn told(seen: &Seen, axes: Option<&AxesDevice>) -> serde_json::Value {
    let lit = seen.levels.iter().enumerate().filter(|(_, level)| **level > 0);
    let levels: serde_json::Map<_, _> = lit.map(|(n, level)| ((n + 1).to_string(), (*level).into())).collect();
    let deg = |axis: &Option<Axis>| {
        let axis = axis.as_ref()?;
        let at = seen.at.get("XYZA".find(axis.letter)?)?;
        Some((at - axis.zero) / axis.per_deg)
    };
    let (turntable, arm) = match axes {
        Some(AxesDevice::Grbl { turntable, arm, .. }) => (deg(turntable), deg(arm)),
        _ => (None, None),
    };
    serde_json::json!({ "levels": levels, "turntable_deg": turntable, "arm_deg": arm, "moving": seen.moving })
}
