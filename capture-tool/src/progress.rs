//! Progress bars with time left, and Ctrl-C.
//!
//! Work reports each finished unit through [`Progress::step`]; that is also where a request to stop takes effect, so that
//! every output is either whole or gone.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use relume_core::Error;

/// Work that will take less than this gets no bar.
const WORTH_SHOWING: Duration = Duration::from_secs(2);
/// How long to watch before the time left is guessed.
const WATCH: Duration = Duration::from_millis(300);

/// Requests to stop.
static STOPS: AtomicU32 = AtomicU32::new(0);
/// Devices that are being switched off.
static SWITCHING_OFF: AtomicU32 = AtomicU32::new(0);
/// What the watchdog is told of.
static SIGNS: AtomicU64 = AtomicU64::new(0);
/// Devices are on: the second request gives up the step in flight but switches off first.
static DEVICES: AtomicBool = AtomicBool::new(false);

/// From now on Ctrl-C (and a polite `kill`) stops between two units of work; the second one exits at once.
pub fn listen_for_ctrl_c() {
    let on_signal = || {
        let before = STOPS.fetch_add(1, Ordering::Relaxed);
        let devices = u32::from(DEVICES.load(Ordering::Relaxed));
        if before > devices {
            std::process::exit(i32::from(crate::EXIT_STOPPED));
        }
        if std::io::stderr().is_terminal() {
            let again = if before == devices { "exit at once" } else { "give up the photograph in flight" };
            let after = if before == 0 { "after this step" } else { "now" };
            crate::complain(&format!("\nstopping {after}; again to {again}"));
        }
    };
    // Where no handler can be set, Ctrl-C ends the program as it would any other.
    let _ = ctrlc::set_handler(on_signal);
}

/// Signs of life so far: work that goes on, or waits for something, gives them by [`check`] and [`check_urgent`].
pub fn signs() -> u64 {
    SIGNS.load(Ordering::Relaxed)
}

/// Stops if that was asked for.
///
/// # Errors
/// [`Error::Cancelled`].
pub fn check() -> relume_core::Result<()> {
    SIGNS.fetch_add(1, Ordering::Relaxed);
    if STOPS.load(Ordering::Relaxed) > 0 { Err(Error::Cancelled) } else { Ok(()) }
}

/// Stops if that was asked for twice: in the middle of a step that can be taken back.
///
/// # Errors
/// [`Error::Cancelled`].
pub fn check_urgent() -> relume_core::Result<()> {
    SIGNS.fetch_add(1, Ordering::Relaxed);
    let hurried = STOPS.load(Ordering::Relaxed) > 1 && SWITCHING_OFF.load(Ordering::Relaxed) == 0;
    if hurried { Err(Error::Cancelled) } else { Ok(()) }
}

/// While it lives devices are being switched off, which no request to stop cuts short: [`check_urgent`] lets waits go on.
#[derive(Debug)]
pub struct SwitchingOff(());

impl SwitchingOff {
    /// From now on.
    pub fn begin() -> Self {
        SWITCHING_OFF.fetch_add(1, Ordering::Relaxed);
        Self(())
    }
}

impl Drop for SwitchingOff {
    fn drop(&mut self) {
        SWITCHING_OFF.fetch_sub(1, Ordering::Relaxed);
    }
}

/// While it lives, a second Ctrl-C gives up the step in flight in place of the program, so that devices are switched off;
/// only the third exits at once.
#[derive(Debug)]
pub struct DevicesOn(());

impl DevicesOn {
    /// From now on.
    pub fn begin() -> Self {
        DEVICES.store(true, Ordering::Relaxed);
        Self(())
    }
}

impl Drop for DevicesOn {
    fn drop(&mut self) {
        DEVICES.store(false, Ordering::Relaxed);
    }
}

/// Is an error the answer to a request to stop?
pub fn is_cancelled(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| matches!(cause.downcast_ref::<Error>(), Some(Error::Cancelled)))
}

/// How a bar counts.
#[derive(Debug, Clone, Copy)]
pub enum Unit {
    /// Photographs, rows.
    Steps,
    /// Bytes.
    Bytes,
}

/// A bar that appears once the work is known to be long, and only on a terminal.
#[derive(Debug)]
pub struct Progress {
    what: &'static str,
    unit: Unit,
    begun: Instant,
    bar: Option<ProgressBar>,
}

impl Progress {
    /// `what` is being done, as in "importing".
    pub fn new(what: &'static str, unit: Unit) -> Self {
        Self { what, unit, begun: Instant::now(), bar: None }
    }

    /// `done` of `total` units are finished.
    ///
    /// # Errors
    /// [`Error::Cancelled`] after Ctrl-C.
    pub fn step(&mut self, done: u64, total: u64) -> relume_core::Result<()> {
        check()?;
        if self.bar.is_none() && is_long(self.begun.elapsed(), done, total) && std::io::stderr().is_terminal() {
            self.bar = Some(bar(self.what, self.unit, total).with_elapsed(self.begun.elapsed()));
        }
        if let Some(bar) = &self.bar {
            bar.set_position(done);
        }
        Ok(())
    }
}

impl Progress {
    /// Says how far the work has come, behind what is being done.
    pub fn say(&self, text: &str) {
        if let Some(bar) = &self.bar {
            bar.set_message(format!("{}, {text}", self.what));
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Will the work take longer than [`WORTH_SHOWING`] in all, going by what was done so far?
fn is_long(elapsed: Duration, done: u64, total: u64) -> bool {
    let expected = elapsed.as_secs_f64() * total as f64 / done.max(1) as f64;
    elapsed >= WATCH && expected > WORTH_SHOWING.as_secs_f64()
}

fn bar(what: &'static str, unit: Unit, total: u64) -> ProgressBar {
    let count = match unit {
        Unit::Steps => "{pos}/{len}",
        Unit::Bytes => "{bytes}/{total_bytes}",
    };
    let template = format!("{{msg}} [{{bar:30}}] {count}, {{eta}} left");
    let style = ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr())
        .with_style(style.progress_chars("=> "))
        .with_message(what)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_for_long_work() {
        let seconds = Duration::from_secs_f64;
        assert!(!is_long(seconds(0.1), 1, 1000), "too early to tell");
        assert!(!is_long(seconds(0.5), 50, 100), "one second in all");
        assert!(is_long(seconds(0.5), 10, 100), "five seconds in all");
        assert!(is_long(seconds(2.1), 99, 100));
        assert!(is_long(seconds(3.0), 0, 100));
    }

    #[test]
    fn the_style_is_understood() {
        for unit in [Unit::Steps, Unit::Bytes] {
            assert_eq!(bar("importing", unit, 7).message(), "importing");
        }
    }

    #[test]
    fn a_request_to_stop_is_recognised_under_its_context() {
        let error = anyhow::Error::new(Error::Cancelled).context("cannot import");
        assert!(is_cancelled(&error));
        assert!(!is_cancelled(&anyhow::anyhow!("stopped on request")));
    }
}
