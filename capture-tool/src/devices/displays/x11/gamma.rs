//! The gamma table of a CRTC: what the graphics card makes of codes on their way to the panel. A screenshot does not show it, so it is read.

/// A table, as the server gives it: 16 bits, one list a channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Gamma {
    /// Red, green, blue; of one length.
    pub channels: [Vec<u16>; 3],
}

impl Gamma {
    /// Entries of each channel.
    pub fn len(&self) -> usize {
        self.channels.iter().map(Vec::len).min().unwrap_or(0)
    }

    /// Has nobody written it? So it is on servers without a graphics card (Xvfb), which keep one and use none. (A card with such a table
    /// would show black alone.)
    pub fn is_unwritten(&self) -> bool {
        self.len() > 0 && self.channels.iter().flatten().all(|value| *value == 0)
    }

    /// Do codes up to `white` come out as they went in? Tables are of 16 bits and cards keep fewer, by rounding or by cutting off, so
    /// an entry may be half a code too large or one too small.
    pub fn is_identity(&self, white: u16) -> bool {
        let last = self.len().saturating_sub(1);
        let (above, below) =
            (f64::from(u16::MAX) / f64::from(white) / 2.0, 65536.0 / f64::from(white.saturating_add(1)));
        let kept = |(at, value): (usize, &u16)| {
            let off = f64::from(*value) - at as f64 / last as f64 * f64::from(u16::MAX);
            (-below - 1.0..=above + 1.0).contains(&off)
        };
        last > 0
            && self.channels.iter().all(|channel| channel.len() == last + 1 && channel.iter().enumerate().all(kept))
    }

    /// What it does, for people: the middle of each channel, and white.
    pub fn words(&self) -> String {
        let share = |value: Option<&u16>| value.map_or(0.0, |value| 100.0 * f64::from(*value) / f64::from(u16::MAX));
        let at =
            |at: usize| self.channels.iter().map(|c| format!("{:.0}", share(c.get(at)))).collect::<Vec<_>>().join(", ");
        let last = self.len().saturating_sub(1);
        format!("red, green, blue of white become {} %, of middle grey {} %", at(last), at(last / 2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(entries: usize, value: impl Fn(f64) -> f64) -> Gamma {
        let list: Vec<u16> = (0..entries).map(|n| value(n as f64 / (entries - 1) as f64) as u16).collect();
        Gamma { channels: [list.clone(), list.clone(), list] }
    }

    #[test]
    fn identities_as_servers_and_cards_write_them() {
        let cut = |bits: u32| move |v: f64| ((v * 65535.0) as u32 >> (16 - bits) << (16 - bits)).into();
        for entries in [256, 1024, 4096] {
            for white in [255, 1023] {
                assert!(table(entries, |v| v * 65535.0).is_identity(white), "{entries}");
                assert!(table(entries, |v| (v * 65535.0).round()).is_identity(white));
                assert!(table(entries, cut(10)).is_identity(white), "kept with 10 bits");
            }
            assert!(table(entries, cut(8)).is_identity(255), "kept with 8 bits");
            assert!(!table(entries, cut(8)).is_identity(1023), "8 bits are too few for codes of 10");
        }
        let shifted = Gamma { channels: [0, 1, 2].map(|_| (0..256).map(|n| n << 8).collect()) };
        assert!(shifted.is_identity(255));
    }

    #[test]
    fn what_bends_codes_is_seen() {
        assert!(!table(256, |v| v.powf(1.0 / 1.02) * 65535.0).is_identity(255), "a gamma of 1.02");
        assert!(!table(256, |v| v * 65535.0 * 0.99).is_identity(255), "1 % dimmer");
        let mut night = table(256, |v| v * 65535.0);
        night.channels[2].iter_mut().for_each(|v| *v = (f64::from(*v) * 0.8) as u16);
        assert!(!night.is_identity(255));
        assert!(night.words().contains("100, 100, 80 %"), "{}", night.words());
        let mut one = table(256, |v| v * 65535.0);
        one.channels[1][128] += 200;
        assert!(!one.is_identity(255), "one entry alone");
        assert!(!Gamma { channels: [vec![], vec![], vec![]] }.is_identity(255), "no table says nothing");
        let zeros = table(256, |_| 0.0);
        assert!(!zeros.is_identity(255) && zeros.is_unwritten() && !night.is_unwritten());
    }
}
