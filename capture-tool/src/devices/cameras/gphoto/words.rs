//! What refusals of libgphoto2 mean to the person on set.

use super::body::Refusal;
use crate::devices::Trouble;

/// What to do when a camera is silent.
const SILENT: &str = "check its cable, its battery, and that it is switched on and does not fall asleep";

/// Kinds of refusals, by the numbers of `gphoto2-result.h` and `gphoto2-port-result.h`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The camera is at something: again soon.
    Busy,
    /// The connection is lost, perhaps for the moment: it is made again once.
    Lost,
    /// Another program holds the camera.
    Claimed,
    /// It is not there.
    Absent,
    /// No room on its card.
    Full,
    /// It cannot, or something else.
    Other,
}

impl Refusal {
    /// What kind it is.
    pub fn kind(&self) -> Kind {
        match self.code {
            // GP_ERROR_CAMERA_BUSY, as PTP's "device busy".
            -110 => Kind::Busy,
            // GP_ERROR_IO_USB_CLAIM, GP_ERROR_IO_LOCK.
            -53 | -60 => Kind::Claimed,
            // GP_ERROR_UNKNOWN_PORT, GP_ERROR_MODEL_NOT_FOUND.
            -5 | -105 => Kind::Absent,
            // GP_ERROR_NO_SPACE; GP_ERROR_NO_MEMORY is what the driver of PTP cameras answers when the card fills during an exposure.
            -115 | -3 => Kind::Full,
            // GP_ERROR_IO and its kin, GP_ERROR_TIMEOUT, GP_ERROR_IO_USB_FIND (unplugged).
            -7 | -10 | -31 | -34 | -35 | -37 | -51 | -52 => Kind::Lost,
            _ => Kind::Other,
        }
    }

    /// For the loop and the person; `camera` is as in "the Nikon DSC D750 (usb:001,004)".
    pub fn trouble(&self, camera: &str) -> Trouble {
        let Self { code, doing, said } = self;
        match self.kind() {
            Kind::Busy => Trouble::Busy(format!("{camera} is busy")),
            Kind::Lost => Trouble::stop(format!("{camera} does not answer ({doing}: {said})"), SILENT),
            Kind::Absent => Trouble::stop(format!("{camera} is not there ({said})"), SILENT),
            Kind::Claimed => Trouble::stop(format!("another program holds {camera} ({said})"), claimed()),
            Kind::Full => Trouble::stop(
                format!("the card of {camera} is full ({doing}: {said})"),
                "empty it, or put in another one; without keep_on_card photographs are deleted once they are downloaded",
            ),
            Kind::Other => Trouble::stop(
                format!("{camera}, {doing}: {said} (libgphoto2's error {code})"),
                "look at its display; focus by hand, leave its menus, or switch it off and on",
            ),
        }
    }
}

/// Who holds cameras on each system.
fn claimed() -> &'static str {
    if cfg!(target_os = "macos") {
        "close it; the system's own PTPCamera or Image Capture often does: end it (killall PTPCamera)"
    } else {
        "close it; a desktop's gvfs often does: unmount the camera in the file manager, or with `gio mount -s gphoto2`"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refusals_become_words() {
        let trouble = |code| {
            let refusal = Refusal { code, doing: "taking a photograph".to_owned(), said: "Some words".to_owned() };
            refusal.trouble("the X100 (usb:001,002)")
        };
        assert!(matches!(trouble(-110), Trouble::Busy(_)));
        for (code, words) in [
            (-53, "another program holds the X100"),
            (-53, "gphoto2"),
            (-7, "does not answer (taking a photograph: Some words)"),
            (-52, "cable"),
            (-105, "is not there"),
            (-3, "card of the X100 (usb:001,002) is full"),
            (-115, "empty it"),
            (-1, "libgphoto2's error -1"),
        ] {
            let Trouble::Stop { what, advice } = trouble(code) else { panic!("{code}") };
            assert!(
                cfg!(target_os = "macos") || format!("{what}; {advice}").contains(words),
                "{code}: {what}; {advice}"
            );
        }
    }
}
