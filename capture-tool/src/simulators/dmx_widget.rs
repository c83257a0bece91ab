//! An ENTTEC DMX USB Pro ("DMX USB Pro Widget API Specification 1.44"): messages `7E label length(2) data E7`.

use std::collections::VecDeque;
use std::time::Instant;

use super::served::Board;
use super::world::{CHANNELS, World};

const START: u8 = 0x7e;
const END: u8 = 0xe7;
/// Label, length.
const HEAD: usize = 4;
/// The longest message: 512 channels and a start code.
const LONGEST: usize = CHANNELS + 1;
/// Bytes that users can store in it.
const MOST_STORED: usize = 508;
/// Of the labels, those that a sender of DMX needs.
const GET_PARAMETERS: u8 = 3;
const SEND_DMX: u8 = 6;
const GET_SERIAL: u8 = 10;
/// Serial number 02170815, decimal digits in pairs, the last pair first.
const SERIAL: [u8; 4] = [0x15, 0x08, 0x17, 0x02];

/// The widget.
pub struct DmxWidget {
    world: World,
    bytes: Vec<u8>,
    answers: VecDeque<Vec<u8>>,
}

impl DmxWidget {
    /// A widget that lights this world.
    pub fn new(world: World) -> Self {
        Self { world, bytes: Vec::new(), answers: VecDeque::new() }
    }

    fn message(&mut self, label: u8, data: &[u8]) {
        match label {
            SEND_DMX => {
                // Start code 0: levels. Anything else is for other devices on the line.
                if let [0, levels @ ..] = data {
                    self.world.light(levels);
                    self.world.publish();
                }
            }
            GET_PARAMETERS => {
                self.world.publish();
                // Firmware 1.44; break and mark times and rate as it is delivered; so much of what users stored as was asked for.
                let wanted = if let [low, high, ..] = *data { usize::from(u16::from_le_bytes([low, high])) } else { 0 };
                let parameters = [&[44, 1, 9, 1, 40][..], &vec![0; wanted.min(MOST_STORED)]].concat();
                self.answers.push_back(message(GET_PARAMETERS, &parameters));
            }
            // At any question but that for its parameters it sends no more and turns its port to input.
            GET_SERIAL => {
                self.world.light(&[0; CHANNELS]);
                self.world.publish();
                self.answers.push_back(message(GET_SERIAL, &SERIAL));
            }
            // Old widgets say nothing to what they do not know.
            _ => {}
        }
    }
}

/// A message as bytes.
fn message(label: u8, data: &[u8]) -> Vec<u8> {
    let [low, high] = (data.len() as u16).to_le_bytes();
    [&[START, label, low, high], data, &[END]].concat()
}

impl Board for DmxWidget {
    fn opened(&mut self) {
        self.bytes.clear();
    }

    fn take(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
        loop {
            let start = self.bytes.iter().position(|b| *b == START).unwrap_or(self.bytes.len());
            self.bytes.drain(..start);
            let &[_, label, low, high, ..] = &self.bytes[..] else { return };
            let length = usize::from(u16::from_le_bytes([low, high]));
            if length > LONGEST {
                self.bytes.remove(0);
                continue;
            }
            let Some(end) = self.bytes.get(HEAD + length) else { return };
            if *end != END {
                self.bytes.remove(0);
                continue;
            }
            let whole: Vec<u8> = self.bytes.drain(..=HEAD + length).collect();
            self.message(label, &whole[HEAD..HEAD + length]);
        }
    }

    fn answer(&mut self) -> Option<Vec<u8>> {
        self.answers.pop_front()
    }

    fn wakes(&self) -> Option<Instant> {
        None
    }

    /// With a question that is not answered yet.
    fn works(&self) -> bool {
        !self.answers.is_empty()
    }

    /// Lamps go out until the next frame.
    fn restart(&mut self) {
        self.world.light(&[0; CHANNELS]);
        self.bytes.clear();
        self.answers.clear();
    }
}
