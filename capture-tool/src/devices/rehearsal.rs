//! Bad days on purpose: what virtual devices do wrong, so that people (and tests) see what the tool then says.
//!
//! Each fault is written `KIND@N`: it strikes at the N-th exposure of this run, counted from 1, or at lamp N.

use std::str::FromStr;

/// A fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The camera is gone from exposure N on.
    Unplug(u64),
    /// The camera is busy for three calls before exposure N.
    Busy(u64),
    /// The camera is busy for good from exposure N on.
    Stuck(u64),
    /// The exposure time reads back wrong from exposure N on.
    Misread(u64),
    /// Lamp N does not answer.
    SilentLamp(u64),
    /// The disk is full at exposure N.
    FullDisk(u64),
    /// The clock is put back by a day at exposure N.
    Clock(u64),
    /// From exposure N on the camera delivers its files slowly, a piece at a time.
    Slow(u64),
    /// Somebody bumps into the camera: from exposure N on the picture is shifted by two pixels.
    Bump(u64),
}

/// The kinds, as they are written.
pub const KINDS: &str = "unplug, busy, stuck, misread, silent-lamp, full-disk, clock, slow or bump";

impl FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wanted = || format!("not a fault; write KIND@N, as in unplug@30, with {KINDS}");
        let (kind, at) = text.split_once('@').ok_or_else(wanted)?;
        let at: u64 = at.parse().ok().filter(|n| *n > 0).ok_or_else(wanted)?;
        match kind {
            "unplug" => Ok(Fault::Unplug(at)),
            "busy" => Ok(Fault::Busy(at)),
            "stuck" => Ok(Fault::Stuck(at)),
            "misread" => Ok(Fault::Misread(at)),
            "silent-lamp" => Ok(Fault::SilentLamp(at)),
            "full-disk" => Ok(Fault::FullDisk(at)),
            "clock" => Ok(Fault::Clock(at)),
            "slow" => Ok(Fault::Slow(at)),
            "bump" => Ok(Fault::Bump(at)),
            _ => Err(wanted()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_written_kind_at_number() {
        assert_eq!("unplug@30".parse(), Ok(Fault::Unplug(30)));
        assert_eq!("silent-lamp@7".parse(), Ok(Fault::SilentLamp(7)));
        for bad in ["unplug", "unplug@0", "unplug@-1", "unplug@x", "rain@3", "@3", ""] {
            assert!(bad.parse::<Fault>().unwrap_err().contains("unplug"), "{bad}");
        }
    }
}
