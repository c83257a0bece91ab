//! A board that takes lines of text by a template, as home-made domes do.
//!
//! Each line is answered by the reply of the template, where there is one. When a reply is wrong or does not come, nothing is
//! assumed of what the board does: all is put out and the lamps are lit again.

use std::time::{Duration, Instant};

use super::{Lights, mistaken};
use crate::devices::port::{Port, pause, seconds};
use crate::devices::{Finding, Trouble};
use crate::rigs::LampsDevice;

/// The same is asked so often before a person is.
const ATTEMPTS: usize = 3;
/// Bits of a character on a serial line: start, eight, stop.
const BITS: f64 = 10.0;

/// The board.
pub struct Text {
    port: Option<Port>,
    name: String,
    baud: u32,
    on: String,
    off: Option<String>,
    all_off: String,
    reply: Option<String>,
    ends: String,
    wait: Duration,
    settle: Duration,
    /// The board's numbers of lamps.
    numbers: Vec<i64>,
    /// Levels of lamps, as far as they are known to be so.
    shown: Option<Vec<u8>>,
}

/// A line that was not answered as it should be.
enum Unanswered {
    Wrong(String),
    Silent,
    Port(Trouble),
}

impl From<Trouble> for Unanswered {
    fn from(trouble: Trouble) -> Self {
        Self::Port(trouble)
    }
}

impl Text {
    /// Opens the board of a rig file with so many lamps.
    ///
    /// # Errors
    /// No such port; fewer numbers than lamps.
    pub fn open(device: &LampsDevice, lamps: usize) -> Result<Self, Trouble> {
        let LampsDevice::Text { port, baud, on, off, all_off, reply, ends, reply_s, first, wiring } = device else {
            return Err(mistaken());
        };
        let numbers: Vec<i64> = match wiring.channel_of.is_empty() {
            true => (0..lamps as i64).map(|lamp| lamp + first).collect(),
            false => wiring.channel_of.iter().map(|number| i64::from(*number)).collect(),
        };
        if numbers.len() < lamps {
            let what = format!("channel_of names {} lamps of the board, and there are {lamps}", numbers.len());
            return Err(Trouble::stop(what, "name one a lamp in the rig file"));
        }
        Ok(Self {
            port: Some(Port::open(port, *baud)?),
            name: port.clone(),
            baud: *baud,
            on: on.clone(),
            off: off.clone(),
            all_off: all_off.clone(),
            reply: reply.clone(),
            ends: ends.clone(),
            wait: seconds(*reply_s),
            settle: seconds(wiring.settle_s),
            numbers,
            shown: None,
        })
    }

    fn port(&mut self) -> Result<&mut Port, Trouble> {
        if self.port.is_none() {
            self.port = Some(Port::open(&self.name, self.baud)?);
        }
        self.port.as_mut().ok_or_else(mistaken)
    }

    /// Sends a line and sees that it is answered as it should be.
    fn tell(&mut self, template: &str, number: Option<i64>, level: u8) -> Result<(), Unanswered> {
        let lamp = number.map_or_else(String::new, |number| number.to_string());
        let line = format!("{}{}", template.replace("{lamp}", &lamp).replace("{level}", &level.to_string()), self.ends);
        let expected = self.reply.as_deref().map(|reply| reply.replace("{level}", &level.to_string()));
        let (wait, ends) = (self.wait, self.ends.clone());
        let on_the_line = Duration::from_secs_f64(line.len() as f64 * BITS / f64::from(self.baud.max(1)));
        let port = self.port()?;
        port.buffer().clear();
        port.send(line.as_bytes())?;
        let Some(expected) = expected else { return Ok(pause(on_the_line)?) };
        let by = Instant::now() + wait + 2 * on_the_line;
        let mut last = None;
        while let Some(said) = next_line(port, &ends, by)? {
            // Boards echo, or greet; noise is no reply.
            if fits(expected.trim(), number, &said) {
                return Ok(());
            }
            last = Some(said).filter(|said| !said.is_empty()).or(last);
        }
        Err(last.map_or(Unanswered::Silent, Unanswered::Wrong))
    }

    /// Brings the lamps from what is known of them to these levels.
    fn change(&mut self, levels: &[u8]) -> Result<(), (usize, Unanswered)> {
        let shown = self.shown.take();
        let (on, off) = (self.on.clone(), self.off.clone());
        let begin = match (shown, off) {
            (Some(shown), _) if shown == levels => shown,
            (Some(mut shown), Some(off)) => {
                for lamp in 0..levels.len() {
                    if shown[lamp] > 0 && levels[lamp] == 0 {
                        self.tell(&off, Some(self.numbers[lamp]), 0).map_err(|error| (lamp, error))?;
                        shown[lamp] = 0;
                    }
                }
                shown
            }
            (_, _) => {
                let all_off = self.all_off.clone();
                let lit = levels.iter().position(|level| *level > 0).unwrap_or_default();
                self.tell(&all_off, None, 0).map_err(|error| (lit, error))?;
                vec![0; levels.len()]
            }
        };
        for lamp in 0..levels.len() {
            if levels[lamp] != begin[lamp] {
                self.tell(&on, Some(self.numbers[lamp]), levels[lamp]).map_err(|error| (lamp, error))?;
            }
        }
        self.shown = Some(levels.to_vec());
        Ok(())
    }

    /// As [`Text::change`], as often as it takes.
    fn bring(&mut self, levels: &[u8]) -> Result<(), Trouble> {
        let mut attempt = 1;
        loop {
            let Err((lamp, error)) = self.change(levels) else { return Ok(()) };
            match error {
                Unanswered::Port(trouble) => return Err(trouble),
                _ if attempt < ATTEMPTS => {
                    // What is late is not taken for an answer to what comes; what noise began is ended.
                    let (wait, ends) = (self.wait, self.ends.clone());
                    let port = self.port()?;
                    port.drain(wait)?;
                    port.send(ends.as_bytes())?;
                    port.drain(wait / 4)?;
                    attempt += 1;
                }
                Unanswered::Silent => {
                    let what = format!("lamp {}: the board at {} does not answer", lamp + 1, self.name);
                    return Err(Trouble::stop(what, "check its cable, its power, and baud in the rig file"));
                }
                Unanswered::Wrong(said) => {
                    let said: String = said.chars().filter(|c| !c.is_control()).take(40).collect();
                    let what = format!("lamp {}: the board at {} answers \"{said}\"", lamp + 1, self.name);
                    return Err(Trouble::stop(what, "compare with on, off, all_off and reply in the rig file"));
                }
            }
        }
    }
}

/// Is this the reply? What a board calls all lamps together is its own affair.
fn fits(template: &str, number: Option<i64>, said: &str) -> bool {
    let Some((before, behind)) = template.split_once("{lamp}") else { return said == template };
    let lamp = said.strip_prefix(before).and_then(|rest| rest.strip_suffix(behind));
    lamp.is_some_and(|lamp| number.is_none_or(|number| lamp.trim() == number.to_string()))
}

/// The next line, ended as the board ends them.
fn next_line(port: &mut Port, ends: &str, by: Instant) -> Result<Option<String>, Trouble> {
    // Many boards answer with the usual end whatever they are sent.
    let ends = ends.as_bytes();
    loop {
        let buffer = port.buffer();
        let own = buffer.windows(ends.len().max(1)).position(|window| window == ends).map(|at| at + ends.len());
        let usual = buffer.iter().position(|b| *b == b'\n').map(|at| at + 1);
        if let Some(end) = [own, usual].into_iter().flatten().min() {
            let line: Vec<u8> = buffer.drain(..end).collect();
            let text = String::from_utf8_lossy(&line);
            let text = text.strip_suffix(&*String::from_utf8_lossy(ends)).unwrap_or(&text);
            return Ok(Some(text.trim().to_owned()));
        }
        if !port.fill(by)? {
            return Ok(None);
        }
    }
}

impl Lights for Text {
    fn preflight(&mut self) -> Vec<Finding> {
        let dark = vec![0; self.numbers.len()];
        self.shown = None;
        vec![match self.bring(&dark) {
            Ok(()) if self.reply.is_some() => Finding::fine(format!("lamps: a board at {} answers", self.name)),
            Ok(()) => Finding::fine(format!("lamps: a board at {} (it answers nothing: mind settle_s)", self.name)),
            Err(trouble) => Finding::missing(trouble.to_string()),
        }]
    }

    fn show(&mut self, levels: &[u8]) -> Result<(), Trouble> {
        if levels.len() > self.numbers.len() {
            let what = format!("{} lamps were to be lit, and the board has {}", levels.len(), self.numbers.len());
            return Err(Trouble::stop(what, "name one a lamp in channel_of in the rig file"));
        }
        self.bring(levels)?;
        pause(self.settle)
    }

    fn dark(&mut self) -> Result<(), Trouble> {
        let dark = vec![0; self.numbers.len()];
        self.shown = None;
        if self.bring(&dark).is_err() {
            // Perhaps the cable is in again.
            (self.port, self.shown) = (None, None);
            self.bring(&dark)?;
        }
        Ok(())
    }
}
