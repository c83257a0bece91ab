//! An ENTTEC DMX USB Pro, or what speaks as it does ("DMX USB Pro Widget API Specification 1.44").
//!
//! A frame of levels, `7E 06 length(2) 00 ch1 ch2... E7`, is not answered. So behind it goes a question that every widget answers: its
//! serial number (label 10) or its parameters (label 3), in turn, so that a late answer to the one is not taken for an answer
//! to the other. Widgets work in order: the answer says that the frame before was taken. The frame goes out twice, since behind
//! plain serial lines, which home-made widgets have, a byte may get lost, and nothing says so.

use std::time::{Duration, Instant};

use super::patch::{CHANNELS, Patch};
use super::{Lights, mistaken};
use crate::devices::port::{Port, pause, seconds};
use crate::devices::{Finding, Trouble};
use crate::rigs::LampsDevice;

const START: u8 = 0x7e;
const END: u8 = 0xe7;
/// Start, label, length in two bytes.
const HEAD: usize = 4;
/// Longer messages are noise: 512 channels behind a start code and a status.
const LONGEST: usize = 600;
const GET_PARAMETERS: u8 = 3;
const SEND_DMX: u8 = 6;
const GET_SERIAL: u8 = 10;
/// Widgets send no shorter frames.
const LEAST_CHANNELS: usize = 24;
/// The port is virtual: any speed does; this one is what FTDI's chips start with.
const BAUD: u32 = 57_600;
/// The same is asked so often before a person is.
const ATTEMPTS: usize = 4;
/// A frame of 512 channels is on the line for 23 ms; what was sent last is out after two.
const ON_THE_LINE: Duration = Duration::from_millis(46);

/// The widget.
pub struct DmxUsbPro {
    port: Option<Port>,
    name: String,
    reply: Duration,
    settle: Duration,
    patch: Patch,
    /// Channels up to the last one in use.
    used: usize,
    asks_serial: bool,
}

impl DmxUsbPro {
    /// Opens the widget of a rig file with so many lamps.
    ///
    /// # Errors
    /// No such port; wrong channels. Whether it answers is seen at preflight.
    pub fn open(device: &LampsDevice, lamps: usize) -> Result<Self, Trouble> {
        let LampsDevice::DmxUsbPro { port, reply_s, wiring } = device else { return Err(mistaken()) };
        let patch = Patch::new(wiring, lamps)?;
        let used = wiring.channels(lamps).into_iter().max().map_or(0, usize::from).max(LEAST_CHANNELS);
        Ok(Self {
            port: Some(Port::open(port, BAUD)?),
            name: port.clone(),
            reply: seconds(*reply_s),
            settle: seconds(wiring.settle_s),
            patch,
            used,
            asks_serial: true,
        })
    }

    fn port(&mut self) -> Result<&mut Port, Trouble> {
        if self.port.is_none() {
            self.port = Some(Port::open(&self.name, BAUD)?);
        }
        self.port.as_mut().ok_or_else(mistaken)
    }

    /// Sends levels, until the widget says that it has them.
    fn send(&mut self, levels: &[u8]) -> Result<(), Trouble> {
        let frame = message(SEND_DMX, &[&[0], levels].concat());
        for _ in 0..ATTEMPTS {
            if self.asked(&[&frame[..], &frame].concat())?.is_some() {
                return Ok(());
            }
        }
        Err(self.silent())
    }

    fn silent(&self) -> Trouble {
        let what = format!("the lamps' DMX widget at {} does not answer", self.name);
        Trouble::stop(what, "check that it is a DMX USB Pro, its cable, and that no other program holds it")
    }

    /// Sends this, and a question behind it; the answer, where one came in time.
    fn asked(&mut self, before: &[u8]) -> Result<Option<Vec<u8>>, Trouble> {
        self.asks_serial = !self.asks_serial;
        let label = if self.asks_serial { GET_SERIAL } else { GET_PARAMETERS };
        // Of its parameters no part that users wrote.
        let question = if self.asks_serial { message(GET_SERIAL, &[]) } else { message(GET_PARAMETERS, &[0, 0]) };
        let reply = self.reply;
        let port = self.port()?;
        port.buffer().clear();
        port.send(&[before, &question].concat())?;
        let by = Instant::now() + reply;
        loop {
            while let Some((answered, data)) = next_message(port.buffer()) {
                if answered == label {
                    return Ok(Some(data));
                }
            }
            if !port.fill(by)? {
                // What is late is not left for the next question.
                port.drain(reply / 4)?;
                return Ok(None);
            }
        }
    }

    fn found(&mut self) -> Result<String, Trouble> {
        let (mut firmware, mut serial) = (None, None);
        for _ in 0..2 * ATTEMPTS {
            let answer = self.asked(&[])?;
            match (self.asks_serial, answer.as_deref()) {
                (true, Some(&[a, b, c, d])) => serial = Some(format!("{d:02x}{c:02x}{b:02x}{a:02x}")),
                (false, Some([low, high, ..])) => firmware = Some(format!("{high}.{low:02}")),
                _ => {}
            }
            if let (Some(firmware), Some(serial)) = (&firmware, &serial) {
                return Ok(format!("lamps: DMX widget at {}, firmware {firmware}, serial {serial}", self.name));
            }
        }
        match firmware.or(serial) {
            Some(_) => Ok(format!("lamps: DMX widget at {}", self.name)),
            None => Err(self.silent()),
        }
    }
}

impl Lights for DmxUsbPro {
    fn preflight(&mut self) -> Vec<Finding> {
        vec![match self.found() {
            Ok(text) => Finding::fine(text),
            Err(trouble) => Finding::missing(trouble.to_string()),
        }]
    }

    fn show(&mut self, levels: &[u8]) -> Result<(), Trouble> {
        let universe = self.patch.universe(levels)?;
        let used = self.used;
        self.send(&universe[..used])?;
        pause(self.settle)
    }

    fn dark(&mut self) -> Result<(), Trouble> {
        if self.send(&[0; CHANNELS]).is_err() {
            // Perhaps the cable is in again.
            self.port = None;
            self.send(&[0; CHANNELS])?;
        }
        std::thread::sleep(ON_THE_LINE.min(self.settle));
        Ok(())
    }
}

/// A message as bytes.
fn message(label: u8, data: &[u8]) -> Vec<u8> {
    let [low, high] = (data.len() as u16).to_le_bytes();
    [&[START, label, low, high], data, &[END]].concat()
}

/// Takes the next whole message out of what came; noise before it is dropped.
fn next_message(bytes: &mut Vec<u8>) -> Option<(u8, Vec<u8>)> {
    let mut at = 0;
    loop {
        at += bytes[at..].iter().position(|b| *b == START).unwrap_or(bytes.len() - at);
        let rest = &bytes[at..];
        let &[_, label, low, high, ..] = rest else { return None };
        let length = usize::from(u16::from_le_bytes([low, high]));
        match rest.get(HEAD + length) {
            Some(&END) => {
                let data = rest[HEAD..HEAD + length].to_vec();
                bytes.drain(..=at + HEAD + length);
                return Some((label, data));
            }
            // Still to come, unless this is noise: a message may begin behind it.
            None if length <= LONGEST && !has_later(rest) => return None,
            _ => at += 1,
        }
    }
}

/// Does a whole message begin later in these bytes?
fn has_later(bytes: &[u8]) -> bool {
    (1..bytes.len()).filter(|at| bytes[*at] == START).any(|at| {
        let rest = &bytes[at..];
        let &[_, _, low, high, ..] = rest else { return false };
        rest.get(HEAD + usize::from(u16::from_le_bytes([low, high]))) == Some(&END)
    })
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    fn noise(seed: u64, count: usize) -> Vec<u8> {
        let mut rng = rand_pcg::Pcg32::seed_from_u64(seed);
        (0..count).map(|_| rng.random()).collect()
    }

    #[test]
    fn frames_are_as_the_specification_says() {
        assert_eq!(message(SEND_DMX, &[0, 1, 2]), [0x7e, 6, 3, 0, 0, 1, 2, 0xe7]);
        let long = message(SEND_DMX, &[0; 513]);
        assert_eq!((long[2], long[3], long.len()), (1, 2, 518));
    }

    #[test]
    fn messages_are_found_behind_and_between_noise() {
        for seed in 0..300 {
            let noise = noise(seed, (seed % 50) as usize);
            let mut bytes =
                [&noise[..], &message(GET_SERIAL, &[1, 2, 3, 4]), &message(GET_PARAMETERS, &[9; 5])].concat();
            let mut labels = Vec::new();
            while let Some((label, _)) = next_message(&mut bytes) {
                labels.push(label);
            }
            assert!(labels.contains(&GET_PARAMETERS), "seed {seed}: {labels:?}");
        }
        let mut half = message(GET_SERIAL, &[1, 2, 3, 4]);
        let rest = half.split_off(5);
        assert_eq!(next_message(&mut half), None);
        half.extend(rest);
        assert_eq!(next_message(&mut half), Some((GET_SERIAL, vec![1, 2, 3, 4])));
        assert!(half.is_empty());
    }
}
