//! Files with names that the user gave.

use core::time::Duration;
use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::path::Path;
use std::thread;

use rustix::fs::{CWD, FileType, Mode, OFlags};
use rustix::io::Errno;

use crate::dir::{Dir, Last};

/// Number of attempts, and pause between them, to open a pipe that has no reader yet.
const PIPE_TRIES: u32 = 100;
const PIPE_PAUSE: Duration = Duration::from_millis(50);

/// The directory of the file `path`, and the name of the file in it.
fn place(path: &Path) -> io::Result<(Dir, OsString)> {
    let Some(name) = path.file_name() else {
        let message = "expected the name of a file";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
    };
    let parent = path.parent().unwrap_or(Path::new(""));
    Ok((Dir::open_as(parent, Last::Followed)?, name.to_owned()))
}

/// Writes the file `path` atomically: after a full disk or a kill, the earlier file or none
/// remains. A link of that name is replaced and its target stays unchanged. A pipe or a device is
/// written directly.
///
/// # Errors
/// System errors. In that case `path` stays unchanged.
pub fn write(path: &Path, bytes: impl AsRef<[u8]>) -> io::Result<()> {
    if let Some(mut file) = standing(path)? {
        return file.write_all(bytes.as_ref());
    }
    let (dir, name) = place(path)?;
    dir.write(name, bytes)
}

/// Creates an empty file `path`. A link of that name is replaced and its target stays unchanged. A
/// pipe or a device is opened directly.
///
/// # Errors
/// System errors; if a pipe has no reader after five seconds.
pub fn create(path: &Path) -> io::Result<File> {
    if let Some(file) = standing(path)? {
        return Ok(file);
    }
    let (dir, name) = place(path)?;
    dir.create_file(name)
}

/// Creates the folder for the file `path`.
///
/// # Errors
/// System errors.
pub fn create_parent(path: &Path) -> io::Result<()> {
    let parent = path.parent().unwrap_or(Path::new(""));
    Dir::create_as(parent, Last::Followed).map(drop)
}

/// Opens the file `path` for appending and creates it if it is missing.
///
/// # Errors
/// As [`Dir::append`].
pub fn append(path: &Path) -> io::Result<File> {
    let (dir, name) = place(path)?;
    dir.append(name)
}

/// Opens the file `path` for reading and writing and creates it if it is missing.
///
/// # Errors
/// As [`Dir::append`].
pub fn open_or_create(path: &Path) -> io::Result<File> {
    let (dir, name) = place(path)?;
    dir.open_or_create(name)
}

/// Opens the plain file `path` for reading. Use it for a file that the user did not name, such as a
/// file of a result folder: opening a pipe in its place could wait forever.
///
/// # Errors
/// If `path` is missing, a directory, a pipe, or another special file.
pub fn open(path: &Path) -> io::Result<File> {
    let flags = OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::CLOEXEC;
    let file: File = rustix::fs::openat(CWD, path, flags, Mode::empty())?.into();
    match file.metadata()?.is_file() {
        true => Ok(file),
        false => Err(io::Error::other("is not a file")),
    }
}

/// Reads the plain file `path`.
///
/// # Errors
/// As [`open`].
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads the plain file `path`, which must be UTF-8.
///
/// # Errors
/// As [`open`], and if the file is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    open(path)?.read_to_string(&mut text)?;
    Ok(text)
}

/// Removes the file `path`; of a link, only the link itself.
///
/// # Errors
/// If `path` is missing or is a directory.
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

/// Renames the file `from` to `to` in the same directory. A link is renamed itself.
///
/// # Errors
/// System errors; if `to` is in another directory.
pub fn rename(from: &Path, to: &Path) -> io::Result<()> {
    let (dir, name) = place(from)?;
    match to.file_name() {
        Some(new) if to.parent() == from.parent() => dir.rename(name, new),
        _ => Err(io::ErrorKind::CrossesDevices.into()),
    }
}

/// Opens `path` if it is written directly: a pipe, a device, or a descriptor of this process.
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

/// Opens a pipe; fails after five seconds without a reader.
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

/// Whether `path` is one of the system's links to the descriptors of a process.
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
