//! Errors of folders that a search writes and continues from.

use std::io;
use std::path::{Path, PathBuf};

/// A folder of a campaign or of a fuzzer that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A file cannot be read or written.
    #[error("{}: {source}", .path.display())]
    File {
        /// The path of the file.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// A required file or folder cannot be used, e.g. because a folder has the name of a file.
    #[error("{}: {source}, expected {expected}", .path.display())]
    Unusable {
        /// The path.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
        /// The expected kind of file.
        expected: &'static str,
    },
    /// Another process holds the lock on the folder.
    #[error(
        "{}: {} works in this folder, expected none: wait for its end or give another --out",
        .dir.display(), .pid.map_or("another process".to_owned(), |pid| format!("process {pid}"))
    )]
    Locked {
        /// The folder.
        dir: PathBuf,
        /// The id of that process, if the lock file contains it.
        pid: Option<i32>,
    },
    /// A file has the wrong content.
    #[error("{}: {message}", .path.display())]
    Content {
        /// The path of the file.
        path: PathBuf,
        /// The error, and the expected value.
        message: String,
    },
}

pub(super) fn failed(path: &Path) -> impl FnOnce(io::Error) -> StoreError {
    let path = path.to_owned();
    move |source| StoreError::File { path, source }
}
