//! Which channel of a DMX universe each lamp is on.

use crate::devices::Trouble;
use crate::rigs::Wiring;

/// Channels of a universe (ANSI E1.11).
pub const CHANNELS: usize = 512;

/// Channels of lamps, counted from 0.
#[derive(Debug, Clone)]
pub struct Patch {
    channels: Vec<usize>,
}

impl Patch {
    /// Of so many lamps.
    ///
    /// # Errors
    /// Channels that are none, or fewer than lamps.
    pub fn new(wiring: &Wiring, lamps: usize) -> Result<Self, Trouble> {
        let channels = wiring.channels(lamps);
        if channels.len() < lamps {
            let what = format!("channel_of names {} channels, and there are {lamps} lamps", channels.len());
            return Err(Trouble::stop(what, "name one a lamp in the rig file"));
        }
        if let Some(wrong) = channels.iter().find(|channel| !(1..=CHANNELS).contains(&usize::from(**channel))) {
            return Err(Trouble::stop(format!("channel_of names channel {wrong}"), "a universe has channels 1 to 512"));
        }
        Ok(Self { channels: channels.iter().map(|channel| usize::from(*channel) - 1).collect() })
    }

    /// The universe under levels of lamps; what is no lamp's is 0.
    ///
    /// # Errors
    /// More levels than lamps.
    pub fn universe(&self, levels: &[u8]) -> Result<[u8; CHANNELS], Trouble> {
        if levels.len() > self.channels.len() {
            let what = format!("{} lamps were to be lit, and {} have channels", levels.len(), self.channels.len());
            return Err(Trouble::stop(what, "name one channel a lamp in the rig file"));
        }
        let mut universe = [0; CHANNELS];
        levels.iter().zip(&self.channels).for_each(|(level, channel)| universe[*channel] = *level);
        Ok(universe)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wiring(channel_of: &[u16]) -> Wiring {
        Wiring { channel_of: channel_of.to_vec(), level: 255, settle_s: 0.0 }
    }

    #[test]
    fn lamps_are_on_their_channels_alone() {
        let patch = Patch::new(&wiring(&[512, 7, 1]), 3).unwrap();
        let universe = patch.universe(&[10, 20, 0]).unwrap();
        assert_eq!((universe[511], universe[6], universe[0]), (10, 20, 0));
        assert_eq!(universe.iter().filter(|v| **v > 0).count(), 2);
        let usual = Patch::new(&wiring(&[]), 2).unwrap();
        assert_eq!(usual.universe(&[1, 2]).unwrap()[..3], [1, 2, 0]);
    }

    #[test]
    fn channels_that_are_none_are_refused() {
        for (channels, lamps, said) in
            [(&[0u16][..], 1, "channel 0"), (&[513], 1, "channel 513"), (&[1], 2, "2 lamps"), (&[], 513, "channel 513")]
        {
            let message = Patch::new(&wiring(channels), lamps).unwrap_err().to_string();
            assert!(message.contains(said), "{message}");
        }
        assert!(Patch::new(&wiring(&[1]), 1).unwrap().universe(&[1, 1]).is_err());
    }
}
