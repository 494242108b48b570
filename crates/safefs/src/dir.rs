//! A directory, addressed by an open handle.

mod socket;

use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::os::fd::{AsFd as _, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Component, Path, PathBuf};

use rustix::fs::{self, AtFlags, CWD, FileType, Mode, OFlags, Stat};
use rustix::io::Errno;

/// Root of the default folders. The user never types this name, so a link with this name was not
/// intended by the user.
const DEFAULT_ROOT: &str = "hilrig-out";
/// Permissions of new files and folders before the umask.
const FILE_MODE: u32 = 0o666;
const FOLDER_MODE: u32 = 0o777;

/// Flags of a handle for `openat`, without the right to list where the system supports such
/// handles.
#[cfg(target_os = "linux")]
const HANDLE: OFlags = OFlags::PATH;
#[cfg(not(target_os = "linux"))]
const HANDLE: OFlags = OFlags::RDONLY;

/// Treatment of a link as the last component of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Last {
    /// The component is opened only if it is a directory, not a link.
    NoLink,
    /// A link is followed: the component is an ancestor of the path that the user named.
    Followed,
}

/// An open directory. Its files are reached relative to the handle, never through a link.
#[derive(Debug)]
pub struct Dir {
    fd: OwnedFd,
    path: PathBuf,
}

impl Dir {
    /// Opens the directory `path`, which must exist.
    ///
    /// # Errors
    /// If `path` is missing, no directory, or a link.
    pub fn open(path: &Path) -> io::Result<Self> {
        Self::open_as(path, Last::NoLink)
    }

    /// Opens the directory `path` and creates missing directories.
    ///
    /// # Errors
    /// If `path` cannot be created, is no directory, or is a link.
    pub fn create(path: &Path) -> io::Result<Self> {
        Self::create_as(path, Last::NoLink)
    }

    pub(crate) fn open_as(path: &Path, last: Last) -> io::Result<Self> {
        let (Some(name), Some(parent)) = (path.file_name(), path.parent()) else {
            // The path is the root, the working directory, or ends in `..`.
            let path = if path == Path::new("") {
                Path::new(".")
            } else {
                path
            };
            let flags = HANDLE | OFlags::DIRECTORY | OFlags::CLOEXEC;
            let fd = fs::openat(CWD, path, flags, Mode::empty())?;
            let path = path.to_owned();
            return Ok(Self { fd, path });
        };
        let last = if is_default(path) { Last::NoLink } else { last };
        Self::open_as(parent, Last::Followed)?.folder(name, path, last)
    }

    pub(crate) fn create_as(path: &Path, last: Last) -> io::Result<Self> {
        match Self::open_as(path, last) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            other => return other,
        }
        let (Some(name), Some(parent)) = (path.file_name(), path.parent()) else {
            return Err(io::ErrorKind::NotFound.into());
        };
        let parent = Self::create_as(parent, Last::Followed)?;
        parent.make(name)?;
        parent.folder(name, path, last)
    }

    /// Opens the folder `relative` below this one and creates missing folders.
    ///
    /// # Errors
    /// If `relative` leads outside, is no directory, or a component is a link.
    pub fn below(&self, relative: impl AsRef<Path>) -> io::Result<Self> {
        let mut dir = self.again()?;
        for component in relative.as_ref().components() {
            let Component::Normal(name) = component else {
                return Err(outside(relative.as_ref()));
            };
            dir.make(name)?;
            let path = dir.path.join(name);
            dir = dir.folder(name, &path, Last::NoLink)?;
        }
        Ok(dir)
    }

    /// Opens a second handle of the same directory.
    ///
    /// # Errors
    /// If the process has no descriptor left.
    pub fn again(&self) -> io::Result<Self> {
        let (fd, path) = (self.fd.try_clone()?, self.path.clone());
        Ok(Self { fd, path })
    }

    /// The path with which the directory was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }

    fn make(&self, name: &OsStr) -> io::Result<()> {
        match fs::mkdirat(self.fd(), name, Mode::from_raw_mode(FOLDER_MODE)) {
            Ok(()) | Err(Errno::EXIST) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }

    /// Opens the folder `name`; error messages call it `path`.
    fn folder(&self, name: &OsStr, path: &Path, last: Last) -> io::Result<Self> {
        let mut flags = HANDLE | OFlags::DIRECTORY | OFlags::CLOEXEC;
        if last == Last::NoLink {
            flags |= OFlags::NOFOLLOW;
        }
        match fs::openat(self.fd(), name, flags, Mode::empty()) {
            Ok(fd) => Ok(Self {
                fd,
                path: path.to_owned(),
            }),
            Err(error) => Err(match (last, self.read_link(name)) {
                (Last::NoLink, Ok(target)) => linked(&target),
                _ => error.into(),
            }),
        }
    }

    /// Status of the entry `name`, if it exists. The status of a link is that of the link itself.
    fn stat(&self, name: &OsStr) -> io::Result<Option<Stat>> {
        match fs::statat(self.fd(), name, AtFlags::SYMLINK_NOFOLLOW) {
            Ok(stat) => Ok(Some(stat)),
            Err(Errno::NOENT) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// File type of the entry `name`.
    pub(crate) fn kind(&self, name: &OsStr) -> io::Result<Option<FileType>> {
        Ok(self
            .stat(name)?
            .map(|stat| FileType::from_raw_mode(stat.st_mode)))
    }

    /// Whether `file` still has the name `name`.
    pub fn holds(&self, name: impl AsRef<Path>, file: &File) -> bool {
        let there = one(name.as_ref()).and_then(|name| self.stat(name));
        match (there, fs::fstat(file)) {
            (Ok(Some(there)), Ok(held)) => {
                (there.st_dev, there.st_ino) == (held.st_dev, held.st_ino)
            }
            _ => false,
        }
    }

    /// Writes the file `name` atomically: after a full disk or a kill, the earlier file or none
    /// remains. An existing entry of that name, such as a link, is replaced.
    ///
    /// # Errors
    /// System errors; if `name` is a directory or leads outside.
    pub fn write(&self, name: impl AsRef<Path>, bytes: impl AsRef<[u8]>) -> io::Result<()> {
        self.write_with(name, |file| file.write_all(bytes.as_ref()))
    }

    /// Writes the file `name` atomically, as [`write`](Self::write) does; `write` supplies the
    /// bytes in several steps.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_with(
        &self,
        name: impl AsRef<Path>,
        write: impl FnOnce(&mut File) -> io::Result<()>,
    ) -> io::Result<()> {
        let (dir, name) = self.place(name.as_ref())?;
        if dir.kind(&name)? == Some(FileType::Directory) {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        let mut part = name.clone();
        part.push(".part");
        let mut file = dir.new_file(&part)?;
        let written = write(&mut file).and_then(|()| {
            fs::renameat(dir.fd(), &part, dir.fd(), &name)?;
            Ok(())
        });
        written.inspect_err(|_| drop(dir.unlink(&part)))
    }

    /// Creates an empty file `name`. An existing entry of that name, such as a link, is removed.
    ///
    /// # Errors
    /// System errors; if `name` is a directory or leads outside.
    pub fn create_file(&self, name: impl AsRef<Path>) -> io::Result<File> {
        let (dir, name) = self.place(name.as_ref())?;
        match dir.new_file(&name) {
            Err(error) if may_be_fixed(&error) => {
                // The file may be writable in a read-only directory, or may be a mount point.
                let file = dir.open_own(&name, OFlags::WRONLY).map_err(|_| error)?;
                file.set_len(0)?;
                Ok(file)
            }
            other => other,
        }
    }

    fn new_file(&self, name: &OsStr) -> io::Result<File> {
        let flags = OFlags::RDWR | OFlags::CREATE | OFlags::EXCL | OFlags::NOFOLLOW;
        let mode = Mode::from_raw_mode(FILE_MODE);
        let open = || fs::openat(self.fd(), name, flags | OFlags::CLOEXEC, mode);
        let fd = match open() {
            Err(Errno::EXIST) => {
                self.unlink(name)?;
                open()?
            }
            other => other?,
        };
        Ok(fd.into())
    }

    /// Opens the file `name` for appending and creates it if it is missing.
    ///
    /// # Errors
    /// If `name` is a link, has a second name (hard link), is no plain file, or belongs to another
    /// user.
    pub fn append(&self, name: impl AsRef<Path>) -> io::Result<File> {
        self.own(name.as_ref(), OFlags::RDWR | OFlags::APPEND)
    }

    /// Opens the file `name` for reading and writing and creates it if it is missing.
    ///
    /// # Errors
    /// As [`append`](Self::append).
    pub fn open_or_create(&self, name: impl AsRef<Path>) -> io::Result<File> {
        self.own(name.as_ref(), OFlags::RDWR)
    }

    fn own(&self, name: &Path, flags: OFlags) -> io::Result<File> {
        let (dir, name) = self.place(name)?;
        match dir.open_own(&name, flags) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let new = OFlags::CREATE | OFlags::EXCL | OFlags::NOFOLLOW | OFlags::CLOEXEC;
                let mode = Mode::from_raw_mode(FILE_MODE);
                match fs::openat(dir.fd(), &name, flags | new, mode) {
                    // Another process created the file in the meantime.
                    Err(Errno::EXIST) => dir.open_own(&name, flags),
                    made => Ok(made?.into()),
                }
            }
            other => other,
        }
    }

    /// Opens an existing file only if writing it changes nothing outside this directory.
    fn open_own(&self, name: &OsStr, flags: OFlags) -> io::Result<File> {
        let flags = flags | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let file: File = match fs::openat(self.fd(), name, flags, Mode::empty()) {
            Ok(fd) => fd.into(),
            Err(error) => {
                return Err(match self.read_link(name) {
                    Ok(target) => linked(&target),
                    Err(_) => error.into(),
                });
            }
        };
        let meta = file.metadata()?;
        let refused = |why| Err(io::Error::new(io::ErrorKind::PermissionDenied, why));
        if !meta.is_file() {
            return Err(io::Error::other("is not a file"));
        }
        if meta.nlink() > 1 {
            return refused("has a second name elsewhere (hard link); remove it or copy the file");
        }
        let own = rustix::process::geteuid().as_raw();
        if meta.uid() != own && Some(meta.uid()) != self.owner() {
            return refused("belongs to another user; choose another directory or remove it");
        }
        Ok(file)
    }

    /// Opens a pipe or a device for writing.
    pub(crate) fn open_special(&self, name: &OsStr, flags: OFlags) -> io::Result<File> {
        let flags = flags | OFlags::WRONLY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        Ok(fs::openat(self.fd(), name, flags, Mode::empty())?.into())
    }

    fn owner(&self) -> Option<u32> {
        fs::fstat(&self.fd).ok().map(|stat| stat.st_uid)
    }

    /// Reads at most `most` bytes of the plain file `name`.
    ///
    /// # Errors
    /// If `name` is missing, a link, a pipe, or another special file.
    pub fn read(&self, name: impl AsRef<Path>, most: u64) -> io::Result<Vec<u8>> {
        let (dir, name) = self.existing(name.as_ref())?;
        let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let file: File = fs::openat(dir.fd(), &name, flags, Mode::empty())?.into();
        if !file.metadata()?.is_file() {
            return Err(io::Error::other("is not a file"));
        }
        let mut bytes = Vec::new();
        file.take(most).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    /// Removes the file `name`; of a link, only the link itself.
    ///
    /// # Errors
    /// If `name` is missing, is a directory, or leads outside.
    pub fn remove_file(&self, name: impl AsRef<Path>) -> io::Result<()> {
        let (dir, name) = self.existing(name.as_ref())?;
        dir.unlink(&name)
    }

    /// Removes the folder `name` and its content; of a link, only the link itself.
    ///
    /// # Errors
    /// If an entry cannot be removed.
    pub fn remove_tree(&self, name: impl AsRef<Path>) -> io::Result<()> {
        let (dir, name) = self.existing(name.as_ref())?;
        if dir.kind(&name)? != Some(FileType::Directory) {
            return dir.unlink(&name);
        }
        let path = dir.path.join(&name);
        let folder = dir.folder(&name, &path, Last::NoLink)?;
        for name in folder.names()? {
            folder.remove_tree(&name)?;
        }
        fs::unlinkat(dir.fd(), &name, AtFlags::REMOVEDIR)?;
        Ok(())
    }

    /// Removes the empty folder `name`.
    ///
    /// # Errors
    /// If it is not empty, or no folder.
    pub fn remove_dir(&self, name: impl AsRef<Path>) -> io::Result<()> {
        let (dir, name) = self.existing(name.as_ref())?;
        fs::unlinkat(dir.fd(), &name, AtFlags::REMOVEDIR)?;
        Ok(())
    }

    /// Sorted names of all entries of the directory.
    ///
    /// # Errors
    /// If it cannot be listed.
    pub fn names(&self) -> io::Result<Vec<OsString>> {
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC;
        let mut names = Vec::new();
        for entry in fs::Dir::new(fs::openat(self.fd(), ".", flags, Mode::empty())?)? {
            let name = OsStr::from_bytes(entry?.file_name().to_bytes()).to_owned();
            if name != "." && name != ".." {
                names.push(name);
            }
        }
        names.sort();
        Ok(names)
    }

    /// Renames the file `from` to `to`; both lie below this directory.
    ///
    /// # Errors
    /// System errors.
    pub fn rename(&self, from: impl AsRef<Path>, to: impl AsRef<Path>) -> io::Result<()> {
        let (from, old) = self.existing(from.as_ref())?;
        let (to, new) = self.place(to.as_ref())?;
        fs::renameat(from.fd(), &old, to.fd(), &new)?;
        Ok(())
    }

    /// Creates a symbolic link `name` to `target`. No entry of that name may exist.
    ///
    /// # Errors
    /// System errors.
    pub fn link(&self, name: impl AsRef<Path>, target: &Path) -> io::Result<()> {
        fs::symlinkat(target, self.fd(), one(name.as_ref())?)?;
        Ok(())
    }

    /// Target of the link `name`.
    ///
    /// # Errors
    /// If `name` is no link.
    pub fn read_link(&self, name: impl AsRef<Path>) -> io::Result<PathBuf> {
        let target = fs::readlinkat(self.fd(), one(name.as_ref())?, Vec::new())?;
        Ok(PathBuf::from(OsStr::from_bytes(target.to_bytes())))
    }

    fn unlink(&self, name: &OsStr) -> io::Result<()> {
        Ok(fs::unlinkat(self.fd(), name, AtFlags::empty())?)
    }

    /// The folder of the file `relative`, created if missing, and the name of the file in it.
    fn place(&self, relative: &Path) -> io::Result<(Self, OsString)> {
        let (parent, name) = split(relative)?;
        Ok((self.below(parent)?, name))
    }

    /// As `place`, but without creating folders.
    fn existing(&self, relative: &Path) -> io::Result<(Self, OsString)> {
        let (parent, name) = split(relative)?;
        let mut dir = self.again()?;
        for component in parent.components() {
            let Component::Normal(name) = component else {
                return Err(outside(relative));
            };
            let path = dir.path.join(name);
            dir = dir.folder(name, &path, Last::NoLink)?;
        }
        Ok((dir, name))
    }
}

/// Splits a relative path into its folder and its file name.
fn split(relative: &Path) -> io::Result<(&Path, OsString)> {
    let name = match relative.components().next_back() {
        Some(Component::Normal(name)) => name.to_owned(),
        _ => return Err(outside(relative)),
    };
    Ok((relative.parent().unwrap_or(Path::new("")), name))
}

/// `name` if it is a single component: no separator, not `..`, not absolute.
fn one(name: &Path) -> io::Result<&OsStr> {
    let mut components = name.components();
    match (components.next(), components.next()) {
        (Some(Component::Normal(only)), None) if only == name.as_os_str() => Ok(only),
        _ => Err(outside(name)),
    }
}

/// Whether the first component of `path` is the default folder.
fn is_default(path: &Path) -> bool {
    path.components().next() == Some(Component::Normal(DEFAULT_ROOT.as_ref()))
}

/// Whether a file can still be written in place after this error.
fn may_be_fixed(error: &io::Error) -> bool {
    matches!(
        Errno::from_io_error(error),
        Some(Errno::ACCESS | Errno::PERM | Errno::BUSY)
    )
}

fn outside(path: &Path) -> io::Error {
    let path = path.display();
    let message = format!("{path:?} leads outside of the directory; expected a plain name");
    io::Error::new(io::ErrorKind::InvalidInput, message)
}

fn linked(target: &Path) -> io::Error {
    let target = target.display();
    let message = format!(
        "is a symbolic link to {target}, and hilrig does not write through links; name its target"
    );
    io::Error::new(io::ErrorKind::PermissionDenied, message)
}
