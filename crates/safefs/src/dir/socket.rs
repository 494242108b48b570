//! Sockets in a directory.

use std::io;
use std::os::unix::net::UnixListener;
use std::path::Path;

use rustix::fs::{self, AtFlags, FileType, Mode};
use rustix::net::{AddressFamily, SocketAddrUnix, SocketType};

use super::{Dir, one};

/// Maximum number of connections that wait to be accepted.
const BACKLOG: i32 = 128;

impl Dir {
    /// Creates a socket `name` to which only this user may connect, whatever the umask. No entry of
    /// that name may exist.
    ///
    /// # Errors
    /// System errors; `AddrInUse` if an entry of that name exists.
    pub fn listen(&self, name: impl AsRef<Path>) -> io::Result<UnixListener> {
        let name = one(name.as_ref())?;
        let socket = rustix::net::socket(AddressFamily::UNIX, SocketType::STREAM, None)?;
        rustix::io::fcntl_setfd(&socket, rustix::io::FdFlags::CLOEXEC)?;
        let mode = Mode::RUSR | Mode::WUSR;
        // On Linux, the file inherits the permissions of the socket. Other systems may refuse
        // `fchmod`.
        let _ = fs::fchmod(&socket, mode);
        rustix::net::bind(&socket, &SocketAddrUnix::new(self.path.join(name))?)?;
        let stat = self.stat(name)?;
        let made = stat.filter(|it| FileType::from_raw_mode(it.st_mode) == FileType::Socket);
        let Some(made) = made else {
            return Err(io::Error::other("the directory was exchanged"));
        };
        if Mode::from_raw_mode(made.st_mode) & Mode::from_raw_mode(0o777) != mode {
            fs::chmodat(self.fd(), name, mode, AtFlags::empty())?;
        }
        // A client can connect only from here on, when the permissions are already set.
        rustix::net::listen(&socket, BACKLOG)?;
        Ok(socket.into())
    }

    /// Whether `name` is a socket.
    pub fn is_socket(&self, name: impl AsRef<Path>) -> bool {
        let kind = one(name.as_ref()).and_then(|name| self.kind(name));
        kind.is_ok_and(|kind| kind == Some(FileType::Socket))
    }
}
