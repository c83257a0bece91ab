//! sACN (ANSI E1.31) over UDP, multicast or to one node.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use sacn::packet::ACN_SDT_MULTICAST_PORT;
use sacn::source::SacnSource;
use uuid::Uuid;

use super::art_net::resolved;
use super::mistaken;
use super::patch::{CHANNELS, Patch};
use super::stream::{Carrier, Streamed};
use crate::devices::port::seconds;
use crate::devices::{Finding, Trouble};
use crate::rigs::LampsDevice;

/// What consoles show of this source.
const NAME: &str = "relume";
/// DMX with start code 0: levels.
const START_CODE: u8 = 0;

/// A universe of nodes.
struct Sacn {
    source: SacnSource,
    universe: u16,
    to: Option<SocketAddr>,
    priority: u8,
    packet: Vec<u8>,
}

/// Opens the lamps of a rig file.
///
/// # Errors
/// An address that is none; wrong channels; no network.
pub fn open(device: &LampsDevice, lamps: usize) -> Result<Streamed, Trouble> {
    let LampsDevice::Sacn { universe, host, from, priority, wiring } = device else { return Err(mistaken()) };
    let patch = Patch::new(wiring, lamps)?;
    let to = host.as_ref().map(|host| resolved(host, ACN_SDT_MULTICAST_PORT)).transpose()?;
    let own: IpAddr = match from {
        None => Ipv4Addr::UNSPECIFIED.into(),
        Some(from) => from.parse().map_err(|_| {
            Trouble::stop(format!("lamps: `{from}` is no address"), "write one of this machine's, as in \"10.0.0.5\"")
        })?,
    };
    let wrong = |error: &dyn std::fmt::Display| {
        Trouble::stop(format!("lamps: no network for sACN ({error})"), "check the network, and from in the rig file")
    };
    // Any free port: a receiver on this machine keeps the usual one to itself. Multicast leaves by the network of its address.
    let mut source = SacnSource::with_cid_ip(NAME, cid(*universe, host.as_deref()), SocketAddr::new(own, 0))
        .map_err(|e| wrong(&e))?;
    // Discovery is for consoles; the crate would print where it fails.
    source.set_is_sending_discovery(false);
    source.register_universe(*universe).map_err(|error| {
        Trouble::stop(format!("lamps: sACN has no universe {universe} ({error})"), "write 1 to 63999 in the rig file")
    })?;
    let carrier =
        Sacn { source, universe: *universe, to, priority: *priority, packet: Vec::with_capacity(CHANNELS + 1) };
    Streamed::new(carrier, patch, seconds(wiring.settle_s))
}

/// One identity for a rig's lamps, whichever process drives them: a second one puts out what the first one lit, where a stranger
/// would only be merged with it.
fn cid(universe: u16, host: Option<&str>) -> Uuid {
    let hash = blake3::hash(format!("relume sACN {universe} {}", host.unwrap_or("multicast")).as_bytes());
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&hash.as_bytes()[..16]);
    uuid::Builder::from_custom_bytes(bytes).into_uuid()
}

impl Carrier for Sacn {
    fn send(&mut self, universe: &[u8; CHANNELS]) -> Result<(), String> {
        self.packet.clear();
        self.packet.push(START_CODE);
        self.packet.extend_from_slice(universe);
        let sent = self.source.send(&[self.universe], &self.packet, Some(self.priority), self.to, None);
        sent.map_err(|error| error.to_string())
    }

    /// Receivers of sACN say nothing.
    fn preflight(&mut self) -> Vec<Finding> {
        vec![Finding::fine(format!("lamps: {}; receivers do not answer: look at the lamps", self.name()))]
    }

    fn name(&self) -> String {
        let to = self.to.map_or_else(|| "multicast".to_owned(), |to| to.to_string());
        format!("sACN universe {}, {to}", self.universe)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rigs::Wiring;

    #[test]
    fn every_process_is_the_same_source_of_a_rig() {
        assert_eq!(cid(1, None), cid(1, None));
        assert_ne!(cid(1, None), cid(2, None));
        assert_ne!(cid(1, None), cid(1, Some("10.0.0.2")));
    }

    #[test]
    fn what_is_no_address_is_refused() {
        let device = |universe, host: Option<&str>, from: Option<&str>| LampsDevice::Sacn {
            universe,
            host: host.map(str::to_owned),
            from: from.map(str::to_owned),
            priority: 100,
            wiring: Wiring { channel_of: Vec::new(), level: 255, settle_s: 0.0 },
        };
        for (device, said) in [
            (device(0, None, None), "no universe 0"),
            (device(1, Some("no such host"), None), "no host"),
            (device(1, None, Some("eth0")), "no address"),
            (device(1, None, Some("192.0.2.1")), "no network"),
        ] {
            let message = open(&device, 2).err().unwrap().to_string();
            assert!(message.contains(said), "{message}");
        }
    }
}
