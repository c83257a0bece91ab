//! Pictures on an output, one after another, each confirmed.

use std::time::{Duration, Instant};

use x11rb::connection::Connection;
use x11rb::errors::ConnectionError;
use x11rb::protocol::Event;
use x11rb::protocol::dpms::{ConnectionExt as _, DPMSMode};
use x11rb::protocol::present::{CompleteKind, CompleteMode, ConnectionExt as _, EventMask};
use x11rb::protocol::screensaver::ConnectionExt as _;
use x11rb::protocol::xproto::{ConnectionExt as _, InputFocus, ScreenSaver};
use x11rb::rust_connection::PollMode;

use super::super::{GLANCE, Layout, Panel, Texels, choose};
use super::link::Link;
use super::outputs::Output;
use super::surface::Surface;
use crate::devices::{Finding, Trouble};
use crate::progress;
use crate::rigs::ScreenLook;

/// Pictures are confirmed at the next refresh, within some 20 ms.
const CONFIRMED: Duration = Duration::from_secs(5);
/// So many pictures in a row are given again because a window came over them.
const COVERED: u32 = 5;
/// After a window appears, drivers and desktops may show a picture or two of their own.
const FIRST_PICTURES: usize = 3;
/// Keys that end: X11's numbers of Escape, Return and Enter.
const ENDING: [u32; 3] = [0xff1b, 0xff0d, 0xff8d];

/// An output.
#[derive(Debug)]
pub struct X11Panel {
    link: Link,
    output: Output,
    surface: Surface,
    white: u16,
    any_gamma: bool,
    serial: u32,
    appeared: bool,
    covered: u32,
    /// Keycodes that end; none unless keys were asked for.
    ending: Vec<u8>,
    ended: bool,
    /// A picture that is not confirmed after this is given again.
    pub(super) patience: Duration,
    /// Waits for nothing: what a driver that does so would do.
    #[cfg(test)]
    pub(super) hasty: bool,
}

impl X11Panel {
    /// Opens an output; shows nothing yet.
    ///
    /// # Errors
    /// No server, no such output; one without Present, or without the bits.
    pub fn open(display: Option<&str>, look: &ScreenLook) -> Result<Self, Trouble> {
        let link = Link::connect(display)?;
        let mut outputs = Output::all(&link)?;
        let names: Vec<String> = outputs.iter().map(|output| output.name.clone()).collect();
        let chosen = choose(&names, look.output.as_deref(), &format!("the X server {}", link.name))?;
        let output = outputs.swap_remove(chosen);
        let present = link.server.present_query_version(1, 0).map_err(Into::into).and_then(|cookie| cookie.reply());
        if present.is_err() {
            return Err(Trouble::stop(
                format!("the X server {} does not confirm pictures (it has no Present extension)", link.name),
                "use driver = \"window\" under [devices] screen, and measure settle_s",
            ));
        }
        let surface = Surface::new(&link, output.place, look.bits)?;
        let events = link.told(link.server.generate_id())?;
        link.told(link.server.present_select_input(events, surface.window, EventMask::COMPLETE_NOTIFY))?;
        link.told(link.server.flush())?;
        Ok(Self {
            link,
            output,
            surface,
            white: if look.bits > 8 { 1023 } else { 255 },
            any_gamma: look.any_gamma,
            serial: 0,
            appeared: false,
            covered: 0,
            ending: Vec::new(),
            ended: false,
            patience: CONFIRMED,
            #[cfg(test)]
            hasty: false,
        })
    }

    /// The output is as it was, and awake.
    fn check(&self) -> Result<(), Trouble> {
        self.output.again(&self.link)?.check(self.white, self.any_gamma)?;
        let server = &self.link.server;
        // Servers without DPMS never sleep.
        let power = server.dpms_info().map_err(Into::into).and_then(|cookie| cookie.reply());
        if power.is_ok_and(|power| power.state && power.power_level != DPMSMode::ON) {
            self.link.told(server.dpms_force_level(DPMSMode::ON))?;
            self.link.told(server.flush())?;
            return Err(Trouble::Busy(format!("output {} was asleep and is being woken", self.output.name)));
        }
        Ok(())
    }

    /// The window comes up, black, and neither sleep nor screen savers come as long as it is there.
    fn appear(&mut self) -> Result<(), Trouble> {
        if self.appeared {
            return Ok(());
        }
        let (link, window) = (&self.link, self.surface.window);
        // Both end with the connection. Servers without the extension have no saver that would come.
        let _ = link.server.screensaver_suspend(1);
        link.told(link.server.force_screen_saver(ScreenSaver::RESET))?;
        self.surface.raise(link)?;
        link.told(link.server.map_window(window))?;
        if !self.ending.is_empty() {
            link.told(link.server.set_input_focus(InputFocus::POINTER_ROOT, window, x11rb::CURRENT_TIME))?;
        }
        link.told(link.server.flush())?;
        let mapped = |event: &Event| matches!(event, Event::MapNotify(e) if e.window == window).then_some(());
        if self.wait_for(self.patience, mapped)?.is_none() {
            return Err(Trouble::Busy(format!("the X server {} does not open a window", self.link.name)));
        }
        let size = (usize::from(self.output.place.width), usize::from(self.output.place.height));
        let black = vec![0; self.surface.format.row_bytes(size.0) * size.1];
        for _ in 0..FIRST_PICTURES {
            self.present(&black)?;
        }
        self.appeared = true;
        Ok(())
    }

    /// Gives the server a picture and waits until it says that this very one is on the screen.
    fn present(&mut self, bytes: &[u8]) -> Result<(), Trouble> {
        self.serial = self.serial.wrapping_add(1);
        let (serial, window, crtc) = (self.serial, self.surface.window, self.output.crtc);
        let pixmap = self.surface.upload(&self.link, bytes)?;
        let server = &self.link.server;
        self.link.told(server.present_pixmap(window, pixmap, serial, 0, 0, 0, 0, crtc, 0, 0, 0, 0, 0, 0, &[]))?;
        self.link.told(server.free_pixmap(pixmap))?;
        self.link.told(server.flush())?;
        #[cfg(test)]
        if self.hasty {
            return Ok(());
        }
        let completed = |event: &Event| match event {
            Event::PresentCompleteNotify(e) if e.kind == CompleteKind::PIXMAP && e.serial == serial => Some(e.mode),
            _ => None,
        };
        match self.wait_for(self.patience, completed)? {
            Some(CompleteMode::SKIP) => {
                Err(Trouble::Busy(format!("the X server {} skipped a picture", self.link.name)))
            }
            Some(_) => Ok(()),
            None => Err(Trouble::Busy(format!(
                "the X server {} has not confirmed a picture for {:.1} seconds",
                self.link.name,
                self.patience.as_secs_f64()
            ))),
        }
    }

    /// Takes in events until one is the wanted one; none after so long.
    fn wait_for<T>(&mut self, time: Duration, wanted: impl Fn(&Event) -> Option<T>) -> Result<Option<T>, Trouble> {
        let begun = Instant::now();
        loop {
            while let Some(event) = self.link.told(self.link.server.poll_for_event())? {
                if let Some(found) = wanted(&event) {
                    return Ok(Some(found));
                }
                self.take(&event)?;
            }
            progress::check_urgent()?;
            let left = time.saturating_sub(begun.elapsed());
            if left.is_zero() {
                return Ok(None);
            }
            let waited = self.link.server.stream().wait(PollMode::Readable, left.min(GLANCE));
            self.link.told(waited.map_err(ConnectionError::IoError))?;
        }
    }

    /// What nobody waited for.
    fn take(&mut self, event: &Event) -> Result<(), Trouble> {
        match event {
            Event::Error(error) => {
                self.link.told(Err(x11rb::errors::ReplyError::X11Error(error.clone())))?;
            }
            Event::KeyPress(key) if self.ending.contains(&key.detail) => self.ended = true,
            _ => {}
        }
        if self.ended { Err(super::super::closed()) } else { Ok(()) }
    }
}

impl Panel for X11Panel {
    fn name(&self) -> String {
        format!("output {}", self.output.name)
    }

    fn size(&self) -> (usize, usize) {
        (self.output.place.width.into(), self.output.place.height.into())
    }

    fn preflight(&mut self) -> Vec<Finding> {
        let text = format!("screen: output {}, pictures confirmed by the X server", self.output.words(self.white));
        let mut findings = vec![match self.check() {
            Ok(()) | Err(Trouble::Busy(_)) => Finding::fine(text),
            Err(trouble) => Finding::missing(format!("screen: {trouble}")),
        }];
        if self.white > 255 && self.output.gamma.len() < 1024 {
            findings.push(Finding::fine(format!(
                "screen: the gamma table of output {} has {} entries: the card may show 8 of 10 bits; look at a ramp",
                self.output.name,
                self.output.gamma.len()
            )));
        }
        if self.surface.is_composited() {
            findings.push(Finding::fine(
                "screen: a compositor stands between windows and the screen; switch it off, or allow two refreshes more in settle_s",
            ));
        }
        findings
    }

    fn check(&mut self) -> Result<(), Trouble> {
        X11Panel::check(self)
    }

    fn put(&mut self, texels: &Texels, layout: &Layout) -> Result<(), Trouble> {
        self.appear()?;
        self.surface.raise(&self.link)?;
        let bytes = self.surface.format.pack(texels, layout);
        self.present(&bytes)
    }

    fn rest(&mut self, time: Duration) -> Result<(), Trouble> {
        self.wait_for(time, |_| None::<()>).map(|_| ())
    }

    fn still(&mut self) -> Result<(), Trouble> {
        #[cfg(test)]
        if self.hasty {
            return Ok(());
        }
        X11Panel::check(self)?;
        let Some(over) = self.surface.cover(&self.link)? else {
            self.covered = 0;
            return Ok(());
        };
        self.covered += 1;
        let what = format!("{over} lies over the patterns on output {}", self.output.name);
        if self.covered < COVERED {
            return Err(Trouble::Busy(what));
        }
        Err(Trouble::stop(what, "close it, and keep notifications and panels off that output"))
    }

    fn take_keys(&mut self) -> Result<(), Trouble> {
        let (link, setup) = (&self.link, self.link.server.setup());
        let (first, last) = (setup.min_keycode, setup.max_keycode);
        let keys = link.told(link.told(link.server.get_keyboard_mapping(first, last - first + 1))?.reply())?;
        let each = usize::from(keys.keysyms_per_keycode.max(1));
        let ends = |symbols: &[u32]| symbols.iter().any(|symbol| ENDING.contains(symbol));
        let codes = keys.keysyms.chunks(each).enumerate().filter(|(_, symbols)| ends(symbols));
        self.ending = codes.map(|(n, _)| first + n as u8).collect();
        Ok(())
    }

    fn is_closed(&self) -> bool {
        self.ended
    }
}
