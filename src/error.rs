//! The one error type: every variant's text names what, where, and what to do about it.

use std::path::{Path, PathBuf};

/// What can go wrong, told apart by what a caller may do about it.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused something.
    #[error("{}: {action}: {source}", path.display())]
    Io {
        /// The file concerned.
        path: PathBuf,
        /// What was tried, as in "cannot read".
        action: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file's content breaks its format, or contradicts itself.
    #[error("{place}: {reason}")]
    Invalid {
        /// File, and where in it.
        place: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// The input is sound, but of a kind that deepfield does not handle.
    #[error("{place}: not supported: {reason}")]
    NotSupported {
        /// File, and where in it.
        place: String,
        /// What is not supported and what is.
        reason: String,
    },
    /// A user's request cannot be met: a key, an option, a limit.
    #[error("{0}")]
    Request(String),
}

impl Error {
    /// An I/O error on `path` while doing `action` ("cannot read").
    pub fn io(path: impl AsRef<Path>, action: impl Into<String>, source: std::io::Error) -> Self {
        Self::Io { path: path.as_ref().to_path_buf(), action: action.into(), source }
    }

    /// Broken content at `place` (a file, and where in it).
    pub fn invalid(place: impl std::fmt::Display, reason: impl Into<String>) -> Self {
        Self::Invalid { place: place.to_string(), reason: reason.into() }
    }

    /// Sound content of a kind that is not handled.
    pub fn not_supported(place: impl std::fmt::Display, reason: impl Into<String>) -> Self {
        Self::NotSupported { place: place.to_string(), reason: reason.into() }
    }

    /// The same for another who waited for what failed.
    pub(crate) fn again(&self) -> Self {
        match self {
            Self::Io { path, action, source } => {
                let again = source.raw_os_error().map_or_else(
                    || std::io::Error::new(source.kind(), source.to_string()),
                    std::io::Error::from_raw_os_error,
                );
                Self::io(path, action, again)
            }
            Self::Invalid { place, reason } => Self::invalid(place, reason),
            Self::NotSupported { place, reason } => Self::not_supported(place, reason),
            Self::Request(reason) => Self::request(reason),
        }
    }

    /// A request that cannot be met.
    pub fn request(reason: impl Into<String>) -> Self {
        Self::Request(reason.into())
    }
}

/// The crate's result type.
pub type Result<T, E = Error> = std::result::Result<T, E>;
