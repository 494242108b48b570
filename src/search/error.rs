//! Why a folder that a search goes on from cannot be used.

use std::io;
use std::path::{Path, PathBuf};

/// A folder of a campaign or of a fuzzer that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A file cannot be read or written.
    #[error("{}: {source}", .path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file does not say what it should.
    #[error("{}: {message}", .path.display())]
    Content {
        /// Which.
        path: PathBuf,
        /// What is wrong and what was expected.
        message: String,
    },
}

pub(super) fn failed(path: &Path) -> impl FnOnce(io::Error) -> StoreError {
    let path = path.to_owned();
    move |source| StoreError::File { path, source }
}
