//! Why a folder that a search continues from cannot be used.

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
        /// The error of the operating system.
        source: io::Error,
    },
    /// What is needed cannot be used, like a folder in the place of a file.
    #[error("{}: {source}, expected {expected}", .path.display())]
    Unusable {
        /// Which.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
        /// What should be there.
        expected: &'static str,
    },
    /// Another process works in the folder.
    #[error(
        "{}: {} works in this folder, expected none: wait for its end or give another --out",
        .dir.display(), .pid.map_or("another process".to_owned(), |pid| format!("process {pid}"))
    )]
    Locked {
        /// Which.
        dir: PathBuf,
        /// Number of that process, if its lock says so.
        pid: Option<i32>,
    },
    /// A file has the wrong content.
    #[error("{}: {message}", .path.display())]
    Content {
        /// Which.
        path: PathBuf,
        /// The error, and the expected value.
        message: String,
    },
}

pub(super) fn failed(path: &Path) -> impl FnOnce(io::Error) -> StoreError {
    let path = path.to_owned();
    move |source| StoreError::File { path, source }
}
