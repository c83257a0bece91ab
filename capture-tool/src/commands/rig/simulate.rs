//! `relume rig simulate`: the boards of a rig file, on pseudo-terminals, and the photograph that its camera would take.

use std::fs;
use std::io::Write;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use relume_core::Error;

use crate::devices::cameras::virtual_camera::Window;
use crate::progress::{self, Progress, Unit};
use crate::rigs::virtual_stage::VirtualStage;
use crate::rigs::{AxesDevice, Kind, LampsDevice, RigFile};
use crate::simulators::studio::Studio;
use crate::simulators::{Mischief, Served, World, dmx_widget, grbl, serve, text_board};

/// A request to stop is looked for so often.
const LOOK: Duration = Duration::from_millis(50);

const EXAMPLES: &str = "\
Example:
  relume rig simulate dome.toml --at /tmp/dome
  relume capture dome.toml --session rehearsal

Boards on serial ports (grbl, text, dmx-usb-pro) are stood in for by programs that speak the same bytes; the ports that the rig
file names inside DIR lead to them, so write port = \"/tmp/dome/axes\" and port = \"/tmp/dome/lamps\". Of a stage, the file
DIR/camera/DCIM/100/0001.JPG is always the photograph that the camera would take now, at the first of times_s, of the object of the
[virtual] table: under the lamps that are lit, at the table's stop, and blurred while the table turns. With camera = {driver =
\"virtual\"} boards are rehearsed without a camera. Ctrl-C ends it.";

/// Raw flags.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The rig file, with a [devices] table.
    rig: PathBuf,
    /// The folder of the ports and of the camera's card; it may be there already.
    #[arg(long, value_name = "DIR")]
    at: PathBuf,
}

/// A link to a port, which goes away with this.
struct Link(PathBuf);

impl Drop for Link {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

/// The boards, and the links to them.
#[derive(Default)]
struct Boards {
    links: Vec<Link>,
    served: Vec<Served>,
    told: Vec<String>,
}

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
        if rig.kind == Kind::Stage && rig.camera.times_s.is_some() {
            let file = self.watch(&rig, &world)?;
            told += &format!(", photograph at {}", file.display());
        }
        let mut out = std::io::stdout().lock();
        let said = writeln!(out, "ready: {told}").and_then(|()| out.flush());
        said.map_err(|source| Error::io("write to", "the standard output", source))?;
        drop(out);
        while progress::check().is_ok() {
            std::thread::sleep(LOOK);
        }
        Ok(String::new())
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
                serve(grbl::Grbl::new(settings, world.clone()), Mischief::default())?,
            )?;
        }
        match &devices.lamps {
            Some(LampsDevice::DmxUsbPro { port, .. }) => {
                let widget = dmx_widget::DmxWidget::new(world.clone());
                self.link(&mut boards, "lamps", port, serve(widget, Mischief::default())?)?;
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
                self.link(&mut boards, "lamps", port, serve(board, Mischief::default())?)?;
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
        // One left behind by a simulation that was killed.
        if place.is_symlink() {
            fs::remove_file(&place).map_err(|source| Error::io("replace", &place, source))?;
        }
        symlink(board.path(), &place).map_err(|source| Error::io("create", &place, source))?;
        boards.told.push(format!("{what} at {}", place.display()));
        boards.links.push(Link(place));
        boards.served.push(board);
        Ok(())
    }

    /// Keeps the photograph up to date; returns its file.
    fn watch(&self, rig: &RigFile, world: &World) -> anyhow::Result<PathBuf> {
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
        let mut studio = Studio::new(rig, stage, Path::new(&self.at).join("camera").as_path())?.counted_from(first);
        let file = studio.file().to_owned();
        studio.photograph(&world.seen())?;
        world.watch(move |seen| {
            if let Err(error) = studio.photograph(seen) {
                crate::complain(&format!("warning: {error}"));
            }
        });
        Ok(file)
    }
}
