//! What a rig can be asked to show.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A light condition. Lamps, stops, patterns and squares count from 0 here and in the journal, from 1 in what people read.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Condition {
    /// One lamp of a stage.
    Lamp(usize),
    /// Every lamp that can be lit with the turntable at a stop.
    AllLamps {
        /// Stop of the turntable.
        stop: usize,
    },
    /// Nothing emitted.
    Black {
        /// Stop of the turntable, or position of the projector.
        stop: usize,
    },
    /// A white ball in the object's place under one lamp.
    WhiteBall(usize),
    /// A flat white card in the object's place, facing the camera, under one lamp: evens out near lamps.
    FlatField(usize),
    /// A colour chart in the object's place, facing the camera, under all lamps of the first stop.
    Chart,
    /// Pattern number `number` of the set called `set` on a screen, or a projector's from `stop`.
    Pattern {
        /// Name of the set: `noise`, `squares`, `gray-code`...
        set: String,
        /// Its number in the set.
        number: usize,
        /// Position of the projector; 0 for a screen.
        stop: usize,
    },
    /// A screen or projector all white.
    White {
        /// Position of the projector; 0 for a screen.
        stop: usize,
    },
    /// A picture shown on a screen, a file in the session's `references/`.
    Picture(String),
}

impl Condition {
    /// The largest number in it: what comes from a file is checked before it is counted with.
    pub fn largest(&self) -> usize {
        match self {
            Condition::Lamp(lamp) | Condition::WhiteBall(lamp) | Condition::FlatField(lamp) => *lamp,
            Condition::AllLamps { stop } | Condition::Black { stop } | Condition::White { stop } => *stop,
            Condition::Pattern { number, stop, .. } => *(number.max(stop)),
            Condition::Chart | Condition::Picture(_) => 0,
        }
    }

    /// Where the turntable or the arm has to be.
    pub fn stop(&self, lamps_per_stop: usize) -> usize {
        match self {
            Condition::Lamp(lamp) | Condition::WhiteBall(lamp) | Condition::FlatField(lamp) => {
                lamp / lamps_per_stop.max(1)
            }
            Condition::AllLamps { stop }
            | Condition::Black { stop }
            | Condition::White { stop }
            | Condition::Pattern { stop, .. } => *stop,
            Condition::Picture(_) | Condition::Chart => 0,
        }
    }
}

impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Condition::Lamp(lamp) => write!(f, "lamp {}", lamp + 1),
            Condition::AllLamps { stop } => write!(f, "all lamps, stop {}", stop + 1),
            Condition::Black { stop } => write!(f, "black, stop {}", stop + 1),
            Condition::WhiteBall(lamp) => write!(f, "white ball, lamp {}", lamp + 1),
            Condition::FlatField(lamp) => write!(f, "flat field, lamp {}", lamp + 1),
            Condition::Chart => write!(f, "colour chart"),
            Condition::Pattern { set, number, stop: 0 } => write!(f, "{set} {}", number + 1),
            Condition::Pattern { set, number, stop } => write!(f, "{set} {}, stop {}", number + 1, stop + 1),
            Condition::White { stop } => write!(f, "white, stop {}", stop + 1),
            Condition::Picture(name) => write!(f, "picture {name}"),
        }
    }
}
