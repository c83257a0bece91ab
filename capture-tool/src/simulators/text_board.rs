//! A board that lights lamps by lines of text, with the templates that the rig file gives.

use std::collections::VecDeque;
use std::time::Instant;

use super::served::Board;
use super::world::{CHANNELS, World};

/// What it understands, and answers.
#[derive(Debug, Clone)]
pub struct Templates {
    /// Lights a lamp.
    pub on: String,
    /// Puts one out.
    pub off: Option<String>,
    /// Puts all out.
    pub all_off: String,
    /// Answers each line that was understood.
    pub reply: Option<String>,
    /// What ends lines, both ways.
    pub ends: String,
}

/// The board; its lamp n is channel n of the world.
pub struct TextBoard {
    templates: Templates,
    world: World,
    bytes: Vec<u8>,
    answers: VecDeque<Vec<u8>>,
}

impl TextBoard {
    /// A board that lights this world.
    pub fn new(templates: Templates, world: World) -> Self {
        Self { templates, world, bytes: Vec::new(), answers: VecDeque::new() }
    }

    fn line(&mut self, line: &str) {
        let Templates { on, off, all_off, reply, ends } = self.templates.clone();
        let off = off.unwrap_or_default();
        let lamp = if line == all_off {
            self.world.light(&[0; CHANNELS]);
            0
        } else if let Some((lamp, level)) = read(&on, line) {
            self.world.light_one(lamp, level.unwrap_or(u8::MAX));
            lamp
        } else if let Some((lamp, _)) = read(&off, line) {
            self.world.light_one(lamp, 0);
            lamp
        } else {
            self.answers.push_back(format!("?{ends}").into_bytes());
            return;
        };
        self.world.publish();
        if let Some(reply) = reply {
            self.answers.push_back(format!("{}{ends}", reply.replace("{lamp}", &lamp.to_string())).into_bytes());
        }
    }
}

/// Lamp and level of a line that fits a template.
fn read(template: &str, line: &str) -> Option<(usize, Option<u8>)> {
    let (mut lamp, mut level) = (None, None);
    let (mut template, mut line) = (template, line);
    while let Some(open) = template.find('{') {
        line = line.strip_prefix(&template[..open])?;
        let close = template.find('}')?;
        let digits = line.find(|c: char| !c.is_ascii_digit()).unwrap_or(line.len());
        match &template[open..=close] {
            "{lamp}" => lamp = Some(line[..digits].parse().ok()?),
            "{level}" => level = Some(line[..digits].parse().ok()?),
            _ => return None,
        }
        (template, line) = (&template[close + 1..], &line[digits..]);
    }
    (template == line).then_some(())?;
    lamp.map(|lamp| (lamp, level))
}

impl Board for TextBoard {
    fn opened(&mut self) {
        self.bytes.clear();
    }

    fn take(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
        let ends = self.templates.ends.clone().into_bytes();
        while let Some(at) = self.bytes.windows(ends.len().max(1)).position(|window| window == ends) {
            let line: Vec<u8> = self.bytes.drain(..at + ends.len()).collect();
            let text = String::from_utf8_lossy(&line[..at]).into_owned();
            self.line(&text);
        }
    }

    fn answer(&mut self) -> Option<Vec<u8>> {
        self.answers.pop_front()
    }

    fn wakes(&self) -> Option<Instant> {
        None
    }

    fn works(&self) -> bool {
        true
    }

    fn restart(&mut self) {
        self.world.light(&[0; CHANNELS]);
        self.bytes.clear();
        self.answers.clear();
    }
}
