//! The watchdog: a second process that puts the lamps out when the first one hangs or dies.
//!
//! A capture starts `relume rig watch` and tells it the rig, then gives a sign of life through a pipe whenever its work has gone on
//! ([`progress::signs`]). When the pipe closes without a word the capture was killed or crashed; when no sign comes for too long it
//! hangs, and is ended, since it holds the ports. Either way the watchdog then puts the lamps out. Axes are left alone: a move that was
//! begun ends within its limits and its motors hold, and opening the port of many boards restarts them.

use std::io::{BufRead, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use anyhow::Context;
use serde::{Deserialize, Serialize};

use crate::devices::{Trouble, lights};
use crate::progress;
use crate::rigs::{LampsDevice, RigFile};

/// So often a sign of life is given.
const BEAT: Duration = Duration::from_millis(250);
/// Beyond the longest exposure and the patience with devices: decoding, choosing exposures, a slow disk.
const MARGIN_S: f64 = 60.0;
/// Ports of a process that was ended are free soon, not at once.
const FREE_WITHIN: Duration = Duration::from_secs(3);
const LIFE: &str = "alive";
const END: &str = "done";

/// What the watchdog has to know; its first line.
#[derive(Debug, Serialize, Deserialize)]
struct Orders {
    /// The process that it watches.
    process: u32,
    /// No sign for so long means that it hangs.
    limit_s: f64,
    lamps: LampsDevice,
    bulbs: usize,
}

/// A watchdog that runs. Dropped, it is sent home: whoever drops it has put the lamps out.
#[derive(Debug)]
pub struct Watchdog {
    child: Child,
    over: Arc<AtomicBool>,
    beating: Option<std::thread::JoinHandle<ChildStdin>>,
}

impl Watchdog {
    /// Begins to watch this process, if the rig has lamps that are driven and wants it.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn start(rig: &RigFile) -> anyhow::Result<Option<Self>> {
        let Some(devices) = &rig.devices else { return Ok(None) };
        let usual = rig.camera.limits_s[1] + rig.camera.patience_s + MARGIN_S;
        let limit_s = devices.watchdog_s.unwrap_or(usual);
        let Some(lamps) = devices.lamps.clone().filter(|_| limit_s > 0.0) else { return Ok(None) };
        let orders = Orders { process: std::process::id(), limit_s, lamps, bulbs: rig.bulbs() };
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["rig", "watch"]).stdin(Stdio::piped()).stdout(Stdio::null());
        out_of_the_terminals_reach(&mut command);
        let mut child = command.spawn().context("the watchdog cannot be started")?;
        let mut pipe = child.stdin.take().context("the watchdog has no pipe")?;
        writeln!(pipe, "{}", serde_json::to_string(&orders)?).context("the watchdog does not listen")?;
        let over = Arc::new(AtomicBool::new(false));
        let beating = std::thread::spawn({
            let over = over.clone();
            move || beat(pipe, &over)
        });
        Ok(Some(Self { child, over, beating: Some(beating) }))
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(Ok(mut pipe)) = self.beating.take().map(std::thread::JoinHandle::join) {
            let _ = writeln!(pipe, "{END}");
        }
        let _ = self.child.wait();
    }
}

/// Ctrl-C in the terminal reaches every process of its group: the watchdog is in one of its own.
fn out_of_the_terminals_reach(command: &mut Command) {
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(command, 0);
    #[cfg(windows)]
    std::os::windows::process::CommandExt::creation_flags(command, 0x0000_0200); // CREATE_NEW_PROCESS_GROUP
    #[cfg(not(any(unix, windows)))]
    let _ = command;
}

/// Passes on that work has gone on since the last time.
fn beat(mut pipe: ChildStdin, over: &AtomicBool) -> ChildStdin {
    let mut told = None;
    let mut next = Instant::now();
    while !over.load(Ordering::Relaxed) {
        let signs = Some(progress::signs());
        if next <= Instant::now() {
            next += BEAT;
            // A watchdog that is gone cannot be told; the capture goes on without.
            if signs != told && writeln!(pipe, "{LIFE}").is_err() {
                break;
            }
            told = signs;
        }
        std::thread::sleep(BEAT / 25);
    }
    pipe
}

/// What a watchdog found.
#[derive(Debug, PartialEq, Eq)]
enum Verdict {
    Done,
    Died,
    Hangs,
}

/// Watches the process that speaks through the standard input, until it is done.
///
/// # Errors
/// Orders that are none; lamps that cannot be put out.
pub fn watch() -> anyhow::Result<String> {
    let mut first = String::new();
    std::io::stdin().lock().read_line(&mut first)?;
    let orders: Orders = serde_json::from_str(&first).context("`relume rig watch` is started by captures alone")?;
    let what = match listen(Duration::try_from_secs_f64(orders.limit_s)?) {
        Verdict::Done => return Ok(String::new()),
        Verdict::Died => "the capture ended without a word".to_owned(),
        Verdict::Hangs => {
            end(orders.process);
            format!("the capture gave no sign of life for {} s and was ended", orders.limit_s)
        }
    };
    match dark(&orders) {
        Ok(()) => {
            crate::complain(&format!("watchdog: {what}; all lamps are off, the session keeps what was finished"));
            Ok(String::new())
        }
        Err(trouble) => Err(anyhow::anyhow!("watchdog: {what}, and {trouble}; switch the lamps off by hand")),
    }
}

fn listen(limit: Duration) -> Verdict {
    let (tell, told) = channel();
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines() {
            let Ok(line) = line else { break };
            if tell.send(line).is_err() {
                break;
            }
        }
    });
    loop {
        match told.recv_timeout(limit) {
            Ok(line) if line == END => return Verdict::Done,
            Ok(_) => {}
            Err(RecvTimeoutError::Disconnected) => return Verdict::Died,
            Err(RecvTimeoutError::Timeout) => return Verdict::Hangs,
        }
    }
}

/// Ends a process that hangs; it cannot be asked.
fn end(process: u32) {
    let process = process.to_string();
    let _ = if cfg!(windows) {
        Command::new("taskkill").args(["/F", "/PID", &process]).status()
    } else {
        Command::new("kill").args(["-9", &process]).status()
    };
}

fn dark(orders: &Orders) -> Result<(), Trouble> {
    let begun = Instant::now();
    loop {
        match lights::open(&orders.lamps, orders.bulbs).and_then(|mut lights| lights.dark()) {
            Err(_) if begun.elapsed() < FREE_WITHIN => std::thread::sleep(BEAT),
            other => return other,
        }
    }
}
