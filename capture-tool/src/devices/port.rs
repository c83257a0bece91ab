//! Serial ports: opened, read with deadlines, told apart where something is wrong.
//!
//! ```text
//! Wire (bytes; a port, a pty, a test) -> Port (lines and messages, a bounded buffer, requests to stop) -> drivers
//! ```

use std::io::{self, ErrorKind, Read, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use serialport::{SerialPort, SerialPortInfo, SerialPortType};

use super::Trouble;
use crate::progress;

/// While a reply is waited for, a request to stop is looked for so often.
const SLICE: Duration = Duration::from_millis(50);
/// A line that does not take a command for so long will take none.
const WRITE_LIMIT: Duration = Duration::from_secs(2);
/// More bytes than this without an end of line are no line: the longest that GRBL and DMX widgets send is about 600.
const LONGEST: usize = 4096;

/// Something that bytes go over in both directions.
pub trait Wire: Send {
    /// Reads what is there, and waits so long for the first byte; 0: nothing came.
    ///
    /// # Errors
    /// The other end is gone.
    fn read(&mut self, into: &mut [u8], wait: Duration) -> io::Result<usize>;

    /// Writes some of the bytes; 0: the line takes none now.
    ///
    /// # Errors
    /// The other end is gone.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize>;
}

impl Wire for Box<dyn SerialPort> {
    fn read(&mut self, into: &mut [u8], wait: Duration) -> io::Result<usize> {
        // Some drivers take a timeout of zero as "for ever".
        self.set_timeout(wait.max(Duration::from_millis(1)))?;
        match Read::read(self, into) {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            other => nothing_yet(other),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.set_timeout(SLICE)?;
        nothing_yet(Write::write(self, bytes))
    }
}

/// A timeout is no error.
fn nothing_yet(result: io::Result<usize>) -> io::Result<usize> {
    match result {
        Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
            Ok(0)
        }
        other => other,
    }
}

/// A line to a board.
pub struct Port {
    name: String,
    wire: Box<dyn Wire>,
    buffer: Vec<u8>,
}

impl Port {
    /// Opens a serial port for this program alone: 8 bits, no parity, one stop bit, no flow control.
    ///
    /// # Errors
    /// No such port (with those there are), no permission, another program has it.
    pub fn open(name: &str, baud: u32) -> Result<Self, Trouble> {
        let opened = serialport::new(name, baud).timeout(SLICE).open();
        // DTR is raised where the port has it (an Arduino then restarts); ptys have none, and opening does not mind.
        let port = opened.map_err(|error| cannot_open(name, &error))?;
        Ok(Self::over(name, Box::new(port)))
    }

    /// Over any wire, called `name` in messages.
    pub fn over(name: &str, wire: Box<dyn Wire>) -> Self {
        Self { name: name.to_owned(), wire, buffer: Vec::new() }
    }

    /// As in "/dev/ttyUSB0".
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Sends all of it.
    ///
    /// # Errors
    /// The port is gone, or takes nothing.
    pub fn send(&mut self, mut bytes: &[u8]) -> Result<(), Trouble> {
        let begun = Instant::now();
        while !bytes.is_empty() {
            let sent = self.wire.write(bytes).map_err(|error| self.gone(&error))?;
            bytes = &bytes[sent..];
            if sent == 0 && begun.elapsed() > WRITE_LIMIT {
                let advice = "unplug it, wait a moment and plug it in again";
                return Err(Trouble::stop(format!("{} takes no commands", self.name), advice));
            }
        }
        Ok(())
    }

    /// The next line without what ends it, invalid characters replaced; `None` when none has come by then.
    ///
    /// # Errors
    /// The port is gone; a second request to stop.
    pub fn line(&mut self, by: Instant) -> Result<Option<String>, Trouble> {
        loop {
            if let Some(end) = self.buffer.iter().position(|b| *b == b'\n') {
                let line: Vec<u8> = self.buffer.drain(..=end).collect();
                let text = String::from_utf8_lossy(&line);
                return Ok(Some(text.trim_matches(['\r', '\n', ' ', '\0']).to_owned()));
            }
            if !self.fill(by)? {
                return Ok(None);
            }
        }
    }

    /// Waits for more bytes behind those in [`Port::buffer`]; false when none have come by then.
    ///
    /// # Errors
    /// As [`Port::line`].
    pub fn fill(&mut self, by: Instant) -> Result<bool, Trouble> {
        let mut bytes = [0; 1024];
        loop {
            let left = by.saturating_duration_since(Instant::now());
            let count = self.wire.read(&mut bytes, left.min(SLICE)).map_err(|error| self.gone(&error))?;
            if count > 0 {
                // Of endless noise the end alone can be of use.
                let surplus = (self.buffer.len() + count).saturating_sub(LONGEST).min(self.buffer.len());
                self.buffer.drain(..surplus);
                self.buffer.extend_from_slice(&bytes[..count]);
                return Ok(true);
            }
            progress::check_urgent()?;
            if left.is_zero() {
                return Ok(false);
            }
        }
    }

    /// What came and was not used yet.
    pub fn buffer(&mut self) -> &mut Vec<u8> {
        &mut self.buffer
    }

    /// Forgets what came, and what comes, until nothing has for so long; gives up on a line that never rests.
    ///
    /// # Errors
    /// As [`Port::line`].
    pub fn drain(&mut self, quiet: Duration) -> Result<(), Trouble> {
        let end = Instant::now() + 10 * quiet.max(Duration::from_millis(10));
        self.buffer.clear();
        while self.fill(Instant::now() + quiet)? && Instant::now() < end {
            self.buffer.clear();
        }
        self.buffer.clear();
        Ok(())
    }

    fn gone(&self, error: &io::Error) -> Trouble {
        let advice = "check its cable and its power";
        Trouble::stop(format!("the connection at {} was lost ({error})", self.name), advice)
    }
}

/// Waits, and looks for a second request to stop.
///
/// # Errors
/// That request.
pub fn pause(wait: Duration) -> Result<(), Trouble> {
    let end = Instant::now() + wait;
    loop {
        progress::check_urgent()?;
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Ok(());
        }
        std::thread::sleep(left.min(SLICE));
    }
}

/// A duration of a rig file.
pub fn seconds(value: f64) -> Duration {
    Duration::try_from_secs_f64(value).unwrap_or(Duration::from_secs(1))
}

fn cannot_open(name: &str, error: &serialport::Error) -> Trouble {
    let known = ports();
    let there = Path::new(name).exists() || known.iter().any(|port| port.port_name == name);
    match error.kind {
        serialport::ErrorKind::Io(ErrorKind::PermissionDenied) => {
            Trouble::stop(format!("no permission to open {name}"), PERMISSION)
        }
        serialport::ErrorKind::NoDevice if there => {
            let advice = "close the other program (a console, a sender of G-code, another relume)";
            Trouble::stop(format!("{name} is in use by another program"), advice)
        }
        _ if !there => {
            let names: Vec<&str> = known.iter().map(|port| port.port_name.as_str()).collect();
            let advice = match names.is_empty() {
                true => "plug the board in: there are no serial ports now".to_owned(),
                false => format!("there are {}; `relume devices` tells more of them", names.join(", ")),
            };
            Trouble::stop(format!("there is no serial port {name}"), advice)
        }
        _ => Trouble::stop(
            format!("{name} cannot be opened as a serial port ({error})"),
            "check the name in the rig file",
        ),
    }
}

const PERMISSION: &str =
    "it needs membership of the group dialout (sudo usermod -aG dialout $USER), after which one has to log in again";

/// Serial ports of this machine; none where the system cannot say.
fn ports() -> Vec<SerialPortInfo> {
    // Without /sys (some containers) the crate would panic.
    if cfg!(target_os = "linux") && !Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    let mut ports = serialport::available_ports().unwrap_or_default();
    ports.sort_by(|a, b| a.port_name.cmp(&b.port_name));
    ports
}

/// What `relume devices` says of serial ports, a line each.
pub fn list() -> Vec<String> {
    ports().iter().map(told).collect()
}

fn told(port: &SerialPortInfo) -> String {
    let mut said = port.port_name.clone();
    match &port.port_type {
        SerialPortType::UsbPort(usb) => {
            let named = |label: &str, text: &Option<String>| {
                text.as_ref().filter(|text| !text.is_empty()).map(|text| format!("{label}{text}"))
            };
            let product = named("", &usb.product).unwrap_or_else(|| format!("USB {:04x}:{:04x}", usb.vid, usb.pid));
            let parts = [Some(product), named("", &usb.manufacturer), named("serial ", &usb.serial_number)];
            said += &format!("  {}", parts.into_iter().flatten().collect::<Vec<_>>().join(", "));
        }
        SerialPortType::BluetoothPort => said += "  Bluetooth",
        SerialPortType::PciPort => said += "  built in",
        SerialPortType::Unknown => {}
    }
    if !may_open(Path::new(&port.port_name)) {
        said += &format!("  (no permission: {PERMISSION})");
    }
    said
}

/// May this user open it? Tells from its owner, group and mode alone: opening would restart an Arduino.
#[cfg(target_os = "linux")]
fn may_open(path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;

    let (Ok(device), Ok(status)) = (path.metadata(), std::fs::read_to_string("/proc/self/status")) else { return true };
    let ids = |key: &str| -> Vec<u32> {
        let line = status.lines().find_map(|line| line.strip_prefix(key));
        line.map_or_else(Vec::new, |line| line.split_whitespace().filter_map(|id| id.parse().ok()).collect())
    };
    // Real, effective, saved, file system.
    let user = ids("Uid:").get(1).copied().unwrap_or_default();
    let groups = [ids("Gid:"), ids("Groups:")].concat();
    let bits = match (user, device.uid()) {
        (0, _) => return true,
        (user, owner) if user == owner => 0o600,
        _ if groups.contains(&device.gid()) => 0o060,
        _ => 0o006,
    };
    device.mode() & bits == bits
}

#[cfg(not(target_os = "linux"))]
fn may_open(_: &Path) -> bool {
    true
}

#[cfg(test)]
pub mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;

    /// A wire that says what it is told to, piece by piece, and then nothing, or is gone.
    #[derive(Default)]
    pub struct Told {
        pub says: std::collections::VecDeque<Vec<u8>>,
        pub heard: Arc<Mutex<Vec<u8>>>,
        pub then_gone: bool,
    }

    impl Wire for Told {
        fn read(&mut self, into: &mut [u8], _: Duration) -> io::Result<usize> {
            match self.says.pop_front() {
                Some(piece) => {
                    into[..piece.len()].copy_from_slice(&piece);
                    Ok(piece.len())
                }
                None if self.then_gone => Err(ErrorKind::BrokenPipe.into()),
                None => Ok(0),
            }
        }

        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let taken = bytes.len().min(3);
            self.heard.lock().unwrap().extend_from_slice(&bytes[..taken]);
            Ok(taken)
        }
    }

    fn port(pieces: &[&[u8]], then_gone: bool) -> Port {
        let says = pieces.iter().map(|piece| piece.to_vec()).collect();
        Port::over("wire", Box::new(Told { says, then_gone, ..Told::default() }))
    }

    fn soon() -> Instant {
        Instant::now() + Duration::from_millis(5)
    }

    #[test]
    fn lines_are_put_together_from_pieces() {
        let mut port = port(&[b"o", b"k\r\n<Id", b"le>\nhalf"], false);
        assert_eq!(port.line(soon()).unwrap().as_deref(), Some("ok"));
        assert_eq!(port.line(soon()).unwrap().as_deref(), Some("<Idle>"));
        assert_eq!(port.line(soon()).unwrap(), None);
        port.drain(Duration::from_millis(1)).unwrap();
        assert!(port.buffer().is_empty());
    }

    #[test]
    fn noise_without_an_end_does_not_grow() {
        let noise = [b'x'; 1000];
        let mut port = port(&[&noise[..]; 50], false);
        assert_eq!(port.line(soon()).unwrap(), None);
        assert!(port.buffer().len() <= LONGEST);
    }

    #[test]
    fn all_bytes_are_sent_and_a_lost_port_is_said() {
        let heard = Arc::new(Mutex::new(Vec::new()));
        let wire = Told { heard: heard.clone(), then_gone: true, ..Told::default() };
        let mut port = Port::over("/dev/ttyUSB7", Box::new(wire));
        port.send(b"G4 P0\n").unwrap();
        assert_eq!(*heard.lock().unwrap(), b"G4 P0\n");
        let message = port.line(soon()).unwrap_err().to_string();
        assert!(message.contains("/dev/ttyUSB7 was lost") && message.contains("cable"), "{message}");
    }

    #[test]
    fn a_port_that_is_not_there_is_named_with_those_that_are() {
        let message = Port::open("/dev/no-such-port", 9600).err().unwrap().to_string();
        assert!(message.contains("no serial port /dev/no-such-port") && message.contains("there are "), "{message}");
        let file = tempfile::NamedTempFile::new().unwrap();
        let message = Port::open(&file.path().display().to_string(), 9600).err().unwrap().to_string();
        assert!(message.contains("cannot be opened as a serial port"), "{message}");
    }

    /// Two who drive one board at a time would photograph each other's conditions.
    #[cfg(unix)]
    #[test]
    fn a_port_is_opened_by_one_alone() {
        let (_board, pty) = serialport::TTYPort::pair().unwrap();
        let name = pty.name().unwrap();
        drop(pty);
        let first = Port::open(&name, 115_200).unwrap();
        let message = Port::open(&name, 115_200).err().unwrap().to_string();
        assert!(message.contains("in use by another program"), "{message}");
        drop(first);
        Port::open(&name, 9600).unwrap();
    }

    #[test]
    fn ports_are_told_with_what_is_plugged_in() {
        let usb = serialport::UsbPortInfo {
            vid: 0x0403,
            pid: 0x6001,
            serial_number: Some("EN123".to_owned()),
            manufacturer: Some("ENTTEC".to_owned()),
            product: Some("DMX USB PRO".to_owned()),
        };
        let port = |port_type| SerialPortInfo { port_name: "/dev/ttyUSB0".to_owned(), port_type };
        assert_eq!(told(&port(SerialPortType::UsbPort(usb))), "/dev/ttyUSB0  DMX USB PRO, ENTTEC, serial EN123");
        assert_eq!(told(&port(SerialPortType::PciPort)), "/dev/ttyUSB0  built in");
        list();
    }
}
