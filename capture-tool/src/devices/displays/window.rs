//! A full-screen window, as any program may have: Windows, macOS, Wayland, X11.
//!
//! Systems take pictures and do not say when they are on the screen. So each is drawn twice, one redraw after the other: where the system
//! asks for the next picture only when it has used the last (Wayland), the first is on its way by then; everywhere else `settle_s`
//! alone counts.

use std::cell::RefCell;
use std::num::NonZeroU32;
use std::sync::Arc;
use std::time::{Duration, Instant};

use softbuffer::{Context, Surface};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::error::EventLoopError;
use winit::event::{ElementState, KeyEvent, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, EventLoop, OwnedDisplayHandle};
use winit::keyboard::{Key, NamedKey};
use winit::monitor::MonitorHandle;
use winit::platform::pump_events::{EventLoopExtPumpEvents, PumpStatus};
use winit::window::{Fullscreen, Window, WindowId};

use super::x11::Witness;
use super::{GLANCE, Layout, Panel, PixelFormat, Texels, choose};
use crate::devices::{Finding, Trouble};
use crate::progress;
use crate::rigs::ScreenLook;

/// A window that is not there after this, or not drawn, is asked for again.
const PATIENCE: Duration = Duration::from_secs(5);
/// Redraws of a picture.
const DRAWN: u32 = 2;
/// Redraws of black when the window is new: desktops animate it, and show its first pictures in part.
const FIRST_DRAWN: u32 = 5;
/// What the system does of its own when a window comes, lasts no longer.
const COMING: Duration = Duration::from_millis(300);

thread_local! {
    // A process may have one event loop in its life.
    static EVENTS: RefCell<Option<EventLoop<()>>> = const { RefCell::new(None) };
}

/// The event loop, put back when it is no longer needed.
struct Events(Option<EventLoop<()>>);

impl Events {
    fn take() -> Result<Self, Trouble> {
        if let Some(events) = EVENTS.with(|events| events.borrow_mut().take()) {
            return Ok(Self(Some(events)));
        }
        let mut builder = EventLoop::builder();
        #[cfg(target_os = "linux")]
        winit::platform::x11::EventLoopBuilderExtX11::with_any_thread(&mut builder, true);
        #[cfg(target_os = "windows")]
        winit::platform::windows::EventLoopBuilderExtWindows::with_any_thread(&mut builder, true);
        match builder.build() {
            Ok(events) => Ok(Self(Some(events))),
            Err(error) => Err(Trouble::stop(
                format!("no window can be opened: {}", reason(&error)),
                "start relume in a graphical session (on Linux, DISPLAY or WAYLAND_DISPLAY is set there)",
            )),
        }
    }
}

/// Why, without the place in winit's source that it begins with.
fn reason(error: &EventLoopError) -> String {
    match error {
        EventLoopError::Os(error) => {
            let said = error.to_string();
            said.split_once(".rs:")
                .and_then(|(_, rest)| rest.split_once(": "))
                .map_or(said.clone(), |(_, why)| why.to_owned())
        }
        other => other.to_string(),
    }
}

impl Events {
    /// Is it X11's?
    fn is_x11(&self) -> bool {
        #[cfg(target_os = "linux")]
        return self.0.as_ref().is_some_and(winit::platform::x11::EventLoopExtX11::is_x11);
        #[cfg(not(target_os = "linux"))]
        false
    }
}

impl Drop for Events {
    fn drop(&mut self) {
        EVENTS.with(|kept| *kept.borrow_mut() = self.0.take());
    }
}

/// An output with a window over it.
struct WindowPanel {
    // The window goes before what it lives by.
    stage: Stage,
    events: Events,
    monitor: MonitorHandle,
    name: String,
    size: (usize, usize),
    appeared: bool,
    /// Under X11, where winit 0.30 keeps the outputs as they were.
    witness: Option<Witness>,
}

/// What the system calls back.
#[derive(Default)]
struct Stage {
    /// Outputs, as they were last looked at.
    monitors: Vec<MonitorHandle>,
    look: bool,
    /// The output to open a window on.
    open_on: Option<MonitorHandle>,
    window: Option<Arc<Window>>,
    surface: Option<Surface<OwnedDisplayHandle, Arc<Window>>>,
    picture: Vec<u32>,
    drawn: u32,
    hidden: bool,
    any_key: bool,
    closed: bool,
    failed: Option<String>,
}

impl Stage {
    fn open(&mut self, system: &ActiveEventLoop, monitor: MonitorHandle) -> Result<(), String> {
        let attributes = Window::default_attributes().with_title("relume").with_inner_size(monitor.size());
        let window = system.create_window(placed(attributes, system, monitor)).map_err(|error| error.to_string())?;
        window.set_cursor_visible(false);
        let window = Arc::new(window);
        let context = Context::new(system.owned_display_handle()).map_err(|error| error.to_string())?;
        self.surface = Some(Surface::new(&context, window.clone()).map_err(|error| error.to_string())?);
        self.window = Some(window);
        Ok(())
    }

    fn draw(&mut self) -> Result<(), String> {
        let (Some(window), Some(surface)) = (&self.window, &mut self.surface) else { return Ok(()) };
        let PhysicalSize { width, height } = window.inner_size();
        let (Some(columns), Some(rows)) = (NonZeroU32::new(width), NonZeroU32::new(height)) else { return Ok(()) };
        surface.resize(columns, rows).map_err(|error| error.to_string())?;
        let mut pixels = surface.buffer_mut().map_err(|error| error.to_string())?;
        // Before the window has its size there is nothing to show.
        if pixels.len() == self.picture.len() {
            pixels.copy_from_slice(&self.picture);
            self.drawn += 1;
        } else {
            pixels.fill(0);
        }
        window.pre_present_notify();
        pixels.present().map_err(|error| error.to_string())
    }
}

/// Over the whole of an output. Under X11 without a window manager full screen is ignored, and with one it is the manager's; a window that
/// asks nobody is exact in both.
fn placed(
    attributes: winit::window::WindowAttributes,
    system: &ActiveEventLoop,
    monitor: MonitorHandle,
) -> winit::window::WindowAttributes {
    #[cfg(target_os = "linux")]
    {
        use winit::platform::x11::{ActiveEventLoopExtX11, WindowAttributesExtX11};
        if system.is_x11() {
            return attributes.with_position(monitor.position()).with_override_redirect(true);
        }
    }
    let _ = system;
    attributes.with_fullscreen(Some(Fullscreen::Borderless(Some(monitor))))
}

impl ApplicationHandler for Stage {
    fn new_events(&mut self, system: &ActiveEventLoop, _cause: StartCause) {
        if std::mem::take(&mut self.look) {
            self.monitors = system.available_monitors().collect();
        }
    }

    fn resumed(&mut self, _system: &ActiveEventLoop) {}

    fn about_to_wait(&mut self, system: &ActiveEventLoop) {
        if let Some(monitor) = self.open_on.take()
            && let Err(error) = self.open(system, monitor)
        {
            self.failed = Some(error);
        }
    }

    fn window_event(&mut self, _system: &ActiveEventLoop, _window: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested | WindowEvent::Destroyed => self.closed = true,
            WindowEvent::KeyboardInput {
                event: KeyEvent { logical_key: Key::Named(key), state: ElementState::Pressed, .. },
                ..
            } => self.closed |= key == NamedKey::Escape || self.any_key && key == NamedKey::Enter,
            WindowEvent::Occluded(hidden) => self.hidden = hidden,
            WindowEvent::RedrawRequested => {
                if let Err(error) = self.draw() {
                    self.failed = Some(error);
                }
            }
            _ => {}
        }
    }
}

/// The names of outputs, those without one by their number.
fn names(monitors: &[MonitorHandle]) -> Vec<String> {
    let name = |(n, monitor): (usize, &MonitorHandle)| monitor.name().unwrap_or_else(|| format!("screen {}", n + 1));
    monitors.iter().enumerate().map(name).collect()
}

/// Lets the system call back, for so long at most.
fn pump(events: &mut Events, stage: &mut Stage, time: Duration) -> Result<(), Trouble> {
    progress::check_urgent()?;
    if let Some(events) = &mut events.0
        && let PumpStatus::Exit(_) = events.pump_app_events(Some(time), stage)
    {
        return Err(Trouble::stop("the system has ended the window", "log in again and start anew"));
    }
    match stage.failed.take() {
        Some(error) => Err(Trouble::stop(format!("the window cannot show patterns: {error}"), "restart the session")),
        None if stage.closed => Err(super::closed()),
        None => Ok(()),
    }
}

/// The outputs that there are now.
fn looked(events: &mut Events, stage: &mut Stage) -> Result<(), Trouble> {
    stage.look = true;
    let begun = Instant::now();
    while stage.look && begun.elapsed() < PATIENCE {
        pump(events, stage, Duration::ZERO)?;
    }
    Ok(())
}

/// Opens an output; shows nothing yet.
///
/// # Errors
/// No graphical session, no such output, more than 8 bits.
pub fn open(look: &ScreenLook) -> Result<Box<dyn Panel>, Trouble> {
    if look.bits > 8 {
        return Err(Trouble::stop(
            format!("a window takes codes of 8 bits, and patterns of {} bits were asked for", look.bits),
            "use driver = \"x11\" under [devices] screen on a server of depth 30, or set bits = 8",
        ));
    }
    let (mut events, mut stage) = (Events::take()?, Stage::default());
    looked(&mut events, &mut stage)?;
    let names = names(&stage.monitors);
    let chosen = choose(&names, look.output.as_deref(), "the system")?;
    let (monitor, name) = (stage.monitors[chosen].clone(), names[chosen].clone());
    let witness = if events.is_x11() { Witness::of(&name, look.any_gamma) } else { None };
    let PhysicalSize { width, height } = monitor.size();
    let size = (width as usize, height as usize);
    Ok(Box::new(WindowPanel { stage, events, monitor, name, size, appeared: false, witness }))
}

/// A line for each output.
pub fn list() -> Vec<String> {
    let lines = || -> Result<Vec<String>, Trouble> {
        let (mut events, mut stage) = (Events::take()?, Stage::default());
        looked(&mut events, &mut stage)?;
        let line = |(name, monitor): (String, &MonitorHandle)| {
            let (size, at) = (monitor.size(), monitor.position());
            let rate = monitor
                .refresh_rate_millihertz()
                .map_or(String::new(), |rate| format!(", {:.2} Hz", f64::from(rate) / 1e3));
            format!(
                "{name}: {} x {} pixels at ({}, {}){rate}, gamma table not readable",
                size.width, size.height, at.x, at.y
            )
        };
        Ok(names(&stage.monitors).into_iter().zip(&stage.monitors).map(line).collect())
    };
    lines().unwrap_or_else(|trouble| vec![trouble.to_string()])
}

impl WindowPanel {
    fn pump(&mut self, time: Duration) -> Result<(), Trouble> {
        pump(&mut self.events, &mut self.stage, time)
    }

    /// Pumps until something holds; says whether it does.
    fn until(&mut self, holds: impl Fn(&Stage) -> bool) -> Result<bool, Trouble> {
        let begun = Instant::now();
        while !holds(&self.stage) {
            if begun.elapsed() > PATIENCE {
                return Ok(false);
            }
            self.pump(GLANCE)?;
        }
        Ok(true)
    }

    /// The window comes up, black, and as large as the output.
    fn appear(&mut self) -> Result<(), Trouble> {
        if self.appeared {
            return Ok(());
        }
        let size = PhysicalSize::new(self.size.0 as u32, self.size.1 as u32);
        if self.stage.window.is_none() {
            self.stage.picture = vec![0; self.size.0 * self.size.1];
            self.stage.open_on = Some(self.monitor.clone());
        }
        let fills = |stage: &Stage| stage.window.as_ref().is_some_and(|window| window.inner_size() == size);
        if !self.until(fills)? {
            return Err(self.misfit());
        }
        self.draw(FIRST_DRAWN)?;
        self.rest(COMING)?;
        self.appeared = true;
        Ok(())
    }

    fn misfit(&self) -> Trouble {
        let (columns, rows) = self.size;
        let what = match self.stage.window.as_ref().map(|window| window.inner_size()) {
            Some(size) => format!(
                "the window on {} has {} x {} pixels, and the output {columns} x {rows}",
                self.name, size.width, size.height
            ),
            None => format!("the system opens no window on {}", self.name),
        };
        Trouble::stop(
            what,
            "switch off the desktop's scaling of that output, or use driver = \"x11\" where there is X11",
        )
    }

    fn draw(&mut self, times: u32) -> Result<(), Trouble> {
        for _ in 0..times {
            let before = self.stage.drawn;
            if let Some(window) = &self.stage.window {
                window.request_redraw();
            }
            if !self.until(|stage| stage.drawn > before)? {
                return Err(Trouble::Busy(format!("the system does not let the window on {} be drawn", self.name)));
            }
        }
        Ok(())
    }
}

impl Panel for WindowPanel {
    fn name(&self) -> String {
        format!("output {}", self.name)
    }

    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn preflight(&mut self) -> Vec<Finding> {
        match self.check() {
            Err(trouble) => vec![Finding::missing(format!("screen: {trouble}"))],
            Ok(()) => {
                let (columns, rows) = self.size;
                let output = self.witness.as_ref().map_or_else(
                    || {
                        let unseen = "its gamma table is not read: switch off night light and colour profiles";
                        format!("{}: {columns} x {rows} pixels, {unseen}", self.name)
                    },
                    Witness::words,
                );
                vec![Finding::fine(format!(
                    "screen: output {output}; no picture is confirmed, settle_s alone is waited"
                ))]
            }
        }
    }

    fn check(&mut self) -> Result<(), Trouble> {
        if let Some(witness) = &self.witness {
            return witness.check();
        }
        looked(&mut self.events, &mut self.stage)?;
        let advice = "put the screen back as it was, keep the desktop from changing it, and go on";
        let found = names(&self.stage.monitors).iter().position(|name| *name == self.name);
        let now = found.map(|n| self.stage.monitors[n].size());
        match now {
            None => Err(Trouble::stop(format!("output {} was unplugged or switched off", self.name), advice)),
            Some(size) if (size.width as usize, size.height as usize) != self.size => Err(Trouble::stop(
                format!(
                    "output {} had {} x {} pixels and now has {} x {}",
                    self.name, self.size.0, self.size.1, size.width, size.height
                ),
                advice,
            )),
            Some(_) => Ok(()),
        }
    }

    fn put(&mut self, texels: &Texels, layout: &Layout) -> Result<(), Trouble> {
        self.appear()?;
        let word = |bytes: &[u8]| u32::from_ne_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        self.stage.picture = PixelFormat::XRGB.pack(texels, layout).chunks_exact(4).map(word).collect();
        self.draw(DRAWN)
    }

    fn rest(&mut self, time: Duration) -> Result<(), Trouble> {
        let begun = Instant::now();
        loop {
            let left = time.saturating_sub(begun.elapsed());
            self.pump(left.min(GLANCE))?;
            if left.is_zero() {
                return Ok(());
            }
        }
    }

    fn still(&mut self) -> Result<(), Trouble> {
        self.check()?;
        let size = self.stage.window.as_ref().map(|window| window.inner_size());
        if size.is_some_and(|size| (size.width as usize, size.height as usize) != self.size) {
            return Err(self.misfit());
        }
        if self.stage.hidden {
            return Err(Trouble::Busy(format!("another window hides the patterns on {}", self.name)));
        }
        Ok(())
    }

    fn take_keys(&mut self) -> Result<(), Trouble> {
        self.stage.any_key = true;
        Ok(())
    }

    fn is_closed(&self) -> bool {
        self.stage.closed
    }
}
