//! Files by the names that a user gives them.

use core::time::Duration;
use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::{self, Write as _};
use std::path::Path;
use std::thread;

use rustix::fs::{CWD, FileType, Mode, OFlags};
use rustix::io::Errno;

use crate::dir::{Dir, Last};

/// How often, and how long after each other, a pipe is tried that no program reads yet.
const PIPE_TRIES: u32 = 100;
const PIPE_PAUSE: Duration = Duration::from_millis(50);

/// The directory of the file that the user called `path`, and its name there.
fn place(path: &Path) -> io::Result<(Dir, OsString)> {
    let Some(name) = path.file_name() else {
        let message = "expected the name of a file";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
    };
    let parent = path.parent().unwrap_or(Path::new(""));
    Ok((Dir::open_as(parent, Last::Followed)?, name.to_owned()))
}

/// Writes the file `path` as a whole: a full disk or a kill leaves the earlier file or none. A
/// link of that name is replaced, and its target is not touched. A pipe or a device is written as
/// it is.
///
/// # Errors
/// Those of the system. Then `path` is as it was.
pub fn write(path: &Path, bytes: impl AsRef<[u8]>) -> io::Result<()> {
    if let Some(mut file) = standing(path)? {
        return file.write_all(bytes.as_ref());
    }
    let (dir, name) = place(path)?;
    dir.write(name, bytes)
}

/// A new, empty file `path`. A link of that name is replaced, and its target is not touched. A
/// pipe or a device is opened as it is.
///
/// # Errors
/// Those of the system; if a pipe has no reader after five seconds.
pub fn create(path: &Path) -> io::Result<File> {
    if let Some(file) = standing(path)? {
        return Ok(file);
    }
    let (dir, name) = place(path)?;
    dir.create_file(name)
}

/// Makes the folder in which the file `path` shall be.
///
/// # Errors
/// Those of the system.
pub fn create_parent(path: &Path) -> io::Result<()> {
    let parent = path.parent().unwrap_or(Path::new(""));
    Dir::create_as(parent, Last::Followed).map(drop)
}

/// The file `path` to be appended to, made if it is missing.
///
/// # Errors
/// As [`Dir::append`].
pub fn append(path: &Path) -> io::Result<File> {
    let (dir, name) = place(path)?;
    dir.append(name)
}

/// The file `path` to be read and written, made if it is missing.
///
/// # Errors
/// As [`Dir::append`].
pub fn open_or_create(path: &Path) -> io::Result<File> {
    let (dir, name) = place(path)?;
    dir.open_or_create(name)
}

/// Removes the file `path`; a link goes itself.
///
/// # Errors
/// If there is none, or it is a directory.
pub fn remove_file(path: &Path) -> io::Result<()> {
    let (dir, name) = place(path)?;
    dir.remove_file(name)
}

/// Removes the empty folder `path`.
///
/// # Errors
/// If it is not empty, or no folder.
pub fn remove_dir(path: &Path) -> io::Result<()> {
    let (dir, name) = place(path)?;
    dir.remove_dir(name)
}

/// Gives the file `from` the name `to` in the same directory. A link is renamed itself.
///
/// # Errors
/// Those of the system; if `to` is in another directory.
pub fn rename(from: &Path, to: &Path) -> io::Result<()> {
    let (dir, name) = place(from)?;
    match to.file_name() {
        Some(new) if to.parent() == from.parent() => dir.rename(name, new),
        _ => Err(io::ErrorKind::CrossesDevices.into()),
    }
}

/// What has the name `path` and is written as it is: a pipe, a device, a descriptor of this
/// process.
fn standing(path: &Path) -> io::Result<Option<File>> {
    if is_descriptor(path) {
        let flags = OFlags::WRONLY | OFlags::CLOEXEC;
        return Ok(Some(
            rustix::fs::openat(CWD, path, flags, Mode::empty())?.into(),
        ));
    }
    let (dir, name) = place(path)?;
    match dir.kind(&name)? {
        Some(FileType::Fifo) => open_pipe(&dir, &name).map(Some),
        Some(FileType::CharacterDevice | FileType::BlockDevice) => {
            dir.open_special(&name, OFlags::NOCTTY).map(Some)
        }
        _ => Ok(None),
    }
}

/// Opens a pipe without waiting forever for its reader.
#[expect(
    clippy::disallowed_methods,
    reason = "no rig runs yet: a reader that starts at the same time is waited for"
)]
fn open_pipe(dir: &Dir, name: &OsStr) -> io::Result<File> {
    for _ in 0..PIPE_TRIES {
        match dir.open_special(name, OFlags::NONBLOCK) {
            Ok(pipe) => {
                let flags = rustix::fs::fcntl_getfl(&pipe)?;
                rustix::fs::fcntl_setfl(&pipe, flags - OFlags::NONBLOCK)?;
                return Ok(pipe);
            }
            Err(error) if Errno::from_io_error(&error) == Some(Errno::NXIO) => {}
            Err(error) => return Err(error),
        }
        thread::sleep(PIPE_PAUSE);
    }
    let message = "is a pipe that no program reads; start the reader first, or remove the pipe";
    Err(io::Error::new(io::ErrorKind::TimedOut, message))
}

/// Links that the system has for the descriptors of a process.
fn is_descriptor(path: &Path) -> bool {
    let is_number = |name: &OsStr| {
        let name = name.as_encoded_bytes();
        !name.is_empty() && name.iter().all(u8::is_ascii_digit)
    };
    let folders = ["/dev/fd", "/proc/self/fd"].map(Path::new);
    let streams = ["/dev/stdout", "/dev/stderr"].map(Path::new);
    streams.contains(&path)
        || path
            .parent()
            .is_some_and(|parent| folders.contains(&parent))
            && path.file_name().is_some_and(is_number)
}
