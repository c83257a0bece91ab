//! What boards move and light.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Axes of a board.
pub const AXES: usize = 4;
/// Channels of a universe.
pub const CHANNELS: usize = 512;

/// What there is to be seen at an instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    /// Where the axes stand, in the board's units from where the switches are.
    pub at: [f64; AXES],
    /// Do they move?
    pub moving: bool,
    /// Levels of channels, the first one at 0.
    pub levels: Vec<u8>,
}

/// A stretch of motion at constant speed.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    from: [f64; AXES],
    to: [f64; AXES],
    begin: Instant,
    end: Instant,
}

struct Inner {
    /// Where the axes stand when all stretches are done.
    rest: [f64; AXES],
    stretches: Vec<Stretch>,
    levels: Vec<u8>,
}

/// Told what is to be seen, whenever a board is about to confirm something.
type Watcher = Box<dyn FnMut(&Seen) + Send>;

/// Axes and lamps. Clones are the same world.
#[derive(Clone)]
pub struct World {
    inner: Arc<Mutex<Inner>>,
    watcher: Arc<Mutex<Option<Watcher>>>,
}

impl Default for World {
    fn default() -> Self {
        let inner = Inner { rest: [0.0; AXES], stretches: Vec::new(), levels: vec![0; CHANNELS] };
        Self { inner: Arc::new(Mutex::new(inner)), watcher: Arc::default() }
    }
}

impl World {
    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Calls this before anything is confirmed.
    pub fn watch(&self, watcher: impl FnMut(&Seen) + Send + 'static) {
        *self.watcher.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(watcher));
    }

    /// Something is about to be confirmed: whoever watches is told first.
    pub fn publish(&self) {
        let seen = self.seen();
        if let Some(watcher) = self.watcher.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
            watcher(&seen);
        }
    }

    /// Now.
    pub fn seen(&self) -> Seen {
        let now = Instant::now();
        let inner = self.inner();
        Seen { at: inner.at(now), moving: inner.moving(now), levels: inner.levels.clone() }
    }

    /// Moves on to there, behind what is under way, in so long; returns when it will have arrived.
    pub fn plan(&self, to: [f64; AXES], takes: Duration) -> Instant {
        let now = Instant::now();
        let mut inner = self.inner();
        inner.stretches.retain(|stretch| stretch.end > now);
        let from = inner.rest;
        let begin = inner.stretches.last().map_or(now, |last| last.end);
        let end = begin + takes;
        inner.stretches.push(Stretch { from, to, begin, end });
        inner.rest = to;
        end
    }

    /// Where it will stand when all is done.
    pub fn rest(&self) -> [f64; AXES] {
        self.inner().rest
    }

    /// Stops at once; returns where.
    pub fn stop(&self) -> [f64; AXES] {
        let mut inner = self.inner();
        inner.rest = inner.at(Instant::now());
        inner.stretches.clear();
        inner.rest
    }

    /// Somebody puts the axes there by hand.
    #[cfg(test)]
    pub fn put(&self, at: [f64; AXES]) {
        let mut inner = self.inner();
        inner.stretches.clear();
        inner.rest = at;
    }

    /// Gives channels from the first one on their levels; what lies beyond is left as it is.
    pub fn light(&self, levels: &[u8]) {
        let mut inner = self.inner();
        let count = levels.len().min(CHANNELS);
        inner.levels[..count].copy_from_slice(&levels[..count]);
    }

    /// Gives one channel, counted from 0, its level.
    pub fn light_one(&self, channel: usize, level: u8) {
        if let Some(there) = self.inner().levels.get_mut(channel) {
            *there = level;
        }
    }
}

impl Inner {
    fn at(&self, now: Instant) -> [f64; AXES] {
        let Some(stretch) = self.stretches.iter().find(|stretch| now < stretch.end) else { return self.rest };
        let whole = stretch.end.duration_since(stretch.begin).as_secs_f64();
        let share = now.saturating_duration_since(stretch.begin).as_secs_f64() / whole.max(1e-9);
        std::array::from_fn(|n| stretch.from[n] + share.min(1.0) * (stretch.to[n] - stretch.from[n]))
    }

    fn moving(&self, now: Instant) -> bool {
        self.stretches.iter().any(|stretch| now < stretch.end && stretch.from != stretch.to)
    }
}
