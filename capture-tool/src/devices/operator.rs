//! Who puts the ball in place when asked to.

use std::io::{BufRead, IsTerminal};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use super::Trouble;
use crate::progress;

/// So often a request to stop is looked for while an answer is waited for.
const LOOK: Duration = Duration::from_millis(50);

/// A person on set.
pub trait Operator: Send + Sync {
    /// Asks for something to be done ("put the white ball in the object's place"), and returns when it is.
    ///
    /// # Errors
    /// Nobody is there to ask; a request to stop.
    fn ask(&self, request: &str) -> Result<(), Trouble>;
}

/// The person before the terminal that `relume` runs in.
#[derive(Debug)]
pub struct AtTerminal;

impl Operator for AtTerminal {
    fn ask(&self, request: &str) -> Result<(), Trouble> {
        if !std::io::stdin().is_terminal() {
            let advice = "nobody can be asked: run relume in a terminal";
            return Err(Trouble::stop(format!("the operator is to {request}"), advice));
        }
        crate::complain(&format!("\n>> {}, then press Enter", capitalised(request)));
        let (done, answer) = channel();
        // Left behind, blocked in its read, when the person stops the tool in place of answering.
        std::thread::spawn(move || done.send(std::io::stdin().lock().lines().next().is_some()));
        loop {
            match answer.recv_timeout(LOOK) {
                Ok(true) => return Ok(()),
                Ok(false) | Err(RecvTimeoutError::Disconnected) => {
                    return Err(Trouble::stop("the terminal was closed", "run relume in a terminal"));
                }
                Err(RecvTimeoutError::Timeout) => progress::check()?,
            }
        }
    }
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// Does at once what it is asked: of tests and rehearsals.
#[derive(Debug, Default)]
pub struct Willing {
    /// What was asked so far.
    pub asked: std::sync::Mutex<Vec<String>>,
}

impl Operator for Willing {
    fn ask(&self, request: &str) -> Result<(), Trouble> {
        self.asked.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push(request.to_owned());
        Ok(())
    }
}
