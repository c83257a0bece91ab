//! What can go wrong, as sentences for the artist. They reach the host's message area and the status line.

/// Result of everything here that can fail.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file, a map or a field that the core refused.
    #[error("{0}")]
    Core(#[from] relume_core::Error),
    /// Something is not set; the sentence says what to do.
    #[error("{0}")]
    Missing(&'static str),
    /// A path that cannot be used as typed.
    #[error("{path}: {what}")]
    Path {
        /// As typed, or as resolved where that helps more.
        path: String,
        /// What is wrong with it.
        what: String,
    },
    /// The host broke the standard, or offers something this effect does not read.
    #[error("The host {what}; {advice}")]
    Host {
        /// What it did, as a verb: "gave no output image".
        what: String,
        /// What an artist can try.
        advice: &'static str,
    },
    /// The threads could not be started.
    #[error("Cannot start threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// The host asked to stop. Not an error for anybody to read.
    #[error("stopped on request")]
    Aborted,
}

impl Error {
    /// A host that went off the standard, with advice that helps most often.
    pub fn host(what: impl Into<String>) -> Self {
        Self::Host { what: what.into(), advice: "try another pixel format or report this" }
    }
}
