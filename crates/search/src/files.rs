//! Files that a kill at any moment leaves whole: read with what is expected, replaced in one step.

use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::path::Path;

use super::error::{StoreError, failed};
use safefs::Dir;

/// The bytes of the file `path`, which should be `expected`.
///
/// # Errors
/// If there is none, it cannot be read, or something else has its name, like a folder.
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

/// The file `path`, which should be `expected`, to be read.
///
/// # Errors
/// If there is none, or something else has its name, like a folder.
pub(super) fn open(path: &Path, expected: &'static str) -> Result<File, StoreError> {
    let unusable = |source| StoreError::Unusable {
        path: path.to_owned(),
        source,
        expected,
    };
    // A pipe would be waited for, without end.
    if !fs::metadata(path).map_err(unusable)?.is_file() {
        return Err(unusable(io::Error::other("is not a file")));
    }
    File::open(path).map_err(unusable)
}

/// Replaces the file `name` below `dir`: a kill leaves the old file or the new one. For what the
/// same command makes again, because after a power cut there may be neither.
///
/// # Errors
/// If the folder cannot be written, or a folder has the name.
pub(super) fn replace(dir: &Path, name: impl AsRef<Path>, bytes: &[u8]) -> Result<(), StoreError> {
    replace_after(dir, name.as_ref(), |file| file.write_all(bytes))
}

/// As [`replace`], and a power cut leaves the old file or the new one as well.
///
/// # Errors
/// As [`replace`].
pub(super) fn replace_for_good(
    dir: &Path,
    name: impl AsRef<Path>,
    bytes: &[u8],
) -> Result<(), StoreError> {
    replace_with(dir, name, |file| file.write_all(bytes))
}

/// As [`replace_for_good`], for what `write` writes bit by bit.
///
/// # Errors
/// As [`replace`].
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

/// Makes the folder `path` if there is none.
///
/// # Errors
/// If something else has its name, or it cannot be made.
pub(super) fn make_folder(path: &Path) -> Result<Dir, StoreError> {
    Dir::create(path).map_err(|source| StoreError::Unusable {
        path: path.to_owned(),
        source,
        expected: "a folder that can be written",
    })
}
