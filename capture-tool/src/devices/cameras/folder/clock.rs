//! The camera's clock against ours, as far as its photographs have told: a file whose time lies elsewhere is of another exposure.
//!
//! A camera says the second in which an exposure began; we know that it began between asking for it and finding its file. So each
//! photograph bounds the difference of the two clocks, all of them together better than one, and a file that was exposed half a minute before
//! it was asked for falls outside.

use std::time::Instant;

/// EXIF times are cut off to the second.
const SECOND_S: f64 = 1.0;
/// Cameras write the time of the exposure's beginning, or of its end, or of writing the file; and clocks drift.
const SLACK_S: f64 = 2.0;

/// The camera's clock.
#[derive(Debug)]
pub struct CameraClock {
    start: Instant,
    /// Bounds of the camera's time minus ours, seconds.
    ahead_s: Option<[f64; 2]>,
}

impl Default for CameraClock {
    fn default() -> Self {
        Self { start: Instant::now(), ahead_s: None }
    }
}

impl CameraClock {
    /// What a photograph bounds the difference to: taken at `taken_s` of the camera's clock, within a time of ours.
    fn bounds(&self, taken_s: f64, window: [Instant; 2]) -> [f64; 2] {
        let [from, to] = window.map(|instant| instant.saturating_duration_since(self.start).as_secs_f64());
        [taken_s - to, taken_s + SECOND_S - from]
    }

    /// Can a photograph be of an exposure within this time? The first one can always.
    pub fn agrees(&self, taken_s: f64, window: [Instant; 2]) -> bool {
        let [least, most] = self.bounds(taken_s, window);
        self.ahead_s.is_none_or(|[from, to]| most >= from - SLACK_S && least <= to + SLACK_S)
    }

    /// Of a photograph that was within this time.
    pub fn learn(&mut self, taken_s: f64, window: [Instant; 2]) {
        let [least, most] = self.bounds(taken_s, window);
        let [from, to] = self.ahead_s.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let (from, to) = (from.max(least), to.min(most));
        // Drifted clocks contradict what was known: the newest counts.
        self.ahead_s = Some(if from <= to { [from, to] } else { [least, most] });
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn files_of_other_exposures_stand_out() {
        let mut clock = CameraClock::default();
        let at = |s: f64| clock_start() + Duration::from_secs_f64(s);
        clock.start = at(0.0);
        // The camera's clock is 1000 s ahead.
        assert!(clock.agrees(5.0, [at(0.0), at(1.0)]), "nothing is known yet");
        clock.learn(1010.0, [at(10.0), at(12.0)]);
        clock.learn(1020.0, [at(20.3), at(20.9)]);
        let fresh = [at(60.0), at(61.0)];
        assert!(clock.agrees(1060.0, fresh));
        assert!(!clock.agrees(1020.0, fresh), "40 s late");
        assert!(!clock.agrees(1055.0, fresh), "5 s late");
        assert!(!clock.agrees(1070.0, fresh));
        // A long wait for a file leaves room for when it was exposed.
        assert!(clock.agrees(1063.0, [at(60.0), at(90.0)]));
    }

    fn clock_start() -> Instant {
        use std::sync::OnceLock;
        static START: OnceLock<Instant> = OnceLock::new();
        *START.get_or_init(Instant::now)
    }
}
