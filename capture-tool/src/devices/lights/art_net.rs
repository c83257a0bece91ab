//! Art-Net 4 over UDP: ArtDmx packets to one node or all of them.

use std::net::{IpAddr, SocketAddr, ToSocketAddrs, UdpSocket};
use std::time::{Duration, Instant};

use artnet_protocol::{ArtCommand, Output, Poll, PortAddress};

use super::mistaken;
use super::patch::{CHANNELS, Patch};
use super::stream::{Carrier, Streamed};
use crate::devices::port::seconds;
use crate::devices::{Finding, Trouble};
use crate::rigs::LampsDevice;

/// Nodes answer to this port, whatever they were asked from (Art-Net 4, ArtPoll).
const ANSWERS_TO: u16 = 6454;
/// Nodes answer within 3 s (Art-Net 4, ArtPoll); on a network of one rig they do at once.
const ANSWERS_WITHIN: Duration = Duration::from_millis(1500);

/// A universe of nodes.
struct ArtNet {
    socket: UdpSocket,
    to: SocketAddr,
    universe: PortAddress,
    /// 1 to 255; 0 would say that packets are not numbered.
    sequence: u8,
    /// Answers to polls come in here.
    listens: bool,
}

/// Opens the lamps of a rig file.
///
/// # Errors
/// An address that is none; wrong channels.
pub fn open(device: &LampsDevice, lamps: usize) -> Result<Streamed, Trouble> {
    let LampsDevice::ArtNet { host, udp_port, universe, wiring } = device else { return Err(mistaken()) };
    let patch = Patch::new(wiring, lamps)?;
    let to = resolved(host, *udp_port)?;
    let address = PortAddress::try_from(*universe).map_err(|_| {
        Trouble::stop(format!("lamps: Art-Net has no universe {universe}"), "write 0 to 32767 in the rig file")
    })?;
    let wrong = |error: std::io::Error| {
        Trouble::stop(format!("lamps: no network for Art-Net ({error})"), "check the network of this machine")
    };
    let (socket, listens) = match UdpSocket::bind(("0.0.0.0", ANSWERS_TO)) {
        Ok(socket) => (socket, true),
        Err(_) => (UdpSocket::bind(("0.0.0.0", 0)).map_err(wrong)?, false),
    };
    socket.set_broadcast(true).map_err(wrong)?;
    Streamed::new(ArtNet { socket, to, universe: address, sequence: 0, listens }, patch, seconds(wiring.settle_s))
}

/// An IPv4 address of a host.
pub fn resolved(host: &str, port: u16) -> Result<SocketAddr, Trouble> {
    let found = (host, port).to_socket_addrs().ok().and_then(|mut all| all.find(SocketAddr::is_ipv4));
    found.ok_or_else(|| {
        Trouble::stop(format!("lamps: there is no host `{host}`"), "write an IPv4 address, as in \"10.0.0.20\"")
    })
}

impl ArtNet {
    /// Nodes that answer, by address and name.
    fn nodes(&mut self) -> Result<Vec<(IpAddr, String)>, String> {
        let poll = ArtCommand::Poll(Poll::default()).write_to_buffer().map_err(|error| error.to_string())?;
        self.socket.send_to(&poll, self.to).map_err(|error| error.to_string())?;
        let end = Instant::now() + ANSWERS_WITHIN;
        let mut nodes: Vec<(IpAddr, String)> = Vec::new();
        let mut bytes = [0; 1500];
        while let Some(left) = end.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) {
            self.socket.set_read_timeout(Some(left)).map_err(|error| error.to_string())?;
            let Ok((count, from)) = self.socket.recv_from(&mut bytes) else { continue };
            let Ok(ArtCommand::PollReply(reply)) = ArtCommand::from_buffer(&bytes[..count]) else { continue };
            let name: Vec<u8> = reply.short_name.iter().copied().take_while(|b| *b != 0).collect();
            let name = String::from_utf8_lossy(&name).trim().to_owned();
            if !nodes.iter().any(|(known, _)| *known == from.ip()) {
                nodes.push((from.ip(), name));
            }
            if nodes.iter().any(|(known, _)| *known == self.to.ip()) {
                break;
            }
        }
        Ok(nodes)
    }
}

impl Carrier for ArtNet {
    fn send(&mut self, universe: &[u8; CHANNELS]) -> Result<(), String> {
        self.sequence = self.sequence.checked_add(1).unwrap_or(1);
        let dark = universe.iter().all(|level| *level == 0);
        let output = Output {
            // Darkness is to come through whatever was sent before, by another process too.
            sequence: if dark { 0 } else { self.sequence },
            port_address: self.universe,
            data: universe.to_vec().into(),
            ..Output::default()
        };
        let bytes = ArtCommand::Output(output).write_to_buffer().map_err(|error| error.to_string())?;
        self.socket.send_to(&bytes, self.to).map(|_| ()).map_err(|error| error.to_string())
    }

    /// Who does not answer may light lamps all the same: simple receivers know no polls.
    fn preflight(&mut self) -> Vec<Finding> {
        let name = self.name();
        if !self.listens {
            return vec![Finding::fine(format!(
                "lamps: {name}; another program has port {ANSWERS_TO}, so that no node can be heard"
            ))];
        }
        vec![match self.nodes() {
            Err(error) => {
                Finding::missing(format!("lamps: nothing can be sent by {name} ({error}); check the network"))
            }
            Ok(nodes) if nodes.is_empty() => Finding::fine(format!(
                "lamps: {name}; no node answers a poll, which simple ones do not: look at the lamps"
            )),
            Ok(nodes) => {
                let told: Vec<String> = nodes.iter().map(|(ip, name)| format!("{name} ({ip})")).collect();
                Finding::fine(format!("lamps: {name}; nodes: {}", told.join(", ")))
            }
        }]
    }

    fn name(&self) -> String {
        format!("Art-Net universe {} at {}", u16::from(self.universe), self.to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::devices::Lights;
    use crate::rigs::Wiring;

    fn device(host: &str, udp_port: u16, universe: u16) -> LampsDevice {
        let wiring = Wiring { channel_of: vec![3, 1], level: 255, settle_s: 0.0 };
        LampsDevice::ArtNet { host: host.to_owned(), udp_port, universe, wiring }
    }

    #[test]
    fn packets_are_numbered_and_darkness_is_not() {
        let node = UdpSocket::bind("127.0.0.1:0").unwrap();
        node.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let mut lights = open(&device("127.0.0.1", node.local_addr().unwrap().port(), 5), 2).unwrap();
        lights.show(&[9, 200]).unwrap();
        lights.dark().unwrap();
        let mut heard = Vec::new();
        for _ in 0..4 {
            let mut bytes = [0; 1500];
            let (count, _) = node.recv_from(&mut bytes).unwrap();
            assert_eq!(&bytes[..8], b"Art-Net\0");
            let Ok(ArtCommand::Output(output)) = ArtCommand::from_buffer(&bytes[..count]) else { panic!("no ArtDmx") };
            assert_eq!((u16::from(output.port_address), *output.length), (5, 512));
            heard.push((output.sequence, output.data.as_ref()[..4].to_vec()));
        }
        let lit = vec![200, 0, 9, 0];
        assert_eq!(heard, [(1, lit.clone()), (2, lit.clone()), (3, lit), (0, vec![0; 4])]);
    }

    #[test]
    fn what_is_no_address_is_refused() {
        for (host, universe, said) in [("no such host", 0, "no host"), ("127.0.0.1", 40_000, "no universe 40000")] {
            let message = open(&device(host, 6454, universe), 2).err().unwrap().to_string();
            assert!(message.contains(said), "{message}");
        }
    }
}
