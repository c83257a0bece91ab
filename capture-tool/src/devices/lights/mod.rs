//! Lamps.
//!
//! | part | what it holds |
//! |---|---|
//! | [`patch`] | which channel each lamp is on |
//! | [`text`] | lines of text, as home-made domes take them |
//! | [`dmx_usb_pro`] | an ENTTEC DMX USB Pro |
//! | [`art_net`] | Art-Net over the network |
//! | [`sacn`] | sACN (E1.31) over the network |
//! | `stream` | what networks want: the same levels again and again |

use super::{Finding, Trouble};
use crate::progress::SwitchingOff;
use crate::rigs::LampsDevice;

pub mod art_net;
pub mod dmx_usb_pro;
pub mod patch;
pub mod sacn;
mod stream;
pub mod text;

/// Lamps. Calls block; while they wait they look at [`crate::progress::check_urgent`].
pub trait Lights {
    /// Is what drives them there? Lights nothing.
    fn preflight(&mut self) -> Vec<Finding>;

    /// Gives each physical lamp its level, 0 off, all others of the device off; returns when that is confirmed (where the device can) and
    /// the lamps shine steadily.
    ///
    /// # Errors
    /// [`Trouble::Busy`] when the same call may succeed soon; anything else ends the capture.
    fn show(&mut self, levels: &[u8]) -> Result<(), Trouble>;

    /// Does the device still show what it was last told, as far as it can say?
    ///
    /// # Errors
    /// As [`Lights::show`]; that it does not.
    fn confirm(&mut self) -> Result<(), Trouble> {
        Ok(())
    }

    /// All lamps off, of every channel. Tries hard: also after an error, also when the port has to be opened again.
    ///
    /// # Errors
    /// The operator must switch off by hand.
    fn dark(&mut self) -> Result<(), Trouble>;
}

/// Lamps that go out when this is dropped, whatever happened before.
pub struct PutOut(pub Box<dyn Lights>);

impl Drop for PutOut {
    fn drop(&mut self) {
        let _unhurried = SwitchingOff::begin();
        if let Err(trouble) = self.0.dark() {
            crate::complain(&format!("warning: {trouble}; if lamps are on, switch them off by hand"));
        }
    }
}

/// Opens the lamps of a rig file, of which there are so many.
///
/// # Errors
/// No such port or address; a board that does not answer.
pub fn open(device: &LampsDevice, lamps: usize) -> Result<Box<dyn Lights>, Trouble> {
    Ok(match device {
        LampsDevice::Text { .. } => Box::new(text::Text::open(device, lamps)?),
        LampsDevice::DmxUsbPro { .. } => Box::new(dmx_usb_pro::DmxUsbPro::open(device, lamps)?),
        LampsDevice::ArtNet { .. } => Box::new(art_net::open(device, lamps)?),
        LampsDevice::Sacn { .. } => Box::new(sacn::open(device, lamps)?),
    })
}

/// The wrong opener was called.
fn mistaken() -> Trouble {
    Trouble::stop("lamps of one kind were to be opened as another", "this is a mistake in relume")
}
