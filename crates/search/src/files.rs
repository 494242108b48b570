//! Files that survive a kill at any moment: replaced in one step.

use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::path::Path;

use super::error::{StoreError, failed};
use safefs::Dir;

/// Reads the file `path`; `expected` is used in the error message.
///
/// # Errors
/// If the file does not exist or cannot be read, or if the path is not a file.
pub(super) fn read(path: &Path, expected: &'static str) -> Result<Vec<u8>, StoreError> {
    let (mut file, mut bytes) = (open(path, expected)?, Vec::new());
    let read = file.read_to_end(&mut bytes);
    read.map_err(|source| StoreError::Unusable {
        path: path.to_owned(),
        source,
        expected,
    })?;
    Ok(bytes)
}

/// Opens the file `path` for reading; `expected` is used in the error message.
///
/// # Errors
/// If the file does not exist, or if the path is not a file.
pub(super) fn open(path: &Path, expected: &'static str) -> Result<File, StoreError> {
    let unusable = |source| StoreError::Unusable {
        path: path.to_owned(),
        source,
        expected,
    };
    safefs::open(path).map_err(unusable)
}

/// Replaces the file `name` below `dir`: after a kill the old or the new content is there. After a
/// power cut both may be lost, so this is for files that the same command can create again.
///
/// # Errors
/// If the folder cannot be written, or a folder has this name.
pub(super) fn replace(dir: &Path, name: impl AsRef<Path>, bytes: &[u8]) -> Result<(), StoreError> {
    replace_after(dir, name.as_ref(), |file| file.write_all(bytes))
}

/// Like [`replace`], and also safe against a power cut.
///
/// # Errors
/// Those of [`replace`].
pub(super) fn replace_for_good(
    dir: &Path,
    name: impl AsRef<Path>,
    bytes: &[u8],
) -> Result<(), StoreError> {
    replace_with(dir, name, |file| file.write_all(bytes))
}

/// Like [`replace_for_good`], for content that `write` writes in parts.
///
/// # Errors
/// Those of [`replace`].
pub(super) fn replace_with(
    dir: &Path,
    name: impl AsRef<Path>,
    write: impl FnOnce(&mut File) -> io::Result<()>,
) -> Result<(), StoreError> {
    replace_after(dir, name.as_ref(), |file| {
        write(file)?;
        file.sync_data()
    })
}

fn replace_after(
    dir: &Path,
    name: &Path,
    write: impl FnOnce(&mut File) -> io::Result<()>,
) -> Result<(), StoreError> {
    let path = dir.join(name);
    if path.is_dir() {
        return Err(StoreError::Unusable {
            path,
            source: io::ErrorKind::IsADirectory.into(),
            expected: "a file",
        });
    }
    let written = Dir::open(dir).and_then(|dir| dir.write_with(name, write));
    written.map_err(failed(&path))
}

/// Creates the folder `path` if it does not exist.
///
/// # Errors
/// If the path is not a folder, or the folder cannot be created.
pub(super) fn make_folder(path: &Path) -> Result<Dir, StoreError> {
    Dir::create(path).map_err(|source| StoreError::Unusable {
        path: path.to_owned(),
        source,
        expected: "a folder that can be written",
    })
}
