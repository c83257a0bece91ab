//! An ENTTEC DMX USB Pro, or what speaks as it does ("DMX USB Pro Widget API Specification 1.44").
//!
//! A frame of levels, `7E 06 length(2) 00 ch1 ch2... E7`, is not answered. So behind it goes a question that every widget answers: its
//! parameters (label 3). Widgets work in order: the answer says that the frame before was taken. With the parameters the widget
//! sends as many bytes of what users stored in it as it was asked for, each time another number, so that a late answer is not
//! taken for the next one's; of widgets that ignore the number what is late is waited out. No other question follows a frame: a
//! widget stops sending and turns its port to input at any but this one. Frames have all channels, since some widgets take no
//! other length, and lamps beyond the last one in use would keep what they had. A frame goes out until it is confirmed twice, since behind plain serial lines, which home-made widgets have, bytes of a
//! frame may get lost and those of the question behind it not.

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
/// The port is virtual: any speed does; this one is what FTDI's chips start with.
const BAUD: u32 = 57_600;
/// Parameters without what users stored: firmware in two bytes, break, mark, rate.
const PARAMETERS: usize = 5;
/// Numbers of stored bytes that are asked for, from 1.
const NUMBERS: usize = 40;
/// The same is sent so often before a person is asked, and has to be confirmed so often.
const ATTEMPTS: usize = 5;
const CONFIRMED: usize = 2;
/// A frame of 512 channels is on the line for 23 ms; what was sent last is out after two.
const ON_THE_LINE: Duration = Duration::from_millis(46);

/// The widget.
pub struct DmxUsbPro {
    port: Option<Port>,
    name: String,
    reply: Duration,
    settle: Duration,
    patch: Patch,
    /// Questions asked.
    asked: usize,
    /// Its answers are as long as was asked for; not known before the first one.
    counts: Option<bool>,
}

impl DmxUsbPro {
    /// Opens the widget of a rig file with so many lamps.
    ///
    /// # Errors
    /// No such port; wrong channels. Whether it answers is seen at preflight.
    pub fn open(device: &LampsDevice, lamps: usize) -> Result<Self, Trouble> {
        let LampsDevice::DmxUsbPro { port, reply_s, wiring } = device else { return Err(mistaken()) };
        let patch = Patch::new(wiring, lamps)?;
        Ok(Self {
            port: Some(Port::open(port, BAUD)?),
            name: port.clone(),
            reply: seconds(*reply_s),
            settle: seconds(wiring.settle_s),
            patch,
            asked: 0,
            counts: None,
        })
    }

    fn port(&mut self) -> Result<&mut Port, Trouble> {
        if self.port.is_none() {
            self.port = Some(Port::open(&self.name, BAUD)?);
        }
        self.port.as_mut().ok_or_else(mistaken)
    }

    /// Sends levels, until the widget says that it has them.
    fn send(&mut self, levels: &[u8; CHANNELS]) -> Result<(), Trouble> {
        let frame = message(SEND_DMX, &[&[0], &levels[..]].concat());
        let mut confirmed = 0;
        for _ in 0..ATTEMPTS {
            confirmed += usize::from(self.answer(false, &frame)?.is_some());
            if confirmed == CONFIRMED {
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
    fn answer(&mut self, serial: bool, before: &[u8]) -> Result<Option<Vec<u8>>, Trouble> {
        self.asked += 1;
        let (label, number) = if serial { (GET_SERIAL, 0) } else { (GET_PARAMETERS, 1 + self.asked % NUMBERS) };
        let question = if serial { message(label, &[]) } else { message(label, &[number as u8, 0]) };
        let reply = self.reply;
        let port = self.port()?;
        port.buffer().clear();
        port.send(&[before, &question].concat())?;
        let by = Instant::now() + reply;
        loop {
            while let Some((answered, data)) = next_message(self.port()?.buffer()) {
                let counted = data.len() == PARAMETERS + number;
                let uncounted = data.len() == PARAMETERS && self.counts != Some(true);
                if answered == label && (serial || counted || uncounted) {
                    if !serial {
                        self.counts = Some(counted);
                    }
                    return Ok(Some(data));
                }
            }
            if !self.port()?.fill(by)? {
                // What is late is not left for the next question.
                self.port()?.drain(reply / 4)?;
                return Ok(None);
            }
        }
    }

    fn found(&mut self) -> Result<String, Trouble> {
        let firmware = (0..ATTEMPTS).find_map(|_| self.answer(false, &[]).transpose()).transpose()?;
        let serial = (0..ATTEMPTS).find_map(|_| self.answer(true, &[]).transpose()).transpose()?;
        let mut told = format!("lamps: DMX widget at {}", self.name);
        match firmware.as_deref() {
            Some([low, high, ..]) => told += &format!(", firmware {high}.{low:02}"),
            _ => return Err(self.silent()),
        }
        if let Some(&[a, b, c, d]) = serial.as_deref() {
            told += &format!(", serial {d:02x}{c:02x}{b:02x}{a:02x}");
        }
        Ok(told)
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
        self.send(&universe)?;
        pause(self.settle)
    }

    /// A widget that lost its power has put its lamps out, and its port is gone.
    fn confirm(&mut self) -> Result<(), Trouble> {
        for _ in 0..ATTEMPTS {
            if self.answer(false, &[])?.is_some() {
                return Ok(());
            }
        }
        Err(self.silent())
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
