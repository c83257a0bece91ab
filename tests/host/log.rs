//! What the host saw go wrong: one [`Violation`] for each rule of the standard (or of this project) that a plugin broke.

use std::fmt;

/// Which rule was broken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// A suite function was given a NULL handle.
    NullHandle,
    /// A suite function was given a handle of another kind, or one this host never made.
    BadHandle,
    /// A suite function was given a handle that had been released.
    StaleHandle,
    /// A suite function was given NULL where it has to write or read.
    NullPointer,
    /// A property, parameter or clip that does not exist there.
    UnknownName,
    /// A property read or written as another type than the standard's.
    WrongType,
    /// A property index or count beyond its dimension.
    WrongDimension,
    /// A property was written that is the host's to write.
    ReadOnly,
    /// A value outside the set or range the standard allows.
    BadValue,
    /// Something mandatory is absent after a describe action.
    Missing,
    /// An action answered with a status that it may not answer with.
    Status,
    /// An action failed without telling the user why.
    NoMessage,
    /// An image was not released.
    LeakedImage,
    /// A memory block was not freed.
    LeakedMemory,
    /// A mutex was not destroyed, or destroyed while locked.
    LeakedMutex,
    /// A pixel outside the render window was written.
    OutsideWindow,
    /// Bytes between the end of a row and the start of the next were written.
    Padding,
    /// Bytes before or after the image were written.
    Overrun,
    /// Render said OK and left pixels of the window as they were.
    Unwritten,
    /// An input image was written to.
    InputWritten,
    /// Pixels were written after the image had been released.
    AfterRelease,
    /// A suite function was called in an action that forbids it.
    NotAllowed,
    /// Calls that come in pairs did not.
    Unbalanced,
}

/// A rule that was broken, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Violation {
    /// The rule.
    pub rule: Rule,
    /// The action during which it was seen; empty outside actions and on the plugin's own threads.
    pub action: String,
    /// What was found and what was expected.
    pub what: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:?} in {}: {}",
            self.rule,
            if self.action.is_empty() { "no action" } else { &self.action },
            self.what
        )
    }
}

/// A message a plugin showed to the user.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// `OfxMessageError` and its like.
    pub kind: String,
    /// The formatted text.
    pub text: String,
    /// Whether it stays until cleared (message suite v2).
    pub persistent: bool,
}
