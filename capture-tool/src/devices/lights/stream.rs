//! Lamps over a network: levels are sent again and again, since nothing confirms them and receivers forget.
//!
//! A change goes out several times, because UDP may lose it (E1.31, 6.6.1, asks for three), and then every 0.8 s from a thread of its
//! own, also during a long exposure: sACN receivers take a source as lost after 2.5 s (E1.31, 6.7.1), Art-Net nodes after some 10 s; both
//! specifications recommend 0.8 to 1 s. At the end all channels are sent as 0.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::Lights;
use super::patch::{CHANNELS, Patch};
use crate::devices::port::pause;
use crate::devices::{Finding, Trouble};

/// A state is sent again after this time.
const AGAIN: Duration = Duration::from_millis(800);
/// A change is sent so often, with pauses of a frame of DMX at 44 Hz between.
const CHANGES: usize = 3;
const FRAME: Duration = Duration::from_millis(23);
/// "All off" is sent so often, and faster. A second process begins to number its packets anew, and receivers take
/// packets whose numbers lie up to 20 behind for old ones (E1.31, 6.7.2): of these, five come through at least.
const DARKS: usize = 25;
const DARK_PAUSE: Duration = Duration::from_millis(8);

/// What puts a universe on the network.
pub trait Carrier: Send + 'static {
    /// Sends levels of all channels once.
    ///
    /// # Errors
    /// What the system says.
    fn send(&mut self, universe: &[u8; CHANNELS]) -> Result<(), String>;

    /// What can be found out before the start.
    fn preflight(&mut self) -> Vec<Finding>;

    /// As in "Art-Net universe 0 at 10.0.0.20".
    fn name(&self) -> String;
}

/// Lamps on a carrier.
pub struct Streamed {
    shared: Arc<Shared>,
    patch: Patch,
    settle: Duration,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

struct State {
    carrier: Box<dyn Carrier>,
    universe: [u8; CHANNELS],
    /// Nothing is sent before the first call.
    begun: bool,
    ends: bool,
    /// What went wrong since the last call.
    failed: Option<String>,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sends the state again and again.
    fn keep_alive(&self) {
        let mut state = self.state();
        while !state.ends {
            state = self.changed.wait_timeout(state, AGAIN).unwrap_or_else(PoisonError::into_inner).0;
            if state.begun && !state.ends {
                let State { carrier, universe, .. } = &mut *state;
                if let Err(failed) = carrier.send(universe) {
                    state.failed = Some(failed);
                }
            }
        }
    }
}

impl Streamed {
    /// Lamps of this patch.
    ///
    /// # Errors
    /// The system's: no thread.
    pub fn new(carrier: impl Carrier, patch: Patch, settle: Duration) -> Result<Self, Trouble> {
        let state =
            State { carrier: Box::new(carrier), universe: [0; CHANNELS], begun: false, ends: false, failed: None };
        let shared = Arc::new(Shared { state: Mutex::new(state), changed: Condvar::new() });
        let theirs = shared.clone();
        let thread = std::thread::Builder::new().name("lamps".to_owned()).spawn(move || theirs.keep_alive());
        let thread = thread
            .map_err(|error| Trouble::stop(format!("no thread for the lamps ({error})"), "close other programs"))?;
        Ok(Self { shared, patch, settle, thread: Some(thread) })
    }

    /// Sends a state so often.
    fn send(&self, universe: [u8; CHANNELS], times: usize, between: Duration) -> Result<(), Trouble> {
        let mut sent = 0;
        let mut failed = None;
        for n in 0..times {
            if n > 0 {
                std::thread::sleep(between);
            }
            let mut state = self.shared.state();
            (state.universe, state.begun) = (universe, true);
            match state.carrier.send(&universe) {
                Ok(()) => sent += 1,
                Err(error) => failed = Some(error),
            }
        }
        match (sent, failed) {
            (0, Some(error)) => {
                let what = format!("lamps: nothing can be sent by {} ({error})", self.shared.state().carrier.name());
                Err(Trouble::stop(what, "check the network, and the addresses in the rig file"))
            }
            _ => Ok(()),
        }
    }
}

impl Lights for Streamed {
    fn preflight(&mut self) -> Vec<Finding> {
        self.shared.state().carrier.preflight()
    }

    fn show(&mut self, levels: &[u8]) -> Result<(), Trouble> {
        let universe = self.patch.universe(levels)?;
        let failed = self.shared.state().failed.take();
        if let Some(failed) = failed {
            let what =
                format!("lamps: {} failed during the photograph before ({failed})", self.shared.state().carrier.name());
            return Err(Trouble::stop(what, "check the network; that photograph can be taken again with --redo"));
        }
        self.send(universe, CHANGES, FRAME)?;
        pause(self.settle)
    }

    fn dark(&mut self) -> Result<(), Trouble> {
        self.send([0; CHANNELS], DARKS, DARK_PAUSE)
    }
}

impl Drop for Streamed {
    /// Off, and no thread stays behind.
    fn drop(&mut self) {
        let lit = {
            let state = self.shared.state();
            state.begun && state.universe != [0; CHANNELS]
        };
        if lit {
            let _ = self.dark();
        }
        self.shared.state().ends = true;
        self.shared.changed.notify_all();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rigs::Wiring;

    #[derive(Clone, Default)]
    struct Heard(Arc<Mutex<(Vec<u8>, bool)>>);

    impl Carrier for Heard {
        fn send(&mut self, universe: &[u8; CHANNELS]) -> Result<(), String> {
            let mut heard = self.0.lock().unwrap();
            heard.0.push(universe[0]);
            if heard.1 { Err("network is unreachable".to_owned()) } else { Ok(()) }
        }

        fn preflight(&mut self) -> Vec<Finding> {
            Vec::new()
        }

        fn name(&self) -> String {
            "a test".to_owned()
        }
    }

    fn streamed(heard: &Heard) -> Streamed {
        let wiring = Wiring { channel_of: vec![1], level: 255, settle_s: 0.0 };
        Streamed::new(heard.clone(), Patch::new(&wiring, 1).unwrap(), Duration::ZERO).unwrap()
    }

    /// Changes come several times, go on by themselves, and end dark.
    #[test]
    fn levels_are_sent_again_and_end_at_zero() {
        let heard = Heard::default();
        let mut lights = streamed(&heard);
        std::thread::sleep(Duration::from_millis(20));
        assert!(heard.0.lock().unwrap().0.is_empty(), "nothing is lit before the first call");
        lights.show(&[77]).unwrap();
        assert_eq!(heard.0.lock().unwrap().0, [77; CHANGES]);
        std::thread::sleep(AGAIN + Duration::from_millis(200));
        assert!(heard.0.lock().unwrap().0.len() > CHANGES);
        drop(lights);
        let said = heard.0.lock().unwrap().0.clone();
        assert!(said.ends_with(&[0; DARKS]) && !said[..said.len() - DARKS].contains(&0), "{said:?}");
        std::thread::sleep(Duration::from_millis(20));
        assert_eq!(heard.0.lock().unwrap().0.len(), said.len(), "nothing is sent after the end");
    }

    #[test]
    fn a_network_that_is_away_is_said() {
        let heard = Heard::default();
        heard.0.lock().unwrap().1 = true;
        let message = streamed(&heard).show(&[1]).unwrap_err().to_string();
        assert!(message.contains("network is unreachable") && message.contains("check the network"), "{message}");
    }
}
