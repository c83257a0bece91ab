//! The connection to an X server: no call waits for longer than the server's patience, or past an urgent request to stop.

use std::io::{self, IoSlice};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use x11rb::connection::Connection;
use x11rb::errors::{ConnectError, ConnectionError, ReplyError, ReplyOrIdError};
use x11rb::protocol::xproto::Screen;
use x11rb::reexports::x11rb_protocol::parse_display::{ConnectAddress, parse_display};
use x11rb::reexports::x11rb_protocol::xauth::get_auth;
use x11rb::rust_connection::{DefaultStream, PollMode, RustConnection, Stream};
use x11rb::utils::RawFdContainer;

use super::super::GLANCE;
use crate::devices::Trouble;
use crate::progress;

/// A server that says nothing for so long though it was asked is lost. Servers answer within milliseconds; a machine that swaps may take
/// seconds.
const PATIENCE: Duration = Duration::from_secs(10);

/// A socket whose waits end.
#[derive(Debug)]
pub struct Watched(DefaultStream);

impl Watched {
    /// Waits until there may be something to do; says whether there is.
    pub fn wait(&self, mode: PollMode, time: Duration) -> io::Result<bool> {
        let mut flags = PollFlags::empty();
        flags.set(PollFlags::IN, mode.readable());
        flags.set(PollFlags::OUT, mode.writable());
        let time = Timespec::try_from(time).map_err(io::Error::other)?;
        match poll(&mut [PollFd::new(&self.0, flags)], Some(&time)) {
            Ok(ready) => Ok(ready > 0),
            // A signal: the caller looks what it was about.
            Err(rustix::io::Errno::INTR) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }
}

impl Stream for Watched {
    fn poll(&self, mode: PollMode) -> io::Result<()> {
        let begun = Instant::now();
        while !self.wait(mode, GLANCE)? {
            progress::check_urgent().map_err(io::Error::other)?;
            if begun.elapsed() > PATIENCE {
                return Err(io::ErrorKind::TimedOut.into());
            }
        }
        Ok(())
    }

    fn read(&self, buffer: &mut [u8], descriptors: &mut Vec<RawFdContainer>) -> io::Result<usize> {
        self.0.read(buffer, descriptors)
    }

    fn write(&self, buffer: &[u8], descriptors: &mut Vec<RawFdContainer>) -> io::Result<usize> {
        self.0.write(buffer, descriptors)
    }

    fn write_vectored(&self, buffers: &[IoSlice<'_>], descriptors: &mut Vec<RawFdContainer>) -> io::Result<usize> {
        self.0.write_vectored(buffers, descriptors)
    }
}

/// A server.
#[derive(Debug)]
pub struct Link {
    /// What requests go through.
    pub server: RustConnection<Watched>,
    screen: usize,
    /// As in ":0".
    pub name: String,
}

impl Link {
    /// Connects; without a name to what the variable DISPLAY says.
    ///
    /// # Errors
    /// No such server, or one that lets nobody in.
    pub fn connect(display: Option<&str>) -> Result<Self, Trouble> {
        let name = display.map(str::to_owned).or_else(|| std::env::var("DISPLAY").ok()).unwrap_or_default();
        if name.is_empty() {
            return Err(Trouble::stop(
                "no X server: the variable DISPLAY is not set",
                "start relume in a graphical session, or say which server (display under [devices] screen)",
            ));
        }
        let refused = |why: String| {
            Trouble::stop(
                format!("the X server {name} cannot be reached: {why}"),
                "check the name (DISPLAY, or display under [devices] screen), and that this user may use it (xhost, XAUTHORITY)",
            )
        };
        let parsed = parse_display(Some(&name)).map_err(|error| refused(error.to_string()))?;
        let mut why = "its name is not understood".to_owned();
        // A path is the socket itself, which x11rb 0.13 leaves out.
        let addresses = match parsed.host.starts_with('/') {
            true => vec![ConnectAddress::Socket(parsed.host.clone())],
            false => parsed.connect_instruction().collect(),
        };
        for address in addresses {
            let (stream, (family, peer)) = match DefaultStream::connect(&address) {
                Ok(connected) => connected,
                Err(error) => {
                    why = error.to_string();
                    continue;
                }
            };
            // Without a cookie the server may still let in who comes from this machine.
            let (kind, cookie) = get_auth(family, &peer, parsed.display).ok().flatten().unwrap_or_default();
            let screen = usize::from(parsed.screen);
            let server = RustConnection::connect_to_stream_with_auth_info(Watched(stream), screen, kind, cookie)
                .map_err(|error| refused(refusal(&error)))?;
            return Ok(Self { server, screen, name });
        }
        Err(refused(why))
    }

    /// The screen: outputs of one server mostly share one.
    pub fn screen(&self) -> &Screen {
        &self.server.setup().roots[self.screen]
    }

    /// An answer, or why there is none.
    ///
    /// # Errors
    /// A lost connection; what the server refuses.
    pub fn told<T, E: Into<Failure>>(&self, answer: Result<T, E>) -> Result<T, Trouble> {
        answer.map_err(|error| self.trouble(error.into()))
    }

    fn trouble(&self, failure: Failure) -> Trouble {
        if let Err(cancelled) = progress::check_urgent() {
            return cancelled.into();
        }
        match failure {
            Failure::Lost(ConnectionError::IoError(error)) if error.kind() == io::ErrorKind::TimedOut => Trouble::stop(
                format!("the X server {} has not answered for {} seconds", self.name, PATIENCE.as_secs()),
                "look whether the desktop still moves; restart the session if it does not",
            ),
            Failure::Lost(error) => Trouble::stop(
                format!("the connection to the X server {} is lost: {error}", self.name),
                "log in again and start anew",
            ),
            Failure::Refused(what) => Trouble::stop(
                format!("the X server {} refuses a request: {what}", self.name),
                "try driver = \"window\" under [devices] screen, and report this",
            ),
        }
    }
}

/// Why there is no answer.
#[derive(Debug)]
pub enum Failure {
    /// The connection is gone.
    Lost(ConnectionError),
    /// The server says no.
    Refused(String),
}

impl From<ConnectionError> for Failure {
    fn from(error: ConnectionError) -> Self {
        Self::Lost(error)
    }
}

impl From<ReplyError> for Failure {
    fn from(error: ReplyError) -> Self {
        match error {
            ReplyError::ConnectionError(error) => Self::Lost(error),
            ReplyError::X11Error(error) => {
                Self::Refused(format!("{:?} in {}", error.error_kind, error.request_name.unwrap_or("a request")))
            }
        }
    }
}

impl From<ReplyOrIdError> for Failure {
    fn from(error: ReplyOrIdError) -> Self {
        match error {
            ReplyOrIdError::ConnectionError(error) => Self::Lost(error),
            ReplyOrIdError::X11Error(error) => ReplyError::X11Error(error).into(),
            ReplyOrIdError::IdsExhausted => Self::Refused("no names for pictures are left".to_owned()),
        }
    }
}

/// Why a server lets nobody in, as it says itself.
fn refusal(error: &ConnectError) -> String {
    match error {
        ConnectError::SetupFailed(said) => String::from_utf8_lossy(&said.reason).trim().to_owned(),
        ConnectError::InvalidScreen => "it has no such screen".to_owned(),
        other => other.to_string(),
    }
}
